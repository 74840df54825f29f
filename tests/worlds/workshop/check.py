"""Read a written data folder back: rig.toml resolves, a static tool in the air reads m R' g, joint torques match inverse dynamics at rest, no gaps."""
import json
import sys
import tomllib
from pathlib import Path

import numpy as np
import pinocchio as pin
import pyarrow.parquet as pq

folder = Path(sys.argv[1])
worst, spans = [], []
truth = json.loads((folder / "truth.json").read_text())
for rec in truth:
    case = folder / rec["case"]
    rig = tomllib.loads((case / "rig.toml").read_text())
    log = next(case.glob("log.*"))
    if log.suffix == ".csv":
        rows = [line.split(",") for line in log.read_text().split()]
        tab = {k: np.array([float(r[i]) for r in rows[1:]]) for i, k in enumerate(rows[0])}
    else:
        tab = dict(np.load(log)) if log.suffix == ".npz" else {k: np.array(v) for k, v in pq.read_table(log).to_pydict().items()}
    num = {k: v for k, v in tab.items() if v.dtype.kind == "f"}
    assert all(np.isfinite(v).all() for v in num.values()) and (np.diff(num["t"]) > 0).all(), rec["case"]
    assert any(k.startswith("dq") for k in tab) == (case / "log_nodq.parquet").exists(), rec["case"]
    spans.append(float(num["t"][-1] - num["t"][0]))
    if rec["kind"] == "wrench":
        model = pin.buildModelFromUrdf(str(case / rig["robot"]["model"]))
        assert list(model.names)[1:] == rig["robot"]["joints"]
        data = model.createData()
        q = np.column_stack([num[f"q{i + 1}"] for i in range(model.nq)])
        rest = num["t"] < 0.35
        pin.forwardKinematics(model, data, q[rest].mean(axis=0))
        R = pin.updateFramePlacement(model, data, model.getFrameId("ft_sensor")).rotation
        f = np.array([num[c][rest].mean() for c in ("fx", "fy", "fz")])
        worst.append((float(np.abs(f - rig["tool"]["mass"] * R.T @ [0, 0, -9.81]).max()), rec["case"], ",".join(rec["hidden"])))
print(len(truth), "cases; spans", round(min(spans), 1), round(float(np.median(spans)), 1), round(max(spans), 1), "s; largest static deviations", sorted(worst)[-6:])
