"""Writing logs and rigs."""
import os
import numpy as np
import pandas as pd


def write_log(cols, folder, fmt):
    os.makedirs(folder, exist_ok=True)
    for f in ("parquet", "csv", "npz"):
        p = os.path.join(folder, "log." + f)
        if os.path.exists(p):
            os.remove(p)
    p = os.path.join(folder, "log." + fmt)
    if fmt == "npz":
        np.savez_compressed(p, **{k: (np.asarray(v) if k != "phase" else np.asarray(v, dtype="U12")) for k, v in cols.items()})
    elif fmt == "csv":
        pd.DataFrame(cols).to_csv(p, index=False, float_format="%.9g")
    else:
        pd.DataFrame(cols).to_parquet(p, index=False)
    return p


def _v(x):
    if isinstance(x, str):
        return f'"{x}"'
    if np.ndim(x):
        return "[" + ", ".join(_v(float(a)) if not isinstance(a, str) else f'"{a}"' for a in x) + "]"
    return repr(round(float(x), 9))


def write_rig(folder, robot=None, tool=None, surface=None, noise=None):
    L = []
    for name, tab in (("robot", robot), ("tool", tool), ("surface", surface), ("sensor", None if noise is None else dict(noise=np.round(noise, 5)))):
        if tab:
            L.append(f"[{name}]")
            L += [f"{k} = {_v(v)}" for k, v in tab.items()]
            L.append("")
    with open(os.path.join(folder, "rig.toml"), "w") as f:
        f.write("\n".join(L) if L else "# no robot: a machine's own log\n")
