"""The arm in free motion as a place for cases: joint positions and joint torques."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

import kinid
from hidden.case import Case
from hidden.draw import WEAK, Stream, choose, tuned, wanted
from hidden.world.arm import Body
from hidden.world.drives import JOINTS, NOISE, SCALE, STRANGE, Drives, Excitation, excite, friction, readings, torques
from hidden.world.hiding import Plan
from hidden.world.wrist import ENCODER, JITTER

Array = NDArray[np.float64]

WORLD = "joints"
FRICTION = ("joint-coulomb-friction", "joint-viscous-friction", "joint-torque-offset")
#: what the starting model may hold beside rigid-body dynamics
RUNGS = ((), FRICTION[:1], FRICTION[:2], FRICTION)


@dataclass(frozen=True, eq=False)
class Bench:
    """A motion, joints that the starting model describes, and their quiet readings."""

    motion: Excitation
    setup: Drives
    plain: Array
    torque: Array
    model: tuple[str, ...]
    seed: Stream
    rig: kinid.Rig

    @classmethod
    def draw(
        cls, seed: Stream, rungs: tuple[str, ...], fast: bool = True, seconds: float = 50.0, still: tuple[int, ...] = ()
    ) -> Bench:
        """Joints with the friction that these rungs of the catalogue name."""
        rng = seed.generator()
        motion = excite(rng, seconds, fast, still)
        tool = Body(float(rng.uniform(0.3, 1.5)), (*rng.uniform(-0.02, 0.02, 2), float(rng.uniform(0.03, 0.08))))
        bodies = (tool,) if rng.uniform() < 0.5 else ()
        setup = Drives(
            dry=SCALE * rng.uniform(0.3, 2.0, JOINTS) * (FRICTION[0] in rungs),
            viscous=SCALE * rng.uniform(0.5, 3.0, JOINTS) * (FRICTION[1] in rungs),
            offset=SCALE * rng.uniform(-1.0, 1.0, JOINTS) * (FRICTION[2] in rungs),
            bodies=bodies,
            clock_error=float(rng.uniform(-2e-4, 2e-4)),
            offset_error=rng.uniform(-0.1, 0.1, JOINTS) * NOISE,
            noise=NOISE * rng.uniform(0.7, 1.4),
        )
        tables: dict[str, Any] = {"robot": {"model": "lwr4plus"}}
        if bodies:
            tables["tool"] = {"mass": tool.mass, "com": list(tool.com)}
        torque = torques(setup, motion)
        plain = readings(setup, motion, torque, seed.generator("read"), quiet=True)
        setup = dataclasses.replace(setup, peak=np.abs(plain).max(axis=0))
        return cls(motion, setup, plain, torque, ("rigid-body", *rungs), seed, kinid.Rig.parse(tables))

    def _torque(self, setup: Drives) -> Array:
        """Torque of this setup; dynamics are computed anew only where they differ."""
        plain = self.setup
        if all(getattr(setup, name) is getattr(plain, name) for name in ("bodies", "motors", "softness")):
            return (
                self.torque + friction(setup, self.motion) - friction(plain, self.motion) + setup.offset - plain.offset
            )
        return torques(setup, self.motion)

    def read(self, setup: Drives, rng: np.random.Generator, quiet: bool = False) -> Array:
        """What the torque sensors log, (n, 7)."""
        return readings(setup, self.motion, self._torque(setup), rng, quiet)

    def matters(self, setup: Drives, proxies_too: bool = False) -> float:
        """What this setup leaves in the residual of the starting model, as a multiple of the noise.

        With proxies, what friction of all kinds, inertia, gain, clock, gear and drift of each joint can follow is
        absorbed too.
        """
        change = (self.read(setup, self.seed.generator("read"), quiet=True) - self.plain) / self.setup.noise
        t, (_, dq, ddq) = self.motion.t, self.motion.logged
        columns = {FRICTION[0]: self.motion.directions, FRICTION[1]: dq, FRICTION[2]: np.ones_like(dq)}
        for j in range(JOINTS):
            a = [columns[name][:, j] for name in FRICTION if name in self.model or proxies_too] or [np.zeros_like(t)]
            if proxies_too:
                torque = self.plain[:, j]
                a += [
                    np.abs(dq[:, j]),
                    ddq[:, j],
                    torque,
                    np.gradient(torque, t),
                    np.gradient(np.gradient(torque, t), t),
                    t,
                ]
            a = np.stack(a, axis=1)
            a /= np.linalg.norm(a, axis=0) + 1e-300
            change[:, j] -= a @ np.linalg.lstsq(a, change[:, j], rcond=1e-10)[0]
        return float(np.sqrt(np.mean(change**2)))

    def log(self, setup: Drives) -> kinid.Log:
        """What is recorded."""
        rng = self.seed.generator("log")
        q = self.motion.logged[0]
        q = ENCODER * np.round((q + JITTER * rng.standard_normal(q.shape)) / ENCODER)
        return kinid.Log(t=self.motion.t, q=q, tau=self.read(setup, rng), phase=np.full(len(q), "free"))


@dataclass(frozen=True)
class Hideable:
    """An effect that joints can hide: rungs of friction that may be there, and how it is drawn."""

    draw: Callable[[np.random.Generator], Plan]
    family: str
    rungs: tuple[tuple[str, ...], ...] = RUNGS


def _per_joint(name: str, low: float, high: float, start: float, signed: bool, scale: Array = SCALE) -> Any:
    """A figure of each joint: all of them times the size."""

    def draw(rng: np.random.Generator) -> Plan:
        way = scale * rng.uniform(0.3, 1.0, JOINTS) * (rng.choice([-1.0, 1.0], JOINTS) if signed else 1.0)
        return Plan(lambda d, x: dataclasses.replace(d, **{name: getattr(d, name) + x * way}), low, high, start)

    return draw


def _load(rng: np.random.Generator) -> Plan:
    """A second body behind the flange that nobody told of; most of its mass is in the middle."""
    com = tuple(rng.uniform(-0.03, 0.03, 3) + [0, 0, 0.03])
    size = rng.uniform(0.01, 0.03, 3) ** 2

    def put(d: Drives, x: float) -> Drives:
        inertia = (*(x * (size.sum() - size)), 0.0, 0.0, 0.0)
        return dataclasses.replace(d, bodies=(*d.bodies, Body(x, com, inertia)))

    return Plan(put, 2e-3, 3.0, 0.1)


def _chain(d: Drives, **changes: Any) -> Drives:
    return dataclasses.replace(d, chain=dataclasses.replace(d.chain, **changes))


def _lag(rng: np.random.Generator) -> Plan:
    split = rng.uniform(0.02, 0.15)
    return Plan(lambda d, x: _chain(d, poles=((1 - split) * x, split * x)), 1e-3, 0.04, 4e-3)


def _late(rng: np.random.Generator) -> Plan:
    way = float(rng.choice([-1.0, 1.0]))
    return Plan(lambda d, x: _chain(d, late=way * x), 8e-4, 0.05, 4e-3)


def _drift(rng: np.random.Generator) -> Plan:
    way = NOISE * rng.uniform(0.3, 1.0, JOINTS) * rng.choice([-1.0, 1.0], JOINTS)
    return Plan(lambda d, x: _chain(d, drift=x * way), 0.1, 40.0, 2.0)


HIDEABLE: dict[str, Hideable] = {
    "joint-coulomb-friction": Hideable(_per_joint("dry", 0.005, 3.0, 0.2, signed=False), "dry", RUNGS[:1]),
    "joint-viscous-friction": Hideable(_per_joint("viscous", 0.005, 5.0, 0.4, signed=False), "viscous", RUNGS[:2]),
    "joint-friction-asymmetry": Hideable(_per_joint("one_sided", 0.005, 3.0, 0.2, signed=True), "viscous", RUNGS[2:]),
    "joint-torque-offset": Hideable(_per_joint("offset", 0.005, 3.0, 0.1, signed=True), "offset", RUNGS[:3]),
    "rotor-inertia": Hideable(_per_joint("motors", 1e-3, 2.0, 0.05, signed=False), "inertia"),
    "joint-torque-gain": Hideable(_per_joint("gain", 1e-3, 0.4, 0.02, signed=True, scale=np.ones(JOINTS)), "gain"),
    "joint-elasticity": Hideable(
        _per_joint("softness", 2e-6, 8e-5, 3e-5, signed=False, scale=np.array([1, 1, 1, 1, 2, 4, 8.0])), "elastic"
    ),
    "payload": Hideable(_load, "load"),
    "time-offset": Hideable(_late, "clock"),
    "sensor-lag": Hideable(_lag, "clock"),
    "sensor-drift": Hideable(_drift, "drift"),
    "quantization": Hideable(lambda r: Plan(lambda d, x: _chain(d, step=x * NOISE), 1.0, 20.0, 4.0), "mark"),
    "saturation": Hideable(lambda r: Plan(lambda d, x: _chain(d, limit=(1.0 - x) * d.peak), 0.02, 0.6, 0.2), "mark"),
}


def make(kind: str, number: int, seed: int) -> Case:
    """The case of this kind and number."""
    made = {"none": _nothing, "single": partial(_hidden, 1), "pair": partial(_hidden, 2), "outside": _outside}
    return made[kind](number, seed)


def _case(kind: str, bench: Bench, setup: Drives, truth: tuple[str, ...], number: int, note: str) -> Case:
    name = f"{kind}/{WORLD}/{'+'.join(truth) or 'none'}/{number}"
    return Case(
        name,
        kind,
        bench.log(setup),
        bench.rig,
        bench.model,
        frozenset(truth),
        (*bench.model, *truth),
        bench.seed.number,
        note,
    )


def _nothing(number: int, seed: int) -> Case:
    bench = Bench.draw(Stream(seed, WORLD, "none", number), RUNGS[number % len(RUNGS)])
    return _case("none", bench, bench.setup, (), number, "nothing hidden")


def _hidden(count: int, number: int, seed: int) -> Case:
    kind = {1: "single", 2: "pair"}[count]
    first = choose(tuple(HIDEABLE), number, seed, kind + WORLD)
    for attempt in range(20):
        stream = Stream(seed, WORLD, kind, number, attempt)
        rng = stream.generator("what")
        names = (first,) if count == 1 else (first, _second(rng, first))
        rungs = [rung for rung in RUNGS if all(rung in HIDEABLE[name].rungs for name in names)]
        bench = Bench.draw(stream, rungs[int(rng.integers(len(rungs)))])
        setup, notes, enough = bench.setup, [], True
        for name in names:
            plan = HIDEABLE[name].draw(rng)
            size, found = _sized(bench, plan, wanted(rng))
            setup = plan.put(setup, size)
            notes.append(f"{name} of size {size:.3g}, {found:.3g} times the noise")
            enough = enough and found > 0.75 * WEAK
        if enough:
            return _case(kind, bench, setup, names, number, "; ".join(notes))
    raise RuntimeError(f"{first} can't be hidden in {WORLD}")


def _outside(number: int, seed: int) -> Case:
    kind = choose(tuple(STRANGE), number, seed, "outside" + WORLD)
    for attempt in range(20):
        stream = Stream(seed, WORLD, "outside", number, attempt)
        rng = stream.generator("what")
        # what goes with dry friction is told from it only where that is in the starting model
        rungs = RUNGS[int(rng.integers(1 if kind in ("stribeck", "load-friction") else 0, len(RUNGS)))]
        bench = Bench.draw(stream, rungs)
        shape = int(rng.integers(2**31))
        plan = Plan(lambda d, x: dataclasses.replace(d, strange=(kind, x, shape)), 0.0, np.inf, STRANGE[kind])  # noqa: B023
        size, found = _sized(bench, plan, wanted(rng, 0.6), proxies=True)
        if found > 0.45:
            case = _case(
                "outside",
                bench,
                plan.put(bench.setup, size),
                (),
                number,
                f"{kind} of size {size:.3g}, {found:.3g} times the noise",
            )
            return dataclasses.replace(case, name=f"outside/{WORLD}/{kind}/{number}")
    raise RuntimeError(f"{kind} can't be seen in {WORLD}")


def _sized(bench: Bench, plan: Plan, aim: float, proxies: bool = False) -> tuple[float, float]:
    return tuned(lambda size: bench.matters(plan.put(bench.setup, size), proxies), plan.start, plan.low, plan.high, aim)


def _second(rng: np.random.Generator, first: str) -> str:
    """Another effect of another family that some rung of friction shows together with the first."""
    fit = [
        name
        for name in HIDEABLE
        if HIDEABLE[name].family != HIDEABLE[first].family and set(HIDEABLE[name].rungs) & set(HIDEABLE[first].rungs)
    ]
    return str(rng.choice(fit))
