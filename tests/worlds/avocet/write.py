"""Logs and rigs to disk: what the encoders, clocks and files do to a case."""
import json, os
import numpy as np
import pyarrow as pa, pyarrow.parquet as pq, pyarrow.csv as pc
from scipy.signal import butter, sosfilt, lfilter
from contact import sensor, finish


def clock(rng, T, fs, jit, drop):
    n = int(T * fs) + 1; t = np.arange(n) / fs
    if jit: t = t + np.clip(rng.normal(size=n) * jit / fs, -.3 / fs, .3 / fs); t[0] = max(t[0], 0); t = np.minimum(t, T)
    keep = np.ones(n, bool)
    if drop:
        keep = rng.random(n) > drop
        if n > 500 and rng.random() < .5: j = rng.integers(n // 4, n - 100); keep[j:j + rng.integers(2, 6)] = False
    return t[keep]


def colour(rng, n, c, fs, cut):
    """noise of unit rms, filtered at cut Hz when given"""
    w = rng.normal(size=(n, c))
    if cut and cut < .4 * fs:
        w = sosfilt(butter(2, cut / (fs / 2), output="sos"), w, axis=0); w /= w.std(0)
    return w


def measure(rng, t, q, step, noise):
    q = q + noise * rng.normal(size=q.shape)
    return np.round(q / step) * step if step else q


def rates(rng, t, q, dq, mode, fs):
    """dq as controllers give it: filtered, late, with a bias"""
    if mode == "absent": return None
    a = 1 - np.exp(-1 / fs / rng.uniform(.001, .006))
    v = lfilter([a], [1, a - 1], dq, axis=0)
    v = v + rng.normal(size=dq.shape[1]) * 2e-5 + rng.normal(size=dq.shape) * 10 ** rng.uniform(-5, -3.7)
    return v


def table(d, cols, name):
    tb = pa.table(cols)
    p = os.path.join(d, name)
    if name.endswith("csv"): pc.write_csv(tb, p)
    else: pq.write_table(tb, p)


def toml(d, R):
    def v(x):
        if isinstance(x, str): return json.dumps(x)
        if isinstance(x, (list, tuple, np.ndarray)): return "[" + ", ".join(v(y) for y in x) + "]"
        return repr(round(float(x), 9))
    with open(os.path.join(d, "rig.toml"), "w") as f:
        for k, tb in R.items():
            f.write(f"[{k}]\n" + "".join(f"{a} = {v(b)}\n" for a, b in tb.items()) + "\n")


def sig2(x): return float("%.2g" % x)


def write_contact(b, d, rng):
    os.makedirs(d, exist_ok=True)
    sc, world, nz, nc = b["sc"], b["world"], b["nz"], b["nc"]
    arm_log = sc.arm_log
    sp, ideal, V = world(b["s"], b["fx"], b["us"], b["k"])
    W = sensor(sc.t, sc.wrench(sp), sp["S"]); Wi = sensor(sc.t, sc.wrench(ideal), ideal["S"])
    fs = min(b["fs"], sc.ff)
    jit, drop = (rng.uniform(.01, .1) if rng.random() < .4 else 0), (rng.uniform(5e-4, 5e-3) if rng.random() < .3 else 0)
    t = clock(rng, sc.t[-1], fs, jit, drop); n = len(t)
    I = lambda X: np.c_[tuple(np.interp(t, sc.t, X[:, i]) for i in range(X.shape[1]))]
    cut = rng.choice([0, 0, 50, 100, 200])
    if "sensor-lag" in b["fx"] or "time-offset" in b["fx"]: cut = 0
    Y = finish(I(W), colour(rng, n, nc, fs, cut) * b["sig"], sp["S"], before=rng.random() < .7)
    Mi = finish(I(Wi), 0., ideal["S"])
    if not sp["S"]["quant"] is None and np.isscalar(sp["S"]["quant"]):      # the converter of the data sheet
        h = b["sig"] * .5; Y = np.round(Y / h) * h
    ph = sc.ph[np.clip(np.searchsorted(sc.t, t), 0, len(sc.t) - 1)]
    cols = {"t": np.round(t, 7)}; rig = {}
    clean = I(sc.q) if arm_log else None
    if arm_log:
        A = b["A"]
        Q = measure(rng, t, clean, nz["enc"] * (1 if rng.random() < .7 else 0.), .3 * nz["enc"])
        for j in range(A.J): cols[f"q{j+1}"] = Q[:, j]
        v = rates(rng, t, clean, I(sc.dq), "absent" if rng.random() < .4 else "there", fs)
        if v is not None:
            for j in range(A.J): cols[f"dq{j+1}"] = v[:, j]
        for i, c in enumerate(["fx", "fy", "fz", "tx", "ty", "tz"]): cols[c] = Y[:, i]
        open(os.path.join(d, "arm.urdf"), "w").write(A.urdf())
        rig["robot"] = dict(model="arm.urdf", sensor_frame="ft_sensor", tip_frame="tool_tip", gravity=[0, 0, -9.81])
        rig["tool"] = dict(mass=b["base"]["m"], com=b["base"]["com"])
        rig["surface"] = dict(point=sc.p0, normal=sc.n, tangent=sc.t1)
        mf = np.abs(Y[:, :3]).max(); mt = np.abs(Y[:, 3:]).max()
        rng_ = next((x for x in ([40, 40, 120, 2, 2, 2], [80, 80, 240, 4, 4, 4], [145, 145, 290, 10, 10, 10]) if .95 * x[0] > np.abs(Y[:, :2]).max() and .95 * x[3] > mt and .95 * x[2] > mf), [400, 400, 800, 30, 30, 30])
        noise = [sig2(x * rng.uniform(.95, 1.1)) for x in b["sig"]]
        rig["sensor"] = dict(noise=noise)
        if sp["S"]["sat"] is None: rig["sensor"] = dict(range=rng_, noise=noise)
    else:
        dep = measure(rng, t, I(sc.de[:, None]), rng.choice([1e-7, 1e-6, 2e-6]), 2e-7)[:, 0]
        cols["depth"] = dep
        if rng.random() < .4: cols["depth_rate"] = rates(rng, t, None, I(np.gradient(sc.de, sc.t)[:, None]), "", fs)[:, 0]
        cols["normal_force"] = Y[:, 2]
        if b["slides"]:
            s = measure(rng, t, I(sc.s), 1e-6, 2e-7); cols["slip1"], cols["slip2"] = s[:, 0], s[:, 1]
            cols["tangential_force1"], cols["tangential_force2"] = Y[:, 0], Y[:, 1]
        mx = np.abs(Y).max()
        s3 = b["sig"]
        if rng.random() < .8:
            rig["sensor"] = dict(noise=[sig2(s3[0]), sig2(s3[1]), sig2(s3[2] * rng.uniform(.95, 1.1)), 5e-4, 5e-4, 5e-4])
    if rng.random() < .7: cols["phase"] = [str(x) for x in ph]
    name = "log.csv" if n * len(cols) < 250000 and rng.random() < .3 else "log.parquet"
    table(d, cols, name); toml(d, rig)
    F = slice(0, 3) if (arm_log or b["slides"]) else slice(2, 3)
    te = float(np.sqrt(((Y - Mi)[:, F] ** 2).mean()))
    # truths of the model's own parameters
    P = ideal["P"]; L = b["law"]; vals = {f"{L}.stiffness": P["k"]}
    if L == "kelvin-voigt": vals["kelvin-voigt.damping"] = P["c"]
    if L == "hunt-crossley": vals["hunt-crossley.damping"] = P["k"] * P["lam"]; vals["hunt-crossley.exponent"] = P["n"]
    if L == "maxwell": vals["maxwell.time-constant"] = P["tau1"]
    if L == "zener": vals["zener.branch-ratio"] = P["rho1"]; vals["zener.time-constant"] = P["tau1"]
    if b["slides"]: vals["coulomb-friction.coefficient"] = P["mu"]
    vals.update({k: v for k, v in V.items() if not k.startswith("OUT")})
    return dict(model=L + (",coulomb-friction" if b["slides"] else ""), values={k: float(v) for k, v in vals.items()}, true_error=te, rows=n, fs=fs)
