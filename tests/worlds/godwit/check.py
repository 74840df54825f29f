"""check.py DATA: do the files keep the contract? Own kinematics through Pinocchio, no fits."""
import json, os, sys, tomllib
import numpy as np
import pinocchio as pin
import pyarrow.parquet as pq, pyarrow.csv as pc

NAMES = set('''hertz-exponent viscous-damping hunt-crossley-damping relaxation hysteresis stress-softening adhesion stiffening-layer surface-offset
stiffness-drift stiffness-inhomogeneity coulomb-friction viscous-friction stribeck-friction presliding friction-rounding load-dependent-friction
friction-anisotropy tool-mass tool-com tool-inertia structural-compliance tip-offset joint-coulomb-friction joint-viscous-friction joint-friction-asymmetry
joint-torque-offset rotor-inertia joint-torque-gain payload joint-elasticity gravity-error joint-stribeck-friction joint-load-friction joint-torque-ripple
joint-spring sensor-bias sensor-drift sensor-crosstalk sensor-misalignment sensor-gain sensor-lag time-offset saturation quantization mains-hum
coupled-stiffness surface-tilt hooke kelvin-voigt hertz hunt-crossley maxwell zener rigid-body none'''.split())
WANT = {'quiet': 9, 'one': 22, 'two': 7, 'outside': 6, 'not-excited': 4}
CH = ['fx', 'fy', 'fz', 'tx', 'ty', 'tz']


def load_robot(d, rb):
    m = rb['model']
    if m == 'lwr4plus':
        from kin import Arm
        return Arm('lwr4plus').full
    if m.endswith('.urdf'):
        return pin.buildModelFromUrdf(os.path.join(d, m))
    import example_robot_data as erd
    return erd.load(m).model


def main(data):
    truth = json.load(open(os.path.join(data, 'truth.json')))
    bad = []

    def need(c, case, msg):
        if not c:
            bad.append(f'{case}: {msg}')
    cnt = {}
    seen = []
    for T in truth:
        cs, d = T['case'], os.path.join(data, T['case'])
        cnt[T['group']] = cnt.get(T['group'], 0) + 1
        if T['group'] == 'one':
            seen += T['truth']
        for n in T['truth'] + T['near'] + T.get('class', []) + T['model'].split(','):
            need(n in NAMES, cs, f'unknown name {n}')
        need(all(k.split('.')[0] in NAMES and np.isfinite(v) for k, v in T['values'].items()), cs, 'values')
        need('class' in T if T['group'] == 'outside' else True, cs, 'no class')
        need((len(T['truth']) == {'one': 1, 'two': 2, 'not-excited': 1}.get(T['group'], 0)), cs, 'truth count')
        f = [os.path.join(d, x) for x in ('log.parquet', 'log.csv') if os.path.exists(os.path.join(d, x))]
        need(len(f) == 1, cs, 'one log expected')
        tab = pq.read_table(f[0]) if f[0].endswith('parquet') else pc.read_csv(f[0])
        rig = tomllib.load(open(os.path.join(d, 'rig.toml'), 'rb'))
        c = {n: tab[n].to_numpy() for n in tab.column_names}
        t = c['t']
        need(np.all(np.diff(t) > 0), cs, 't not increasing')
        need(all(np.all(np.isfinite(v)) for k, v in c.items() if k != 'phase'), cs, 'not finite')
        need(4 < t[-1] - t[0] < 620 and 40 < 1 / np.median(np.diff(t)) < 2100, cs, 'length or rate')
        if 'robot' not in rig:
            need(('depth' in c and 'normal_force' in c) or ('q1' in c and 'tau1' in c), cs, 'columns of a tester or drive')
            if 'depth' in c:
                i = c['depth'] > .6 * c['depth'].max()
                need(c['normal_force'][i].mean() > 0, cs, 'normal force sign')
            continue
        m = load_robot(d, rig['robot'])
        names = rig['robot'].get('joints') or list(m.names)[1:]
        n = len(names)
        need(all(f'q{i+1}' in c for i in range(n)) and f'q{n+1}' not in c, cs, 'joint columns')
        iq = [m.joints[m.getJointId(x)].idx_q for x in names]
        q = np.zeros(m.nq)
        need(m.existFrame(rig['robot']['sensor_frame']) and m.existFrame(rig['robot']['tip_frame']), cs, 'frames')
        dat = m.createData()
        Q = np.stack([c[f'q{i+1}'] for i in range(n)], 1)
        lo, hi = m.lowerPositionLimit[iq], m.upperPositionLimit[iq]
        need(np.all(Q > lo - .3) and np.all(Q < hi + .3), cs, 'joint limits')
        if 'tau1' in c:
            # still start: tau against gravity, loosely
            k = int(np.argmin(np.abs(np.gradient(Q, t, axis=0)).max(1)))
            q[iq] = Q[k]
            g = pin.computeGeneralizedGravity(m, dat, q)[[m.joints[m.getJointId(x)].idx_v for x in names]]
            y = np.array([c[f'tau{i+1}'][k] for i in range(n)])
            need(np.linalg.norm(y - g) < .6 * max(np.linalg.norm(g), np.linalg.norm(y)) + 2, cs, f'gravity torque {y.round(2)} against {g.round(2)}')
            continue
        W = np.stack([c[x] for x in CH], 1)
        nrm = np.array(rig['surface']['normal'])
        tan = np.array(rig['surface']['tangent'])
        need(abs(np.linalg.norm(nrm) - 1) < 1e-6 and abs(nrm @ tan) < 1e-6, cs, 'surface axes')
        g = np.array(rig['robot'].get('gravity', [0, 0, -9.81]))
        fs, ft = m.getFrameId(rig['robot']['sensor_frame']), m.getFrameId(rig['robot']['tip_frame'])
        pick = np.linspace(0, len(t) - 1, 4000).astype(int)
        dep, fb, fair, tair, tcon = [], [], [], [], []
        mt, ct = rig['tool']['mass'], np.array(rig['tool']['com'])
        for k in pick:
            q[iq] = Q[k]
            pin.framesForwardKinematics(m, dat, q)
            S, P = dat.oMf[fs], dat.oMf[ft]
            w_air = mt * S.rotation.T @ g
            dep.append(-(P.translation - rig['surface']['point']) @ nrm)
            fb.append(S.rotation @ (W[k, :3] - w_air) @ nrm)
            fair.append(W[k, :3] - w_air)
            tair.append(W[k, 3:] - np.cross(ct, w_air))
            rt = S.rotation.T @ (P.translation - S.translation)
            tcon.append(W[k, 3:] - np.cross(ct, w_air) - np.cross(rt, W[k, :3] - w_air))
        dep, fb, fair, tair, tcon = map(np.array, (dep, fb, fair, tair, tcon))
        a, b = dep < -.002, dep > .5 * dep.max()
        rf = np.sqrt((W[:, :3] ** 2).mean())
        need(dep.max() > .001, cs, f'never touches (max depth {dep.max():.4f})')
        need(fb[b].mean() > .3 * rf, cs, 'normal force sign')
        hid = ' '.join(T['truth']) + T['notes']
        if not any(x in hid for x in ('tool-', 'sensor-', 'hum', 'warm', 'cable', 'quantization')):
            ra = np.sqrt((fair[a] ** 2).mean())
            # accelerations of the free phases and the noise remain
            need(ra < .15 * rf + .1, cs, f'air reads {ra:.3f} N off m Rᵀ g (rms reading {rf:.2f})')
            need(np.sqrt((tcon[b] ** 2).mean()) < .2 * np.sqrt((tair[b] ** 2).mean()) + .02 * rf * .3 or 'tip-offset' in hid, cs, 'moments are not r × f')
    if len(truth) == 48:
        need(cnt == WANT, 'all', f'counts {cnt}')
        need(len(set(seen)) == len(seen), 'all', 'an effect twice in one')
    print('\n'.join(bad) if bad else 'all fine', f'\n{len(truth)} cases, {cnt}')
    sys.exit(bool(bad))


main(sys.argv[1])
