"""Logs and rig files."""
import os
import numpy as np
import pandas as pd


def write_log(folder, cols, rng):
    os.makedirs(folder, exist_ok=True)
    kind = rng.random()
    n = len(cols["t"])
    if kind < .08 and n < 40000:
        pd.DataFrame(cols).to_csv(os.path.join(folder, "log.csv"), index=False, float_format="%.9g")
        return "log.csv"
    if kind < .16:
        np.savez_compressed(os.path.join(folder, "log.npz"), **{k: (np.asarray(v, dtype="U12") if k == "phase" else np.asarray(v)) for k, v in cols.items()})
        return "log.npz"
    pd.DataFrame(cols).to_parquet(os.path.join(folder, "log.parquet"), index=False, compression="zstd")
    return "log.parquet"


def value(v):
    if isinstance(v, str):
        return '"' + v + '"'
    if isinstance(v, bool):
        return "true" if v else "false"
    if isinstance(v, (list, tuple, np.ndarray)):
        return "[" + ", ".join(value(x) for x in v) + "]"
    if isinstance(v, (int, np.integer)):
        return str(int(v))
    s = repr(float(v))
    return s


def toml(path, doc):
    out = []
    for k, t in doc.items():
        out.append(f"[{k}]")
        out += [f"{a} = {value(b)}" for a, b in t.items()]
        out.append("")
    with open(path, "w") as f:
        f.write("\n".join(out))
