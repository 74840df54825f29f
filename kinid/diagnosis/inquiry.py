"""The entrance: a log and a model, or a fit, to a diagnosis."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Sequence

from kinid.contact.series import ContactSeries
from kinid.data.log import Log
from kinid.data.rig import Rig
from kinid.diagnosis.conclusions import Conclusions
from kinid.diagnosis.pipeline import run
from kinid.diagnosis.result import Diagnosis
from kinid.diagnosis.settings import DiagnosisSettings
from kinid.errors import InputError, expect
from kinid.identification.fit import Fit
from kinid.modeling.applicability import expand_names, refuse_inapplicable, refuse_names
from kinid.modeling.data_warnings import refuse_outliers, refuse_signs
from kinid.modeling.experiment import Experiment
from kinid.modeling.model import Model
from kinid.modeling.readings import all_channels, check_excitation, refuse_undiagnosable
from kinid.parallel import one_blas_thread


def diagnose(
    data: Fit | ContactSeries | Log,
    rig: Rig | None = None,
    *,
    model: Model | None = None,
    add: Sequence[str] = (),
    max_effects: int | None = None,
    tolerance: float | None = None,
    settings: DiagnosisSettings | None = None,
    progress: Callable[[str], None] = lambda _: None,
) -> Diagnosis:
    """Compare a model with the measurement, and say which effects it lacks.

    Where the log behind a fit has joints and the whole wrench, all six channels are looked at, not only the contact
    forces that the fit was made to.

    Args:
        data: a fit; or contact-frame quantities, or a log with its `rig`, together with a `model`.
        model: the model to ask about; a fit has its own.
        add: effects to add whatever the evidence says.
        max_effects: so many are added at most; default: those of the settings.
        tolerance: error that may be left, in the readings' unit [N, or N·m for joint torques]; default: 2 % of the
            readings' root mean square in contact or motion, or the noise where that is more.
        settings: what decides.
        progress: called with each stage, in words.

    Raises:
        InputError: a log too short to hold any of it out, an unknown name, an effect that the model has already, or
            data that can't carry the model.
    """
    _refuse_types(data, model)
    if rig is not None:
        expect(rig, Rig, "a rig", "what was measured with what", "load it with kinid.Rig.load(path)")
    expect(
        tolerance or 0.0, (int, float), "a tolerance", "a number, in N or N·m", "state what may be left of the error"
    )
    expect(max_effects or 0, int, "max_effects", "how many effects may be added", "give a whole number")
    expect(add, (list, tuple), "effects to add", "a list of names", "as add=['relaxation']")
    if tolerance is not None and not 0.0 <= tolerance < float("inf"):
        raise InputError(
            f"a tolerance of {tolerance:g}", "0 or more, in N or N·m", "state what may be left of the error"
        )
    settings = settings or DiagnosisSettings()
    if max_effects is not None:
        settings = dataclasses.replace(settings, max_effects=max_effects)
    known: dict[str, float] = {}
    if isinstance(data, Fit):
        model, experiment = data.model, _widest(data.experiment, data.model)
        known = {name: p.value for name, p in data.parameters.items()}
    elif model is None:
        raise InputError("a log without a model", "both", "pass model=kinid.Model(…), or a fit")
    else:
        experiment = all_channels(data, rig, model)
    add = expand_names(add, model)
    refuse_names(add, model, settings.max_effects)
    refuse_inapplicable(add, model, experiment)
    warnings = _checked(experiment, model)
    with one_blas_thread():
        found = run(model, experiment, settings, known=known, forced=add, progress=progress)
        made = Conclusions(found, settings, tolerance).diagnosis(progress, warnings)
    if made.left.tolerance > made.left.reading:
        says = (
            f"the tolerance of {made.left.tolerance:g} {made.unit} is more than the readings' own root mean square of "
            f"{made.left.reading:.3g} {made.unit}: inside it no model fails; state what may be left of the error"
        )
        made = dataclasses.replace(made, warnings=(*made.warnings, says))
    return made


def diagnosable(log: Log, rig: Rig, model: Model) -> None:
    """Refuse what a diagnosis would refuse, in a moment.

    Raises:
        InputError: why, and what to do about it.
    """
    _checked(all_channels(log, rig, model), model)


def _checked(experiment: Experiment, model: Model) -> list[str]:
    """What to doubt of an experiment that a diagnosis can take.

    Raises:
        InputError: one that it can't take.
    """
    refuse_undiagnosable(experiment, model)
    refuse_outliers(experiment)
    warnings = check_excitation(model, experiment)
    refuse_signs(experiment, model.needs)
    return warnings


def _refuse_types(data: object, model: object) -> None:
    """What is neither data nor a model."""
    if not isinstance(data, Fit | ContactSeries | Log):
        expected = "a fit, contact-frame quantities, or a log with its rig"
        raise InputError(f"{type(data).__name__} to diagnose", expected, "read it with kinid.read(path, rig)")
    if model is not None and not isinstance(model, Model):
        remedy = "pass model=kinid.Model('kelvin-voigt', …)"
        raise InputError(f"a model that is a {type(model).__name__}", "a kinid.Model", remedy)


def _widest(experiment: Experiment, model: Model) -> Experiment:
    """All channels of the log that an experiment came from."""
    touch = experiment.touch
    if experiment.layout.kind != "contact" or touch is None:
        return experiment
    return all_channels(touch, None, model)
