"""Cases of the kinds joints (an arm moves freely in MuJoCo, torques logged) and drive (one axis, own integrator)."""
import numpy as np
from numba import njit
from scipy.interpolate import CubicSpline
from scipy.signal import butter, filtfilt
import jointfit as J
from jointfit import JData, LIN
from motion import ramp, H
from plant import JP, joint_friction
from robots import ROBOTS, rotvec
from sensing import noise, stamps, at, lp1, read_joints
from wrench import arm_of

OUTSIDE = {"joints": ["warming-up", "pushes", "coupled-gears"], "drive": ["fan-drag", "worn-places", "warming-up"]}


def path(rng, N, amp, speeds, seconds, slow):
    """Joint path on the grid H: smooth sines, then sweeps at several speeds, all joints at once, few rests."""
    u = rng.uniform
    n = int(seconds * .45 / H)
    t = np.arange(n) * H
    env = np.clip(np.minimum(t, t[-1] - t) / 1.5, 0, 1)
    env = env * env * (3 - 2 * env)
    X = np.zeros((n, N))
    for j in range(N):
        for f, a in ((u(.05, .15), .6), (u(.2, .4), .3), (u(.5, .9) * (0.5 if slow else 1), .1)):
            X[:, j] += a * np.sin(2 * np.pi * f * t + u(0, 6.28))
        X[:, j] *= env * amp[j]
    parts, ph = [X], ["sines"] * n
    at_ = X[-1]
    left = seconds * .5
    i = 0
    while left > 0:
        step = rng.uniform(.5, 1.2, N) * amp * rng.choice([-1, 1], N)      # every joint moves, none creeps
        goal = np.clip(np.where(np.abs(at_ + step) <= amp, at_ + step, at_ - step), -amp, amp)
        v = speeds[i % len(speeds)]
        T = max(np.max(np.abs(goal - at_) / amp) / v, .4)
        if T > left + 3:
            goal = at_ + (goal - at_) * (left + 1) / T
            T = left + 1
        ta = min(.35, .45 * T)
        k = max(int((T + ta) / H), 4)
        parts.append(at_ + (goal - at_) * ramp(k + 1, ta / (T + ta))[1:, None])
        ph += ["sweep"] * k
        at_ = goal
        left -= T + ta
        if i % 4 == 3:
            r = int(.3 / H)
            parts.append(np.repeat(at_[None], r, 0))
            ph += ["rest"] * r
        i += 1
    return np.concatenate(parts), np.array(ph)


class Base:
    unit, main = "N·m", "force"

    def draw_common(self, rng, coarse):
        u = rng.uniform
        pick = lambda p: rng.random() < p
        self.nu = dict(level=1.0, tau_lp=float(np.exp(u(np.log(5), np.log(50)))) if pick(.4) else None, zero_phase=bool(pick(.6)),
                       clock=float(u(-3e-4, 3e-4)) if pick(.5) else 0.0, jitter=float(u(.01, .1)) if pick(.4) else 0.0,
                       drop=float(u(.001, .01)) if pick(.3) else 0.0, colour=float(u(.2, .5)) if pick(.4) else 0.0, colour_f=float(u(.5, 5)),
                       encoder=float(np.exp(u(np.log(1e-4), np.log(1e-3)) if pick(coarse) else u(np.log(2e-6), np.log(5e-5)))), dq=not pick(.25), dq_noise=float(np.exp(u(np.log(2e-4), np.log(5e-3)))),
                       dq_bias=float(u(-2e-4, 2e-4)) if pick(.5) else 0.0, dq_lag=float(u(0, 5e-3)) if pick(.5) else 0.0,
                       dq_lp=float(u(15, 100)) if pick(.5) else None, tau_rate=float(rng.choice([.2, .5, .8])) if pick(.3) else None, hold=bool(pick(.4)),
                       ell=float(np.exp(u(np.log(2e-4), np.log(1.2e-3)))), vlag=float(u(0, .004)))
        self.with_phase = pick(.4)

    def relax(self, only=False):
        n = self.nu
        n["level"] *= .5
        if n["tau_lp"]:
            n["tau_lp"] *= 1.7
            n["zero_phase"] = n["zero_phase"] or n["level"] < .2
            if n["tau_lp"] > 60 and n["level"] < .1:
                n["tau_lp"] = None
        n["encoder"] = max(n["encoder"] * .5, 2e-6)
        n["clock"] *= .5
        n["ell"] = max(n["ell"] * .7, 1.5e-4)
        n["tau_rate"] = None
        if "tool_err" in n:
            n["tool_err"] = [x * .5 for x in n["tool_err"]]
            n["tilt"] = [x * .5 for x in n["tilt"]]
        self.cache.clear()

    def jp(self, amps, par):
        """Friction table with the model's own and the hidden effects."""
        N = self.N
        jp = np.zeros((N, len(JP)))
        jp[:, JP["ell"]] = self.nu["ell"] * self.ell_scale
        jp[:, JP["vs"]] = self.sh["vs"]
        jp[:, JP["warm_t"]] = 1.0
        self.gain = np.zeros(N)
        self.offset = np.zeros(N)
        self.rotor = np.zeros(N)
        self.compl = np.zeros(N)
        for e in self.model + self.hidden:
            a = amps[e] if e in self.hidden else self.model_amp.get(e, 1.0)
            js = self.acts[e] if e in self.hidden else list(range(N))
            s = self.scale * self.sh["w"].get(e, np.ones(N))
            v = np.zeros(N)
            v[js] = 1.0
            top = self.top_speed
            p = {}
            if e == "joint-coulomb-friction":
                jp[:, JP["fc"]] = p["fc"] = .02 * a * s * v
            elif e == "joint-viscous-friction":
                jp[:, JP["fv"]] = p["fv"] = .02 * a * s * v / top
            elif e == "joint-friction-asymmetry":
                jp[:, JP["asym"]] = p["asymmetry"] = .15 * a * v * self.sh["sg"]
            elif e == "joint-torque-offset":
                self.offset = p["offset"] = .01 * a * s * v * self.sh["sg"]
            elif e == "rotor-inertia":
                self.rotor = p["inertia"] = .25 * a * v * self.arm_nominal
            elif e == "joint-torque-gain":
                self.gain = p["gain"] = .03 * a * v * self.sh["sg"]
            elif e == "joint-stribeck-friction":
                jp[:, JP["df"]] = p["df"] = .012 * a * s * v
                jp[:, JP["vlag"]] = self.nu["vlag"] * self.nu["level"]
                p["vs"] = self.sh["vs"]
            elif e == "joint-load-friction":
                jp[:, JP["load"]] = p["factor"] = .02 * a * v
            elif e == "joint-torque-ripple":
                jp[:, JP["ra"]] = p["amplitude"] = .01 * a * s * v
                jp[:, JP["ra2"]] = jp[:, JP["ra"]] * self.sh["h2"]
                jp[:, JP["rk"]] = p["k"] = self.sh["k"]
                jp[:, JP["rph"]] = p["phase"] = self.sh["ph"]
            elif e == "joint-spring":
                jp[:, JP["spring"]] = p["stiffness"] = .02 * a * s * v / self.range
                jp[:, JP["sq0"]] = p["zero"] = self.q0
            elif e == "joint-elasticity":
                self.compl = p["compliance"] = self.compl_nominal * a * v
            elif e == "payload":
                p["mass"] = .25 * a
            elif e == "gravity-error":
                p["tilt"] = .008 * a
            par[e] = {k: (np.asarray(x).tolist() if np.ndim(x) else float(x)) for k, x in p.items()}
        return jp

    def outside_jp(self, jp, a, par):
        u = self.extra_u
        s = self.scale
        k = self.extra
        if k == "warming-up":
            jp[:, JP["warm"]] = .4 * a
            jp[:, JP["warm_t"]] = self.T * (.25 + .1 * u[0])
        elif k == "pushes":
            for j in self.acts["outside"]:
                jp[j, JP["push"]] = .05 * a * s[j] * np.sign(u[j])
                jp[j, JP["push_t1"]], jp[j, JP["push_t2"]] = self.T * .15, self.T * (.18 + .03 * u[1])
        elif k == "coupled-gears":
            for j in self.acts["outside"]:
                jp[j, JP["couple"]] = .5 * a
        elif k == "fan-drag":
            jp[:, JP["drag"]] = .03 * a * s / self.top_speed ** 2
        elif k == "worn-places":
            jp[:, JP["fpos"]], jp[:, JP["fk"]] = min(.4 * a, .95), 2 * np.pi / (self.range * (.5 + .2 * u[0]))
        par["outside"] = dict(kind=k, amplitude=float(a))

    def shapes(self, rng):
        N = self.N
        u = rng.uniform
        self.sh = dict(vs=float(self.top_speed * np.exp(u(np.log(.03), np.log(.12)))), sg=rng.choice([-1., 1.], N), h2=float(u(0, .4)),
                       k=float(rng.choice(self.ripple_k)), ph=float(u(0, 6.28)), w={e: u(.6, 1.5, N) for e in LIN},
                       dir=rng.normal(size=3), pl=rng.normal(size=3) * .02)
        self.acts = {}
        for e in self.hidden + ["outside"]:
            pool = list(range(N))
            if e in ("joint-torque-gain", "joint-load-friction", "joint-elasticity") and N > 1:
                pool = [1, 3] if N == 7 else [1, 2, 3]                # joints that carry weight
            k = N if e in ("payload", "gravity-error") else int(rng.integers(max(1, len(pool) // 2), len(pool) + 1))
            self.acts[e] = sorted(rng.choice(pool, k, replace=False).tolist())
        if self.extra == "coupled-gears":
            self.acts["outside"] = [j for j in self.acts["outside"] if j > 0] or [N - 1]
        if self.extra in ("warming-up", "fan-drag", "worn-places"):
            self.acts["outside"] = list(range(N))
        self.model_amp = {e: float(u(.6, 1.6)) * (2.2 if self.extra in ("warming-up", "worn-places", "coupled-gears") and "friction" in e else 1) for e in self.model}
        self.extra_u = u(-1, 1, 12)

    def log(self, w):
        s = w["stream"]
        nu = self.nu
        rng = np.random.default_rng(self.seed + [4])
        ts = s["t"]
        dt = ts[1] - ts[0]
        t = stamps(rng, ts[-1], self.rate, nu["jitter"], nu["drop"])
        y = s["tau"] * (1 + self.gain) + self.offset
        if nu["tau_lp"]:
            if nu["zero_phase"]:
                b, a = butter(1, nu["tau_lp"] * 2 * dt)
                y = filtfilt(b, a, y, axis=0)
            else:
                y = lp1(y, 1 / (2 * np.pi * nu["tau_lp"]), dt)
        if nu["tau_rate"]:
            g = np.arange(ts[0], ts[-1], 1 / (self.rate * nu["tau_rate"]))
            yg = at(ts, y, g - nu["clock"])
            y = yg[np.clip(np.searchsorted(g, t, side="right") - 1, 0, len(g) - 1)] if nu["hold"] else at(g, yg, t)
        else:
            y = at(ts, y, t - nu["clock"])
        y = y + noise(rng, t.size, float(np.median(np.diff(t))), self.sigma, nu["colour"], nu["colour_f"])
        q, dq = read_joints(ts, s["q"] + s["tau"] * self.compl, s["dq"], t, nu, rng)
        return dict(t=t, q=q, dq=dq, tau=y, sigma=self.sigma * np.sqrt(1 + nu["colour"] ** 2), phase=self.ph[np.clip((t / H).astype(int), 0, len(self.ph) - 1)])

    def data(self, w, log, width=None):
        rig = self.rig(w)
        best = None
        for wd in ([width] if width else [.02, .06, .15]):
            D = JData(log["t"], log["q"], log["tau"], log["sigma"], self.robot, rig.get("tool"), (0, 0, -9.81), width=wd, ell=max(self.nu["ell"] * self.ell_scale, 1.5 * self.nu["encoder"]),
                      limit=2200)
            c = D.fit(self.model, self.truth(w))[1]
            if best is None or c < best[0]:
                best = (c, D)
        return best[1]

    def truth(self, w):
        return dict(vs=self.sh["vs"], k=self.sh["k"])

    def analyse(self, w, log):
        D = self.data(w, log)
        tr = self.truth(w)
        only = {k: v for k, v in tr.items() if k == "vs" and "joint-stribeck-friction" in self.all or k == "k" and "joint-torque-ripple" in self.all}
        return D, J.analyse(D, self.model, self.hidden, only, self.acts)

    def near(self, w, log, D, r):
        tr = self.truth(w)
        only = {k: v for k, v in tr.items() if k == "vs" and "joint-stribeck-friction" in self.all or k == "k" and "joint-torque-ripple" in self.all}
        return J.near(D, self.model, self.hidden, r, only)

    def write(self, w, log, folder, fmt):
        import tables
        N = self.N
        cols = {"t": log["t"], **{f"q{i+1}": log["q"][:, i] for i in range(N)}}
        if log["dq"] is not None and self.kind == "joints":
            cols.update({f"dq{i+1}": log["dq"][:, i] for i in range(N)})
        cols.update({f"tau{i+1}": log["tau"][:, i] for i in range(N)})
        if self.with_phase:
            cols["phase"] = log["phase"]
        tables.write_log(cols, folder, fmt)
        rig = self.rig(w)
        tables.write_rig(folder, robot=rig.get("robot"), tool=rig.get("tool"))


class JointCase(Base):
    kind = "joints"

    def __init__(self, seed, model, hidden, extra=None, flags=()):
        self.seed, self.model, self.hidden, self.extra, self.flags = list(seed), list(model), list(hidden), extra, set(flags)
        self.all = self.model + self.hidden
        rng = np.random.default_rng(self.seed + [1])
        u = rng.uniform
        self.robot = "lwr4plus" if rng.random() < .55 else "ur5"
        self.arm = arm_of(self.robot)
        self.N = N = self.arm.chain.n
        self.draw_common(rng, .3)
        self.rate = float(rng.choice([100, 250, 250, 500, 500, 1000]))
        self.scale = np.array(ROBOTS[self.robot]["scale"], float)
        self.scale = self.scale ** .8 * 1.5
        self.sigma = self.scale * float(np.exp(u(np.log(.0008), np.log(.004))))
        if {"joint-stribeck-friction", "joint-load-friction", "joint-elasticity"} & set(self.hidden):
            self.sigma = self.scale * float(np.exp(u(np.log(.0006), np.log(.0015))))
        if "joint-elasticity" in self.hidden:
            self.nu.update(tau_lp=None, encoder=5e-6)
        self.tool = None
        if rng.random() < .6:
            m = float(u(.3, 1.5))
            ax = self.arm.chain.rtip / np.linalg.norm(self.arm.chain.rtip)
            self.tool = dict(mass=round(m, 4), com=np.round(ax * u(.03, .08) + rng.normal(size=3) * .004, 5), inertia=[m * 4e-4] * 3 + [0.] * 3)
        self.nu["tool_err"] = (u(-1, 1, 4) * .015).tolist() if rng.random() < .6 else [0.] * 4
        self.nu["tilt"] = (u(-1, 1, 2) * 1e-3).tolist() if rng.random() < .5 and "gravity-error" not in self.all else [0., 0.]
        self.ell_scale, self.top_speed, self.range = 1.0, 1.0, 1.0
        self.arm_nominal = np.array(ROBOTS[self.robot]["armature"], float)
        self.compl_nominal = 1 / (self.scale * 150.)
        self.ripple_k = [4, 6, 8, 10, 12, 16, 20, 24]
        self.q0 = ROBOTS[self.robot]["home"] * [1, .6, 1, .8, 1, .8, 1][:N] if N == 7 else ROBOTS[self.robot]["home"]
        self.q0 = np.array(self.q0, float)
        amp = (np.array([1.0, .6, 1.0, .7, 1.2, .9, 1.3]) if N == 7 else np.array([1.2, .5, .7, .9, 1.1, 1.3])) * u(.8, 1.1, N)
        T = float(u(18, 55))
        sp = [.15, .9, .3, 1.4, .1] if self.rate > 100 else [.12, .4, .2, .6, .1]
        if "joint-stribeck-friction" in self.all:
            sp = [.25, .06, .9, .12, .04]
        X, self.ph = path(rng, N, amp, sp, T, self.rate <= 100)
        lim = self.arm.chain.limits
        v = np.abs(np.diff(X, axis=0) / H).max(0)
        X = X * np.minimum(1, .85 * lim[:, 2] / v)
        room = np.minimum(lim[:, 1] - self.q0, self.q0 - lim[:, 0]) - .05
        X = X * np.minimum(1, room / np.abs(X).max(0))
        self.ref = np.ascontiguousarray(self.q0 + X)
        self.T = len(X) * H - .05
        sc = u(.6, 2.0)
        K = (np.array([8000, 8000, 5000, 5000, 2500, 1500, 900.]) if N == 7 else np.array([9000, 9000, 7000, 3000, 2000, 1200.])) * sc
        M = self.arm_nominal + (np.array([1.5, 1.5, .5, .5, .06, .05, .01]) if N == 7 else np.array([2.5, 2.5, 1.0, .3, .25, .15]))
        self.ctrl = dict(K=K, D=1.4 * np.sqrt(K * M))
        self.shapes(np.random.default_rng(self.seed + [3]))
        self.cache = {}

    def rig(self, w):
        r = dict(robot=dict(model=self.robot, sensor_frame=self.arm.spec["sensor"], tip_frame=self.arm.spec["tip"]))
        if self.tool is not None:
            r["tool"] = {k: v for k, v in self.tool.items()}
        return r

    def world(self, amps, with_extra=True):
        par = {}
        jp = self.jp(amps, par)
        if self.extra and with_extra:
            self.outside_jp(jp, amps["outside"], par)
        e = self.nu["tool_err"]
        tool = dict(mass=1e-6, com=[0., 0., 0.], inertia=[1e-9] * 3 + [0.] * 3)
        if self.tool is not None:
            tool = dict(mass=self.tool["mass"] * (1 + e[0]), com=np.array(self.tool["com"]) * (1 + np.array(e[1:])), inertia=self.tool["inertia"])
        payload = None
        if "payload" in par:
            ax = self.arm.chain.rtip / np.linalg.norm(self.arm.chain.rtip)
            com = ax * .06 + self.sh["pl"]
            m = par["payload"]["mass"]
            payload = dict(mass=m, com=com.tolist(), inertia=[m * 3e-4] * 3 + [0.] * 3)
            par["payload"]["com"] = com.tolist()
        g = np.array([0, 0, -9.81])
        a, b = self.nu["tilt"]
        g = rotvec([a, b, 0]) @ g
        if "gravity-error" in par:
            d = self.sh["dir"].copy()
            d[2] = 0
            g = rotvec(d / np.linalg.norm(d) * par["gravity-error"]["tilt"]) @ g
            par["gravity-error"]["gravity"] = g.tolist()
        A = np.maximum(self.arm_nominal, self.rotor)
        key = repr((jp.tolist(), tool, payload, g.tolist(), A.tolist()))
        if key not in self.cache:
            self.cache.clear()
            s = self.arm.run_free(self.ref, H, self.T, jp, tool, g, self.ctrl, A, payload)
            self.cache[key] = s
        s = dict(self.cache[key])
        s["tau"] = s["tau"] - (A - self.rotor) * s["ddq"]            # link side: the drives' own inertia is not seen, unless it's the effect
        return dict(stream=s, par=par)


@njit(cache=True)
def axis_loop(ref, dref, rh, n, dt, Jin, K, D, jp, O):
    q = ref[0]
    v = z = vl = F = 0.0
    row = 0
    for k in range(n):
        t = k * dt
        u = t / rh
        i = min(int(u), ref.size - 2)
        u -= i
        a, b, da, db = ref[i], ref[i + 1], dref[i] * rh, dref[i + 1] * rh
        qd = (2 * u**3 - 3 * u**2 + 1) * a + (u**3 - 2 * u**2 + u) * da + (3 * u**2 - 2 * u**3) * b + (u**3 - u**2) * db
        vd = ((6 * u**2 - 6 * u) * (a - b) + (3 * u**2 - 4 * u + 1) * da + (3 * u**2 - 2 * u) * db) / rh
        tau = K * (qd - q) + D * (vd - v)
        F, z, vl = joint_friction(jp, t, q, v, dt, z, vl, tau)
        acc = (tau - F) / Jin
        O[row, 0] = t; O[row, 1] = q; O[row, 2] = v; O[row, 3] = tau; O[row, 4] = acc
        row += 1
        v += acc * dt
        q += v * dt


class DriveCase(Base):
    kind = "drive"

    def __init__(self, seed, model, hidden, extra=None, flags=()):
        self.seed, self.model, self.hidden, self.extra, self.flags = list(seed), list(model), list(hidden), extra, set(flags)
        self.all = self.model + self.hidden
        rng = np.random.default_rng(self.seed + [1])
        u = rng.uniform
        self.robot, self.N = None, 1
        self.draw_common(rng, .5)
        self.rate = float(rng.choice([200, 500, 1000, 1000, 2000]))
        self.top_speed = float(np.exp(u(np.log(2), np.log(30))))
        turns = self.top_speed * u(.6, 1.6)
        self.range, self.q0 = turns, np.zeros(1)
        sc = float(np.exp(u(np.log(.3), np.log(20))))
        self.J = sc * .5 / (self.top_speed * 4)
        self.scale = np.array([sc])
        self.sigma = self.scale * float(np.exp(u(np.log(.0012), np.log(.006))))
        self.ell_scale = self.top_speed * .3
        self.arm_nominal, self.compl_nominal = np.array([self.J]), 1 / (self.scale * 60.)
        self.ripple_k = [1, 2, 3, 4, 6, 8, 12]
        T = float(u(12, 40))
        X, self.ph = path(rng, 1, np.array([turns]), [.25, .05, .9, .1, .02] if "joint-stribeck-friction" in self.all else [.12, 1.0, .35, .03, .7], T, False)
        self.ref, self.T = X[:, 0], len(X) * H - .05
        wn = 2 * np.pi * u(12, 35)
        self.K, self.D = self.J * wn * wn, 2 * self.J * wn * u(.6, .9)
        self.shapes(np.random.default_rng(self.seed + [3]))
        self.cache = {}

    def rig(self, w):
        return {}

    def world(self, amps, with_extra=True):
        par = {}
        jp = self.jp(amps, par)
        if self.extra and with_extra:
            self.outside_jp(jp, amps["outside"], par)
        dt = 2.5e-4
        n = int(self.T / dt)
        O = np.zeros((n, 5))
        axis_loop(self.ref, np.gradient(self.ref, H), H, n, dt, self.J, self.K, self.D, jp[0], O)
        O = O[::2]
        return dict(stream=dict(t=O[:, 0], q=O[:, 1:2], dq=O[:, 2:3], tau=O[:, 3:4], ddq=O[:, 4:5]), par=par)


def tune_outside(case, rng, tries=8):
    want = float(np.exp(rng.uniform(np.log(4.6), np.log(8))))
    amps = {"outside": 1.0}
    for _ in range(8):
        w = case.world(amps, with_extra=False)
        log = case.log(w)
        D, r = case.analyse(w, log)
        if r["force"]["ok"]:
            break
        case.relax()
    else:
        return None
    j = case.acts["outside"]
    left = J.rms((D.y - r["pred"])[D.moving][:, j])
    for _ in range(tries):
        w = case.world(amps)
        log = case.log(w)
        D, r1 = case.analyse(w, log)
        tot = J.rms((D.y - r1["pred"])[D.moving][:, j])
        read = J.rms(D.y[D.moving][:, j])
        eff = np.sqrt(max(tot ** 2 - left ** 2, 0))
        after, name = J.best_addition(D, case.model, {}, j)
        need = max(want * left, .085 * read)
        rest = np.sqrt(max(after ** 2 - left ** 2, 0))
        enough = min(eff / need, rest / max(3.2 * left, .055 * read))
        if .97 < enough < 1.9:
            return amps, (w, log, D, dict(effect=eff, left=left, reading=read, fit=tot, after=after, helps=name, noise=r["force"]["noise"]))
        amps["outside"] *= float(np.clip(1.25 / max(enough, .05), .2, 4.0))
        if amps["outside"] > (4 if case.extra in ("warming-up", "worn-places") else 60):
            return None
    return None
