"""The contract that every effect of the catalogue keeps, and that models made of any of them keep."""

from __future__ import annotations

import dataclasses
from functools import cache
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from kinid.effects import Layout, Motion, Signals, catalogue, get
from kinid.errors import InputError
from kinid.modeling.contract import RULES, Case, Rule, departure_from_affine, true_values
from kinid.modeling.model import Model
from kinid.modeling.reference_motions import reference_motion

Array = NDArray[np.float64]

IDS = sorted(catalogue())
#: names that stand fixed, so that logs, scripts and checks written against them keep working
FIXED = """
    hooke kelvin-voigt hertz hunt-crossley maxwell zener rigid-body
    hertz-exponent viscous-damping hunt-crossley-damping relaxation hysteresis stress-softening adhesion
    stiffening-layer surface-offset stiffness-drift stiffness-inhomogeneity
    coulomb-friction viscous-friction stribeck-friction presliding friction-rounding load-dependent-friction
    friction-anisotropy
    tool-mass tool-com tool-inertia structural-compliance tip-offset
    joint-coulomb-friction joint-viscous-friction joint-friction-asymmetry joint-torque-offset rotor-inertia
    joint-torque-gain payload joint-elasticity joint-stribeck-friction joint-load-friction joint-torque-ripple
    joint-spring
    sensor-bias sensor-drift sensor-crosstalk sensor-misalignment sensor-gain sensor-lag time-offset saturation
    quantization mains-hum
"""
NAMES = FIXED.split()
LAWS = ("hooke", "kelvin-voigt", "hertz", "hunt-crossley", "maxwell", "zener")


@cache
def example(name: str) -> Case:
    """An effect's own example."""
    return Case.of(catalogue()[name])


# ---- the contract ----------------------------------------------------------------------------------------------------


def test_the_catalogue_holds_every_name() -> None:
    assert set(NAMES) <= set(IDS)


@pytest.mark.parametrize("rule", RULES, ids=lambda rule: rule.name)
@pytest.mark.parametrize("name", IDS)
def test_it_keeps_the_contract(name: str, rule: Rule) -> None:
    outcome = rule.ask(example(name))
    assert outcome.passed, f"found {outcome.found}; expected {outcome.expected}"


@pytest.mark.parametrize("name", IDS)
def test_what_it_lacks_is_said(name: str) -> None:
    effect = get(name)
    if not effect.requires:
        return
    with pytest.raises(InputError, match=effect.requires[0]):
        Model(name)


@pytest.mark.parametrize("name", IDS)
def test_what_calibration_leaves_open(name: str) -> None:
    case = example(name)
    effect = case.effect
    open_ = effect.calibration_sd(case.signals)
    assert set(open_) <= set(case.own)
    assert all(0.0 < sd < np.inf for sd in open_.values())
    # shares of a stated tool, which not every rig has; filters of drives
    stated = {"tool-mass", "payload", "sensor-lag"}
    assert name in stated or bool(open_) == bool(effect.calibration_tolerance)
    assert all(case.null[key.split("[")[0]] == 0.0 for key in open_), "calibration is open about nothing"


# ---- predictions ----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", IDS)
def test_a_prediction_that_begins_where_it_differs_from_another_is_the_same(name: str) -> None:
    """With another value of any parameter, with this effect more than the other had, and over another motion."""
    case = example(name)
    model, values, signals = case.model, case.values, case.signals
    here = model.course(signals, values)
    np.testing.assert_array_equal(here.reading, model.predict(signals, values))
    for i, p in enumerate(model.parameters(signals.layout).values()):
        other = values.copy()
        other[i] += 0.1 * p.scale if other[i] + 0.1 * p.scale <= p.high else -0.1 * p.scale
        alone = model.predict(signals, other)
        np.testing.assert_allclose(model.predict(signals, other, here), alone, 0.0, _apart(name, alone - here.reading))
    if not case.kind.base:
        near = case.rest.course(signals, case.rest_values)
        np.testing.assert_array_equal(model.predict(signals, values, near), here.reading)
    moved = dataclasses.replace(signals, depth=signals.depth + 1e-4)
    alone = model.predict(moved, values)
    np.testing.assert_allclose(model.predict(moved, values, here), alone, 0.0, _apart(name, alone - here.reading))


def _apart(name: str, change: Array) -> float:
    """How far two predictions may be apart: law and arm agree to a ten-thousandth of what changes beside a known
    agreement.
    """
    return 1e-4 * float(np.abs(change).max()) if name == "structural-compliance" else 0.0


def test_a_prediction_near_another_runs_only_what_differs(monkeypatch: pytest.MonkeyPatch) -> None:
    case = example("sensor-crosstalk")
    model, values, signals = case.model, case.values, case.signals
    here, acted = model.course(signals, values), []
    for kind, stage in ((type(model.effects[0]), "elastic"), (type(model.effects[1]), "friction")):
        act = getattr(kind, stage)
        monkeypatch.setattr(
            kind, stage, lambda self, s, p, act=act, stage=stage: (acted.append(stage), act(self, s, p))[0]
        )
    again = Model(*model.effects)  # its steps are those above
    for place, expected in ((-1, []), (1, ["friction"]), (0, ["elastic", "friction"])):
        other = values.copy()
        other[place] *= 1.01
        acted.clear()
        again.predict(signals, other, here)
        assert acted == expected


@pytest.mark.parametrize("name", ["relaxation", "maxwell", "zener", "stress-softening"])
def test_materials_remember_over_a_short_gap(name: str) -> None:
    """Samples that are lost while the tool rests, in the material or in the air, change nothing of what comes after."""
    case = example(name)
    t = np.arange(0.0, 6.0, 2e-3)
    depth = np.interp(t, [0.0, 1.0, 1.5, 3.0, 3.5, 4.5, 5.0, 6.0], [-1e-3, -1e-3, 3e-3, 3e-3, -1e-3, -1e-3, 2e-3, 2e-3])
    moving = np.gradient(depth, t)
    nothing = np.zeros((2, len(t)))
    whole = Signals(Layout(("normal_force",), "contact"), t, np.diff(t, prepend=0.0), depth, moving, nothing, nothing)
    model = Model(*(effect for effect in case.model.effects if effect.base or effect.id == name))
    named = {key: value for key, value in zip(case.named, case.values) if key in model.parameters(whole.layout)}
    expected = model.predict(whole, named)[0]
    assert expected.max() > 0.1
    for begins, ends in ((1.6, 2.5), (3.7, 4.2)):
        kept = (t < begins) | (t > ends)
        dt = np.diff(t[kept], prepend=0.0)
        dt[dt > 0.1] = 0.0
        short = Signals(whole.layout, t[kept], dt, depth[kept], moving[kept], nothing[:, kept], nothing[:, kept])
        np.testing.assert_allclose(model.predict(short, named)[0], expected[kept], atol=1e-6 * expected.max())


# ---- any model of contact laws --------------------------------------------------------------------------------------

CONTACT = [name for name in NAMES[: NAMES.index("tool-mass")] if name not in (*LAWS, "rigid-body")]


@st.composite
def contact_models(draw: st.DrawFn, without: frozenset[str] = frozenset()) -> Model:
    """An admissible model of a base and some of the normal and tangential effects, in any order."""
    base = draw(st.sampled_from(LAWS))
    chosen = draw(st.lists(st.sampled_from([name for name in CONTACT if name not in without]), unique=True, max_size=6))
    names = [base]
    for name in sorted(chosen, key=lambda name: bool(get(name).requires)):
        if not get(name).requires or set(get(name).requires) & {*names, *chosen}:
            names.append(name)
    while True:  # drop what has lost what it wants
        kept = [name for name in names if not get(name).requires or set(get(name).requires) & set(names)]
        if kept == names:
            return Model(*draw(st.permutations(names)))
        names = kept


#: compiled kernels are loaded within the first example
QUICK = settings(max_examples=40, deadline=None, derandomize=True, suppress_health_check=[HealthCheck.too_slow])


#: these bend what others predict: a tool that leaves what has flowed does so at a force that the whole law decides,
#: a bond takes no more off the load than there is
BENDING = frozenset({"load-dependent-friction", "relaxation", "hysteresis", "maxwell", "zener", "adhesion"})


@QUICK
@given(contact_models(without=BENDING).filter(lambda model: not BENDING & set(model.names)), st.integers(0, 99))
def test_any_model_is_affine_in_what_is_marked_linear(model: Model, seed: int) -> None:
    signals = reference_motion(Motion.POKES)
    assert departure_from_affine(model, signals, true_values(model, signals.layout), seed) < 1e-9


@QUICK
@given(contact_models())
def test_nothing_acts_out_of_reach(model: Model) -> None:
    signals = reference_motion(Motion.POKES)
    reading = model.predict(signals, true_values(model, signals.layout))
    assert np.isfinite(reading).all()
    # a bond reaches out by its length, a misplaced surface by its offset, both below 1 mm in the examples
    np.testing.assert_array_equal(reading[:, signals.depth < -0.9e-3], 0.0)


@pytest.mark.parametrize("name", [*LAWS, *CONTACT])
def test_a_bond_opens_the_outside_to_nothing_else(name: str) -> None:
    """With adhesion in the model, forces outside the material count: every law must end there by itself."""
    case = example(name)
    if "adhesion" in case.model:
        return
    bonded = case.model + "adhesion"
    reading = bonded.predict(case.signals, dict(zip(case.named, case.values)))
    np.testing.assert_array_equal(reading[:, case.signals.depth < -0.9e-3], 0.0)


@pytest.mark.parametrize("base", ["hooke", "kelvin-voigt", "hertz", "maxwell", "zener"])
def test_the_null_of_an_exponent_is_the_bases_own(base: str) -> None:
    signals = reference_motion(Motion.POKES)
    model = Model(base, "hertz-exponent")
    null = get("hertz-exponent").null_for(base)["exponent"]
    reading = model.predict(signals, {"hertz-exponent.exponent": null})
    expected = Model(base).predict(signals, {})
    np.testing.assert_allclose(reading, expected, rtol=0, atol=1e-12 * expected.max())


@QUICK
@given(contact_models(), st.randoms(use_true_random=False))
def test_the_order_in_which_effects_are_named_does_not_matter(model: Model, random: Any) -> None:
    effects = list(model.effects)
    random.shuffle(effects)
    assert _apart_by_order(reference_motion(Motion.POKES), model, Model(*effects)) < 1e-12


def _apart_by_order(signals: Signals, model: Model, other: Model) -> float:
    """The largest difference between two predictions, in units of the largest reading."""
    one, two = (each.predict(signals, true_values(each, signals.layout)) for each in (model, other))
    return float(np.abs(one - two).max() / np.abs(one).max())


@pytest.mark.parametrize(
    ("asked", "meant"),
    [
        ("anisotropic-friction", "friction-anisotropy"),
        ("tilt-surface", "surface-tilt"),
        ("compliance", "structural-compliance"),
        ("relaxaton", "relaxation"),
        ("delay", "time-offset"),
        ("mullins", "stress-softening"),
    ],
)
def test_near_names_are_suggested(asked: str, meant: str) -> None:
    """In any order of their words, in part, with slips, and by what people call them."""
    with pytest.raises(InputError, match=f"did you mean '{meant}'"):
        get(asked)
