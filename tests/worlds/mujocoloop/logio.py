"""Instruments and files: encoders, clocks, rates, dropped samples, filters; rig.toml and log writing (SI units)."""
from __future__ import annotations
import os
import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from scipy.signal import butter, lfilter, lfilter_zi, savgol_filter


def lowpass(y: np.ndarray, fc: float, fs: float, order: int = 1) -> np.ndarray:
    """Causal Butterworth of the given order at fc [Hz]."""
    b, a = butter(order, min(fc, 0.45 * fs) / (fs / 2))
    return lfilter(b, a, y, axis=0, zi=lfilter_zi(b, a)[:, None] * y[:1])[0]


def at(t_new: np.ndarray, t: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Columns of y at other times, by straight lines."""
    return np.column_stack([np.interp(t_new, t, y[:, i]) for i in range(y.shape[1])])


def clock(rng: np.random.Generator, t: np.ndarray, rate: float, nu: dict) -> np.ndarray:
    """Sampling times [s]: jittered, some dropped."""
    tl = np.arange(t[0], t[-1] - 2 / rate, 1 / rate)
    jit = float(rng.choice([0.0, rng.uniform(0.01, 0.1)]))
    drop = float(rng.choice([0.0, rng.uniform(0.001, 0.02)]))
    nu |= {"rate_hz": rate, "jitter_periods": jit, "dropped": drop}
    tl = tl + jit / rate * np.clip(rng.normal(0, 0.4, len(tl)), -1, 1)
    return np.maximum.accumulate(tl[rng.random(len(tl)) >= drop]) - 0.0


def joints(rng: np.random.Generator, t, q, dq, tl, nu: dict, coarse: bool, quiet: bool = False):
    """Encoder angles [rad] and rates [rad/s] (None where the robot gives none) at log times tl."""
    step = float(rng.choice([1e-5, 5e-5, 2e-4, 5e-4, 1e-3], p=[0.5, 0.4, 0.1, 0, 0] if quiet else [0.3, 0.4, 0.2, 0.07, 0.03]) if coarse else rng.choice([2e-6, 4e-6, 1e-5, 2e-5], p=[0.6, 0.4, 0, 0] if quiet else [0.45, 0.35, 0.15, 0.05]))
    ql = np.round(at(tl, t, q) / step) * step
    nu["encoder_step_rad"] = step
    if rng.random() < 0.25:
        nu["dq"] = "missing"
        return ql, None
    fs, lag, fc = 1 / np.median(np.diff(t)), 0.0, 0.0
    if rng.random() < 0.5:
        fc = float(rng.uniform(50 if quiet else 20, 100))
        dq = lowpass(dq, fc, fs)
    else:
        lag = float(rng.uniform(0, 0.002 if quiet else 0.005))
    noise, bias = float(10 ** rng.uniform(-5, -4 if quiet else -3.3)), rng.uniform(-1, 1, q.shape[1]) * 2e-4 * rng.random()
    nu["dq"] = {"noise": noise, "bias_max": float(np.abs(bias).max()), "lag_s": lag, "lowpass_hz": fc}
    return ql, at(tl - lag, t, dq) + bias + rng.normal(0, noise, ql.shape)


def differentiate(t: np.ndarray, q: np.ndarray, dq: np.ndarray | None, width: float) -> tuple[np.ndarray, np.ndarray]:
    """Rates and accelerations as a user would get them from a log: Savitzky-Golay over width [s], on an even clock."""
    te = np.linspace(t[0], t[-1], len(t))
    h = te[1] - te[0]
    n = max(5, int(width / h) // 2 * 2 + 1)
    y = at(te, t, q)
    v = savgol_filter(y, n, 3, deriv=1, delta=h, axis=0)
    a = savgol_filter(y, n, 3, deriv=2, delta=h, axis=0)
    if dq is not None:
        a = savgol_filter(at(te, t, dq), n, 2, deriv=1, delta=h, axis=0)
        return dq, at(t, te, a)
    return at(t, te, v), at(t, te, a)


def write(folder: str, cols: dict[str, np.ndarray], rig: str, fmt: str) -> None:
    """log.<fmt>, log_nodq.<fmt> if there are dq columns, rig.toml."""
    os.makedirs(folder, exist_ok=True)
    with open(os.path.join(folder, "rig.toml"), "w") as f:
        f.write(rig)
    sets = {"log": cols}
    if any(k.startswith("dq") for k in cols):
        sets["log_nodq"] = {k: v for k, v in cols.items() if not k.startswith("dq")}
    for name, c in sets.items():
        path = os.path.join(folder, name)
        if fmt == "parquet":
            pq.write_table(pa.table(c), path + ".parquet")
        elif fmt == "npz":
            np.savez(path + ".npz", **c)
        else:
            rows = zip(*[v if v.dtype.kind in "UO" else [f"{x:.9g}" for x in v] for v in c.values()])
            with open(path + ".csv", "w") as f:
                f.write(",".join(c) + "\n" + "\n".join(",".join(r) for r in rows) + "\n")


def wrench_rig(surf: np.ndarray, tool, noise: list[float], urdf_name: str = "lwr4plus", inertia: bool = True, rng_lim: list[float] | None = None) -> str:
    """rig.toml of a contact log, as the user knows it."""
    L = lambda v: "[" + ", ".join(f"{float(x):.9g}" for x in v) + "]"
    s = f'[robot]\nmodel = "{urdf_name}"\nsensor_frame = "ft_sensor"\ntip_frame = "tool_tip"\ngravity = [0.0, 0.0, -9.81]\n\n[tool]\nmass = {tool.mass:.9g}\ncom = {L(tool.com)}\n'
    if inertia:
        s += f"inertia = {L([*tool.inertia, 0, 0, 0])}\n"
    s += f"\n[surface]\npoint = {L(surf[0])}\nnormal = {L(surf[1])}\ntangent = {L(surf[2])}\n\n[sensor]\n"
    return s + f"range = {L(rng_lim or [40, 40, 120, 2, 2, 2])}\nnoise = {L(noise)}\n"
