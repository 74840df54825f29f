"""Force laws from linear finite elements (scikit-fem): indented axisymmetric slabs, inclusions in plane strain.

Selective reduced integration (Hughes 1980) keeps near-incompressible slabs from locking; contact is frictionless and
solved by an active set on the slab's condensed surface compliance.
"""
from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.sparse.linalg import splu
from skfem import Basis, BilinearForm, ElementQuad1, ElementVector, MeshQuad

@BilinearForm
def _shear_axi(u, v, w):
    """2 mu eps:eps, axisymmetric, E = 1."""
    r = w.x[0]
    du, dv = u.grad, v.grad
    hoop, shear = (u.value[0] / r) * (v.value[0] / r), 0.5 * (du[0][1] + du[1][0]) * (dv[0][1] + dv[1][0])
    return 2 * np.pi * r * 2 * w.mu * (du[0][0] * dv[0][0] + du[1][1] * dv[1][1] + hoop + shear)

@BilinearForm
def _bulk_axi(u, v, w):
    """lambda div u div v, axisymmetric."""
    r = w.x[0]
    div = lambda a: a.grad[0][0] + a.grad[1][1] + a.value[0] / r
    return 2 * np.pi * r * w.lam * div(u) * div(v)

@BilinearForm
def _plane(u, v, w):
    """Plane strain; w.e holds Young's modulus at the quadrature points."""
    lam, mu = w.e * w.nu / (1 + w.nu) / (1 - 2 * w.nu), w.e / 2 / (1 + w.nu)
    du, dv = u.grad, v.grad
    div = lambda g: g[0][0] + g[1][1]
    shear = 0.5 * (du[0][1] + du[1][0]) * (dv[0][1] + dv[1][0])
    return lam * div(du) * div(dv) + 2 * mu * (du[0][0] * dv[0][0] + du[1][1] * dv[1][1] + shear)

def surface_compliance(nu: float, thickness: float, rc: float = 1.1, n: int = 90) -> tuple[np.ndarray, np.ndarray]:
    """Radii [lengths of the tip] and matrix of surface sink per unit ring force for a slab bonded to a plate (E = 1)."""
    far = max(3.0 * thickness, 8.0)
    r = np.concatenate([np.linspace(0, rc, n), rc + (far - rc) * np.linspace(0, 1, 36)[1:] ** 2.2])
    z = -thickness * np.linspace(0, 1, 46)[::-1] ** 2.2
    mesh, element = MeshQuad.init_tensor(r, z), ElementVector(ElementQuad1())
    full, reduced = Basis(mesh, element, intorder=3), Basis(mesh, element, intorder=1)
    stiff = _shear_axi.assemble(full, mu=0.5 / (1 + nu)) + _bulk_axi.assemble(reduced, lam=nu / (1 + nu) / (1 - 2 * nu))
    fixed = np.unique(np.concatenate([full.get_dofs(lambda x: np.isclose(x[1], -thickness)).all(),
                                      full.get_dofs(lambda x: np.isclose(x[0], 0)).all("u^1")]))
    free, nodes = np.setdiff1d(np.arange(full.N), fixed), np.flatnonzero(np.isclose(mesh.p[1], 0) & (mesh.p[0] <= rc + 1e-9))
    nodes = nodes[np.argsort(mesh.p[0, nodes])]
    dofs = full.nodal_dofs[1, nodes]
    rhs = np.zeros((full.N, len(dofs)))
    rhs[dofs, np.arange(len(dofs))] = 1.0
    lu, u = splu(stiff[free][:, free].tocsc()), np.zeros_like(rhs)
    u[free] = lu.solve(rhs[free])
    return mesh.p[0, nodes], u[dofs]

def press(compliance: np.ndarray, gap: np.ndarray, depths: np.ndarray) -> np.ndarray:
    """Force over depth (E = 1) of a rigid profile `gap` above the surface."""
    out, active = [], gap <= gap.min() + 1e-9
    for d in depths:
        active |= gap < 0.6 * d
        for _ in range(60):
            p, a = np.zeros(len(gap)), np.flatnonzero(active)
            p[a] = np.linalg.solve(compliance[np.ix_(a, a)], d - gap[a])
            new = np.where(active, p > 0, d - gap - compliance @ p > 1e-9)
            if np.array_equal(new, active): break
            active = new
        out.append(p.sum())
    return np.array(out)

@dataclass
class Law:
    """Force shape over depth: f = F0 S(d), S(d0) = 1; `n` the best free exponent, `misfit` its relative rms error."""
    name: str
    d0: float
    dmax: float
    n: float
    misfit: float
    table: np.ndarray            # S on linspace(0, dmax)

def _law(name: str, x: np.ndarray, f: np.ndarray, length: float, base_n: float | None, smooth: bool = True) -> Law:
    """Table in metres from forces over depths x [tip lengths]; misfit against a power law (base_n, or its own)."""
    dmax, d0 = x[-1] * length, 0.5 * x[-1] * length
    fit = lambda n: (f @ x**n) / (x**n @ x**n) * x**n
    ns = np.linspace(0.9, 2.6, 681) if base_n is None else np.array([base_n])
    errs = [np.sqrt(np.mean((f - fit(n)) ** 2) / np.mean(f**2)) for n in ns]
    i, grid = int(np.argmin(errs)), np.linspace(0, 1, 1201)[1:]
    if smooth:
        c = np.polyfit(np.log(x / x[-1]), np.log(f), 3, w=np.sqrt(f))
        s = np.exp(np.polyval(c, np.log(grid)))
    else: s = np.interp(grid, np.r_[0, x / x[-1]], np.r_[0, f])
    s = np.r_[0, s]
    return Law(name, d0, dmax, float(ns[i]), float(errs[i]), s / np.interp(0.5, np.linspace(0, 1, 1201), s))

def build() -> dict[str, Law]:
    """All force laws of the world: tips of 12.5 mm radius, 7 mm for the stepped one; depths to 6.9 mm."""
    laws: dict[str, Law] = {}
    x = np.linspace(0.02, 1.0, 50) ** 1.5
    ball = lambda r: np.where(r < 1, 1 - np.sqrt(np.maximum(1 - r**2, 0)), 1 + (r - 1) * 40)
    for name, nu, h in (("ball-foam", 0.30, 6.0), ("ball-gel", 0.45, 9.0)):
        r, c = surface_compliance(nu, h)
        d = x * 0.55
        laws[name] = _law(name, d, press(c, ball(r), d), 0.0125, 1.5)
    r, c = surface_compliance(0.42, 1.5)
    laws["ball-thin"] = _law("ball-thin", x * 0.55, press(c, ball(r), x * 0.55), 0.0125, None)
    r, c = surface_compliance(0.42, 8.0)
    d = x * 0.55
    laws["cone"] = _law("cone", d, press(c, 1.2 * (np.sqrt(r**2 + 0.03**2) - 0.03), d), 0.0125, None)
    for name, edge in (("punch", 0.01), ("punch-worn", 0.022)):
        g = np.where(r > 1 - edge, (r - 1 + edge) ** 2 / (2 * edge), 0.0)
        laws[name] = _law(name, d, press(c, g, d), 0.0125, 1.0)
    r, c = surface_compliance(0.35, 5.0, rc=2.2, n=140)
    g, d = np.where(r <= 1.0, 0.0, np.where((r < 1.25) | (r > 1.9), 40.0, 0.3)), np.linspace(0.01, 1.0, 100)
    return laws | {"stepped": _law("stepped", d, press(c, g, d), 0.007, None, smooth=False)}

def profiles() -> dict[str, tuple[np.ndarray, np.ndarray]]:
    """Relative change of stiffness over place [m] above an inclusion, an edge, a slope (plane strain)."""
    xs, zs = np.linspace(-60, 60, 121), -40 * np.linspace(0, 1, 34)[::-1] ** 1.5
    mesh = MeshQuad.init_tensor(xs, zs)
    basis = Basis(mesh, ElementVector(ElementQuad1()), intorder=3)
    qx, qz = basis.global_coordinates().value
    fields = {"inclusion": 1 + 7 * ((qx**2 + (qz + 9) ** 2) < 6**2), "edge": 1 + 0.8 * (qx > 0),
              "two": 1 + 6 * (((qx + 14) ** 2 + (qz + 8) ** 2) < 25) - 0.9 * (((qx - 13) ** 2 + (qz + 8) ** 2) < 25),
              "slope": 1 + 0.5 * np.tanh(qx / 25)}
    fixed = basis.get_dofs(lambda p: np.isclose(p[1], -40)).all()
    free, top = np.setdiff1d(np.arange(basis.N), fixed), np.flatnonzero(np.isclose(mesh.p[1], 0))
    top = top[np.argsort(mesh.p[0, top])]
    dofs, places = basis.nodal_dofs[1, top], np.arange(-40, 41, 2.0)
    loads = np.exp(-0.5 * ((mesh.p[0, top][:, None] - places) / 3.0) ** 2)
    loads /= loads.sum(0)
    out = {}
    for name, field in fields.items():
        k, rhs = _plane.assemble(basis, e=field, nu=0.4), np.zeros((basis.N, len(places)))
        rhs[dofs] = loads
        u, full = splu(k[free][:, free].tocsc()).solve(rhs[free]), np.zeros_like(rhs)
        full[free] = u
        stiff = 1 / np.sum(full[dofs] * loads, axis=0)
        stiff = stiff / stiff.mean() - 1
        out[name] = (places * 1e-3, stiff / np.abs(stiff).max())
    return out
