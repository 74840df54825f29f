#!/usr/bin/env python
"""World 'kestrel': 48 blind logs (own Newton-Euler arms, MDR contact, presses, drives). generate.py --seed N --out OUT"""
import argparse, json, os, sys, time
os.environ.setdefault('OMP_NUM_THREADS', '1'); os.environ.setdefault('OPENBLAS_NUM_THREADS', '1')
sys.path.insert(0, os.path.dirname(os.path.abspath(__file__)))
import numpy as np
from scipy.interpolate import CubicSpline
from scipy.spatial.transform import Rotation as Rot
from scipy.signal import lfilter
import sim, ref

CHAN = ['fx', 'fy', 'fz', 'tx', 'ty', 'tz']
ATI = np.array([.015, .015, .029, .0005, .0006, .0003])

# ------------------------------------------------------------------ helpers
def lp(x, dt, tau):
    if tau <= 0: return x
    a = 1 - np.exp(-dt/tau); x0 = x[:1]
    return lfilter([a], [1, -(1-a)], x - x0, axis=0) + x0

def stamps(rng, T, fs, nu):
    t = np.arange(int(T*fs))/fs
    if nu.get('jitter'): t = t + rng.uniform(-nu['jitter'], nu['jitter'], t.size)/fs
    t = np.clip(t, 0, T); t = np.maximum.accumulate(t)
    if nu.get('drop'): t = t[rng.random(t.size) > nu['drop']]
    return t[np.r_[True, np.diff(t) > 1e-6]]

def interp(t, ti, X):
    X = np.asarray(X)
    if X.ndim == 1: return np.interp(t, ti, X)
    return np.stack([np.interp(t, ti, X[:, j]) for j in range(X.shape[1])], 1)

def rnd(x, q): return np.round(x/q)*q

def save(path, cols, fmt):
    if fmt == 'parquet':
        import pyarrow as pa, pyarrow.parquet as pq
        pq.write_table(pa.table({k: (list(map(str, v)) if k == 'phase' else np.asarray(v, float)) for k, v in cols.items()}), path, compression='zstd')
    else:
        num = [k for k in cols if k != 'phase']; ft = []
        for k in num: ft.append('%.6f' if k == 't' else '%.7g' if k[0] in 'q' else '%.6g')
        ft = ['%.9g' if k.startswith('q') and not k.startswith('q_') else f for k, f in zip(num, ft)]
        A = np.stack([cols[k] for k in num], 1)
        with open(path, 'w') as f:
            f.write(','.join(num + (['phase'] if 'phase' in cols else [])) + '\n')
            row = ','.join(ft)
            if 'phase' in cols:
                for r, p in zip(A, cols['phase']): f.write(row % tuple(r) + ',' + str(p) + '\n')
            else:
                f.write('\n'.join(row % tuple(r) for r in A)); f.write('\n')

def arr(v): return '[' + ', '.join(f'{float(x):.9g}' for x in v) + ']'

def nuis(rng, **kw):
    """the ordinary faults of a rig, drawn per log"""
    n = dict(jitter=float(rng.choice([0, .05, .15])), drop=float(rng.choice([0, 0, .003, .01])), enc=float(rng.choice([2e-6, 5e-6, 1e-5, 2e-5])),
             dq=str(rng.choice(['none', 'filtered', 'biased', 'none'])), dqf=float(rng.uniform(20, 60)), clock=float(rng.choice([0, 0, rng.uniform(-.0012, .0012)])),
             nonlin=float(rng.choice([0, rng.uniform(.002, .008)])), tdrift=float(rng.choice([0, rng.uniform(-.02, .02)])), noise=float(rng.uniform(.8, 1.6)),
             toolerr=float(rng.choice([0, rng.uniform(-.012, .012)])), level=float(rng.choice([0, rng.uniform(.1, 1.5)])), stated=bool(rng.random() < .5), phase=bool(rng.random() < .5),
             fmt=str(rng.choice(['csv', 'parquet'])), friction=str(rng.choice(['dahl', 'dahl', 'gms'])))
    n.update(kw); return n

# ------------------------------------------------------------------ press, tribometer
def segments(dt, segs, z0=-1e-3, x0=0.):
    """segs: (duration, z, x[, phase]) minimum-jerk-less: straight ramps rounded by the drive's lag of 15 ms"""
    Z, X, PH = [], [], []
    z, x = z0, x0
    for s in segs:
        n = max(2, int(s[0]/dt)); u = np.arange(1, n+1)/n
        Z.append(z + (s[1]-z)*u); X.append(x + (s[2]-x)*u); PH += [s[3] if len(s) > 3 else 'free']*n
        z, x = s[1], s[2]
    z = np.concatenate(Z); x = np.concatenate(X)
    for _ in range(2): z = lp(z, dt, .015); x = lp(x, dt, .015)
    return np.arange(z.size)*dt, z, x, np.array(PH)

def press_case(rng, out, segs, bed, P, base, hidden, fs, nu, trib=False, sig=.01, mods=None, dt=5e-4, extra=None, qz=1e-6):
    mods = mods or {}
    t, z, x, ph = segments(dt, segs)
    vz = np.gradient(z, dt); vx = np.gradient(x, dt)
    if nu['friction'] == 'elasto-plastic': P[sim.EP] = .3
    if nu['friction'] == 'gms': P[sim.SPREAD] = .25
    F = sim.press(t, z, vz, x, vx, P, *bed)
    N = F[:, 0]; Tg = F[:, 1]
    if extra: N, Tg = extra(t, N, Tg)
    cell = rng.uniform(.0006, .002); N = lp(N, dt, cell); Tg = lp(Tg, dt, cell)          # amplifier of the load cell
    ts = stamps(rng, t[-1], fs, nu)
    n = interp(ts, t, N); T = interp(ts, t, Tg)
    n = n*(1 + nu['nonlin']*(n/np.abs(N).max() - .5)) + nu['tdrift']*ts/60 + sig*nu['noise']*rng.normal(size=ts.size)
    T = T + sig*nu['noise']*rng.normal(size=ts.size)
    if 'lim' in mods: n = np.minimum(n, mods['lim'])
    d = rnd(interp(ts, t, z) + 3e-7*rng.normal(size=ts.size), qz); X = rnd(interp(ts, t, x), 2e-6)
    c = dict(t=ts, depth=d, normal_force=rnd(n, 1e-3))
    if nu['dq'] != 'none':
        v = interp(ts, t, lp(vz, dt, 1/(2*np.pi*nu['dqf'])) if nu['dq'] == 'filtered' else vz + 2e-6)
        c['depth_rate'] = v + 2e-6*rng.normal(size=ts.size)
    if trib: c['slip1'] = X; c['tangential_force1'] = rnd(T, 1e-3)
    if nu['phase']: c['phase'] = ph[np.clip(np.searchsorted(t, ts), 0, ph.size-1)]
    os.makedirs(out, exist_ok=True)
    save(f'{out}/log.{nu["fmt"]}', c, nu['fmt'])
    rig = '# material tester: depth from the crosshead, force from a load cell\n[surface]\npoint = [0.0, 0.0, 0.0]\nnormal = [0, 0, 1]\ntangent = [1, 0, 0]\n'
    if nu['stated']: rig += f'\n[sensor]\nnoise = {arr([sig*nu["noise"]]*3 + [1e-3]*3)}\n'
    open(f'{out}/rig.toml', 'w').write(rig)
    return base, hidden

# ------------------------------------------------------------------ arm with wrench
def keyframes(dt, keys):
    """keys: (duration, x, y, z, rx, ry, rz, phase): minimum-jerk between them"""
    cur = np.zeros(6); cur[2] = -.003; out = []; ph = []
    for k in keys:
        n = max(2, int(k[0]/dt)); u = np.arange(1, n+1)/n; s = 10*u**3 - 15*u**4 + 6*u**5
        if k[7] == 'slide':      # even speed, rounded over 80 ms at the ends
            b = min(.45, .08/k[0]); s = np.where(u < b, u*u/2/b, np.where(u > 1-b, 1-b-(1-u)**2/2/b, u-b/2))/(1-b)
        nxt = np.array(k[1:7], float)
        out.append(cur + (nxt-cur)*s[:, None]); ph += [k[7]]*n; cur = nxt
    return np.concatenate(out), np.array(ph)

def arm_case(rng, out, arm, path, ph, dt, bed, P, base, hidden, fs, nu, mode=1, Kc=(2500., 150.), Kq=None, tool=(.3, (0, 0, .05)), inertia=None, tipoff=(0, 0, 0), sens=None,
             surface=True, rate_hold=None, static=None, tip=(0, 0, .11), hose=None, gainflip=None):
    sens = sens or {}
    A = sim.arm_lwr() if arm == 'lwr' else sim.arm_kestrel()
    n = len(A['m'])
    sxyz = np.array([0, 0, rng.uniform(.03, .05)]); yaw = rng.uniform(-.6, .6); tip = np.array(tip, float)
    Rz = Rot.from_euler('z', yaw).as_matrix()
    os.makedirs(out, exist_ok=True); sim.write_urdf(A, sxyz, yaw, tip, f'{out}/robot.urdf')
    fs_in = A['flange'] + sxyz
    ptip = fs_in + Rz @ tip; ptrue = fs_in + Rz @ (tip + np.array(tipoff))
    q0 = A['q0'] + rng.uniform(-.08, .08, n)
    O, Z, R = sim.fk(q0, A['p'], A['ax'])
    p0 = O[-1] + R[-1] @ ptip; R0 = R[-1] @ Rz
    nrm = -R0[:, 2] if rng.random() < .4 else np.array([0, 0, 1.])
    nrm = np.round(nrm, 5); nrm = nrm/np.linalg.norm(nrm)
    # tool axis along -normal at the start
    zt = -nrm; xt = R0[:, 0] - (R0[:, 0] @ zt)*zt; xt /= np.linalg.norm(xt); R0 = np.stack([xt, np.cross(zt, xt), zt], 1)
    t1 = np.array([1., 0, 0]) if abs(nrm[0]) < .8 else np.array([0, 1., 0]); t1 = t1 - (t1 @ nrm)*nrm; t1 /= np.linalg.norm(t1); t2 = np.cross(nrm, t1)
    sp = np.round(p0, 5)
    joint_path = ph is not None and ph[0] == 'free' and len(set(ph[::50])) == 1 and not surface
    ti = np.arange(len(path))*dt
    if joint_path: cs = CubicSpline(ti[::8], path[::8] + q0); qr = cs(ti); dqr = cs(ti, 1)
    else:
        k = max(1, int(.004/dt)); sc = 1.
        for _ in range(4):
            pk = np.concatenate([path[::k], path[-1:]])*np.array([1, 1, 1, sc, sc, sc])
            pos = sp + pk[:, :1]*t1 + pk[:, 1:2]*t2 - pk[:, 2:3]*nrm
            rv = pk[:, 3:4]*t1 + pk[:, 4:5]*t2 + pk[:, 5:6]*nrm
            Rd = Rot.from_rotvec(rv).as_matrix() @ R0
            qk = sim.ik_path(q0, pos, np.ascontiguousarray(Rd), A['p'], A['ax'], Rz, ptip)
            if np.abs(np.diff(qk, axis=0)).max() < .015: break
            sc *= .75
        else: raise RuntimeError('path out of reach ' + out)
        tk = np.r_[np.arange(0, len(path), k)*dt, (len(path)-1)*dt + 1e-9]
        cs = CubicSpline(tk[:len(qk)], qk); qr = cs(ti); dqr = cs(ti, 1)
    lev = nu['level']*np.pi/180
    grav = Rot.from_rotvec(lev*np.array([np.cos(1.1), np.sin(1.1), 0])).as_matrix() @ np.array([0, 0, -9.81])
    if lev and not nu['stated']: lev_ = np.deg2rad(.2); grav = Rot.from_rotvec(lev_*np.array([.5, .8, 0])).as_matrix() @ np.array([0, 0, -9.81]); nu['level'] = .19
    # tool into the last link for the dynamics
    m, c, I = A['m'].copy(), A['c'].copy(), A['I'].copy()
    mt, ct = tool[0], np.array(tool[1], float)
    cl = fs_in + Rz @ ct; M = m[-1] + mt; cn = (m[-1]*c[-1] + mt*cl)/M
    for mm_, cc in ((A['m'][-1], c[-1] - cn), (mt, cl - cn)): I[-1] = I[-1] + mm_*((cc @ cc)*np.eye(3) - np.outer(cc, cc))
    m[-1] = M; c[-1] = cn
    Kq = np.full(n, 50.) if Kq is None else np.array(Kq, float)
    Dq = 1.4*np.sqrt(np.maximum(Kq, 30)*A['rotor'])
    kc = np.array([Kc[0], Kc[1], 2*.8*np.sqrt(Kc[0]*5.), 2*.6*np.sqrt(Kc[1]*.3), 8.])
    if nu['friction'] == 'elasto-plastic': P[sim.EP] = .3
    if nu['friction'] == 'gms': P[sim.SPREAD] = .25
    g, ke = bed if bed is not None else (np.array([1.]), np.array([0.]))
    Q, V, FC, TAU, DEP = sim.run(qr, dqr, dt, A['p'], A['ax'], m, c, I, A['rotor'], A['vis'], grav, mode, Kq, Dq, kc, ptip, ptrue, Rz, sp, nrm, t1, P, g, ke)
    if not np.isfinite(Q).all(): raise RuntimeError('diverged ' + out)
    Ol, Rl = ref.fk_series(Q, A['p'], A['ax'])
    Rs = Rl @ Rz; pc = Ol + Rl @ cl
    acc = np.gradient(np.gradient(pc, dt, axis=0), dt, axis=0)
    acc = np.stack([lp(acc[:, j], dt, .0008) for j in range(3)], 1)
    sT = lambda X: np.einsum('tji,tj->ti', Rs, X)
    ft = sT(mt*(grav - acc)); fcs = sT(FC)
    tq = np.cross(ct, ft) + np.cross(tip + np.array(tipoff), fcs)
    if inertia is not None:
        Rdot = np.gradient(Rs, dt, axis=0); Om = np.einsum('tij,tkj->tik', Rdot, Rs); w = np.stack([Om[:, 2, 1], Om[:, 0, 2], Om[:, 1, 0]], 1); al = np.gradient(w, dt, axis=0)
        wb = sT(w); ab = sT(al); Iv = np.array(inertia); tq = tq - (Iv*ab + np.cross(wb, Iv*wb))
    if hose is not None:   # a hose from a point of the cell to the tool
        ph_, Kh, L0 = hose; r = (sp + ph_) - pc; d = np.linalg.norm(r, axis=1); fh = Kh*np.maximum(d - L0, 0)[:, None]*r/d[:, None]
        fh = sT(fh); ft = ft + fh; tq = tq + np.cross(ct, fh)
    W = np.concatenate([ft + fcs, tq], 1)
    if 'misalign' in sens:
        Rm = Rot.from_rotvec(sens['misalign']).as_matrix(); W = np.concatenate([W[:, :3] @ Rm, W[:, 3:] @ Rm], 1)
    if 'cross' in sens: W = W @ sens['cross'].T
    W = W*(1 + sens.get('gain', 0.))
    if gainflip is not None: W = W*gainflip(ti)[:, None]
    W = lp(W, dt, sens.get('lag', rng.uniform(.0003, .001)))
    ts = stamps(rng, ti[-1], fs, nu)
    if static is not None: ts = np.array(static)
    off = sens.get('offset', nu['clock'])
    w = interp(ts - off, ti, W)          # the wrench carries what was true `off` earlier
    rngs = np.array([40, 40, 120, 2, 2, 2.])
    w = w*(1 + nu['nonlin']*np.abs(w)/rngs)
    w = w + sens.get('bias', np.zeros(6)) + np.outer(ts/60, sens.get('drift', nu['tdrift']*np.array([1, -.6, 1.2, .02, .01, -.01])))
    if 'hum' in sens: w = w + sens['hum'][0]*np.sin(2*np.pi*50*ts + .4)[:, None] + sens['hum'][1]*np.sin(2*np.pi*50*ts + 1.9)[:, None]
    w = w + ATI*nu['noise']*rng.normal(size=w.shape)
    w = rnd(w, np.array([.01, .01, .02, 2.5e-4, 2.5e-4, 2.5e-4])/2)
    q = rnd(interp(ts, ti, Q), nu['enc'])
    cols = dict(t=ts); cols.update({f'q{i+1}': q[:, i] for i in range(n)})
    if nu['dq'] != 'none':
        v = lp(V, dt, 1/(2*np.pi*nu['dqf'])) if nu['dq'] == 'filtered' else V + 2e-4*rng.normal(size=n)
        v = interp(ts, ti, v) + 1e-4*rng.normal(size=q.shape); cols.update({f'dq{i+1}': v[:, i] for i in range(n)})
    cols.update({k_: w[:, j] for j, k_ in enumerate(CHAN)})
    if nu['phase'] and ph is not None: cols['phase'] = ph[np.clip(np.searchsorted(ti, ts), 0, len(ph)-1)]
    save(f'{out}/log.{nu["fmt"]}', cols, nu['fmt'])
    ms, cs_ = sens.get('tool_said', (mt*(1+nu['toolerr']), ct))
    r = f'[robot]\nmodel = "robot.urdf"\nsensor_frame = "ft_sensor"\ntip_frame = "tool_tip"\n'
    if nu['stated'] and lev: r += f'gravity = {arr(grav)}\n'
    if rng.random() < .5: r += 'joints = [' + ', '.join(f'"joint_{i+1}"' for i in range(n)) + ']\n'
    r += f'\n[tool]\nmass = {ms:.5g}\ncom = {arr(np.round(cs_, 5))}\n'
    if inertia is not None and sens.get('inertia_said'): r += f'inertia = {arr(list(inertia) + [0]*3)}\n'
    if surface: r += f'\n[surface]\npoint = {arr(sp)}\nnormal = {arr(nrm)}\ntangent = {arr(t1)}\n'
    if nu['stated']: r += f'\n[sensor]\nrange = [40, 40, 120, 2, 2, 2]\nnoise = {arr(ATI*nu["noise"])}\n'
    open(f'{out}/rig.toml', 'w').write(r)
    return base, hidden

def pokes(rng, n, depth, speeds, holds, x=0., air=.4, tilt=0.):
    K = [(.6, 0, 0, -.002, 0, 0, 0, 'approach')]
    for i in range(n):
        d = depth[i % len(depth)]; v = speeds[i % len(speeds)]; T = max(.12, 1.9*(d+.002)/v); h = holds[i % len(holds)]
        rx, ry = (rng.uniform(-tilt, tilt, 2) if tilt else (0, 0)); xi = x*rng.uniform(-1, 1)
        if tilt or x: K.append((.6, xi, 0, -.002, rx, ry, 0, 'free'))
        K.append((T, xi, 0, d, rx, ry, 0, 'poke'))
        if h > 0: K.append((h, xi, 0, d, rx, ry, 0, 'hold'))
        K.append((T, xi, 0, -.002, rx, ry, 0, 'retract')); K.append((air, xi, 0, -.002, rx, ry, 0, 'free'))
    return K

def slides(rng, depths, pts, speeds):
    """lower, slide between the points, lift, next depth"""
    K = [(.5, pts[0][0], pts[0][1], -.002, 0, 0, 0, 'approach')]
    i = 0
    for d in depths:
        K.append((.6, pts[0][0], pts[0][1], d, 0, 0, 0, 'poke')); cur = pts[0]
        for p in pts[1:] + pts[:1]:
            v = speeds[i % len(speeds)]; i += 1
            L = np.hypot(p[0]-cur[0], p[1]-cur[1]); K.append((max(.15, L/v), p[0], p[1], d, 0, 0, 0, 'slide')); cur = p
        K.append((.5, pts[0][0], pts[0][1], -.002, 0, 0, 0, 'retract')); K.append((.3, pts[0][0], pts[0][1], -.002, 0, 0, 0, 'free'))
    return K

def freepath(rng, T, dt, arm, big=.5, wrist=1.0, f=(.08, .35), nf=4):
    """free motion: several sines in every joint, the wrist far"""
    n = 7 if arm == 'lwr' else 6
    t = np.arange(int(T/dt))*dt; out = np.zeros((t.size, n))
    env = np.clip(t/1.5, 0, 1); env = env*env*(3-2*env)
    for j in range(n):
        for i in range(nf):
            fr = rng.uniform(*f); out[:, j] += np.sin(2*np.pi*fr*t + rng.uniform(0, 6.28))/nf*1.4*(big if j < n-3 else wrist)
    out *= env[:, None]
    return out, np.full(t.size, 'free')

# ------------------------------------------------------------------ joints
def joint_case(rng, out, arm, base, hidden, fs, nu, T, payload=None, load=0., gain=None, strib=0., off=False, amp=.7, fmax=.35, tauf=None, tau_rate=None, br=3e-4, noise=.002, extern=None, uni=False, asy=None, grav_stated=True):
    A = sim.arm_lwr() if arm == 'lwr' else sim.arm_kestrel()
    n = len(A['m']); dt = 5e-4; os.makedirs(out, exist_ok=True)
    sim.write_urdf(A, np.array([0, 0, .04]), 0., np.array([0, 0, .1]), f'{out}/robot.urdf')
    t = np.arange(int(T/dt))*dt; q = np.zeros((t.size, n)); dq = q.copy(); dd = q.copy()
    for j in range(n):
        for i in range(5):
            f = rng.uniform(.04, fmax); a = amp*rng.uniform(.3, 1)/(1 + 6*f*f)*.5; ph = rng.uniform(0, 6.28); w = 2*np.pi*f
            q[:, j] += a*np.sin(w*t+ph); dq[:, j] += a*w*np.cos(w*t+ph); dd[:, j] -= a*w*w*np.sin(w*t+ph)
    q += A['q0'] + rng.uniform(-.2, .2, n)
    m, c, I = A['m'].copy(), A['c'].copy(), A['I'].copy()
    if payload:
        mp, cp = payload; cp = np.array(cp); M = m[-1]+mp; cn = (m[-1]*c[-1] + mp*cp)/M
        for a_, b_ in ((m[-1], c[-1]-cn), (mp, cp-cn)): I[-1] = I[-1] + a_*((b_ @ b_)*np.eye(3) - np.outer(b_, b_))
        m[-1] = M; c[-1] = cn
    lev = np.deg2rad(nu['level']); grav = Rot.from_rotvec(lev*np.array([.6, -.8, 0])).as_matrix() @ np.array([0, 0, -9.81])
    one = np.ones(n)
    fc = A['fc']*rng.uniform(.8, 1.2, n); fv = A['vis']*rng.uniform(.8, 1.2, n)
    rot = A['rotor'] if 'rotor-inertia' in base else np.zeros(n) + 0.
    rot = rot if rot.any() else np.full(n, 1e-3)
    foff = rng.uniform(-1, 1, n)*.8 if off else 0*one
    Q, V, Ac, TAU = sim.run_joint(q, dq, dd, dt, A['p'], A['ax'], m, c, I, rot, grav, m, c, I, 900*A['rotor'], 45*A['rotor'], fc, fv, strib*fc, .12*one, load*one, foff, 0*one, br*one)
    if not np.isfinite(Q).all(): raise RuntimeError('diverged ' + out)
    if extern is not None: TAU = TAU + extern(t, Q, A)
    if gain is not None: TAU = TAU*(1 + np.array(gain))
    if tauf: TAU = lp(TAU, dt, 1/(2*np.pi*tauf))
    ts = stamps(rng, t[-1], fs, nu)
    tt = ts if not tau_rate else np.floor(ts*tau_rate)/tau_rate       # the torque is held between its own, slower samples
    tau = interp(tt - nu['clock'], t, TAU) + noise*np.array([176, 176, 100, 100, 100, 38, 38])[:n]*.5*interp(tt, t, rng.normal(size=(t.size, n)))
    tau = rnd(tau, .01)
    qq = rnd(interp(ts, t, Q), nu['enc'])
    cols = dict(t=ts); cols.update({f'q{i+1}': qq[:, i] for i in range(n)})
    if nu['dq'] != 'none':
        v = lp(V, dt, 1/(2*np.pi*nu['dqf'])) if nu['dq'] == 'filtered' else V + 3e-4*rng.normal(size=n)
        v = interp(ts, t, v) + 1e-4*rng.normal(size=qq.shape); cols.update({f'dq{i+1}': v[:, i] for i in range(n)})
    cols.update({f'tau{i+1}': tau[:, i] for i in range(n)})
    save(f'{out}/log.{nu["fmt"]}', cols, nu['fmt'])
    r = '[robot]\nmodel = "robot.urdf"\nsensor_frame = "ft_sensor"\ntip_frame = "tool_tip"\n'
    if lev: r += f'gravity = {arr(grav)}\n'
    open(f'{out}/rig.toml', 'w').write(r)
    return base, hidden

def drive_case(rng, out, base, hidden, fs, nu, T, fs_=0., vs=.3, rip=0., ripk=8., ks=0., uni=False, asy=0., warm=0., J=.08, fc=.6, fv=.25, noise=.01, vmax=4., extern=None, tauf=30., tau_rate=None, br=6e-4):
    os.makedirs(out, exist_ok=True)
    dt = 2.5e-4; t = np.arange(int(T/dt))*dt; dq = np.zeros(t.size)
    if uni:
        lv = rng.uniform(.5, vmax, int(T/3)+2); dq = lp(lp(lv[(t/3).astype(int)], dt, .4), dt, .4); dq[:1] = dq[0]
    else:
        # trapezoids at several speeds and multi-sine
        k = 0; tb = 0.
        v = np.zeros(t.size)
        while tb < T:
            L = rng.uniform(.8, 1.8); s = vmax*rng.choice([.02, .06, .15, .4, 1.])*(-1)**k; v[(t >= tb) & (t < tb+L)] = s; tb += L; k += 1
        dq = lp(lp(lp(v, dt, .06), dt, .06), dt, .06)
    q = np.cumsum(dq)*dt; dd = np.gradient(dq, dt)
    ext = np.zeros(t.size) if extern is None else extern(t)
    Q, V, TAU = sim.run_drive(q, dq, dd, dt, J, fc, fv, fs_, vs, br, rip, ripk, .5, ks, asy, warm, T/3., 400*J, 40*J, ext)
    if tauf: TAU = lp(TAU, dt, 1/(2*np.pi*tauf))
    ts = stamps(rng, t[-1], fs, nu); tt = ts if not tau_rate else np.floor(ts*tau_rate)/tau_rate
    tau = rnd(interp(tt, t, TAU + noise*rng.normal(size=t.size)), .002)
    qq = rnd(interp(ts, t, Q), nu['enc'])
    cols = dict(t=ts, q1=qq)
    if nu['dq'] != 'none': cols['dq1'] = interp(ts, t, lp(V, dt, 1/(2*np.pi*nu['dqf'])) if nu['dq'] == 'filtered' else V + .001) + 2e-4*rng.normal(size=ts.size)
    cols['tau1'] = tau
    save(f'{out}/log.{nu["fmt"]}', cols, nu['fmt'])
    open(f'{out}/rig.toml', 'w').write('# one drive without a robot: angle and torque on the link side of its gear\n')
    return base, hidden

# ------------------------------------------------------------------ the rows
P_ = sim.params
DT = 5e-4
def poke_segs(rng, depths, speeds, holds, x=0., air=.5, up=-.001):
    s = [(.5, up, x, 'free')]
    for d in depths:
        v = rng.choice(speeds); s += [((d-up)/v, d, x, 'poke')]
        h = rng.choice(holds)
        if h > 0: s += [(h, d, x, 'hold')]
        s += [((d-up)/v, up, x, 'retract'), (air, up, x, 'free')]
    return s
def trib_segs(rng, loads, strokes, speeds, up=-.001):
    s = [(.3, up, 0., 'free')]; i = 0
    for d in loads:
        s += [(.5, d, 0., 'poke')]; cur = 0.
        for L in strokes:
            v = speeds[i % len(speeds)]; i += 1; s.append((abs(L-cur)/v, d, L, 'slide')); cur = L
        s += [(abs(cur)/speeds[-1] + .1, d, 0., 'slide'), (.4, up, 0., 'retract'), (.3, up, 0., 'free')]
    return s

ROWS = []
def row(kind, cls=(), left=None):
    def w(f): ROWS.append((f.__name__, kind, list(cls), f)); return f
    return w
def U(r, a, b): return float(r.uniform(a, b))
LUB = dict(mu=.004, vround=.02)

# ---- 22 with one
@row('one')
def hysteresis(r, o, a):
    A, L = .16*a*U(r, .9, 1.1), U(r, 3e-4, 5e-4); nu = nuis(r)
    return (*press_case(r, o, poke_segs(r, [.002, .0035, .003, .004, .0025, .004], [.001, .004, .016], [0, .5]), bed_flat_(r, 900), P_(hA=A, hL=L), ['hooke'], ['hysteresis'], 100, nu, sig=.02),
            {'hysteresis.amplitude': A, 'hysteresis.length': L}, nu)
def bed_flat_(r, k): return sim.bed_flat(k*U(r, .9, 1.1), 40, 1.5e-5)
def bed_sph_(r, K, R=.008): return sim.bed_sphere(K*U(r, .9, 1.1), R, 160, .008)
@row('one')
def stress_softening(r, o, a):
    A, L = .22*a*U(r, .9, 1.1), U(r, 8e-4, 1.2e-3); nu = nuis(r)
    return (*press_case(r, o, poke_segs(r, [.0015, .0015, .003, .003, .0015, .0045, .003, .0045], [.003, .01], [0, .3]), bed_flat_(r, 1500), P_(mull=A, mulllen=L, cv=.004), ['kelvin-voigt'], ['stress-softening'], 200, nu, sig=.03),
            {'stress-softening.ratio': A, 'stress-softening.length': L}, nu)
@row('one')
def adhesion(r, o, a):
    A, L = .16*a*U(r, .9, 1.1), U(r, 4e-4, 7e-4); nu = nuis(r)
    return (*press_case(r, o, poke_segs(r, [.0015, .002, .001, .002, .0013], [.0015, .003], [0, .4], air=1.), bed_sph_(r, 2e4), P_(Fa=A, La=L, cv=.003), ['hertz', 'viscous-damping'], ['adhesion'], 250, nu, sig=.02),
            {'adhesion.force': A, 'adhesion.length': L}, nu)
@row('one')
def stiffening_layer(r, o, a):
    K, d = 260*a*U(r, .9, 1.1), U(r, .0019, .0023); nu = nuis(r)
    return (*press_case(r, o, poke_segs(r, [.002, .004, .003, .0045, .0015, .004], [.003, .012], [0, 2., 4.], air=1.5), bed_flat_(r, 800), P_(K2=K, d2=d, r1=.35, t1=.8), ['hooke', 'relaxation'], ['stiffening-layer'], 50, nu, sig=.03),
            {'stiffening-layer.stiffness': K, 'stiffening-layer.depth': d}, nu)
@row('one')
def hunt_crossley_damping(r, o, a):
    lam = .8*a*U(r, .9, 1.1); off = U(r, -2e-4, 2e-4); nu = nuis(r)
    p, ph = keyframes(DT, pokes(r, 7, [.006, .009, .012], [.03, .1, .25], [.3, 0], x=.004))
    return (*arm_case(r, o, 'lwr', p, ph, DT, bed_sph_(r, 2.2e4), P_(lam=lam, off=off, **LUB), ['hertz', 'surface-offset'], ['hunt-crossley-damping'], 500, nu, Kc=(3000., 150.)), {'hunt-crossley-damping.lam': lam}, nu)
@row('one')
def stiffness_inhomogeneity(r, o, a):
    A = .08*a*U(r, .9, 1.1); off = U(r, -2e-4, 2e-4); nu = nuis(r)
    x0 = U(r, -.005, .01); p, ph = keyframes(DT, slides(r, [.006, .010], [(-.03, 0), (.03, 0), (-.03, 0), (.03, .0)], [.02, .03, .012]))
    return (*arm_case(r, o, 'lwr', p, ph, DT, bed_flat_(r, 1800), P_(itype=1, iamp=A, ix=x0, iy=0, iw=.010, mu=.35, off=off, cv=.002, len=U(r, .8e-4, 1.2e-4)), ['kelvin-voigt', 'coulomb-friction', 'surface-offset'], ['stiffness-inhomogeneity'], 250, nu),
            {'stiffness-inhomogeneity.amplitude': A, 'stiffness-inhomogeneity.x': x0, 'stiffness-inhomogeneity.width': .010}, nu)
@row('one')
def viscous_friction(r, o, a):
    c = 9*a*U(r, .9, 1.1); nu = nuis(r, enc=5e-6)
    p, ph = keyframes(DT, slides(r, [.004, .007], [(-.03, -.01), (.03, -.01), (.03, .02), (-.03, .02)], [.02, .06, .12]))
    return (*arm_case(r, o, 'kestrel', p, ph, DT, bed_flat_(r, 1500), P_(mvis=c, mu=.25, cv=.003, len=U(r, .8e-4, 1.2e-4)), ['kelvin-voigt', 'coulomb-friction'], ['viscous-friction'], 500, nu, mode=0, Kq=[9000, 9000, 6000, 2500, 2000, 1200]), {'viscous-friction.c': c}, nu)
@row('one')
def presliding(r, o, a):
    L = .35e-3*a*U(r, .9, 1.1); nu = nuis(r, friction='gms')
    return (*press_case(r, o, trib_segs(r, [.0015, .003], [.004, .001, .006, .003, .0035, 0., .008, .002], [.002, .005, .01]), bed_flat_(r, 1500), P_(mu=.45, len=L), ['hooke', 'coulomb-friction'], ['presliding'], 200, nu, trib=True, sig=.03), {'presliding.length': L}, nu)
@row('one')
def load_dependent_friction(r, o, a):
    p = -.2*a*U(r, .9, 1.1); nu = nuis(r)
    return (*press_case(r, o, trib_segs(r, [.0008, .002, .0035, .0014], [.01, -.005, .012, 0.], [.005, .015]), bed_sph_(r, 3e4), P_(mu=.5, p=p, N0=2., len=U(r, .8e-4, 1.2e-4)), ['hertz', 'coulomb-friction'], ['load-dependent-friction'], 200, nu, trib=True, sig=.03), {'load-dependent-friction.p': p}, nu)
@row('one')
def friction_anisotropy(r, o, a):
    A = .11*a*U(r, .9, 1.1); off = U(r, -2e-4, 2e-4); nu = nuis(r)
    p, ph = keyframes(DT, slides(r, [.005, .009], [(0, 0), (.03, 0), (.03, .03), (-.01, .03), (0, 0), (.02, .025), (-.02, .01)], [.03, .05]))
    return (*arm_case(r, o, 'lwr', p, ph, DT, bed_flat_(r, 1500), P_(mu=.45, an=A, off=off, cv=.002, len=U(r, .8e-4, 1.2e-4)), ['kelvin-voigt', 'coulomb-friction', 'surface-offset'], ['friction-anisotropy'], 200, nu), {'friction-anisotropy.a': A}, nu)
@row('one')
def sensor_crosstalk(r, o, a):
    M = np.eye(6); M[0, 2] = .045*a; M[1, 2] = -.04*a; M[0, 1] = .04*a; M[2, 0] = -.05*a; M[3, 1] = .004*a; M[4, 2] = .003*a; nu = nuis(r, nonlin=0., toolerr=0.)
    p, ph = freepath(r, 40, DT, 'kestrel')
    return (*arm_case(r, o, 'kestrel', p, ph, DT, None, P_(), ['none', 'sensor-bias'], ['sensor-crosstalk'], 125, nu, tool=(.9, (.004, -.003, .06)), surface=False, sens=dict(cross=M, bias=r.normal(size=6)*ATI*20)),
            {'sensor-crosstalk.fx_fz': .045*a, 'sensor-crosstalk.fy_fz': -.04*a, 'sensor-crosstalk.fx_fy': .04*a, 'sensor-crosstalk.fz_fx': -.05*a, 'sensor-crosstalk.tx_fy': .004*a, 'sensor-crosstalk.ty_fz': .003*a}, nu)
@row('one')
def sensor_lag(r, o, a):
    L = .009*a*U(r, .9, 1.1); nu = nuis(r, clock=0.)
    p, ph = keyframes(DT, pokes(r, 12, [.005, .008, .010, .006], [.08, .25, .15], [0, .3, 0], x=.004, air=.2))
    return (*arm_case(r, o, 'lwr', p, ph, DT, bed_flat_(r, 1800), P_(cv=.003, **LUB), ['kelvin-voigt'], ['sensor-lag'], 2000, nu, sens=dict(lag=L)), {'sensor-lag.tau': L}, nu)
@row('one')
def sensor_drift(r, o, a):
    d = np.array([.13, -.08, .26, .002, .0015, -.001])*a*U(r, .9, 1.1); nu = nuis(r)
    p, ph = keyframes(DT, pokes(r, 20, [.006, .009, .004], [.01, .02], [.5, 1.], x=.004, air=1.))
    return (*arm_case(r, o, 'lwr', p, ph, DT, bed_sph_(r, 2.2e4), P_(**LUB), ['hertz', 'sensor-bias'], ['sensor-drift'], 50, nu, sens=dict(drift=d, bias=r.normal(size=6)*ATI*10)), {f'sensor-drift.{c}': float(x) for c, x in zip(CHAN, d)}, nu)
@row('one')
def mains_hum(r, o, a):
    A = .2*a; h = (np.array([.6, .5, 1., .01, .012, .006])*A, np.array([-.3, .4, .3, .004, 0, .003])*A); nu = nuis(r); off = U(r, -2e-4, 2e-4)
    p, ph = keyframes(DT, pokes(r, 5, [.006, .010, .008], [.03, .08], [.4, .8]))
    return (*arm_case(r, o, 'kestrel', p, ph, DT, bed_flat_(r, 900), P_(cv=.004, off=off, **LUB), ['kelvin-voigt', 'surface-offset'], ['mains-hum'], 1000, nu, mode=0, Kq=[9000, 9000, 6000, 2500, 2000, 1200], sens=dict(hum=h)), {'mains-hum.frequency': 50., 'mains-hum.fz': A}, nu)
@row('one')
def tool_com(r, o, a):
    m = .45; ct = np.array([.006, -.004, .055]); d = np.array([.0040, -.003, .0045])*a; nu = nuis(r, toolerr=0.)
    p, ph = freepath(r, 30, DT, 'lwr')
    return (*arm_case(r, o, 'lwr', p, ph, DT, None, P_(), ['none', 'sensor-bias'], ['tool-com'], 100, nu, tool=(m, ct), surface=False, sens=dict(bias=r.normal(size=6)*ATI*10, tool_said=(m, ct-d))), {f'tool-com.{k}': float(x) for k, x in zip('xyz', d)}, nu)
@row('one')
def structural_compliance(r, o, a):
    C = 8e-5*a*U(r, .9, 1.1); nu = nuis(r, enc=5e-6, noise=1.5)
    p, ph = keyframes(DT, pokes(r, 8, [.002, .010, .005, .007], [.03, .07], [.3, 0], x=.004))
    return (*arm_case(r, o, 'kestrel', p, ph, DT, bed_sph_(r, 5e4), P_(C=C, **LUB), ['hertz', 'sensor-bias'], ['structural-compliance'], 250, nu, mode=0, Kq=[9000, 9000, 6000, 2500, 2000, 1200], sens=dict(bias=r.normal(size=6)*ATI*5)), {'structural-compliance.compliance': C}, nu)
@row('one')
def tip_offset(r, o, a):
    d = np.array([.002, -.0015, 0.])*a; nu = nuis(r)
    K = []
    for i in range(10):
        tx, ty = r.uniform(-.22, .22, 2); x = U(r, -.01, .01)
        K += [(.9, x, 0, -.004, tx, ty, 0, 'free'), (.5, x, 0, .008, tx, ty, 0, 'poke'), (.9, x+.02, .01, .008, tx, ty, 0, 'slide'), (.5, x+.02, .01, -.004, tx, ty, 0, 'retract')]
    p, ph = keyframes(DT, K)
    return (*arm_case(r, o, 'lwr', p, ph, DT, bed_flat_(r, 1200), P_(mu=.3, cv=.003, len=U(r, .8e-4, 1.2e-4)), ['kelvin-voigt', 'coulomb-friction', 'sensor-bias'], ['tip-offset'], 250, nu, tipoff=d, sens=dict(bias=r.normal(size=6)*ATI*5)), {f'tip-offset.{k}': float(x) for k, x in zip('xyz', d)}, nu)
FRB = ['rigid-body', 'joint-coulomb-friction', 'joint-viscous-friction', 'rotor-inertia']
@row('one')
def payload(r, o, a):
    m = .55*a*U(r, .9, 1.1); c = (.01, -.005, .08); nu = nuis(r, enc=float(r.choice([1e-5, 1e-4])), nonlin=0., level=0.)
    return (*joint_case(r, o, 'lwr', FRB, ['payload'], 250, nu, 40, payload=(m, c), tauf=40., noise=.004), {'payload.mass': m}, nu)
@row('one')
def joint_load_friction(r, o, a):
    k = .10*a*U(r, .9, 1.1); nu = nuis(r, enc=2e-5)
    return (*joint_case(r, o, 'kestrel', FRB, ['joint-load-friction'], 500, nu, 40, load=k, tauf=50., noise=.003, amp=1.1), {'joint-load-friction.ratio': k}, nu)
@row('one')
def joint_torque_gain(r, o, a):
    g = np.array([.06, -.07, .05, .08, -.06, .05, .04])*a; nu = nuis(r, enc=5e-5)
    return (*joint_case(r, o, 'lwr', FRB, ['joint-torque-gain'], 200, nu, 45, gain=g, tauf=40., tau_rate=125., noise=.004), {f'joint-torque-gain.joint_{i+1}': float(x) for i, x in enumerate(g)}, nu)
@row('one')
def joint_torque_ripple(r, o, a):
    A = .10*a*U(r, .9, 1.1); k = float(r.choice([6., 8., 10.])); nu = nuis(r, enc=1e-4)
    return (*drive_case(r, o, ['rigid-body', 'joint-coulomb-friction', 'joint-viscous-friction'], ['joint-torque-ripple'], 1000, nu, 30, rip=A, ripk=k, vmax=2.5, tauf=50., noise=.03), {'joint-torque-ripple.amplitude': A, 'joint-torque-ripple.k': k}, nu)
@row('one')
def joint_stribeck_friction(r, o, a):
    A = .28*a*U(r, .9, 1.1); vs = U(r, .3, .5); nu = nuis(r, enc=5e-5)
    return (*drive_case(r, o, ['rigid-body', 'joint-coulomb-friction', 'joint-viscous-friction'], ['joint-stribeck-friction'], 500, nu, 40, fs_=A, vs=vs, tauf=50., noise=.03), {'joint-stribeck-friction.dtau': A, 'joint-stribeck-friction.vs': vs}, nu)

# ---- 7 pairs
@row('pair')
def relaxation__saturation(r, o, a):
    R, tau = .30*U(r, .9, 1.1), U(r, .7, 1.3); nu = nuis(r); lim = 3.3*U(r, .97, 1.03)
    return (*press_case(r, o, poke_segs(r, [.002, .0035, .0025, .004, .003, .0038], [.004, .015], [1., 3.], air=2.), bed_flat_(r, 900), P_(r1=R, t1=tau), ['hooke'], ['relaxation', 'saturation'], 100, nu, sig=.03, mods=dict(lim=lim)),
            {'relaxation.ratio': R, 'relaxation.tau': tau, 'saturation.limit': lim}, nu)
@row('pair')
def hertz_exponent__tool_mass(r, o, a):
    nn = 1.3*U(r, .98, 1.02); dm = .045*a; nu = nuis(r, toolerr=0.); m = .3
    K = [(2., 0, 0, -.03, .5, .2, 0, 'free'), (2., 0, 0, -.03, -.4, .4, 0, 'free'), (2., 0, 0, -.03, .1, -.5, 0, 'free'), (2., 0, 0, -.002, 0, 0, 0, 'approach')] + pokes(r, 6, [.005, .009, .007], [.03, .06], [.4], x=.004)
    p, ph = keyframes(DT, K)
    return (*arm_case(r, o, 'lwr', p, ph, DT, sim.bed_power(4500*U(r, .9, 1.1), nn), P_(**LUB), ['hooke', 'sensor-bias'], ['hertz-exponent', 'tool-mass'], 200, nu, tool=(m+dm, (0, 0, .05)), sens=dict(tool_said=(m, (0, 0, .05)))), {'hertz-exponent.n': nn, 'tool-mass.mass': dm}, nu)
@row('pair')
def stribeck_friction__sensor_bias(r, o, a):
    A, vs = .13*a*U(r, .9, 1.1), U(r, .018, .028); b = np.array([.13, -.10, .14, .003, -.004, .003]); nu = nuis(r, enc=5e-6)
    p, ph = keyframes(DT, slides(r, [.004, .006], [(-.03, -.01), (.03, -.01), (-.02, .01), (.03, .02)], [.008, .09, .03]))
    return (*arm_case(r, o, 'kestrel', p, ph, DT, bed_flat_(r, 1500), P_(mu=.35, dmu=A, vs=vs, cv=.003, len=U(r, .8e-4, 1.2e-4)), ['kelvin-voigt', 'coulomb-friction'], ['stribeck-friction', 'sensor-bias'], 250, nu, mode=0, Kq=[9000, 9000, 6000, 2500, 2000, 1200], sens=dict(bias=b)),
            {'stribeck-friction.dmu': A, 'stribeck-friction.vs': vs, **{f'sensor-bias.{c}': float(x) for c, x in zip(CHAN, b)}}, nu)
@row('pair')
def coulomb_friction__stiffness_drift(r, o, a):
    mu, al = .06*a, -.25*a*U(r, .9, 1.1); nu = nuis(r)
    return (*press_case(r, o, trib_segs(r, [.001, .0025, .0018, .003, .0012, .0025, .003, .002], [.01, -.004, .008, 0.], [.006, .012]), bed_flat_(r, 1500), P_(mu=mu, drift=al, len=U(r, .8e-4, 1.2e-4)), ['hooke'], ['coulomb-friction', 'stiffness-drift'], 100, nu, trib=True, sig=.03), {'coulomb-friction.mu': mu, 'stiffness-drift.rate': al}, nu)
@row('pair')
def viscous_damping__viscous_friction(r, o, a):
    c = 14*a*U(r, .9, 1.1); cv = 11*a*U(r, .9, 1.1); nu = nuis(r); k = 1500.
    s = [(.3, -.001, 0., 'free')]
    for i in range(9): v = [.01, .03, .06][i % 3]; d = [.002, .0035, .003][(i//2) % 3]; s += [((d+.001)/v, d, 0., 'poke'), (.012/[.08, .03, .12][i % 3], d, .012, 'slide'), (.012/[.03, .1, .05][i % 3], d, 0., 'slide'), (.3, d, 0., 'hold'), ((d+.001)/v, -.001, 0., 'retract'), (.2, -.001, 0, 'free')]
    return (*press_case(r, o, s, sim.bed_flat(k, 40, 1.5e-5), P_(cv=c/k, mvis=cv, mu=.3, len=U(r, .8e-4, 1.2e-4)), ['hooke', 'coulomb-friction'], ['viscous-damping', 'viscous-friction'], 500, nu, trib=True, sig=.04), {'viscous-damping.c': c, 'viscous-friction.c': cv}, nu)
@row('pair')
def surface_offset__time_offset(r, o, a):
    z, dt_ = 2.4e-4*a, .006*a*U(r, .9, 1.1); nu = nuis(r)
    p, ph = keyframes(DT, pokes(r, 9, [.005, .009, .007], [.05, .12, .2], [.2, .5], x=.004, air=.3))
    return (*arm_case(r, o, 'lwr', p, ph, DT, bed_sph_(r, 2.2e4), P_(off=z, lam=.15, **LUB), ['hertz', 'hunt-crossley-damping'], ['surface-offset', 'time-offset'], 500, nu, sens=dict(offset=dt_)), {'surface-offset.offset': z, 'time-offset.offset': dt_}, nu)
@row('pair')
def tool_mass__sensor_misalignment(r, o, a):
    v = np.array([.025, -.02, .035])*a; dm = .03*a; nu = nuis(r, toolerr=0., nonlin=0.); m = .8
    p, ph = freepath(r, 35, DT, 'kestrel')
    return (*arm_case(r, o, 'kestrel', p, ph, DT, None, P_(), ['none', 'sensor-bias'], ['tool-mass', 'sensor-misalignment'], 100, nu, tool=(m+dm, (.01, 0, .05)), surface=False, sens=dict(bias=r.normal(size=6)*ATI*10, tool_said=(m, (.01, 0, .05)), misalign=v)),
            {'tool-mass.mass': dm, **{f'sensor-misalignment.{k}': float(x) for k, x in zip('xyz', v)}}, nu)

# ---- 9 with nothing
@row('none')
def n_zener_two_times(r, o, a):
    nu = nuis(r)
    return (*press_case(r, o, poke_segs(r, [.002, .0035, .003, .004, .0025], [.003, .015], [1., 2., 4.], air=1.5), bed_flat_(r, 900), P_(r1=.30, t1=.9, r2=.025, t2=.15), ['zener'], [], 100, nu, sig=.02), {}, nu)
@row('none')
def n_hertz_poke(r, o, a):
    nu = nuis(r); off = U(r, -2e-4, 2e-4); p, ph = keyframes(DT, pokes(r, 7, [.006, .009, .012], [.03, .1, .2], [.3, 0], x=.004))
    return (*arm_case(r, o, 'lwr', p, ph, DT, sim.bed_sphere(2.2e4, .008, 160, .010), P_(lam=.35, off=off, **LUB), ['hertz', 'hunt-crossley-damping', 'surface-offset', 'sensor-bias'], [], 500, nu, sens=dict(bias=r.normal(size=6)*ATI*10)), {}, nu)
@row('none')
def n_slide(r, o, a):
    nu = nuis(r); p, ph = keyframes(DT, slides(r, [.005, .009], [(0, 0), (.03, 0), (.03, .03), (-.01, .03), (0, 0), (.02, .025)], [.03, .05]))
    return (*arm_case(r, o, 'lwr', p, ph, DT, bed_flat_(r, 1500), P_(mu=.4, off=U(r, -2e-4, 2e-4), cv=.002, len=U(r, .8e-4, 1.2e-4), sig1=.02), ['kelvin-voigt', 'coulomb-friction', 'surface-offset'], [], 200, nu), {}, nu)
@row('none')
def n_tribo(r, o, a):
    nu = nuis(r, friction='gms')
    return (*press_case(r, o, trib_segs(r, [.0015, .003], [.004, .001, .006, .003, .0035, 0., .008, .002], [.002, .01, .03]), bed_flat_(r, 1500), P_(mu=.45, len=6e-4, mvis=6.), ['hooke', 'coulomb-friction', 'presliding', 'viscous-friction'], [], 200, nu, trib=True, sig=.02), {}, nu)
@row('none')
def n_free(r, o, a):
    nu = nuis(r); p, ph = freepath(r, 30, DT, 'lwr')
    return (*arm_case(r, o, 'lwr', p, ph, DT, None, P_(), ['none', 'sensor-bias'], [], 100, nu, tool=(.5, (.003, 0, .06)), surface=False, sens=dict(bias=r.normal(size=6)*ATI*15)), {}, nu)
@row('none')
def n_joints_lwr(r, o, a):
    nu = nuis(r, enc=2e-5)
    return (*joint_case(r, o, 'lwr', FRB, [], 200, nu, 40, tauf=30., tau_rate=100., noise=.002), {}, nu)
@row('none')
def n_joints_kestrel(r, o, a):
    nu = nuis(r, enc=5e-5)
    return (*joint_case(r, o, 'kestrel', FRB + ['joint-stribeck-friction', 'joint-torque-offset'], [], 250, nu, 40, strib=.3, off=True, tauf=40., noise=.002), {}, nu)
@row('none')
def n_drive(r, o, a):
    nu = nuis(r, enc=2e-4)
    return (*drive_case(r, o, ['rigid-body', 'joint-coulomb-friction', 'joint-viscous-friction'], [], 500, nu, 25, vmax=3., tauf=50., noise=.01), {}, nu)
@row('none')
def n_kv_slow(r, o, a):
    nu = nuis(r, fmt='csv'); p, ph = keyframes(DT, pokes(r, 12, [.006, .011, .008], [.02, .05], [.8, 1.6], x=.003, air=1.0))
    return (*arm_case(r, o, 'kestrel', p, ph, DT, bed_flat_(r, 900), P_(cv=.01, off=U(r, -2e-4, 2e-4), **LUB), ['kelvin-voigt', 'surface-offset'], [], 50, nu, mode=0, Kq=[9000, 9000, 6000, 2500, 2000, 1200]), {}, nu)

# ---- 6 outside
@row('outside')
def o_pulse(r, o, a):
    """living tissue: the surface itself moves with a pulse and breathing; fixed in time, not in motion"""
    A = 2.5e-4*a; f = U(r, 1.05, 1.35); nu = nuis(r); p, ph = keyframes(DT, pokes(r, 7, [.006, .009, .007], [.02, .05], [2., 3.], x=.003))
    return (*arm_case(r, o, 'lwr', p, ph, DT, bed_flat_(r, 900), P_(mamp=A, mfreq=f, cv=.003, **LUB), ['kelvin-voigt', 'surface-offset'], [], 200, nu), {'pulse.amplitude': A, 'pulse.frequency': f}, nu)
@row('outside')
def o_hose(r, o, a):
    """a hose between cell and tool: spring towards a point; nothing in the catalogue pulls with position in free air"""
    nu = nuis(r, toolerr=0.); p, ph = freepath(r, 35, DT, 'lwr')
    return (*arm_case(r, o, 'lwr', p, ph, DT, None, P_(), ['none', 'sensor-bias'], [], 100, nu, tool=(.5, (0, 0, .05)), surface=False, hose=(np.array([-.05, .22, .1]), 5*a, .18), sens=dict(bias=r.normal(size=6)*ATI*5)), {'hose.stiffness': 5*a, 'hose.length': .18}, nu)
@row('outside')
def o_mu_of_place(r, o, a):
    """friction coefficient that changes along the counterface; the normal force knows nothing of it"""
    A, L = .25*a, U(r, .007, .009); nu = nuis(r)
    return (*press_case(r, o, trib_segs(r, [.001, .002, .003], [.02, -.004, .016, 0.], [.005, .012, .03]), bed_flat_(r, 1500), P_(mu=.4, muamp=A, muL=L, len=U(r, .8e-4, 1.2e-4)), ['hooke', 'coulomb-friction'], [], 200, nu, trib=True, sig=.02), {'mu-profile.amplitude': A, 'mu-profile.period': L}, nu)
@row('outside')
def o_warm_gear(r, o, a):
    """the gear's grease warms up: viscous friction falls over the log"""
    w = 1.2*a; nu = nuis(r, enc=1e-3)
    return (*drive_case(r, o, ['rigid-body', 'joint-coulomb-friction', 'joint-viscous-friction'], [], 250, nu, 60, warm=w, vmax=4., fv=.2, tauf=30., noise=.01), {'warm-up.ratio': w}, nu)
@row('outside')
def o_pushes(r, o, a):
    """somebody leans on the arm several times"""
    nu = nuis(r, enc=2e-5); tc = np.sort(r.uniform(3, 37, 9)); am = r.uniform(20, 45, 9)*a; du = r.uniform(.25, .9, 9); dirs = r.normal(size=(9, 3)); dirs /= np.linalg.norm(dirs, axis=1)[:, None]
    def ext(t, Q, A):
        out = np.zeros_like(Q); n = Q.shape[1]
        for i in range(9):
            k = np.where(np.abs(t - tc[i]) < du[i])[0]; s = np.cos(.5*np.pi*(t[k]-tc[i])/du[i])**2
            for kk, ss in zip(k, s):
                O, Z, R = sim.fk(Q[kk], A['p'], A['ax']); pt = O[n-2]
                for j in range(n-1): out[kk, j] = -np.dot(np.cross(Z[j], pt-O[j]), dirs[i])*am[i]*ss
        return out
    return (*joint_case(r, o, 'kestrel', FRB, [], 250, nu, 40, tauf=40., noise=.002, extern=ext), {'pushes.force': float(am.mean())}, nu)
@row('outside')
def o_loose_plug(r, o, a):
    """a loose plug: all channels lose part of their gain for short random spells"""
    nu = nuis(r); D = .15*a; rr = np.random.default_rng(r.integers(1 << 30))
    p, ph = keyframes(DT, pokes(r, 8, [.006, .009, .007], [.02, .06], [1., 1.6], x=.003))
    T = len(p)*DT; sw = np.cumsum(rr.exponential(.8, 400))
    def gf(t): return 1 - D*(np.searchsorted(sw, t) % 2)
    return (*arm_case(r, o, 'lwr', p, ph, DT, bed_sph_(r, 2.2e4), P_(**LUB), ['hertz', 'surface-offset'], [], 200, nu, gainflip=gf), {'plug.loss': D}, nu)

# ---- 4 not excited
@row('not-excited')
def x_viscous_damping(r, o, a):
    c = 20.; nu = nuis(r, jitter=0., drop=0., dq='none', phase=False, fmt='csv', stated=True); k = 1200.
    s = [(1., 0., 0., 'rest')]
    lev = r.permutation(np.r_[np.linspace(.0003, .004, 22), np.linspace(.0005, .0035, 18)])
    for d in lev: s += [(2., float(d), 0., 'poke'), (3., float(d), 0., 'hold')]
    # one row a step, read at the end of the hold
    b, h = press_case(r, o, s, sim.bed_flat(k, 40, 1e-5), P_(cv=c/k), ['hooke'], ['viscous-damping'], .2, nu, sig=.015)
    L = ref.read_log(f'{o}/log.csv')
    return b, h, {'viscous-damping.c': c}, nu
@row('not-excited')
def x_tool_inertia(r, o, a):
    I = np.array([.002, .0018, .0009]); nu = nuis(r, phase=False, fmt='csv', dq='none', toolerr=0.)
    K = []; ts = []; T = 0.
    for i in range(28):
        v = (U(r, -.03, .03), U(r, -.03, .03), -.05, *r.uniform(-.5, .5, 3)); K += [(1.3, *v, 'free'), (1.0, *v, 'rest')]; T += 2.3; ts.append(T - .05)
    p, ph = keyframes(DT, K)
    return (*arm_case(r, o, 'lwr', p, ph, DT, None, P_(), ['none', 'sensor-bias'], ['tool-inertia'], 1., nu, tool=(.6, (0, 0, .06)), surface=False, inertia=I, static=ts, sens=dict(bias=r.normal(size=6)*ATI*10)), {f'tool-inertia.{k}': float(x) for k, x in zip(('ixx', 'iyy', 'izz'), I)}, nu)
@row('not-excited')
def x_friction_anisotropy(r, o, a):
    A = .2; nu = nuis(r)
    return (*press_case(r, o, trib_segs(r, [.001, .002, .003], [.012, -.004, .01, 0.], [.006, .02]), bed_flat_(r, 1500), P_(mu=.4, an=A, len=U(r, .8e-4, 1.2e-4)), ['hooke', 'coulomb-friction'], ['friction-anisotropy'], 200, nu, trib=True, sig=.02), {'friction-anisotropy.a': A}, nu)
@row('not-excited')
def x_joint_friction_asymmetry(r, o, a):
    A = .25; nu = nuis(r, enc=5e-4)
    return (*drive_case(r, o, ['rigid-body', 'joint-coulomb-friction', 'joint-viscous-friction'], ['joint-friction-asymmetry'], 250, nu, 30, uni=True, asy=A, tauf=12., tau_rate=100., noise=.01), {'joint-friction-asymmetry.asymmetry': A}, nu)

def main():
    ap = argparse.ArgumentParser(); ap.add_argument('--seed', type=int, default=1); ap.add_argument('--out', required=True); ap.add_argument('--only', default=''); ap.add_argument('--nofit', action='store_true')
    a = ap.parse_args(); t0 = time.time(); os.makedirs(a.out, exist_ok=True)
    order = np.random.default_rng([a.seed, 77]).permutation(len(ROWS)); truth, nui = [], {}
    for pos, i in enumerate(order):
        name, kind, cls, f = ROWS[i]
        if a.only and a.only not in name: continue
        d = f'case_{pos:03d}'; amp = 1.; t1 = time.time()
        for attempt in range(3):
            r = np.random.default_rng([a.seed, int(i), 5])
            base, hid, vals, nu = f(r, os.path.join(a.out, d), amp)
            row = dict(log=f'{d}/log.{nu["fmt"]}', rig=f'{d}/rig.toml', base=base, truth=hid, kind=kind, **{'class': cls}, values={k: float(v) for k, v in vals.items()}, error_true_model=None)
            if kind not in ('one', 'pair') : break
            s = score(a.out, row); row['error_true_model'] = round(s['with'], 5)
            if s['ratio'] >= 2.15 and s['important'] and min(s.get('single', {'': 9}).values()) > 1.9: break
            amp *= 1.45
        if kind in ('none', 'not-excited', 'outside'):
            s = score(a.out, row)
            if kind != 'outside': row['error_true_model'] = round(s['with'], 5)
        tst = {k: v for k, v in row.items()}; truth.append(tst); nui[d] = dict(name=name, **{k: v for k, v in nu.items()}, amp=amp, score={k: v for k, v in s.items() if k != 'th'})
        print(f'{d} {name:34s} {kind:11s} without {s["without"]:.4f} with {s["with"]:.4f} ratio {s["ratio"]:.2f} share of reading {s["share"]*100:.2f}% -> {s["share_with"]*100:.2f}%  amp {amp:.2f} {time.time()-t1:.1f}s', flush=True)
    json.dump(truth, open(os.path.join(a.out, 'truth.json'), 'w'), indent=1); json.dump(nui, open(os.path.join(a.out, 'nuisances.json'), 'w'), indent=1, default=float)
    print(f'{len(truth)} rows, {time.time()-t0:.0f} s')

TORQUE = {'tool-com', 'tip-offset', 'tool-inertia'}
def score(root, row):
    """rms error of the base alone and of the base with the hidden effects, by the reference estimator on the written log"""
    M = ref.load(root, row)
    start = dict(row['values'])
    alias = {'sensor-bias.': None}
    for e in ('sensor-bias', 'sensor-drift'):
        for j, c in enumerate(CHAN):
            if f'{e}.{c}' in start: start[f'{e}.{"b" if e == "sensor-bias" else "d"}{j}'] = start[f'{e}.{c}']
    b = M.fit(row['base'], start)
    e2 = [e for e in row['truth']]
    if row['kind'] == 'not-excited' and 'joint-friction-asymmetry' in e2 or not e2: w = b if not e2 else M.fit(row['base'] + e2, start)
    else: w = M.fit(row['base'] + e2, {**{k: v for k, v in b.get('th', {}).items()}, **start} if isinstance(b.get('th'), dict) else start)
    key = 'torque' if set(e2) & TORQUE and 'torque' in b else 'rms'
    rk = 'torque_reading' if key == 'torque' else 'reading'
    s = dict(without=b[key], ratio=b[key]/max(w[key], 1e-12), share=b[key]/b[rk], share_with=w[key]/w[rk], important=b[key]/b[rk] > .025, channel=key)
    s['with'] = w[key]
    if row['kind'] == 'pair':
        s['single'] = {}
        for e in e2:
            o = [x for x in e2 if x != e]; k = M.fit(row['base'] + o, start); s['single'][e] = k[key]/max(w[key], 1e-12)
    s['th'] = w.get('th')
    return s

if __name__ == '__main__': main()
