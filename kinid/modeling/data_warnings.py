"""What to doubt of a log, each with what to do about it: units, signs, lost samples, missing channels."""

from __future__ import annotations

from collections.abc import Collection, Iterator

import numpy as np
from numpy.typing import NDArray

from kinid.errors import InputError
from kinid.modeling.experiment import Experiment
from kinid.modeling.sample_times import gaps_in_contact

Array = NDArray[np.float64]

#: no tool pokes deeper than this into what it probes, nor so little and still feels it [m]
DEEPEST, SHALLOWEST = 0.3, 1e-6
#: no arm presses harder [N]
STRONGEST = 1e5
#: a depth is turned where the force outside the material is so many times that inside
OUTSIDE = 3.0
#: samples that such a thing is told from
FEWEST = 50
#: of the greatest depth, a share that no tool moves from one sample to the next
LEAP = 0.5
#: … where samples follow each other in less than this [s]
QUICK = 0.05
#: time between samples of a log of touches [s] beyond which its unit is doubted
SLOWEST = 0.2
#: how the unit of a depth is stated
DEPTH_UNIT = 'in [columns] of the rig: depth = { unit = "mm" }'
#: how a force is turned, tangential forces, and a depth
TURN = "normal_force = { scale = -1 } in [columns] of the rig turns it"
TURN_TANGENTIAL = "tangential_force1 and tangential_force2 = { scale = -1 } in [columns] of the rig turn it"
TURN_DEPTH = "depth = { scale = -1 } in [columns] of the rig turns it"
#: … where both were worked out from joints and a wrench
TURN_WRENCH = "wrench = { scale = -1 } in [columns] of the rig turns the sensor's, if [surface] normal points out of it"
TURN_NORMAL = "turn [surface] normal, which points out of the material"
#: a direction of slip turns where each of its components varies by this much
TURNS = 0.2
#: a reading that is so many times what this share of all stay within is none
BEYOND, USUAL = 1e3, 0.999
#: of slip faster than this [m/s], correlation of tangential force and slip rate beyond which the force drives the slip
SLIPPING, DRIVES = 1e-3, 0.5


def warnings_of(experiment: Experiment) -> list[str]:
    """Units and signs of depth and normal force that nature doesn't have; and whether there is free motion."""
    return [*_units(experiment), *_channels(experiment), *_signs(experiment), *_sampling(experiment)]


def _deepest(experiment: Experiment) -> float:
    """Greatest depth among the samples that count [m]."""
    depth = experiment.signals.depth
    return float(depth[experiment.valid & (depth > 0)].max())


def _units(experiment: Experiment) -> Iterator[str]:
    deepest, force = _deepest(experiment), _force(experiment)
    if not SHALLOWEST < deepest < DEEPEST:
        yield f"depths of up to {deepest:.3g} m: are they in another unit? Say so {DEPTH_UNIT}"
    if force is not None and np.abs(force[experiment.valid]).max() > STRONGEST:
        yield (
            f"normal forces of up to {np.abs(force[experiment.valid]).max():.3g} N: are they in another unit? Say so "
            'in [columns] of the rig: normal_force = { unit = "mN" }, or { scale = 1e-6 }'
        )


def _channels(experiment: Experiment) -> Iterator[str]:
    """Forces and slips of which one is missing, or that are exchanged."""
    blind = [i for i in (1, 2) if _slides_unseen(experiment, i)]
    if blind:
        yield (
            f"tangential_force{blind[0]} without slip{blind[0]}: how the tool slides along that tangent isn't known, "
            "so friction has the wrong direction wherever it does; record both"
        )
    unfelt = [i for i in (1, 2) if _slides_unfelt(experiment, i)]
    if unfelt:
        yield (
            f"slip{unfelt[0]} without tangential_force{unfelt[0]}: what friction does along that tangent isn't seen; "
            "record both"
        )
    if _crossed(experiment):
        yield (
            "tangential_force1 acts against slip2, and tangential_force2 against slip1: are they exchanged? [columns] "
            'of the rig names them: slip1 = { column = "…" }'
        )


def _signs(experiment: Experiment) -> Iterator[str]:
    strongest, along, lowest = turned_depth(experiment), drives(experiment), turned(experiment)
    if strongest is not None:
        yield (
            f"a force of {strongest:.3g} N where the depth is negative, and next to none inside: is its sign turned? "
            f"It is positive inside the material; {TURN_NORMAL if _of_joints(experiment) else TURN_DEPTH}"
        )
    if along is not None:
        yield (
            f"the tangential force points along the slip, by {along:.3g} N: is its sign turned? It is what the surface "
            f"does to the tool, against the slip; {TURN_TANGENTIAL}"
        )
    if lowest is not None:
        yield (
            f"the normal force falls to {lowest:.3g} N as the tool goes deeper: is its sign turned? It is positive "
            f"where the material pushes the tool out; {TURN_WRENCH if _of_joints(experiment) else TURN}"
        )


def _sampling(experiment: Experiment) -> Iterator[str]:
    """Free motion, samples and time that are missing, or a unit of time that is another one."""
    s, t = experiment.signals, experiment.signals.t
    if not (experiment.valid & (s.depth <= 0) & ~experiment.in_contact).any():
        yield "no free motion in the log: a bias of the sensor would look like stiffness"
    quick = (s.dt > 0) & (s.dt < QUICK)
    jump = float(np.abs(np.diff(s.depth, prepend=s.depth[:1])[quick]).max(initial=0.0))
    if jump > LEAP * _deepest(experiment):
        yield f"the depth leaps by {1e3 * jump:.3g} mm from one sample to the next: no tool does; look for lost samples"
    gaps = gaps_in_contact(t, experiment.in_contact)
    if len(gaps) and gaps[0] == 0:
        yield (
            "the log begins in contact: what bristles and a material remember of how it was reached isn't known; begin "
            "in the air"
        )
        gaps = gaps[1:]
    if len(gaps):
        many = "a gap of" if len(gaps) == 1 else f"{len(gaps)} gaps of up to"
        yield (
            f"{many} {float((t[gaps] - t[gaps - 1]).max()):.2g} s in contact: what bristles and a material remember "
            "over it isn't known; look for lost samples"
        )
    steps = s.dt[s.dt > 0]
    if experiment.layout.kind == "contact" and len(steps) and np.median(steps) > SLOWEST:
        yield (
            f"{np.median(steps):.3g} s between samples: is the time in another unit? Say so in [columns] of the rig: "
            't = { unit = "ms" }'
        )


def refuse_outliers(experiment: Experiment) -> None:
    """A reading beyond all measure: nothing else would count beside it."""
    for name, unit, row in zip(experiment.layout.channels, experiment.layout.units, experiment.measured):
        size = np.where(experiment.valid, np.abs(row), 0.0)
        usual, i = float(np.quantile(size[experiment.valid], USUAL)), int(size.argmax())
        if usual > 0.0 and size[i] > BEYOND * usual:
            at = experiment.signals.t[i]
            raise InputError(
                f"a {name} of {row[i]:.3g} {unit}, {at:.4g} s after the first sample, where 99.9 % stay within "
                f"{usual:.3g} {unit}",
                "readings of one kind",
                "leave out what no sensor has read",
            )


def refuse_signs(experiment: Experiment, needs: Collection[str]) -> None:
    """Forces and depths whose sign is turned, of those that a model needs."""
    lowest = turned(experiment) if "normal" in needs else None
    if lowest is not None:
        raise InputError(
            f"a normal force that falls to {lowest:.3g} N as the tool goes deeper",
            "one that is positive where the material pushes the tool out",
            TURN_WRENCH if _of_joints(experiment) else TURN,
        )
    along = drives(experiment) if "slip" in needs else None
    if along is not None:
        raise InputError(
            f"a tangential force that points along the slip, by {along:.3g} N",
            "what the surface does to the tool, against the slip",
            TURN_TANGENTIAL,
        )
    outside = turned_depth(experiment) if "normal" in needs else None
    if outside is not None:
        raise InputError(
            f"a force of {outside:.3g} N where the depth is negative, and next to none inside",
            "a depth that is positive inside the material",
            TURN_NORMAL if _of_joints(experiment) else TURN_DEPTH,
        )


def turned(experiment: Experiment) -> float | None:
    """The lowest normal force [N] where it falls as the tool goes deeper, as with a turned sign; else None."""
    whole = _force(experiment)
    if whole is None:
        return None
    inside = experiment.valid & (experiment.signals.depth > 0)
    depth, force = experiment.signals.depth[inside], whole[inside]
    quiet = experiment.noise[experiment.layout.channels.index("normal_force")]
    wrong = force.std() > 0 and force.mean() < -5.0 * quiet and np.corrcoef(depth, force)[0, 1] < -0.3
    return float(force.min()) if wrong else None


def turned_depth(experiment: Experiment) -> float | None:
    """The strongest normal force [N] at negative depths where next to none is inside the material; else None."""
    force = _force(experiment)
    if force is None:
        return None
    inside = experiment.signals.depth > 0
    within, beyond = (force[experiment.valid & part] for part in (inside, ~inside))
    if not len(within) or not len(beyond):
        return None
    there, here = (float(np.sqrt(np.mean(part**2))) for part in (beyond, within))
    return float(np.abs(beyond).max()) if there > OUTSIDE * here else None


def drives(experiment: Experiment) -> float | None:
    """The mean tangential force along the slip [N] where it points along it rather than against it, to and fro; else
    None.

    One way alone, a tilted surface may push the tool along.
    """
    s, channels = experiment.signals, experiment.layout.channels
    axes = [(i, channels.index(f"tangential_force{i + 1}")) for i in (0, 1) if f"tangential_force{i + 1}" in channels]
    if experiment.layout.kind != "contact" or not axes:
        return None
    slip, force = np.stack([s.slip_rate[i] for i, _ in axes]), np.stack([experiment.measured[row] for _, row in axes])
    speed = np.hypot.reduce(slip)
    moving = experiment.valid & (s.depth > 0) & (speed > SLIPPING)
    main = slip[int(np.argmax(np.mean(slip**2, axis=1)))]
    ways = [moving & (main > 0), moving & (main < 0)]
    if min(int(way.sum()) for way in ways) < FEWEST:
        return None
    along = [float(np.mean(np.sum(force * slip, axis=0)[way] / speed[way])) for way in ways]
    size = float(np.sqrt(np.mean(np.sum(force**2, axis=0)[moving])))
    return min(along) if min(along) > DRIVES * size > 0 else None


def _slides_unseen(experiment: Experiment, tangent: int) -> bool:
    """Whether the force along a tangent was recorded, and the slip along it wasn't, but that along the other."""
    touch = experiment.touch
    if touch is None or experiment.layout.kind != "contact":
        return False
    force, slip, other = (
        np.isfinite(getattr(touch, f"{name}{i}")).any()
        for name, i in (("tangential_force", tangent), ("slip_rate", tangent), ("slip_rate", 3 - tangent))
    )
    return bool(force and not slip and other)


def _slides_unfelt(experiment: Experiment, tangent: int) -> bool:
    """Whether the tool slides along a tangent, and only the force along the other was recorded."""
    s, channels = experiment.signals, experiment.layout.channels
    felt = [f"tangential_force{i}" in channels for i in (tangent, 3 - tangent)]
    slides = experiment.valid & (s.depth > 0) & (np.abs(s.slip_rate[tangent - 1]) > SLIPPING)
    return experiment.layout.kind == "contact" and felt == [False, True] and int(slides.sum()) >= FEWEST


def _crossed(experiment: Experiment) -> bool:
    """Whether each tangential force acts against the slip along the other tangent, and not against its own."""
    s, channels = experiment.signals, experiment.layout.channels
    if experiment.layout.kind != "contact" or not {"tangential_force1", "tangential_force2"} <= set(channels):
        return False
    speed = np.hypot(*s.slip_rate)
    moving = experiment.valid & (s.depth > 0) & (speed > SLIPPING)
    force = np.stack([experiment.measured[channels.index(f"tangential_force{i}")] for i in (1, 2)])[:, moving]
    along = s.slip_rate[:, moving] / speed[moving]
    if int(moving.sum()) < FEWEST or along.std(axis=1).min() < TURNS or not force.any(axis=1).all():
        return False
    against = -np.array([[np.mean(f * a) / np.sqrt(np.mean(f**2) * np.mean(a**2)) for a in along] for f in force])
    return bool(np.diag(against).max() < DRIVES < min(against[0, 1], against[1, 0]))


def _force(experiment: Experiment) -> Array | None:
    """Normal force of a log of contact quantities, (n,)."""
    return experiment.normal_force if experiment.layout.kind == "contact" else None


def _of_joints(experiment: Experiment) -> bool:
    """Whether depth and force were worked out from joints and a wrench, and not logged."""
    touch = experiment.touch
    return touch is not None and touch.source is not None and touch.source[0].q is not None
