"""Structures that no effect of the catalogue describes."""
import numpy as np
import scene


def texture(rng, dm, Fm, s):
    a, l = rng.uniform(.08, .15) * dm * s, rng.uniform(.0015, .004)
    return dict(tex_a=a, tex_l=l, needs={"slides", "loops"}, note=f"surface texture {a*1e6:.0f} µm of {l*1e3:.1f} mm whose height answers to the slip rate (lift)")


def thixotropy(rng, dm, Fm, s):
    return dict(thix=min(.85, rng.uniform(.45, .7) * s), needs={"slides", "hold", "pokes", "speeds"}, note="thixotropic gel: motion (depth rate and slip) softens it, rest heals it in 4 s")


def crushing(rng, dm, Fm, s):
    p = min(.75, rng.uniform(.35, .6) * s)
    return dict(plast=p, needs={"pokes", "depths"}, note=f"crushable foam: {p:.2f} of the deepest depth stays as a dent")


def snap(rng, dm, Fm, s):
    return dict(jump_a=min(.8, rng.uniform(.35, .55) * s), jump_d=rng.uniform(.5, .7) * dm, needs={"pokes", "depths", "speeds"}, note="snap-through shell: loses a share of its force past one depth, regains it below 0.45 of it")


def dither(rng, dm, Fm, s):
    return dict(mu_t=min(.7, rng.uniform(.3, .5) * s), mu_f=rng.uniform(.35, 1.3), needs={"slides", "loops"}, note="friction modulated in time (a vibrating base): frequency wanders")


C = {"texture": texture, "thixotropy": thixotropy, "snap": snap, "dither": dither}
T = {"crushing": crushing, "snap": snap}


def slosh(rng, arm, q, Rs, g, mass, s, notes):
    """a liquid or loose mass in the tool: an oscillator driven by gravity and acceleration in tool axes"""
    ms = mass * rng.uniform(.15, .3) * s; f = rng.uniform(.5, 1.4); z = rng.uniform(.04, .12); w = 2 * np.pi * f
    R6, p6 = arm.fk(q)
    p = scene.lowpass(p6 + R6 @ arm.sp, 20, zero=True)
    a = np.gradient(np.gradient(p, scene.DT, axis=0), scene.DT, axis=0)
    b = np.einsum("nji,nj->ni", Rs, g - a)
    x = b[0] / w ** 2; v = np.zeros(3); F = np.zeros_like(b)
    for i in range(len(b)):
        F[i] = ms * (w * w * x + 2 * z * w * v) - ms * b[i]
        v = v + scene.DT * (b[i] - w * w * x - 2 * z * w * v); x = x + scene.DT * v
    notes.append(f"sloshing mass {ms:.2f} kg at {f:.2f} Hz, damping {z:.2f}")
    return np.hstack([F, np.cross(arm.tip_s * .5, F)])


def cable(rng, arm, q, Rs, g, mass, s, notes):
    """a hose to the wall: tension along the line to a fixed point, growing with length, with dry internal friction"""
    R6, p6 = arm.fk(q)
    ps = p6 + R6 @ arm.sp
    an = ps.mean(0) + rng.normal(0, 1, 3) * .5
    d = an - ps; L = np.linalg.norm(d, axis=1)
    k = rng.uniform(15, 30) * s
    u = np.zeros(len(L)); dl = np.diff(L, prepend=L[0])
    for i in range(1, len(L)):
        sg = np.sign(dl[i]); u[i] = sg + (u[i - 1] - sg) * np.exp(-abs(dl[i]) / .01) if sg else u[i - 1]
    fw = d / L[:, None] * np.maximum(0, k * (L - .8 * L.min()) + 1.0 * s * u)[:, None]
    F = np.einsum("nji,nj->ni", Rs, fw)
    notes.append(f"hose to a wall point, {k:.0f} N/m with inner friction")
    return np.hstack([F, np.cross(arm.tip_s * .3, F)])


F = {"slosh": slosh, "hose": cable}


def pushes(rng, Qd, t, big, s, notes):
    x = np.zeros_like(Qd)
    for _ in range(int(len(t) * scene.DT / 2.5)):
        c, w = rng.uniform(2, t[-1] - 1), rng.uniform(.3, 1.2)
        x += np.exp(-((t - c) / w) ** 2)[:, None] * rng.normal(0, 1, Qd.shape[1]) * big * 6 * s
    notes.append("somebody leans on the arm now and then (torques of 0.3-1.2 s)")
    return x


def coupled(rng, Qd, t, big, s, notes):
    """wrist couplings: joint j pulled by a product of its neighbours' angles and rates"""
    x = np.zeros_like(Qd); n = Qd.shape[1]
    V = np.gradient(Qd, scene.DT, axis=0)
    for j in range(n):
        k = (j + 1) % n; l = (j + 2) % n
        x[:, j] = big[j] * s * (4 * np.sin(3 * Qd[:, k] + 2 * Qd[:, j]) + 5 * V[:, k] * np.cos(Qd[:, l]))
    notes.append("torques from products of other joints' angles and rates (cable bundle, coupled gears)")
    return x


J = {"pushes": pushes, "coupled": coupled}


def loads(rng, qd, t, m, s, notes):
    x = np.zeros(len(t))
    for c in np.arange(1, t[-1], rng.uniform(1.5, 3)):
        c += rng.uniform(-.5, .5)
        x += m * .7 * s * rng.choice([-1, 1]) * .5 * (np.tanh((t - c) / .05) - np.tanh((t - c - rng.uniform(.4, 1.5)) / .05))
    notes.append("load switched on and off at random times")
    return x, 0.0


def eccentric(rng, qd, t, m, s, notes):
    notes.append("dry friction that swells with the angle (eccentric seal): F_c(1 + a sin 2.3 q) sign")
    return np.zeros(len(t)), min(.85, rng.uniform(.55, .75) * s)


D = {"loads": loads, "eccentric": eccentric}
