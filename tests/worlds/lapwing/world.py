"""Builders of the lapwing world: a spec (dict) in; a log (dict of columns), rig (dict), URDF text and values out."""
import numpy as np
from scipy.interpolate import CubicSpline
from scipy.signal import butter, lfilter
import engine as E, robots
from engine import material

ATI_N = np.array([0.015, 0.014, 0.029, 0.0005, 0.0006, 0.0003])
ATI_Q = np.array([0.01, 0.01, 0.02, 0.00025, 0.00025, 0.00025])

def unit(v):
    return np.asarray(v, float) / np.linalg.norm(v)

class Prog:
    """A planned motion of the tip: (s1, s2, depth, tilt1, tilt2) as quintic moves, holds and sines."""
    def __init__(s, d=-0.004):
        s.x = np.array([0, 0, d, 0, 0.0]); s.seg = []

    def to(s, T, phase, **kw):
        y = s.x.copy()
        for k, v in kw.items():
            y[("s1", "s2", "d", "a1", "a2").index(k)] = v
        s.seg.append((T, phase, s.x.copy(), y, None)); s.x = y
        return s

    def hold(s, T, phase="hold"):
        return s.to(T, phase)

    def sine(s, T, phase, comps):
        """comps: (channel, amplitude, frequency) with ramps of an eighth of T."""
        s.seg.append((T, phase, s.x.copy(), s.x.copy(), [(("s1", "s2", "d", "a1", "a2").index(c), a, f) for c, a, f in comps]))
        return s

    def render(s, dt):
        T = sum(a[0] for a in s.seg)
        t = np.arange(0, T, dt)
        X, ph, t0 = np.zeros((len(t), 5)), np.empty(len(t), object), 0.0
        for Ts, phase, a, b, comps in s.seg:
            m = (t >= t0 - 1e-9)
            u = np.clip((t[m] - t0) / Ts, 0, 1)
            X[m] = a + (b - a) * (u ** 3 * (10 - 15 * u + 6 * u * u))[:, None]
            if comps:
                win = np.clip(np.minimum(u, 1 - u) * 8, 0, 1)
                for c, A, f in comps:
                    X[m, c] += A * win * win * (3 - 2 * win) * np.sin(2 * np.pi * f * (t[m] - t0))
            ph[m] = phase
            t0 += Ts
        return t, X, ph

def log_times(rng, T, fs, jitter=0.0, drop=0.0):
    n = int(T * fs) - 2
    t = (np.arange(n) + 0.5) / fs
    if jitter:
        t = t + rng.uniform(-jitter, jitter, n) / fs
    keep = np.ones(n, bool)
    if drop:
        keep &= rng.random(n) > drop
        for _ in range(2):
            a = rng.integers(n // 10, n - 10)
            keep[a:a + rng.integers(2, max(3, int(0.02 * fs)))] = False
    return t[keep]

def interp(t, tg, Y):
    return np.column_stack([np.interp(t, tg, Y[:, i]) for i in range(Y.shape[1])])

def lag_filter(Y, tau, dt):
    if tau <= 0:
        return Y
    a = np.exp(-dt / tau)
    return lfilter([1 - a], [1, -a], Y, axis=0, zi=(a * Y[:1]))[0]

def joint_columns(rng, t, tg, Q, DQ, nu, log):
    n = Q.shape[1]
    enc = nu.get("enc", 5e-6)
    q = np.round(interp(t, tg, Q) / enc) * enc
    for i in range(n):
        log[f"q{i+1}"] = q[:, i]
    if nu.get("dq", True):
        dq = lag_filter(DQ, nu.get("dq_tau", 0.003), tg[1] - tg[0])
        dq = interp(t - nu.get("dq_delay", 0.0), tg, dq) + rng.normal(0, nu.get("dq_noise", 1e-3), (len(t), n)) + rng.normal(0, nu.get("dq_bias", 2e-4), n)
        for i in range(n):
            log[f"dq{i+1}"] = dq[:, i]

def draw_nuisance(rng, contact=True):
    nu = dict(enc=float(np.exp(rng.uniform(np.log(2e-6), np.log(2e-5 if contact else 1e-4)))), dq=bool(rng.random() < 0.65),
              dq_tau=float(rng.uniform(0.001, 0.01)), dq_delay=float(rng.uniform(0, 0.004)), dq_noise=float(10 ** rng.uniform(-4, -2.3)),
              dq_bias=float(10 ** rng.uniform(-4.3, -3.3)), jitter=float(rng.choice([0, 0.03, 0.1, 0.3])), drop=float(rng.choice([0, 0, 0.005, 0.02])),
              noise=float(rng.uniform(0.6, 1.6)), bias=float(rng.uniform(0, 0.02)), drift=float(rng.uniform(0, 0.03)), nonlin=float(rng.uniform(-0.008, 0.008)),
              clock=float(rng.uniform(-0.0012, 0.0012)), tool_off=float(rng.uniform(-0.02, 0.02)), lp=float(rng.choice([150, 250, 400])),
              base_tilt=float(rng.choice([0, 0, 0.02, 0.05])), phase=bool(rng.random() < 0.65), csv=bool(rng.random() < 0.25), q_cmd=bool(rng.random() < 0.2))
    return nu

def friction_kind(rng, P, exclude=()):
    k = rng.choice([x for x in ("dahl", "prandtl", "lugre", "rounded", "stick-slip") if x not in exclude])
    P[E.BK] = {"dahl": 0, "prandtl": 1, "lugre": 2, "rounded": 3, "stick-slip": 1}[k]
    P[E.ZL] = rng.uniform(0.7e-4, 1.3e-4) * (0.7 if k in ("prandtl", "stick-slip") else 1)
    if k == "rounded":
        P[E.VR] = rng.uniform(5e-5, 2e-4)
    if k == "stick-slip":
        P[E.DM], P[E.VS] = 0.04 * P[E.MU], 0.002
    return str(k)

def make_arm(rng, robot, nu, standard_gravity=True):
    g = np.array([0, 0, -9.81])
    if nu["base_tilt"]:
        a, th = nu["base_tilt"], rng.uniform(0, 2 * np.pi)
        g = 9.81 * unit([np.sin(a) * np.cos(th), np.sin(a) * np.sin(th), -np.cos(a)])
        g = np.round(g, 5)
    rig, urdf, jn = {}, None, None
    if robot == "lwr":
        hs, ro, L = round(rng.uniform(0.02, 0.05), 4), round(rng.uniform(-1.5, 1.5), 4), round(rng.uniform(0.07, 0.14), 4)
        urdf = robots.lwr_urdf(hs, ro, (0, 0, L))
        import tempfile, os
        with tempfile.TemporaryDirectory() as tmp:
            open(os.path.join(tmp, "arm.urdf"), "w").write(urdf)
            arm = robots.load("arm.urdf", "ft_sensor", "tool_tip", g, base=tmp)
        rig["robot"] = dict(model="arm.urdf", sensor_frame="ft_sensor", tip_frame="tool_tip")
    elif robot == "lwr4plus":
        arm = robots.load("lwr4plus", "flange", "flange", g)
        rig["robot"] = dict(model="lwr4plus", sensor_frame="flange", tip_frame="flange")
    elif robot == "ur5":
        arm = robots.load("ur5", "tool0", "tool0", g)
        rig["robot"] = dict(model="ur5", sensor_frame="tool0", tip_frame="tool0")
    else:
        jn = [f"panda_joint{i}" for i in range(1, 8)]
        arm = robots.load("panda", "panda_hand", "panda_hand_tcp", g, joints=jn)
        rig["robot"] = dict(model="panda", sensor_frame="panda_hand", tip_frame="panda_hand_tcp", joints=jn)
    rig["robot"]["gravity"] = [float(x) for x in g]
    return arm, rig, urdf

def tool_wrench(arm, Ro, po, wo, al, ao, Fc, m, com, I6, ptip):
    """The contract's wrench in the sensor frame. ptip: contact point in the last joint's frame."""
    Rs = Ro @ arm.Rs
    rc = Ro @ (arm.ps + arm.Rs @ com)
    ac = ao + np.cross(al, rc) + np.cross(wo, np.cross(wo, rc))
    ft = np.einsum("nji,nj->ni", Rs, m * (arm.g - ac))
    fc = np.einsum("nji,nj->ni", Rs, Fc)
    ws, als = np.einsum("nji,nj->ni", Rs, wo), np.einsum("nji,nj->ni", Rs, al)
    I = np.array([[I6[0], I6[3], I6[4]], [I6[3], I6[1], I6[5]], [I6[4], I6[5], I6[2]]])
    rt = arm.Rs.T @ (ptip - arm.ps)
    tau = np.cross(com, ft) + np.cross(rt, fc) - als @ I.T - np.cross(ws, ws @ I.T)
    return np.hstack([ft + fc, tau])

def sense(rng, t, tg, W, nu, fx):
    """Sensor chain. fx: hidden sensor effects (gain, crosstalk matrix, rotation, bias, drift, lag, delay, limit, step, hum)."""
    dt = tg[1] - tg[0]
    rngf = np.array([40, 40, 120, 2, 2, 2.0]) * nu.get("range", 1)
    W = W * (1 + nu["nonlin"] * (W / rngf) ** 2 * 4)
    if "rot" in fx:
        from scipy.spatial.transform import Rotation
        R = Rotation.from_rotvec(fx["rot"]).as_matrix()
        W = np.hstack([W[:, :3] @ R, W[:, 3:] @ R])
    if "xt" in fx:
        W = W @ (np.eye(6) + fx["xt"]).T
    W = W * (1 + fx.get("gain", 0.0))
    b, a = butter(2, min(nu["lp"], 0.4 / dt) * 2 * dt)
    W = lfilter(b, a, W - W[:1], axis=0) + W[:1]
    W = lag_filter(W, fx.get("lag", 0.0), dt)
    Y = interp(t - nu["clock"] - fx.get("delay", 0.0), tg, W)
    sc = np.array([1, 1, 1, 0.05, 0.05, 0.05])
    Y = Y + sc * rng.normal(0, nu["bias"], 6) + np.outer(t / 60, sc * rng.normal(0, nu["drift"], 6))
    Y = Y + fx.get("bias", 0.0) + np.outer(t / 60, fx.get("drift", np.zeros(6)))
    if "extra" in fx:
        Y = Y + interp(t, tg, fx["extra"])
    Y = Y + rng.normal(0, 1, Y.shape) * ATI_N * nu["noise"]
    if "limit" in fx:
        Y = np.clip(Y, -fx["limit"], fx["limit"])
    return np.round(Y / ATI_Q) * ATI_Q

def build_arm(rng, sp):
    """Contact log of a compliant arm. sp: robot, mat, prog, fs, fx, hidden rig errors."""
    nu = draw_nuisance(rng); nu.update(sp.get("nu", {}))
    arm, rig, urdf = make_arm(rng, sp["robot"], nu)
    P = sp["mat"]
    q0 = np.array(robots.SEEDS[sp["robot"]]) + rng.uniform(-0.12, 0.12, arm.n)
    q0[0] = rng.uniform(-0.6, 0.6)
    R, p = E.fk(arm.chain, q0)
    pt = p[-1] + R[-1] @ arm.pt
    tilt = sp.get("surface_tilt", rng.choice([0, 0, 0.2, 0.4]))
    th = rng.uniform(0, 2 * np.pi)
    nrm = np.round(unit([np.sin(tilt) * np.cos(th), np.sin(tilt) * np.sin(th), np.cos(tilt)]), 6)
    nrm = unit(nrm)
    tz = (R[-1] @ arm.Rt)[:, 0]
    t1 = unit(tz - nrm * (tz @ nrm)); t2 = np.cross(nrm, t1)
    pt0 = np.round(pt, 5)
    Rd0 = np.column_stack([t1, np.cross(-nrm, t1), -nrm])
    tip = arm.pt + arm.Rt @ sp.get("tip_offset", np.zeros(3))
    # stiffness of the controlled arm at the tip -> command that reaches the wanted depth
    h = 5e-4 if sp["T_hint"] <= 70 else 1e-3
    q0 = E.ik(arm.chain, tip, arm.Rt, q0, pt0, Rd0, 100)
    m_t, com = round(rng.uniform(0.15, 0.5), 3), np.round([rng.uniform(-0.004, 0.004), rng.uniform(-0.004, 0.004), rng.uniform(0.02, 0.05)], 4)
    m_true = m_t * (1 + nu["tool_off"]) + sp.get("dmass", 0.0)
    com_true = com + sp.get("dcom", np.zeros(3))
    chain = arm.with_load(m_true, arm.ps + arm.Rs @ com_true)
    R, p = E.fk(chain, q0)
    M, z = E.mass_matrix(chain, q0, R, p)
    sk = sp.get("soft", float(np.exp(rng.uniform(np.log(0.6), np.log(3)))))
    Kp = sk * np.array([2000, 2000, 1500, 1500, 800, 600, 400.0])[:arm.n] * (1.6 if arm.n == 6 else 1)
    rot = np.array([1.0, 1.0, 0.6, 0.6, 0.25, 0.15, 0.15])[:arm.n]
    Kd = 2 * rng.uniform(0.5, 0.9) * np.sqrt(Kp * (np.diag(M) + rot))
    J = np.array([np.cross(z[i], pt0 - p[i]) for i in range(arm.n)]).T
    ktip = 1 / (nrm @ J @ np.diag(1 / Kp) @ J.T @ nrm)
    tk, X, ph = sp["prog"].render(0.01)
    d = np.maximum(X[:, 2], 0)
    el = P[E.K] * d ** P[E.N_] + P[E.LK] * np.maximum(d - P[E.LD], 0)
    X[:, 2] += el / ktip
    pos = pt0 + X[:, :1] * t1 + X[:, 1:2] * t2 - X[:, 2:3] * nrm
    from scipy.spatial.transform import Rotation
    Rd = np.einsum("nij,jk->nik", Rotation.from_rotvec(X[:, 3:4] * t1 + X[:, 4:5] * t2).as_matrix(), Rd0)
    qk = E.ik_path(arm.chain, tip, arm.Rt, q0, pos, Rd)
    ts = np.arange(0, tk[-1], h)
    cs = CubicSpline(tk, qk)
    qc, dqc = np.ascontiguousarray(cs(ts)), np.ascontiguousarray(cs(ts, 1))
    Fc = rng.uniform(0.05, 0.4) * np.array([1, 1, 0.8, 0.8, 0.5, 0.3, 0.2])[:arm.n]
    zs = sp["zs"](rng, ts) if "zs" in sp else np.zeros(len(ts))
    Q, DQ, DDQ, F, TAU, D3 = E.sim_contact(chain, tip, qc, dqc, h, Kp, Kd, rot, Fc, 0.5 * Fc, 3e-4, P, pt0, nrm, t1, t2, zs)
    dec = 2 if h < 1e-3 else 1
    ts = ts[::dec] + h
    Q, DQ, DDQ, F, D3 = (np.ascontiguousarray(a[::dec]) for a in (Q, DQ, DDQ, F, D3))
    kin = E.motion(arm.chain, Q, DQ, DDQ)
    W = tool_wrench(arm, *kin, F, m_true, com_true, np.zeros(6), tip)
    fx = dict(sp.get("fx", {}))
    if "extra_force" in sp:                              # force on the tool at the sensor's origin, base frame
        Fe = sp["extra_force"](rng, ts, kin[1] + kin[0] @ arm.pt)
        fx["extra"] = np.hstack([np.einsum("nji,nj->ni", kin[0] @ arm.Rs, Fe), np.zeros((len(ts), 3))])
    t = log_times(rng, ts[-1] - 0.01, sp["fs"], nu["jitter"], nu["drop"])
    log = {"t": t}
    joint_columns(rng, t, ts, Q, DQ, nu, log)
    Y = sense(rng, t, ts, W, nu, fx)
    for i, c in enumerate(("fx", "fy", "fz", "tx", "ty", "tz")):
        log[c] = Y[:, i]
    if nu["phase"]:
        log["phase"] = ph[np.clip(np.searchsorted(tk, t) - 1, 0, len(tk) - 1)]
    if nu["q_cmd"]:
        for i in range(arm.n):
            log[f"q_cmd{i+1}"] = np.interp(t, ts - h, qc[::dec, i])
    rig["tool"] = dict(mass=m_t, com=[float(x) for x in com])
    z0 = sp.get("z0", 0.0)
    rig["surface"] = dict(point=[float(x) for x in pt0 - nrm * z0], normal=[float(x) for x in nrm], tangent=[float(x) for x in t1])
    if rng.random() < 0.4:
        rig["sensor"] = dict(noise=[float(x) for x in ATI_N])
    return dict(log=log, rig=rig, urdf=urdf, csv=nu["csv"], truth_depth=D3, T=ts[-1])

def multisine(rng, t, n, amp, f0, nh=4, ramp=1.0):
    T = t[-1]
    q = np.zeros((len(t), n))
    for i in range(n):
        a = rng.normal(0, 1, nh) / np.arange(1, nh + 1) ** 0.5
        ph = rng.uniform(0, 2 * np.pi, nh)
        y = sum(a[k] * np.sin(2 * np.pi * f0 * (k + 1) * (1 + 0.03 * i) * t + ph[k]) for k in range(nh))
        q[:, i] = amp[i] * y / np.abs(y).max()
    u = np.clip(np.minimum(t, T - t) / ramp, 0, 1)
    return q * (u ** 3 * (10 - 15 * u + 6 * u * u))[:, None]

def sim_free(rng, chain, n, q0, qcmd, h, o):
    """Run sim_joints with the joint effects in o (defaults: none)."""
    z = np.zeros(n)
    ts = np.arange(len(qcmd)) * h
    cs = CubicSpline(ts[::10], qcmd[::10])
    qc, dqc, ddqc = (np.ascontiguousarray(cs(ts, k)) for k in (0, 1, 2))
    ct = o.get("ct", int(rng.random() < 0.5))
    R, p = E.fk(chain, qc[0])
    M, _ = E.mass_matrix(chain, qc[0], R, p)
    rot = o.get("rotor", z)
    wn = rng.uniform(15, 40)
    if ct:
        Kp, Kd = np.full(n, wn ** 2), np.full(n, 2 * 0.8 * wn)
    else:
        Kp = wn ** 2 * (np.diag(M) + rot); Kd = 1.6 * wn * (np.diag(M) + rot)
    v = lambda k: np.asarray(o.get(k, z), float)
    br = o.get("brake", np.zeros((len(qc), n)))
    out = E.sim_joints(chain, qc, dqc, ddqc, h, ct, Kp, Kd, np.asarray(rot, float), v("Fc"), v("Fv"), o.get("jz", 2e-4), o.get("jkind", 0), v("As"), v("Ad"),
                       v("Ex"), np.asarray(o.get("Vs", np.ones(n)), float), v("Ld"), v("ro"), v("rs"), v("rc"), v("rs2"), v("rc2"), v("sk"), v("sq"), br,
                       np.asarray(o.get("slosh", np.zeros(3)), float), np.asarray(o.get("patt", np.zeros(3)), float))
    return (ts + h,) + out

def free_motion(rng, arm, chain, sp, nu, h):
    T = sp["T"]
    t = np.arange(0, T, h)
    base = np.array(robots.SEEDS[{"lwr4plus": "lwr"}.get(sp["robot"], sp["robot"])]) + rng.uniform(-0.3, 0.3, arm.n)
    amp = sp.get("amp", 1.0) * np.array([0.8, 0.5, 0.8, 0.6, 1.0, 0.8, 1.2])[:arm.n]
    q = base + multisine(rng, t, arm.n, amp, sp.get("f0", 0.1), sp.get("nh", 4), 1.0 if sp.get("f0", 0.1) > 0.05 else 0.2 / sp["f0"])
    return sim_free(rng, chain, arm.n, base, q, h, sp.get("joint", {}))

def build_free(rng, sp):
    """Wrench in free motion."""
    nu = draw_nuisance(rng, False); nu.update(sp.get("nu", {}))
    arm, rig, urdf = make_arm(rng, sp["robot"], nu)
    m_t, com = sp.get("mass", round(rng.uniform(0.6, 1.2), 3)), np.round([rng.uniform(-0.01, 0.01), rng.uniform(-0.01, 0.01), rng.uniform(0.04, 0.07)], 4)
    m_true, com_true, I6 = m_t * (1 + nu["tool_off"] * 0.4) + sp.get("dmass", 0.0), com + sp.get("dcom", np.zeros(3)), np.asarray(sp.get("I6", np.zeros(6)), float)
    h = 1e-3
    chain = arm.with_load(m_true, arm.ps + arm.Rs @ com_true)
    ts, Q, DQ, DDQ, TAU = free_motion(rng, arm, chain, sp, nu, h)
    kin = E.motion(arm.chain, Q, DQ, DDQ)
    W = tool_wrench(arm, *kin, np.zeros((len(ts), 3)), m_true, com_true, I6, arm.pt)
    t = log_times(rng, ts[-1] - 0.01, sp["fs"], nu["jitter"], nu["drop"])
    log = {"t": t}
    joint_columns(rng, t, ts, Q, DQ, nu, log)
    Y = sense(rng, t, ts, W, nu, sp.get("fx", {}))
    for i, c in enumerate(("fx", "fy", "fz", "tx", "ty", "tz")):
        log[c] = Y[:, i]
    if nu["phase"]:
        log["phase"] = np.full(len(t), "free", object)
    rig["tool"] = dict(mass=m_t, com=[float(x) for x in com])
    return dict(log=log, rig=rig, urdf=urdf, csv=nu["csv"], T=ts[-1])

def filter_tau(rng, t, ts, TAU, nu):
    h = ts[1] - ts[0]
    b, a = butter(2, nu["tau_lp"] * 2 * h)
    Y = lfilter(b, a, TAU - TAU[:1], axis=0) + TAU[:1]
    if nu.get("tau_fs"):                                 # logged at another rate, held
        k = np.floor(t * nu["tau_fs"]) / nu["tau_fs"]
    else:
        k = t
    return interp(k, ts, Y) + rng.normal(0, 1, (len(t), TAU.shape[1])) * nu["tau_noise"]

def build_joint(rng, sp):
    """Joint torques of an arm in free motion."""
    nu = draw_nuisance(rng, False); nu.update(sp.get("nu", {}))
    nu.setdefault("tau_lp", float(rng.uniform(25, 50))); nu.setdefault("tau_fs", float(rng.choice([0, 250, 333])))
    arm, rig, urdf = make_arm(rng, sp["robot"], nu)
    if urdf:
        rig["robot"] = dict(model="arm.urdf", gravity=rig["robot"]["gravity"])
    else:
        rig["robot"] = {k: v for k, v in rig["robot"].items() if k in ("model", "joints", "gravity")}
    h = 1e-3
    chain = arm.chain
    if "payload" in sp:
        chain = arm.with_load(sp["payload"][0], sp["payload"][1])
    sp = dict(sp, joint=dict(sp.get("joint", {}), patt=arm.ps))
    ts, Q, DQ, DDQ, TAU = free_motion(rng, arm, chain, sp, nu, h)
    TAU = TAU * (1 + sp.get("tau_gain", np.zeros(arm.n))) + sp.get("tau_offset", np.zeros(arm.n))
    t = log_times(rng, ts[-1] - 0.01, sp["fs"], nu["jitter"], nu["drop"])
    log = {"t": t}
    joint_columns(rng, t, ts, Q, DQ, nu, log)
    nu["tau_noise"] = nu.get("tau_noise", 1) * np.array([0.07, 0.07, 0.04, 0.04, 0.03, 0.015, 0.015])[:arm.n]
    Y = filter_tau(rng, t, ts, TAU, nu)
    for i in range(arm.n):
        log[f"tau{i+1}"] = Y[:, i]
    return dict(log=log, rig=rig, urdf=urdf, csv=nu["csv"], T=ts[-1])

def build_drive(rng, sp):
    """One axis: an unknown inertia and a drive."""
    nu = draw_nuisance(rng, False); nu.update(sp.get("nu", {}))
    J = sp["J"]
    chain = (np.eye(3)[None], np.zeros((1, 3)), np.array([[0, 0, 1.0]]), np.array([1e-9]), np.zeros((1, 3)), J * np.eye(3)[None], np.zeros(3))
    h = 5e-4
    t = np.arange(0, sp["T"], h)
    q = sp["motion"](rng, t)
    o = dict(sp["joint"])
    if callable(o.get("brake")):
        o["brake"] = o["brake"](rng, t)
    ts, Q, DQ, DDQ, TAU = sim_free(rng, chain, 1, q[0], q.reshape(-1, 1), h, o)
    t = log_times(rng, ts[-1] - 0.01, sp["fs"], nu["jitter"], nu["drop"])
    log = {"t": t}
    nu["enc"] = sp.get("enc", nu["enc"])
    joint_columns(rng, t, ts, Q, DQ, nu, log)
    nu.setdefault("tau_lp", 50.0); nu["tau_noise"] = np.array([sp.get("tau_noise", 0.005)])
    log["tau1"] = filter_tau(rng, t, ts, TAU, nu)[:, 0]
    return dict(log=log, rig={}, urdf=None, csv=nu["csv"], T=ts[-1])

def build_tester(rng, sp):
    """Material tester or tribometer: depth (and slip) as its own sensors see them."""
    nu = draw_nuisance(rng); nu.update(sp.get("nu", {}))
    h = 5e-4
    tk, X, ph = sp["prog"].render(0.002)
    ts = np.arange(0, tk[-1], h)
    d, s = CubicSpline(tk, X[:, 2])(ts), CubicSpline(tk, X[:, 0])(ts)
    F, Tq = E.sim_tester(sp["mat"], ts, d, s, h, np.asarray(sp.get("floor", np.zeros(3)), float))
    t = log_times(rng, ts[-1] - 0.01, sp["fs"], nu["jitter"], nu["drop"])
    fs = np.abs(F).max()
    W = np.column_stack([F, Tq])
    b, a = butter(2, nu["lp"] * 2 * h)
    W = lfilter(b, a, W, axis=0)
    Y = interp(t - nu["clock"], ts, W)
    Y = Y * (1 + nu["nonlin"] * (Y / fs) ** 2) + fs * (rng.normal(0, 2e-3 * nu["noise"], Y.shape)) + fs * nu["bias"] * 0.05
    dn = sp.get("depth_noise", 2e-6)
    log = {"t": t, "depth": np.interp(t, ts, d) + rng.normal(0, dn, len(t)) + sp.get("depth_offset", 0.0)}
    if sp.get("rate") and nu["dq"]:
        log["depth_rate"] = np.interp(t, ts, np.gradient(d, h)) + rng.normal(0, 1e-5, len(t))
    log["normal_force"] = Y[:, 0]
    if sp.get("slip"):
        log["slip1"] = np.interp(t, ts, s) + rng.normal(0, dn, len(t))
        log["tangential_force1"] = Y[:, 1]
    if nu["phase"]:
        log["phase"] = ph[np.clip(np.searchsorted(tk, t) - 1, 0, len(tk) - 1)]
    return dict(log=log, rig={}, urdf=None, csv=nu["csv"], T=ts[-1])
