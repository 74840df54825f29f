"""From the plant's stream to the log: sensor chain, clocks, encoders, noise; the nuisances of every case are drawn here."""
import numpy as np
from scipy.signal import lfilter, savgol_filter

FR = np.array([40, 40, 120, 2, 2, 2.0])


def lp1(x, tau, dt):
    if tau <= 0:
        return x
    a = np.exp(-dt / tau)
    zi = a * x[:1]
    return lfilter([1 - a], [1, -a], x, axis=0, zi=zi)[0]


def blank_sensor():
    return dict(gain=0.0, misalign=np.zeros(3), cross=np.zeros((6, 6)), lag=0.0, toff=0.0, bias=np.zeros(6), drift=np.zeros(6),
                hum=np.zeros(6), hum_f=50.0, hum_h=0.0, sat=None, sat_before=True, quant=None)


def draw_nuisances(rng, rate, kind, level=.6):
    """One random mixture. level scales everything that isn't plain noise."""
    n = dict(rate=float(rate), level=level)
    pick = lambda p: rng.random() < p
    u = rng.uniform
    n["sigma_f"] = float(np.exp(u(np.log(.012), np.log(.06))))
    n["sigma_t"] = n["sigma_f"] * float(np.exp(u(np.log(.04), np.log(.1))))
    n["colour"] = float(u(.2, .5)) if pick(.4) else 0.0
    n["colour_f"] = float(u(.5, 5))
    n["nonlin"] = (rng.uniform(-1, 1, 6) * .008 * level).tolist() if pick(.4) else None
    n["lp_hz"] = float(u(60, 300)) if pick(.5) else None
    n["drift"] = (rng.normal(size=6) * np.r_[[.02] * 3, [.0004] * 3] * level).clip(-.05, .05).tolist() if pick(.4) else None
    n["clock"] = float(u(-3e-4, 3e-4)) * level if pick(.6) else 0.0
    n["jitter"] = float(u(.01, .12)) if pick(.4) else 0.0
    n["drop"] = float(u(.001, .01)) if pick(.35) else 0.0
    n["encoder"] = float(np.exp(u(np.log(2e-6), np.log(1e-5))))
    n["dq"] = not pick(.25)
    n["dq_noise"] = float(np.exp(u(np.log(2e-4), np.log(3e-3))))
    n["dq_bias"] = float(u(-2e-4, 2e-4)) if pick(.5) else 0.0
    n["dq_lag"] = float(u(0, 5e-3)) if pick(.5) else 0.0
    n["dq_lp"] = float(u(20, 150)) if pick(.5) else None
    n["wrench_rate"] = float(rng.choice([.5, .8])) if pick(.2) and rate >= 500 else None
    n["hold"] = bool(pick(.4))
    n["surface"] = float(u(-5e-5, 5e-5)) * level if pick(.5) else 0.0
    n["level_base"] = (u(-1, 1, 2) * 1e-3 * level).tolist() if pick(.5) else [0.0, 0.0]
    n["tool_err"] = (u(-1, 1, 4) * .012 * level).tolist() if pick(.6) else [0.0] * 4
    n["toe"] = float(u(2e-5, 1.5e-4)) * level if pick(.4) else 0.0
    n["second_tau"] = [float(u(.01, .03)) * level, float(np.exp(u(np.log(.05), np.log(3))))] if pick(.35) else None
    n["ball"] = float(u(.5e-3, 2e-3)) * level if pick(.3) else 0.0
    n["ftype"] = int(rng.choice([0, 0, 1, 2, 3]))
    n["ell"] = float(u(.75e-4, 1.25e-4))
    return n


def noise(rng, n, dt, sigma, colour, f):
    """White plus an AR(1) part of relative size colour."""
    w = rng.normal(size=(n, len(sigma)))
    if colour > 0:
        a = np.exp(-2 * np.pi * f * dt)
        e = rng.normal(size=(n, len(sigma)))
        w = w + colour * lfilter([np.sqrt(1 - a * a)], [1, -a], e, axis=0)
    return w * np.asarray(sigma)


def stamps(rng, T, rate, jitter, drop):
    dt = 1.0 / rate
    t = np.arange(int(T * rate)) * dt
    t = t + np.clip(rng.normal(size=t.size), -3, 3) * jitter * dt
    if drop > 0:
        keep = np.ones(t.size, bool)
        for i in rng.integers(5, t.size - 20, int(drop * t.size / 4) + 1):
            keep[i:i + int(rng.integers(1, 8))] = False
        t = t[keep]
    t = t[(t > 0.02) & (t < T - 0.02)]
    return t


def at(ts, x, t):
    """Columns of x (on the uniform grid ts) at times t, linear."""
    dt = ts[1] - ts[0]
    u = np.clip((t - ts[0]) / dt, 0, len(ts) - 1.001)
    i = u.astype(int)
    u = (u - i)[:, None]
    return x[i] * (1 - u) + x[i + 1] * u


def read_channels(ts, y, t, S, nu, rng, sigma, rng_range):
    """The sensor's reading of channels y (n,c) on the stream grid ts, at the log's times t. Returns reading, the same without
    quantization/saturation-free noise split: (reading, noise_free)."""
    dt = ts[1] - ts[0]
    nc = y.shape[1]
    if nu["nonlin"] is not None:
        y = y + y * y * np.array(nu["nonlin"])[:nc] / rng_range
    y = lp1(y, S["lag"], dt)
    if nu["lp_hz"]:
        y = lp1(y, 1 / (2 * np.pi * nu["lp_hz"]), dt)
    slope = S["drift"][:nc].copy()
    if nu["drift"] is not None:
        slope = slope + np.array(nu["drift"])[:nc]
    tt = t - S["toff"] - nu["clock"]
    if nu["wrench_rate"]:
        g = np.arange(ts[0], ts[-1], 1 / (nu["rate"] * nu["wrench_rate"]))
        yg = at(ts, y, g - S["toff"] - nu["clock"])
        if nu["hold"]:
            clean = yg[np.clip(np.searchsorted(g, t, side="right") - 1, 0, len(g) - 1)]
        else:
            clean = at(g, yg, t)
    else:
        clean = at(ts, y, tt)
    clean = clean + S["bias"][:nc] + slope * t[:, None] / 60.0
    if np.any(S["hum"]):
        ph = 2 * np.pi * S["hum_f"] * t[:, None] + np.arange(nc)
        clean = clean + S["hum"][:nc] * (np.sin(ph) + S["hum_h"] * np.sin(2 * ph + .7))
    nz = noise(rng, t.size, float(np.median(np.diff(t))), sigma, nu["colour"], nu["colour_f"])
    out = clean + nz
    if S["sat"] is not None:
        lim = S["sat"]
        out = np.clip(out, -lim[:nc], lim[:nc]) if S["sat_before"] else np.clip(clean, -lim[:nc], lim[:nc]) + nz
    pre = out
    if S["quant"] is not None:
        st = S["quant"][:nc]
        out = np.where(st > 0, np.round(out / np.where(st > 0, st, 1)) * st, out)
    return out, pre, float(np.sqrt(1 + nu["colour"] ** 2))


def read_joints(ts, q, dq, t, nu, rng):
    st = nu["encoder"]
    ql = np.round(at(ts, q, t) / st) * st
    if not nu["dq"]:
        return ql, None
    dt = ts[1] - ts[0]
    y = dq
    if nu["dq_lp"]:
        y = lp1(y, 1 / (2 * np.pi * nu["dq_lp"]), dt)
    y = at(ts, y, t - nu["dq_lag"]) + nu["dq_bias"] + rng.normal(size=ql.shape) * nu["dq_noise"]
    return ql, y


def smooth(t, q, width, order=3):
    """q, dq, ddq at the times t of a jittered log: Savitzky-Golay on a uniform grid."""
    dt = float(np.median(np.diff(t)))
    g = np.arange(t[0], t[-1] + dt / 2, dt)
    qi = np.column_stack([np.interp(g, t, q[:, j]) for j in range(q.shape[1])])
    w = max(int(round(width / dt)) | 1, 5)
    out = []
    for k in range(3):
        y = savgol_filter(qi, w, order, deriv=k, delta=dt, axis=0)
        out.append(np.column_stack([np.interp(t, g, y[:, j]) for j in range(q.shape[1])]))
    return out
