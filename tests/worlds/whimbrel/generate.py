import argparse, os, sys, time, copy, json
os.environ.setdefault('OMP_NUM_THREADS', '1'); os.environ.setdefault('OPENBLAS_NUM_THREADS', '1')
import numpy as np
from cases import *
import pyarrow as pa, pyarrow.parquet as pq
def plain(o):
    if isinstance(o, dict): return {k: plain(v) for k, v in o.items()}
    if isinstance(o, (list, tuple)): return [plain(v) for v in o]
    if isinstance(o, np.ndarray): return plain(o.tolist())
    if isinstance(o, np.generic): return o.item()
    return o
def ok(group, J, c, truth, err):
    # noise-plus-nuisance of the reading itself: err = rms(logged - noise-free); 2 % of the rms of the readings otherwise
    s = J['scale']; f = J['full']
    main = 'all' if c['engine'] == 'joint' else 'f'
    noise = {'all': float(np.sqrt(np.mean(np.square(c['sigma']))))}.get(main, float(np.sqrt(np.mean(np.square(c['sigma'][:3])))))
    noise = max(noise, err)
    if group == 'one': return all(v >= 2.1 for v in J['ratio'].values()), min(J['ratio'].values())
    if group == 'two': return all(v >= 1.6 for v in J['ratio'].values()), min(J['ratio'].values())
    if group == 'not-excited': return all(v <= 1.15 for v in J['ratio'].values()) and (f[main] <= 1.3*noise or J['base'][main] <= .03*s[main]), J['base'][main]/s[main]
    if group == 'quiet': return f[main] <= 1.3*noise or f[main] <= .02*s[main], f[main]/s[main]
    return True, 0
def build(S, i, group, fn, log_=None):
    best = None
    sched = [(1, 1), (1, 1.15), (.6, 1.3), (.35, 1.45), (.2, 1.6), (.1, 1.8), (.05, 2.1), (.1, 1.5), (.05, 1.8), (.05, 2.1)]   # the last three redraw the case too
    for a, (s, g) in enumerate(sched):
        r = np.random.default_rng([S, i, 77+(a if a > 6 else 0)]); rn = np.random.default_rng([S, i, a, 5])
        c, hv, read, near = fn(r, g); near = list(near); z = draw_nuis(rn, s); truth = list(hv)
        st = copy.deepcopy((c, r.bit_generator.state))
        sim = ENG[c['engine']][0]
        log, err = sim(r, c, hv, z); J = judge(log, c, truth, hv, read); extra = {}
        if group == 'outside':     # base on this log, against base on the same log without the outside thing
            c2 = copy.deepcopy(st[0]); r2 = np.random.default_rng(0); r2.bit_generator.state = st[1]
            for k in ('cable', 'floor', 'xt', 'warm'): c2.pop(k, None)
            up(c2, snA=0., txA=0.) if 'P' in c2 else None
            l2, _ = sim(r2, c2, hv, copy.deepcopy(z)); J2 = judge(l2, c2, [], {}, {})
            cc = copy.deepcopy(c); rd = {'o_text': 't', 'o_snap': 'n', 'o_cable': 'f', 'o_xt': 'j2', 'o_warm': 'j0', 'o_floor': 'f'}[fn.__name__]
            if 'P' in c: up(cc, snA=0., txA=0.); J = judge(log, cc, [], {}, {}); c = cc
            q = J['base'][rd]/J2['base'][rd]; good, score = q >= 2.1, q; extra = {'outside_ratio': q, 'without': J2['base'][rd], 'read': rd}
        else: good, score = ok(group, J, c, truth, err)
        sc = -score if group in ('quiet', 'not-excited') else score
        if best is None or sc > best[0] or good: best = (sc, log, err, c, hv, read, near, z, J, extra, a, good)
        if good: break
    return best
def values(c, hv):
    o = {}
    for e, v in hv.items():
        js = v.get('joints')
        for k, x in v.items():
            if k == 'joints': continue
            s = SYM.get(k, k)
            if not isinstance(x, list) and abs(x) < 1e-8 and k != 'q0': continue
            if isinstance(x, list):
                for j, y in zip(js, x):
                    if y: o[f'{e}.{s}_{j+1}'] = y
            else: o[f'{e}.{s}'] = x
    return o
def write(D, name, log, c, r):
    d = os.path.join(D, name); os.makedirs(d, exist_ok=True); T = []; f = lambda v: '[' + ', '.join(repr(round(float(x), 9)) for x in v) + ']'
    for x in os.listdir(d): os.remove(os.path.join(d, x))
    rb = ROB.get(c['robot'])
    if rb is not None:
        ps = np.array(c.get('ps', rb['flange'])); urdf(rb, ps, c.get('yaw', 0.), np.array(c.get('pt', [0, 0, .1])), os.path.join(d, rb['name']+'.urdf'))
        T += ['[robot]', f'model = "{rb["name"]}.urdf"', 'sensor_frame = "ft_sensor"', 'tip_frame = "tool_tip"', f'gravity = {f(c["grav"])}']
        if c['engine'] == 'arm':
            T += ['', '[tool]', f'mass = {c["m"]}', f'com = {f(c["com"])}']
            if not c['free']: T += ['', '[surface]', f'point = {f(c["point"])}', f'normal = {f(c["normal"])}', f'tangent = {f(c["tangent"])}']
            if r.random() < .7: T += ['', '[sensor]', 'range = [40, 40, 120, 2, 2, 2]', f'noise = {f(c["sigma"])}']
    open(os.path.join(d, 'rig.toml'), 'w').write('\n'.join(T)+'\n' if T else '# a log without a robot: nothing to state\n')
    if r.random() < .25 and len(log['t']) < 25000:
        ks = list(log); A = [log[k] for k in ks]
        with open(os.path.join(d, 'log.csv'), 'w') as h:
            h.write(','.join(ks)+'\n')
            for row in zip(*A): h.write(','.join(x if isinstance(x, str) else f'{x:.8g}' for x in row)+'\n')
        fn = 'log.csv'
    else: pq.write_table(pa.table({k: pa.array(v.tolist() if v.dtype.kind == 'U' else v) for k, v in log.items()}), os.path.join(d, 'log.parquet')); fn = 'log.parquet'
    return fn
def main():
    ap = argparse.ArgumentParser(); ap.add_argument('--seed', type=int, required=True); ap.add_argument('--out', required=True); ap.add_argument('--only', default=''); a = ap.parse_args(); S = a.seed
    os.makedirs(a.out, exist_ok=True); R = np.random.default_rng([S, 9]); todo = [('one', l[int(R.integers(len(l)))]) for l in ONE]+[('quiet', f) for f in QUIET]+[('two', l[int(R.integers(len(l)))]) for l in TWO]+[('outside', f) for f in OUT]+[('not-excited', f) for f in NEX]
    order = R.permutation(len(todo)); truth, priv, t00 = [], [], time.time()
    if a.only: t_ = todo; order = [i for i in order if a.only in (t_[i][1].__name__, t_[i][0])] if a.only != 'all' else order
    for k, i in enumerate(order):
        g, fn = todo[i]; name = f'whimbrel_{k:02d}'; t0 = time.time(); _, log, err, c, hv, read, near, z, J, ex, at, good = build(S, int(i), g, fn); r = np.random.default_rng([S, k, 3])
        fname = write(a.out, name, log, c, r)
        kind = {'arm': 'free' if c.get('free') else c.get('kind', ''), 'tester': 'tribometer' if c.get('tribo') else 'tester', 'joint': 'drive' if c['robot'] == 'drive' else 'joints'}[c['engine']]
        e = dict(case=name, group=g, kind=(c['robot']+'-'+kind) if c['robot'] in ROB else kind, model=','.join(c['model']), truth=[] if g == 'outside' else list(hv), near=near if g != 'outside' else [], values=values(c, hv), true_error=err, notes=f'{fn.__name__}' if g in ('outside',) else '')
        if g == 'outside': e['class'] = near
        truth.append(plain(e)); priv.append(plain(dict(case=name, fn=fn.__name__, c=c, hv=hv, read=read, nuis=z, attempt=at, good=bool(good), extra=ex, file=fname)))
        bl = {k2: round(v, 4) for k2, v in J['base'].items() if k2 in ('f', 'q', 'all', 'n', 't')}
        print(f"{name} {g:11s} {fn.__name__ if g!='quiet' else 'q'+str(i-22):10s} {kind:8s} T={c['T']:.0f} fs={c['fs']:.0f} rows={len(log['t'])} att={at} {'ok' if good else 'BAD'} ratio={ {a: round(v,2) for a,v in J['ratio'].items()} } {round(ex.get('outside_ratio',0),2)} base={bl} scale={round(J['scale'].get('all',J['scale'].get('f',0)),3)} err={err:.4g} enc={z['enc']:.1e} {time.time()-t0:.1f}s", flush=True)
    json.dump(truth, open(os.path.join(a.out, 'truth.json'), 'w'), indent=1); json.dump(priv, open(os.path.join(a.out, 'whimbrel_private.json'), 'w'))
    print('total', round(time.time()-t00, 1), 'bad', sum(not p['good'] for p in priv))
if __name__ == '__main__': main()
