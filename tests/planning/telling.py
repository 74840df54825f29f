"""A study of planned experiments: do they let the diagnosis tell two effects apart that the log before left open?

    python -m plan.telling OUT.json [SEED [COUNT]]        from the folder of the tests; about an hour on one core

One of two effects that are easily taken for each other is hidden. Three logs are diagnosed, each alone and with the
whole catalogue to choose from: a plain poke or slide (*before*); the experiment that `kinid plan discriminate` proposes
for the two (*planned*); one drawn at random of the same length (*random*). An answer is right where the hidden effect
is named first and the other one of the pair is not called indistinguishable from it.

The planner sees what a user has: the starting model, its values as fitted to the log before, the rig, and the pair.
Logs are made by `hidden.world`, on other equations than the catalogue's, along the planned motion, with noise, tremor
and what calibration leaves. The size of what is hidden follows from the log before alone: what the starting model can't
absorb of it there is `WEAK` to `STRONG` times the noise. An experiment lasts `DURATION`, planned or drawn.
"""

from __future__ import annotations

import json
import sys
import time
from collections.abc import Callable, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import asdict, dataclass
from multiprocessing import get_context
from pathlib import Path as File
from typing import Any

import numpy as np
from hidden.draw import WEAK, Stream, tuned
from hidden.tester_cases import Tester, base_of
from hidden.world.arm import Body, forward
from hidden.world.hiding import HIDEABLE
from hidden.world.path import FINE, Path, shake
from hidden.world.rubbing import Rub
from hidden.world.tester import Setup, imperfect, readings
from hidden.world.wrist import NOISE, Swing, Wrist, carried
from hidden.world.wrist import readings as wrench_of
from hidden.wrist_cases import Arm
from scipy.interpolate import CubicSpline

import kinid
from kinid.errors import InputError
from kinid.planning import Multisine, Planner, Poke, Protocol, Slide, Trajectory
from kinid.planning.discriminate import discriminate, judge_for
from kinid.planning.experiments import drawn_at_random

#: what the hidden effect leaves in the residual of the log before, as multiples of the noise
STRONG = 1.5
#: length of an experiment [s], and how many are drawn before one that the robot can do must have been among them
DURATION, DRAWS = 40.0, 30
#: seeds from here on are for reports alone
REPORT = 2001
WAYS = ("before", "planned", "random")


@dataclass(frozen=True)
class Pair:
    """Two effects that are taken for each other, and what is known before.

    Attributes:
        effects: the two. base: contact law of the starting model. slides: whether the log before is a slide, not a
            poke.
        world: "tester" (depth and forces) or "wrist" (joints and six channels).
    """

    effects: tuple[str, str]
    base: str = "hooke"
    slides: bool = False
    world: str = "tester"

    @property
    def model(self) -> tuple[str, ...]:
        """What the user starts with."""
        return (self.base, "coulomb-friction") if self.slides or self.world == "wrist" else (self.base,)


#: pairs that the catalogue itself calls easily mistaken for each other
PAIRS = (
    Pair(("relaxation", "stiffness-drift")),
    Pair(("relaxation", "hysteresis")),
    Pair(("relaxation", "viscous-damping"), base="hertz"),
    Pair(("viscous-damping", "hunt-crossley-damping"), base="hertz"),
    Pair(("hertz-exponent", "stiffening-layer")),
    Pair(("stress-softening", "stiffness-drift")),
    Pair(("sensor-drift", "stiffness-drift")),
    Pair(("adhesion", "surface-offset")),
    Pair(("stiffness-drift", "stiffness-inhomogeneity"), slides=True),
    Pair(("viscous-friction", "stribeck-friction"), slides=True),
    Pair(("tool-mass", "sensor-bias"), world="wrist"),
    Pair(("tool-com", "sensor-misalignment"), world="wrist"),
    Pair(("sensor-crosstalk", "sensor-misalignment"), slides=True, world="wrist"),
    Pair(("surface-offset", "tip-offset"), world="wrist"),
    Pair(("sensor-lag", "time-offset"), base="hunt-crossley", world="wrist"),
    Pair(("tool-inertia", "sensor-lag"), world="wrist"),
)


@dataclass(frozen=True)
class Answer:
    """What diagnosis said of one log."""

    pair: tuple[str, str]
    hidden: str
    seed: int
    way: str
    right: bool
    verdict: str
    added: tuple[str, ...]
    alike: tuple[str, ...]
    experiment: str
    note: str
    seconds: float

    def line(self) -> str:
        """For a listing."""
        alike = f" (= {', '.join(self.alike)})" if self.alike else ""
        return (
            f"{'ok ' if self.right else 'BAD'} {self.way:<8} {self.hidden} of {'/'.join(self.pair)} seed {self.seed} "
            f"[{self.experiment}]: {self.verdict} {', '.join(self.added) or '–'}{alike} {self.note} "
            f"[{self.seconds:.1f} s]"
        )


class Trial:
    """One hidden effect of a pair: the world it is in, the log before, and what a user knows."""

    def __init__(self, pair: Pair, hidden: str, seed: int) -> None:
        self.pair, self.hidden, self.seed = pair, hidden, seed
        self.stream = Stream(seed, "telling", *pair.effects, hidden)
        rng = self.stream.generator()
        self.deep = float(rng.uniform(2.5e-3, 5e-3))
        self.tool = Body(float(rng.uniform(0.15, 0.45)), (*rng.uniform(-8e-3, 8e-3, 2), float(rng.uniform(0.03, 0.06))))
        wrist = pair.world == "wrist"
        error = imperfect(rng)
        if wrist:
            error["noise"] = NOISE * rng.uniform(0.7, 1.4)
            error["bias_error"] = rng.uniform(-1, 1, 6) * [0.01, 0.01, 0.01, 3e-4, 3e-4, 3e-4]
        parts: dict[str, Any] = {
            "matter": base_of(rng, pair.base, self.deep),
            "rub": Rub(mu=float(rng.uniform(0.15, 0.6))),
        }
        parts |= error
        self.plain: Any = Wrist(bodies=(self.tool,), **parts) if wrist else Setup(**parts)
        self.rig = kinid.Rig.parse(
            {
                "robot": {"model": "lwr4plus"},
                "tool": {"mass": self.tool.mass, "com": list(self.tool.com)},
                "surface": {"point": (0.55, 0.0, 0.10), "normal": (0, 0, 1), "tangent": (1, 0, 0)},
                "sensor": {"noise": NOISE.tolist()},
            }
        )
        self.planner = Planner(self.rig, Protocol())
        # a quick look: one poke to one depth at one frequency, or one short slide at one speed
        touch = (
            Slide(((-0.003, 0.0), (0.003, 0.0)), 0.6 * self.deep, 6e-3, 1.0)
            if pair.slides
            else Poke(signal=Multisine(0.6 * self.deep, ((0.4 * self.deep, 0.9),), 3.0), hold=0.2)
        )
        self.before = self.planner.plan([touch])
        bench = self.bench(self.before)
        for attempt in range(20):
            plan = HIDEABLE[hidden].draw(self.stream.generator(f"what{attempt}"), self.deep, pair.base)
            aim = float(np.exp(self.stream.generator(f"aim{attempt}").uniform(np.log(WEAK), np.log(STRONG))))

            def matters(size: float, put: Callable[[Any, float], Any] = plan.put) -> float:
                return float(bench.matters(put(bench.setup, size)))

            size, self.found = tuned(matters, plan.start, plan.low, plan.high, aim)
            if self.found > 0.75 * WEAK:
                break
        self.setup = plan.put(self.plain, size)
        self.note = f"size {size:.3g}, {self.found:.3g} times the noise before"

    def bench(self, motion: Trajectory) -> Any:
        """The world with this motion carried out in it, nothing hidden."""
        rng = self.stream.generator(f"tremor{motion.duration}")
        swing = self._swing(motion, rng)
        seed = Stream(self.seed, "log", self.hidden, *self.pair.effects, len(motion))
        if self.pair.world == "wrist":
            weight = carried((self.tool,), swing)
            plain = wrench_of(self.plain, swing, seed.generator("read"), weight, quiet=True)
            return Arm(self.pair.base, self.deep, swing, self.plain, weight, plain, self.pair.model, seed, self.rig)
        plain = readings(self.plain, swing.path, seed.generator("read"), quiet=True)
        return Tester(self.pair.base, self.pair.slides, self.deep, swing.path, self.plain, plain, self.pair.model, seed)

    def _swing(self, motion: Trajectory, rng: np.random.Generator) -> Swing:
        """The planned joints at the fine rate, with a machine's tremor; what the tip does follows from other
        kinematics.
        """
        assert self.rig.surface is not None
        point, axes = np.array(self.rig.surface.point), np.eye(3)
        t = motion.t - motion.t[0]
        fine = np.arange(round(t[-1] * FINE) + 1) / FINE
        joints = CubicSpline(t, motion.q)
        if self.pair.world == "wrist":  # the arm's tremor is that of its joints
            shaking = shake(rng, len(fine), np.full(motion.q.shape[1], 2e-6))
            joints = CubicSpline(t, motion.q + CubicSpline(fine, shaking)(t))
        q = joints(fine[:: FINE // 500])
        now = forward(q)
        place = (now.position - point) @ (axes * [[1.0], [1.0], [-1.0]]).T
        x = CubicSpline(fine[:: FINE // 500], place)(fine) + shake(rng, len(fine), np.array([3e-7, 3e-7, 2e-6]))
        phase = motion.phase[np.minimum(np.arange(len(fine)) // (FINE // 500), len(t) - 1)]
        return Swing(Path(fine, x, phase), joints, point, axes, q, now.rotation, now.position)

    def values(self) -> dict[str, float]:
        """What a fit of the starting model to the log before says."""
        log, model = self.log(self.before), kinid.Model(*self.pair.model)
        fit = model.fit(log, kinid.Rig() if self.pair.world == "tester" else self.rig)
        return {name: p.value for name, p in fit.parameters.items()}

    def log(self, motion: Trajectory) -> kinid.Log:
        """What is recorded of a motion."""
        return self.bench(motion).log(self.setup)

    def planned(self) -> tuple[str, Trajectory]:
        """The experiment that is proposed for the pair."""
        found = discriminate(
            self.planner,
            kinid.Model(*self.pair.model),
            self.pair.effects,
            self.values(),
            depth=self.deep,
            duration=DURATION,
        )
        return f"{found.proposal.name}, {found.distance**0.5:.0f} σ", found.trajectory

    def drawn(self) -> tuple[str, Trajectory]:
        """One at random."""
        judge = judge_for(self.planner, kinid.Model(*self.pair.model), {}, self.pair.effects)
        for k in range(DRAWS):
            proposal = drawn_at_random(1000 * self.seed + k, DURATION, self.deep)
            try:
                return proposal.name, judge.bench.trajectory(proposal, 500.0, collisions=False)
            except InputError:
                continue
        raise RuntimeError("no experiment at random that the robot can do")

    def asked(self, way: str) -> Answer:
        """The log of one way, diagnosed."""
        name, motion = {"before": lambda: ("plain", self.before), "planned": self.planned, "random": self.drawn}[way]()
        log = self.log(motion)
        began = time.perf_counter()
        verdict, added, alike = diagnosed(
            log,
            self.rig if self.pair.world == "wrist" else kinid.Rig(),
            self.pair.model,
            touching=bool((motion.phase != "free").any()),
        )
        other = next(e for e in self.pair.effects if e != self.hidden)
        right = bool(added) and added[0] == self.hidden and other not in alike
        return Answer(
            self.pair.effects,
            self.hidden,
            self.seed,
            way,
            right,
            verdict,
            added,
            alike,
            name,
            self.note,
            time.perf_counter() - began,
        )


def diagnosed(
    log: kinid.Log, rig: kinid.Rig, model: Sequence[str], touching: bool
) -> tuple[str, tuple[str, ...], tuple[str, ...]]:
    """Verdict, what was added, and what the first of it can't be told from; a log of the air alone knows no
    material.
    """
    if not touching:
        rig, model = rig.model_copy(update={"surface": None}), ("none",)
    found = kinid.diagnose(log, rig, model=kinid.Model(*model))
    return found.verdict, found.added, tuple(found[found.added[0]].equivalent_to) if found.added else ()


@dataclass(frozen=True)
class Job:
    """One answer to ask for."""

    pair: Pair
    hidden: str
    seed: int
    ways: tuple[str, ...] = WAYS


def run(job: Job) -> list[Answer]:
    """All logs of one hidden effect; what can't be planned or diagnosed is a wrong answer, and told."""
    out: list[Answer] = []
    trial: Trial | None = None
    for way in job.ways:
        try:
            trial = trial or Trial(job.pair, job.hidden, job.seed)
            out.append(trial.asked(way))
        except Exception as error:
            out.append(
                Answer(job.pair.effects, job.hidden, job.seed, way, False, "crash", (), (), "", repr(error), 0.0)
            )
    return out


def jobs(seed: int = REPORT, count: int = 4, pairs: Sequence[Pair] = PAIRS) -> list[Job]:
    """Each effect of each pair hidden so many times."""
    return [Job(pair, hidden, seed + k) for pair in pairs for k in range(count) for hidden in pair.effects]


def study(work: Sequence[Job], processes: int = 2, tell: Callable[[str], None] = lambda _: None) -> list[Answer]:
    """All of them, on so many cores."""
    out: list[Answer] = []
    with ProcessPoolExecutor(processes, get_context("spawn")) as pool:
        for answers in pool.map(run, work):
            for answer in answers:
                tell(answer.line())
            out += answers
    return out


def rates(answers: Sequence[Answer]) -> dict[tuple[str, str], dict[str, tuple[int, int]]]:
    """Right answers and all of them, by pair and way."""
    out: dict[tuple[str, str], dict[str, tuple[int, int]]] = {}
    for a in answers:
        row = out.setdefault(a.pair, dict.fromkeys(WAYS, (0, 0)))
        right, asked = row[a.way]
        row[a.way] = right + a.right, asked + 1
    return out


def table(answers: Sequence[Answer]) -> str:
    """Pair, and right answers before, planned and at random."""
    found = rates(answers)
    total = {way: tuple(int(n) for n in np.sum([row[way] for row in found.values()], axis=0)) for way in WAYS}
    lines = [f"{'pair':<44}" + "".join(f"{way:>12}" for way in WAYS)]
    for pair, row in [*(("/".join(pair), row) for pair, row in found.items()), ("all", total)]:
        lines.append(
            f"{pair:<44}"
            + "".join(
                f"{right:>5}/{asked:<2}{100 * right / max(asked, 1):>3.0f} %"
                for right, asked in (row[way] for way in WAYS)
            )
        )
    return "\n".join(lines)


if __name__ == "__main__":
    first, many = (int(sys.argv[2]) if len(sys.argv) > 2 else REPORT), (int(sys.argv[3]) if len(sys.argv) > 3 else 4)
    every = study(jobs(first, many), tell=lambda line: print(line, flush=True))
    File(sys.argv[1]).write_text(json.dumps([asdict(a) for a in every], indent=1) + "\n", encoding="utf-8")
    print(table(every))
