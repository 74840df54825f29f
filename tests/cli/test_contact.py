"""`kinid contact` as a user meets it: results, and one clear line for whatever is wrong."""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from scripted import RIG, Scripted

from kinid.data.rig import CONTACT

Run = Callable[..., tuple[int, str, str]]
Refused = Callable[..., None]
SURFACE = '[robot]\nmodel = "lwr4plus"\n[surface]\npoint = [0.55, 0.0, 0.1]\nnormal = [0, 0, 1]\n'


def change(log: Path, **columns: np.ndarray | None) -> None:
    table = pq.read_table(log).to_pydict()
    table |= {k: v for k, v in columns.items() if v is not None}
    for name in [k for k, v in columns.items() if v is None]:
        del table[name]
    pq.write_table(pa.table(table), log)


def test_forces_and_depth_are_those_of_the_experiment(run: Run, log: Path, scripted: Scripted) -> None:
    out = log.parent / "contact.parquet"
    code, said, _ = run(
        "contact", log, "-o", out, "--plot", log.parent / "plot.html", "--json", log.parent / "facts.json"
    )
    assert code == 0
    assert "normal_force" in said
    table = pq.read_table(out)
    assert table.column_names == ["t", *CONTACT, "in_contact", "phase"]
    # noise of the sensor is 0.029 N in z and 0.015 N across; the bias is removed to a tenth of that
    for name, truth, noise in zip(
        ("tangential_force1", "tangential_force2", "normal_force"), scripted.contact_force.T, (0.015, 0.015, 0.03)
    ):
        assert np.sqrt(np.mean((table[name].to_numpy() - truth) ** 2)) < 1.2 * noise
    # encoders of 2 µrad a step over an arm of a metre
    assert np.abs(table["depth"].to_numpy() - scripted.depth).max() < 5e-6
    assert b"kinid" in pq.read_schema(out).metadata
    page = (log.parent / "plot.html").read_text()
    assert "http://" not in page.split("<script>")[0]
    assert "normal force [N]" in page
    assert json.loads((log.parent / "facts.json").read_text())["touches"] == 1


def test_csv_with_other_names_and_degrees(run: Run, log: Path, tmp_path: Path) -> None:
    table = pq.read_table(log).to_pydict()
    names = {"t": "time_ms", **{f"q{j}": f"joint{j}_deg" for j in range(1, 8)}}
    header, columns = [], []
    for name, values in table.items():
        if name == "phase" or name.startswith("tau"):
            continue
        header.append(names.get(name, name))
        columns.append(np.asarray(values) * (1e3 if name == "t" else np.rad2deg(1) if name.startswith("q") else 1))
    np.savetxt(
        tmp_path / "mine.csv", np.column_stack(columns), delimiter=",", header=",".join(header), comments="", fmt="%.9g"
    )
    mapping = "[columns]\nt = { column = 'time_ms', unit = 'ms' }\n" + "".join(
        f"q{j} = {{ column = 'joint{j}_deg', unit = 'deg' }}\n" for j in range(1, 8)
    )
    (tmp_path / "rig.toml").write_text(RIG + mapping)
    code, said, err = run("contact", tmp_path / "mine.csv", "-o", tmp_path / "out.csv")
    assert code == 0, err
    assert (tmp_path / "out.csv").read_text().startswith('"t","depth"') or (
        tmp_path / "out.csv"
    ).read_text().startswith("t,depth")


def test_motion_is_smoothed_unless_a_bandwidth_is_asked_for(run: Run, log: Path) -> None:
    facts = log.parent / "facts.json"
    for options, step in (((), "smooth"), (("--bandwidth", "25"), "differentiate")):
        code, _, err = run("contact", log, "--json", facts, *options)
        assert code == 0, err
        names = [one["name"] for one in json.loads(facts.read_text())["provenance"]["steps"]]
        assert step in names
        assert len({"smooth", "differentiate"} & set(names)) == 1


def test_logged_velocities_that_contradict_the_positions_are_doubted(run: Run, log: Path) -> None:
    table = pq.read_table(log)
    t, offset = table["t"].to_numpy(), 0.01
    change(log, **{f"dq{j}": np.gradient(table[f"q{j}"].to_numpy(), t) + offset for j in range(1, 8)})
    code, said, err = run("contact", log, "--json", log.parent / "facts.json")
    assert code == 0, err
    assert "doubt: logged velocities are offset from the derivative of the positions" in said
    assert "+0.01" in said
    steps = json.loads((log.parent / "facts.json").read_text())["provenance"]["steps"]
    assert any("offset" in line for one in steps for line in one.get("warnings", ()))


def test_samples_that_are_not_numbers_are_counted_and_stay_where_they_are(run: Run, log: Path) -> None:
    fz = np.array(pq.read_table(log)["fz"].to_pylist())
    fz[[100, 5000]], fz[200] = np.nan, np.inf
    change(log, fz=fz)
    out = log.parent / "c.parquet"
    code, said, _ = run("contact", log, "-o", out)
    assert code == 0
    assert "3 invalid samples" in said
    depth = pq.read_table(out)["normal_force"].to_numpy()
    assert list(np.flatnonzero(~np.isfinite(depth))) == [100, 200, 5000]


BAD_LOGS: dict[str, tuple[Callable[[Path], None], tuple[str, ...]]] = {
    "time runs backwards": (lambda p: change(p, t=np.arange(7500)[::-1] / 500.0), ("backwards", "row 2")),
    "time repeats": (lambda p: change(p, t=np.minimum(np.arange(7500), 7000) / 500.0), ("repeats", "row 7002")),
    "degrees": (
        lambda p: change(p, **{f"q{j}": np.rad2deg(pq.read_table(p)[f"q{j}"].to_numpy()) for j in range(1, 8)}),
        ("degrees", "radians"),
    ),
    "a joint is missing": (lambda p: change(p, q7=None), ("7",)),
    "a joint in the middle is missing": (lambda p: change(p, q4=None), ("q5", "hole")),
    "opposite sign": (
        lambda p: change(p, **{c: -pq.read_table(p)[c].to_numpy() for c in ("fx", "fy", "fz", "tx", "ty", "tz")}),
        ("opposite sign", "gravity"),
    ),
    "empty": (lambda p: p.write_bytes(b""), ()),
    "truncated": (lambda p: p.write_bytes(p.read_bytes()[:5000]), ()),
    "not a table": (lambda p: p.write_bytes(b"hello" * 100), ()),
}


@pytest.mark.parametrize("case", BAD_LOGS)
def test_bad_logs_are_refused_in_one_line(run: Run, log: Path, case: str, refused: Refused) -> None:
    spoil, words = BAD_LOGS[case]
    spoil(log)
    out = log.parent / "out.parquet"
    out.write_text("what was here before")
    refused(run("contact", log, "-o", out), *words)
    assert out.read_text() == "what was here before"
    assert not [p for p in log.parent.iterdir() if p.name.startswith(".")]


BAD_RIGS: dict[str, tuple[str, tuple[str, ...]]] = {
    "no such key": ('[robot]\nmodell = "lwr4plus"\n', ("modell", "model")),
    "no such robot": ('[robot]\nmodel = "lwr5"\n', ("lwr5", "lwr4plus")),
    "normal of zero length": (SURFACE.replace("[0, 0, 1]", "[0, 0, 0]"), ("zero length",)),
    "negative mass": (SURFACE + "[tool]\nmass = -1\n", ("mass",)),
    "no such frame": (SURFACE.replace('"lwr4plus"', '"lwr4plus"\ntip_frame = "tip"'), ("tip", "tool_tip")),
    "no such joint": (SURFACE.replace('"lwr4plus"', '"lwr4plus"\njoints = ["a1"]'), ("a1",)),
    "not TOML": ("[robot\n", ("TOML",)),
    "mesh outside": ('[robot]\nmodel = "lwr4plus"\n[surface]\nmesh = "../part.stl"\n', ("part.stl",)),
    "no mesh": ('[robot]\nmodel = "lwr4plus"\n[surface]\nmesh = "part.stl"\n', ("part.stl",)),
    "unknown unit": (SURFACE + '[columns]\nq1 = { unit = "furlong" }\n', ("furlong",)),
    "unknown column": (SURFACE + '[columns]\nq1 = { column = "nowhere" }\n', ("nowhere",)),
}


@pytest.mark.parametrize("case", BAD_RIGS)
def test_bad_rigs_are_refused_in_one_line(run: Run, log: Path, case: str, refused: Refused) -> None:
    text, words = BAD_RIGS[case]
    (log.parent / "rig.toml").write_text(text)
    refused(run("contact", log), *words)


URDF = '<?xml version="1.0"?>{doctype}<robot name="r"><link name="base">{geometry}</link></robot>'


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (URDF.format(doctype='<!DOCTYPE r [<!ENTITY a "aaaa"><!ENTITY b "&a;&a;&a;">]>', geometry=""), ("entit",)),
        (
            URDF.format(
                doctype="", geometry='<visual><geometry><mesh filename="../../secret.stl"/></geometry></visual>'
            ),
            ("secret.stl",),
        ),
        (URDF.format(doctype="", geometry="")[:-12], ("my.urdf",)),
        (URDF.format(doctype="", geometry=""), ("tip_frame",)),
    ],
)
def test_bad_urdfs_are_refused_in_one_line(
    run: Run, log: Path, text: str, words: tuple[str, ...], refused: Refused
) -> None:
    (log.parent / "my.urdf").write_text(text)
    (log.parent / "rig.toml").write_text(SURFACE.replace("lwr4plus", "my.urdf"))
    refused(run("contact", log), *words)


def test_bad_use_is_refused_in_one_line(run: Run, log: Path, refused: Refused) -> None:
    refused(run("contact", log, "-o", log.parent / "nowhere" / "out.parquet"), "nowhere")
    refused(run("contact", log, "-o", log.parent / "out.xlsx"), "xlsx")
    refused(run("contact", log, "--bias", "automatic"), "automatic")
    refused(run("contact", log, "--bandwidth", "-3"), "bandwidth")
    refused(run("contact", log.with_name("absent.parquet")), "absent.parquet")
    refused(run("contact", log.with_name("absent.xyz")), "xyz")
    code, _, err = run("contact", "--nonsense")
    assert code == 2
    assert err.count("\n") == 1


def test_find_surface_needs_touches(run: Run, log: Path, refused: Refused) -> None:
    refused(run("contact", log, "--find-surface"), "1 touch")


def test_a_log_without_a_surface_gives_the_tip(run: Run, log: Path) -> None:
    (log.parent / "rig.toml").write_text('[robot]\nmodel = "lwr4plus"\n')
    out = log.parent / "tip.csv"
    code, said, err = run("contact", log, "-o", out)
    assert code == 0, err
    assert "tip_x" in said
    assert "residual rms" in said


@pytest.mark.parametrize("suffix", ["parquet", "csv", "npz"])
def test_its_table_is_read_with_the_rig_of_the_log(suffix: str, run: Run, tmp_path: Path) -> None:
    """Whose [columns] are the log's: names and units of the table are the format's."""
    t = np.arange(2000) / 100
    depth = 2e-3 * np.sin(2 * np.pi * t)
    force = np.where(depth > 0, 700 * depth, 0) + np.random.default_rng(0).normal(0, 0.01, len(t))
    rows = np.column_stack([t * 1e3, depth * 1e3, force])
    np.savetxt(tmp_path / "a.csv", rows, delimiter=",", header="t,travel,load", comments="")
    (tmp_path / "rig.toml").write_text(
        '[columns]\nt = { unit = "ms" }\n'
        'depth = { column = "travel", unit = "mm" }\nnormal_force = { column = "load" }\n'
    )
    table = tmp_path / f"contact.{suffix}"
    code, _, err = run("contact", tmp_path / "a.csv", "-o", table)
    assert code == 0, err
    code, _, err = run("fit", table, "--model", "hooke", "--json", tmp_path / "fit.json")
    assert code == 0, err
    found = json.loads((tmp_path / "fit.json").read_text())["parameters"]["hooke.stiffness"]
    assert found["value"] == pytest.approx(700, rel=0.01)


def test_a_material_tester_needs_no_robot(run: Run, tmp_path: Path) -> None:
    t = np.arange(400) / 100
    depth = 2.0 * np.sin(t)
    np.savetxt(tmp_path / "tester.csv", np.column_stack([t, depth, np.maximum(depth, 0)]), delimiter=",")
    (tmp_path / "rig.toml").write_text(
        "[columns]\nt = {column = 0}\ndepth = {column = 1, unit = 'mm'}\nnormal_force = {column = 2}\n"
    )
    code, said, err = run("contact", tmp_path / "tester.csv", "-o", tmp_path / "out.npz")
    assert code == 0, err
    assert "unknown" in said  # slip
    assert np.load(tmp_path / "out.npz")["depth"].max() == pytest.approx(2e-3, rel=1e-3)


def test_help_and_version(run: Run) -> None:
    for args in (["--help"], ["contact", "--help"], ["demo", "-h"]):
        code, said, _ = run(*args)
        assert code == 0
        assert "Usage" in said
    code, said, _ = run("--version")
    assert code == 0
    assert said.startswith("kinid ")


def test_a_channel_without_a_single_number_is_refused(run: Run, refused: Refused, log: Path) -> None:
    out = log.parent / "out.parquet"
    change(log, q1=np.full(7500, np.nan))
    refused(run("contact", log, "-o", out, "--plot", log.parent / "p.html"), "not one sample")
    assert not out.exists()


def test_a_missing_sample_does_not_split_a_touch(run: Run, log: Path) -> None:
    fz = np.array(pq.read_table(log)["fz"].to_pylist())
    fz[3000:3003] = np.nan
    change(log, fz=fz)
    assert "1 touches" in run("contact", log)[1]


def test_outputs_replace_neither_inputs_nor_each_other(run: Run, refused: Refused, log: Path) -> None:
    before = log.read_bytes()
    refused(run("contact", log, "-o", log), "read too")
    refused(run("contact", log, "--json", log.parent / "rig.toml"), "read too")
    same = log.parent / "same.csv"
    refused(run("contact", log, "-o", same, "--json", same), "two outputs")
    refused(run("contact", log, "-o", log.parent / "x.csv", "--plot", log.parent), "a folder")
    assert log.read_bytes() == before
    assert not same.exists()
    assert not (log.parent / "x.csv").exists()


def test_what_the_urdf_parser_says_goes_into_the_line(log: Path) -> None:
    """In a process of its own: the parser, which is C++, writes past Python's error stream."""
    (log.parent / "my.urdf").write_text(
        '<robot name="r"><link name="a"/><link name="b"/><joint name="j" type="revolute"><parent link="a"/><child '
        'link="b"/>'
        "</joint></robot>"
    )
    (log.parent / "rig.toml").write_text(SURFACE.replace("lwr4plus", "my.urdf"))
    done = subprocess.run(
        [sys.executable, "-c", "from kinid.cli import main; main()", "contact", log],
        check=False,
        capture_output=True,
        text=True,
    )
    assert done.returncode == 2
    assert done.stderr.count("\n") == 1
    assert "limits" in done.stderr


@pytest.mark.parametrize("name", ["plot.pdf", "plot", "plot.png"])
def test_a_plot_is_named_as_the_page_that_it_is(run, log, refused, name):
    refused(run("contact", log, "--plot", log.parent / name), f"output '{name}'", ".html")
    assert not (log.parent / name).exists()


@pytest.mark.parametrize("bandwidth", ["1e-9", "250", "1e9", "0", "nan"])
def test_a_bandwidth_that_the_samples_do_not_hold(run, log, refused, bandwidth):
    refused(run("contact", log, "--bandwidth", bandwidth), "Hz")
