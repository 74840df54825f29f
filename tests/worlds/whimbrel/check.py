"""check.py DATA: reads the written logs back and prints what base and base+truth leave (own least-squares fits)."""
import os, sys
os.environ.setdefault('OMP_NUM_THREADS', '1'); os.environ.setdefault('OPENBLAS_NUM_THREADS', '1')
import json, csv, numpy as np, pyarrow.parquet as pq
from cases import *
def load(d, f):
    p = os.path.join(d, f)
    if f.endswith('.csv'):
        R = list(csv.reader(open(p))); A = list(zip(*R[1:])); return {k: np.array(a) if k == 'phase' else np.array(a, float) for k, a in zip(R[0], A)}
    T = pq.read_table(p); return {k: np.array(T[k].to_pylist()) if k == 'phase' else T[k].to_numpy() for k in T.column_names}
def main(D):
    tr = json.load(open(os.path.join(D, 'truth.json'))); pv = json.load(open(os.path.join(D, 'whimbrel_private.json'))); bad = []
    for e, p in zip(tr, pv):
        c, hv, rd, g = p['c'], p['hv'], p['read'], e['group']; J = judge(load(os.path.join(D, e['case']), p['file']), c, list(hv), hv, rd); k = 'all' if c['engine'] == 'joint' else 'f'
        m = ''; b, f, s = J['base'], J['full'], J['scale']
        if g in ('one', 'two'): good = all(v >= (2 if g == 'one' else 1.5) for v in J['ratio'].values()); m = '  '.join(f'{x} [{rd[x]}]: base{"" if g == "one" else "(dropped)"} {f[rd[x]]*v:.4g} -> {f[rd[x]]:.4g} x{v:.2f}' for x, v in J['ratio'].items())
        elif g == 'quiet': good = b[k] <= 1.3*e['true_error'] or b[k] <= .02*s[k]; m = f'left {b[k]:.4g} = {b[k]/e["true_error"]:.2f} x error, {100*b[k]/s[k]:.2f} % of rms'
        elif g == 'not-excited': good = all(v <= 1.2 for v in J['ratio'].values()); m = f'base/base+truth {max(J["ratio"].values()):.3f}, left {100*b[k]/s[k]:.2f} % of rms'
        else: x = p['extra']; q = b[x['read']]/x['without']; good = q >= 2; m = f'[{x["read"]}] base leaves {b[x["read"]]:.4g}, without the outside thing {x["without"]:.4g} x{q:.2f}'
        if not good: bad.append(e['case'])
        print(f"{e['case']} {g:11s} {p['fn'] if g != 'quiet' else '':9s} {e['kind']:12s} {'' if good else 'BAD '}{m}")
    print('break a rule:', bad or 'none')
if __name__ == '__main__': main(sys.argv[1])
