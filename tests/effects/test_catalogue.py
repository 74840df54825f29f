"""The contract that every effect of the catalogue keeps, and that models made of any of them keep."""

from __future__ import annotations

import dataclasses
import importlib.util
import re
import sys
from collections.abc import Callable, Mapping
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from kinid.effects import Effect, Layout, Signals, Stage, catalogue, get
from kinid.effects._signals import REMEMBERED
from kinid.errors import InputError
from kinid.estimators.batch import solve
from kinid.modeling.forward import Route
from kinid.modeling.model import Model
from kinid.parameter import Parameter

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
#: a product and quotient of powers of SI units, and of the minute; exponents may be a parameter of the law
UNIT = re.compile(r"1?((^|[·/(])(kg|N|m|s|min|rad|A|V|Hz)(²|³|\^(\d+(\.\d+)?|n|\(n\+1\)))?\)?)*")


def _load(path: Path) -> Any:
    spec = importlib.util.spec_from_file_location(f"effects{path.stem}", path)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module
    spec.loader.exec_module(module)
    return module


def arrays(thing: Any) -> list[Array]:
    """All arrays of signals, those of its parts included."""
    out = []
    for field in dataclasses.fields(thing):
        value = getattr(thing, field.name)
        if isinstance(value, np.ndarray):
            out.append(value)
        elif dataclasses.is_dataclass(value):
            out += arrays(value)
    return out


@cache
def examples() -> dict[str, Any]:
    """All examples of the registry, `_examples.py` and its neighbours; their arrays are closed for writing."""
    out: dict[str, Any] = {}
    for path in sorted(Path(__file__).parent.glob("_examples*.py")):
        more = _load(path).EXAMPLES
        assert not out.keys() & more.keys()
        out |= more
    for found in out.values():
        for array in arrays(found.signals):
            array.setflags(write=False)
    return out


def example(name: str) -> tuple[Model, Array, Signals]:
    """Model, true values and signals of an effect's example."""
    found = examples()[name]
    model, signals = Model(*found.model), found.signals
    named = model.parameters(signals.layout)
    unknown = set(found.values) - set(named)
    assert not unknown, f"values of {unknown}, the model has {list(named)}"
    return model, np.array([found.values.get(key, p.nominal) for key, p in named.items()]), signals


def measured_example(name: str) -> tuple[Model, Array, Signals, Array]:
    """The same as a fit meets it: with the readings it makes as the measured ones, that some laws are driven by."""
    model, values, signals = example(name)
    readings = model.predict(signals, values)
    readings.setflags(write=False)
    return model, values, dataclasses.replace(signals, measured=readings), readings


def of(model: Model, name: str) -> Effect:
    """The effect of this name in a model."""
    return next(effect for effect in model.effects if effect.id == name)


def indices(model: Model, layout: Layout, wanted: Callable[[str, Parameter], bool]) -> list[int]:
    """Places of the parameters that are wanted, by full name."""
    return [i for i, (key, p) in enumerate(model.parameters(layout).items()) if wanted(key, p)]


def at_null(model: Model, name: str, layout: Layout, values: Array) -> Array:
    """Values with an effect's own at its null."""
    base = next((effect.id for effect in model.effects if effect.base), None)
    null = of(model, name).null_for(base)
    out = values.copy()
    for i, key in enumerate(model.parameters(layout)):
        effect, parameter = key.split(".", 1)
        if effect == name and parameter.split("[")[0] in null:
            out[i] = null[parameter.split("[")[0]]
    return out


# ---- texts ----------------------------------------------------------------------------------------------------------


def test_the_catalogue_holds_every_name() -> None:
    assert set(NAMES) <= set(IDS)


def test_every_effect_has_an_example_of_its_own() -> None:
    assert set(examples()) == set(IDS)
    for name in IDS:
        assert name in Model(*examples()[name].model), name


@pytest.mark.parametrize("name", IDS)
def test_texts(name: str) -> None:
    effect = get(name)
    kind = type(effect)
    assert effect.id == name
    assert re.fullmatch(r"[a-z]+(-[a-z]+)*", name)
    for text in (effect.title, effect.equation, effect.source, effect.signature, effect.excited_by):
        assert text.strip() == text
        assert len(text) > 3
    assert effect.title[-1] != "."
    assert kind.__doc__ is not None
    assert not kind.__doc__.startswith(f"{kind.__name__}("), "a docstring of its own, not a dataclass's"
    assert getattr(kind, "__final__", False), "an effect's class is final"
    assert set(effect.needs) <= {"normal", "slip", "wrench", "joints"}
    assert set(effect.wants) <= set(IDS) - {name}
    assert set(effect.confusions) <= set(IDS) - {name}
    assert all(len(told) > 3 for told in effect.confusions.values())
    assert effect.stages()
    unmistakable = effect.base or effect.detector or name == "coulomb-friction"
    assert effect.confusions or unmistakable, "what can it be mistaken for?"


@pytest.mark.parametrize("name", IDS)
def test_it_acts_where_its_kind_of_log_has_a_stage(name: str) -> None:
    effect = get(name)
    if "joints" in effect.needs:
        assert set(effect.stages()) <= {Stage.JOINT, Stage.SENSOR, Stage.ACQUISITION}
    elif effect.base:
        assert Stage.ELASTIC in effect.stages()
    else:
        assert Stage.JOINT not in effect.stages()


@pytest.mark.parametrize("name", IDS)
def test_parameters(name: str) -> None:
    model, _, signals = example(name)
    effect = of(model, name)
    parameters = effect.parameters(signals.layout)
    names = [p.name for p in parameters]
    assert len(set(names)) == len(names)
    assert parameters or name == "rigid-body"
    for p in parameters:
        assert re.fullmatch(r"[a-z]+(-[a-z0-9]+)*\d?(\[[^\]]+\])?", p.name), p.name
        assert UNIT.fullmatch(p.unit), p.unit
        assert p.symbol
        assert np.isfinite([p.nominal, p.scale]).all()
        if p.linear:
            assert p.low <= 0.0 <= p.high, "the linear part is taken apart at zero"
    before_bracket = {p.name.split("[")[0] for p in parameters}
    assert effect.base or set(effect.null_for("hooke")) <= before_bracket
    for key, value in effect.null_for("hooke").items():
        assert all(p.low <= value <= p.high for p in parameters if p.name.split("[")[0] == key)


@pytest.mark.parametrize("name", IDS)
def test_what_it_lacks_is_said(name: str) -> None:
    effect = get(name)
    if not effect.wants:
        return
    with pytest.raises(InputError, match=effect.wants[0]):
        Model(name)


@pytest.mark.parametrize("name", IDS)
def test_starts(name: str) -> None:
    """Shapes, which mean nothing where the effect does nothing, have values to start from; all of them are
    admissible.
    """
    model, _, signals = example(name)
    effect = of(model, name)
    parameters = effect.parameters(signals.layout)
    named = {p.name.split("[")[0]: p for p in parameters}
    assert set(effect.grid) <= set(named)
    null = effect.null_for("hooke")
    if not effect.detector:
        shapes = {p.name.split("[")[0] for p in parameters if not p.linear}
        assert shapes - set(null) <= set(effect.grid)
    for key, values in effect.grid.items():
        assert 2 <= len(values) <= 8
        assert list(values) == sorted(set(values))
        assert all(named[key].low <= value <= named[key].high for value in values)
    starts = effect.starts(signals)
    assert bool(len(starts)) == bool(effect.grid)
    low, high = np.array([p.low for p in parameters]), np.array([p.high for p in parameters])
    places = indices(model, signals.layout, lambda key, _: key.startswith(f"{name}."))
    for start in starts:
        assert ((start >= low) & (start <= high)).all()
        full = model.nominal(signals.layout)
        full[places] = start
        assert np.isfinite(model.predict(signals, full)).all()


@pytest.mark.parametrize("name", IDS)
def test_what_is_admissible(name: str) -> None:
    """True and nominal values are; the null is; what lies outside of a range is told; ranges are of parameters that
    there are.
    """
    model, values, signals = example(name)
    effect, layout = of(model, name), signals.layout
    own = {p.name: p for p in effect.parameters(layout)}
    every = dict(zip(model.parameters(layout), values.tolist()))
    for one in (values, model.nominal(layout), at_null(model, name, layout, values)):
        named = dict(zip(model.parameters(layout), one.tolist()))
        assert effect.implausible({key: named[f"{name}.{key}"] for key in own}, named, signals) == ""
    units = {f"{p.name.split('[')[0]}[{p.unit}]" for p in own.values()} | {p.name.split("[")[0] for p in own.values()}
    for of_name in (effect.admissible, effect.calibration_tolerance):
        known = {key for key in of_name if key in units}
        assert known or not of_name
    for key, p in own.items():
        short = key.split("[")[0]
        low, high = effect.admissible.get(f"{short}[{p.unit}]", effect.admissible.get(short, (-np.inf, np.inf)))
        assert low < high
        for end, beyond in ((low, low - p.scale), (high, high + p.scale)):
            if np.isfinite(end):
                moved = {other: every[f"{name}.{other}"] for other in own} | {key: beyond}
                assert effect.implausible(moved, every | {f"{name}.{key}": beyond}, signals), key


@pytest.mark.parametrize("name", IDS)
def test_what_calibration_leaves_open(name: str) -> None:
    model, _, signals = example(name)
    effect = of(model, name)
    open_ = effect.calibration_sd(signals)
    named = {p.name: p for p in effect.parameters(signals.layout)}
    assert set(open_) <= set(named)
    assert all(0.0 < sd < np.inf for sd in open_.values())
    stated = {
        "tool-mass",
        "payload",
        "sensor-lag",
    }  # shares of a stated tool, which not every rig has; filters of drives
    assert name in stated or bool(open_) == bool(effect.calibration_tolerance)
    null = effect.null_for("hooke")
    assert all(null[key.split("[")[0]] == 0.0 for key in open_), "calibration is open about nothing"


@pytest.mark.parametrize("name", IDS)
def test_priors(name: str) -> None:
    """A prior is a precision: symmetric, positive; none of what has no prior; and a log's own form stays what it is."""
    model, _, signals, _ = measured_example(name)
    effect = of(model, name)
    prior, count = effect.prior(signals.layout), len(effect.parameters(signals.layout))
    own = effect.for_log(signals)
    assert own.for_log(signals) is own
    assert own.id == name
    if prior is None:
        assert effect.learnt(signals.layout, np.eye(count), np.ones(count)) is effect
        return
    assert prior.shape == (count, count)
    np.testing.assert_array_equal(prior, prior.T)
    assert np.linalg.eigvalsh(prior).min() > 0.0


@pytest.mark.parametrize("name", [name for name in IDS if get(name).simpler() is not None])
def test_a_simpler_form_is_the_effect_with_the_rest_at_null(name: str) -> None:
    model, values, signals = example(name)
    small = Model(*(effect.simpler() or effect for effect in model.effects))
    named, fewer = list(model.parameters(signals.layout)), list(small.parameters(signals.layout))
    assert set(fewer) < set(named)
    null = of(model, name).null_for("hooke")
    full = dict(zip(named, values))
    for key in set(named) - set(fewer):
        full[key] = null.get(key.split(".")[1], full[key])
    expected = small.predict(signals, {key: full[key] for key in fewer})
    np.testing.assert_array_equal(model.predict(signals, full), expected)


# ---- predictions ----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", IDS)
def test_prediction_is_finite_and_leaves_its_input_alone(name: str) -> None:
    model, values, signals = example(name)
    inputs = arrays(signals)  # all closed for writing: numpy and numba raise where one is written into
    before = [array.copy() for array in inputs]
    shape = (len(signals.layout.channels), len(signals))
    first = model.predict(signals, values)
    assert first.shape == shape
    assert np.isfinite(first).all()
    nominal = model.predict(signals, model.nominal(signals.layout))
    assert nominal.shape == shape
    assert np.isfinite(nominal).all()
    np.testing.assert_array_equal(model.predict(signals, values), first)  # and carries nothing over to the next one
    for array, copy in zip(inputs, before):
        np.testing.assert_array_equal(array, copy)


@pytest.mark.parametrize("name", IDS)
def test_it_replaces_arrays_and_never_writes_into_them(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """Quantities of the chain share arrays (N begins as F_e): they are closed before each effect acts."""

    def closed(act: Callable[[Signals, Array], None]) -> Callable[[Signals, Array], None]:
        def run(s: Signals, p: Array) -> None:
            for array in (*arrays(s), p):
                array.setflags(write=False)
            act(s, p)

        return run

    model, values, signals = example(name)
    expected = model.predict(signals, values)
    route = Route.of(model.effects, signals.layout.kind)
    steps = tuple(dataclasses.replace(step, act=closed(step.act)) for step in route.steps)
    monkeypatch.setattr(Route, "of", lambda *_: dataclasses.replace(route, steps=steps))
    np.testing.assert_array_equal(Model(*model.effects).predict(signals, values), expected)


@pytest.mark.parametrize("name", IDS)
def test_a_prediction_that_begins_where_it_differs_from_another_is_the_same(name: str) -> None:
    """With another value of any parameter, with this effect more than the other had, and over another motion."""
    model, values, signals = example(name)
    here = model.course(signals, values)
    np.testing.assert_array_equal(here.reading, model.predict(signals, values))
    for i, p in enumerate(model.parameters(signals.layout).values()):
        other = values.copy()
        other[i] += 0.1 * p.scale if other[i] + 0.1 * p.scale <= p.high else -0.1 * p.scale
        alone = model.predict(signals, other)
        np.testing.assert_allclose(model.predict(signals, other, here), alone, 0.0, _apart(name, alone - here.reading))
    if not of(model, name).base:
        rest = Model(*(effect for effect in model.effects if effect.id != name and name not in effect.wants))
        kept = dict(zip(model.parameters(signals.layout), values))
        near = rest.course(signals, np.array([kept[key] for key in rest.parameters(signals.layout)]))
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
    model, values, signals = example("sensor-crosstalk")
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


@pytest.mark.parametrize("name", IDS)
def test_at_its_null_it_is_not_there(name: str) -> None:
    model, values, signals = example(name)
    effect = of(model, name)
    if effect.base:
        assert not effect.null
        return
    assert effect.null, "an effect that can't be switched off can't be tested for"
    rest = Model(*(other for other in model.effects if other.id != name and name not in other.wants))
    model = Model(*(other for other in model.effects if other.id == name or other.id in rest))
    kept = dict(zip(example(name)[0].parameters(signals.layout), values))
    values = np.array([kept[key] for key in model.parameters(signals.layout)])
    fewer = np.array([kept[key] for key in rest.parameters(signals.layout)])
    without = rest.predict(signals, fewer)
    with_ = model.predict(signals, at_null(model, name, signals.layout, values))
    size = np.abs(without).max(axis=1)  # of each channel
    assert (np.abs(with_ - without).max(axis=1) <= 1e-12 * np.maximum(size, 1.0)).all()
    changed = np.abs(model.predict(signals, values) - without).max(axis=1)
    assert (changed > 5e-3 * size).any(), "and at its true values it is"


def superposition_error(model: Model, signals: Signals, values: Array, seed: int = 0) -> float:
    """Departure from an affine dependence on all parameters marked linear, relative to the largest change."""
    rng = np.random.default_rng(seed)
    named = list(model.parameters(signals.layout).values())
    linear = [i for i, p in enumerate(named) if p.linear]
    if not linear:
        return 0.0

    def at(x: Array) -> Array:
        full = values.copy()
        full[linear] = x
        return model.predict(signals, full)

    size = np.array([max(abs(values[i]), named[i].scale) for i in linear])
    # of either sign, where the law allows it: the linear part is solved for before it is held within bounds
    x, y = (size * rng.uniform(0.3, 2.0, len(linear)) for _ in range(2))
    zero = at(np.zeros(len(linear)))
    a, b = at(x) - zero, at(y) - zero
    both = at(x + y) - zero
    scale = max(np.abs(both).max(), np.abs(zero).max(), 1e-30)
    return float(np.abs(both - a - b).max() / scale)


@pytest.mark.parametrize("name", IDS)
def test_linear_flags(name: str) -> None:
    model, values, signals, _ = measured_example(name)
    error = superposition_error(model, signals, values)
    if all(effect.affine for effect in model.effects):
        assert error < 1e-9
    elif not of(model, name).affine and indices(model, signals.layout, lambda _, p: p.linear):
        assert error > 1e-6, "it says that it bends what others predict"


@pytest.mark.parametrize("name", [name for name in IDS if not get(name).detector])
def test_smooth_in_its_parameters(name: str) -> None:
    """The central differences that a fit takes agree with Richardson's extrapolation of wider ones."""
    model, values, signals, _ = measured_example(name)
    named = model.parameters(signals.layout)
    for i, (key, p) in enumerate(named.items()):
        if not key.startswith(f"{name}."):
            continue

        def slope(h: float, i: int = i, p: Parameter = p) -> Array:
            ahead, behind = values.copy(), values.copy()
            ahead[i], behind[i] = values[i] + h, values[i] - h
            assert p.low <= behind[i] < ahead[i] <= p.high
            return (model.predict(signals, ahead) - model.predict(signals, behind)) / (2 * h)

        h = 6e-6 * max(abs(values[i]), p.scale)  # what kinid.estimators.batch takes
        one, wide, wider = slope(h), slope(4 * h), slope(8 * h)
        best = (4 * wide - wider) / 3
        size = np.linalg.norm(best)
        assert size > 0, f"{key} isn't excited by its example"
        # rounding leaves 1e-16/6e-6 of the reading, a corner (a layer's depth) about one sample of a thousand
        assert np.linalg.norm(one - best) < 1e-4 * size, key


def tail(signals: Signals, k: int) -> Signals:
    """Signals from sample k on."""

    def cut(thing: Any, first: tuple[str, ...] = (), whole: tuple[str, ...] = ()) -> dict[str, Any]:
        out = {}
        for field in dataclasses.fields(thing):
            value = getattr(thing, field.name)
            if isinstance(value, np.ndarray) and value.size and field.name not in whole:
                out[field.name] = value[k:] if field.name in first else np.ascontiguousarray(value[..., k:])
        return out

    parts: dict[str, Any] = cut(signals)
    if signals.sensor is not None:
        parts["sensor"] = dataclasses.replace(signals.sensor, **cut(signals.sensor, ("to_contact",), ("tip", "com")))
    if signals.joints is not None:
        parts["joints"] = dataclasses.replace(signals.joints, **cut(signals.joints))
    return dataclasses.replace(signals, **parts)


@pytest.mark.parametrize("name", IDS)
def test_memory_begins_anew_after_a_gap(name: str) -> None:
    model, values, signals = example(name)
    restarts = np.flatnonzero(signals.dt == 0.0)
    assert restarts[0] == 0
    assert len(restarts) > 1, "the example has a gap"
    k = int(restarts[1])
    # what materials remember outlasts a short gap
    signals = dataclasses.replace(signals, t=signals.t + np.where(np.arange(len(signals)) >= k, 1.01 * REMEMBERED, 0.0))
    whole = model.predict(signals, values)
    alone = model.predict(tail(signals, k), values)
    np.testing.assert_allclose(whole[:, k:], alone, rtol=0, atol=1e-12 * max(1.0, np.abs(whole).max()))


@pytest.mark.parametrize("name", ["relaxation", "maxwell", "zener", "stress-softening"])
def test_materials_remember_over_a_short_gap(name: str) -> None:
    """Samples that are lost while the tool rests, in the material or in the air, change nothing of what comes after."""
    model, values, signals = example(name)
    t = np.arange(0.0, 6.0, 2e-3)
    depth = np.interp(t, [0.0, 1.0, 1.5, 3.0, 3.5, 4.5, 5.0, 6.0], [-1e-3, -1e-3, 3e-3, 3e-3, -1e-3, -1e-3, 2e-3, 2e-3])
    moving = np.gradient(depth, t)
    nothing = np.zeros((2, len(t)))
    whole = Signals(Layout(("normal_force",), "contact"), t, np.diff(t, prepend=0.0), depth, moving, nothing, nothing)
    model = Model(*(effect for effect in model.effects if effect.base or effect.id == name))
    named = {
        key: value
        for key, value in zip(example(name)[0].parameters(signals.layout), values)
        if key in model.parameters(whole.layout)
    }
    expected = model.predict(whole, named)[0]
    assert expected.max() > 0.1
    for begins, ends in ((1.6, 2.5), (3.7, 4.2)):
        kept = (t < begins) | (t > ends)
        dt = np.diff(t[kept], prepend=0.0)
        dt[dt > 0.1] = 0.0
        short = Signals(whole.layout, t[kept], dt, depth[kept], moving[kept], nothing[:, kept], nothing[:, kept])
        np.testing.assert_allclose(model.predict(short, named)[0], expected[kept], atol=1e-6 * expected.max())


@pytest.mark.parametrize("name", [name for name in IDS if not get(name).detector])
def test_recovers_its_parameters(name: str) -> None:
    """Without noise, from the nominal values: to 1e-5 of each value, or of the change that matters where that is
    larger.
    """
    model, values, signals, measured = measured_example(name)
    named = model.parameters(signals.layout)
    if not named:
        return
    sigma = np.maximum(np.sqrt(np.mean(measured**2, axis=1)), 1e-6)
    affine = all(effect.affine for effect in model.effects)
    parameters = [p if affine else dataclasses.replace(p, linear=False) for p in named.values()]
    found = solve(lambda v: model.predict(signals, v), measured, parameters, sigma=sigma, covariance=False)
    for key, p, value, truth in zip(named, parameters, found.values, values):
        if key.startswith(f"{name}."):
            assert abs(value - truth) <= 1e-5 * max(abs(truth), p.scale), key


# ---- any model of contact laws --------------------------------------------------------------------------------------

CONTACT = [name for name in NAMES[: NAMES.index("tool-mass")] if name not in (*LAWS, "rigid-body")]


@st.composite
def contact_models(draw: st.DrawFn, without: frozenset[str] = frozenset()) -> Model:
    """An admissible model of a base and some of the normal and tangential effects, in any order."""
    base = draw(st.sampled_from(LAWS))
    chosen = draw(st.lists(st.sampled_from([name for name in CONTACT if name not in without]), unique=True, max_size=6))
    names = [base]
    for name in sorted(chosen, key=lambda name: bool(get(name).wants)):
        if not get(name).wants or set(get(name).wants) & {*names, *chosen}:
            names.append(name)
    while True:  # drop what has lost what it wants
        kept = [name for name in names if not get(name).wants or set(get(name).wants) & set(names)]
        if kept == names:
            return Model(*draw(st.permutations(names)))
        names = kept


def true_values(model: Model, layout: Layout) -> Array:
    """Each effect's values as in its own example."""
    own: Mapping[str, float] = {key: value for found in examples().values() for key, value in found.values.items()}
    return np.array([own.get(key, p.nominal) for key, p in model.parameters(layout).items()])


#: compiled kernels are loaded within the first example
QUICK = settings(max_examples=40, deadline=None, derandomize=True, suppress_health_check=[HealthCheck.too_slow])


#: these bend what others predict: a tool that leaves what has flowed does so at a force that the whole law decides
BENDING = frozenset({"load-dependent-friction", "relaxation", "hysteresis", "maxwell", "zener"})


@QUICK
@given(contact_models(without=BENDING).filter(lambda model: not BENDING & set(model.names)), st.integers(0, 99))
def test_any_model_is_affine_in_what_is_marked_linear(model: Model, seed: int) -> None:
    signals = examples()["hooke"].signals
    assert superposition_error(model, signals, true_values(model, signals.layout), seed) < 1e-9


@QUICK
@given(contact_models())
def test_nothing_acts_out_of_reach(model: Model) -> None:
    signals = examples()["hooke"].signals
    reading = model.predict(signals, true_values(model, signals.layout))
    assert np.isfinite(reading).all()
    # a bond reaches out by its length, a misplaced surface by its offset, both below 1 mm in the examples
    np.testing.assert_array_equal(reading[:, signals.depth < -0.9e-3], 0.0)


@pytest.mark.parametrize("name", [*LAWS, *CONTACT])
def test_a_bond_opens_the_outside_to_nothing_else(name: str) -> None:
    """With adhesion in the model, forces outside the material count: every law must end there by itself."""
    found = examples()[name]
    if "adhesion" in found.model:
        return
    bonded = Model(*found.model) + "adhesion"
    reading = bonded.predict(found.signals, found.values)
    np.testing.assert_array_equal(reading[:, found.signals.depth < -0.9e-3], 0.0)


@pytest.mark.parametrize("base", ["hooke", "kelvin-voigt", "hertz", "maxwell", "zener"])
def test_the_null_of_an_exponent_is_the_bases_own(base: str) -> None:
    signals = examples()["hooke"].signals
    model = Model(base, "hertz-exponent")
    reading = model.predict(signals, at_null(model, "hertz-exponent", signals.layout, model.nominal(signals.layout)))
    expected = Model(base).predict(signals, {})
    np.testing.assert_allclose(reading, expected, rtol=0, atol=1e-12 * expected.max())


@QUICK
@given(contact_models(), st.randoms(use_true_random=False))
def test_the_order_in_which_effects_are_named_does_not_matter(model: Model, random: Any) -> None:
    effects = list(model.effects)
    random.shuffle(effects)
    assert _apart_by_order(examples()["hooke"].signals, model, Model(*effects)) < 1e-12


def _apart_by_order(signals: Signals, model: Model, other: Model) -> float:
    """The largest difference between two predictions, in units of the largest reading."""
    one, two = (each.predict(signals, true_values(each, signals.layout)) for each in (model, other))
    return float(np.abs(one - two).max() / np.abs(one).max())


@pytest.mark.parametrize("name", [name for name in NAMES if not get(name).base])
def test_nor_does_it_of_any_two_that_act_at_one_stage(name: str) -> None:
    """On the effect's own log, beside each other effect of the catalogue that can act there."""
    found = examples()[name]
    own, layout = Model(*found.model), found.signals.layout
    others = [
        other
        for other in NAMES
        if other not in own
        and not get(other).base
        and get(other).parameters(layout)
        and set(get(other).stages()) & set(get(name).stages())
        and (not get(other).wants or set(get(other).wants) & set(own.names))
    ]
    for other in others:
        names = [n for n in own.names if n != name]
        assert _apart_by_order(found.signals, Model(*names, name, other), Model(*names, other, name)) < 1e-12, other


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
