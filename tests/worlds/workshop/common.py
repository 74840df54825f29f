"""Shared pieces: instruments (encoders, dq, clocks), least squares, case records, writing. SI units."""
from __future__ import annotations

import json
import shutil
from dataclasses import dataclass, field
from pathlib import Path
from typing import Callable

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from scipy.interpolate import CubicSpline
from scipy.signal import butter, filtfilt, lfilter


@dataclass
class Case:
    """One log with its truth; arrays by column, rms values in `unit`."""
    kind: str
    group: str
    model: list[str]
    hidden: list[str]
    near: list[str]
    effect_rms: float
    left_rms: float
    unit: str
    nuisances: dict
    notes: str
    columns: dict[str, np.ndarray]
    rig: str
    urdf: Path | None = None
    fmt: str = "parquet"
    extra: dict = field(default_factory=dict)

    def write(self, out: Path, name: str) -> dict:
        """Write log, log_nodq, rig.toml and the robot into out/name; return the truth record."""
        folder = out / name
        shutil.rmtree(folder, ignore_errors=True)
        folder.mkdir(parents=True)
        self.save(folder / f"log.{self.fmt}", self.columns)
        bare = {k: v for k, v in self.columns.items() if not k.startswith("dq")}
        if len(bare) < len(self.columns):
            self.save(folder / "log_nodq.parquet", bare)
        (folder / "rig.toml").write_text(self.rig)
        if self.urdf is not None:
            shutil.copy(self.urdf, folder / self.urdf.name)
        record = {"case": name, "kind": self.kind, "group": self.group, "model": ",".join(self.model), "hidden": self.hidden,
                  "true_model": ",".join(self.model + [h for h in self.hidden if self.group != "outside"]), "near": self.near,
                  "effect_rms": self.effect_rms, "left_rms": self.left_rms, "unit": self.unit, "nuisances": self.nuisances,
                  "notes": self.notes, **self.extra}
        return json.loads(json.dumps(record, default=float))

    @staticmethod
    def save(path: Path, cols: dict[str, np.ndarray]) -> None:
        """Write columns as parquet, csv or npz, by suffix."""
        if path.suffix == ".parquet":
            pq.write_table(pa.table(cols), path, compression="zstd")
        elif path.suffix == ".npz":
            np.savez(path, **cols)
        else:
            rows = zip(*[c if c.dtype.kind in "UO" else [f"{v:.9g}" for v in c] for c in cols.values()])
            path.write_text("\n".join([",".join(cols), *(",".join(r) for r in rows)]) + "\n")


def rms(x: np.ndarray) -> float:
    """Root mean square of all entries."""
    return float(np.sqrt(np.mean(np.square(x)))) if np.size(x) else 0.0


def lowpass(x: np.ndarray, hz: float, rate: float) -> np.ndarray:
    """Causal first-order low-pass along axis 0, started at rest."""
    a = np.exp(-2 * np.pi * hz / rate)
    return lfilter([1 - a], [1, -a], x, axis=0, zi=a * x[:1])[0]


def smooth(t: np.ndarray, q: np.ndarray, hz: float) -> CubicSpline:
    """Zero-phase smoothed motion (order 2, forth and back) as a spline, from samples with jitter and gaps."""
    rate = 1 / np.median(np.diff(t))
    grid = np.arange(t[0], t[-1], 1 / rate)
    even = np.column_stack([np.interp(grid, t, c) for c in q.T])
    if hz < 0.45 * rate:
        even = filtfilt(*butter(2, hz, fs=rate), even, axis=0)
    return CubicSpline(grid, even)


def clock(rng: np.random.Generator, end: float, rate: float, nuis: dict) -> np.ndarray:
    """Sample times with jitter up to 10 % of a period and up to 2 % dropped samples."""
    t = np.arange(0.05, end - 0.05, 1 / rate)
    jitter, drop = rng.choice([0.0, 0.03, 0.1]), rng.choice([0.0, 0.005, 0.02])
    t = t + rng.uniform(-0.5, 0.5, len(t)) * jitter / rate
    nuis.update(rate_hz=rate, jitter=float(jitter), drop=float(drop))
    return t[rng.random(len(t)) >= drop]


def encoder(rng: np.random.Generator, q: np.ndarray, step: float, nuis: dict) -> np.ndarray:
    """Angles [rad] rounded to encoder steps."""
    nuis["encoder_step"] = step
    return np.round((q + rng.normal(0, 0.3 * step, q.shape)) / step) * step


def rates(rng: np.random.Generator, dq: np.ndarray, rate: float, nuis: dict) -> np.ndarray | None:
    """Measured dq [rad/s]: noise, bias, lag or low-pass; None in a quarter of the logs."""
    if rng.random() < 0.25:
        nuis["dq"] = "missing"
        return None
    noise, bias = 10 ** rng.uniform(-5, -3.3), rng.uniform(0, 2e-4)
    if rng.random() < 0.5:
        tau, what = rng.uniform(0, 5e-3), "lag"
        hz = 1 / (2 * np.pi * max(tau, 2e-4))
    else:
        hz, what = rng.uniform(20, 100), "lowpass_hz"
        tau = hz
    nuis.update(dq_noise=noise, dq_bias=bias, **{"dq_" + what: tau})
    return lowpass(dq, hz, rate) + rng.normal(0, noise, dq.shape) + rng.uniform(-bias, bias, (1, dq.shape[1]))


def gauss_newton(fn: Callable[[np.ndarray], np.ndarray], start: np.ndarray, scale: np.ndarray, target: np.ndarray, iters: int = 3) -> tuple[np.ndarray, np.ndarray]:
    """Least squares over parameters from `start`; returns (parameters, residual of the best point)."""
    p, pred = start.copy(), fn(start)
    best = np.sum((target - pred) ** 2)
    lam = 1e-6
    for _ in range(iters):
        J = np.column_stack([((fn(p + np.eye(len(p))[i] * scale[i] * 0.01) - pred) / 0.01).ravel() for i in range(len(p))]) if len(p) else np.zeros((pred.size, 0))
        r = (target - pred).ravel()
        N, g = J.T @ J, J.T @ r
        for _try in range(4):
            dp = np.linalg.lstsq(N + lam * np.diag(np.diag(N) + 1e-12), g, rcond=1e-12)[0] if len(p) else np.zeros(0)
            new = p + np.clip(dp, -1.0, 1.0) * scale
            cand = fn(new)
            cost = np.sum((target - cand) ** 2)
            if np.isfinite(cost) and cost < best:
                p, pred, lam = new, cand, max(lam * 0.1, 1e-9)
                done, best = (best - cost) < 1e-4 * best, cost
                break
            lam = max(lam, 1e-4) * 10
        else:
            break
        if done:
            break
    return p, target - pred


def wanted(group: str, ratio: float, target: float, share: float) -> float:
    """Factor for the strength of the hidden effect (1.0: leave it) from effect/left and effect/readings."""
    if group in ("none", "unexcited"):
        return 1.0
    if group == "weak":
        return 1.0 if 0.45 <= ratio <= 0.85 else float(np.clip(target / max(ratio, 1e-3), 0.15, 2.5))
    floor = 0.075 if group == "outside" else 0.035
    if ratio < 0.85 * target or share < floor:
        return float(np.clip(1.15 * max(target / max(ratio, 1e-3), floor / max(share, 1e-4)), 1.15, 2.5))
    return 1.0 if ratio <= 3 * target or share < 0.2 else float(np.clip(2 * target / ratio, 0.4, 1.0))
