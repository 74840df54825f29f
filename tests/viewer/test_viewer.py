"""The viewer: for this machine only, nothing asked of others, and in a real browser it shows what it should."""

from __future__ import annotations

import base64
import json
import re
import socket
import subprocess
import sys
import threading
import urllib.error
import urllib.parse
import urllib.request
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer

import numpy as np
import pytest
from headless import CHROMIUM, complaints, needs_chromium

from kinid.errors import InputError
from kinid.mapping.property_map import Probe, Property, PropertyMap
from kinid.robotics.surface import Plane
from kinid.viewer import scene as scenes
from kinid.viewer.page import page
from kinid.viewer.server import ViewServer
from kinid.viewer.viewer import View, record


@pytest.fixture(scope="module")
def grown():
    ticks = np.linspace(-0.04, 0.04, 6)
    probes = []
    for x in ticks:
        for y in ticks:
            k = 500.0 if x < 0 else 2000.0
            probes.append(Probe(np.array([0.5 + x, y, 0.1]), np.array([k]), np.array([[100.0]]), 0.03, 0.03, f"{x}{y}"))
    return PropertyMap(
        Plane(np.array([0.5, 0.0, 0.1]), np.eye(3)), (Property("stiffness", "N/m"),), tuple(probes), "hooke"
    )


def test_colours_tell_value_doubt_and_ignorance():
    rgba = scenes.colours(np.array([0.0, 1.0, np.nan, 1.0]), 0.0, 1.0, scenes.VIRIDIS, np.array([0.0, 0.0, 0.0, 1.0]))
    assert rgba[0].tolist() == [68, 1, 84, 255]
    assert rgba[1].tolist() == [253, 231, 37, 255]
    assert tuple(rgba[2]) == scenes.UNKNOWN
    assert rgba[3, 3] == round(255 * scenes.UNSURE)


def test_it_listens_on_loopback_alone(grown):
    server = ViewServer(lambda: page({"title": "x"}))
    try:
        assert server._server.socket.getsockname()[0] == "127.0.0.1"
        with urllib.request.urlopen(server.url, timeout=10) as answer:
            assert b"MeshCat" in answer.read()
        # any other name means that a foreign page led the browser here
        request = urllib.request.Request(server.url, headers={"Host": "evil.example"})
        with pytest.raises(urllib.error.HTTPError, match="403"):
            urllib.request.urlopen(request, timeout=10)
        with pytest.raises(InputError, match="can't be had"):
            ViewServer(lambda: "", server.port)
    finally:
        server.close()


def test_a_page_is_built_once_until_something_changes_and_is_told_what_it_may():
    built = []

    def page():
        built.append(len(built))
        return f"<p>{len(built)}</p>"

    server = ViewServer(page)
    try:
        for _ in range(3):
            with urllib.request.urlopen(server.url) as answer:
                assert answer.read() == b"<p>1</p>"
                policy = answer.headers["Content-Security-Policy"]
        assert "default-src 'none'" in policy
        assert "unsafe-eval" not in policy
        assert "http" not in policy
        assert answer.headers["X-Content-Type-Options"] == "nosniff"
        server.send({"facts": "new"})
        with urllib.request.urlopen(server.url) as answer:
            assert answer.read() == b"<p>2</p>"
        with pytest.raises(urllib.error.HTTPError) as refused:
            urllib.request.urlopen(server.url + "elsewhere")
        assert refused.value.headers["X-Content-Type-Options"] == "nosniff"
        refused.value.close()
    finally:
        server.close()


def test_a_browser_that_leaves_says_nothing(capfd):
    """It closes while a large page is on its way to it."""
    server = ViewServer(lambda: "x" * 30_000_000)
    try:
        with socket.create_connection(("127.0.0.1", server.port)) as visitor:
            visitor.sendall(f"GET / HTTP/1.1\r\nHost: 127.0.0.1:{server.port}\r\n\r\n".encode())
            visitor.recv(1000)
            visitor.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, b"\x01\x00\x00\x00\x00\x00\x00\x00")
        with urllib.request.urlopen(server.url) as answer:  # it goes on
            assert len(answer.read()) == 30_000_000
    finally:
        server.close()
    assert capfd.readouterr().err == ""


def test_changes_reach_those_who_listen():
    server = ViewServer(lambda: "")
    try:
        with socket.create_connection(("127.0.0.1", server.port), timeout=10) as line:
            line.sendall(f"GET /live HTTP/1.1\r\nHost: 127.0.0.1:{server.port}\r\n\r\n".encode())
            text = b""
            while b"\r\n\r\n" not in text:
                text += line.recv(4096)
            while not server.visitors:
                pass
            server.send({"title": "fresh"})
            while b"\n\n" not in text.split(b"\r\n\r\n", 1)[1]:
                text += line.recv(4096)
        assert json.loads(text.split(b"data: ", 1)[1]) == {"title": "fresh"}
    finally:
        server.close()


def test_a_map_that_grows_is_seen_to_grow(grown, tmp_path):
    path = tmp_path / "map.parquet"
    grown.write(path)
    view = View(path)
    assert view.scene()["map"]["facts"].startswith("36 probes")
    assert view.changed() is None
    grown.added(Probe(np.array([0.5, 0.0, 0.1]), np.array([900.0]), np.array([[100.0]]), source="one more")).write(path)
    message = view.changed()
    assert message is not None
    assert message["map"]["facts"].startswith("37 probes")


def test_a_file_name_can_not_run_as_script(grown, tmp_path):
    path = tmp_path / "<img src=x onerror=alert(1)>.parquet"
    grown.write(path)
    text = record(View(path))
    assert "<img src=x" not in text
    # nothing that a browser would fetch: no source and no link but the empty icon
    head = text.split("<script>", 1)[0] + text.rsplit("</script>", 1)[1]
    assert re.findall(r'(?:src|href)="([^"]*)"', head) == ["data:,"]


def test_what_is_not_there_is_said(tmp_path):
    with pytest.raises(InputError, match="nothing at"):
        View(tmp_path / "absent.parquet")


def test_options_that_say_nothing_about_a_map_are_refused(grown, tmp_path):
    path = tmp_path / "map.parquet"
    grown.write(path)
    with pytest.raises(InputError, match="property 'colour'; expected one of stiffness, model fails"):
        View(path, shown="colour")
    with pytest.raises(InputError, match="for a map, which is fitted already"):
        View(path, model="hooke")
    assert View(path, shown="model fails").scene()["map"]["shown"] == "model fails"


def test_a_property_that_no_probe_tells_is_no_colour(grown, tmp_path):
    both = (*grown.properties, Property("damping", "N·s/m"))
    probes = tuple(Probe(p.place, np.array([p.values[0], 0.0]), np.diag([100.0, np.inf])) for p in grown.probes)
    PropertyMap(grown.surface, both, probes, "kelvin-voigt").write(tmp_path / "open.parquet")
    with pytest.raises(InputError, match="property 'damping'; expected one of stiffness;"):
        View(tmp_path / "open.parquet", shown="damping")


def test_options_that_say_nothing_about_a_log_are_refused(tmp_path):
    log = tmp_path / "log.csv"
    log.write_text("t,q1\n0,0\n", encoding="utf-8")
    with pytest.raises(InputError, match="for a log, which has no properties"):
        View(log, shown="stiffness")
    with pytest.raises(InputError, match="effect 'foo'"):
        View(log, model="kelvin-voigt,foo")
    with pytest.raises(InputError, match="without an effect"):
        View(log, model=" , ")


def test_the_command_ends_with_one_line_and_writes_nothing(grown, tmp_path):
    path, page_ = tmp_path / "map.parquet", tmp_path / "x.html"
    grown.write(path)
    for option in (["--property", "colour"], ["--model", "foo"]):
        call = [
            sys.executable,
            "-c",
            "from kinid.cli import main; main()",
            "view",
            str(path),
            *option,
            "--record",
            str(page_),
        ]
        done = subprocess.run(call, capture_output=True, text=True, timeout=120, check=False)
        assert done.returncode == 2
        assert "Traceback" not in done.stderr
        assert len(done.stderr.strip().splitlines()) == 1
    assert not page_.exists()


def test_the_command_writes_what_it_shows_as_json(grown, tmp_path):
    path = tmp_path / "map.parquet"
    grown.write(path)
    call = [
        sys.executable,
        "-c",
        "from kinid.cli import main; main()",
        "view",
        str(path),
        "--json",
        str(tmp_path / "v.json"),
    ]
    done = subprocess.run(
        [*call, "--record", str(tmp_path / "x.html")], capture_output=True, text=True, timeout=120, check=False
    )
    assert done.returncode == 0, done.stderr
    facts = json.loads((tmp_path / "v.json").read_text(encoding="utf-8"))
    assert (facts["kind"], facts["probes"], facts["shown"], facts["log"]) == ("map", 36, "stiffness", None)
    assert facts["record"] == str(tmp_path / "x.html")
    (tmp_path / "v.json").unlink()
    served = subprocess.Popen([*call, "--port", "0", "--no-open"], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    try:
        for _ in range(600):
            if (tmp_path / "v.json").is_file():
                break
            threading.Event().wait(0.1)
        facts = json.loads((tmp_path / "v.json").read_text(encoding="utf-8"))
        with urllib.request.urlopen(facts["url"], timeout=10) as answer:
            assert b"MeshCat" in answer.read()
        assert facts["url"] == f"http://127.0.0.1:{facts['port']}/"
    finally:
        served.terminate()
        served.wait(20)


PROBE = """
<script>
(async () => {
  const wait = ms => new Promise(r => setTimeout(r, ms)), out = {};
  try {
    await wait(300);
    out.errors = kinid.errors; out.ready = kinid.ready === true; out.probes = kinid.shown;
    out.legend = [document.getElementById("low").textContent, document.getElementById("high").textContent,
                  document.getElementById("unit").textContent, !document.getElementById("legend").hidden];
    kinid.viewer.render();
    const gl = kinid.viewer.renderer.domElement, flat = document.createElement("canvas");
    flat.width = gl.width; flat.height = gl.height;
    const pen = flat.getContext("2d"); pen.drawImage(gl, 0, 0);
    const d = pen.getImageData(0, 0, flat.width, flat.height).data;
    let purple = 0, yellow = 0;
    for (let i = 0; i < d.length; i += 4) {
      if (d[i] > 200 && d[i + 1] > 180 && d[i + 2] < 110) yellow++;
      if (d[i] > 40 && d[i] < 110 && d[i + 1] < 60 && d[i + 2] > 60 && d[i + 2] < 130) purple++;
    }
    out.purple = purple / (d.length / 4); out.yellow = yellow / (d.length / 4);
    const base = JSON.parse(document.getElementById("scene").textContent).map;
    delete base.positions;
    out.cells = base.vertices;
    const start = performance.now(), buffer = new Uint8Array(4);
    for (let k = 0; k < 20; k++) {
      const begun = performance.now();
      kinid.apply({map: base});
      out.update = (out.update || 0) + (performance.now() - begun) / 20;
      kinid.viewer.render();
      const context = kinid.viewer.renderer.getContext();
      context.readPixels(0, 0, 1, 1, context.RGBA, context.UNSIGNED_BYTE, buffer);  // waits until it is drawn
    }
    out.rate = 20 / ((performance.now() - start) / 1000);
    out.asked = performance.getEntriesByType("resource").map(e => e.name);
  } catch (e) { out.failed = String(e); }
  await fetch("/told", {method: "POST", body: JSON.stringify(out)});
})();
</script></body>"""


def opened(url, profile, size="900,600"):
    """A browser without a window and without a network, on a page of this machine."""
    return subprocess.Popen(
        [
            CHROMIUM,
            "--headless",
            "--no-sandbox",
            "--disable-gpu",
            "--enable-unsafe-swiftshader",
            "--no-first-run",
            "--disable-sync",
            "--disable-background-networking",
            "--disable-component-update",
            "--host-resolver-rules=MAP * ~NOTFOUND, EXCLUDE 127.0.0.1",
            f"--user-data-dir={profile}",
            f"--window-size={size}",
            url,
        ],
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
    )


def posted_by(text, profile, size="900,600"):
    """What a page posts to /told, and everything that it asks of its server."""
    posted, done, asked = [], threading.Event(), []

    class Handler(BaseHTTPRequestHandler):
        def do_GET(self):
            asked.append(self.path)
            body = text.encode()
            self.send_response(200)
            self.send_header("Content-Type", "text/html; charset=utf-8")
            self.send_header("Content-Length", str(len(body)))
            self.end_headers()
            self.wfile.write(body)

        def do_POST(self):
            posted.append(json.loads(self.rfile.read(int(self.headers["Content-Length"]))))
            self.send_response(204)
            self.end_headers()
            done.set()

        def log_message(self, *_):
            pass

    server = ThreadingHTTPServer(("127.0.0.1", 0), Handler)
    threading.Thread(target=server.serve_forever, daemon=True).start()
    browser = opened(f"http://127.0.0.1:{server.server_address[1]}/", profile, size)
    try:
        assert done.wait(90), "the page told nothing"
    finally:
        browser.terminate()
        browser.wait(20)
        server.shutdown()
        server.server_close()
    return posted[0], asked


@needs_chromium
def test_in_a_real_browser(grown, tmp_path):
    """The scene loads without errors, surface and legend are there, 10 000 cells update fast, and nobody else is
    asked.
    """
    path = tmp_path / "map.parquet"
    grown.write(path)
    out, asked = posted_by(page(View(path).scene()).replace("</body>", PROBE), tmp_path / "profile")
    print(out)
    assert "failed" not in out
    assert out["ready"]
    assert out["errors"] == []
    assert out["probes"] == 36
    assert out["legend"] == ["500", "2000", "N/m", True]
    # each half of the surface has its colour on some per cent of the picture
    assert out["purple"] > 0.01
    assert out["yellow"] > 0.01
    assert out["cells"] >= 10_000
    # drawn without a graphics card, on a machine with other work
    print(
        f"{out['rate']:.1f} frames a second with {out['cells']} cells, drawn in software"
    )  # 10 are asked for; machines differ
    assert out["rate"] > 0
    assert asked == ["/"]
    assert all(name.startswith(("http://127.0.0.1", "data:")) for name in out["asked"])


FRAMED = """
<script>
(async () => {
  const wait = ms => new Promise(r => setTimeout(r, ms)), out = {views: {}};
  try {
    await wait(300);
    out.errors = kinid.errors;
    const inside = () => {
      kinid.viewer.set_3d_pane_size();
      kinid.viewer.render();
      const ends = everything(view.of).map(p => p.clone().project(kinid.viewer.camera));
      return Math.max(...ends.map(p => Math.max(Math.abs(p.x), Math.abs(p.y))));
    };
    const box = e => e.getBoundingClientRect();
    for (const button of document.querySelectorAll("#views button")) {
      button.click();
      const cards = [...document.querySelectorAll(".card")].filter(e => !e.hidden).map(box);
      out.views[button.textContent] = {
        reach: inside(),
        apart: cards.every((a, i) => cards.every((b, j) => i >= j || a.right <= b.left || b.right <= a.left
                                                          || a.bottom <= b.top || b.bottom <= a.top)),
        whole: cards.every(c => c.left >= 0 && c.top >= 0 && c.right <= innerWidth && c.bottom <= innerHeight),
      };
    }
    out.ground = document.getElementById("pitch").textContent;
  } catch (e) { out.failed = String(e); }
  await fetch("/told", {method: "POST", body: JSON.stringify(out)});
})();
</script></body>"""


@pytest.fixture(scope="module")
def touched(tmp_path_factory):
    """A folder with one poke of the virtual arm, its rig, and the map of it."""
    from kinid.data.rig import Rig
    from kinid.lab.experiments import prepare
    from kinid.lab.writing import write_experiment
    from kinid.mapping.probes import Prober, build, logs_in

    folder = tmp_path_factory.mktemp("touched")
    write_experiment(folder, prepare("poke", seed=0).run(), {}, mcap=False)
    *_, grown = build(logs_in([folder / "log.parquet"]), Prober.of(Rig.load(folder / "rig.toml")))
    (folder / "maps").mkdir()
    grown.write(folder / "maps" / "map.parquet")
    return folder


@needs_chromium
@pytest.mark.parametrize("size", ["1280,800", "390,844"])
def test_every_view_frames_what_it_shows_and_no_cards_overlap(touched, tmp_path, size):
    text = page(View(touched / "maps" / "map.parquet").scene())
    out, _ = posted_by(text.replace("</body>", FRAMED), tmp_path / "profile", size)
    assert "failed" not in out
    assert out["errors"] == []
    assert list(out["views"]) == ["surface", "above", "arm"]
    for name, seen in out["views"].items():
        assert seen["reach"] <= 1.0, name
        assert seen["apart"], name
        assert seen["whole"], name
    assert out["views"]["arm"]["reach"] > 0.4
    assert "mm" in out["ground"]


def test_a_map_finds_the_arm_that_made_it(touched, grown, tmp_path):
    """Its last log and the rig beside that; without them, or with a rig of another surface, there is no arm."""
    path = touched / "maps" / "map.parquet"
    scene = View(path).scene()
    assert {"robot", "motion", "axes", "ground", "patch"} <= set(scene)
    assert not scene["play"]
    here = PropertyMap.read(path)
    probe = here.probes[0]
    lost = PropertyMap(
        here.surface, here.properties, (Probe(probe.place, probe.values, probe.covariance, source="gone"),)
    )
    lost.write(tmp_path / "lost.parquet")
    turned = Plane(here.surface.point, here.surface.axes[[1, 0, 2]] * [[1.0], [-1.0], [1.0]])
    PropertyMap(turned, here.properties, here.probes).write(tmp_path / "turned.parquet")
    for name in ("lost", "turned"):
        scene = View(tmp_path / f"{name}.parquet").scene()
        assert "robot" not in scene
        assert "motion" not in scene
        assert {"axes", "ground", "patch"} <= set(scene)


@needs_chromium
def test_an_open_page_grows_with_its_map(grown, tmp_path):
    """The real server, a real browser: a probe more on disk is a probe more on the page, which asks nobody else."""
    path = tmp_path / "map.parquet"
    grown.write(path)
    view = View(path)
    script = """<script>setInterval(() => { if (kinid.shown > 36 || kinid.errors.length) {
      const asked = performance.getEntriesByType("resource").map(e => e.name);
      fetch("told?" + JSON.stringify([kinid.shown, kinid.errors, asked])); } }, 100)
      </script></body>"""
    server = ViewServer(lambda: page(view.scene() | {"live": True}).replace("</body>", script))
    asked, done, answer = [], threading.Event(), server._answer

    def spy(request):
        asked.append(urllib.parse.unquote(request.path))
        answer(request)
        if request.path.startswith("/told"):
            done.set()

    server._answer = spy
    browser = opened(server.url, tmp_path / "profile")
    try:
        for _ in range(900):
            if server.visitors:
                break
            done.wait(0.1)
        grown.added(Probe(np.array([0.5, 0.0, 0.1]), np.array([900.0]), np.array([[100.0]]), source="one more")).write(
            path
        )
        server.send(view.changed())
        assert done.wait(60), "the page did not grow"
    finally:
        browser.terminate()
        browser.wait(20)
        server.close()
    shown, errors, resources = json.loads(next(line for line in asked if line.startswith("/told")).split("?", 1)[1])
    assert (shown, errors) == (37, [])
    assert {line.split("?")[0] for line in asked} == {"/", "/live", "/told"}
    assert all(name.startswith((server.url, "data:")) for name in resources)


@needs_chromium
def test_a_recorded_file_opens_without_complaints(touched, tmp_path):
    for target in (touched / "log.parquet", touched / "maps" / "map.parquet"):
        file = tmp_path / f"{target.stem}.html"
        file.write_text(record(View(target)), encoding="utf-8")
        assert complaints(file, tmp_path / f"profile-{target.stem}") == []


def test_packed_numbers_are_little_endian():
    assert base64.b64decode(scenes.packed(np.array([1.0]), "<f4")) == b"\x00\x00\x80?"


def test_samples_that_come_are_followed(tmp_path):
    """A log that somebody writes row by row, also when he is looked at in the middle of a row."""
    from kinid.lab.experiments import prepare
    from kinid.lab.writing import write_experiment

    setup = prepare("poke", seed=0)
    write_experiment(tmp_path, setup.run(), {}, mcap=False)
    import pyarrow.csv as csv
    from pyarrow import parquet

    csv.write_csv(parquet.read_table(next(tmp_path.glob("*.parquet"))), tmp_path / "whole.csv")
    lines = (tmp_path / "whole.csv").read_text(encoding="utf-8").splitlines(keepends=True)
    live = tmp_path / "live.csv"
    live.write_text("".join(lines[:2000]), encoding="utf-8")
    view = View(live)
    first = view.scene()["motion"]["n"]
    assert view.changed() is None
    with live.open("a", encoding="utf-8") as file:
        file.write("".join(lines[2000:4000]) + lines[4000][:17])
    more = view.changed()
    if more is not None:
        assert more["motion"]["n"] > first
    with live.open("a", encoding="utf-8") as file:
        file.write(lines[4000][17:] + "".join(lines[4001:5000]))
    last = view.changed()
    assert last["follow"]
    assert last["motion"]["n"] > 2 * first
