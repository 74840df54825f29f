"""Instruments: clocks, encoders, rates, coloured noise, rig.toml and log files."""
from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from scipy.signal import butter, lfilter


def sample_times(rng: np.random.Generator, T: float, rate: float, nu: dict) -> np.ndarray:
    """Log times [s] in (0, T) with jitter and dropped samples."""
    t = np.arange(0.01, T - 0.02, 1 / rate)
    jit = rng.choice([0.0, 0.0, rng.uniform(0.01, 0.1)])
    drop = rng.choice([0.0, 0.0, rng.uniform(0.002, 0.02)])
    t = t + rng.uniform(-0.5, 0.5, t.size) * jit / rate
    t = t[rng.random(t.size) >= drop]
    nu.update(rate_hz=rate, jitter_share=float(jit), dropped_share=float(drop))
    return t


def noise(rng: np.random.Generator, n: int, rate: float, sd: np.ndarray, share: float, cut: float) -> np.ndarray:
    """Noise (n, k) of standard deviations sd; `share` of the variance low-passed at `cut` Hz, the rest white."""
    k = len(sd)
    out = np.sqrt(1 - share) * rng.standard_normal((n, k))
    if share > 0:
        if cut < 0.4 * rate:
            b, a = butter(1, cut / (rate / 2))
            c = lfilter(b, a, rng.standard_normal((n + 200, k)), axis=0)[200:]
            c /= c.std(axis=0)
        else:
            c = rng.standard_normal((n, k))
        out += np.sqrt(share) * c
    return out * sd


def lowpass(x: np.ndarray, rate: float, cut: float) -> np.ndarray:
    """Causal first-order low-pass along axis 0 starting at rest at x[0]."""
    if cut >= 0.45 * rate:
        return x
    b, a = butter(1, cut / (rate / 2))
    zi = np.outer(np.ones(1), x[0]) * (1 - b[0]) if x.ndim > 1 else np.array([x[0] * (1 - b[0])])
    return lfilter(b, a, x, axis=0, zi=zi)[0]


def encoder(q: np.ndarray, stepsize: float) -> np.ndarray:
    """Quantised angle [rad]."""
    return np.round(q / stepsize) * stepsize if stepsize > 0 else q


def rates(rng: np.random.Generator, t: np.ndarray, dq: np.ndarray, rate: float, nu: dict, contact: bool = True) -> np.ndarray | None:
    """Measured dq: noise, bias, lag or low-pass; None in a quarter of the cases."""
    if rng.random() < 0.25:
        nu["dq"] = "missing"
        return None
    sd, bias = 10 ** rng.uniform(-5, np.log10(5e-4)), rng.choice([0, 1]) * rng.uniform(0, 2e-4)
    nu.update(dq_noise=float(sd), dq_bias=float(bias))
    out = dq
    if rng.random() < 0.5:
        lag = rng.uniform(0, 5e-3)
        out = np.stack([np.interp(t - lag, t, dq[:, j]) for j in range(dq.shape[1])], 1)
        nu["dq_lag_s"] = float(lag)
    else:
        cut = rng.uniform(20, 100)
        out = lowpass(dq, rate, cut)
        nu["dq_lowpass_hz"] = float(cut)
    return out + sd * rng.standard_normal(dq.shape) + bias * rng.choice([-1, 1], dq.shape[1])


def write_log(folder: Path, cols: dict[str, np.ndarray], fmt: str = "parquet") -> None:
    """log.<fmt> and, where the log has dq columns, log_nodq.<fmt>."""
    folder.mkdir(parents=True, exist_ok=True)
    for name, keep in (("log", cols), ("log_nodq", {k: v for k, v in cols.items() if not k.startswith("dq")})):
        if name == "log_nodq" and len(keep) == len(cols):
            continue
        if fmt == "csv":
            ks = list(keep)
            with open(folder / f"{name}.csv", "w") as f:
                f.write(",".join(ks) + "\n")
                arr = [[str(s) for s in keep[k]] if keep[k].dtype.kind in "US" else [f"{v:.9g}" for v in keep[k]] for k in ks]
                f.writelines(",".join(r) + "\n" for r in zip(*arr))
        elif fmt == "npz":
            np.savez_compressed(folder / f"{name}.npz", **keep)
        else:
            pq.write_table(pa.table({k: pa.array(v.astype(str) if v.dtype.kind in "US" else v) for k, v in keep.items()}), folder / f"{name}.parquet")


def write_rig(folder: Path, rig: dict[str, dict]) -> None:
    """rig.toml from a dict of tables."""
    folder.mkdir(parents=True, exist_ok=True)
    s = ""
    for tab, kv in rig.items():
        s += f"[{tab}]\n" + "".join(f"{k} = {json.dumps(v)}\n" for k, v in kv.items()) + "\n"
    (folder / "rig.toml").write_text(s)
