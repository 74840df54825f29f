"""Instruments: clocks, encoders, filters, noise, logs on disk. Everything that is measured goes through here."""
from __future__ import annotations

from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from scipy.interpolate import CubicSpline
from scipy.signal import butter, filtfilt, lfilter


def first_order(x: np.ndarray, dt: float, tau: float) -> np.ndarray:
    """Causal first-order low-pass with time constant tau [s]; starts settled."""
    a = np.exp(-dt / tau)
    return lfilter([1 - a], [1, -a], x, axis=0, zi=np.atleast_1d(x[0])[None, :] * a if x.ndim > 1 else [x[0] * a])[0]


def log_clock(rng: np.random.Generator, t_end: float, rate: float, jitter: float, drop: float, t0: float = 0.05) -> np.ndarray:
    """Sampling instants [s]: jitter as a share of the period, a share of samples dropped."""
    t = np.arange(t0, t_end - 0.05, 1 / rate)
    t = t + rng.uniform(-1, 1, len(t)) * jitter / rate
    keep = rng.random(len(t)) >= drop
    keep[[0, -1]] = True
    return t[keep]


def at(t: np.ndarray, x: np.ndarray, ts: np.ndarray) -> np.ndarray:
    """Cubic interpolation of a simulated signal at instants ts."""
    return CubicSpline(t, x, axis=0)(np.clip(ts, t[0], t[-1]))


def lin(t: np.ndarray, x: np.ndarray, ts: np.ndarray) -> np.ndarray:
    """Linear interpolation of columns."""
    return np.column_stack([np.interp(ts, t, c) for c in np.atleast_2d(x.T)])


def derivatives(t: np.ndarray, q: np.ndarray, fc: float) -> tuple:
    """Zero-phase positions, velocities and accelerations of a jittered log at its own instants (own inverse, never in a log)."""
    fs = max(4 * fc * 2.5, min(1000.0, 1 / np.median(np.diff(t))))
    g = np.arange(t[0], t[-1], 1 / fs)
    x = lin(t, q, g)
    b, a = butter(3, min(fc / (fs / 2), 0.9))
    x = filtfilt(b, a, x, axis=0, padlen=min(len(g) - 2, int(fs / fc)))
    v = np.gradient(x, 1 / fs, axis=0)
    acc = np.gradient(v, 1 / fs, axis=0)
    return lin(g, x, t), lin(g, v, t), lin(g, acc, t)


def draw(rng: np.random.Generator, contact: bool, clean: bool) -> dict:
    """A mix of nuisances (SI units). clean: the milder mix of 'none' cases (sensor nonlinearity ≤ 0.3 %)."""
    n = {"rate": float(rng.choice([200, 250, 333, 500, 500, 1000, 1000])), "jitter": float(rng.choice([0, 0.02, 0.05, 0.1])), "drop": float(rng.choice([0, 0.003, 0.01, 0.02])),
         "dq": bool(rng.random() > 0.25), "dq_noise": float(10 ** rng.uniform(-5, -3.3)), "dq_bias": float(rng.uniform(-2e-4, 2e-4)), "dq_lag": 0.0, "dq_lowpass_hz": 0.0,
         "encoder": float(10 ** rng.uniform(np.log10(2e-6), np.log10(2e-5 if contact else 4e-5))), "clock": float(rng.uniform(-2e-4, 2e-4)),
         "nonlinearity": float(rng.uniform(0, 0.003 if clean else 0.006)), "base_tilt_deg": float(rng.uniform(0, 0.06 if clean else 0.15)), "tilt_dir": float(rng.uniform(0, 6.28)),
         "tool_mass_error": float(rng.uniform(-0.02, 0.02)), "tool_com_error": float(rng.uniform(-0.02, 0.02)), "drift_share": float(rng.uniform(-0.5, 0.5)),
         "controller_hz": float(rng.choice([4, 6, 9, 12])), "torque_lowpass_hz": 0.0, "torque_rate": 0.0}
    n["dq_lag" if rng.random() < 0.5 else "dq_lowpass_hz"] = float(rng.uniform(0.0, 5e-3)) if n["dq_lowpass_hz"] == 0 else 0.0
    if n["dq_lowpass_hz"] > 0:
        n["dq_lowpass_hz"] = float(rng.uniform(20, 100))
    if not contact and rng.random() < 0.08:
        n["encoder"] = float(10 ** rng.uniform(-4, -3))
    if not contact and rng.random() < 0.5:
        n["torque_lowpass_hz"] = float(rng.uniform(25, 50) if rng.random() < 0.8 else rng.uniform(8, 25))
    if rng.random() < 0.2:
        n["torque_rate"] = float(rng.choice([100, 125, 250]))
    return n


def encode(rng: np.random.Generator, q: np.ndarray, step: float) -> np.ndarray:
    """An encoder: rounding to its step, with a phase of its own."""
    phase = rng.random(q.shape[1])
    return (np.round(q / step + phase) - phase) * step


def measured_dq(rng: np.random.Generator, t: np.ndarray, v: np.ndarray, ts: np.ndarray, nz: dict) -> np.ndarray:
    """Velocities as logged: delayed or low-passed, biased, noisy."""
    if nz["dq_lowpass_hz"] > 0:
        v = first_order(v, t[1] - t[0], 1 / (2 * np.pi * nz["dq_lowpass_hz"]))
    x = at(t, v, ts - nz["dq_lag"])
    return x + nz["dq_bias"] * rng.choice([-1, 1], x.shape[1]) + nz["dq_noise"] * rng.standard_normal(x.shape)


def bend(x: np.ndarray, eps: float) -> np.ndarray:
    """Sensor nonlinearity: a cubic of share eps of the largest reading, without a linear part (least squares)."""
    m = np.max(np.abs(x), axis=0) + 1e-12
    y = (x / m) ** 3
    slope = np.sum(y * x, axis=0) / (np.sum(x * x, axis=0) + 1e-12)
    return x + eps * 2.5 * m * (y - slope * x)


def write(folder: Path, cols: dict, fmt: str = "parquet") -> None:
    """log.<fmt> and, where there is dq, log_nodq.parquet."""
    def table(names):
        return pa.table({k: cols[k] for k in names})
    names = list(cols)
    if fmt == "parquet":
        pq.write_table(table(names), folder / "log.parquet")
    elif fmt == "csv":
        import pyarrow.csv as pc
        pc.write_csv(table(names), folder / "log.csv")
    else:
        np.savez(folder / "log.npz", **{k: np.asarray(cols[k]) for k in names})
    if any(k.startswith("dq") for k in names):
        pq.write_table(table([k for k in names if not k.startswith("dq")]), folder / "log_nodq.parquet")
