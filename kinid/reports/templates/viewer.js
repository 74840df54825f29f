"use strict";
const THREE = MeshCat.THREE, $ = id => document.getElementById(id);
// without a graphics card, four samples a pixel cost more than half of the frames: there, only what stands still has them
let card = true;
function renderer() {
  const probe = document.createElement("canvas").getContext("webgl"), driver = probe && probe.getExtension("WEBGL_debug_renderer_info");
  const name = driver ? probe.getParameter(driver.UNMASKED_RENDERER_WEBGL) : "";
  card = !/swiftshader|llvmpipe|software|basic render/i.test(name);
  const out = new THREE.WebGLRenderer({antialias: card, alpha: true});
  out.shadowMap.enabled = true;
  $("pane").appendChild(out.domElement);
  return out;
}
const viewer = new MeshCat.Viewer($("pane"), true, renderer());
function bytes(text) {
  const raw = atob(text), out = new Uint8Array(raw.length);
  for (let i = 0; i < raw.length; i++) out[i] = raw.charCodeAt(i);
  return out;
}
const dark = matchMedia("(prefers-color-scheme: dark)"), css = name => getComputedStyle(document.documentElement).getPropertyValue(name).trim();
// a colour of the light page in the colours of this one
const tone = hex => css("--c" + hex.slice(1)) || hex;
const floats = text => new Float32Array(bytes(text).buffer);
const kinid = window.kinid = {viewer, errors: [], frame: 0, playing: false, shown: 0, updates: 0};
window.addEventListener("error", e => kinid.errors.push(String(e.message)));

const REST = 300;  // ms
let drawn = 0, sharp = false;
function sharpness(still) {
  if (card || sharp === still) return;
  sharp = still;
  viewer.renderer.setPixelRatio(still ? Math.max(2, window.devicePixelRatio) : 1);
}
const draw = viewer.render.bind(viewer);
viewer.render = () => { sharpness(false); draw(); drawn = performance.now(); };
function rest() {
  if (card || sharp || performance.now() - drawn < REST) return;
  sharpness(true);
  draw();
}

function place(path, object) { viewer.set_object(["kinid", ...path], object); viewer.set_dirty(); }

// meshcat's camera turns about an upright y axis; the world's z points up
const eye = (x, y, z) => new THREE.Vector3(x, z, -y);

function dress() {
  viewer.set_property(["Background"], "top_color", dark.matches ? [0.10, 0.12, 0.16] : [0.93, 0.95, 0.98]);
  viewer.set_property(["Background"], "bottom_color", dark.matches ? [0.22, 0.25, 0.30] : [0.80, 0.84, 0.89]);
  for (const name of ["Axes", "Grid"]) viewer.set_property([name], "visible", false);
  // shadows are drawn anew only when the arm has moved
  Object.assign(viewer.renderer.shadowMap, {autoUpdate: false, type: THREE.PCFShadowMap});
}

const NEAR = 2, FAR = 6;  // the ground fades out between so many times the size of what stands on it
const nice = most => { const p = 10 ** Math.floor(Math.log10(most)); return (most / p >= 5 ? 5 : most / p >= 2 ? 2 : 1) * p; };
const length = metres => metres >= 1 ? metres.toFixed(0) + " m" : (1e3 * metres).toPrecision(1) * 1 + " mm";
const fade = (r, size) => Math.min(Math.max((FAR - r / size) / (FAR - NEAR), 0), 1);

function shaded(geometry, material, size, strength) {
  const p = geometry.attributes.position, rgba = new Float32Array(4 * p.count).fill(1);
  for (let i = 0; i < p.count; i++) rgba[4 * i + 3] = strength * fade(Math.hypot(p.getX(i), p.getY(i)), size);
  geometry.setAttribute("color", new THREE.BufferAttribute(rgba, 4));
  return Object.assign(material, {vertexColors: true, transparent: true});
}

// a floor with lines a round number of millimetres apart, and a sun whose shadows are as sharp as the scene is small
function setGround(g) {
  const disc = new THREE.RingGeometry(0, FAR * g.size, 48, 12), pitch = nice(g.size / 6), lines = [], reach = Math.ceil(FAR * g.size / pitch);
  const ground = new THREE.Mesh(disc, shaded(disc, new THREE.MeshLambertMaterial({color: dark.matches ? 0x3a424e : 0x949da9}), g.size, 1));
  ground.position.set(...g.centre); ground.receiveShadow = true; ground.renderOrder = -2;
  place(["ground"], ground);
  for (let i = -reach; i <= reach; i++) for (let j = -FAR; j < FAR; j++) {
    const a = i * pitch, b = j * g.size;
    if (Math.hypot(a, b) < FAR * g.size) lines.push(a, b, 0, a, b + g.size, 0, b, a, 0, b + g.size, a, 0);
  }
  const mesh = new THREE.BufferGeometry();
  mesh.setAttribute("position", new THREE.Float32BufferAttribute(lines, 3));
  const grid = new THREE.LineSegments(mesh, shaded(mesh, new THREE.LineBasicMaterial({color: 0x5b6673, depthWrite: false}), g.size, 0.55));
  grid.position.set(g.centre[0], g.centre[1], g.centre[2] + 2e-3 * g.size); grid.renderOrder = -1;
  place(["grid"], grid);
  const sun = new THREE.DirectionalLight(0xffffff, 0.35), reached = 1.3 * g.size;
  sun.position.set(g.centre[0] + 1.2 * g.size, g.centre[1] - 1.5 * g.size, g.centre[2] + 3 * g.size);
  sun.target.position.set(...g.centre); sun.castShadow = true;
  sun.shadow.mapSize.set(1024, 1024); sun.shadow.normalBias = 2e-3 * g.size;
  Object.assign(sun.shadow.camera, {left: -reached, right: reached, top: reached, bottom: -reached, near: 0.5 * g.size, far: 6 * g.size});
  const light = new THREE.Group();
  light.add(sun); light.add(sun.target);
  place(["sun"], light);
  $("pitch").hidden = $("legend").hidden = false;
  $("pitch").lastChild.textContent = "squares on the ground: " + length(pitch);
  viewer.renderer.shadowMap.needsUpdate = true;
}

function label(text, size) {
  const canvas = document.createElement("canvas"), pen = canvas.getContext("2d"), font = "600 52px system-ui, sans-serif";
  pen.font = font;
  canvas.width = Math.ceil(pen.measureText(text).width) + 16; canvas.height = 68;
  pen.font = font; pen.textBaseline = "middle"; pen.lineJoin = "round";
  pen.lineWidth = 9; pen.strokeStyle = "rgba(255,255,255,.9)"; pen.strokeText(text, 8, 36);
  pen.fillStyle = "#1f2937"; pen.fillText(text, 8, 36);
  const skin = new THREE.Texture(canvas);
  skin.minFilter = THREE.LinearFilter; skin.needsUpdate = true;
  const sprite = new THREE.Sprite(new THREE.SpriteMaterial({map: skin, depthWrite: false}));
  sprite.scale.set(size * canvas.width / canvas.height, size, 1);
  sprite.renderOrder = 5;
  return sprite;
}

// both tangents along two edges of the surface, with their distance from the surface's point in millimetres
let axes = null;
function setAxes(a) {
  const group = new THREE.Group(), [t1, t2, n] = a.axes.map(v => new THREE.Vector3(...v)), size = (window.innerWidth <= 640 ? 0.08 : 0.05) * Math.max(a.high[0] - a.low[0], a.high[1] - a.low[1]);
  const at = (u, v) => new THREE.Vector3(...a.point).addScaledVector(t1, u).addScaledVector(t2, v).addScaledVector(n, 0.01 * size);
  const ends = [], put = (text, where, big, k) => {
    const s = label(text, big * size);
    s.center.set(k === 0 ? 0.5 : 0, 0.5);
    s.position.copy(where).addScaledVector(n, 0.4 * size);
    group.add(s);
  };
  const gap = 0.7 * size;
  for (const k of [0, 1]) {
    const to = (u, off) => k === 0 ? at(u, a.low[1] - off) : at(a.high[0] + off, u);
    const step = nice((a.high[k] - a.low[k]) / 2.5);
    ends.push(to(a.low[k], gap), to(a.high[k], gap));
    for (let u = Math.ceil(a.low[k] / step - 1e-9) * step; u <= a.high[k] + 1e-9; u += step) {
      ends.push(to(u, gap), to(u, 1.3 * gap));
      put((1e3 * u).toFixed(step < 1e-3 ? 1 : 0).replace("-0", "0").replace("-", "−"), to(u, (k === 0 ? 2.3 : 1.5) * gap), 1, k);
    }
    put("tangent " + (k + 1) + " [mm]", to(0.5 * (a.low[k] + a.high[k]), (k === 0 ? 6 : 4.2) * gap), 1.1, k);
  }
  group.add(new THREE.LineSegments(new THREE.BufferGeometry().setFromPoints(ends), new THREE.LineBasicMaterial({color: 0x1f2937})));
  axes = {group, size};
  place(["axes"], group);
}

function shape(s) {
  let g;
  if (s.kind === "box") g = new THREE.BoxGeometry(...s.size);
  else if (s.kind === "sphere") g = new THREE.SphereGeometry(s.size[0], 28, 20);
  else { g = new THREE.CylinderGeometry(s.size[0], s.size[0], s.size[1], 36); g.rotateX(Math.PI / 2); }
  const m = new THREE.Mesh(g, new THREE.MeshPhongMaterial({color: new THREE.Color(...s.color.slice(0, 3)), shininess: 40}));
  m.applyMatrix4(new THREE.Matrix4().fromArray(s.matrix));
  m.castShadow = m.receiveShadow = true;
  return m;
}

const FORCES = [["measured", "#D55E00"], ["predicted", "#0072B2"]];
let joints = [], motion = null, arrows = {};
function setRobot(robot) {
  joints = robot.joints.map((shapes, i) => {
    const group = new THREE.Group();
    shapes.forEach(s => group.add(shape(s)));
    place(["robot", "joint" + i], group);
    return group;
  });
  pose(floats(robot.zero), 0);
}

// where something happened
function setMarks(marks) {
  const group = new THREE.Group();
  for (const mark of marks) {
    const ball = new THREE.Mesh(new THREE.SphereGeometry(0.003, 14, 10), new THREE.MeshLambertMaterial({color: mark.color}));
    ball.position.set(...mark.at);
    group.add(ball);
  }
  kinid.marks = marks.length;
  place(["marks"], group);
  $("facts").textContent = marks[marks.length - 1].says;
}

function setMotion(m) {
  motion = {t: floats(m.t), poses: floats(m.poses), n: m.n, joints: m.joints, tip: m.tip ? floats(m.tip) : null, forces: {}, scale: m.scale,
            phase: m.phase || []};
  for (const [name, color] of FORCES) {
    if (!m[name]) continue;
    motion.forces[name] = floats(m[name]);
    const thick = name === "measured" ? 1 : 0.75;
    const group = new THREE.Group(), skin = new THREE.MeshPhongMaterial({color: tone(color), depthTest: false, transparent: true, opacity: 0.95});
    const shaft = new THREE.Mesh(new THREE.CylinderGeometry(0.004 * thick, 0.004 * thick, 1, 16), skin);
    const head = new THREE.Mesh(new THREE.ConeGeometry(0.010 * thick, 0.024, 20), skin);
    shaft.renderOrder = head.renderOrder = 10;
    group.add(shaft); group.add(head);
    arrows[name] = {group, shaft, head};
    place(["force", name], group);
    $("forces").hidden = $("newton").hidden = false;
  }
  if (motion.scale) $("newton").lastChild.textContent = "an arrow of 10 mm: " + (0.01 / motion.scale).toPrecision(2) + " N";
  $("time").hidden = false;
  $("strip").hidden = !Object.keys(motion.forces).length;
  drawStrip();
  if (Object.keys(motion.forces).length) $("legend").hidden = false;
  $("at").max = motion.n - 1; $("at").step = 1;
  show(Math.min(kinid.frame, motion.n - 1));
}

// the sizes of the forces over the whole time, and where one is
const HEAD = 14;  // pixels, for what is written
let strip = null;
function drawStrip() {
  const canvas = $("strip"), w = canvas.clientWidth, h = canvas.clientHeight, fine = window.devicePixelRatio || 1;
  strip = null;
  if (!w || !motion) return;
  canvas.width = w * fine; canvas.height = h * fine;
  const sizes = FORCES.filter(([name]) => motion.forces[name]).map(([name, color]) =>
    [color, Float32Array.from({length: motion.n}, (_, i) => Math.hypot(...motion.forces[name].subarray(3 * i, 3 * i + 3)))]);
  const top = 1.05 * sizes.reduce((most, [, f]) => f.reduce((a, b) => Math.max(a, b), most), 1e-9), end = motion.t[motion.n - 1] || 1;
  const pen = canvas.getContext("2d", {willReadFrequently: true});
  pen.scale(fine, fine); pen.lineWidth = 1.2;
  for (const [color, f] of sizes) {
    pen.beginPath(); pen.strokeStyle = tone(color);
    f.forEach((size, i) => pen.lineTo(w * motion.t[i] / end, h - (h - HEAD) * size / top));
    pen.stroke();
  }
  pen.fillStyle = css("--soft"); pen.font = "11px system-ui, sans-serif";
  pen.fillText("size of the force, up to " + (top / 1.05).toPrecision(3) * 1 + " N", 4, 11);
  strip = {canvas, w, h, end, base: pen.getImageData(0, 0, canvas.width, canvas.height)};
}
function markStrip() {
  if (!strip) return;
  const pen = strip.canvas.getContext("2d");
  pen.putImageData(strip.base, 0, 0);
  pen.fillStyle = css("--ink");
  pen.fillRect(strip.w * motion.t[kinid.frame] / strip.end - 0.5, 0, 1.5, strip.h);
}
$("strip").onclick = e => {
  const t = motion.t[motion.n - 1] * e.offsetX / $("strip").clientWidth;
  play(false);
  show(Math.max(0, motion.t.findIndex(at => at >= t)));
};

function pose(p, frame) {
  joints.forEach((joint, j) => {
    const k = (frame * joints.length + j) * 7;
    joint.position.set(p[k], p[k + 1], p[k + 2]);
    joint.quaternion.set(p[k + 3], p[k + 4], p[k + 5], p[k + 6]);
  });
}

function show(frame) {
  if (!motion) return;
  kinid.frame = frame;
  pose(motion.poses, frame);
  let newtons = "";
  for (const name in motion.forces) {
    const f = motion.forces[name], a = arrows[name];
    const v = new THREE.Vector3(f[3 * frame], f[3 * frame + 1], f[3 * frame + 2]), size = v.length();
    if (name === "measured" && isFinite(size)) newtons = "  " + size.toFixed(2) + " N";
    const length = size * motion.scale;
    a.group.visible = isFinite(length) && length > 0.004;
    if (!a.group.visible) continue;
    // the two stand beside each other, so that equal ones are both seen
    a.group.position.set(motion.tip[3 * frame] + (name === "measured" ? -0.02 : 0.02), motion.tip[3 * frame + 1], motion.tip[3 * frame + 2]);
    a.group.quaternion.setFromUnitVectors(new THREE.Vector3(0, 1, 0), v.normalize());
    a.shaft.scale.y = length; a.shaft.position.y = length / 2; a.head.position.y = length;
  }
  viewer.renderer.shadowMap.needsUpdate = true;
  $("at").value = frame;
  markStrip();
  $("clock").textContent = motion.t[frame].toFixed(2) + " s" + (motion.phase.length ? "  " + motion.phase[frame] : "") + newtons;
  viewer.set_dirty();
}

let last = 0, now = 0;
function tick(stamp) {
  if (kinid.playing && motion) {
    now += (stamp - last) * 1e-3 * Number($("speed").value);
    if (now > motion.t[motion.n - 1]) now = motion.t[0];
    let i = kinid.frame;
    if (motion.t[i] > now) i = 0;
    while (i + 1 < motion.n && motion.t[i + 1] <= now) i++;
    if (i !== kinid.frame) show(i);
  }
  last = stamp;
  rest();
  requestAnimationFrame(tick);
}
function play(on) {
  kinid.playing = on;
  if (motion) now = kinid.frame >= motion.n - 1 ? motion.t[0] : motion.t[kinid.frame];
  $("play").textContent = on ? "❚❚" : "▶";
}
$("play").onclick = () => play(!kinid.playing);
$("at").oninput = () => { play(false); show(Number($("at").value)); };
document.addEventListener("keydown", e => { if (e.code === "Space" && e.target.tagName !== "BUTTON") { e.preventDefault(); play(!kinid.playing); } });

let surface = null, layers = [];
function setMap(map) {
  layers = map.layers;
  const count = map.vertices * 4;
  if (!surface || surface.count !== map.vertices || map.positions) {
    const geometry = new THREE.BufferGeometry();
    geometry.setAttribute("position", new THREE.BufferAttribute(floats(map.positions), 3));
    geometry.setIndex(new THREE.BufferAttribute(new Uint32Array(bytes(map.faces).buffer), 1));
    geometry.setAttribute("color", new THREE.BufferAttribute(new Uint8Array(count).fill(200), 4, true));
    geometry.computeVertexNormals();
    const skin = new THREE.MeshBasicMaterial({vertexColors: true, transparent: true, side: THREE.DoubleSide, depthWrite: true,
                                              polygonOffset: true, polygonOffsetFactor: -1, polygonOffsetUnits: -1});
    const mesh = new THREE.Mesh(geometry, skin);
    place(["surface"], mesh);
    surface = {geometry, count: map.vertices};
  }
  const chooser = $("property"), names = layers.map(l => l.name);
  if (chooser.options.length !== names.length || [...chooser.options].some((o, i) => o.value !== names[i])) {
    chooser.replaceChildren(...names.map(n => new Option(n, n)));
    chooser.value = map.shown || names[0];
  }
  $("legend").hidden = $("scale").hidden = $("blank").hidden = false;
  $("facts").textContent = map.facts;
  if (map.probes !== surface.probes) { setProbes(floats(map.probes), map.size); surface.probes = map.probes; }
  words = map.probe_words || [];
  paint();
}

function paint() {
  const layer = layers.find(l => l.name === $("property").value) || layers[0];
  if (!layer || !surface) return;
  surface.geometry.attributes.color.array.set(bytes(layer.colors));
  surface.geometry.attributes.color.needsUpdate = true;
  $("bar").style.background = "linear-gradient(90deg," + layer.stops.join(",") + ")";
  $("low").textContent = layer.low; $("high").textContent = layer.high; $("unit").textContent = layer.unit;
  $("faint").hidden = !layer.fades;
  kinid.updates++;
  viewer.set_dirty();
}
$("property").onchange = paint;

function setProbes(places, size) {
  const n = places.length / 3;
  const dots = new THREE.InstancedMesh(new THREE.SphereGeometry(size, 10, 8), new THREE.MeshLambertMaterial({color: 0x1f2937}), Math.max(n, 1));
  const m = new THREE.Matrix4();
  for (let i = 0; i < n; i++) { m.setPosition(places[3 * i], places[3 * i + 1], places[3 * i + 2]); dots.setMatrixAt(i, m); }
  dots.count = n;
  place(["probes"], dots);
  kinid.shown = n;
  probes = {places, size};
}

// a click beside a probe shows what it measured; a click elsewhere hides it
const REACH = 16;  // pixels
let words = [], probes = null, pressed = null;
function choose(x, y) {
  let best = -1, near = REACH;
  for (let i = 0; probes && i < probes.places.length / 3; i++) {
    const p = eye(...probes.places.subarray(3 * i, 3 * i + 3)).project(viewer.camera);
    const off = Math.hypot((p.x + 1) * innerWidth / 2 - x, (1 - p.y) * innerHeight / 2 - y);
    if (Math.abs(p.z) < 1 && off < near) { best = i; near = off; }
  }
  $("probe").hidden = best < 0;
  $("probe").textContent = best < 0 ? "" : words[best] || "";
  const ring = new THREE.Mesh(new THREE.SphereGeometry(probes ? 1.6 * probes.size : 1, 16, 12), new THREE.MeshLambertMaterial({color: 0xE69F00}));
  ring.visible = best >= 0;
  if (ring.visible) ring.position.set(...probes.places.subarray(3 * best, 3 * best + 3));
  place(["chosen"], ring);
}
$("pane").addEventListener("pointerdown", e => { pressed = [e.clientX, e.clientY]; });
$("pane").addEventListener("pointerup", e => {
  if (pressed && Math.hypot(e.clientX - pressed[0], e.clientY - pressed[1]) < 5) choose(e.clientX, e.clientY);
});

function setPatch(patch) {
  const mesh = new THREE.Mesh(new THREE.BoxGeometry(...patch.size), new THREE.MeshLambertMaterial({color: 0xb3aea5}));
  mesh.applyMatrix4(new THREE.Matrix4().fromArray(patch.matrix));
  mesh.castShadow = mesh.receiveShadow = true;
  place(["patch"], mesh);
  viewer.renderer.shadowMap.needsUpdate = true;
}

// corners of the boxes around all shapes of something in the scene, where they are now
function corners(name) {
  const out = [];
  const node = viewer.scene_tree.find(["kinid", name]).object;
  node.updateWorldMatrix(true, true);
  node.traverse(m => {
    if (m.isSprite) {
      const p = m.getWorldPosition(new THREE.Vector3()), r = (1 - m.center.x) * m.scale.x;
      for (const x of [-r, r]) for (const z of [-r, r]) out.push(new THREE.Vector3(p.x + x, p.y, p.z + z));
    }
    if (!m.geometry || m.isSprite || m.isInstancedMesh) return;
    m.geometry.computeBoundingBox();
    const {min, max} = m.geometry.boundingBox;
    for (const x of [min.x, max.x]) for (const y of [min.y, max.y]) for (const z of [min.z, max.z])
      out.push(new THREE.Vector3(x, y, z).applyMatrix4(m.matrixWorld));
  });
  return out;
}

function everything(names) {
  const out = [];
  for (const name of names) {
    if (name === "tip" && motion && motion.tip) {
      for (let i = 0; i < motion.n; i += 10) for (const s of [-0.09, 0.16])
        out.push(eye(motion.tip[3 * i] + s, motion.tip[3 * i + 1] + s, motion.tip[3 * i + 2] + s));
    }
    else if (name === "robot" && motion) {
      const now = kinid.frame;
      for (let i = 0; i < 8; i++) { show(Math.round(i * (motion.n - 1) / 7)); out.push(...corners(name)); }
      show(now);
    } else out.push(...corners(name));
  }
  return out;
}

// the part of the window that no card covers, from -1 to 1 to the right and up
function free() {
  const w = window.innerWidth, h = window.innerHeight, box = id => $(id).getBoundingClientRect(), narrow = w <= 640;
  const low = narrow ? box("low_cards").top : $("time").hidden ? h : box("time").top, top = w < 900 ? box("about").bottom : 0;
  const left = narrow || $("legend").hidden || w < 900 ? 0 : Math.max(box("legend").right, box("about").right), edge = 0.04;
  return {left: 2 * left / w - 1 + edge, right: 1 - edge, low: 1 - 2 * low / h + edge, top: 1 - 2 * top / h - edge};
}

// the nearest camera in a direction that has all points between the four planes of its view
let view = null;
function look(v) {
  view = v;
  for (const name of ["robot", "force"]) viewer.set_property(["kinid", name], "visible", v.arm);
  viewer.renderer.shadowMap.needsUpdate = true;
  $("time").hidden = !v.arm || !motion;
  if (!strip) { drawStrip(); markStrip(); }
  $("forces").hidden = $("newton").hidden = !v.arm || !motion || !motion.scale;
  [...$("views").children].forEach(b => b.setAttribute("aria-pressed", b.textContent === v.name));
  const points = everything(v.of);
  if (!points.length) return;
  const away = eye(...v.away).normalize(), right = new THREE.Vector3(0, 1, 0).cross(away).normalize(), up = away.clone().cross(right);
  const ty = Math.tan(20 * Math.PI / 180), tx = ty * window.innerWidth / window.innerHeight, f = free();
  const bound = (axis, slope) => Math.max(...points.map(p => p.dot(axis) + slope * p.dot(away)));
  const a = bound(right, f.right * tx), b = bound(right.clone().negate(), -f.left * tx), c = bound(up, f.top * ty), d = bound(up.clone().negate(), -f.low * ty);
  const z = Math.max((a + b) / ((f.right - f.left) * tx), (c + d) / ((f.top - f.low) * ty));
  const x = 0.5 * (a - f.right * tx * z - b - f.left * tx * z), y = 0.5 * (c - f.top * ty * z - d - f.low * ty * z);
  const depth = points.map(p => p.dot(away)), far = z - 0.5 * (Math.max(...depth) + Math.min(...depth));
  const at = w => right.clone().multiplyScalar(x).addScaledVector(up, y).addScaledVector(away, w);
  viewer.camera.fov = 40; viewer.camera.near = far / 100; viewer.camera.far = 60 * far;
  viewer.camera.position.copy(at(z)); viewer.controls.target.copy(at(z - far));
  viewer.controls.update();
  sized();
  viewer.set_dirty();
}

// labels are there while they can be read
function sized() {
  if (!axes) return;
  const away = viewer.camera.position.distanceTo(axes.group.children[0].getWorldPosition(new THREE.Vector3()));
  axes.group.visible = axes.size / (2 * away * Math.tan(20 * Math.PI / 180)) * window.innerHeight > 8;
}

function setViews(list) {
  $("views").replaceChildren(...list.map(v => {
    const b = document.createElement("button");
    b.textContent = v.name; b.title = v.says;
    b.onclick = () => { kinid.moved = false; look(v); };
    return b;
  }));
  $("views").hidden = list.length < 2;
  view = list.find(v => view && v.name === view.name) || list[0];
}
viewer.controls.addEventListener("start", () => { kinid.moved = true; });
viewer.controls.addEventListener("change", sized);
window.addEventListener("resize", () => { drawStrip(); markStrip(); if (view && !kinid.moved) look(view); });
dark.addEventListener("change", () => { dress(); drawStrip(); markStrip(); });

kinid.apply = message => {
  if (message.title) { $("name").textContent = message.title; }
  if (message.facts) $("facts").textContent = message.facts;
  if (message.patch) setPatch(message.patch);
  if (message.robot) setRobot(message.robot);
  // whoever looks at the newest sample of a log that grows goes on seeing the newest one
  const newest = message.follow && motion && (kinid.playing || kinid.frame >= motion.n - 1);
  if (message.motion) setMotion(message.motion);
  if (newest) { play(false); show(motion.n - 1); }
  if (message.marks && message.marks.length) setMarks(message.marks);
  if (message.map) setMap(message.map);
  if (message.robot && !message.ground) setGround({centre: [0.3, 0, -2e-3], size: 0.9});
  if (message.camera && !message.views) {
    const c = message.camera, away = c.position.map((p, i) => p - c.target[i]);
    setViews([{name: "all", says: "", of: message.patch ? ["robot", "patch"] : ["robot"], away, arm: true}]);
    look(view);
  }
  if (message.ground) setGround(message.ground);
  if (message.axes) setAxes(message.axes);
  if (message.views) setViews(message.views);
  // what grows stays in the picture until somebody turns it
  if (view && !kinid.moved && (message.views || message.patch)) look(view);
};
dress();
const scene = JSON.parse($("scene").textContent);
kinid.apply(scene);
if (scene.frame) show(scene.frame);
if (scene.play) play(true);
if (scene.live) {
  const live = new EventSource("live");
  live.onmessage = e => kinid.apply(JSON.parse(e.data));
}
kinid.ready = true;
requestAnimationFrame(tick);
