"""From a user's data to the readings that a model speaks about, or a refusal that says what to record instead."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from kinid.contact.series import ContactSeries, contact_series
from kinid.data.log import Log
from kinid.data.rig import Rig
from kinid.effects import Stage
from kinid.errors import InputError, expect, near
from kinid.modeling.data_warnings import DEEPEST, DEPTH_UNIT, warnings_of
from kinid.modeling.experiment import Experiment
from kinid.modeling.from_logs import FAR, from_contact, from_joint_torques, from_wrench
from kinid.modeling.model import Model
from kinid.modeling.sample_times import block_length

Array = NDArray[np.float64]

CONTACT_FORCES = ("normal_force", "tangential_force1", "tangential_force2")
#: fewer samples in contact than this can't carry a contact law
MIN_CONTACT_SAMPLES = 20
#: a log must last so long [s] to be diagnosed, and hold so many blocks that count, half of which are held out in turn
MIN_DURATION, MIN_BLOCKS = 2.5, 8


def experiment_for(
    model: Model, data: ContactSeries | Log | Experiment, rig: Rig | None, channels: Sequence[str] | None = None
) -> Experiment:
    """Signals and readings that this model speaks about."""
    if isinstance(data, Experiment):
        return data
    if isinstance(data, ContactSeries):
        if data.source is not None and not channels and _asks_for_more(model, *data.source):
            return experiment_for(model, *data.source)
        if model.needs_log:
            raise InputError(
                f"contact-frame quantities for {model}, which acts on the whole wrench or on joint torques",
                "the log itself with its rig",
                "call fit(log, rig)",
            )
        for name in channels or ():
            if name not in CONTACT_FORCES:
                raise InputError(f"channel '{name}'", f"one of {', '.join(CONTACT_FORCES)}", near(name, CONTACT_FORCES))
        return from_contact(data, tuple(channels or contact_channels(model, data)))
    if not isinstance(data, Log):
        raise InputError(
            f"{type(data).__name__} to fit to",
            "a log with its rig, or contact-frame quantities",
            "read it with kinid.read(path, rig)",
        )
    rig = rig_of(data, rig, "fit(log, rig)")
    if channels is None:
        return all_channels(data, rig, model)
    return experiment_for(model, contact_series(data, rig), None, channels)


def all_channels(data: ContactSeries | Log, rig: Rig | None, model: Model) -> Experiment:
    """Every channel of a log that this kind of model speaks about: joint torques, the whole wrench, or contact
    forces.

    Contact quantities have had a bias of the sensor removed; the same is removed from the wrench behind them. A log has
    what its rig states removed.
    """
    if isinstance(data, Log):
        rig = rig_of(data, rig, "diagnose(log, rig, model=…)")
        if "joints" in model.needs:
            return from_joint_torques(data, rig)
        if data.wrench is not None and data.q is not None and rig.robot is not None:
            return from_wrench(data, rig)
        data = contact_series(data, rig)
    elif data.source is not None and "joints" not in model.needs:
        log, rig = data.source
        if log.wrench is not None and log.q is not None and rig.robot is not None:
            return from_wrench(log, rig, bias="none" if data.bias is None else data.bias.tolist())
    slides = [
        f"tangential_force{i}"
        for i in (1, 2)
        if np.isfinite(getattr(data, f"tangential_force{i}")).any()
        and np.isfinite(getattr(data, f"slip_rate{i}")).any()
    ]
    return from_contact(data, tuple(dict.fromkeys([*contact_channels(model, data), *slides])))


def rig_of(log: Log, rig: Rig | None, call: str) -> Rig:
    """The rig that goes with a log; a material tester's needs none.

    Raises:
        InputError: the log of a robot alone.
    """
    if rig is None and "depth" not in log.contact:
        raise InputError("a log without its rig", "both", f"call {call}")
    expect(rig or Rig(), Rig, "a rig", "what was measured with what", "load it with kinid.Rig.load(path)")
    return rig or Rig()


def contact_channels(model: Model, touch: ContactSeries) -> tuple[str, ...]:
    """The contact forces that a model says something about."""
    if not touch.valid.any():
        empty = [
            name for name, x in (touch.source[0].contact.items() if touch.source else ()) if not np.isfinite(x).any()
        ]
        if empty:
            raise InputError(
                f"no number in {', '.join(empty)} of {touch.provenance.source}",
                "readings in each column",
                "record it, or leave the column out",
            )
        raise InputError(
            f"no usable sample among the {len(touch)} of {touch.provenance.source}",
            "depth, its rate and the forces as numbers in the same rows",
            "record more than a few samples, and look for columns that hold nothing",
        )
    if not np.isfinite(touch.normal_force).any():
        raise InputError(
            f"no normal force in {touch.provenance.source}",
            "a force to hold the model against",
            "record the force/torque sensor too",
        )
    if "slip" not in model.needs:
        return ("normal_force",)
    known = [
        i
        for i in (1, 2)
        if np.isfinite(getattr(touch, f"slip_rate{i}")).any()
        and np.isfinite(getattr(touch, f"tangential_force{i}")).any()
    ]
    slides = np.isfinite([touch.slip_rate1, touch.slip_rate2]).any()
    if not known and slides and Stage.FRICTION not in model.stages:
        return ("normal_force",)  # where the tool is says what differs from place to place
    if not known:
        raise InputError(
            f"no slip or tangential force in {touch.provenance.source} for {model}",
            "slip1, slip2, tangential_force1, tangential_force2",
            "leave friction out, or log them",
        )
    return ("normal_force", *(f"tangential_force{i}" for i in known))


def _asks_for_more(model: Model, log: Log, rig: Rig) -> bool:
    """Whether a model acts on what contact quantities no longer hold, and the log behind them does."""
    if "joints" in model.needs:
        return log.tau is not None
    return log.wrench is not None and log.q is not None and rig.robot is not None and model.needs_log


def check_excitation(model: Model, experiment: Experiment) -> list[str]:
    """Refuse data that can't carry a contact law; say what will stay in doubt.

    Raises:
        InputError: too few samples in contact, depth that is never positive, or an input that doesn't change.
    """
    warnings = list(experiment.warnings)
    if experiment.unstated and not any(e.constant and Stage.SENSOR in e.stages() for e in model.effects):
        warnings.append(experiment.unstated)
    if "normal" not in model.needs or experiment.layout.kind == "joints":
        return warnings
    depth = experiment.signals.depth[experiment.valid]
    inside = depth > 0
    if not inside.any():
        raise _never_inside(depth, experiment)
    if inside.sum() < MIN_CONTACT_SAMPLES:
        raise InputError(
            f"{int(inside.sum())} samples inside the material",
            f"{MIN_CONTACT_SAMPLES} at least",
            "poke for longer, or log faster",
        )
    if np.ptp(depth[inside]) < 1e-9:
        raise InputError(
            "a depth that never changes inside the material",
            "at least two depths",
            "poke with a motion of a few tenths of a millimetre",
        )
    if "normal_force" in experiment.layout.channels:
        force = experiment.measured[experiment.layout.channels.index("normal_force")][experiment.valid]
        if np.ptp(force[inside]) == 0.0:
            raise InputError(
                f"a normal force that is {force[inside][0]:.4g} N at every depth",
                "a force that the depth changes",
                "check the sensor, and which column the force is read from",
            )
    return [*warnings, *warnings_of(experiment)]


def _never_inside(depth: Array, experiment: Experiment) -> InputError:
    """What is the matter where no sample is inside the material, by where the depth comes from."""
    found = f"a depth that is never positive (at most {1e3 * depth.max(initial=-np.inf):.3g} mm)"
    expected, find = "samples inside the material", "let touches find it: kinid contact LOG --find-surface"
    if experiment.touch is not None and experiment.touch.source is None:
        mend = "check its sign, which { scale = -1 } in [columns] turns, and its zero, which is the surface"
        return InputError(found, expected, mend)
    free = "; free motion alone is --model none" if experiment.layout.kind == "wrench" else ""
    if free and (depth == FAR).all():
        mend = f"add [surface] point and normal, or {find}{free}"
        return InputError("a rig without [surface]", "the surface that depths are measured from", mend)
    return InputError(found, expected, f"check [surface] point and normal, or {find}{free}")


def refuse_inactive_effects(model: Model, experiment: Experiment) -> None:
    """Refuse effects that can do nothing in this log, instead of leaving them out without a word."""
    kind = experiment.layout.kind
    for effect in model.effects:
        acts = {stage.value for stage in effect.stages()}
        reading = bool(acts & {"tool", "sensor", "acquisition"})
        if kind == "joints" and "joint" not in acts and not reading:
            raise InputError(
                f"'{effect.id}' for joint torques",
                "effects of joints, sensor or acquisition",
                "fit it to a contact law without rigid-body",
            )
        if kind != "joints" and "joint" in acts:
            raise InputError(
                f"'{effect.id}' for contact forces",
                "effects of contact, tool or sensor",
                "fit it with rigid-body to joint torques",
            )
        if not effect.base and not effect.parameters(experiment.layout):
            raise InputError(
                f"'{effect.id}', which has nothing to act on in this log",
                "what it needs: " + (effect.excited_by or "more channels"),
                "leave it out, or give the robot in the rig",
            )
    if "slip" in model.needs and not any(effect.base for effect in model.effects):
        raise InputError(
            f"{model} without a contact law",
            "friction with the normal force it grows with",
            "add one, e.g. --model kelvin-voigt,coulomb-friction",
        )


def refuse_undiagnosable(experiment: Experiment, model: Model) -> None:
    """Refuse a log that is too short to hold any of it out, or a depth that no tool has.

    Raises:
        InputError: and what to record instead.
    """
    s = experiment.signals
    if not experiment.valid.any():
        raise InputError("no sample with all of its channels", "readings that are numbers", "check the log's columns")
    span = float(np.ptp(s.t[experiment.valid]))
    if span < MIN_DURATION:
        raise InputError(
            f"{span:.3g} s of log",
            f"{MIN_DURATION:g} s at least, to hold half of it out in blocks",
            "record several pokes, with holds and slides between them",
        )
    blocks = len(np.unique((s.t[experiment.valid] / block_length(span)).astype(int)))
    if blocks < MIN_BLOCKS:
        raise InputError(
            f"readings in {blocks} of the blocks of {block_length(span):.2g} s",
            f"in {MIN_BLOCKS} at least",
            "record for longer, or find out why so many samples are invalid",
        )
    if "normal" in model.needs and s.layout.kind != "joints" and not (s.depth[experiment.valid] > 0).any():
        raise _never_inside(s.depth[experiment.valid], experiment)
    deep = float(s.depth[experiment.valid].max()) if "normal" in model.needs and s.layout.kind == "contact" else 0.0
    if deep > DEEPEST:
        raise InputError(f"depths of up to {deep:.3g} m", "metres inside the material", f"say so {DEPTH_UNIT}")
