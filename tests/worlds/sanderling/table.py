"""CSV and Parquet tables without pandas."""
import csv
import numpy as np, pyarrow as pa, pyarrow.parquet as pq


class Col(np.ndarray):
    def to_numpy(self):
        return np.asarray(self)


class Table(dict):
    def __getattr__(self, k):
        if k not in self: raise AttributeError(k)
        return self[k].view(Col)

    def __getitem__(self, k):
        if isinstance(k, list):
            return np.stack([dict.__getitem__(self, x) for x in k], 1).view(Col)
        return dict.__getitem__(self, k).view(Col)


def read(f):
    if f.endswith("parquet"):
        t = pq.read_table(f)
        return Table({n: np.asarray(t[n].to_pylist()) if n == "phase" else t[n].to_numpy() for n in t.column_names})
    R = list(csv.reader(open(f)))
    C = list(zip(*R[1:]))
    return Table({n: np.array(c) if n == "phase" else np.array(c, float) for n, c in zip(R[0], C)})


def write(f, d):
    if f.endswith("parquet"):
        pq.write_table(pa.table({k: pa.array(np.asarray(v).tolist() if k == "phase" else np.asarray(v)) for k, v in d.items()}), f)
    else:
        with open(f, "w", newline="") as o:
            o.write(",".join(d) + "\n")
            c = [[str(x) for x in v] if k == "phase" else ["%.9g" % x for x in v] for k, v in d.items()]
            o.writelines(",".join(r) + "\n" for r in zip(*c))
