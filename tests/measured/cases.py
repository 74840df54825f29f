"""The cases: every log with every change that fits it, at sizes that are multiples of what is left in the log."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

import numpy as np
from hidden.draw import Stream
from numpy.typing import NDArray

import kinid
from measured import contact_changes, joint_changes, wrench_changes
from measured.changes import Draw, Grown, Shape
from measured.logs import SOURCES, Source
from measured.scene import Scene, with_readings

Array = NDArray[np.float64]

SIZES = (1.0, 2.0, 5.0)
#: of a change that fits a log, a refit of the starting model leaves at least this share
VISIBLE = 0.1
#: names that take up a change but for this share of what was to be seen of it, or of what is left, are honestly the
#: same
SAME, UNSEEN = 0.15, 0.3
#: how near to the asked size a change comes that is no multiple of a shape
NEARLY, TURNS, STEPS = 0.02, 40, 24
#: the converter's marks take part in no linear change
CONVERTER = ("quantization", "saturation", "mains-hum")


@dataclass(frozen=True, eq=False)
class Case:
    """A measured log with one thing injected.

    Attributes:
        name: log/effect/size. source: its log. effect: what was injected. near: names that would do the same to this
            log.
        size: multiples of what is left that the starting model can't take up. model: that a user starts from.
        log, rig: as a user has them. natural: whether the source's own model holds this effect, so that the log has
        some of it.
        reached: as `size`, computed from the readings once more. note: what was drawn, in words.
    """

    name: str
    source: str
    effect: str
    near: frozenset[str]
    size: float
    model: tuple[str, ...]
    log: kinid.Log
    rig: kinid.Rig
    natural: bool
    reached: float
    note: str


def changes_of(source: Source) -> dict[str, Draw]:
    """What can be injected into this log, by the effect's name."""
    own = {
        "silicone-two-cycles": contact_changes.CYCLES,
        "med14-poses": wrench_changes.POSES,
        "med14-turning": wrench_changes.TURNING,
    }
    family = {
        "arm": joint_changes.ARM,
        "axis": joint_changes.AXIS,
        "leg": joint_changes.LEG,
        "tester": contact_changes.PRESS,
        "places": contact_changes.PLACES,
        "slide": contact_changes.SLIDE,
        "wrench": wrench_changes.BAG,
    }
    every = own.get(source.name, family[source.family])
    taken = {"joint-torque-gain", "payload"} & set(source.model)  # the log has these already, and of unknown size
    return {name: draw for name, draw in every.items() if name not in taken}


def planned(only: str = "", sizes: Sequence[float] = SIZES) -> list[tuple[Source, str, float]]:
    """All combinations, fit or not, whose name holds a text, or one of several between commas."""
    every = [(source, effect, size) for source in SOURCES for effect in changes_of(source) for size in sizes]
    return [row for row in every if any(part in name_of(*row) for part in only.split(","))]


def name_of(source: Source, effect: str, size: float) -> str:
    """Of a case."""
    return f"{source.name}/{effect}/{size:g}"


def cases(seed: int, real: Path, only: str = "", sizes: Sequence[float] = SIZES) -> Iterator[Case]:
    """All that fit, in order; deterministic in the seed."""
    for row in planned(only, sizes):
        if (made := case(*row, seed, real)) is not None:
            yield made


@lru_cache(maxsize=4)
def scene_of(source: Source, real: Path, without: str) -> Scene:
    """The log with what its starting model leaves; the last few are kept."""
    return Scene.of(source, real, without)


def case(source: Source, effect: str, size: float, seed: int, real: Path) -> Case | None:
    """One of them; None where this log can't show the effect, or not so much of it."""
    natural = effect in source.model
    scene = scene_of(source, real, effect if natural else "")
    drawn = changes_of(source)[effect](scene, Stream(seed, "measured", source.name, effect).generator())
    made = _of_shape(scene, drawn, size, natural) if isinstance(drawn, Shape) else _grown(scene, drawn, size)
    if made is None:
        return None
    change = scene.counted(made - scene.readings)
    near = _near(scene, effect, change, seed)
    log = with_readings(scene.log, made)
    return Case(
        name_of(source, effect, size),
        source.name,
        effect,
        near,
        size,
        scene.model,
        log,
        scene.rig,
        natural,
        seen(scene, change),
        drawn.note,
    )


def seen(scene: Scene, change: Array) -> float:
    """What a refit leaves of a change (k, m), in units of what is left, over the channels that it is about."""
    about = (change**2).sum(axis=1) > 1e-6 * (change**2).sum()
    return float(np.sqrt(np.mean(scene.beyond(change)[about] ** 2))) if about.any() else 0.0


def _of_shape(scene: Scene, shape: Shape, size: float, natural: bool) -> Array | None:
    weights = shape.weights.copy()
    if natural and shape.signed:
        # some of it is in the log already: more of it, not less
        for i, column in enumerate(shape.columns):
            if weights[i]:
                own = float(
                    (scene.beyond(scene.counted(column)) * scene.residual * scene.fitting.weight[:, None]).sum()
                )
                weights[i] = abs(weights[i]) * (np.sign(own) or 1.0)
    whole = np.tensordot(weights, shape.columns, axes=1)
    change = scene.counted(whole)
    about = (change**2).sum(axis=1) > 1e-6 * (change**2).sum()
    raw = float(np.sqrt(np.mean((change[about] * scene.fitting.weight[about, None]) ** 2))) if about.any() else 0.0
    found = seen(scene, change)
    if not found > VISIBLE * raw or not raw > 0:
        return None
    whole *= size / found
    if shape.most is not None and (np.abs(whole).max(axis=0) > shape.most).any():
        return None
    return np.asarray(scene.readings + whole)


def _grown(scene: Scene, grown: Grown, size: float) -> Array | None:
    def shows(by: float) -> float:
        return seen(scene, scene.counted(grown.readings(by) - scene.readings))

    # a change that is large enough is proportional to the reading again, and the refit takes it up: the first place
    # that will do
    grid = np.geomspace(grown.low, grown.high, STEPS)
    enough = next((i for i, by in enumerate(grid) if shows(float(by)) >= size), 0)
    if not enough:
        return None
    low, high = np.log(grid[enough - 1]), np.log(grid[enough])
    for _ in range(TURNS):
        middle = 0.5 * (low + high)
        found = shows(float(np.exp(middle)))
        if abs(found / size - 1.0) < NEARLY:
            return grown.readings(float(np.exp(middle)))
        low, high = (middle, high) if found < size else (low, middle)
    return None


def _near(scene: Scene, effect: str, change: Array, seed: int) -> frozenset[str]:
    """Names whose linear changes take up what the starting model can't: with them nobody could say more."""
    if effect in CONVERTER:
        return frozenset()
    whole = float(np.sqrt(np.mean(scene.beyond(change) ** 2)))
    out = {"sensor-lag", "time-offset"} - {effect} if effect in ("sensor-lag", "time-offset") else set()
    for name, draw in changes_of(scene.source).items():
        if name == effect or name in CONVERTER or name in scene.model:
            continue
        columns = _columns(scene, name, draw, seed)
        left = float(np.sqrt(np.mean(scene.beyond(change, np.array([scene.counted(c) for c in columns])) ** 2)))
        if left < max(SAME * whole, UNSEEN * min(1.0, whole)):
            out.add(name)
    return frozenset(out)


def _columns(scene: Scene, name: str, draw: Draw, seed: int) -> Array:
    """All that an effect of this name could do in small, (p, n, k)."""
    drawn = draw(scene, Stream(seed, "measured", scene.source.name, name).generator())
    if isinstance(drawn, Shape):
        return drawn.columns
    little = drawn.readings(float(np.sqrt(drawn.low * drawn.high))) - scene.readings
    columns = np.zeros((little.shape[1], *little.shape))
    for c in range(little.shape[1]):
        columns[c, :, c] = little[:, c]
    return columns


def unchanged(source: Source, model: tuple[str, ...], real: Path) -> tuple[kinid.Log, kinid.Rig]:
    """The log as recorded, for what is named without an injection."""
    scene = scene_of(source, real, next((name for name in source.model if name not in model), ""))
    return dataclasses.replace(scene.log), scene.rig
