"""One model fitted to many logs: the single fit for one, narrower intervals for many, each log's own beside it."""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from campaign.testers import poked, several

import kinid
from kinid.errors import InputError
from kinid.identification.fit import checked_experiment
from kinid.identification.pooling.fit import fit_logs
from kinid.identification.pooling.logs import PooledLog, Problems

MODEL = kinid.Model("kelvin-voigt", "surface-offset", "sensor-bias")


def test_one_log_is_the_single_fit() -> None:
    (log,) = several(1)
    single, pooled = MODEL.fit(log, kinid.Rig()), kinid.Campaign([log]).fit(MODEL)
    found = pooled.parameters | pooled.logs[0].parameters
    assert set(found) == set(single.parameters)
    for name, p in single.parameters.items():
        # the same numbers along another way of adding them up
        assert (found[name].value, found[name].low, found[name].high) == pytest.approx((p.value, p.low, p.high), 1e-6)
    assert pooled.error.train == pytest.approx(single.error.train, rel=1e-6)
    assert pooled.error.held_out == pytest.approx(single.error.held_out, rel=1e-6)
    assert np.isnan(pooled.by_log)


def test_each_log_keeps_its_own_surface_and_bias() -> None:
    rng = np.random.default_rng([0, 3])
    offsets, biases = 1e-4 * rng.standard_normal(6), 0.05 * rng.standard_normal(6)
    fit = kinid.Campaign(several(6)).fit(MODEL)
    assert set(fit.parameters) == {"kelvin-voigt.stiffness", "kelvin-voigt.damping"}
    # a dashpot that pulls at a tool that leaves, as the law has it and the tester not, costs some tenths of a percent
    assert fit["stiffness"].value == pytest.approx(800.0, rel=0.005)
    for log, offset, bias in zip(fit.logs, offsets, biases):
        assert log.parameters["surface-offset.offset"].value == pytest.approx(offset, abs=1e-5)
        assert log.parameters["sensor-bias.offset[normal_force]"].value == pytest.approx(bias, abs=0.01)
    # material from other logs, offset from the other fold: as good as a fit of this log alone
    assert fit.by_log == pytest.approx(fit.error.noise_floor, rel=0.1)
    assert fit.odd == {}


def test_intervals_of_copies_are_narrower_by_the_root_of_their_number() -> None:
    # the same motion and fresh noise: a copy with its noise is no news, and isn't told apart from a law that errs
    logs = [poked(i, motion=0) for i in range(9)]
    model = kinid.Model("kelvin-voigt", "sensor-bias")
    nine, each = kinid.Campaign(logs).fit(model), [model.fit(log, kinid.Rig()) for log in logs]
    for name in ("stiffness", "damping"):
        usual = np.median([fit[name].high - fit[name].low for fit in each])
        # a width is the largest of several guesses, which are noisier for one log: nine gain a little more than that
        assert 2.7 < usual / (nine[name].high - nine[name].low) < 4.2
    # a log that is there twice is refused; one that begins at another time is another log
    copies = kinid.Campaign([dataclasses.replace(logs[0], t=logs[0].t + 64.0 * i) for i in range(9)]).fit(model)
    assert copies["stiffness"].value == pytest.approx(each[0]["stiffness"].value, rel=1e-5)
    alone = kinid.Campaign(logs[:1]).fit(model)
    # of the very same readings, what nine say of stiffness and damping is nine times what one says, its own bias out
    squares = copies.held_out.squares[:2, :2]
    others = alone.held_out.squares[2:, 2:]
    one = alone.held_out.squares[:2, :2] - alone.held_out.squares[:2, 2:] @ np.linalg.solve(
        others, alone.held_out.squares[2:, :2]
    )
    assert squares == pytest.approx(9.0 * one, rel=0.01)


def test_stiffness_by_group_and_out_of_a_population() -> None:
    truth = {"a": 700.0, "b": 900.0}
    robots = ["a", "b"] * 3
    logs = [poked(i, stiffness=truth[robot]) for i, robot in enumerate(robots)]
    model = kinid.Model("kelvin-voigt")
    by_robot = kinid.Campaign(logs, columns={"robot": robots}, sharing={"stiffness": "per robot"}).fit(model)
    for robot, value in truth.items():
        assert by_robot.parameters[f"kelvin-voigt.stiffness[robot={robot}]"].value == pytest.approx(value, rel=0.01)
    drawn = kinid.Campaign(logs, sharing={"kelvin-voigt.stiffness": "population"}).fit(model)
    # six values of ±100: a standard deviation of 110
    assert drawn.spread["kelvin-voigt.stiffness"].value == pytest.approx(110.0, rel=0.1)
    assert drawn["stiffness"].low < 800.0 < drawn["stiffness"].high
    values = [log.parameters["kelvin-voigt.stiffness"].value for log in drawn.logs]
    assert values == pytest.approx([truth[robot] for robot in robots], rel=0.01)


def test_memory_is_that_of_the_logs_that_are_kept(monkeypatch: pytest.MonkeyPatch) -> None:
    """The same answer where only one log at a time is in memory."""
    logs, loads = several(4), []

    def fit() -> float:
        def loader(i: int) -> Callable[[], object]:
            return lambda: (loads.append(i), checked_experiment(MODEL, logs[i], kinid.Rig())[0])[1]

        pooled = fit_logs(MODEL, [PooledLog(str(i), loader(i)) for i in range(4)])  # type: ignore[arg-type]
        return pooled["stiffness"].value

    kept = fit()
    assert len(loads) <= 8  # once for fits of logs alone, once for all of them
    monkeypatch.setattr("kinid.identification.pooling.logs.MOST_SAMPLES", 1)
    loads.clear()
    assert fit() == kept
    assert len(loads) > 12
    assert len(Problems([])) == 0


def test_a_log_that_cannot_carry_the_model_is_put_aside() -> None:
    logs = several(3)
    air = kinid.Log(
        t=logs[0].t, contact={name: x - (0.01 if name == "depth" else 0.0) for name, x in logs[0].contact.items()}
    )
    fit = kinid.Campaign([*logs, air]).fit(MODEL)
    assert "never positive" in fit.put_aside["log 4"]
    assert [log.name for log in fit.logs] == ["log 1", "log 2", "log 3"]
    assert any("log 4 is put aside" in warning for warning in fit.warnings)
    with pytest.raises(InputError, match="never positive"):
        kinid.Campaign([air, dataclasses.replace(air, t=air.t + 64.0)]).fit(MODEL)


def test_what_cannot_be_shared_is_said() -> None:
    logs = several(2)
    for sharing, words in (
        ({"stiffness": "per robto"}, "per-log"),
        ({"stifness": "shared"}, "stiffness"),
        ({"kelvin-voigt.stifness": "shared"}, "stiffness"),
    ):
        with pytest.raises(InputError, match=words):
            kinid.Campaign(logs, sharing=sharing).fit(MODEL)
    with pytest.raises(InputError, match="one for each of 2 logs"):
        kinid.Campaign(logs, columns={"robot": ["a"]})


def test_a_log_without_the_column_that_a_parameter_is_shared_by_is_refused(tmp_path: Path) -> None:
    write(tmp_path, several(2))
    (tmp_path / "campaign.toml").write_text(
        'logs = ["*.parquet"]\n[sharing]\n"kelvin-voigt.stiffness" = "per day"\n'
        '[[log]]\nfile = "a.parquet"\nday = "monday"\n'
    )
    with pytest.raises(InputError, match="1 of 2 logs without day: b.parquet") as refused:
        kinid.Campaign(tmp_path / "campaign.toml").fit(MODEL)
    assert 'day = "…"' in refused.value.mend


def test_models_side_by_side_on_logs_held_out() -> None:
    found = kinid.Campaign(several(4, stiffening=8e4)).compare(
        [kinid.Model("kelvin-voigt", "surface-offset"), kinid.Model("hunt-crossley", "surface-offset")]
    )
    assert [row.rank for row in found.rows] == [1, 2]
    assert "hunt-crossley" in str(found.rows[0].fit.model)  # a spring that stiffens is nearer to a power
    assert found.rows[1].differs
    assert found.to_dict()["models"][1]["difference"] > 0


def write(folder: Path, logs: list[kinid.Log]) -> list[Path]:
    paths = []
    for i, log in enumerate(logs):
        paths.append(folder / f"{'abcdefgh'[i]}.parquet")
        pq.write_table(pa.table({"t": log.t, **log.contact}), paths[-1])
    return paths


def test_files_folders_and_campaign_files_are_one(tmp_path: Path) -> None:
    paths = write(tmp_path, several(3))
    (tmp_path / "rest.toml").write_text(
        'logs = ["a.parquet", "b.*"]\n[sharing]\n"kelvin-voigt.stiffness" = "per robot"\n'
        '[[log]]\nfile = "a.parquet"\nrobot = "left"\n[[log]]\nfile = "b.parquet"\nrobot = "left"\n'
        '[[log]]\nfile = "c.parquet"\nrobot = "right"\n'
    )
    by_name, folder = kinid.Campaign(paths), kinid.Campaign(tmp_path)
    assert by_name.names == folder.names == ["a.parquet", "b.parquet", "c.parquet"]
    assert by_name.fit(MODEL).to_dict() == folder.fit(MODEL).to_dict()
    named = kinid.Campaign(tmp_path / "rest.toml")
    assert named.names == folder.names
    facts = json.loads(json.dumps(named.fit(MODEL).to_dict(), allow_nan=False))
    assert {"kelvin-voigt.stiffness[robot=left]", "kelvin-voigt.stiffness[robot=right]"} < set(facts["parameters"])
    assert set(facts["per_log"]["a.parquet"]) == {"surface-offset.offset", "sensor-bias.offset[normal_force]"}
    assert facts["error_by_log"]["c.parquet"]["held_out"] < 0.03
    assert facts["odd"] == []
    for text, words in (
        ("logs = 3", "a list"),
        ("log = 3", "a list"),
        ("lgos = []", "logs"),
        ("", "no logs"),
        ('logs = ["z*"]', "no log like"),
        ('[[log]]\nfile = "z"', "no log at"),
        ('[[log]]\nfile = "a.parquet"\n' * 2, "two"),
        ("logs =", "TOML"),
    ):
        (tmp_path / "bad.toml").write_text(text)
        with pytest.raises(InputError, match=words):
            kinid.Campaign(tmp_path / "bad.toml")
