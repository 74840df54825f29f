"""A finite block of silicone under a tip, by scikit-fem's finite elements: what its sides do to stiffness and damping.

Plane strain, a strip 10 mm deep on a ground that it sticks to, 60 mm to a plane of symmetry; a rigid tip 4 mm wide
without friction presses it at a distance e from its side. The side is free, sticks to a rigid wall, or slides along it.
Stiffness is the work of a unit press, uᵀ A u. Damping is that of a Kelvin-Voigt solid whose shear alone is viscous,
uᵀ D u: to first order in the frequency the motion is that of the slow press. Where bulk and shear are viscous alike,
damping follows stiffness exactly, and so do storage and loss of a Zener solid (correspondence principle: R. M.
Christensen, Theory of Viscoelasticity, 1982).
"""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
from numpy.typing import NDArray

from kinid.lab.materials import FREE_SIDE, WALLED_SIDE, Side, material

skfem = pytest.importorskip("skfem")

Array = NDArray[np.float64]

DEPTH, LONG, HALF_TIP, POISSON = 0.010, 0.060, 0.002, 0.49
AT = 1e-3 * np.array([0.0, 2.0, 4.0, 5.0, 6.0, 8.0, 10.0, 15.0, 20.0, 30.0])


@cache
def pressed(kind: str, cell: float = 1e-3, at: tuple[float, ...] = tuple(AT)) -> tuple[Array, Array]:
    """Stiffness and damping of a press at some places [m], over those of the last one, (n,) both."""
    from skfem.helpers import ddot, div, sym_grad

    columns, rows = round(LONG / cell), round(DEPTH / cell)
    mesh = skfem.MeshQuad.init_tensor(np.linspace(0, LONG, columns + 1), np.linspace(0, DEPTH, rows + 1))
    basis = skfem.Basis(mesh, skfem.ElementVector(skfem.ElementQuad2()))
    shear = skfem.BilinearForm(lambda u, v, _: 2 * ddot(sym_grad(u), sym_grad(v))).assemble(basis)
    bulk = skfem.BilinearForm(lambda u, v, _: div(u) * div(v)).assemble(basis)
    stiff, viscous = shear + 2 * POISSON / (1 - 2 * POISSON) * bulk, shear - 2 / 3 * bulk
    side = basis.get_dofs(lambda p: np.isclose(p[0], 0.0))
    held = [basis.get_dofs(lambda p: np.isclose(p[1], 0.0)).all()]
    held.append(basis.get_dofs(lambda p: np.isclose(p[0], LONG)).all(["u^1"]))
    held += {"free": [], "stuck": [side.all()], "slides": [side.all(["u^1"])]}[kind]
    out = []
    for place in at:
        under = basis.get_dofs(lambda p, x=place: np.isclose(p[1], DEPTH) & (np.abs(p[0] - x) <= HALF_TIP + 1e-9))
        tip = under.all(["u^2"])
        if kind == "stuck":
            tip = np.setdiff1d(tip, side.all())
        u = np.zeros(basis.N)
        u[tip] = -1.0
        u = skfem.solve(*skfem.condense(stiff, x=u, D=np.unique(np.concatenate([*held, tip]))))
        out.append((u @ (stiff @ u), u @ (viscous @ u)))
    stiffness, damping = np.array(out).T
    return stiffness / stiffness[-1], damping / damping[-1]


def test_a_finer_mesh_says_the_same() -> None:
    at = (0.0, 5e-3, 30e-3)
    for coarse, fine in zip(pressed("free", at=at), pressed("free", 0.5e-3, at)):
        assert np.abs(coarse - fine).max() < 0.02


def test_at_a_free_side_both_fall_and_at_a_wall_both_rise() -> None:
    """So damping that rises towards the rim of a mould is that of a material which its walls hold."""
    (free, damped), (walled, held), (sliding, slid) = (pressed(kind) for kind in ("free", "stuck", "slides"))
    assert (np.diff(free) > 0).all()
    assert (np.diff(damped) > 0).all()
    assert np.abs(damped / free - 1).max() < 0.05
    assert (walled[AT >= 2e-3][:-1] > 1.0).all()
    assert (held[AT >= 2e-3][:-1] > 1.0).all()
    assert sliding[0] < 0.6
    assert 1.05 < slid.max() < sliding.max() < 1.25
    print("e [mm]          ", *(f"{1e3 * e:5.0f}" for e in AT))
    for name, values in (("free: K", free), ("free: C", damped), ("wall: K", walled), ("wall: C", held)):
        print(f"{name:16s}", *(f"{v:5.2f}" for v in values))


@pytest.mark.parametrize(("kind", "law", "nearest"), [("free", FREE_SIDE, 0.0), ("stuck", WALLED_SIDE, 4e-3)])
def test_the_laboratorys_sides_are_those_of_the_block(kind: str, law: Side, nearest: float) -> None:
    ask = nearest <= AT
    for values, most in zip(pressed(kind), (0.03, 0.05)):
        assert np.abs(law(0.05 - AT[ask], np.zeros(ask.sum())) - values[ask]).max() < most


@pytest.mark.parametrize(("name", "law"), [("free-mould", FREE_SIDE), ("walled-mould", WALLED_SIDE)])
def test_a_mould_has_them_on_all_sides(name: str, law: Side) -> None:
    rim, middle = np.array([-0.045, -0.025]), np.array([-0.025, -0.045])
    here, plain = material(name).at(rim, middle), material("mould").at(np.full(2, -0.025), np.full(2, -0.025))
    assert np.allclose(here["stiffness"] / plain["stiffness"], 1 + law.change * np.exp(-5e-3 / law.length), rtol=0.01)
    assert np.allclose(here["damping"] / plain["damping"], 1 + law.change * np.exp(-5e-3 / law.length), rtol=0.01)
