"""Turns a draw (group, hidden effects, scene) into a contact log with its truth: sizing, noise, encoders, clocks, fits."""
import numpy as np
from contact import World, Fit, NORMAL, TANG, TOOL, SENS, CHAN, DT, lowpass
from law import LAW
from kin import Arm

OUTSIDE = {  # name: (honest partial descriptions in the catalogue, needs slides)
    'plastic-dent': ['hysteresis', 'stress-softening', 'surface-offset', 'stiffness-drift', 'stiffness-inhomogeneity', 'relaxation'],
    'ageing-friction': ['stribeck-friction', 'presliding', 'friction-rounding'],
    'ploughing': ['load-dependent-friction', 'coupled-stiffness', 'friction-anisotropy', 'stribeck-friction'],
    'snap-through': ['stiffening-layer', 'hertz-exponent', 'stress-softening', 'hysteresis'],
    'structural-resonance': ['sensor-lag', 'time-offset', 'tool-inertia', 'structural-compliance'],
    'warm-up': ['sensor-drift', 'sensor-bias'],
    'cable-pull': ['sensor-bias', 'tool-mass', 'tool-com', 'sensor-drift', 'sensor-misalignment', 'sensor-crosstalk'],
    'clock-skew': ['time-offset', 'sensor-lag'],
    'poroelastic': ['relaxation', 'viscous-damping', 'hunt-crossley-damping', 'hysteresis'],
    'puncture': ['stress-softening', 'stiffness-drift', 'stiffness-inhomogeneity', 'hysteresis'],
}
OUT_ARM = ['plastic-dent', 'ageing-friction', 'ploughing', 'snap-through', 'structural-resonance', 'warm-up', 'cable-pull', 'clock-skew']
OUT_TEST = ['plastic-dent', 'snap-through', 'poroelastic', 'puncture']
TORQUE_ONLY = ('tool-com', 'tool-inertia')
NEVER = {'tester': {'tool-mass', 'tool-com', 'tool-inertia', 'tip-offset', 'sensor-gain', 'sensor-misalignment', 'sensor-crosstalk',
                    'stiffness-inhomogeneity', 'friction-anisotropy'}}
NEAR = True
BASES = ['hooke', 'kelvin-voigt', 'hertz', 'hunt-crossley', 'zener', 'maxwell']
GOOD_BASE = {'hertz-exponent': ['hooke', 'kelvin-voigt', 'zener'], 'viscous-damping': ['hooke', 'hertz', 'zener'],
             'hunt-crossley-damping': ['hooke', 'hertz', 'zener'], 'relaxation': ['hooke', 'kelvin-voigt', 'hertz', 'hunt-crossley'],
             'stiffening-layer': ['hooke', 'kelvin-voigt', 'zener'], 'stress-softening': ['hooke', 'kelvin-voigt', 'hertz', 'hunt-crossley'],
             'hysteresis': ['hooke', 'kelvin-voigt', 'hertz', 'hunt-crossley'], 'structural-compliance': ['hertz'], 'surface-offset': ['hooke', 'kelvin-voigt', 'zener', 'hunt-crossley']}


def change(w, eff, s):
    """Put one effect of size s (about 1) into the world w; random directions are drawn once and kept."""
    rng = np.random.default_rng(w.eff_seed + sum(map(ord, eff)))
    u, sg = rng.uniform, rng.choice([-1, 1])
    L, D, F = w.law, w.D, w.F
    ke = F / D
    dirn = lambda k: (lambda x: x / np.linalg.norm(x))(rng.normal(size=k))
    if eff == 'hertz-exponent':
        n1 = 1 + .25 * s
        L.update(n=n1, k=w.law0['k'] * D ** (1 - n1))
    elif eff == 'viscous-damping': L['c'] = .12 * s * F / .02
    elif eff == 'hunt-crossley-damping': L['lam'] = 5. * s
    elif eff == 'relaxation': L.update(rho=.3 * s, tau=np.exp(u(np.log(.3), np.log(2.))))
    elif eff == 'hysteresis': L.update(hy_r=.12 * s, hy_l=u(.1, .25) * D)
    elif eff == 'stress-softening': L.update(ss_r=min(.25 * s, .7), ss_l=u(.1, .35) * D)
    elif eff == 'adhesion': L.update(ad_F=.15 * s * F, ad_l=u(3e-4, 7e-4))
    elif eff == 'stiffening-layer': L.update(st_d=u(.55, .75) * D, st_K=.8 * s * ke)
    elif eff == 'surface-offset': L['z0'] = sg * .05 * s * D
    elif eff == 'stiffness-drift': L['drift'] = sg * .2 * s * 60 / (w.prog.T)
    elif eff == 'stiffness-inhomogeneity':
        k = int(rng.choice([1, 2, 3]))
        L.update(ih_kind=k, ih_a=sg * .12 * s, ih_x=u(-.3, .3) * w.L if k < 3 else 0., ih_w=(u(.2, .5) if k < 3 else 1.) * w.L, ih_dir=0.)
    elif eff == 'coulomb-friction': L.update(mu=min(.12 * s, .9), ell=1e-4)
    elif eff == 'viscous-friction': L['cv'] = .15 * s * F / .03
    elif eff == 'stribeck-friction': L.update(st_mu=.15 * s, st_v=u(.006, .012))
    elif eff == 'presliding': L['ell'] = 8e-4 * s
    elif eff == 'friction-rounding': L['vr'] = 5e-3 * s
    elif eff == 'load-dependent-friction': L['p'] = max(1 - .2 * s, .35)
    elif eff == 'friction-anisotropy': L['an'] = sg * min(.18 * s, .6)
    elif eff == 'tool-mass': w.tool['dm'] = w.tv['dm'] = sg * .03 * s if sg > 0 or .03 * s < .5 * w.m_rig else .03 * s
    elif eff == 'tool-com':
        v = .006 * s * dirn(3)
        w.tool['dc'] = v
        w.tv.update(dcx=v[0], dcy=v[1], dcz=v[2])
    elif eff == 'tool-inertia':
        v = np.r_[u(.5, 1., 3), 0, 0, 0] * .002 * s
        w.tool['dI'] = v
        w.tv.update({f'I{i}': v[i] for i in range(6)})
    elif eff == 'structural-compliance': w.tool['C'] = w.tv['C'] = min(.12 * s, .5) * D / F
    elif eff == 'tip-offset':
        v = .003 * s * dirn(3) * [1, 1, .15]
        w.tool['off'] = v
        w.tv.update(ox=v[0], oy=v[1], oz=v[2])
    elif eff == 'sensor-bias':
        v = .06 * s * F * dirn(w.nch)
        v[3:] *= .05
        w.sens['bias'] = v
    elif eff == 'sensor-drift':
        v = .12 * s * F * dirn(w.nch) * 60 / w.prog.T
        v[3:] *= .05
        w.sens['drift'] = v
    elif eff == 'sensor-crosstalk':
        E = .05 * s * rng.normal(size=(6, 6))
        E[:3, 3:] *= 3
        E[3:, :3] *= .03
        np.fill_diagonal(E, 0)
        w.sens['E'] = E
    elif eff == 'sensor-misalignment':
        v = .06 * s * dirn(3)
        w.sens['ph'] = v
        w.tv.update(ph0=v[0], ph1=v[1], ph2=v[2])
    elif eff == 'sensor-gain': w.sens['gain'] = w.tv['gain'] = sg * .08 * s
    elif eff == 'sensor-lag': w.sens['lag'] = w.tv['lag'] = .02 * s
    elif eff == 'time-offset': w.sens['delay'] = w.tv['delay'] = sg * .02 * s
    elif eff == 'saturation': w.clip_frac = max(1 - .3 * s, .25)
    elif eff == 'quantization': w.qfrac = .16
    elif eff == 'mains-hum': w.sens['hum'] = (float(rng.choice([50., 60.])), .1 * s * F * np.r_[dirn(3), .03 * dirn(3)][:w.nch] if w.nch > 2 else .12 * s * F * dirn(w.nch), u(0, 6))
    # outside the catalogue
    elif eff == 'plastic-dent': L.update(dent_r=.12 * s * D / F, dent_F=.35 * F)
    elif eff == 'ageing-friction': L.update(age_b=.35 * s, age_t=.05)
    elif eff == 'ploughing': L['pl_c'] = .35 * s * L['mu'] * F / D
    elif eff == 'snap-through': L.update(snap_F=.25 * s * F, snap_d=.55 * D, snap_w=.25 * D)
    elif eff == 'structural-resonance': w.sens['reson'] = (u(8., 14.) / s ** .5, u(.02, .06))
    elif eff == 'warm-up':
        v = .12 * s * F * dirn(w.nch)
        v[3:] *= .04
        w.sens['warm'] = (u(4., 9.), v)
    elif eff == 'cable-pull':
        hk = w.P0 + .25 * dirn(3) + w.n * .1
        w.out['cable'] = (s * .1 * F / .01, hk, rng.uniform(-.05, .05, 3))
    elif eff == 'clock-skew': w.skew = sg * 6e-4 * s
    elif eff == 'poroelastic': L['poro'] = .5 * s
    elif eff == 'puncture': L.update(punct_F=.8 * F, punct_r=.3 * s)
    else: raise KeyError(eff)


def setup(w, sizes):
    w.law, w.sens, w.tool, w.out, w.tv = dict(w.law0), dict(w.sens0), {}, {}, {}
    w.clip_frac = w.qfrac = None
    w.skew = 0.
    for e, s in sizes.items():
        change(w, e, s)
    unreach = w.opt.get('unreached')
    if unreach == 'stiffening-layer':
        w.law['st_d'] = 1.6 * w.D
    elif unreach == 'saturation':
        w.clip_frac = 1.35
    elif unreach in ('coulomb-friction', 'viscous-friction'):
        w.jig = w.jig * .02
    w.run()
    ref = np.abs(w.y)
    if w.clip_frac:
        j = int(np.argmax(np.sqrt((w.y[:, :3] ** 2).mean(0)))) if not w.tester else 0
        w.sens['clip'] = (j, float(ref[:, j].max() * w.clip_frac))
    if w.qfrac:
        w.sens['step'] = float(np.sqrt((w.y[:, :3 if not w.tester else w.nch] ** 2).mean()) * w.qfrac)
    return w


def finish(w, y, rng, nf, nt):
    n = y + rng.normal(size=y.shape) * np.r_[np.full(3, nf), np.full(3, nt)][:y.shape[1]]
    if 'clip' in w.sens:
        j, lim = w.sens['clip']
        n[:, j] = np.clip(n[:, j], -lim, lim)
        if w.clip_after:
            n[:, j] += rng.normal(size=len(n)) * nf
    if 'step' in w.sens:
        st = np.r_[np.full(3, w.sens['step']), np.full(3, w.sens['step'] * .03)][:y.shape[1]]
        n = np.round(n / st) * st
    return n


def quick(w):
    """Clean readings on a coarse grid with perfect encoders: for sizing."""
    t = np.arange(0.01, w.prog.T - .02, 1 / 300.)
    P, R = w.view(t)
    y = finish(w, w.read(t * (1 + w.skew)), np.random.default_rng(0), 0, 0)
    rf = np.sqrt((y[:, :3] ** 2).mean()) if not w.tester else np.sqrt((y ** 2).mean())
    return Fit(w, t, P, R, y, np.r_[np.full(3, .01 * rf), np.full(3, .0003 * rf)][:w.nch])


def share(f, r, hidden):
    rf, rt = f.rms()
    if hidden and all(h in TORQUE_ONLY for h in hidden):
        return r['et'] / rt
    return r['ef'] / rf


def build(rng, group, hidden, spec, log=print):
    """spec: robot kind or 'tester', base, friction known, options. Returns dict with the log's arrays and its truth, or None."""
    tester = spec['robot'] == 'tester'
    arm = None if tester else Arm(spec['robot'], rng)
    w = World(rng, arm, tester, spec['opt'])
    w.eff_seed, w.hidden, w.clip_after = int(rng.integers(1 << 30)), list(hidden), bool(rng.random() < .5)
    w.nch = 6 if not tester else (2 if spec['opt'].get('slides') else 1)
    w.tv, w.sens0 = {}, {}
    w.set_base(spec['base'], rng.uniform(.2, .7) if spec['friction'] else 0., spec['fkind'])
    exact_base = w.ncol == 1
    if rng.random() < .35 and spec['base'] not in ('maxwell',) and group != 'not-excited':   # a small second relaxation
        w.law.update(rho2=rng.uniform(.002, .006), tau2=rng.uniform(.1, 3.))
    if rng.random() < .3:
        w.sens0['nl'] = rng.uniform(-.006, .006)
    if rng.random() < .4:
        v = rng.normal(size=w.nch) * .0015 * w.F
        v[3:] *= .03
        w.sens0['drift'] = v
    w.law0 = dict(w.law)
    model = [spec['base']] + (['coulomb-friction'] if spec['friction'] else [])
    outs = [h for h in hidden if h in OUTSIDE]
    known = [h for h in hidden if h not in OUTSIDE]
    excited = group in ('one', 'two', 'outside')
    sizes = {h: 1. for h in hidden}
    target = rng.uniform(.05, .10)
    if group == 'not-excited':
        sizes = spec['sizes']
    if excited:
        for h in hidden:                      # size each alone
            for it in range(4):
                setup(w, {h: sizes[h]})
                w.hidden = [h]
                f = quick(w)
                sh = share(f, f.fit(model, 15), [h])
                if h == 'quantization' or abs(np.log(sh / target)) < .2:
                    break
                sizes[h] *= np.clip((target / max(sh, 1e-4)) ** (.8 if h not in ('saturation',) else .4), .3, 3.)
        w.hidden = list(hidden)
    setup(w, sizes)
    f = quick(w)
    rf, rt = f.rms()
    sig0 = f.sig
    if excited:
        e0 = f.fit(model, 20)['e']
        e1 = 0. if outs else (f.fit(model + known, 25)['e'] if 'quantization' not in hidden else .2)
        parts = [f.fit(model + [k for k in known if k != h], 20)['e'] for h in known] if len(known) > 1 else [e0]
        lo = min(parts)
        r = rng.uniform(3., 4.5) if len(hidden) > 1 else rng.uniform(3.5, 7.)
        s2 = (lo ** 2 - r * r * e1 ** 2) / (r * r - 1)
        if s2 < (.1 * lo) ** 2 and not outs:
            r = 2.8
            s2 = max((lo ** 2 - r * r * e1 ** 2) / (r * r - 1), (.08 * lo) ** 2)
        nu = np.sqrt(s2)
    else:
        nu = rng.uniform(.2, 1.5)
    nf, nt = nu * sig0[0], nu * .03 * sig0[0]
    # --- the log: rates, jitter, drops, encoders, clocks
    rate = float(rng.choice([250, 500, 500, 500, 1000, 1000]) if not tester else rng.choice([100, 200, 500, 1000]))
    if 'mains-hum' in hidden:
        rate = max(rate, 250.)
    if w.prog.T > 90:
        rate = min(rate, 250.)
    t = np.arange(0.01, w.prog.T - .02, 1 / rate)
    if rng.random() < .5:
        t = t + rng.uniform(-.1, .1, len(t)) / rate
    if rng.random() < .4:
        t = t[rng.random(len(t)) > rng.uniform(.001, .01)]
    clk = rng.uniform(-3e-4, 3e-4)
    y = finish(w, w.read(t * (1 + w.skew) + clk), rng, nf, nt)
    P, R = w.view(t)
    cols = {'t': t - t[0] * 0}
    if tester:
        res = np.exp(rng.uniform(np.log(1e-7), np.log(1e-6)))
        dep = np.round(-(P @ w.n) / res) * res
        cols['depth'] = dep
        z = P.copy()
        z[:, 2] = -dep
        if w.nch == 2:
            s = np.round(P[:, 0] / 2e-6) * 2e-6
            z[:, 0] = s
            cols['slip1'] = s
        cols['normal_force'] = y[:, 0]
        if w.nch == 2:
            cols['tangential_force1'] = y[:, 1]
        P, q = z, None
    else:
        q, worst = arm.ik(t, P, R)
        if worst > 1e-8:
            log('  ik failed')
            return None
        fine = 2. ** spec.get('att', 0) * (4. if 'hysteresis' in hidden or 'presliding' in hidden else 1.)
        res = max(np.exp(rng.uniform(np.log(2e-6), np.log(8e-6))) / fine, 2e-6)
        q = np.round(q / res) * res
        P, R = arm.fk(q)
        for i in range(arm.n):
            cols[f'q{i+1}'] = q[:, i]
        if rng.random() < .4:                 # some controllers log a velocity: biased, filtered, late
            tu = np.arange(t[0], t[-1], 1 / rate)
            qq = np.column_stack([np.interp(tu, t, q[:, i]) for i in range(arm.n)])
            v = np.gradient(lowpass(qq, rate, rng.uniform(20, 60)), 1 / rate, axis=0) + rng.uniform(-1, 1, arm.n) * 1.5e-4
            for i in range(arm.n):
                cols[f'dq{i+1}'] = np.interp(t - rng.uniform(0, .003), tu, v[:, i])
        for j, c in enumerate(CHAN):
            cols[c] = y[:, j]
    sig = np.r_[np.full(3, max(nf, 1e-4 * rf)), np.full(3, max(nt, 3e-6 * rf))][:w.nch]
    F = Fit(w, t, P, R, y, sig)
    b = F.fit(model, 25)
    rf, rt = F.rms()
    res_ = dict(w=w, cols=cols, arm=arm, model=model, hidden=hidden, group=group, base_fit=b, nf=nf, nt=nt, sizes=sizes, near=[])
    ok = True
    if known and group in ('one', 'two'):
        tr = F.fit(model + known, 35)
        et = tr['e'] if 'quantization' not in hidden else max(nf / sig[0], 1e-9)
        sh = share(F, b, hidden)
        ratio = b['e'] / max(et, 1e-9)
        parts = [F.fit(model + [k for k in known if k != h], 20)['e'] / et for h in known] if len(known) > 1 else []
        ok = 2. <= ratio <= 9. and sh > .035 and (not parts or min(parts) > 1.6)
        res_.update(true=tr, ratio=ratio, share=sh, parts=parts)
        if ok and group == 'one' and NEAR:
            cand = [c for c in (NORMAL + (TANG if spec['friction'] or w.law.get('mu') else []) + (TOOL if not tester else []) + SENS)
                    if c not in hidden and c not in ('quantization', 'saturation') and c not in model and not (tester and c in NEVER['tester'])]
            k = max(1, int(rate / 250))
            F2 = Fit(w, t[::k], P[::k], R[::k], y[::k], sig, sub=1200)
            e2 = F2.fit(model + known, 15)['e']
            for c in cand:
                try:
                    if F2.fit(model + [c], 10)['e'] < 1.15 * e2:
                        res_['near'].append(c)
                except Exception:
                    pass
        if parts and min(parts) < 1.15:
            ok = False
    elif group == 'outside':
        sh = b['ef'] / rf
        ratio = b['e']
        ok = sh > .03 and ratio > 1.8
        res_.update(true=b, ratio=ratio, share=sh)
    else:
        exc = np.sqrt(max(b['ef'] ** 2 - nf ** 2, 0))
        ok = exc < max(.011 * rf, .55 * nf)
        if group == 'not-excited':
            try:
                wt = F.fit(model + [k for k in hidden if k not in ('saturation',)], 20)['e'] if hidden[0] != 'saturation' else b['e']
                ok = ok and b['e'] < 1.05 * wt
            except Exception:
                pass
        res_.update(true=b, ratio=1., share=exc / rf)
    if res_['true']['ef'] > 0 and group in ('one', 'two') and 'quantization' in hidden:
        res_['true'] = dict(res_['true'], ef=nf)
    res_['ok'] = bool(ok)
    res_['values'] = values(w, model, known, exact_base and not w.law.get('rho2'), res_)
    return res_


def values(w, model, known, exact, r):
    """True numbers, written only where the log follows exactly that form."""
    L, v = w.law, {}
    nl = 'nl' in w.sens0
    b = w.base
    vague = {'stiffness-inhomogeneity', 'hysteresis', 'adhesion'} & set(known)      # here a base's number depends on how the effect is written
    if exact and not nl and r['group'] != 'outside' and not vague:
        if b in ('hooke', 'kelvin-voigt') and 'hertz-exponent' not in known:
            v[b + '.stiffness'] = L['k']
            if b == 'kelvin-voigt':
                v[b + '.damping'] = L['c']
        elif b == 'hertz':
            v['hertz.stiffness'] = L['k']
        elif b == 'hunt-crossley':
            v.update({'hunt-crossley.stiffness': L['k'], 'hunt-crossley.damping': L['B'], 'hunt-crossley.exponent': L['n']})
        elif b == 'zener' and 'hertz-exponent' not in known:
            v.update({'zener.stiffness': L['k'], 'zener.branch-ratio': L['rho'], 'zener.time-constant': L['tau']})
        elif b == 'maxwell':
            v.update({'maxwell.stiffness': L['k'], 'maxwell.time-constant': L['tau']})
    if L.get('mu') and w.fkind in ('dahl', 'prandtl') and not nl and 'load-dependent-friction' not in known and r['group'] != 'outside':
        v['coulomb-friction.coefficient'] = L['mu']
    one = {'hertz-exponent': ('exponent', 'n'), 'viscous-damping': ('damping', 'c'), 'hunt-crossley-damping': ('damping', 'lam'),
           'surface-offset': ('offset', 'z0'), 'stiffness-drift': ('rate', 'drift'), 'viscous-friction': ('damping', 'cv'),
           'presliding': ('length', 'ell'), 'friction-rounding': ('speed', 'vr'), 'friction-anisotropy': ('ratio', 'an'),
           'structural-compliance': ('compliance', None), 'sensor-gain': ('gain', None), 'sensor-lag': ('time-constant', None), 'time-offset': ('delay', None)}
    for h in known:
        if r['group'] == 'not-excited':
            continue
        if h in one:
            p, k = one[h]
            x = L[k] if k else w.tv[{'structural-compliance': 'C', 'sensor-gain': 'gain', 'sensor-lag': 'lag', 'time-offset': 'delay'}[h]]
            if exact or h in ('sensor-lag', 'time-offset', 'presliding', 'friction-rounding', 'stiffness-drift'):
                v[f'{h}.{p}'] = x
        elif h == 'relaxation' and exact:
            v.update({h + '.ratio': L['rho'], h + '.time-constant': L['tau']})
        elif h == 'stress-softening' and exact:
            v.update({h + '.ratio': L['ss_r'], h + '.length': L['ss_l']})
        elif h == 'stiffening-layer' and exact:
            v.update({h + '.stiffness': L['st_K'], h + '.depth': L['st_d']})
        elif h == 'stribeck-friction' and w.fkind in ('dahl', 'prandtl'):
            v.update({h + '.coefficient': L['st_mu'], h + '.speed': L['st_v']})
        elif h == 'tip-offset':
            v.update({f'{h}.offset[{a}]': x for a, x in zip('xyz', w.tool['off'])})
        elif h == 'tool-mass' and not nl:
            v['tool-mass.mass'] = w.m + w.tool['dm'] - w.m_rig
        elif h == 'tool-com' and not nl:
            v.update({f'tool-com.com[{a}]': x for a, x in zip('xyz', w.c + w.tool['dc'] - w.c_rig)})
        elif h == 'tool-inertia' and not nl:
            v.update({f'tool-inertia.inertia[{a}]': x for a, x in zip(('xx', 'yy', 'zz', 'xy', 'xz', 'yz'), w.tool['dI'])})
        elif h == 'sensor-misalignment':
            v.update({f'{h}.rotation[{a}]': x for a, x in zip('xyz', w.sens['ph'])})
        elif h in ('sensor-bias', 'sensor-drift') and 'drift' not in w.sens0:
            key, nm = ('bias', 'offset') if h == 'sensor-bias' else ('drift', 'drift')
            ch = CHAN if not w.tester else ['normal_force', 'tangential_force1']
            v.update({f'{h}.{nm}[{c}]': x for c, x in zip(ch, w.sens[key])})
        elif h == 'saturation' and not nl:
            j, lim = w.sens['clip']
            v[f'{h}.limit[{(CHAN if not w.tester else ["normal_force"])[j]}]'] = lim
        elif h == 'quantization':
            for j, c in enumerate(CHAN if not w.tester else ['normal_force', 'tangential_force1'][:w.nch]):
                v[f'{h}.step[{c}]'] = w.sens['step'] * (1 if j < 3 else .03)
    return {k: float(x) for k, x in v.items()}
