"""The 48 cases of the lapwing world. spec(i, rng) -> dict; the order in the folder numbers is shuffled by the seed."""
import numpy as np
import engine as E
from engine import material
from world import Prog, friction_kind, build_arm, build_free, build_joint, build_drive, build_tester

KV, HZ, HC = "kelvin-voigt", "hertz", "hunt-crossley"
CF = "coulomb-friction"

# ---- programmes -------------------------------------------------------------------------------------------------
def pokes(rng, n, dmax, fast=(0.15, 0.8), hold=(0.3, 1.0), spread=0.004, dmin=0.4, tilt=0.0, free=0.8):
    p = Prog(-0.003).hold(free, "free")
    for _ in range(n):
        d, T = dmax * rng.uniform(dmin, 1), np.exp(rng.uniform(*np.log(fast)))
        a = dict(a1=rng.uniform(-tilt, tilt), a2=rng.uniform(-tilt, tilt)) if tilt else {}
        p.to(0.5, "free", s1=rng.uniform(-spread, spread), s2=rng.uniform(-spread, spread), d=-0.002, **a)
        p.to(T, "approach", d=d).hold(rng.uniform(*hold), "hold").to(np.exp(rng.uniform(*np.log(fast))), "retract", d=-0.003)
    return p.hold(free, "free")

def slides(rng, n, depths, L=0.03, T=(0.5, 2.0), dirs="both", free=0.8, rest=0.25, ripple=0.0):
    p = Prog(-0.003).hold(free, "free")
    for dd in depths:
        p.to(0.4, "approach", d=dd).hold(0.4, "hold")
        x, y = 0.0, 0.0
        for k in range(n):
            Tk = np.exp(rng.uniform(*np.log(T)))
            if dirs == "line":
                x, y = (L if k % 2 == 0 else -L) * rng.uniform(0.6, 1), 0.0
            else:
                th = rng.uniform(0, 2 * np.pi) if dirs == "both" else (k % 4) * np.pi / 2 + rng.uniform(-0.2, 0.2)
                x, y = L * np.cos(th), L * np.sin(th)
            p.to(Tk, "slide", s1=x, s2=y, d=dd * (1 + rng.uniform(-ripple, ripple)))
            if rest:
                p.hold(rest * rng.uniform(0.5, 1.5), "rest")
        p.to(0.5, "retract", d=-0.003).to(0.6, "free", s1=0, s2=0).hold(free, "free")
    return p

def add(p, q):
    p.seg += q.seg
    p.x = q.x
    return p

# ---- materials --------------------------------------------------------------------------------------------------
def mat(rng, law="kv", mu=None, k=None, exclude=(), **kw):
    """A base material; small departures: exponent off by 0.01, a weak second relaxation."""
    k1 = k if k else np.exp(rng.uniform(np.log(800), np.log(2500)))
    c = dict(N_=1.0, K=k1, C=k1 * rng.uniform(0.001, 0.004))
    if law == "hertz":
        n = 1.5 + rng.uniform(-0.008, 0.008)
        c = dict(N_=n, K=k1 * 0.004 ** (1 - n) * 1.2, C=0.0)
    if law == "hc":
        n = rng.uniform(1.25, 1.6)
        c = dict(N_=n, K=k1 * 0.004 ** (1 - n) * 1.2, LAM=rng.uniform(0.8, 2))
    if law == "hooke":
        c = dict(N_=1.0, K=k1)
    c.update(MU=rng.uniform(0.25, 0.5) if mu is None else mu)
    if law in ("kv", "hertz") and rng.random() < 0.5:
        c.update(R1=rng.uniform(0.004, 0.012), T1=rng.uniform(0.1, 1.0))
    c.update(kw)
    P = material(**c)
    if P[E.MU] > 0 and "BK" not in kw:
        friction_kind(rng, P, exclude)
    return P

def noise_q(**kw):
    return dict(nu=kw)

def T_of(p):
    return float(sum(a[0] for a in p.seg))

def A(rng, robot, P, prog, fs=500, **kw):
    return dict(build=build_arm, robot=robot, mat=P, prog=prog, fs=fs, T_hint=T_of(prog), T=T_of(prog), **kw)

def Tt(rng, P, prog, fs=500, **kw):
    return dict(build=build_tester, mat=P, prog=prog, fs=fs, T=T_of(prog), **kw)

# ---- joint motions and loads ------------------------------------------------------------------------------------
LWR_FC = np.array([0.7, 0.7, 0.5, 0.5, 0.4, 0.25, 0.25])
LWR_FV = np.array([0.8, 0.9, 0.5, 0.6, 0.3, 0.2, 0.15])

def fric(rng, n, fc=1.0, fv=1.0):
    d = dict(jz=float(np.exp(rng.uniform(np.log(1e-4), np.log(4e-4)))), jkind=0)
    d["Fc"] = fc * LWR_FC[:n] * rng.uniform(0.6, 1.4, n)
    d["Fv"] = fv * LWR_FV[:n] * rng.uniform(0.6, 1.4, n)
    return d

def turns(amp, f0, nh=3):
    def m(rng, t):
        from world import multisine
        return multisine(rng, t, 1, [amp], f0, nh)
    return m

def trapezoids(speeds, T):
    """Runs at set speeds, there and back."""
    def m(rng, t):
        v = np.zeros(len(t)); h = t[1] - t[0]
        n = len(speeds) * 2
        for k in range(n):
            s = speeds[k // 2] * (1 if k % 2 == 0 else -1)
            u = (t - k * T / n) / (T / n)
            m_ = (u >= 0) & (u < 1)
            v[m_] = s * np.clip(np.minimum(u[m_], 1 - u[m_]) * 6, 0, 1)
        from scipy.ndimage import gaussian_filter1d
        return np.cumsum(gaussian_filter1d(v, 0.03 / h)) * h
    return m

def hose(rng, t, x):
    """A hose in a clip on the frame: it pulls the tool until the clip lets a length through, at uneven loads."""
    k, F, lim, s = 160.0, np.zeros((len(t), 3)), rng.uniform(0.8, 2.5), x[0].copy()
    for i in range(len(t)):
        d = x[i] - s                                     # the hose's sleeve sticks to the frame beside the tool
        f = k * d
        n = np.linalg.norm(f)
        if n > lim:
            s = x[i] - d * rng.uniform(-0.3, 0.4); lim = rng.uniform(0.6, 2.5)
        F[i] = -f
    return F

def heart(rng, t):
    """Irregular pulses of the bed under the sample [m]."""
    z, b = np.zeros(len(t)), 0.3
    while b < t[-1]:
        w, a = rng.uniform(0.05, 0.09), rng.uniform(0.7, 1.3)
        z += 0.0011 * a * (np.exp(-0.5 * ((t - b) / w) ** 2) - 0.35 * np.exp(-0.5 * ((t - b - 0.27) / (1.5 * w)) ** 2))
        b += rng.uniform(0.55, 1.25)
    return z

def dragging(level):
    def m(rng, t):
        b = np.zeros((len(t), 1)); x = rng.uniform(0.5, 2)
        while x < t[-1]:
            L = rng.uniform(0.3, 2.0)
            u = np.clip(np.minimum(t - x, x + L - t) / 0.05, 0, 1)
            b[:, 0] += level * rng.uniform(0.4, 1.3) * u
            x += L + rng.uniform(0.4, 2.5)
        return b
    return m

# ---- the table --------------------------------------------------------------------------------------------------
def one(rng):
    """22 builders: (model, truth, make(rng) -> spec with 'values')."""
    L = []

    def relaxation(r):
        P = mat(r, "kv", 0, k=6000, R1=0.35, T1=r.uniform(0.3, 0.6), R2=0.2, T2=r.uniform(2.5, 5))
        p = pokes(r, 6, 0.004, fast=(0.1, 2.0), hold=(1, 6), spread=0)
        return Tt(r, P, p, 200, values={}, notes="two relaxation times")
    L.append((f"{KV}", ["relaxation"], relaxation))

    def hcd(r):
        lam = r.uniform(3.0, 4.5)
        P = mat(r, "hertz", mu=r.uniform(0.04, 0.1), exclude=("rounded",), LAM=lam, R1=0)
        return A(r, "lwr", P, pokes(r, 12, 0.006, fast=(0.06, 0.6), hold=(0.1, 0.3)), 1000, soft=3.0, nu=dict(lp=400.0, clock=0.0), values={"hunt-crossley-damping.damping": lam})
    L.append((f"{HZ},{CF}", ["hunt-crossley-damping"], hcd))

    def layer(r):
        b = r.uniform(0.0022, 0.0028)
        P = mat(r, "kv", mu=r.uniform(0.04, 0.1), exclude=("rounded",), LK=2200, LD=b, LW=1e-4, K=1100)
        return A(r, "lwr", P, pokes(r, 8, 0.006), 500, values={"stiffening-layer.stiffness": 2200, "stiffening-layer.depth": b})
    L.append((f"{KV},{CF}", ["stiffening-layer"], layer))

    def soften(r):
        P = mat(r, "kv", 0, k=9000, SR=0.3, SL=0.0012)
        p = Prog(-0.001).hold(0.5, "free")
        for d in (0.0015, 0.0015, 0.003, 0.002, 0.003, 0.0045, 0.003, 0.0045, 0.0045):
            p.to(r.uniform(0.6, 1.2), "approach", d=d).to(r.uniform(0.6, 1.2), "retract", d=-0.001)
        return Tt(r, P, p, 200, rate=True, values={})
    L.append((KV, ["stress-softening"], soften))

    def inhomo(r):
        P = mat(r, "kv", IK=3, IA=0.8, IX=r.uniform(-0.008, 0.008), IY=r.uniform(-0.006, 0.006), IW=0.014)
        return A(r, "lwr", P, slides(r, 8, (0.003, 0.004), L=0.028), 250, values={})
    L.append((f"{KV},{CF}", ["stiffness-inhomogeneity"], inhomo))

    def adhesion(r):
        P = mat(r, "kv", 0, k=2500, FA=2.2, AL=6e-4)
        return Tt(r, P, pokes(r, 7, 0.003, fast=(0.8, 2.5), spread=0, dmin=0.3), 250, values={"adhesion.force": 2.2}, notes="tail exp(depth/length)")
    L.append((KV, ["adhesion"], adhesion))

    def exponent(r):
        n = r.uniform(1.7, 1.9)
        P = mat(r, "hooke", mu=r.uniform(0.04, 0.1), exclude=("rounded",), N_=n, K=1300 * 0.004 ** (1 - n) * 1.3)
        return A(r, "panda", P, pokes(r, 9, 0.0055, dmin=0.25), 500, values={"hertz-exponent.exponent": n})
    L.append((f"hooke,{CF}", ["hertz-exponent"], exponent))

    def coulomb(r):
        mu = r.uniform(0.35, 0.6)
        P = mat(r, "kv", mu, exclude=("rounded", "stick-slip"))
        return A(r, "lwr", P, slides(r, 10, (0.002, 0.004), rest=0.1), 200, values={"coulomb-friction.coefficient": mu})
    L.append((KV, [CF], coulomb))

    def stribeck(r):
        P = mat(r, "hooke", 0.3, k=5000, DM=0.28, VS=0.012, BK=0, ZL=1e-4)
        p = Prog(-0.0005).hold(0.3, "free").to(0.5, "approach", d=0.003)
        for v in (0.002, 0.05, 0.006, 0.1, 0.012, 0.025, 0.004, 0.07):
            T = min(0.04 / v, 3.0)
            p.to(T, "slide", s1=v * T / 1.2).hold(0.2, "rest").to(T, "slide", s1=0).hold(0.2, "rest")
        p.to(0.5, "retract", d=-0.0005)
        return Tt(r, P, p, 500, slip=True, depth_noise=2e-7, values={"stribeck-friction.coefficient": 0.28, "stribeck-friction.speed": 0.012})
    L.append((f"hooke,{CF}", ["stribeck-friction"], stribeck))

    def viscous(r):
        P = mat(r, "kv", 0.2, CT=22.0)
        return A(r, "ur5", P, slides(r, 8, (0.0025, 0.004), L=0.035, T=(0.35, 2)), 500, values={"viscous-friction.damping": 22.0})
    L.append((f"{KV},{CF}", ["viscous-friction"], viscous))

    def aniso(r):
        a = r.uniform(0.3, 0.4)
        P = mat(r, "kv", 0.5, AN=a)
        return A(r, "lwr", P, slides(r, 10, (0.003, 0.004), dirs="cross", rest=0), 250, values={"friction-anisotropy.ratio": a})
    L.append((f"{KV},{CF}", ["friction-anisotropy"], aniso))

    def com(r):
        d = np.array([0.022, -0.015, 0.012]) * r.uniform(0.8, 1.2)
        return dict(build=build_free, robot="lwr4plus", T=40, fs=250, dcom=d, amp=1.1, values={f"tool-com.com[{a}]": x for a, x in zip("xyz", d)},
                    notes="forces unaffected: sizes are those of the torque channels")
    L.append(("none", ["tool-com"], com))

    def compliance(r):
        P = mat(r, "hertz", mu=r.uniform(0.04, 0.1), exclude=("rounded",), k=9000, COMP=1.1e-4, R1=0)
        return A(r, "lwr", P, pokes(r, 9, 0.0035, dmin=0.2), 500, soft=4.0, values={"structural-compliance.compliance": 1.1e-4}, nu=dict(enc=2e-6))
    L.append((f"{HZ},{CF}", ["structural-compliance"], compliance))

    def tipoff(r):
        o = np.array([0.0025, -0.002, 0.0005])
        P = mat(r, "kv", mu=r.uniform(0.04, 0.1), exclude=("rounded",), )
        return A(r, "lwr", P, pokes(r, 12, 0.004, tilt=0.25, spread=0.003), 250, tip_offset=o,
                 values={f"tip-offset.offset[{a}]": x for a, x in zip("xyz", o)}, notes="offset = true tip minus the rig's, in tool_tip axes")
    L.append((f"{KV},{CF}", ["tip-offset"], tipoff))

    def drift(r):
        d = np.array([0.2, -0.14, 0.36, 0.004, 0.005, -0.002]) * r.uniform(0.9, 1.3)
        P = mat(r, "kv")
        p = slides(r, 6, (0.003, 0.004, 0.003), T=(2, 5), free=3)
        p = add(p, add(pokes(r, 12, 0.004, fast=(0.6, 2), hold=(1, 3), free=2), slides(r, 6, (0.004, 0.003), T=(2, 5), free=3)))
        return A(r, "lwr", P, p, 50, fx=dict(drift=d), values={f"sensor-drift.drift[{c}]": x for c, x in zip(("fx", "fy", "fz", "tx", "ty", "tz"), d)})
    L.append((f"{KV},{CF}", ["sensor-drift"], drift))

    def crosstalk(r):
        X = np.zeros((6, 6)); X[0, 2], X[1, 2], X[2, 1] = 0.18, -0.13, 0.1
        P = mat(r, "kv", mu=0.12, exclude=("rounded",))
        p = add(pokes(r, 5, 0.005), slides(r, 6, (0.003,), rest=0))
        return A(r, "lwr", P, p, 500, fx=dict(xt=X), values={"sensor-crosstalk.crosstalk[fx,fz]": 0.18, "sensor-crosstalk.crosstalk[fy,fz]": -0.13, "sensor-crosstalk.crosstalk[fz,fy]": 0.1})
    L.append((f"{KV},{CF}", ["sensor-crosstalk"], crosstalk))

    def delay(r):
        P = mat(r, "kv", mu=0.1, exclude=("rounded",))
        return A(r, "ur5", P, add(pokes(r, 10, 0.005, fast=(0.08, 0.4), hold=(0.05, 0.3)), slides(r, 8, (0.003,), T=(0.3, 0.9), rest=0)), 500, soft=2.5, fx=dict(delay=0.035),
                 values={}, notes="wrench logged 35 ms late")
    L.append((f"{KV},{CF}", ["time-offset"], delay))

    def saturation(r):
        lim = np.array([1e9, 1e9, 7.0, 1e9, 1e9, 1e9])
        P = mat(r, "kv", mu=0.12, k=2200)
        return A(r, "lwr", P, add(pokes(r, 9, 0.006), slides(r, 6, (0.003, 0.005), rest=0)), 500, fx=dict(limit=lim), values={"saturation.limit[fz]": 7.0})
    L.append((f"{KV},{CF}", ["saturation"], saturation))

    def jviscous(r):
        o = fric(r, 7, fv=0.0)
        o["Fv"] = np.array([6, 6, 4, 4, 2.5, 1.5, 1.2]) * r.uniform(0.7, 1.2, 7)
        return dict(build=build_joint, robot="lwr", T=30, fs=500, joint=o, f0=0.12, values={f"joint-viscous-friction.viscous[j{i+1}]": x for i, x in enumerate(o["Fv"])})
    L.append(("rigid-body,joint-coulomb-friction", ["joint-viscous-friction"], jviscous))

    def payload(r):
        m, c = r.uniform(0.6, 0.9), np.array([0.02, 0.01, 0.08])
        return dict(build=build_joint, robot="ur5", T=40, fs=125, joint=fric(r, 6), payload=(m, c), f0=0.1, values={"payload.mass": m})
    L.append(("rigid-body,joint-coulomb-friction,joint-viscous-friction", ["payload"], payload))

    def ripple(r):
        o = dict(Fc=[0.25], Fv=[0.05], ro=[8.0], rs=[0.1], rc=[0.06], rs2=[0.03], rc2=[0.0], jz=3e-4)
        return dict(build=build_drive, J=0.05, T=30, fs=1000, motion=turns(6.0, 0.05), joint=o, enc=5e-5, nu=dict(tau_lp=150.0), values={"joint-torque-ripple.order[j1]": 8.0})
    L.append(("rigid-body,joint-coulomb-friction,joint-viscous-friction", ["joint-torque-ripple"], ripple))

    def spring(r):
        o = fric(r, 7)
        o["sk"], o["sq"] = np.array([0, 9.0, 0, 4.0, 0, 0, 0]), np.array([0, -3.0, 0, 2.0, 0, 0, 0])
        return dict(build=build_joint, robot="lwr", T=60, fs=250, joint=o, f0=0.07, amp=1.2,
                    values={"joint-spring.rate[j2]": 9.0, "joint-spring.rate[j4]": 4.0}, notes="torque needed = rate q + preload, joints 2 and 4")
    L.append(("rigid-body,joint-coulomb-friction,joint-viscous-friction", ["joint-spring"], spring))
    return L

def two(rng):
    L = []

    def a(r):
        p_ = r.uniform(-0.4, -0.33)
        b = np.array([0.9, -0.7, 1.1, 0.02, -0.015, 0.01])
        P = mat(r, "kv", 0.5, LP=p_, N0=5.0, exclude=("rounded",))
        return A(r, "lwr", P, slides(r, 7, (0.001, 0.0025, 0.005, 0.007), rest=0), 250, fx=dict(bias=b),
                 values=dict({"load-dependent-friction.exponent": p_}, **{f"sensor-bias.offset[{c}]": x for c, x in zip(("fx", "fy", "fz", "tx", "ty", "tz"), b)}))
    L.append((f"{KV},{CF}", ["load-dependent-friction", "sensor-bias"], a))

    def b(r):
        P = mat(r, "hooke", 0.6, k=1500, C=14.0, BK=0, ZL=8e-4)
        p = Prog(-0.003).hold(0.6, "free")
        for d in (0.003, 0.0045):
            p.to(0.5, "approach", d=d)
            for k in range(10):
                p.to(r.uniform(0.25, 0.6), "slide", s1=r.uniform(-0.004, 0.004), s2=r.uniform(-0.004, 0.004))
            for f in (2.0, 4.0, 5.5):
                p.sine(2.5, "poke", [("d", 0.0022, f)])
            p.to(0.4, "retract", d=-0.003)
        return A(r, "lwr", P, p.hold(0.5, "free"), 1000, soft=3.0, values={"presliding.length": 8e-4, "viscous-damping.damping": 14.0}, notes="Dahl bristle")
    L.append((f"hooke,{CF}", ["presliding", "viscous-damping"], b))

    def c(r):
        return dict(build=build_free, robot="lwr", T=25, fs=500, mass=0.6, dmass=0.12, f0=0.35, amp=0.55, nh=6, fx=dict(lag=0.03), values={"tool-mass.mass": 0.12, "sensor-lag.time-constant": 0.03})
    L.append(("none", ["tool-mass", "sensor-lag"], c))

    def d(r):
        o = fric(r, 7)
        o["Fc"] = np.array([3.5, 3.5, 2.5, 2.5, 1.5, 1, 1]) * r.uniform(0.8, 1.2, 7)
        off = np.array([2.5, -3, 1.8, 2, -1, 0.8, 0.6]) * r.uniform(0.8, 1.2, 7)
        v = {f"joint-coulomb-friction.coulomb[j{i+1}]": x for i, x in enumerate(o["Fc"])}
        v.update({f"joint-torque-offset.offset[j{i+1}]": x for i, x in enumerate(off)})
        return dict(build=build_joint, robot="panda", T=30, fs=500, joint=o, tau_offset=off, f0=0.08, values=v, nu=dict(enc=5e-6, tau_lp=50.0))
    L.append(("rigid-body,joint-viscous-friction", ["joint-coulomb-friction", "joint-torque-offset"], d))

    def e(r):
        o = dict(Fc=[0.3], Fv=[0.05], Ex=[0.35], Vs=[0.5], Ad=[0.14], jz=2e-4)
        sp = [0.1, 3.0, 0.25, 1.5, 0.5, 5.0, 0.8, 0.15]
        return dict(build=build_drive, J=0.08, T=48, fs=500, motion=trapezoids(sp, 48), joint=o, enc=2e-5,
                    values={"joint-stribeck-friction.excess[j1]": 0.35, "joint-stribeck-friction.speed[j1]": 0.5}, notes="asymmetry dry: 0.14 N·m more one way, as much less the other")
    L.append(("rigid-body,joint-coulomb-friction,joint-viscous-friction", ["joint-stribeck-friction", "joint-friction-asymmetry"], e))

    def f(r):
        al = 0.22
        P = mat(r, "kv", 0, k=4000, HA=3.0, HL=4e-4, DR=al / 60)
        p = pokes(r, 40, 0.003, fast=(0.3, 2.0), hold=(0.2, 0.6), spread=0, dmin=0.3)
        return Tt(r, P, p, 100, values={"stiffness-drift.rate": al}, notes="Iwan elements (parallel sliders) as the loop")
    L.append((KV, ["hysteresis", "stiffness-drift"], f))

    def g(r):
        P = mat(r, "kv", mu=0.2, R1=0.7, T1=0.5)
        return A(r, "lwr", P, add(pokes(r, 7, 0.005, fast=(0.1, 1.0), hold=(0.8, 2.0), tilt=0.1), slides(r, 6, (0.004,), rest=0)), 500, fx=dict(rot=np.array([0.18, -0.15, 0.08])),
                 values={"relaxation.time-constant": 0.5, "relaxation.ratio": 0.7}, notes="sensor turned by the vector (0.18, -0.15, 0.08) rad; ratio = branch over equilibrium stiffness")
    L.append((f"{KV},{CF}", ["sensor-misalignment", "relaxation"], g))
    return L

def quiet(rng):
    L = []
    L.append((f"{KV},{CF}", [], lambda r: A(r, "lwr", mat(r, "kv", mu=0.1, k=1600, exclude=("rounded",)), add(pokes(r, 5, 0.005), slides(r, 8, (0.003, 0.004), L=0.04, rest=0)), 1000, values={})))
    L.append((f"{HZ},{CF}", [], lambda r: A(r, "ur5", mat(r, "hertz", mu=0.1, exclude=("rounded",)), add(pokes(r, 6, 0.005), slides(r, 8, (0.004,), L=0.04, rest=0)), 500, values={})))
    L.append((f"{HC},{CF}", [], lambda r: A(r, "lwr", mat(r, "hc", mu=0.05, exclude=("rounded",)), pokes(r, 14, 0.006, fast=(0.08, 0.6)), 500, soft=2.5, values={})))
    L.append(("zener", [], lambda r: Tt(r, mat(r, "hooke", 0, k=7000, R1=0.5, T1=0.7), pokes(r, 8, 0.004, fast=(0.1, 2), hold=(0.5, 3), spread=0), 500, values={})))
    L.append((KV, [], lambda r: Tt(r, mat(r, "kv", 0, k=3000), Prog(0.003).hold(0.3, "hold").sine(8, "poke", [("d", 0.002, 1.0)]).sine(6, "poke", [("d", 0.0015, 4.0)]).sine(6, "poke", [("d", 0.001, 9.0)]), 2000, rate=True, values={})))
    L.append(("none", [], lambda r: dict(build=build_free, robot="lwr4plus", T=60, fs=100, values={}, nu=dict(csv=True))))
    L.append(("rigid-body,joint-coulomb-friction,joint-viscous-friction", [], lambda r: dict(build=build_joint, robot="lwr", T=40, fs=500, joint=fric(r, 7), values={})))
    L.append(("rigid-body,joint-coulomb-friction,joint-viscous-friction", [], lambda r: dict(build=build_joint, robot="panda", T=25, fs=1000, joint=fric(r, 7), f0=0.08, values={})))
    L.append(("rigid-body,joint-coulomb-friction,joint-viscous-friction", [], lambda r: dict(build=build_drive, J=0.1, T=20, fs=1000, motion=turns(9.0, 0.1, 4), joint=dict(Fc=[0.15], Fv=[0.12], jz=4e-4), enc=3e-4, values={}, nu=dict(dq=True, dq_noise=3e-4, dq_bias=1e-4, tau_lp=50.0))))
    return L

def outside(rng):
    L = []
    L.append((f"{KV},{CF}", [], lambda r: A(r, "lwr", mat(r, "kv", 0.35), slides(r, 8, (0.003, 0.004), L=0.04), 250, extra_force=hose, values={}, cls=["sensor-bias"],
              notes="a hose pulls on the tool and its clip lets go at uneven loads, in contact and in the air")))
    L.append((f"{KV},{CF}", [], lambda r: A(r, "lwr", mat(r, "kv", k=1500), add(pokes(r, 5, 0.005, hold=(2, 4)), slides(r, 6, (0.004,))), 500, zs=heart, values={}, cls=[],
              notes="the bed under the sample beats, irregularly")))
    L.append((f"{KV},{CF}", [], lambda r: A(r, "lwr", mat(r, "kv", 0.3, LIFT=5.0, LV0=0.03), slides(r, 12, (0.003, 0.005), L=0.035, T=(0.4, 3.0), rest=0.6), 250, values={}, cls=[],
              notes="a film lifts the tip when it slides: normal force that depends on the slip speed")))
    L.append(("rigid-body,joint-coulomb-friction,joint-viscous-friction", [], lambda r: dict(build=build_joint, robot="lwr", T=40, fs=250, joint=dict(fric(r, 7), slosh=np.array([1.2, 1.2 * (2 * np.pi * 1.0) ** 2, 0.4])), f0=0.16, amp=0.8, nh=6,
              values={}, cls=["payload"], notes="a vessel with 1.2 kg of sloshing liquid hangs at the flange (1.0 Hz, lightly damped)")))
    L.append(("rigid-body,joint-coulomb-friction,joint-viscous-friction", [], lambda r: dict(build=build_drive, J=0.1, T=40, fs=500, motion=turns(6.0, 0.1, 4), joint=dict(Fc=[0.3], Fv=[0.1], jz=4e-4, brake=dragging(0.5)), enc=2e-5,
              values={}, cls=[], notes="a brake drags now and then")))
    L.append((KV, [], lambda r: Tt(r, mat(r, "kv", 0, k=4000), pokes(r, 12, 0.004, fast=(0.03, 0.15), hold=(0.6, 1.5), spread=0), 500, floor=[3.0, 9000.0, 4.0], values={}, cls=["structural-compliance"],
              notes="the sample stands on a plate that rings (3 kg, about 10 Hz under load)")))
    return L

def not_excited(rng):
    L = []
    L.append((f"{KV},{CF}", ["stiffening-layer"], lambda r: A(r, "lwr", mat(r, "kv", mu=0.05, exclude=("rounded",), k=1200, LK=4000, LD=0.009), pokes(r, 8, 0.0045), 500, values={}, notes="a layer at 9 mm that no poke reaches")))
    L.append((f"{KV},{CF}", ["friction-anisotropy"], lambda r: A(r, "lwr", mat(r, "kv", 0.4), slides(r, 10, (0.003, 0.004), dirs="line"), 250, values={}, notes="slides along the first tangent only")))
    L.append(("none", ["tool-inertia"], lambda r: dict(build=build_free, robot="lwr", T=120, fs=20, f0=0.015, nh=3, values={}, I6=[0.0004, 0.0004, 0.0003, 0, 0, 0], notes="slow turning in the air")))
    L.append(("rigid-body,joint-coulomb-friction,joint-viscous-friction", ["rotor-inertia"], lambda r: dict(build=build_joint, robot="ur5", T=150, fs=100, joint=fric(r, 6), f0=0.007, nh=3, values={}, notes="slow motion, accelerations below 0.1 rad/s²; rotors not in the data")))
    return L

def table(seed):
    rng = np.random.default_rng([seed, 7])
    rows = []
    for group, f in (("one", one), ("two", two), ("quiet", quiet), ("outside", outside), ("not-excited", not_excited)):
        for k, (model, truth, make) in enumerate(f(rng)):
            rows.append((group, k, model.split(","), truth, make))
    order = rng.permutation(len(rows))
    out = []
    for j, i in enumerate(order):
        out.append((f"lapwing_{j+1:02d}",) + rows[i] + (lambda a, i=int(i): np.random.default_rng([seed, 100 + i, a]),))
    return out
