"""What stands between the physics and the log: encoders, rates of rates, noise, low-passes, other rates held or interpolated, jitter, drops."""
import numpy as np
from scipy.signal import butter, lfilter, sosfilt, sosfilt_zi


def noise(rng, n, sigma, coloured):
    """white noise plus a share of first-order coloured noise; rms sigma per channel."""
    sigma = np.asarray(sigma, float)
    w = rng.standard_normal((n, len(sigma)))
    if coloured > 0:
        a = 0.97
        c = lfilter([np.sqrt(1 - a * a)], [1, -a], rng.standard_normal((n, len(sigma))), axis=0)
        w = np.sqrt(1 - coloured) * w + np.sqrt(coloured) * c
    return w * sigma


def low(x, fs, fc, order=2):
    if not fc or fc >= 0.45 * fs:
        return x
    sos = butter(order, 2 * fc / fs, output="sos")
    zi = sosfilt_zi(sos)[:, :, None] * x[0]
    return sosfilt(sos, x, axis=0, zi=zi)[0]


def at(t, x, tt):
    return np.stack([np.interp(tt, t, x[:, j]) for j in range(x.shape[1])], 1)


def sample_times(rng, T, fs, jitter, drops):
    t = np.arange(1, int(T * fs) - 2) / fs
    if jitter:
        t = t + rng.uniform(-jitter, jitter, len(t)) / fs
    if drops:
        keep = rng.random(len(t)) > drops
        for _ in range(int(rng.integers(0, 3))):                   # and a short gap or two
            a = int(rng.integers(len(t)))
            keep[a:a + int(0.01 * fs) + 1] = False
        t = t[keep]
    return t


def other_rate(t_sim, x, t_log, rate, how, offset=0.0):
    """read at another rate, then held or interpolated to the log's times."""
    if not rate:
        return at(t_sim, x, t_log + offset)
    ts = np.arange(t_sim[0], t_sim[-1], 1 / rate)
    xs = at(t_sim, x, ts + offset)
    if how == "hold":
        return xs[np.clip(np.searchsorted(ts, t_log, side="right") - 1, 0, len(ts) - 1)]
    return at(ts, xs, t_log)


def encoder(x, step):
    return np.round(x / step) * step if step else x


def draw_acquisition(rng, kind, T):
    """a mixture of nuisances, different in every log."""
    u, pick = rng.uniform, lambda *a: a[int(rng.integers(len(a)))]
    n = {}
    if T > 200:
        n["fs"] = pick(50.0, 100.0) if kind != "wrench" else 50.0
    else:
        n["fs"] = float(rng.choice([125, 250, 500, 500, 1000, 1000, 2000] if kind != "tester" else [100, 200, 250, 500, 500, 1000, 2000]))
    n["jitter"] = pick(0, 0, u(0.02, 0.2))
    n["drops"] = pick(0, 0, u(0.001, 0.02))
    n["dq"] = u() > 0.25
    n["dq_bias"], n["dq_lag"], n["dq_fc"] = u(-2e-4, 2e-4), pick(0, u(0, 5e-3)), pick(0, u(20, 100))
    n["coloured"] = pick(0, 0, u(0.1, 0.6))
    n["clock"] = pick(0.0, u(-3e-4, 3e-4))
    n["held"] = None
    if kind == "wrench":
        n["encoder"] = float(np.exp(u(np.log(2e-6), np.log(1e-5))))
        n["lowpass"] = pick(0, 0, u(60, 300))
        if u() < 0.2:
            n["held"] = (float(pick(500, 800, 1000)), pick("hold", "linear"))
    elif kind == "tester":
        n["encoder"] = float(np.exp(u(np.log(2e-8), np.log(1e-6))))
        n["lowpass"] = pick(0, 0, u(60, 300))
    else:
        n["encoder"] = float(np.exp(u(np.log(2e-6), np.log(1e-3))))
        n["lowpass"] = pick(0, 0, u(8, 50))
        if u() < 0.35:
            n["held"] = (float(pick(100, 125, 200, 333)), pick("hold", "linear"))
    return n
