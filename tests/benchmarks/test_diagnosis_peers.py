"""Diagnosis beside what is usual for choosing terms: sparse regression (SINDy's STLSQ) and forward selection by BIC.

    pytest tests/benchmarks/test_diagnosis_peers.py --benchmark-enable -s

Peers get what they need and more: the starting model already fitted, of each effect the columns of finite simulated
change at the shape that follows the residual best, and (STLSQ) a threshold chosen by error on a held-out half. Effects
that are marks in the samples have no columns, so that no case hides one. pysindy is no dependency of the project;
without it the test is skipped.
"""

from __future__ import annotations

import itertools
import warnings
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest
from hidden.case import Case
from hidden.cases import cases
from hidden.study import REPORT
from numpy.typing import NDArray

import kinid
from kinid import effects
from kinid.modeling.applicability import amplitudes, base_of, candidate_effects, shape_points
from kinid.modeling.readings import all_channels

Array = NDArray[np.float64]

SINGLE, NONE = 14, 6
#: thresholds that STLSQ is tried with, in units of the noise that a term explains
THRESHOLDS = (0.02, 0.05, 0.1, 0.2, 0.4)


@dataclass(frozen=True)
class Columns:
    """A case in linear form: residual (m,) of the starting model, change (m, p) per column, each of rms 1 in units of
    noise.

    `own` (m, k) are changes that the starting model's parameters make; `owner` names the effect of each column; `even`
    is half of the samples, in blocks of half a second.
    """

    residual: Array
    own: Array
    columns: Array
    owner: tuple[str, ...]
    even: NDArray[np.bool_]


def linear(case: Case) -> Columns:
    """The starting model fitted, and every effect's columns beside it."""
    model = kinid.Model(*case.model)
    experiment = all_channels(case.log, case.rig, model)
    s = experiment.signals
    fit = model.fit(kinid.contact_series(case.log, case.rig), channels=s.layout.channels)
    values, scales = fit.values, [p.scale for p in model.parameters(s.layout).values()]
    weight = 1.0 / experiment.noise[:, None]

    def stacked(readings: Array) -> Array:
        return np.asarray((readings * weight)[:, experiment.valid]).ravel()

    predicted = model.predict(s, values)
    residual = stacked(experiment.measured - predicted)
    own = []
    for i, scale in enumerate(scales):
        moved = values.copy()
        moved[i] += 1e-3 * scale
        own.append(stacked(model.predict(s, moved) - predicted))
    own += [stacked(np.eye(len(predicted))[i][:, None] * np.ones(len(s))) for i in range(len(predicted))]
    basis = np.linalg.qr(np.stack(own, axis=1))[0]

    def free(column: Array) -> Array:
        return np.asarray(column - basis @ (basis.T @ column))

    left, columns, owner = free(residual), [], []
    for effect, why in candidate_effects(model, s.layout):
        if why or effect.detector:
            continue
        best: tuple[float, list[Array]] = (0.0, [])
        larger, null = model + effect, amplitudes(effect, s.layout, base_of(model))
        before = sum(len(e.parameters(s.layout)) for e in larger.effects[: larger.names.index(effect.id)])
        for at, moving in shape_points(effect, s, null):
            found = []
            for i in moving:
                one = at.copy()
                one[[k for k in moving if k != i]] = [null[k] for k in moving if k != i]
                if one[i] == null[i]:
                    one[i] += effect.parameters(s.layout)[i].scale
                found.append(free(stacked(larger.predict(s, np.insert(values, before, one)) - predicted)))
            found = [c / np.sqrt(np.mean(c**2)) for c in found if np.mean(c**2) > 1e-12]
            if found:
                a = np.stack(found, axis=1)
                fell = float(left @ left - np.sum((left - a @ np.linalg.lstsq(a, left, rcond=None)[0]) ** 2))
                best = max(best, (fell, found), key=lambda pair: pair[0])
        columns += best[1]
        owner += [effect.id] * len(best[1])
    even = np.tile((s.t[experiment.valid] / 0.5).astype(int) % 2 == 0, len(predicted))
    return Columns(left, np.stack(own, axis=1), np.stack(columns, axis=1), tuple(owner), even)


def by_size(data: Columns, coefficients: Array) -> list[str]:
    """Effects by how much of the residual their columns carry, the largest first; none of those that carry nothing."""
    power: dict[str, float] = {}
    for name, c in zip(data.owner, coefficients):
        power[name] = power.get(name, 0.0) + float(c**2)
    return [name for name, p in sorted(power.items(), key=lambda item: -item[1]) if p > 0]


def stlsq(data: Columns, pysindy: Any) -> list[str]:
    """Sequentially thresholded least squares, the threshold by held-out error."""
    best, least = np.zeros(data.columns.shape[1]), np.mean(data.residual[~data.even] ** 2)
    for threshold in THRESHOLDS:
        regression = pysindy.STLSQ(threshold=threshold, alpha=1e-3)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # a threshold that leaves nothing is one of those that are tried
            regression.fit(data.columns[data.even], data.residual[data.even][:, None])
        coefficients = np.ravel(regression.coef_)
        error = np.mean((data.residual - data.columns @ coefficients)[~data.even] ** 2)
        if error < least:
            best, least = coefficients, error
    return by_size(data, best)


def forward(data: Columns) -> list[str]:
    """Effects while BIC of white noise falls, in the order in which they were taken."""
    n, taken, y = len(data.residual), [], data.residual
    owner = np.array(data.owner)
    gram, slope = data.columns.T @ data.columns, data.columns.T @ y

    def bic(names: list[str]) -> float:
        rows = np.flatnonzero(np.isin(owner, names))
        c = np.linalg.lstsq(gram[np.ix_(rows, rows)], slope[rows], rcond=None)[0]
        return float(n * np.log((y @ y - c @ slope[rows]) / n) + len(rows) * np.log(n))

    reached = n * np.log(y @ y / n)
    while len(taken) < len(set(data.owner)):
        score, name = min((bic([*taken, name]), name) for name in set(data.owner) - set(taken))
        if score >= reached:
            break
        reached = score
        taken.append(name)
    return taken


def brief(names: list[str]) -> str:
    """The first four, and how many more."""
    return (", ".join(names[:4]) or "–") + (f" and {len(names) - 4} more" if len(names) > 4 else "")


def chosen() -> Iterator[Case]:
    """Cases that hide one effect with columns, and cases that hide nothing."""
    single = (
        c for c in cases("single", 60, REPORT, "force-depth") if not any(effects.get(n).detector for n in c.truth)
    )
    yield from itertools.islice(single, SINGLE)
    yield from cases("none", NONE, REPORT, "force-depth")


@pytest.mark.benchmark
def test_beside_peers(benchmark: Any, capsys: pytest.CaptureFixture[str]) -> None:
    if benchmark.disabled:
        pytest.skip("takes minutes: pytest tests/benchmarks --benchmark-enable")
    pysindy = pytest.importorskip("pysindy")
    names = ("kinid", "STLSQ (pysindy)", "forward, BIC")
    first, exact, extra, alarms = ({name: 0 for name in names} for _ in range(4))

    def all_cases() -> None:
        for case in chosen():
            found = kinid.diagnose(case.log, case.rig, model=kinid.Model(*case.model))
            data = linear(case)
            answers = dict(zip(names, (list(found.added), stlsq(data, pysindy), forward(data))))
            with capsys.disabled():
                print(
                    f"\n{case.name:<52} " + " | ".join(f"{name}: {brief(t)}" for name, t in answers.items()),
                    end="",
                    flush=True,
                )
            for name, t in answers.items():
                if case.truth:
                    first[name] += t[:1] == list(case.truth)
                    exact[name] += set(t) == case.truth
                    extra[name] += len(set(t) - case.truth)
                else:
                    alarms[name] += bool(t)

    benchmark.pedantic(all_cases, rounds=1)
    with capsys.disabled():
        print(f"\n\n{'':<18}{'named first':>14}{'nothing else':>15}{'false effects':>15}{'false alarms':>15}")
        for name in names:
            print(
                f"{name:<18}{f'{first[name]} of {SINGLE}':>14}{f'{exact[name]} of {SINGLE}':>15}"
                f"{f'{extra[name] / SINGLE:.1f} a case':>15}{f'{alarms[name]} of {NONE}':>15}"
            )
    for name in names[1:]:
        assert exact["kinid"] >= exact[name]
        assert alarms["kinid"] <= alarms[name]
