"""The arm with a wrist sensor as a place for cases: joint positions and the six channels of the wrench."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

import kinid
from hidden.draw import Stream
from hidden.making import Place
from hidden.tester_cases import absorbed, base_of, proxies, still_faults
from hidden.world.arm import Body
from hidden.world.hiding import HIDEABLE
from hidden.world.protocol import Act, Protocol, perform
from hidden.world.rubbing import Rub
from hidden.world.tester import imperfect
from hidden.world.visible import visible
from hidden.world.wrist import NOISE, TIP, Swing, Wrist, carried, encoded, readings, swing_of, touched

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Arm:
    """A motion of the arm, the perfect setup that a base describes, what its tool weighs, and its quiet readings."""

    base: str
    deep: float
    swing: Swing
    setup: Wrist
    weight: Array
    plain: Array
    model: tuple[str, ...]
    seed: Stream
    rig: kinid.Rig

    @classmethod
    def draw(
        cls,
        seed: Stream,
        base: str,
        slip: bool,
        rubless: bool = False,
        protocol: Protocol | None = None,
        act: Act = perform,
    ) -> Arm:
        """A bench whose readings `model` describes fully."""
        rng = seed.generator()
        deep = float(rng.uniform(2.5e-3, 5e-3))
        protocol = protocol or Protocol(slides=slip, places=slip, turning=True, tilts=True)
        swing = swing_of(rng, dataclasses.replace(protocol, deep=deep), act)
        tool = Body(float(rng.uniform(0.15, 0.45)), (*rng.uniform(-8e-3, 8e-3, 2), float(rng.uniform(0.03, 0.06))))
        error = imperfect(rng)
        error["noise"] = NOISE * rng.uniform(0.7, 1.4)
        error["bias_error"] = rng.uniform(-1, 1, 6) * [0.01, 0.01, 0.01, 3e-4, 3e-4, 3e-4]
        mu = 0.0 if rubless else float(rng.uniform(0.15, 0.6))
        setup = Wrist(matter=base_of(rng, base, deep), rub=Rub(mu=mu), bodies=(tool,), **error)
        weight = carried(setup.bodies, swing)
        plain = readings(setup, swing, seed.generator("read"), weight, quiet=True)
        setup = dataclasses.replace(setup, peak=np.abs(plain).max(axis=0) + 1e-9)
        rig = kinid.Rig.parse(
            {
                "robot": {"model": "lwr4plus"},
                "tool": {"mass": tool.mass, "com": list(tool.com)},
                "surface": {
                    "point": swing.point.tolist(),
                    "normal": swing.axes[2].tolist(),
                    "tangent": swing.axes[0].tolist(),
                },
                "sensor": {"range": [40, 40, 120, 2, 2, 2]},
            }
        )
        model = (base,) if rubless else (base, "coulomb-friction")
        return cls(base, deep, swing, setup, weight, plain, model, seed, rig)

    def load(self, setup: Wrist) -> Array:
        """What the sensor carries in this setup, (n, 6)."""
        return self.weight if setup.bodies == self.setup.bodies else carried(setup.bodies, self.swing)

    def matters(self, setup: Wrist, proxies_too: bool = False) -> float:
        """How much what is in this setup and not in the plain one leaves in the residual of the starting model."""
        change = readings(setup, self.swing, self.seed.generator("read"), self.load(setup), quiet=True) - self.plain
        contact, place = touched(self.setup, self.swing)
        rows = self.swing.path.logged
        contact, place = contact[rows], place[rows]
        speed = np.gradient(place[:, 2], self.swing.t)
        columns = [
            np.outer(column, [0.0, 0.0, 1.0]) for column in absorbed(self.model, place[:, 2], speed, contact[:, 2])
        ]
        if "coulomb-friction" in self.model:
            columns.append(contact * [1.0, 1.0, 0.0])
        t, more = self.swing.t, []
        if proxies_too:
            columns += proxies(t, place, contact)
            more = still_faults(t, 6) + [self.weight[rows], self.plain, np.gradient(self.plain, t, axis=0)]
        return visible(change, [self.swing.into_sensor(column, TIP) for column in columns] + more, self.setup.noise)

    def log(self, setup: Wrist) -> kinid.Log:
        """What is recorded."""
        rng = self.seed.generator("log")
        wrench = readings(setup, self.swing, rng, self.load(setup))
        return kinid.Log(
            t=self.swing.t,
            q=encoded(self.swing, rng),
            wrench=wrench,
            phase=self.swing.path.phase[self.swing.path.logged],
        )


PLACE = Place("wrench", tuple(HIDEABLE), Arm.draw, always_slips=True)
