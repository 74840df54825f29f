"""Sensors and recorders: sampling with jitter and loss, encoders, filtered velocities, low-passes, held channels, white and coloured noise."""
from __future__ import annotations

import numpy as np
from scipy.signal import butter, filtfilt, lfilter, lfilter_zi

from laws import lowpass


def sample_times(rng, T, fs, jitter, drop):
    t = np.arange(int(T * fs)) / fs
    if jitter > 0:
        t = t + np.clip(rng.normal(0, jitter / fs, len(t)), -0.4 / fs, 0.4 / fs)
        t = np.maximum(t, 0)
    if drop > 0:
        t = t[rng.random(len(t)) > drop]
    return t


def at(ta, Y, t):
    """Linear interpolation of an analog record with uniform times."""
    dt = ta[1] - ta[0]
    x = np.clip((t - ta[0]) / dt, 0, len(ta) - 1.000001)
    i = x.astype(int)
    f = x - i
    if Y.ndim > 1:
        f = f[:, None]
    return Y[i] * (1 - f) + Y[i + 1] * f


def filt(ta, Y, hz, order=2, zero=False):
    fs = 1 / (ta[1] - ta[0])
    if hz is None or hz >= 0.45 * fs:
        return Y
    b, a = butter(order, hz / (fs / 2))
    if zero:
        return filtfilt(b, a, Y, axis=0)
    zi = lfilter_zi(b, a)
    return lfilter(b, a, Y, axis=0, zi=zi[:, None] * Y[:1])[0]


def lag(ta, Y, tau):
    return Y if tau <= 0 else lowpass(ta, Y, tau)


def native(t, rate, Y_at, mode, phase=0.0):
    """Values known only at a device's own rate, then held or interpolated onto the log's rows."""
    k = np.floor((t - phase) * rate)
    t0 = np.maximum(k / rate + phase, 0)
    if mode == "hold":
        return Y_at(t0)
    t1 = t0 + 1 / rate
    f = ((t - t0) * rate)[:, None]
    return Y_at(t0) * (1 - f) + Y_at(t1) * f


def noise(rng, n, sd, colour, fs):
    """White noise with a share of coloured (corner 2 to 15 Hz) at the same rms."""
    sd = np.asarray(sd, float)
    w = rng.normal(size=(n, len(sd)))
    if colour > 0:
        fc = 2 + 13 * rng.random()
        a = np.exp(-2 * np.pi * fc / fs)
        e = rng.normal(size=(n, len(sd)))
        c = lfilter([np.sqrt(1 - a * a)], [1, -a], e, axis=0)
        w = np.sqrt(1 - colour ** 2) * w + colour * c
    return w * sd


def encoder(rng, Q, step, dither=0.3):
    if step <= 0:
        return Q
    return np.round((Q + dither * step * rng.normal(size=Q.shape)) / step) * step


def velocity(rng, ta, DQ, t, nu):
    """The drive's own velocity: filtered, late, with a bias."""
    V = filt(ta, DQ, nu["dq_lp"], 1)
    v = at(ta, V, np.maximum(t - nu["dq_lag"], 0))
    n = v.shape[1]
    return v + nu["dq_bias"] * (2 * rng.random(n) - 1) + nu["dq_noise"] * rng.normal(size=v.shape)


def draw_common(rng, lo=200, long=False):
    """What every recorder has."""
    fs = float(rng.choice([125, 250, 250, 333, 500, 500, 1000, 1000, 2000])) if not long else float(rng.choice([50, 100, 125]))
    while fs < lo and not long:
        fs = float(rng.choice([250, 333, 500, 500, 1000]))
    return dict(fs=fs, jitter=float(rng.choice([0, 0, 0.02, 0.05, 0.12])), drop=float(rng.choice([0, 0, 0.003, 0.015])),
                encoder=float(np.exp(rng.uniform(np.log(2e-6), np.log(1e-5)))), dq=bool(rng.random() > 0.25),
                dq_lp=float(np.exp(rng.uniform(np.log(15), np.log(150)))), dq_lag=float(rng.uniform(0, 5e-3)), dq_bias=float(rng.uniform(0, 2e-4)),
                dq_noise=float(np.exp(rng.uniform(np.log(1e-5), np.log(5e-4)))), colour=float(rng.choice([0, 0, 0.3, 0.6])),
                clock=float(rng.uniform(-3e-4, 3e-4)))


def logu(rng, a, b):
    return float(np.exp(rng.uniform(np.log(a), np.log(b))))


def rot_exact(r):
    a = np.linalg.norm(r)
    if a < 1e-12:
        return np.eye(3)
    k = r / a
    K = np.array([[0, -k[2], k[1]], [k[2], 0, -k[0]], [-k[1], k[0], 0]])
    return np.eye(3) + np.sin(a) * K + (1 - np.cos(a)) * K @ K


def sensor_chain(rng, ta, Y, t, sens, nu, sd):
    """Analog true channels -> logged channels. sens holds the hidden sensor effects, nu the nuisances."""
    C = Y.shape[1]
    s = nu["strength"]
    Z = lag(ta, Y, sens.get("lag", 0.0))
    if nu["lp"]:
        Z = filt(ta, Z, nu["lp"], 1 if nu["lp_order"] == 1 else 2, zero=nu.get("lp_zero", False))
    late = sens.get("dt", 0.0) + s * nu["clock"]

    def read(tt):
        return at(ta, Z, tt - late)
    V = native(t, nu["native"], read, nu["native_mode"]) if nu["native"] else read(t)
    V = V * (1 + s * nu["nonlin"] * np.abs(V) / np.maximum(np.abs(V).max(0), 1e-9))
    V = V * (1 + sens.get("gain", 0.0))
    if "mis" in sens:
        R = rot_exact(np.asarray(sens["mis"]))
        V = np.column_stack([V[:, :3] @ R, V[:, 3:] @ R])        # R' f
    if "cross" in sens:
        V = V @ (np.eye(C) + sens["cross"]).T
    V = V + np.asarray(sens.get("bias", np.zeros(C)))
    drift = np.asarray(sens.get("drift", np.zeros(C))) + s * np.asarray(nu["temp"][:C])
    V = V + t[:, None] / 60 * drift
    n = noise(rng, len(t), sd, nu["colour"], nu["fs"])
    if "hum" in sens:
        h = sens["hum"]
        for k, (am, ph) in enumerate(zip(h["amp"], h["phase"])):
            V = V + np.sin(2 * np.pi * (k + 1) * h["f"] * t[:, None] + ph) * am
    if "extra" in sens:
        V = V + sens["extra"](t)
    behind = sens.get("sat_noise_behind", False)
    if not behind:
        V = V + n
    if "sat" in sens:
        c = sens["sat_channel"]
        V[:, c] = np.clip(V[:, c], -sens["sat"], sens["sat"])
    if behind:
        V = V + n
    if "step" in sens:
        V = np.round(V / sens["step"]) * sens["step"]
    return V
