from world import *
SYM = {'k': 'stiffness', 'hA': 'amplitude', 'hl': 'length', 'mr': 'ratio', 'ml': 'length', 'Fa': 'F_a', 'la': 'length', 'K2': 'K', 'db': 'delta_b', 'z0': 'z_0', 'r1': 'ratio', 'tau1': 'tau',
       'lam': 'lambda', 'cv': 'c', 'dmu': 'delta_mu', 'vs': 'v_s', 'zl': 'length', 'vr': 'v_r', 'an': 'a', 'is0': 'edge_position', 'iw': 'edge_width', 'iA': 'relative_step', 'dm': 'delta_m', 'alpha': 'alpha_per_min'}
FS = [50, 100, 125, 200, 250, 500, 1000, 2000]
def ft(r, T, fs=(50, 2000), rows=60000):
    T = LU(r, *T); a = [f for f in FS if fs[0] <= f <= fs[1] and f*T <= rows] or [fs[0]]; return dict(T=float(T), fs=float(r.choice(a)))
def con(r, robot, model, kind, T, F=(4, 16), d=(3e-3, 8e-3), fs=(50, 2000), rows=60000, **o):
    m = model.split(','); P = neutral(); nl = m[0]; dm = U(r, *d); n = {'hertz': 1.5, 'hunt-crossley': 1.5}.get(nl, 1.); P[PI['n']] = n; P[0] = U(r, *F)/dm**n; P[PI['c']] = 0.
    w = LU(r, 1., 6.)
    if nl == 'kelvin-voigt': P[PI['c']] = P[0]*U(r, .06, .18)/w
    if nl == 'hunt-crossley': P[PI['lam']] = U(r, .5, 3.)
    if nl == 'zener': P[PI['r1']] = U(r, .15, .4); P[PI['tau1']] = LU(r, .3, 6)
    if nl == 'maxwell': P[PI['r1']] = 1.; P[PI['tau1']] = LU(r, 20, 90)
    if 'coulomb-friction' in m: P[PI['mu']] = U(r, .3, .8)
    return dict(engine='arm' if robot in ROB else 'tester', robot=robot, model=m, normal=nl, P=P.tolist(), free=False, kind=kind, dmax=dm, o=o, tribo=robot == 'tribo', s0=LU(r, .01, .05), **ft(r, T, fs, rows))
def fre(r, robot, T, fs=(50, 2000), **k):
    return dict(engine='arm', robot=robot, model=['none'], normal='none', P=neutral().tolist(), free=True, **ft(r, T, fs), **k)
def jnt(r, robot, model, T, fs=(50, 1000), **k):
    rb = ROB[robot]; s = U(r, .7, 1.4); lim = rb['tau']
    return dict(engine='joint', robot=robot, model=model.split(','), free=False, Fc=(rb['Fc']*s).tolist(), Fv=(rb['Fv']*U(r, .7, 1.4)).tolist(), s0=(lim*(4e-4 if robot == 'lwr' else 1e-3)).tolist(), **ft(r, T, fs), **k)
def drv(r, model, T, fs=(100, 2000), **k):
    J = LU(r, .02, .6); c = U(r, .15, .6)
    k.setdefault('amp', (.5, 2.)); k.setdefault('f', (.1, .8)); k.setdefault('vmax', 3.)
    return dict(engine='joint', robot='drive', model=model.split(','), free=False, J=J, Fc=[c], Fv=[U(r, .05, .25)], s0=[LU(r, .003, .02)], **ft(r, T, fs), **k)
RB = 'rigid-body,joint-coulomb-friction,joint-viscous-friction'
Fm = lambda c: c['P'][0]*c['dmax']**c['P'][1]
def up(c, **k):
    for a, b in k.items(): c['P'][PI[a]] = b
    return c
# every builder: (rng, gain g of the hidden size) -> case, hidden values, reading per effect, near
def hertz_exp(r, g):
    c = con(r, 'lwr', 'kelvin-voigt', 'poke', (20, 90)); n = min(U(r, 1.35, 1.7)*g**.15, 2.1); c['P'][0] *= c['dmax']**(1-n); return c, {'hertz-exponent': {'n': n}}, {'hertz-exponent': 'n'}, ['stiffening-layer']
def hc_damp(r, g):
    c = con(r, 'lwr', 'hertz', 'poke', (10, 60), v=(.01, .12), fs=(200, 2000)); return c, {'hunt-crossley-damping': {'lam': U(r, 2, 4.5)*g}}, {'hunt-crossley-damping': 'n'}, ['viscous-damping']
def relax(r, g):
    c = con(r, r.choice(['lwr', 'cur']), 'kelvin-voigt', 'poke', (30, 150), hold=(.5, 8)); return c, {'relaxation': {'r1': min(U(r, .2, .4)*g, .6), 'tau1': LU(r, .4, 4)}}, {'relaxation': 'n'}, []
def relax_tip(r, g):
    c = con(r, 'tester', 'hertz', 'poke', (40, 250), fs=(50, 500), hold=(1, 15)); return c, {'relaxation': {'r1': min(U(r, .2, .4)*g, .6), 'tau1': LU(r, .6, 6)}}, {'relaxation': 'n'}, []
def mullins(r, g):
    c = con(r, 'cur', 'kelvin-voigt', 'poke', (30, 100), d=(5e-3, 10e-3), d_=0); c['o']['d'] = (.3, 1.); c['o']['grow'] = True
    return c, {'stress-softening': {'mr': min(U(r, .3, .45)*g, .6), 'ml': c['dmax']*U(r, .15, .35)}}, {'stress-softening': 'n'}, ['hysteresis']
def layer(r, g, robot='cur', model='hunt-crossley', T=(20, 80), **k):
    c = con(r, robot, model, 'poke', T, **k); return c, {'stiffening-layer': {'K2': Fm(c)/c['dmax']*U(r, 1., 2.2)*g, 'db': c['dmax']*U(r, .4, .6)}}, {'stiffening-layer': 'n'}, ['hertz-exponent']
def compl(r, g):
    c = con(r, 'lwr', 'hertz', 'poke', (20, 80), F=(14, 35), d=(4e-3, 6e-3)); C = min(U(r, 5e-5, 1.2e-4)*g, 2e-4); return c, {'structural-compliance': {'C': C}}, {'structural-compliance': 'n'}, ['hertz-exponent']
def stribeck(r, g):
    c = con(r, 'lwr', 'hooke,coulomb-friction', 'slide', (30, 120), v=(2e-3, .08), nstroke=10); return c, {'stribeck-friction': {'dmu': U(r, .15, .3)*g, 'vs': U(r, 8e-3, .02)}}, {'stribeck-friction': 't'}, ['viscous-friction']
def loadfr(r, g):
    c = con(r, 'cur', 'kelvin-voigt,coulomb-friction', 'slide', (30, 120), F=(8, 20), d_=0); c['o']['d'] = (.15, 1.); return c, {'load-dependent-friction': {'p': -min(U(r, .2, .33)*g, .45)}}, {'load-dependent-friction': 't'}, []
def rounding(r, g):
    c = con(r, 'tribo', 'hooke,coulomb-friction', 'slide', (30, 200), v=(1e-3, .06), fs=(100, 1000), nstroke=8); return c, {'friction-rounding': {'vr': U(r, 8e-3, .02)*g}}, {'friction-rounding': 't'}, ['viscous-friction', 'stribeck-friction']
def viscfr(r, g):
    c = con(r, 'cur', 'hooke,coulomb-friction', 'slide', (30, 120), F=(4, 10), v=(5e-3, .12), nstroke=10); return c, {'viscous-friction': {'cv': U(r, 8, 20)*g}}, {'viscous-friction': 't'}, ['stribeck-friction']
def presl(r, g):
    c = con(r, 'tribo', 'kelvin-voigt,coulomb-friction', 'slide', (30, 150), v=(1e-3, .02), fs=(100, 1000), L=.006, nstroke=10); return c, {'presliding': {'zl': U(r, .6e-3, 1.5e-3)*g}}, {'presliding': 't'}, ['friction-rounding']
def inhom(r, g, robot='lwr'):
    c = con(r, robot, 'hooke,coulomb-friction', 'slide', (30, 120), nstroke=8, p1=.7); return c, {'stiffness-inhomogeneity': {'iA': U(r, .4, .9)*g, 'is0': U(r, -.012, .012), 'iw': U(r, 2e-3, 7e-3)}}, {'stiffness-inhomogeneity': 'n'}, []
def aniso(r, g):
    c = con(r, 'lwr', 'hooke,coulomb-friction', 'slide', (30, 120), nstroke=8, p1=.5); return c, {'friction-anisotropy': {'an': min(U(r, .15, .3)*g, .4)*SG(r)}}, {'friction-anisotropy': 't'}, []
def toolmass(r, g):
    c = fre(r, 'cur', (20, 120)); return c, {'tool-mass': {'dm': U(r, .05, .2)*g}}, {'tool-mass': 'f'}, ['sensor-gain']
def toolcom(r, g):
    c = fre(r, 'cur', (20, 120)); s = g; return c, {'tool-com': {'x': U(r, 4e-3, .01)*s*SG(r), 'y': U(r, 4e-3, .01)*s*SG(r), 'z': U(r, .008, .02)*s*SG(r)}}, {'tool-com': 'q'}, ['sensor-misalignment']
def toolinertia(r, g):
    c = fre(r, 'lwr', (15, 60), fs=(200, 2000), f=(.3, 1.4), m=round(U(r, .8, 1.6), 3)); return c, {'tool-inertia': {'ixx': U(r, .01, .03)*g, 'iyy': U(r, .01, .03)*g, 'izz': U(r, .004, .01)*g}}, {'tool-inertia': 'q'}, []
def tipoff(r, g):
    c = con(r, 'lwr', 'hooke,coulomb-friction', 'both', (30, 90), F=(6, 15)); c['tilt'] = U(r, .08, .15); return c, {'tip-offset': {'x': U(r, 4e-3, 9e-3)*SG(r)*g, 'y': U(r, 4e-3, 9e-3)*SG(r)*g, 'z': 1e-9}}, {'tip-offset': 'q'}, []
def timeoff(r, g):
    d = U(r, .012, .03)*SG(r)*g; c = fre(r, 'lwr', (10, 40), fs=(250, 2000), f=(.3, 2.), m=round(U(r, .7, 1.6), 3), fullrate=True); return c, {'time-offset': {'dt': d}}, {'time-offset': 'f'}, ['sensor-lag'] if d > 0 else []
def slag(r, g):
    c = fre(r, 'cur', (10, 40), fs=(250, 2000), f=(.4, 2.), m=round(U(r, .7, 1.6), 3), fullrate=True); return c, {'sensor-lag': {'tau': U(r, .03, .06)*g}}, {'sensor-lag': 'f'}, ['time-offset']
def satur(r, g):
    c = con(r, r.choice(['lwr', 'cur']), 'kelvin-voigt', 'poke', (20, 90), F=(10, 30)); c['satn'] = float(r.choice([0, 1])); return c, {'saturation': {'fz': Fm(c)*U(r, .5, .7)/g**.3}}, {'saturation': 'fz'}, []
def misal(r, g):
    c = con(r, 'cur', 'hooke,coulomb-friction', 'slide', (30, 120), p1=.5, F=(6, 16)); return c, {'sensor-misalignment': {'x': np.deg2rad(U(r, -2, 2)), 'y': np.deg2rad(U(r, -2, 2)), 'z': np.deg2rad(U(r, 7, 12))*SG(r)*min(g, 1.5)}}, {'sensor-misalignment': 't'}, ['sensor-crosstalk']
def xtalk(r, g):
    c = con(r, 'cur', 'kelvin-voigt,coulomb-friction', 'both', (30, 120), p1=.5, F=(8, 20)); return c, {'sensor-crosstalk': {'fx_fz': U(r, .06, .12)*SG(r)*g, 'fy_fz': U(r, .03, .08)*SG(r)*g}}, {'sensor-crosstalk': 'fx'}, ['sensor-misalignment']
def rotor(r, g):
    c = jnt(r, 'lwr', RB, (15, 90), fs=(100, 1000), f=(.1, .9), amp=(.05, .5)); v = (ROB['lwr']['Jr']*U(r, .8, 2.2)*g).tolist(); return c, {'rotor-inertia': {'I': v, 'joints': list(range(7))}}, {'rotor-inertia': 'j0'}, []
def graverr(r, g):
    c = jnt(r, 'lwr', RB, (30, 150)); return c, {'gravity-error': {'rx': np.deg2rad(U(r, 3, 6))*g*SG(r), 'ry': np.deg2rad(U(r, 3, 6))*g*SG(r)}}, {'gravity-error': 'all'}, []
def jstri(r, g):
    c = jnt(r, 'cur', RB, (40, 200), amp=(.02, .9), vmax=.5); rb = ROB['cur']; return c, {'joint-stribeck-friction': {'dF': (np.array(c['Fc'])*U(r, .3, .6)*g).tolist(), 'vs': U(r, .03, .09), 'joints': list(range(6))}}, {'joint-stribeck-friction': 'j1'}, []
def jload(r, g):
    c = jnt(r, 'cur', RB, (40, 200)); return c, {'joint-load-friction': {'b': (np.array([.0, .1, .12, .08, .08, .0])*U(r, .8, 1.3)*g).tolist(), 'joints': list(range(6))}}, {'joint-load-friction': 'j1'}, []
def jgain(r, g):
    c = jnt(r, 'lwr', RB, (30, 150)); return c, {'joint-torque-gain': {'g': [U(r, .05, .09)*g, U(r, .05, .1)*g], 'joints': [1, 3]}}, {'joint-torque-gain': 'j1'}, []
def joff(r, g):
    c = jnt(r, 'lwr', RB, (20, 120)); js = [1, 2, 3, 4]; return c, {'joint-torque-offset': {'tau0': [U(r, .6, 1.8)*SG(r)*g, U(r, .4, 1.2)*SG(r)*g, U(r, .4, 1.2)*SG(r)*g, U(r, .3, .8)*SG(r)*g], 'joints': js}}, {'joint-torque-offset': 'j2'}, []
def ripple(r, g):
    c = drv(r, RB, (20, 120), turns=2); return c, {'joint-torque-ripple': {'A': U(r, .1, .3)*g*c['Fc'][0]*2, 'k': float(r.choice([2, 3, 4, 6])), 'phi': U(r, 0, 6.28)}}, {'joint-torque-ripple': 'j0'}, []
def hyst(r, g):
    c = con(r, 'tester', 'kelvin-voigt', 'poke', (40, 250), fs=(50, 500), v=(3e-4, .02)); return c, {'hysteresis': {'hA': Fm(c)*U(r, .07, .13)*g, 'hl': U(r, .08, .2)*c['dmax']}}, {'hysteresis': 'n'}, ['stress-softening']
def visc(r, g):
    c = con(r, 'tester', 'hertz', 'poke', (30, 120), fs=(100, 1000), v=(2e-3, .04)); return c, {'viscous-damping': {'c': Fm(c)*U(r, 3, 7)*g}}, {'viscous-damping': 'n'}, ['hunt-crossley-damping']
def kdrift(r, g):
    c = con(r, 'tester', 'hertz', 'poke', (120, 300), fs=(50, 200)); return c, {'stiffness-drift': {'alpha': U(r, .05, .09)*SG(r)*g}}, {'stiffness-drift': 'n'}, []
def soffs(r, g):
    c = con(r, 'cur', 'hertz', 'poke', (20, 90)); return c, {'surface-offset': {'z0': U(r, .5e-3, 1.2e-3)*g*SG(r)}}, {'surface-offset': 'n'}, ['tip-offset']
def payload(r, g):
    c = jnt(r, 'lwr', RB, (20, 120)); return c, {'payload': {'m': U(r, .5, 1.8)*g, 'x': U(r, -.03, .03), 'y': U(r, -.03, .03), 'z': U(r, .05, .15)}}, {'payload': 'j3'}, []
# two
def t_adrel(r, g):
    c = con(r, 'tester', 'hooke', 'poke', (40, 200), F=(2, 5), fs=(50, 500), v=(5e-4, 8e-3), hold=(.5, 10), clear=5e-3); c['s0'] = U(r, .005, .015)
    return c, {'adhesion': {'Fa': U(r, .25, .5)*min(g, 2), 'la': U(r, 1e-3, 3e-3)}, 'relaxation': {'r1': U(r, .2, .35)*min(g, 1.5), 'tau1': LU(r, .5, 5)}}, {'adhesion': 'n', 'relaxation': 'n'}, []
def t_mun(r, g):
    c = con(r, 'lwr', 'kelvin-voigt', 'both', (30, 100)); n = U(r, 1.4, 1.7)*g**.1; c['P'][0] *= c['dmax']**(1-n); c['o']['d'] = (.25, 1)
    return c, {'hertz-exponent': {'n': n}, 'coulomb-friction': {'mu': U(r, .3, .8)}}, {'hertz-exponent': 'n', 'coulomb-friction': 't'}, []
def t_drin(r, g):
    c, h, rd, _ = inhom(r, g, 'cur'); c.update(ft(r, (100, 200), (50, 250))); h['sensor-drift'] = {'fz': U(r, .3, .7)*g*SG(r), 'fx': U(r, .2, .6)*g*SG(r)}; rd['sensor-drift'] = 'fz'; return c, h, rd, []
def t_drive(r, g):
    c = drv(r, RB, (20, 100)); return c, {'joint-spring': {'ks': c['Fc'][0]*U(r, .15, .5)*g, 'q0': 0.}, 'joint-friction-asymmetry': {'a': U(r, .25, .45)*min(g, 1.6)}}, {'joint-spring': 'j0', 'joint-friction-asymmetry': 'j0'}, ['joint-torque-offset']
def t_vp(r, g):
    c = jnt(r, 'cur', 'rigid-body,joint-coulomb-friction', (30, 150)); fv = c['Fv']; c['Fv'] = fv
    return c, {'joint-viscous-friction': {'Fv': fv, 'joints': list(range(6))}, 'payload': {'m': U(r, 1.5, 4)*g, 'x': U(r, -.03, .03), 'y': U(r, -.03, .03), 'z': U(r, .05, .15)}}, {'joint-viscous-friction': 'j0', 'payload': 'j2'}, []
def t_bcom(r, g):
    c = fre(r, 'lwr', (20, 120), m=round(U(r, .3, .9), 3)); s = g; return c, {'sensor-bias': {'fx': U(r, .3, .9)*SG(r)*s, 'fy': U(r, .3, .9)*SG(r)*s, 'fz': U(r, .4, 1.2)*SG(r)*s}, 'tool-com': {'x': U(r, 5e-3, .012)*SG(r)*s, 'y': U(r, 5e-3, .012)*SG(r)*s, 'z': U(r, .01, .02)*SG(r)*s}}, {'sensor-bias': 'f', 'tool-com': 'q'}, []
def t_hum(r, g):
    c, h, rd, _ = layer(r, g, 'lwr', 'kelvin-voigt', (10, 30), fs=(500, 2000), rows=30000); c['fullrate'] = True; c['humf'] = float(r.choice([50, 60])); c['humc'] = [.5, .3, 1, .003, .004, .002]
    A = U(r, .25, .6)*g; p = U(r, 0, 6.28); h['mains-hum'] = {'a1': A*np.cos(p), 'b1': A*np.sin(p), 'a2': A*.3, 'b2': A*.1}; rd['mains-hum'] = 'fz'; return c, h, rd, []
def t_coff(r, g):
    c = con(r, 'lwr', 'hertz', 'both', (30, 100)); return c, {'surface-offset': {'z0': U(r, .6e-3, 1.3e-3)*g*SG(r)}, 'coulomb-friction': {'mu': U(r, .3, .8)}}, {'surface-offset': 'n', 'coulomb-friction': 't'}, []
# outside
def o_snap(r, g):
    c = con(r, 'tester', 'kelvin-voigt', 'poke', (30, 150), fs=(50, 500)); return up(c, snA=Fm(c)*U(r, .25, .4)*g, snd=c['dmax']*U(r, .4, .6), snw=c['dmax']*U(r, .08, .16)), {}, {}, []
def o_text(r, g):
    c = con(r, 'lwr', 'hooke,coulomb-friction', 'slide', (30, 100), v=(3e-3, .03), fs=(100, 1000), axis1=True, nstroke=8); return up(c, txA=min(U(r, .25, .4)*g, .7), txl=U(r, 4e-3, .012)), {}, {}, []
def o_cable(r, g):
    c = fre(r, 'cur', (30, 120), m=round(U(r, .3, .7), 3)); c['cable'] = [U(r, 1, 3)*g, U(r, .1, .2), [.2, U(r, -.3, .3), 1.0]]; return c, {}, {}, ['sensor-bias']
def o_xt(r, g):
    c = jnt(r, 'lwr', RB, (30, 150)); c['xt'] = [2, 1, U(r, .08, .15)*SG(r)*g]; return c, {}, {}, []
def o_warm(r, g):
    c = drv(r, RB, (120, 300), fs=(100, 200)); c['warm'] = [U(r, .4, .8)*g, c['T']*U(r, .2, .4)]; return c, {}, {}, []
def o_floor(r, g):
    c = con(r, 'cur', 'hunt-crossley', 'poke', (10, 40), fs=(200, 1000)); c['floor'] = [U(r, .3, .7)*g, U(r, 11, 19)]; return c, {}, {}, ['mains-hum']
# not excited
def n_visc(r, g):
    c = con(r, 'lwr', 'hooke,coulomb-friction', 'slide', (20, 80), v=(.01, .02), v1=True, d1=True, axis1=True, sm=.02); c['o']['d'] = (.9, .9); c['o']['v'] = (.02, .02); return c, {'viscous-friction': {'cv': U(r, 1.5, 4)}}, {'viscous-friction': 't'}, []
def n_an(r, g):
    c = con(r, 'cur', 'kelvin-voigt,coulomb-friction', 'slide', (20, 80), axis1=True); return c, {'friction-anisotropy': {'an': U(r, .15, .3)}}, {'friction-anisotropy': 't'}, []
def n_layer(r, g):
    c = con(r, 'tester', 'hunt-crossley', 'poke', (30, 120), fs=(50, 500)); return c, {'stiffening-layer': {'K2': 2*Fm(c)/c['dmax'], 'db': 1.4*c['dmax']}}, {'stiffening-layer': 'n'}, []
def n_rotor(r, g):
    c = jnt(r, 'lwr', RB, (60, 250), fs=(50, 200), f=(.01, .03), vmax=.08); return c, {'rotor-inertia': {'I': ROB['lwr']['Jr'].tolist(), 'joints': list(range(7))}}, {'rotor-inertia': 'j0'}, []
Q = lambda f: (lambda r, g: (f(r), {}, {}, []))
QUIET = [Q(lambda r: con(r, 'lwr', 'kelvin-voigt', 'poke', (10, 90))), Q(lambda r: con(r, 'lwr', 'hooke,coulomb-friction', 'slide', (20, 120))), Q(lambda r: con(r, 'lwr', 'hunt-crossley,coulomb-friction', 'both', (20, 100))),
         Q(lambda r: con(r, 'cur', 'hertz', 'poke', (6, 60))), Q(lambda r: con(r, 'cur', 'kelvin-voigt,coulomb-friction', 'slide', (20, 120))), Q(lambda r: jnt(r, 'lwr', RB, (10, 200))), Q(lambda r: jnt(r, 'cur', RB, (20, 250))),
         Q(lambda r: con(r, 'tester', 'zener', 'poke', (30, 280), fs=(50, 500), hold=(.5, 10))), Q(lambda r: drv(r, RB, (6, 100)))]
ONE = [[hertz_exp, hc_damp], [relax, relax_tip], [mullins], [layer], [compl], [stribeck], [loadfr, rounding], [viscfr, presl], [inhom], [aniso], [toolmass, toolcom], [tipoff, toolinertia], [timeoff], [slag], [satur], [misal, xtalk], [rotor, graverr], [jstri, jgain], [jload, joff], [hyst, visc], [ripple], [kdrift, soffs]]
TWO = [[t_adrel], [t_mun, t_coff], [t_drin], [t_drive], [t_vp], [t_bcom], [t_hum]]
OUT = [o_snap, o_text, o_cable, o_xt, o_warm, o_floor]
NEX = [n_visc, n_an, n_layer, n_rotor]
