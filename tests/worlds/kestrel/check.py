#!/usr/bin/env python
"""check.py OUT EFFECTS.md: columns, finite values, names; the base and the base with the hidden effects refitted on the written logs by ref.py.
Exits 1 when something is off. --outside also fits the catalogue to the outside rows (slow)."""
import json, os, re, sys
os.environ.setdefault('OMP_NUM_THREADS', '1'); os.environ.setdefault('OPENBLAS_NUM_THREADS', '1')
sys.path.insert(0, os.path.dirname(os.path.abspath(__file__)))
import numpy as np, ref, generate
out = sys.argv[1]
T = json.load(open(f'{out}/truth.json')); nui = json.load(open(f'{out}/nuisances.json'))
cat = set(re.findall(r'`([a-z][a-z-]+)`', ''.join(l.split('|')[1] for l in open(sys.argv[2]) if l.startswith('| `')))) | {'hooke', 'kelvin-voigt', 'hertz', 'hunt-crossley', 'maxwell', 'zener', 'rigid-body', 'none'}
bad = []; ratios = {'one': [], 'pair': []}
def need(c, m):
    if not c: bad.append(m); print('   BAD', m)
from collections import Counter
print(Counter(r['kind'] for r in T)); need(Counter(r['kind'] for r in T) == Counter(one=22, pair=7, none=9, outside=6, **{'not-excited': 4}), 'counts')
NORMAL = ['hertz-exponent', 'viscous-damping', 'hunt-crossley-damping', 'relaxation', 'hysteresis', 'stress-softening', 'stiffening-layer', 'surface-offset', 'stiffness-drift', 'stiffness-inhomogeneity']
OUT = {'o_pulse': NORMAL + ['sensor-bias', 'sensor-drift', 'structural-compliance', 'time-offset', 'sensor-lag'], 'o_loose_plug': NORMAL + ['sensor-bias', 'sensor-drift', 'structural-compliance', 'time-offset', 'sensor-lag', 'sensor-misalignment'],
       'o_hose': ['tool-mass', 'tool-com', 'tool-inertia', 'sensor-drift', 'sensor-crosstalk', 'sensor-gain', 'sensor-lag', 'time-offset'],
       'o_mu_of_place': NORMAL + ['viscous-friction', 'stribeck-friction', 'presliding', 'load-dependent-friction', 'sensor-bias', 'sensor-drift'],
       'o_warm_gear': ['joint-torque-offset', 'joint-friction-asymmetry', 'joint-stribeck-friction', 'joint-spring', 'joint-torque-ripple', 'joint-torque-gain'],
       'o_pushes': ['joint-torque-offset', 'joint-friction-asymmetry', 'joint-stribeck-friction', 'joint-spring', 'joint-torque-ripple', 'joint-load-friction', 'joint-torque-gain', 'payload']}
for r in T:
    L = ref.read_log(f'{out}/{r["log"]}'); t = L['t']; d = r['log'].split('/')[0]
    need(os.path.exists(f'{out}/{r["rig"]}'), d + ' rig')
    for k, v in L.items():
        if k != 'phase': need(np.isfinite(np.asarray(v, float)).all(), f'{d} {k} not finite'); need(len(v) == len(t), f'{d} {k} length')
    need((np.diff(t) > 0).all(), d + ' time not rising')
    for e in r['base'] + r['truth']: need(e in cat, f'{d} name {e}')
    if r['base'][0] == 'rigid-body': need(any(k.startswith('tau') for k in L) and 'q1' in L, d + ' columns')
    elif 'fx' in L: need(all(c in L for c in generate.CHAN) and 'q6' in L, d + ' columns')
    else: need('depth' in L and 'normal_force' in L, d + ' columns')
    s = generate.score(out, r); extra = ''
    if r['kind'] in ratios:
        ratios[r['kind']].append(s['ratio']); need(s['ratio'] >= 2, d + ' ratio'); need(s['share'] > .022, d + ' effect below the tolerance')
        if 'single' in s: extra = ' one left out: ' + ', '.join(f'{k} {v:.2f}' for k, v in s['single'].items()); need(min(s['single'].values()) > 1.8, d + ' half of the pair is weak')
    if r['kind'] == 'not-excited': need(s['ratio'] < 1.1, d + ' is excited')
    if r['kind'] == 'outside' and '--outside' in sys.argv:
        M = ref.load(out, r); key = 'rms'; b = M.fit(r['base'], r['values'])[key]; A = [e for e in OUT[nui[d]['name']] if e not in r['base']]
        al = M.fit(r['base'] + A, {'joint-torque-ripple.k': 2.}); best = []
        for e in A: best.append((M.fit(r['base'] + [e], {'joint-torque-ripple.k': 2.})[key]/b, e))
        extra = f' left of the error with the whole catalogue {al[key]/b:.2f}, best single: ' + ', '.join(f'{e} {x:.2f}' for x, e in sorted(best)[:3]); need(al[key]/b > .5, d + ' the catalogue can stand in')
    print(f'{d} {len(t):6d} rows {t[-1]-t[0]:6.1f} s {r["kind"]:11s} {"+".join(r["truth"]) or nui[d]["name"]:44s} {s["without"]:.4f} -> {s["with"]:.4f} x{s["ratio"]:.2f} share {100*s["share"]:.2f}% -> {100*s["share_with"]:.2f}%{extra}', flush=True)
for k, v in ratios.items(): print(k, 'median ratio', round(float(np.median(v)), 2), 'min', round(min(v), 2))
size = sum(os.path.getsize(os.path.join(a, f)) for a, _, fs in os.walk(out) for f in fs); print('size MB', round(size/1e6, 1)); need(size < 250e6, 'size')
print('bad:', bad or 'nothing'); sys.exit(bool(bad))
