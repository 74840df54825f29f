"""The contract finds what is wrong with an effect: each rule is broken by an effect that is sound but for that."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, final

import numpy as np
import pytest

from kinid.effects import Array, Effect, Example, Layout, Motion, Signals, catalogue, get
from kinid.modeling.contract import RULES, Case, check_effect, look_alikes
from kinid.parameter import Parameter


def added(s: Signals, p: Array) -> None:
    """A sound law: a dashpot whose force grows with the square of the speed."""
    s.normal = s.normal + p[0] * abs(s.depth_rate) * s.depth_rate * s.inside


def law(parameter: Parameter | None = None, act: Callable[[Signals, Array], None] = added, **attributes: Any) -> Any:
    """An effect of one parameter, sound but for what is given."""
    own = parameter or Parameter("damping", "b", "N·s²/m²", 0.0, -1e8, 1e8, scale=50.0, linear=True)

    @final
    class Law(Effect):
        """N += b |δ̇| δ̇."""

        id = "law-under-test"
        title = "damping with the square of the speed"
        equation = "N += b |δ̇| δ̇"
        source = "P. Forchheimer, Z. Ver. Dtsch. Ing. 45, 1901"
        signature = "a loop over depth whose width follows the square of the speed"
        confusions = {"viscous-damping": "slow and fast pokes"}
        excited_by = "in and out at several speeds"
        null = {own.name: 0.0}
        example = Example(("hooke",), {own.name: 260.0})

        def parameters(self, layout: Layout) -> tuple[Parameter, ...]:
            """The one."""
            return (own,)

        def normal(self, s: Signals, p: Array) -> None:
            """As given."""
            act(s, p)

    for name, value in attributes.items():
        setattr(Law, name, value)
    return Law


def broken(kind: type[Effect]) -> set[str]:
    """Rules that an effect breaks."""
    return {outcome.rule for outcome in check_effect(kind) if not outcome.passed}


def test_a_sound_effect_keeps_every_rule() -> None:
    outcomes = check_effect(law())
    assert [outcome.rule for outcome in outcomes] == [rule.name for rule in RULES]
    assert [outcome for outcome in outcomes if not outcome.passed] == []
    assert all(outcome.found and outcome.expected and not outcome.mend for outcome in outcomes)


def written_into(s: Signals, p: Array) -> None:
    s.normal += p[0] * abs(s.depth_rate) * s.depth_rate * s.inside


def without_contact(s: Signals, p: Array) -> None:
    s.normal = s.normal + p[0] * (abs(s.depth_rate) * s.depth_rate + 0.01)


def kinked(s: Signals, p: Array) -> None:
    s.normal = s.normal + np.floor(p[0]) * abs(s.depth_rate) * s.depth_rate * s.inside


def bent(s: Signals, p: Array) -> None:
    s.normal = s.normal + p[0] ** 2 * abs(s.depth_rate) * s.depth_rate * s.inside


def periodic(s: Signals, p: Array) -> None:
    s.normal = s.normal + 100.0 * np.sin(p[0] / 50.0) * abs(s.depth_rate) * s.depth_rate * s.inside


def remembered(s: Signals, p: Array) -> None:
    s.normal = s.normal + p[0] * np.cumsum(abs(s.depth_rate)) * 1e-3 * s.inside


def scaled(s: Signals, p: Array) -> None:
    s.normal = s.normal * (1.0 + 1e-3 * p[0])


def loud(s: Signals, p: Array) -> None:
    s.normal = s.normal + p[0] * np.random.default_rng().standard_normal(len(s)) * s.inside


def undefined(s: Signals, p: Array) -> None:
    s.normal = np.where(s.depth_rate > 0.0, s.normal, np.nan) + p[0]


def two(**changed: Any) -> Parameter:
    return Parameter(
        **{"name": "damping", "symbol": "b", "unit": "N·s²/m²", "nominal": 0.0, "low": -1e8, "high": 1e8}
        | {"scale": 50.0, "linear": True}
        | changed
    )


CASES: list[tuple[str, type[Effect]]] = [
    ("identity", law(id="Law_under_test")),
    ("texts", law(equation="")),
    ("texts", law(title="damping.")),
    ("signature", law(signature=get("viscous-damping").signature)),
    ("confusions", law(confusions={"viscous-dampin": "slow and fast pokes"})),
    ("confusions", law(confusions={})),
    ("stages", law(needs=("joints",))),
    ("stages", law(needs=("speed",))),
    ("parameters", law(two(name="Damping"))),
    ("units", law(two(unit="lbf/in"))),
    ("bounds", law(two(low=0.0, high=200.0))),
    ("bounds", law(null={"damping": 1e9})),
    ("bounds", law(null={"mass": 0.0})),
    ("admissible", law(admissible={"damping": (300.0, 1e6)})),
    ("admissible", law(admissible={"viscosity": (0.0, 1e6)})),
    ("starts", law(grid={"damping": (300.0, 100.0)})),
    ("starts", law(two(linear=False), null={})),
    ("prior", law(prior=lambda self, layout: -np.eye(1))),
    ("prediction", law(act=undefined)),
    ("prediction", law(act=loud)),
    ("purity", law(act=written_into)),
    ("null", law(null={"damping": 1.0})),
    ("null", law(example=Example(("hooke",), {"damping": 1e-3}))),
    ("linear", law(act=bent)),
    ("linear", law(affine=False)),
    ("derivatives", law(act=kinked)),
    ("order", law(act=scaled)),
    ("gap", law(act=remembered)),
    ("recovery", law(two(linear=False), act=periodic)),
    ("present", law(example=Example(("hooke",), {"damping": 1e-3}))),
    ("not excited", law(act=without_contact, acts_outside=True)),
]


@pytest.mark.parametrize(("rule", "kind"), CASES, ids=[f"{rule} {i}" for i, (rule, _) in enumerate(CASES)])
def test_each_rule_is_broken_by_what_it_is_about(rule: str, kind: type[Effect]) -> None:
    assert rule in broken(kind)
    (outcome,) = (outcome for outcome in check_effect(kind) if outcome.rule == rule)
    assert outcome.found
    assert outcome.mend


def test_an_effect_that_fits_anything_is_found_where_it_is_absent() -> None:
    """Driven by the measured readings, it copies their noise."""

    def copied(s: Signals, p: Array) -> None:
        if s.measured is not None:
            s.normal = s.normal + p[0] * 1e-3 * (s.measured[0] - 830.0 * s.penetration)

    assert "absent" in broken(law(act=copied))


@pytest.mark.parametrize(
    ("example", "said"),
    [
        (None, "no example"),
        (Example(("hooke",), {"dampin": 1.0}), "'dampin'"),
        (Example(("hooke",), {"damping": (1.0, 2.0)}), "2 values"),
        (Example(("hook",), {"damping": 1.0}), "'hook'"),
        (Example((), {"damping": 1.0}, lambda: 1 / 0), "ZeroDivisionError"),  # type: ignore[arg-type,return-value]
    ],
)
def test_an_example_that_cannot_be_built_is_all_that_is_said(example: Example | None, said: str) -> None:
    (outcome,) = check_effect(law(example=example))
    assert outcome.rule == "example"
    assert not outcome.passed
    assert said in outcome.found
    assert outcome.mend


def test_rules_of_the_list_are_all_broken_by_some_case() -> None:
    """A rule that nothing breaks would check nothing."""
    assert {rule for rule, _ in CASES} | {"absent"} == {rule.name for rule in RULES}


def test_what_an_effect_looks_like() -> None:
    """Where they begin, a lag and a delay of readings are the same; joints have no part in a contact."""
    angles = look_alikes(Case.of(catalogue()["viscous-damping"]))
    assert list(angles.values()) == sorted(angles.values())
    assert set(list(angles)[:2]) == {"sensor-lag", "time-offset"}
    assert angles["sensor-lag"] == pytest.approx(angles["time-offset"], abs=0.1)
    assert all(0.0 <= angle <= 90.0 for angle in angles.values())
    assert not {"joint-spring", "tool-mass", "hooke", "viscous-damping"} & set(angles)
    assert look_alikes(Case.of(catalogue()["hooke"])) == {}


def test_two_of_a_kind_are_no_degree_apart() -> None:
    """A law that the catalogue holds under another name."""

    def same(s: Signals, p: Array) -> None:
        s.normal = s.normal + p[0] * s.depth_rate * s.inside

    angles = look_alikes(Case.of(law(act=same, example=Example(("hooke",), {"damping": 12.0}, Motion.WAVES))))
    assert angles["viscous-damping"] < 1e-3  # [°], of rounding: cos 1e-5° is 1 to the last digit
    assert next(iter(angles)) == "viscous-damping"
