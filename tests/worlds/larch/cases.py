"""Recipes. Each returns a dict for build.py plus kind, model, truth, values, note, class."""
import numpy as np
from sims import Path
WN = [.015, .014, .029, .0005, .0006, .0003]

# ------------------------------------------------------------------ paths: coordinates (slip1, slip2, height); depth needs d + N/K of command
def cmd(d, mat, K): return -(d+(mat["k"]*d**mat["n"]/K if d > 0 else 0.))

def pokes(lst, up=.003, rest=.5, x0=(0, 0), h0=.008, xs=None):
    """lst: (depth, speed in, hold, speed out)"""
    def f(dt, mat, K):
        p = Path([0, 0, h0], dt).hold(.3, "free").to([x0[0], x0[1], up], 1., "approach")
        for i, (d, v, hold, vo) in enumerate(lst):
            x = x0 if xs is None else xs[i % len(xs)]
            if xs is not None: p.to([x[0], x[1], up], .8, "free")
            p.line([x[0], x[1], cmd(d, mat, K)], v*abs(cmd(d, mat, K))/max(d, 1e-4) if K < 1e8 else v, "poke")
            if hold: p.hold(hold, "hold")
            p.line([x[0], x[1], up], vo, "retract"); p.hold(rest, "free")
        return p
    return f

def wiggle(d0, amps, f0, f1, T, up=.003, h0=.008, more=()):
    """in contact around d0, chirp"""
    def f(dt, mat, K):
        p = Path([0, 0, h0], dt).hold(.3, "free").to([0, 0, up], .8, "approach").line([0, 0, cmd(d0, mat, K)], .006, "poke").hold(.4, "hold")
        s = 1+(mat["k"]*mat["n"]*d0**(mat["n"]-1)/K)
        t = np.arange(1, int(T/dt)+1)*dt; w = np.minimum(1, np.minimum(t/.5, (T-t)/.5)); ph = 2*np.pi*(f0*t+.5*(f1-f0)*t*t/T)
        y = np.zeros((len(t), 3)); y[:, 2] = cmd(d0, mat, K)-s*amps*w*np.sin(ph); p.fn(y, "poke")
        for d, v, hold in more: p.line([0, 0, up], .01, "retract").hold(.3, "free").line([0, 0, cmd(d, mat, K)], v, "poke").hold(hold, "hold")
        return p.line([0, 0, up], .02, "retract").hold(.4, "free")
    return f

def slides(lst, up=.003, h0=.008, hold=.3, force=False, start=(0, 0), rest=.4, pause=.15, va=.008):
    """lst: list of (depth or force, [(x, y, speed), ...])"""
    def f(dt, mat, K):
        p = Path([0, 0, h0], dt).hold(.3, "free").to([start[0], start[1], up], 1., "approach")
        for d, segs in lst:
            if force:
                dd = (d/mat["k"])**(1/mat["n"]); h = cmd(dd, mat, K); fd = d
            else: h = cmd(d, mat, K); fd = -1.
            x = p.x[-1][-1]; p.line([x[0], x[1], h], va, "approach").hold(hold, "hold", fd)
            for a, b, v in segs: p.line([a, b, h], v, "slide", fd).hold(pause, "slide", fd)
            x = p.x[-1][-1]; p.line([x[0], x[1], up], .012, "retract").hold(rest, "free")
        return p
    return f

def fourier(T, amp, f0=.08, nh=5, ramp=1.2):
    def f(q0, dt, rng, A):
        t = np.arange(int(T/dt))*dt; Q = np.zeros((len(t), A.n)); w = np.clip(t/ramp, 0, 1); w = w*w*(3-2*w)
        for i in range(A.n):
            x = np.zeros(len(t)); a = 0
            for k in range(1, nh+1):
                u = rng.normal()/k**.7; a += abs(u); x += u*np.sin(2*np.pi*f0*k*(1+.07*i)*t+rng.uniform(0, 6.28))
            lo = min(amp*(1 if i < 3 else 1.5), .9*(A.lim[i]-abs(q0[i]))); Q[:, i] = q0[i]+w*(x-x[0])*lo/(np.max(np.abs(x-x[0]))+1e-9)
        return Q
    return f

def poses(npose, move=1.3, rest=.9, amp=1.0, shake=0., fast=1.0):
    def f(q0, dt, rng, A):
        out = [q0[None]]; q = q0.copy()
        sc = np.array([.25, .25, .3, .35, .9, .9, 1.2]) if A.n == 7 else np.array([.25, .2, .25, 1.1, .9, 1.4])
        for k in range(npose):
            g = np.clip(A.seed+amp*sc*rng.uniform(-1, 1, A.n), -.93*A.lim, .93*A.lim)
            n = int(move/fast/dt); s = np.arange(1, n+1)/n; s = 10*s**3-15*s**4+6*s**5
            out.append(q+np.outer(s, g-q)); q = g; out.append(np.repeat(q[None], int(rest/dt), 0))
            if shake and k % 2:
                m = int(1.5/dt); t = np.arange(m)*dt; w = np.sin(np.pi*t/1.5)**2
                y = np.repeat(q[None], m, 0)
                for i in range(A.n): y[:, i] += shake*w*np.sin(2*np.pi*(1.6+.5*i)*t)
                out.append(y)
        return np.concatenate(out)
    f.shake = shake
    return f

def drive_prof(T, kinds, amp=1.2):
    def f(dt, rng):
        t = np.arange(int(T/dt))*dt; q = np.zeros(len(t)); w = np.clip(t/.8, 0, 1); w = w*w*(3-2*w)
        for a, fr in kinds: q += a*np.sin(2*np.pi*fr*t+rng.uniform(0, 6.28))
        return w*(q-q[0])
    return f

def drive_moves(segs, ta=.25):
    """constant-speed moves back and forth (dq, speed)"""
    from sims import trap
    def f(dt, rng):
        out = [np.zeros((int(.4/dt), 1))]; x = 0.
        for d, v in segs:
            out.append(trap([x], [x+d], v, dt, ta)); x += d; out.append(np.full((int(.1/dt), 1), x))
        return np.concatenate(out)[:, 0]
    return f

# ------------------------------------------------------------------ nuisances
def fr(rng, mu, allow=(0, 1, 2, 4)):
    k = int(rng.choice(allow)); d = dict(mu=mu, kind=k, L=float(rng.uniform(8e-5, 1.2e-4)*(.85 if k == 0 else 1)), vr=float(rng.uniform(1e-4, 4e-4)))
    if k == 2: d["s1"] = float(rng.uniform(1., 4.))
    if k == 4: d.update(kind=2, s1=1.5, dmu=.02*mu, vs=.004)        # a little stick-slip prone
    return d, ["prandtl", "dahl", "lugre", "rounded", "stick-slip"][k]

def nuis(rng, kind, fs, **over):
    d = dict(fs=fs, jitter=float(rng.choice([0, .03, .1])), drop=float(rng.choice([0, 0, .005, .02])), hasdq=bool(rng.random() < .65),
             nonlin=float(rng.uniform(-.01, .01)), dqfilt=float(rng.choice([40., 80., 150.])))
    if kind == "arm":
        d.update(wnoise=[float(x*rng.uniform(.8, 1.4)) for x in WN], enc=float(rng.choice([2e-6, 5e-6, 1.2e-5])), dqnoise=float(10**rng.uniform(-4.5, -3.3)), dqbias=float(rng.uniform(0, 2e-4)),
                 dqlag=float(rng.choice([0, .001, .003])), hastau=bool(rng.random() < .4), taufilt=float(rng.choice([8., 20., 50.])), taurate=float(rng.choice([100., 250., 333.])),
                 wbias=float(rng.uniform(-.01, .01)), wdrift=float(rng.uniform(-.01, .01)), clock=float(rng.uniform(-3e-4, 3e-4)), tool_off=float(rng.uniform(-.015, .015)),
                 tool=dict(mass=round(float(rng.uniform(.16, .32)), 3), com=[0., 0., round(float(rng.uniform(.04, .055)), 4)]), wfilt=float(rng.choice([150., 250., 400.])),
                 K=float(rng.choice([2000., 3500., 5000.])), Kr=float(rng.choice([120., 200.])), wstep=[.01, .01, .02, .00025, .00025, .00025] if rng.random() < .5 else None)
        if rng.random() < .3:
            a = rng.uniform(-.05, .05, 2); d["gravity"] = [round(9.81*float(np.sin(a[0])), 4), round(9.81*float(np.sin(a[1])), 4), -round(9.81*float(np.sqrt(1-np.sin(a[0])**2-np.sin(a[1])**2)), 4)]
    elif kind == "tester":
        d.update(enc=float(rng.choice([5e-7, 1e-6, 3e-6])), dqnoise=float(rng.choice([2e-5, 1e-4])), fnoise=float(rng.uniform(.008, .02)), wbias=float(rng.uniform(-.004, .004)), wfilt=float(rng.choice([150., 250., 400.])), wn=float(rng.choice([120., 250.])), clock=float(rng.uniform(-3e-4, 3e-4)))
    else:
        d.update(enc=float(rng.choice([2e-6, 2e-5, 8e-5])), dqnoise=float(10**rng.uniform(-4.5, -3.3)), dqbias=float(rng.uniform(-2e-4, 2e-4)), taufilt=float(rng.choice([30., 50.])), taurate=float(rng.choice([200., 500.])), taunoise=float(rng.uniform(.01, .03)), kp=float(rng.choice([1500., 4000.])))
    d.update(over); return d

SOFT = dict(n=1.5, k=1.2e4, dref=5e-3)

def mat(rng, n=1.5, k=None, dref=4.5e-3, off=None):
    if k is None: k = {1: 1500., 1.5: 1.6e4}.get(n, 1.6e4)
    return dict(n=n, k=k*float(rng.uniform(.8, 1.25)), dref=dref, off=float(rng.uniform(.05, .3)) if off is None else off)

P8 = [(.0045, .012, .8, .012), (.003, .03, .4, .03), (.0048, .005, .5, .02), (.004, .05, .6, .05), (.002, .01, .4, .006), (.0045, .025, 1., .02)]
BF = [(.03, 0, .02), (0, 0, .02), (.02, .02, .03), (0, 0, .012), (0, .025, .025), (0, 0, .04)]
def sl2(rng, d=(.003, .0045), v=1.):
    r = lambda: float(rng.uniform(.85, 1.15))
    return [(x*r(), [(a*r(), b*r(), s*v*r()) for a, b, s in BF[:-1]]+[(0, 0, .04*v)]) for x in d]

def hc(rng, lam=None): return dict(lam=float(rng.uniform(1., 2.2)) if lam is None else lam)

def A(rng, robot, fs, base, path, m, law, truth=(), values=None, note="", **o):
    if fs >= 200 and rng.random() < .35: fs = float(min(2000., fs*rng.choice([2, 4])))
    c = nuis(rng, "arm", fs); c.update(kind="arm", robot=robot, model=base, path=path, mat=m, law=law, truth=list(truth), values=values or {}, note=note); c.update(o); return c
def T(rng, fs, base, path, m, law, truth=(), values=None, note="", **o):
    if fs >= 200 and rng.random() < .35: fs = float(min(2000., fs*rng.choice([2, 4])))
    c = nuis(rng, "tester", fs); c.update(kind="tester", dec=2, model=base, path=path, mat=m, law=law, truth=list(truth), values=values or {}, note=note); c.update(o); return c
def D(rng, fs, base, q, joint, truth=(), values=None, note="", **o):
    c = nuis(rng, "drive", fs); c.update(kind="drive", model=base, qpath=q, joint=joint, truth=list(truth), values=values or {}, note=note); c.update(o); return c
def F(rng, robot, fs, q, truth=(), values=None, note="", **o):     # free motion, wrench
    c = nuis(rng, "arm", fs); c.update(kind="arm", robot=robot, model="none", path="joint", qpath=q, contact=False, law={}, truth=list(truth), values=values or {}, note=note, tool_off=float(rng.uniform(-.004, .004)),
        enc=float(rng.choice([5e-6, 1e-4, 3e-4, 1e-3])) if not getattr(q, "shake", 0) else float(rng.choice([2e-6, 1.2e-5])), tool=dict(mass=round(float(rng.uniform(.7, 1.0)), 3), com=[0., 0., round(float(rng.uniform(.04, .055)), 4)])); c.update(o); return c
def J(rng, robot, fs, base, q, joint, truth=(), values=None, note="", **o):  # free motion, joint torques
    c = nuis(rng, "arm", fs); c.update(kind="arm", robot=robot, model=base, path="joint", qpath=q, contact=False, haswrench=False, law={}, truth=list(truth), values=values or {}, note=note, joint=joint, hastau=True,
        tool=dict(mass=0., com=[0., 0., 0.]), enc=float(rng.choice([5e-6, 2.5e-5])), taufilt=float(rng.choice([30., 50.])), level=3e-4); c.update(o); return c

def pick(rng): return str(rng.choice(["lwr", "six"]))
def NJ(r): return 7 if r == "lwr" else 6
def jv(name, v): return {"%s[%d]" % (name, i+1): float(x) for i, x in enumerate(v) if x != 0}

# ------------------------------------------------------------------ one hidden effect
def o_exponent(r):
    n = float(r.uniform(1.65, 2.)); m = mat(r, n, k=1.6e4*(4e-3)**(1.5-n)*1., off=.1)
    return T(r, 200., "hertz", pokes([(.004, .004, .5, .004), (.0055, .01, .5, .01), (.003, .002, .3, .004)]), m, {}, ["hertz-exponent"], {"hertz-exponent.n": n}, "exponent %.2f where Hertz has 1.5" % n)
def o_viscous(r):
    c = float(r.uniform(35, 60)); m = mat(r)
    return A(r, "six", 500., "hertz", pokes(P8), m, dict(c=c), ["viscous-damping"], {"viscous-damping.c": c}, "dashpot c*rate over the touching share of the tip")
def o_hcdamp(r):
    l = float(r.uniform(5., 9.)); m = mat(r)
    return T(r, 500., "hertz", wiggle(.003, .0013, .3, 4., 14., more=[(.0045, .03, .5), (.004, .01, .5)]), m, dict(lam=l), ["hunt-crossley-damping"], {"hunt-crossley-damping.lambda": l}, "F_e(1+lambda rate)")
def o_relax(r):
    q = float(r.uniform(.3, .55)); tau = float(r.uniform(.6, 1.5)); m = mat(r)
    return A(r, "lwr", 250., "hunt-crossley", pokes([(.0045, .02, 4., .02), (.003, .04, 3., .02), (.005, .008, 5., .03), (.0035, .03, 2., .03)]), m, dict(r1=.7*q, tau1=.85*tau, r2=.3*q, tau2=1.5*tau, **hc(r)),
             ["relaxation"], {"relaxation.ratio": q, "relaxation.tau": .85*.7*tau+.3*1.5*tau}, "two Maxwell branches; ratio = sum of branch stiffness over the equilibrium stiffness, tau = weighted mean")
def o_hyst(r):
    m = mat(r); a = float(r.uniform(.55, .9))
    return T(r, 100., "hunt-crossley", wiggle(.0032, .001, .1, .8, 16., more=[(.0045, .002, .5), (.004, .02, .5), (.005, .008, .5)]), m, dict(hysA=a, hysL=3e-4, lam=.5), ["hysteresis"], {"hysteresis.amplitude": a, "hysteresis.length": 3e-4},
             "three Jenkin elements of slip lengths 0.5,1,1.5 x 0.3 mm; amplitude in N is half the full loop's width")
def o_mullins(r):
    m = mat(r); a = float(r.uniform(.3, .45)); L = 4e-4
    return T(r, 200., "hunt-crossley", pokes([(.002, .008, .3, .008), (.002, .02, .3, .008), (.0035, .008, .3, .01), (.0035, .008, .3, .01), (.005, .01, .3, .01), (.005, .01, .3, .01), (.0035, .02, .3, .01), (.005, .004, .3, .01)]), m, dict(mulR=a, mulL=L, **hc(r)),
             ["stress-softening"], {"stress-softening.ratio": a, "stress-softening.length": L}, "each ring softens by ratio*(1-exp(-(dmax-d)/L)) below its own deepest past")
def o_adh(r):
    m = mat(r, 1, k=1400.); a = float(r.uniform(.6, 1.1))
    return A(r, "six", 200., "kelvin-voigt", pokes([(.003, .01, .4, .004), (.004, .02, .4, .01), (.002, .005, .3, .003), (.0035, .015, .3, .006)]), m, dict(c=6., adhF=a, adhL=8e-4), ["adhesion"], {"adhesion.force": a, "adhesion.length": 8e-4},
             "constant -F_a while bonded, tail to pull-off of elliptic shape")
def o_layer(r):
    m = mat(r, 1, k=1300.); K = float(r.uniform(2500, 4000)); b = float(r.uniform(.0028, .0036))
    return T(r, 200., "kelvin-voigt", pokes([(.0025, .005, .4, .01), (.0045, .01, .5, .01), (.005, .02, .4, .02), (.0055, .004, .4, .01)]), m, dict(c=5., layK=K, layD=b, layW=8e-5), ["stiffening-layer"], {"stiffening-layer.K": K, "stiffening-layer.depth": b}, "second spring bed beyond delta_b, rounded over 0.08 mm")
def o_soff(r):
    z = float(r.choice([-1, 1])*r.uniform(.0006, .001)); m = mat(r)
    return A(r, "lwr", 250., "hertz", pokes([(.003, .008, .5, .01), (.0045, .015, .5, .01), (.002, .01, .4, .01), (.0038, .02, .4, .02)]), m, {}, ["surface-offset"], {"surface-offset.offset": z}, "surface nearer (+) or farther (-) than the rig says", z0=z)
def o_sdrift(r):
    a = float(r.choice([-1, 1])*r.uniform(.1, .2)); m = mat(r, 1, k=1500.)
    return T(r, 50., "kelvin-voigt", pokes([(.004, .006, 2., .01), (.003, .01, 2., .01), (.0045, .008, 3., .01)]*6), m, dict(c=5., drift=a), ["stiffness-drift"], {"stiffness-drift.rate": a}, "k(1+alpha t), t in minutes from the log's zero", dec=25)
def o_inh(r):
    a = float(r.uniform(.4, .7)); m = mat(r); f, nm = fr(r, .35, (0, 1, 2, 4))
    lst = [(.004, [(.05, y, .02), (0, y, .025)]) for y in (0., .006, .012)]+[(.003, [(.05, .006, .03), (0, .006, .02)])]
    p = slides([(.004, [(.05, 0., .02), (0., 0., .025), (0, .006, .02), (.05, .006, .02), (0, .006, .02), (0, .012, .02), (.05, .012, .02), (0, .012, .02)]), (.003, [(.05, .012, .03), (0, .012, .02), (0, .006, .02), (.05, .006, .03), (0, .006, .02)])])
    return A(r, "lwr", 100., "hunt-crossley,coulomb-friction", p, m, dict(inhA=a, inhX=.027, inhY=.006, inhR=.009, inhW=.003, **hc(r), **f), ["stiffness-inhomogeneity"], {}, "round inclusion of radius 9 mm, +%.0f %%; friction %s" % (100*a, nm))
def o_strib(r):
    dm = float(r.uniform(.2, .3)); vs = float(r.uniform(.006, .012)); f, nm = fr(r, .3, (0, 1)); m = mat(r)
    segs = [(.02, 0, .002), (0, 0, .004), (.03, 0, .008), (0, 0, .015), (.03, 0, .03), (0, 0, .06), (.01, .01, .003), (0, 0, .02)]
    f.update(dmu=dm, vs=vs)
    return T(r, 200., "hunt-crossley,coulomb-friction", slides([(.0045, segs), (.003, segs[2:6])]), m, dict(**hc(r), **f), ["stribeck-friction"], {"stribeck-friction.dmu": dm, "stribeck-friction.v_s": vs}, "Stribeck, bristles " + nm, slides=True)
def o_presl(r):
    L = float(r.uniform(1e-3, 1.8e-3)); m = mat(r); mu = float(r.uniform(.5, .7))
    segs = [(.006, 0, .008), (.002, 0, .006), (.005, 0, .006), (.001, 0, .008), (.006, .003, .008), (.003, 0, .006), (.0045, .002, .005), (.001, 0, .01)]
    return A(r, "lwr", 250., "hunt-crossley,coulomb-friction", slides([(.0045, segs), (.0035, segs)]), m, dict(mu=mu, kind=1, L=L, **hc(r)), ["presliding"], {"presliding.length": L}, "Dahl bristle, length %.2f mm: F = mu N z/L, z' = v - |v| z/L" % (1e3*L))
def o_load(r):
    p = float(r.choice([-1, 1])*r.uniform(.45, .6)); f, nm = fr(r, .4); f.update(pl=p, N0=4.); m = mat(r)
    return T(r, 200., "hunt-crossley,coulomb-friction", slides(sl2(r, (.0015, .003, .0048))), m, dict(**hc(r), **f), ["load-dependent-friction"], {"load-dependent-friction.p": p}, "mu (N/4 N)^p; bristles " + nm, slides=True)
def o_vfric(r):
    c = float(r.uniform(18, 30)); f, nm = fr(r, .25); m = mat(r)
    return A(r, "six", 200., "hunt-crossley,coulomb-friction", slides([(.0035, [(.05, 0, .01), (0, 0, .03), (.06, .01, .08), (0, 0, .06), (.05, .02, .1), (0, 0, .02)]), (.0045, [(.05, 0, .05), (0, 0, .09)])]), m, dict(cv=c, **hc(r), **f), ["viscous-friction"], {"viscous-friction.c": c}, "bristles " + nm)
def o_ani(r):
    a = float(r.choice([-1, 1])*r.uniform(.28, .42)); f, nm = fr(r, .4); f["ani"] = a; m = mat(r)
    return A(r, "lwr", 500., "hunt-crossley,coulomb-friction", slides([(.004, [(.03, 0, .02), (0, 0, .02), (0, .03, .02), (0, 0, .03), (.025, .025, .03), (0, 0, .02)]), (9e-3**1*.35, [(0, .02, .02), (.02, .02, .02), (0, 0, .03)])]), m, dict(**hc(r), **f), ["friction-anisotropy"], {"friction-anisotropy.a": a}, "mu(1+a) along tangent, mu(1-a) across; bristles " + nm)
def o_round(r):
    v = float(r.uniform(.008, .014)); m = mat(r)
    return A(r, "six", 250., "hunt-crossley,coulomb-friction", slides([(.004, [(.03, 0, .01), (0, 0, .03), (.03, .01, .05), (0, 0, .005), (.02, 0, .02), (0, 0, .06)]), (.003, [(.02, 0, .02), (0, 0, .008)])], pause=.5), m, dict(mu=.5, kind=3, vr=v, **hc(r)), ["friction-rounding"], {"friction-rounding.v_r": v}, "lubricated: mu N v/sqrt(v^2+v_r^2), no force at rest")
def o_tmass(r):
    d = float(r.choice([-1, 1])*r.uniform(.08, .14)); rb = pick(r)
    return F(r, rb, 200., poses(9, shake=.04), ["tool-mass"], {"tool-mass.dm": d}, "tool's true mass minus the rig's, com kept", dm=d)
def o_tcom(r):
    d = [float(x) for x in r.choice([-1, 1], 3)*r.uniform([.003, .003, .004], [.006, .006, .009])]
    return F(r, "lwr", 100., poses(9), ["tool-com"], {"tool-com.dx": d[0], "tool-com.dy": d[1], "tool-com.dz": d[2]}, "true com minus the rig's, sensor frame", dcom=d)
def o_tip(r):
    d = [float(r.choice([-1, 1])*r.uniform(.005, .008)), float(r.choice([-1, 1])*r.uniform(.005, .008)), 0.]; m = mat(r); f, nm = fr(r, .35)
    return A(r, "six", 250., "hunt-crossley,coulomb-friction", slides(sl2(r)), m, dict(**hc(r), **f), ["tip-offset"], {"tip-offset.dx": d[0], "tip-offset.dy": d[1], "tip-offset.dz": 0.}, "true tip minus the rig's in the tip frame; seen in the torques; bristles " + nm, tipoff=d)
def o_comp(r):
    C = float(r.uniform(5e-5, 7e-5)); m = mat(r, 1.5, k=8e4, dref=3e-3, off=.05)
    return A(r, "lwr", 500., "hertz", pokes([(.002, .01, .5, .01), (.0032, .015, .5, .01), (.0035, .03, .4, .03), (.0012, .006, .4, .01)]), m, dict(comp=C, compT=1e-3), ["structural-compliance"], {"structural-compliance.C": C}, "wrist gives by C F (1 ms lag); Hertz material", K=5000., enc=2e-6)
def o_bias(r):
    b = [float(x) for x in r.choice([-1, 1], 6)*np.array([.4, .3, .5, .02, .025, .015])*r.uniform(.7, 1.3)]
    return F(r, "six", 100., poses(8), ["sensor-bias"], {"sensor-bias."+k: v for k, v in zip(["fx", "fy", "fz", "tx", "ty", "tz"], b)}, "constant wrench", sens=dict(bias=b))
def o_drift(r):
    b = [float(x) for x in r.choice([-1, 1], 6)*np.array([.35, .25, .5, .02, .02, .01])]
    rb = pick(r)
    return F(r, rb, 50., poses(40, rest=1.6), ["sensor-drift"], {"sensor-drift."+k: v for k, v in zip(["fx", "fy", "fz", "tx", "ty", "tz"], b)}, "per minute from the log's zero", sens=dict(drift=b), dec=10)
def o_cross(r):
    a, b = float(r.choice([-1, 1])*r.uniform(.06, .1)), float(r.choice([-1, 1])*r.uniform(.05, .08))
    return F(r, "lwr", 125., poses(10), ["sensor-crosstalk"], {"sensor-crosstalk.fx_fz": a, "sensor-crosstalk.fy_fz": b}, "reading fx += a fz, fy += b fz", sens=dict(cross={("fx", "fz"): a, ("fy", "fz"): b}))
def o_misal(r):
    v = [float(x) for x in r.choice([-1, 1], 3)*r.uniform(.03, .06, 3)]
    return F(r, "six", 200., poses(10), ["sensor-misalignment"], {"sensor-misalignment.rx": v[0], "sensor-misalignment.ry": v[1], "sensor-misalignment.rz": v[2]}, "reading = R(v) true wrench, i.e. + v x f", sens=dict(rot=v))
def o_gain(r):
    g = float(r.choice([-1, 1])*r.uniform(.08, .13))
    return F(r, "lwr", 200., poses(10, shake=.03), ["sensor-gain"], {"sensor-gain.fz": g}, "only channel fz reads (1+g) times", sens=dict(gain={"fz": g}))
def o_lag(r):
    t = float(r.uniform(.02, .035)); m = mat(r)
    return A(r, "six", 500., "hunt-crossley", wiggle(.0035, .0012, .5, 6., 12., more=[(.0045, .05, .5), (.004, .03, .5)]), m, hc(r), ["sensor-lag"], {"sensor-lag.tau": t}, "first-order low-pass on all six channels", sens=dict(tau=t))
def o_toff(r):
    t = float(r.choice([-1, 1])*r.uniform(.015, .03)); m = mat(r); f, nm = fr(r, .35, (1,)); f["L"] = float(r.uniform(8e-5, 1.2e-4))
    return A(r, "lwr", 250., "hunt-crossley,coulomb-friction", slides(va=.05, lst=[(.004, [(.02, 0, .04), (0, 0, .04)]*3), (.0025, [(.02, .01, .05), (0, 0, .05)]*2), (.0045, [(.02, 0, .06), (0, 0, .06)]*2), (.003, [(.01, 0, .06), (0, 0, .06)]), (.0048, [(.01, 0, .06), (0, 0, .06)])], rest=.2), m, dict(**hc(r), **f), ["time-offset"], {"time-offset.offset": t}, "wrench stamped late by offset: reading(t) = wrench(t - offset); bristles " + nm, sens=dict(toff=t))
def o_sat(r):
    m = mat(r, k=2.4e4)
    return A(r, "six", 200., "hunt-crossley", pokes([(.0045, .01, .6, .01), (.003, .02, .5, .02), (.005, .02, .6, .02), (.002, .01, .4, .01), (.0048, .008, .8, .01)]), m, hc(r), ["saturation"], {"saturation.limit": 4.5}, "fz clipped at 4.5 N, noise before the clip", sens=dict(sat={"fz": 4.5}))
def o_quant(r):
    m = mat(r); s = float(r.choice([.25, .4]))
    return T(r, 200., "hunt-crossley", pokes(P8), m, hc(r), ["quantization"], {"quantization.step": s}, "normal force rounded to a lattice; true_error holds the rounding", sens=dict(quant=s))
def o_hum(r):
    m = mat(r); a = float(r.uniform(.12, .2)); f = float(r.choice([50., 60.]))
    return A(r, pick(r), 500., "hunt-crossley", pokes(P8), m, hc(r), ["mains-hum"], {"mains-hum.frequency": f, "mains-hum.amplitude": a}, "line on fx fz ty, with second harmonic 25 %", sens=dict(hum=dict(f=f, amp=dict(fx=.6*a, fz=a, ty=.004))))
RB = "rigid-body"; RBF = "rigid-body,joint-coulomb-friction,joint-viscous-friction"
def fric(n, r, c=1., v=1.):
    b = np.array([.9, 1., .6, .6, .4, .25, .2])[:n]
    return dict(Fc=c*b*r.uniform(.7, 1.3, n), Fv=v*b*r.uniform(.7, 1.3, n))
def o_jc(r):
    j = fric(7, r, 1.3, .7)
    return J(r, "lwr", 250., "rigid-body,joint-viscous-friction", fourier(30., .6), j, ["joint-coulomb-friction"], jv("joint-coulomb-friction.coulomb", j["Fc"]), "two-bristle Prandtl joints")
def o_jv(r):
    j = fric(6, r, .8, 2.)
    return J(r, "six", 500., "rigid-body,joint-coulomb-friction", fourier(25., .7, .1), j, ["joint-viscous-friction"], jv("joint-viscous-friction.viscous", j["Fv"]), "")
def o_jstr(r):
    s = float(r.uniform(1.6, 2.4)); vs = float(r.uniform(.06, .12))
    return D(r, 200., RBF, drive_moves([(.5, .05), (-.5, .1), (.6, .2), (-.6, .4), (1., .8), (-1., .03), (.3, .05), (-.3, .15), (.8, .6), (-.8, .02), (.8, .3), (-.8, 1.)]), dict(Fc=1.5, Fv=1.2, dFs=s, vs=vs, bl=1.5e-3), ["joint-stribeck-friction"], {"joint-stribeck-friction.dF[1]": s, "joint-stribeck-friction.v_s[1]": vs}, "falling friction around standstill")
def o_jrip(r):
    k = float(r.choice([8, 12, 20])); a = float(r.uniform(.5, .9))
    return D(r, 250., RBF, drive_moves([(4., .5), (-4., .8), (6., 1.), (-6., .6), (3., .4), (-3., 1.2)]), dict(Fc=1.2, Fv=1., ra=a, rk=k, rp=.7, ra2=.25*a), ["joint-torque-ripple"], {"joint-torque-ripple.k[1]": k, "joint-torque-ripple.amplitude[1]": a}, "sine of k q and its 2nd harmonic (25 %)")
def o_jspr(r):
    k = float(r.uniform(2., 4.))
    return D(r, 100., RBF, drive_prof(40., [(.9, .11), (.35, .37), (.06, .8)]), dict(Fc=1.2, Fv=.8, ks=k), ["joint-spring"], {"joint-spring.stiffness[1]": k}, "reading += k q")
def o_rotor(r):
    s = float(r.uniform(.8, 1.2)); c = J(r, "lwr", 500., RBF, fourier(24., .55, .14, 7), fric(7, r), ["rotor-inertia"], {}, "reflected rotor inertia in front of the torque reading", rotSeen=s, taufilt=50.)
    c["values"] = jv("rotor-inertia.inertia", s*np.array([.9, .9, .5, .5, .2, .13, .13])); return c
def o_pay(r):
    m = float(r.uniform(.6, 1.)); z = .06
    return J(r, pick(r), 250., RBF, fourier(30., .6), None, ["payload"], {"payload.mass": m}, "unstated mass at the sensor frame, com 60 mm along its z", dm=m, dcom=[0, 0, z])
def o_jgain(r):
    g = r.choice([-1, 1], 6)*r.uniform(.06, .12, 6)*np.array([0, 1, 1, 0, 0, 0])
    return J(r, "six", 200., RBF, fourier(30., .6), fric(6, r), ["joint-torque-gain"], jv("joint-torque-gain.gain", g), "joints 2 and 3 read (1+g) times", tauread=dict(gain=g))
def o_joff(r):
    b = r.choice([-1, 1], 7)*r.uniform(.5, 1., 7)*np.array([1, 1, .6, .6, .4, .2, .2])
    return J(r, "lwr", 100., RBF, fourier(36., .6, .06), fric(7, r), ["joint-torque-offset"], jv("joint-torque-offset.offset", b), "reading += offset", tauread=dict(offset=b))
def o_jasym(r):
    a = float(r.uniform(.3, .45))
    return J(r, "six", 250., RBF, fourier(30., .6), dict(asym=a, **fric(6, r, 2.)), ["joint-friction-asymmetry"], {}, "Coulomb (1+a) in plus, (1-a) in minus direction, a=%.2f on all joints" % a)
def o_jload(r):
    a = float(r.uniform(.08, .12))
    return J(r, "six", 250., RBF, fourier(30., .7), dict(load=a, **fric(6, r)), ["joint-load-friction"], {"joint-load-friction.ratio": a}, "Coulomb level grows by ratio*|transmitted torque|, all joints")
def o_jela(r):
    k = float(r.uniform(700, 1100))
    return D(r, 500., RBF, drive_prof(20., [(.5, .3), (.04, 1.7), (.008, 3.6)]), dict(Fc=.8, Fv=.8), ["joint-elasticity"], {"joint-elasticity.stiffness[1]": k}, "encoder on the motor side, torque read in the spring: link angle = q - tau/K", ke=k, ce=1.5, Jm=.3, Jl=.6, taufilt=50., taurate=500., enc=2e-6)

def o_grav(r):
    c = J(r, "lwr", 250., RBF, fourier(30., .6), fric(7, r), ["gravity-error"], {}, "link 4 is 8 % heavier and its com 25 mm off the URDF's: first moments wrong", linkcom=(3, [.012, .02, .012], 1.08)); c["class"] = ["payload"]; return c
ONE = dict(normal=[o_exponent, o_viscous, o_hcdamp, o_relax, o_hyst, o_mullins, o_adh, o_layer, o_soff, o_sdrift, o_inh],
           tangential=[o_strib, o_presl, o_load, o_vfric, o_ani, o_round], tool=[o_tmass, o_tcom, o_tip, o_comp],
           sensor=[o_bias, o_drift, o_cross, o_misal, o_gain, o_lag, o_toff, o_sat, o_quant, o_hum],
           joint=[o_jc, o_jv, o_jstr, o_jrip, o_jspr, o_rotor, o_pay, o_jgain, o_joff, o_jasym, o_jload, o_jela, o_grav])
NONE = dict(normal=6, tangential=3, tool=3, sensor=5, joint=5)

# ------------------------------------------------------------------ nothing hidden
def q_l_slide(r):
    f, nm = fr(r, .35, (1, 2, 4)); return A(r, "lwr", 250., "hunt-crossley,coulomb-friction", slides(sl2(r)), mat(r), dict(**hc(r), **f), note="friction "+nm)
def q_s_slide(r):
    f, nm = fr(r, .5, (1, 2, 4)); return A(r, "six", 100., "hunt-crossley,coulomb-friction", slides([(x, s) for x, s in zip((3., 5.), [BF, BF])], force=True), mat(r), dict(**hc(r), **f), note="force-controlled slides, friction "+nm)
def q_l_poke(r): return A(r, "lwr", float(r.choice([500., 1000.])), "hunt-crossley", pokes(P8), mat(r), hc(r), note="pokes")
def q_s_kv(r): return A(r, "six", 200., "kelvin-voigt", pokes(P8[:4]*2), mat(r, 1, k=1500., off=.1), dict(c=10.), note="flat punch, edge radius")
def q_free(r): return F(r, pick(r), 200., poses(10, shake=.03), note="free motion of a heavy tool")
def q_rb(r):
    rb = pick(r); return J(r, rb, 250., RBF, fourier(30., .6), fric(NJ(rb), r), note="joint torques, Prandtl joint friction")
def q_zener(r): 
    q = float(r.uniform(.3, .5)); return T(r, 200., "zener", pokes([(.004, .02, 3., .01), (.003, .005, 2., .02), (.0045, .04, 3., .02)]), mat(r, 1, k=1500., off=.05), dict(r1=q, tau1=float(r.uniform(.5, 1.2))), note="standard solid")
def q_t_slide(r):
    f, nm = fr(r, .4); return T(r, 500., "hunt-crossley,coulomb-friction", slides(sl2(r), pause=0.), mat(r), dict(**hc(r), **f), note="friction "+nm, slides=True)
def q_drive(r): return D(r, 250., RBF, drive_prof(30., [(.8, .13), (.3, .41), (.05, .9)]), dict(Fc=.6, Fv=.9), Jl=1.5, note="drive")
QUIET = [q_l_slide, q_s_slide, q_l_poke, q_s_kv, q_free, q_rb, q_zener, q_t_slide, q_drive]

# ------------------------------------------------------------------ two
def join(c, o, truth, values): c.update(o); c["truth"] = c["truth"]+truth; c["values"] = {**c["values"], **values}; return c
def t_relax_bias(r):
    c = o_relax(r); b = [.5, -.4, .6, .02, .02, -.015]; s = float(r.uniform(.8, 1.2)); b = [x*s for x in b]
    return join(c, dict(sens=dict(bias=b)), ["sensor-bias"], {"sensor-bias."+k: v for k, v in zip(["fx", "fy", "fz", "tx", "ty", "tz"], b)})
def t_vfric_drift(r):
    c = o_vfric(r); b = [1.2, -1., 1.6, .05, .05, .03]
    return join(c, dict(sens=dict(drift=b)), ["sensor-drift"], {"sensor-drift."+k: v for k, v in zip(["fx", "fy", "fz", "tx", "ty", "tz"], b)})
def t_mass_bias(r):
    c = o_tmass(r); b = [.4, .5, -.5, .02, .015, -.02]
    return join(c, dict(sens=dict(bias=b)), ["sensor-bias"], {"sensor-bias."+k: v for k, v in zip(["fx", "fy", "fz", "tx", "ty", "tz"], b)})
def t_layer_relax(r):
    c = o_layer(r); c["path"] = pokes([(.0025, .02, 2.5, .01), (.0045, .02, 3., .01), (.005, .03, 3., .02), (.0055, .01, 3., .01)]); q = float(r.uniform(.3, .5)); c["law"].update(r1=q, tau1=1., r2=0.)
    c["values"].pop("stiffening-layer.K")   # relaxation acts on the sum of both beds
    return join(c, {}, ["relaxation"], {"relaxation.ratio": q, "relaxation.tau": 1.})
def t_jc_rotor(r):
    c = o_rotor(r); c["model"] = "rigid-body,joint-viscous-friction"
    return join(c, {}, ["joint-coulomb-friction"], jv("joint-coulomb-friction.coulomb", c["joint"]["Fc"]))
def t_strib_ripple(r):
    c = o_jstr(r); a = float(r.uniform(.7, 1.)); c["joint"].update(ra=a, rk=20., rp=1.)
    c["qpath"] = drive_moves([(1., .1), (-1., .2), (2., .4), (-2., .8), (3., .8), (-1., .05), (.6, .05), (-.6, .15), (2., .6), (-1.3, .06), (1.4, .3), (-2., 1.)])
    return join(c, {}, ["joint-torque-ripple"], {"joint-torque-ripple.k[1]": 20., "joint-torque-ripple.amplitude[1]": a})
def t_ani_soff(r):
    c = o_ani(r); z = float(r.uniform(.0007, .001)); c["model"] = "hertz,coulomb-friction"; c["law"]["lam"] = .0
    return join(c, dict(z0=z), ["surface-offset"], {"surface-offset.offset": z})
TWO = [t_relax_bias, t_vfric_drift, t_mass_bias, t_layer_relax, t_jc_rotor, t_strib_ripple, t_ani_soff]

# ------------------------------------------------------------------ outside the catalogue
def x_puncture(r):
    c = T(r, 500., "hunt-crossley", pokes([(.0045, .01, .6, .01), (.003, .02, .3, .02), (.005, .005, .6, .01), (.0048, .02, .5, .02)]), mat(r), dict(punD=float(r.uniform(.0032, .0038)), punR=float(r.uniform(.4, .55)), **hc(r)),
          note="a skin bursts at one depth: the force falls by about half within 6 ms and heals once the tip has left"); c["class"] = ["stress-softening"]; return c
def x_backlash(r):
    c = D(r, 500., RBF, drive_prof(24., [(.6, .25), (.08, .8), (.008, 1.9)]), dict(Fc=.8, Fv=.6), note="gear play of 2 x gap between motor and link (half the inertia behind it)", ke=2500., ce=14., gap=float(r.uniform(.007, .012)), Jm=.5, Jl=.8, kp=900., kd=40., taufilt=50., taurate=500.)
    c["class"] = ["joint-elasticity"]; return c
def x_cable(r):
    c = F(r, "lwr", 100., poses(12), note="a hose tied to the frame pulls at the tool tip once it is taut (force along the hose, by distance)", cable=(float(r.uniform(12, 20)), [.25, .3, .35], .42)); c["class"] = ["sensor-bias"]; return c
def x_texture(r):
    f, nm = fr(r, .4, (0, 1, 2)); c = A(r, "six", 250., "hunt-crossley,coulomb-friction", slides(sl2(r)), mat(r), dict(texA=float(r.uniform(.3, .45)), texL=float(r.uniform(.006, .009)), **hc(r), **f), note="ribbed surface: friction coefficient waves with slip1; normal force does not; bristles "+nm)
    c["class"] = []; return c
def x_floor(r):
    c = A(r, "lwr", 250., "hunt-crossley", pokes([(.0045, .012, 3., .012), (.003, .03, 3., .03), (.004, .02, 3., .02)]), mat(r), dict(vibA=float(r.uniform(2e-4, 3.5e-4)), vibF=float(r.uniform(5, 9)), **hc(r)), note="the sample's table shakes at one low frequency"); c["class"] = []; return c
def x_warm(r):
    c = D(r, 100., RBF, drive_prof(150., [(.9, .11), (.35, .37), (.1, .9)]), dict(Fc=3., Fv=2.), note="joint friction falls by about a third to a half as the drive warms by its own motion (time constant 40 s)", warm=[float(r.uniform(.5, .65)), 40., 1.2], dec=25); c["class"] = []; return c
OUTSIDE = [x_puncture, x_backlash, x_cable, x_texture, x_floor, x_warm]

# ------------------------------------------------------------------ not excited
def n_strib(r):
    c = A(r, pick(r), 250., "hunt-crossley,coulomb-friction", pokes(P8), mat(r), dict(mu=.4, dmu=.2, vs=.02, kind=1, **hc(r)), ["stribeck-friction"], {"stribeck-friction.dmu": .2, "stribeck-friction.v_s": .02}, "Stribeck friction is there, pokes only: no sliding but the slow creep of the arm (v << v_s)", enc=2e-6); return c
def n_layer(r):
    return T(r, 200., "hunt-crossley", pokes([(.002, .01, .4, .01), (.003, .02, .4, .02), (.0028, .005, .4, .01)]), mat(r), dict(layK=5000., layD=.006, layW=8e-5, **hc(r)), ["stiffening-layer"], {"stiffening-layer.depth": .006}, "hard layer at 6 mm, pokes to 3 mm")
def n_ani(r):
    f, nm = fr(r, .4, (0, 1, 2)); a = .3; f["ani"] = a
    return A(r, "six", 200., "hunt-crossley,coulomb-friction", slides([(.004, [(.03, 0, .02), (0, 0, .03)]*2), (.003, [(.03, 0, .04), (0, 0, .02)])]), mat(r), dict(**hc(r), **f), ["friction-anisotropy"], {"friction-anisotropy.a": a}, "anisotropy, but slides along tangent 1 only; bristles "+nm)
def n_sat(r):
    return T(r, 250., "kelvin-voigt", pokes(P8[:4]), mat(r, 1, k=1300., off=.05), dict(c=8.), ["saturation"], {"saturation.limit": 25.}, "cell clips at 25 N, the log stays below 8 N", sens=dict(sat=25.))
NOT = [n_strib, n_layer, n_ani, n_sat]

def plan(seed):
    rng = np.random.default_rng([seed, 7]); L = []
    for k, m in NONE.items():
        for i in rng.permutation(len(ONE[k]))[:m]: L.append(("one", ONE[k][i]))
    L += [("quiet", f) for f in QUIET]+[("two", f) for f in TWO]+[("outside", f) for f in OUTSIDE]+[("not-excited", f) for f in NOT]
    order = rng.permutation(len(L))
    return [L[i] for i in order]
def allcases(): return [("one", f) for k in ONE for f in ONE[k]]+[("quiet", f) for f in QUIET]+[("two", f) for f in TWO]+[("outside", f) for f in OUTSIDE]+[("not-excited", f) for f in NOT]
