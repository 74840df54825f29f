"""Offline builder of tables.npz: axisymmetric finite elements (scikit-fem), Taylor-Hood u-p, nearly incompressible.

1. A layer bonded to a rigid base, small strain, soft or two-layered: the flexibility matrix of its free top, from which the frictionless
   contact of any axisymmetric tip follows as a small complementarity problem (active set), for every depth.
2. The same layer's flat-punch stiffness over Poisson's ratio: the relaxation kernel of the structure from that of the shear modulus.
3. Neo-Hookean discs between bonded platens and a bonded flat punch in a layer (total Lagrange, Newton).

Lengths in tip radii (punch radius a or sphere radius R = 1), G of the top layer = 1. Run once: python fem_tables.py (some minutes).
"""
import numpy as np
from scipy.sparse import bmat
from scipy.sparse.linalg import splu, spsolve
from skfem import (MeshTri, Basis, ElementVector, ElementTriP2, ElementTriP1, BilinearForm, LinearForm, asm)
from skfem.helpers import grad


def graded(a, b, n, q):
    """n cells from a to b, each q times the one before."""
    w = q ** np.arange(n)
    return a + (b - a) * np.concatenate([[0], np.cumsum(w)]) / w.sum()


def layer_mesh(h, r_in=1.0, r_out=None, cells=26):
    r_out = r_out or r_in + 4 * max(h, 1.0)
    r = np.concatenate([graded(0, r_in, cells, 0.97), graded(r_in, r_out, 26, 1.12)[1:]])
    z = -graded(0, h, 22, 1.10)[::-1]
    return MeshTri.init_tensor(r, np.sort(z))


def spaces(mesh):
    ub = Basis(mesh, ElementVector(ElementTriP2()), intorder=4)
    return ub, ub.with_element(ElementTriP1())


def linear_system(mesh, modulus, bulk):
    """K of [u, p]; modulus(z), bulk(z): shear modulus and Lame's lambda."""
    ub, pb = spaces(mesh)

    @BilinearForm
    def a(u, v, w):
        r, z = w.x
        du, dv = grad(u), grad(v)
        sym = du[0, 0] * dv[0, 0] + du[1, 1] * dv[1, 1] + 0.5 * (du[0, 1] + du[1, 0]) * (dv[0, 1] + dv[1, 0])
        return 2 * modulus(z) * (sym + u[0] * v[0] / r ** 2) * r

    @BilinearForm
    def b(u, q, w):
        du = grad(u)
        return q * (du[0, 0] + du[1, 1] + u[0] / w.x[0]) * w.x[0]

    @BilinearForm
    def c(p, q, w):
        return p * q / bulk(w.x[1]) * w.x[0]

    A, B, C = asm(a, ub), asm(b, ub, pb), asm(c, pb)
    return ub, pb, bmat([[A, B.T], [B, -C]], format="csc") * (2 * np.pi)


def dofs_at(ub, where, comp):
    x = ub.doflocs
    names = np.zeros(ub.N, int)
    names[np.concatenate([ub.nodal_dofs[1], ub.facet_dofs[1]])] = 1
    return np.flatnonzero(where(x) & (names == comp))


def free_dofs(ub, pb, h, extra=()):
    fixed = np.concatenate([dofs_at(ub, lambda x: x[1] < -h + 1e-9, 0), dofs_at(ub, lambda x: x[1] < -h + 1e-9, 1),
                            dofs_at(ub, lambda x: x[0] < 1e-9, 0), *extra])
    return np.setdiff1d(np.arange(ub.N + pb.N), fixed)


def flexibility(h, nu, split=None, ratio=1.0, r_top=1.0):
    """radii of the top's nodes (r <= r_top) and the matrix top displacement = A force (downwards)."""
    mesh = layer_mesh(h, r_top)
    lam = lambda g: 2 * g * nu / (1 - 2 * nu)
    g = (lambda z: np.where(z > -split, 1.0, ratio)) if split else (lambda z: 1.0 + 0 * z)
    ub, pb, K = linear_system(mesh, g, lambda z: lam(g(z)))
    free = free_dofs(ub, pb, h)
    top = dofs_at(ub, lambda x: (x[1] > -1e-9) & (x[0] <= r_top + 1e-9), 1)
    top = top[np.argsort(ub.doflocs[0, top])]
    lu = splu(K[free][:, free])
    where = np.searchsorted(free, top)
    rhs = np.zeros((len(free), len(top)))
    rhs[where, np.arange(len(top))] = 1.0
    return ub.doflocs[0, top], lu.solve(rhs)[where]


def press(r, A, gap, depths):
    """force over depth of a rigid tip of profile gap(r) >= 0: active set on f >= 0, A f >= depth - gap."""
    g, out, active = gap(r), [], None
    for d in depths:
        need = d - g
        act = need > 0 if active is None else active | (need > 0) & (r < r[active].max() * 1.3 + 1e-3)
        for _ in range(200):
            idx = np.flatnonzero(act)
            f = np.linalg.solve(A[np.ix_(idx, idx)], need[idx])
            bad = f < 0
            if bad.any():
                act[idx[bad]] = False
                continue
            u = A[:, idx] @ f
            miss = (~act) & (u < need - 1e-12 * d)
            if not miss.any():
                break
            act |= miss & (r <= r[idx].max() + (r[1] - r[0]) * 3)
            if not (act & miss).any():
                break
        out.append(f.sum())
        active = act.copy()
    return np.array(out)


def punch_stiffness(h, nu):
    mesh = layer_mesh(h)
    ub, pb, K = linear_system(mesh, lambda z: 1 + 0 * z, lambda z: 2 * nu / (1 - 2 * nu) + 0 * z)
    top = dofs_at(ub, lambda x: (x[1] > -1e-9) & (x[0] <= 1 + 1e-9), 1)
    free = free_dofs(ub, pb, h, (top,))
    x = np.zeros(K.shape[0])
    x[top] = -1.0
    x[free] = spsolve(K[free][:, free], -(K @ x)[free])
    return -(K @ x)[top].sum()


def neo_hookean(mesh, h, held, lam, depths, bonded_r=True):
    """force over depth: dofs held(x) are pushed down, base bonded; W = G/2 (I1 - 3) - G ln J, p (J - 1) - p^2 / 2 lam."""
    ub, pb = spaces(mesh)
    top = dofs_at(ub, held, 1)
    top_r = dofs_at(ub, held, 0) if bonded_r else np.array([], int)
    free = free_dofs(ub, pb, h, (top, top_r))

    def kin(w):
        u, r = w["u"], w.x[0]
        du = u.grad
        frr, frz, fzr, fzz, ft = 1 + du[0, 0], du[0, 1], du[1, 0], 1 + du[1, 1], 1 + u[0] / r
        j2 = frr * fzz - frz * fzr
        inv = (fzz / j2, -fzr / j2, -frz / j2, frr / j2)      # F^-T: rr rz zr zz
        return (frr, frz, fzr, fzz, ft), inv, j2 * ft, r

    def comp(v, r):
        dv = grad(v)
        return dv[0, 0], dv[0, 1], dv[1, 0], dv[1, 1], v[0] / r

    @LinearForm
    def res_u(v, w):
        F, T, J, r = kin(w)
        V = comp(v, r)
        p = w["p"]
        ln = sum(a * b for a, b in zip(T, V)) + V[4] / F[4]
        return (sum(a * b for a, b in zip(F, V)) + (p * J - 1) * ln) * r

    @LinearForm
    def res_p(q, w):
        _, _, J, r = kin(w)
        return q * (J - 1 - w["p"] / lam) * r

    @BilinearForm
    def k_uu(u, v, w):
        F, T, J, r = kin(w)
        U, V, p = comp(u, r), comp(v, r), w["p"]
        lu = sum(a * b for a, b in zip(T, U)) + U[4] / F[4]
        lv = sum(a * b for a, b in zip(T, V)) + V[4] / F[4]
        # F^-T dF^T F^-T : V
        t = np.array([[T[0], T[1]], [T[2], T[3]]])
        du = np.array([[U[0], U[1]], [U[2], U[3]]])
        dv = np.array([[V[0], V[1]], [V[2], V[3]]])
        m = np.einsum("ij...,kj...,kl...->il...", t, du, t)
        second = np.einsum("ij...,ij...->...", m, dv) + U[4] * V[4] / F[4] ** 2
        return (sum(a * b for a, b in zip(U, V)) + p * J * lu * lv - (p * J - 1) * second) * r

    @BilinearForm
    def k_up(u, q, w):
        F, T, J, r = kin(w)
        U = comp(u, r)
        return q * J * (sum(a * b for a, b in zip(T, U)) + U[4] / F[4]) * r

    @BilinearForm
    def k_pp(p, q, w):
        return p * q / lam * w.x[0]

    x, out = np.zeros(ub.N + pb.N), []
    last = 0.0
    for d in depths:
        first = True
        for _ in range(25):
            fields = dict(u=ub.interpolate(x[:ub.N]), p=pb.interpolate(x[ub.N:]))
            B = asm(k_up, ub, pb, **fields)
            K = bmat([[asm(k_uu, ub, **fields), B.T], [B, -asm(k_pp, pb)]], format="csc")
            R = np.concatenate([asm(res_u, ub, **fields), asm(res_p, pb, **fields)])
            step = np.zeros_like(x)
            if first:
                step[top] = -(d - last)
            step[free] = spsolve(K[free][:, free], -(R + K @ step)[free])
            x += step
            if not first and np.abs(step).max() < 1e-9:
                break
            first = False
        fields = dict(u=ub.interpolate(x[:ub.N]), p=pb.interpolate(x[ub.N:]))
        out.append(-2 * np.pi * asm(res_u, ub, **fields)[top].sum())
        last = d
    return np.array(out)


def main():
    T = {}
    u = np.linspace(0, 1, 41)[1:]
    # spheres and blunted tips on one layer: depth up to 0.3 R (and half the layer)
    for h in (0.4, 0.8, 1.6, 3.2, 8.0):
        r, A = flexibility(h, 0.495)
        d = u * min(0.30, 0.45 * h)
        T[f"sphere/h{h}"] = np.array([d, press(r, A, lambda r: 1 - np.sqrt(np.maximum(1 - r ** 2, 1e-9)), d)])
        for flat in (0.3, 0.6):                                # worn sphere: flat middle, spherical flank
            z0 = 1 - np.sqrt(1 - flat ** 2)
            gap = lambda r: np.maximum(1 - np.sqrt(np.maximum(1 - r ** 2, 1e-9)) - z0, 0)
            T[f"worn{flat}/h{h}"] = np.array([d, press(r, A, gap, d)])
        print("sphere", h, flush=True)
    for h1, ratio in ((0.8, 4.0), (1.6, 4.0), (1.6, 0.3)):    # skin on fat, fat on muscle
        r, A = flexibility(3.2, 0.495, h1, ratio)
        d = u * 0.30
        T[f"sphere2/h{h1}e{ratio}"] = np.array([d, press(r, A, lambda r: 1 - np.sqrt(np.maximum(1 - r ** 2, 1e-9)), d)])
    nus = np.array([0.40, 0.45, 0.47, 0.48, 0.49, 0.495, 0.499, 0.4995])
    for h in (0.3, 0.6, 1.2, 2.5, 6.0):
        T[f"punch/h{h}"] = np.array([nus, [punch_stiffness(h, n) for n in nus]])
    print("punch", flush=True)
    lam = 2 * 0.495 / (1 - 0.99)
    for h in (0.5, 1.0, 2.0):                                  # bonded disc, height h radii
        mesh = MeshTri.init_tensor(graded(0, 1, 20, 0.93), np.sort(-graded(0, h, 24, 1.0)))
        d = u * 0.25 * h
        T[f"disc/h{h}"] = np.array([d, neo_hookean(mesh, h, lambda x: x[1] > -1e-9, lam, d)])
        print("disc", h, flush=True)
    for h in (1.0, 2.0, 4.0):                                  # flat punch bonded to a layer
        mesh = layer_mesh(h, cells=14)
        d = u * 0.25
        T[f"neo/h{h}"] = np.array([d, neo_hookean(mesh, h, lambda x: (x[1] > -1e-9) & (x[0] <= 1 + 1e-9), lam, d)])
        print("neo", h, flush=True)
    np.savez_compressed("tables.npz", **{k.replace("/", "__"): v for k, v in T.items()})


if __name__ == "__main__":
    main()
