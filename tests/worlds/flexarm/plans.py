"""Experiments: what a sensible person would do with the arm or the tester, fuller where a stated wish asks for it."""
from __future__ import annotations

import numpy as np

from measure import logu
from motion import Path

TEST_NAMES = ("d", "s1", "s2")


def wrench_plan(rng, dmax, wish=(), long=False, brief=False):
    """wish: words - fast, slow-fast, holds, loops, speeds, loads, places, tilts, revisit, reversals, separate, overload."""
    w = set(wish)
    clear = rng.uniform(0.035, 0.06)
    A, Y = rng.uniform(0.3, 0.5), rng.uniform(0.5, 0.9)
    if "turns" in w:
        A, Y = rng.uniform(0.7, 1.0), rng.uniform(0.8, 1.3)
        clear = rng.uniform(0.06, 0.1)
    p = Path(start=[clear, 0, 0, 0, 0, 0])
    p.hold(rng.uniform(0.3, 0.8), "rest")

    def turns(n):
        seq = [dict(a1=A, a2=0), dict(a1=-A, a2=0.3 * A), dict(a1=0, a2=A, yaw=Y), dict(a1=0.5 * A, a2=-A, yaw=-Y), dict(a1=-0.7 * A, a2=-0.6 * A, yaw=0.3 * Y)]
        for k in rng.permutation(len(seq))[:n]:
            p.move(rng.uniform(0.7, 1.2) * (1.5 if "turns" in w else 1), "free", **seq[k])
            if rng.random() < 0.5:
                p.hold(rng.uniform(0.1, 0.4), "free")
        p.move(1.0 if "turns" not in w else 1.5, "free", a1=0, a2=0, yaw=0)
    turns(4 if not brief else 3)
    if "fast" in w or rng.random() < 0.35:
        p.sine(rng.uniform(1.4, 2.0), "free", [2.1, 1.6, 1.2], a1=0.1, a2=0.13, yaw=0.2)
        p.sine(rng.uniform(1.2, 1.8), "free", [1.9, 1.3, 2.3], h=0.01, s1=0.016, s2=0.01)
        p.sine(1.3, "free", [1.1, 2.2], a1=0.17, a2=0.09)
    p.move(1.0, "approach", h=0.004)
    air = 0.35 if "holds" not in w else 1.8

    def poke(f, vin, hold, vout, up=0.003):
        p.ramp(vin, "poke", h=-f * dmax)
        p.hold(hold, "hold")
        p.ramp(vout, "retract", h=up)
        p.hold(rng.uniform(0.7, 1.2) * air, "rest")
    fr = [0.35, 0.65, 0.9, 1.0]
    if "loops" in w:
        order = [0.4, 0.4, 0.7, 1.0, 1.0, 0.6]
    elif "slow-fast" in w or "holds" in w:
        order = [0.5, 1.0, 0.6, 1.0, 0.8]
    elif brief:
        order = [0.6, 1.0, 0.8]
    else:
        order = [fr[i] for i in rng.permutation(4)]
    for i, f in enumerate(order):
        vin = logu(rng, 0.004, 0.03) if i % 2 else logu(rng, 0.012, 0.04)
        hold = rng.uniform(0.3, 0.8)
        if "holds" in w and i < 3:
            hold = rng.uniform(2.0, 4.0)
        poke(f, vin, hold, vin * rng.uniform(0.6, 1.2) if "tail" not in w else rng.uniform(0.002, 0.005))
    if "loops" in w or "slow-fast" in w:
        p.ramp(0.01, "poke", h=-0.9 * dmax)
        for f in (0.45, 0.9, 0.6, 1.0):
            p.ramp(logu(rng, 0.003, 0.02), "poke", h=-f * dmax)
        p.ramp(0.006, "retract", h=0.003)
        p.hold(air, "rest")
    if "slow-fast" in w or rng.random() < 0.3:
        p.ramp(0.015, "approach", h=-0.6 * dmax)
        p.sine(2.0, "poke", rng.uniform(2.0, 4.0), h=0.25 * dmax)
        p.sine(2.5, "poke", rng.uniform(0.7, 1.2), h=0.3 * dmax)
        p.ramp(0.01, "retract", h=0.003)
        p.hold(air, "rest")
    if "tilts" in w:
        for a1, a2 in ((0.2, 0), (-0.2, 0), (0, 0.2), (0, -0.2)):
            p.move(0.6, "free", a1=a1, a2=a2)
            poke(rng.uniform(0.6, 1.0), 0.015, 0.25, 0.02)
        p.move(0.8, "free", a1=0, a2=0)
    # slides
    loads = [0.45, 0.9] if "loads" not in w else [0.3, 0.6, 1.0]
    if brief:
        loads = [0.7]
    Ls = rng.uniform(0.014, 0.022)
    for i, f in enumerate(loads):
        v = [logu(rng, 0.012, 0.05) for _ in range(4)]
        if "places" in w:
            p.ramp(0.03, "approach", s1=-Ls, s2=0)
        p.ramp(0.012, "approach", h=-f * dmax)
        p.hold(rng.uniform(0.3, 0.6), "hold")
        if "speeds" in w and i == len(loads) - 1:
            for vv, l in ((0.004, 0.006), (0.012, 0.012), (0.035, 0.02), (0.06, 0.025)):
                p.ramp(vv, "slide", s1=l, acc=0.06).ramp(vv, "slide", s1=0, acc=0.06)
            for vv, l in ((0.005, 0.006), (0.015, 0.012), (0.045, 0.02)):
                p.ramp(vv, "slide", s2=l, acc=0.06).ramp(vv, "slide", s2=0, acc=0.06)
        elif "places" in w:
            for vv in (0.015, 0.025):
                p.ramp(vv, "slide", s1=Ls).ramp(vv * 1.3, "slide", s1=-Ls)
            p.ramp(0.02, "slide", s1=0.3 * Ls, s2=0.3 * Ls).ramp(0.02, "slide", s1=0, s2=-0.3 * Ls).ramp(0.02, "slide", s1=Ls, s2=0).ramp(0.03, "slide", s1=0)
        else:
            p.ramp(v[0], "slide", s1=0.8 * Ls).ramp(v[1], "slide", s1=-0.4 * Ls)
            p.hold(rng.uniform(0.2, 0.5), "hold")
            p.ramp(v[2], "slide", s1=0)
            p.ramp(v[3], "slide", s2=0.8 * Ls).ramp(v[0], "slide", s2=-0.4 * Ls)
            p.hold(0.3, "hold").ramp(v[1], "slide", s1=0.6 * Ls, s2=0.4 * Ls).ramp(v[2], "slide", s1=0, s2=0)
        if "reversals" in w:
            for l in (0.001, -0.001, 0.0025, -0.0025, 0.0005, -0.0005, 0):
                p.ramp(0.004, "slide", s1=l, acc=0.05)
            p.hold(0.6, "hold")
            for l in (0.002, -0.002, 0.001, 0):
                p.ramp(0.004, "slide", s2=l, acc=0.05)
        p.ramp(rng.uniform(0.008, 0.02), "retract", h=0.004)
        p.hold(air * 0.8, "rest")
        p.move(0.7, "free", s1=0, s2=0)
    if "places" in w:
        for s in (-0.7, 0.0, 0.7, 0.0):
            p.move(0.7, "free", s1=s * Ls)
            poke(0.8, 0.015, 0.4, 0.015)
    if long:
        for k in range(int(rng.integers(9, 13))):
            p.hold(rng.uniform(3, 7), "rest")
            poke(rng.uniform(0.5, 1.0), 0.01, 0.8, 0.01)
            if k % 3 == 1:
                p.ramp(0.012, "approach", h=-0.6 * dmax).ramp(0.02, "slide", s1=0.02).ramp(0.02, "slide", s1=0).ramp(0.012, "retract", h=0.004)
            if k % 3 == 2:
                turns(2)
    if "revisit" in w:
        for k in range(5):
            p.hold(rng.uniform(2.0, 4.0), "rest")
            poke([0.6, 1.0, 0.8, 0.5, 1.0][k], 0.012, 0.6, 0.012)
    p.move(0.8, "free", h=0.6 * clear)
    if not brief:
        turns(1)
    p.hold(0.4, "rest")
    return p


WISHES = {
    "relaxation": ["holds", "slow-fast"], "hysteresis": ["loops", "slow-fast"], "stress-softening": ["loops"], "adhesion": ["tail"], "surface-offset": ["tilts"],
    "stiffness-drift": ["revisit", "revisit-long"], "stiffness-inhomogeneity": ["places"], "hertz-exponent": ["slow-fast"], "viscous-damping": ["slow-fast"],
    "hunt-crossley-damping": ["slow-fast"], "viscous-friction": ["speeds", "loads"], "stribeck-friction": ["speeds"], "friction-rounding": ["speeds", "reversals"],
    "presliding": ["reversals", "loads"], "load-dependent-friction": ["loads"], "friction-anisotropy": [], "tool-inertia": ["fast", "turns"], "tool-mass": ["fast", "turns"],
    "tool-com": ["fast", "turns"], "structural-compliance": ["loads", "slow-fast"], "tip-offset": ["tilts"], "sensor-gain": ["fast", "turns"], "sensor-bias": ["turns"], "sensor-lag": ["fast", "slow-fast"],
    "time-offset": ["fast", "slow-fast"], "sensor-drift": ["revisit"], "sensor-misalignment": ["loads", "turns"], "sensor-crosstalk": ["loads"], "zener": ["holds"],
}


def tester_plan(rng, dmax, slide, wish=()):
    """Strokes of a material tester; with a lateral stage when `slide`."""
    w = set(wish)
    p = Path(3, TEST_NAMES, start=[-rng.uniform(0.5e-3, 2e-3), 0, 0])
    up = -rng.uniform(0.3e-3, 1.2e-3)
    if "tail" in w:
        up = -2.5e-3
    rest = rng.uniform(0.3, 0.8) if "holds" not in w else rng.uniform(1.5, 2.5)
    p.hold(0.5, "rest")

    def poke(f, v, hold, vo):
        p.ramp(v, "poke", d=f * dmax, acc=0.1)
        if hold > 0:
            p.hold(hold, "hold")
        p.ramp(vo, "retract", d=up, acc=0.1)
        p.hold(rest, "rest")
    order = [0.4, 0.4, 0.7, 0.7, 1.0, 1.0, 0.6, 0.9] if "loops" in w else [0.5, 1.0, 0.7, 1.0, 0.3, 0.85]
    for i, f in enumerate(order):
        v = dmax * [0.45, 3.5, 1.2, 5.0, 2.0, 0.8, 2.5, 0.6][i] * rng.uniform(0.8, 1.25)
        hold = rng.uniform(0.3, 1.0) if "holds" not in w or i % 2 else rng.uniform(2.5, 5)
        poke(f, v, hold, v if "tail" not in w else 0.4 * dmax)
    p.ramp(dmax, "poke", d=0.5 * dmax)
    for f in (0.8, 0.35, 1.0, 0.6, 0.9):
        p.ramp(dmax * logu(rng, 0.3, 2.5), "poke", d=f * dmax)
    p.ramp(dmax, "retract", d=up).hold(rest, "rest")
    p.ramp(dmax, "poke", d=0.55 * dmax)
    p.sine(3, "poke", rng.uniform(0.4, 0.8), d=0.35 * dmax)
    p.sine(2.5, "poke", rng.uniform(1.5, 3.5), d=0.25 * dmax)
    p.sine(1.5, "poke", rng.uniform(4.5, 7), d=0.12 * dmax)
    p.ramp(dmax, "retract", d=up).hold(rest, "rest")
    if slide:
        L = rng.uniform(0.01, 0.02)
        for f in ([0.3, 0.6, 1.0] if "loads" in w else [0.45, 0.9]):
            p.ramp(dmax, "approach", d=f * dmax).hold(0.5, "hold")
            vs = (0.004, 0.014, 0.04) if "speeds" in w else (logu(rng, 5e-3, 0.02), logu(rng, 0.015, 0.05))
            for v in vs:
                l = min(L, 1.0 * v)
                p.ramp(v, "slide", s1=l).ramp(v, "slide", s1=-0.5 * l).hold(0.25, "hold").ramp(v, "slide", s1=0)
                p.ramp(v, "slide", s2=l).ramp(v, "slide", s2=-0.4 * l).ramp(v, "slide", s2=0)
            p.ramp(vs[0], "slide", s1=0.5 * L, s2=0.5 * L).hold(0.3, "hold").ramp(vs[-1], "slide", s1=0, s2=0)
            if "places" in w:
                for v in (0.012, 0.02):
                    p.ramp(v, "slide", s1=L).ramp(v, "slide", s1=-L).ramp(v, "slide", s1=0)
            if "reversals" in w:
                for l in (1e-3, -1e-3, 2.5e-3, -2.5e-3, 5e-4, -5e-4, 0):
                    p.ramp(0.004, "slide", s1=l, acc=0.05)
                p.hold(0.5, "hold")
                for l in (2e-3, -2e-3, 1e-3, 0):
                    p.ramp(0.004, "slide", s2=l, acc=0.05)
            p.ramp(dmax, "retract", d=up).hold(rest, "rest")
    if "revisit" in w:
        for k in range(6):
            p.hold(rng.uniform(3, 5), "rest")
            poke([0.6, 1.0, 0.8, 0.5, 1.0, 0.7][k], dmax, 0.6, dmax)
    if "long" in w:
        for k in range(int(rng.integers(22, 30))):
            p.hold(rng.uniform(5, 12), "rest")
            poke(rng.uniform(0.4, 1.0), dmax * logu(rng, 0.2, 3), rng.uniform(0.5, 3), dmax)
    p.hold(0.4, "rest")
    return p
