"""The material tester as a place for cases: t, depth and normal force, with or without slip and tangential forces."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray
from scipy.signal import lfilter

import kinid
from hidden.draw import Stream
from hidden.making import Place
from hidden.world.hiding import HIDEABLE
from hidden.world.material import Matter
from hidden.world.path import Path
from hidden.world.protocol import Act, Protocol, perform
from hidden.world.rubbing import Rub
from hidden.world.tester import Setup, imperfect, path_of, readings
from hidden.world.visible import only, visible

Array = NDArray[np.float64]


def base_of(rng: np.random.Generator, base: str, deep: float) -> Matter:
    """A material that a base of the catalogue describes."""
    peak = float(np.exp(rng.uniform(np.log(3.0), np.log(10.0))))  # force at the greatest depth [N]
    n = {"hertz": 1.5, "hunt-crossley": float(rng.uniform(1.1, 1.9))}.get(base, 1.0)
    return Matter(
        stiffness=1e3 * peak * (1e-3 / deep) ** n,
        profile=np.inf if n == 1.0 else 1.0 / (n - 1.0),
        dashpot=float(rng.uniform(1.5, 10.0)) if base == "kelvin-voigt" else 0.0,
        loss=float(rng.uniform(0.4, 3.0)) if base == "hunt-crossley" else 0.0,
    )


def absorbed(model: tuple[str, ...], depth: Array, speed: Array, force: Array) -> list[Array]:
    """Changes of the normal force (n,) that the parameters of a base make, for true depth, its rate and the force."""
    inside, speed = np.maximum(depth, 0.0), speed * (depth > 0)
    return {
        "hooke": [inside],
        "kelvin-voigt": [inside, speed],
        "hertz": [inside**1.5],
        "hunt-crossley": [force, force * speed, force * np.log(np.maximum(inside, 1e-6))],
    }[model[0]]


def proxies(t: Array, place: Array, contact: Array) -> list[Array]:
    """Changes of the contact forces (n, 3) that effects of the catalogue make in their simplest form.

    Damping, several branches of relaxation, a clock, an offset, stiffness that drifts or depends on the place, adhesion
    and a second layer; film, clock and load dependence of friction. place: x, y, depth (n, 3); contact: forces (n, 3).
    """
    inside = (place[:, 2] > 0).astype(float)
    depth, force = place[:, 2] * inside, contact[:, 2]
    rate = np.gradient(place, t, axis=0)
    speed = rate[:, 2] * inside
    normal = [
        inside,
        depth,
        depth**2,
        speed,
        force,
        force * speed,
        np.gradient(force, t),
        force * t,
        force * place[:, 0],
        force * place[:, 1],
        np.maximum(depth - 0.5 * depth.max(), 0.0),
    ]
    for tau in (0.03, 0.2, 1.0, 5.0):
        decay = np.exp(-(t[1] - t[0]) / tau)
        normal.append(lfilter([1 - decay], [1, -decay], force))
    out = [only(3, 2, column) for column in normal]
    flat = np.array([1.0, 1.0, 0.0])
    for column in (
        contact,
        rate * inside[:, None],
        np.gradient(contact, t, axis=0),
        contact * force[:, None],
        contact * np.abs(rate[:, :2]).sum(axis=1)[:, None],
    ):
        out += [column * flat, column * [1.0, 0.0, 0.0]]
    return out


def still_faults(t: Array, k: int) -> list[Array]:
    """Bias and drift of each of k channels, (n, k)."""
    return [only(k, channel, column) for channel in range(k) for column in (np.ones_like(t), t)]


@dataclass(frozen=True, eq=False)
class Tester:
    """A path on the tester, the perfect setup that a base describes, and its quiet readings."""

    base: str
    slip: bool
    deep: float
    path: Path
    setup: Setup
    plain: Array
    model: tuple[str, ...]
    seed: Stream
    rig: kinid.Rig = field(default_factory=kinid.Rig)

    @classmethod
    def draw(
        cls,
        seed: Stream,
        base: str,
        slip: bool,
        rubless: bool = False,
        protocol: Protocol | None = None,
        act: Act = perform,
    ) -> Tester:
        """A bench whose readings `model` describes fully."""
        rng = seed.generator()
        deep = float(rng.uniform(2.5e-3, 5e-3))
        path = path_of(rng, dataclasses.replace(protocol or Protocol(slides=slip, places=slip), deep=deep), act)
        mu = 0.0 if rubless or not slip else float(rng.uniform(0.15, 0.6))
        setup = Setup(matter=base_of(rng, base, deep), rub=Rub(mu=mu), **imperfect(rng))
        model = (base, "coulomb-friction") if slip and not rubless else (base,)
        plain = readings(setup, path, seed.generator("read"), quiet=True)
        setup = dataclasses.replace(setup, peak=np.abs(plain).max(axis=0) + 1e-9)
        return cls(base, slip, deep, path, setup, plain, model, seed)

    def matters(self, setup: Setup, proxies_too: bool = False) -> float:
        """How much what is in this setup and not in the plain one leaves in the residual of the starting model."""
        change = readings(setup, self.path, self.seed.generator("read"), quiet=True) - self.plain
        rows = self.path.logged
        normal = absorbed(self.model, self.path.x[rows, 2], self.path.rate[rows, 2], self.plain[:, 2])
        columns = [only(3, 2, column) for column in normal]
        if "coulomb-friction" in self.model:
            columns.append(self.plain * [1.0, 1.0, 0.0])
        if proxies_too:
            t = self.path.t[rows]
            columns += proxies(t, self.path.x[rows], self.plain) + still_faults(t, 3)
        here = slice(None) if self.slip else slice(2, 3)
        return visible(change[:, here], [column[:, here] for column in columns], self.setup.noise[here])

    def log(self, setup: Setup) -> kinid.Log:
        """What is recorded."""
        rows = self.path.logged
        rng = self.seed.generator("log")
        # a table's scales are finer than those of a depth that bends with the frame
        noise = setup.motion_noise * np.array([0.4, 0.4, 1.0])
        motion = self.path.x[rows] + noise * rng.standard_normal((len(self.path.t[rows]), 3))
        force = readings(setup, self.path, rng)
        contact = {"depth": motion[:, 2], "normal_force": force[:, 2]}
        if self.slip:
            contact |= {
                "slip1": motion[:, 0],
                "slip2": motion[:, 1],
                "tangential_force1": force[:, 0],
                "tangential_force2": force[:, 1],
            }
        return kinid.Log(t=self.path.t[rows], contact=contact, phase=self.path.phase[rows])


#: effects that need a robot: the tester has none, and a gain there is a stiffness
ROBOT = {"tool-mass", "tool-com", "tool-inertia", "tip-offset", "sensor-gain"}
PLACE = Place("force-depth", tuple(name for name in HIDEABLE if name not in ROBOT), Tester.draw)
