"""How each effect of the catalogue is put into a contact world: one amplitude A that the tuner turns (range = what real things have), drawn shape, and
what the motion must show. stage: 'law' and 'sim' act inside the closed loop, 'post' in the sensor, its rig file or the acquisition."""
import numpy as np


def U(rng, a, b):
    return float(rng.uniform(a, b))


def LU(rng, a, b):
    return float(np.exp(rng.uniform(np.log(a), np.log(b))))


def sign(rng):
    return float(rng.choice([-1, 1]))


def unit(rng, n=3):
    v = rng.normal(size=n)
    return v / np.linalg.norm(v)


def axes6(rng, c):
    """A direction over the six channels, moments in N m about 3 % of the forces; a tester has its load cell first."""
    u = np.concatenate([unit(rng), .03 * unit(rng)])
    if c.get("tester"):
        u[0] = np.copysign(max(.8, abs(u[0])), u[0])
    return u


def draw(e, rng, c):
    """c: dict(Fmax, dmax, k, base, n0, mass). Returns dict(stage, A, lo, hi, put=function(world, A))."""
    F, d, k = c["Fmax"], c["dmax"], c["k"]
    L = lambda key, f=lambda A: A: (lambda w, A: w["law"].__setitem__(key, f(A)))
    P = lambda key, f=lambda A: A: (lambda w, A: w["post"].__setitem__(key, f(A)))

    def more(fixed, put):
        def g(w, A):
            w["law"].update(fixed); put(w, A)
        return g
    law = lambda A, lo, hi, put, **fixed: dict(stage="law", A=A, lo=lo, hi=hi, put=more(fixed, put))
    post = lambda A, lo, hi, put: dict(stage="post", A=A, lo=lo, hi=hi, put=put)
    s = sign(rng)
    if e == "hertz-exponent":
        s = 1.0 if c["n0"] == 1 else s
        return law(.15, .03, .7 if s > 0 else .45, L("n", lambda A: c["n0"] + s * A))
    if e == "viscous-damping":
        return law(F * 2, F * .1, F * 15, L("c"))
    if e == "hunt-crossley-damping":
        return law(3., .2, 25., L("lam"))
    if e == "relaxation":
        return law(.2, .02, .75, L("r1"), tau1=LU(rng, .25, 3.5))
    if e == "hysteresis":
        return law(.06 * F, .003 * F, .35 * F, L("hA"), hL=U(rng, .05, .14) * d)
    if e == "stress-softening":
        return law(.2, .02, .75, L("mR"), mL=U(rng, .1, .3) * d)
    if e == "adhesion":
        return law(.06 * F, .004 * F, .3 * F, L("aF"), aL=U(rng, 4e-4, 1.2e-3), aform=float(rng.integers(0, 2)))
    if e == "stiffening-layer":
        return law(.6 * k, .02 * k, 6 * k, L("sK"), sB=U(rng, .42, .6) * d)
    if e == "surface-offset":
        return post(3e-4, 6e-5, 2e-3, P("surface", lambda A: s * A))
    if e == "stiffness-drift":
        return law(.1, .004, 1.5, L("alpha", lambda A: s * A if s > 0 else -min(A, .45)))
    if e == "stiffness-inhomogeneity":
        kind = int(rng.integers(1, 4))
        r = c["reach"]
        th = U(rng, 0, 2 * np.pi)
        if kind == 1:
            return law(.15, .01, .6, lambda w, A: w["law"].update(i1=A * np.cos(th) / r, i2=A * np.sin(th) / r), ikind=1)
        if kind == 2:
            return law(.15, .01, .6, L("i1"), ikind=2, i2=U(rng, -.2, .2) * r, i3=th, i4=U(rng, .15, .3) * r)
        return law(.3, .02, .9, L("i1"), ikind=3, i2=U(rng, -.4, .4) * r, i3=U(rng, -.4, .4) * r, i4=U(rng, .3, .5) * r)
    if e == "coulomb-friction":
        return law(.15, .01, .9, L("mu"))
    if e == "viscous-friction":
        return law(F * .6, F * .03, F * 8, L("cv"))
    if e == "stribeck-friction":
        return law(.06, .006, .35, L("dmu"), vs=LU(rng, .009, .025))
    if e == "presliding":
        return law(6e-4, 2e-4, 4e-3, L("L"))
    if e == "friction-rounding":
        return law(.08, .01, .35, L("mu"), vr=LU(rng, 2e-3, 7e-3))
    if e == "load-dependent-friction":
        return law(.2, .02, .45, L("p", lambda A: -A))
    if e == "friction-anisotropy":
        return law(.12, .01, .6, L("a", lambda A: s * A))
    if e == "tool-mass":
        return post(.04, .003, .4, P("dm", lambda A: s * min(A, .6 * c["mass"]) if s < 0 else A))
    if e == "tool-com":
        u = unit(rng)
        return post(.005, .0004, .04, P("dcom", lambda A: A * u))
    if e == "tool-inertia":
        q = np.linalg.qr(rng.normal(size=(3, 3)))[0]
        I = q @ np.diag([1, U(rng, .7, 1), U(rng, .3, .6)]) @ q.T
        return post(1e-3, 5e-5, .03, P("inertia", lambda A: A * I))
    if e == "structural-compliance":
        return law(2e-5, 1e-6, .6 * d / F, L("C"))
    if e == "tip-offset":
        u = unit(rng) * np.array([1, 1, .25])
        return dict(stage="sim", A=2e-3, lo=2e-4, hi=1e-2, put=lambda w, A: w.__setitem__("tip_off", A * u))
    if e == "sensor-bias":
        u = axes6(rng, c)
        return post(.3, .02, max(5., .2 * F), P("bias", lambda A: A * u))
    if e == "sensor-drift":
        u = axes6(rng, c)
        return post(.5, .06, 6., P("drift", lambda A: A * u))
    if e == "sensor-crosstalk":
        X = np.zeros((6, 6))
        for _ in range(int(rng.integers(3, 7))):
            i, j = rng.choice(3, 2, replace=False)
            X[i, j] = U(rng, .5, 1) * sign(rng)
        for _ in range(int(rng.integers(1, 4))):
            X[3 + rng.integers(0, 3), rng.integers(0, 3)] = .02 * U(rng, .5, 1) * sign(rng)
        return post(.04, .003, .2, P("cross", lambda A: A * X))
    if e == "sensor-misalignment":
        u = unit(rng)
        return post(.03, .003, .2, P("rot", lambda A: A * u))
    if e == "sensor-gain":
        return post(.05, .01, .3, P("gain", lambda A: s * A))
    if e == "sensor-lag":
        return post(.012, .002, .15, P("lag"))
    if e == "time-offset":
        return post(.012, .001, .08, P("toff", lambda A: s * A))
    if e == "saturation":
        return post(.25, .03, .75, P("clip"))
    if e == "quantization":
        return post(.3, .01, 8., P("quant"))
    if e == "mains-hum":
        u = np.concatenate([unit(rng), .03 * unit(rng)])
        return post(.4, .02, 6., lambda w, A: w["post"].update(hum=A * u, humf=c["mains"]))
    raise KeyError(e)


PARAM_UNITS = {"hertz-exponent": "|n - n0|", "viscous-damping": "N s/m", "hunt-crossley-damping": "s/m", "relaxation": "ratio", "hysteresis": "N",
               "stress-softening": "ratio", "adhesion": "N", "stiffening-layer": "N/m", "surface-offset": "m", "stiffness-drift": "1/min",
               "stiffness-inhomogeneity": "relative", "coulomb-friction": "mu", "viscous-friction": "N s/m", "stribeck-friction": "delta mu",
               "presliding": "m", "friction-rounding": "mu (speed in law.vr)", "load-dependent-friction": "-p", "friction-anisotropy": "a",
               "tool-mass": "kg", "tool-com": "m", "tool-inertia": "kg m2", "structural-compliance": "m/N", "tip-offset": "m", "sensor-bias": "N",
               "sensor-drift": "N/min", "sensor-crosstalk": "1", "sensor-misalignment": "rad", "sensor-gain": "1", "sensor-lag": "s", "time-offset": "s",
               "saturation": "share of the peak cut off", "quantization": "N", "mains-hum": "N"}


def emphasis(hidden, rng, tester):
    """What the motion must hold so that these effects show and can be told from their look-alikes."""
    o = {}
    grid = lambda r: [(0, 0)] + [tuple(p) for p in rng.uniform(-r, r, (5, 2))] + [(0, 0)]
    r = .012 if tester else .03
    for e in hidden:
        if e in ("relaxation",):
            o.update(holds=(1.0, 2.5), last=(4, 6), poke_speeds=[.005, .012, .04])
        if e in ("hysteresis", "viscous-damping", "hunt-crossley-damping"):
            o.update(inner=True, loops=2, poke_speeds=[.005, .012, .04], depths=[.4, .7, 1.0, .6])
        if e == "stress-softening":
            o.update(depths=[.4, .4, .7, 1.0, .6, 1.0], inner=True)
        if e == "adhesion":
            o.update(out=.004 if tester else .006)
        if e in ("stiffening-layer", "hertz-exponent", "surface-offset", "structural-compliance"):
            o.update(depths=[.25, .5, .75, 1.0])
        if e == "structural-compliance":
            o.update(poke_speeds=[.006, .02, .04])
        if e == "stiffness-drift":
            o.update(cycles=3 if tester else 2, pause=6.0)
        if e == "stiffness-inhomogeneity":
            o.update(places=grid(r), depths=[.7, .5, .7, .9, .7, .5, .7])
        if e in ("stribeck-friction", "viscous-friction", "friction-rounding"):
            o.update(speeds=[.002, .006, .02, .06] if tester else [.004, .012, .03, .07])
        if e in ("tip-offset", "surface-offset"):
            o.update(ntilt=4 if e == "tip-offset" else 2)
        if e in ("stribeck-friction", "viscous-friction"):
            o.update(slow_twice=True)
        if e in ("presliding",):
            o.update(fine=True)
        if e in ("load-dependent-friction", "coulomb-friction", "viscous-friction"):
            o.update(slide_depths=[.2, .5, .9])
        if e in ("tool-mass", "tool-com", "sensor-gain", "sensor-bias", "sensor-misalignment", "sensor-crosstalk"):
            o.update(turns=6, turn=.95)
        if e in ("tool-inertia", "sensor-lag", "time-offset"):
            o.update(shakes=4, shake=.14, poke_speeds=[.01, .03, .07])
        if e == "sensor-drift":
            o.update(cycles=2, pause=8.0)
    return o
