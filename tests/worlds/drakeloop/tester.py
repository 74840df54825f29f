"""Material-tester logs: a servo-held carriage presses a tip into the sample. Columns t, depth, normal_force. SI units."""
from __future__ import annotations
from typing import Any
import numpy as np
import law
from chain import Clock, FREE, at, chain_defaults, fit, get, lowpass, put, smooth_motion
from wrench import EFFECTS, Effect, ELA, p, trapezoid

SINGLES = ("relaxation", "hysteresis", "stress-softening", "adhesion", "stiffening-layer", "surface-offset", "hertz-exponent", "viscous-damping", "hunt-crossley-damping", "stiffness-drift")
OUT: dict[str, Effect] = {
    "quadratic-drag": Effect("outside", "n", ("kelvin-voigt",), "poke", p("c2", 800, 2500), ("hunt-crossley-damping",)),
    "puncture": Effect("outside", "n", ("kelvin-voigt", "hertz"), "poke", lambda r, c: [("P", "puR", -1, float(r.uniform(0.3, 0.6)), 0.0, True), ("P", "puD", -1, float(r.uniform(.55, .75) * c["d"]), 1.0, False)], ("stress-softening",)),
    "sample-creep-up": Effect("outside", "n", ("kelvin-voigt", "hertz"), "poke", p("zr", 1.5e-5, 4e-5), ("surface-offset", "stiffness-drift")),
}


def run(rng: np.random.Generator, arm, group: str, base: str, hidden: list[str], mag: dict[str, float], long: bool, quiet: float) -> dict[str, Any]:
    """One tester case."""
    effs = {h: EFFECTS.get(h) or OUT[h] for h in hidden}
    F, d = float(rng.uniform(5, 25)), float(rng.uniform(2e-3, 6e-3))
    n = 1.5 if base in ("hertz", "hunt-crossley") else 1.0
    dk: dict[str, float] = dict(n=n, k=F / (law.D0 * (d / law.D0) ** n))
    if base == "kelvin-voigt":
        dk["c"] = float(rng.uniform(5, 30))
    if base == "hunt-crossley":
        dk["lam"] = float(rng.uniform(0.8, 4))
    if base == "zener":
        dk.update(r1=float(rng.uniform(0.3, 0.8)), tau1=float(rng.uniform(0.15, 1.0)))
    if base == "maxwell":
        dk.update(keq=0.0, r1=1.0, tau1=float(rng.uniform(2, 8)))
    Q = chain_defaults()
    ctx = dict(F=F, d=d, base=base, Q=Q)
    Pn, items = law.pvec(dk), {}
    for h, e in effs.items():
        items[h] = [(a, b, i, nv + (v - nv) * (mag[h] if s else 1.0), nv, s) for a, b, i, v, nv, s in e.draw(rng, ctx)]
        Pn, Q = put(Pn, Q, [i[:3] for i in items[h]], np.array([i[3] for i in items[h]]))
    rate = float(rng.choice([50, 100, 200, 500, 1000]))
    nu = dict(rate=rate, jitter=float(rng.choice([0, rng.uniform(0, 0.1)])), dropped=float(rng.choice([0, rng.uniform(0, 0.02)])), depth_step=float(rng.choice([5e-7, 1e-6, 2e-6])),
              depth_noise=float(rng.uniform(1e-7, 1e-6)), noise_force=float(max(0.01, rng.uniform(0.01, 0.04) * quiet)), surface_off=float(rng.uniform(-2e-5, 2e-5) * min(1, quiet)),
              clock_off=float(rng.uniform(-5e-5, 5e-5)), nonlinearity=float(rng.uniform(-1, 1) * 0.003), onset_patch=float(rng.choice([0, rng.uniform(5e-6, 2e-5)])))
    Pt = Pn.copy()
    Pt[law.IX["z0"]] += nu["surface_off"]
    Pt[law.IX["found"]] = nu["onset_patch"]
    up, x, ph = -1.5e-3, [np.array([-1.5e-3])], ["free"]
    dt = 1.25e-4

    def go(target: float, v: float, phase: str) -> None:
        T = max(abs(target - x[-1][-1]) / v, 0.05)
        k = int(T / dt)
        x.append(x[-1][-1] + (target - x[-1][-1]) * trapezoid(np.arange(1, k + 1) / k))
        ph.extend([phase] * k)

    def wait(T: float, phase: str) -> None:
        k = int(T / dt)
        x.append(np.full(k, x[-1][-1]))
        ph.extend([phase] * k)
    wait(0.8, "free")
    pokes = 26 if long else 7
    for i in range(pokes):
        D = d * ((0.4, 0.6, 0.5, 1.0, 0.7, 0.9, 0.55)[i % 7] * rng.uniform(0.9, 1.05))
        v = (0.008, 0.05, 0.002, 0.02, 0.08, 0.004, 0.03)[i % 7] * rng.uniform(0.8, 1.2)
        go(D, v, "poke"); wait(rng.uniform(0.4, 1.0) if i % 3 else rng.uniform(1.2, 2.5), "hold"); go(up, v * rng.uniform(0.7, 1.4), "retract"); wait(rng.uniform(0.5, 3.0 if long else 1.0), "rest")
    xc = np.concatenate(x)
    m, f = 1.2, rng.uniform(18, 35)
    kp = m * (2 * np.pi * f) ** 2
    nu["controller"] = dict(kind="stage servo", bandwidth_hz=float(f))
    raw = law.stage(Pt, xc, np.gradient(xc, dt), dt, m, kp, 1.4 * np.sqrt(kp * m), 4)
    tg = np.arange(len(raw)) * dt * 4
    pk = max(raw[:, 2].max(), 1)
    W = raw[:, 2:] * (1 + nu["nonlinearity"] * np.abs(raw[:, 2:]) / pk)
    t = Clock(rng, tg[-1], rate, nu["jitter"], nu["dropped"]).t
    sig = nu["noise_force"]
    Y = at(t + nu["clock_off"], tg, W)[:, 0] + rng.normal(size=len(t)) * sig
    Y = np.round(Y / 5e-3) * 5e-3
    dl = np.round((at(t, tg, raw[:, :1])[:, 0] + rng.normal(size=len(t)) * nu["depth_noise"]) / nu["depth_step"]) * nu["depth_step"]
    s = max(1, int(rate // 250))
    tj = t[::s]
    tr = at(tj, tg, raw)
    z2 = np.zeros((len(tj), 2))
    mdl = lambda de, dd: (lambda P, Q_: law.series(P, tj, de, dd, z2, z2)[:, :1])
    truth = mdl(np.ascontiguousarray(tr[:, 0]), np.ascontiguousarray(tr[:, 1]))
    q_, v_, _ = smooth_motion(t, dl[:, None], None, min(30.0, rate / 5))
    logm = mdl(np.ascontiguousarray(dl[::s]), np.ascontiguousarray(v_[::s, 0]))
    Yc = truth(Pn, Q)
    touch = np.abs(Yc[:, 0]) > 0.05
    rms = lambda e: float(np.sqrt(np.mean(np.square(e[touch]))))
    model = [base]
    names = model + [h for h in hidden if h in EFFECTS]
    w = np.array([sig])
    Pf, _, pr = fit(logm, Y[::s, None], Pn, Q, names, w, 2)
    eff, left, share, near = {}, {}, {}, []
    for h, e in effs.items():
        fs = [i[:3] for i in items[h]]
        P0, Q0 = put(Pn, Q, fs, np.array([i[4] for i in items[h]]))
        others = model + [o for o in hidden if o != h and o in EFFECTS]
        P1, Q1, p1 = fit(truth, Yc, P0, Q0, others, w)
        eff[h], left[h] = rms(Yc - p1), rms(Y[::s, None] - pr)
        share[h] = eff[h] / rms(Yc)
        for alt in e.alike:
            if alt in others or alt.startswith("sensor") or alt in ("stiffness-inhomogeneity", "tip-offset") or (alt == "hertz-exponent" and base == "hunt-crossley"):
                continue
            zf = [f for f in FREE[alt] if abs(get(P1, Q1, f)) < 1e-12 and f[4] >= 0]
            Pa, Qa = put(P1, Q1, [f[:3] for f in zf], np.array([0.3 * f[3] for f in zf]))
            if alt == "stiffening-layer":
                Pa[law.IX["slB"]] = 0.5 * d
            if rms(Yc - fit(truth, Yc, Pa, Qa, others + [alt], w)[2]) < max(0.5 * left[h], 0.08 * eff[h]):
                near.append(alt)
    if group == "outside":
        near = sorted(set(near) | set(effs[hidden[0]].alike))
    cols = {"t": t, "depth": dl, "normal_force": Y}
    if rng.random() < 0.4:
        cols["phase"] = np.array(ph)[np.clip((t / dt).astype(int), 0, len(ph) - 1)]
    return dict(model=model, eff=eff, left=left, share=share, near=sorted(set(near)), unit="N", left_forces=rms(Y[::s, None] - pr), cols=cols, rig=f"[sensor]\nnoise = [{sig:.6g}, {sig:.6g}, {sig:.6g}, 0.001, 0.001, 0.001]\n",
                nuisances=nu, params={h: [{"name": i[1], "index": i[2], "value": i[3]} for i in items[h]] for h in hidden}, noise=sig, style="tester", seconds=float(t[-1]),
                fitted={f[1]: get(Pf, Q, f) for mo in model for f in FREE[mo]}, true={k: float(Pt[law.IX[k]]) for k in law.NAMES if Pt[law.IX[k]]}, peak=float(Yc.max()))
