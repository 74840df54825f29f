import json,sys,numpy as np,fit,os,tomllib
D=sys.argv[1]; T=json.load(open(D+'/truth.json')); M=json.load(open(D+'/.start.json'))
from collections import Counter
print(len(T),Counter(x['group'] for x in T)); cnt=Counter(e for x in T if x['group'] in('one','two') for e in x['truth']); print(len(cnt),max(cnt.values()))
for x in T:
    c=x['case']; L=fit.readlog(D+'/'+c); rig=tomllib.load(open(f'{D}/{c}/rig.toml','rb')); t=L['t']; msg=[]
    for k,v in L.items():
        if v.dtype.kind=='f' and not np.isfinite(v).all(): msg.append('nan '+k)
    if not (np.diff(t)>0).all(): msg.append('t')
    q=np.column_stack([L[k] for k in L if k[0]=='q']) if any(k[0]=='q' for k in L) else None
    s='%s %-11s n=%d T=%.1f fs=%.0f csv=%d'%(c,x['kind'],len(t),t[-1],1/np.median(np.diff(t)),os.path.exists(f'{D}/{c}/log.csv'))
    if q is not None: s+=' |q|max %.2f vmax %.2f'%(abs(q).max(),np.percentile(abs(np.gradient(q,t,axis=0)),99.5)); s+=' quant %.2g'%M[c]['quant']
    if q is not None and q.shape[1]>1 and abs(q).max()>2.97: msg.append('qlim')
    if 'fx' in L: f=np.column_stack([L[k] for k in('fx','fy','fz')]); s+=' fmax %s tmax %.2f'%(abs(f).max(0).round(1),max(abs(L[k]).max() for k in('tx','ty','tz')));
    if 'fx' in L and (abs(f).max(0)>[40,40,120]).any(): msg.append('range')
    if 'normal_force' in L: s+=' N %.2f..%.1f depth %.1f mm'%(L['normal_force'].min(),L['normal_force'].max(),1e3*L['depth'].max())
    print(s,msg or '')
