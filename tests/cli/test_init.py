"""`kinid init`: from a foreign log to a rig that runs."""

from __future__ import annotations

import re
import shlex

import numpy as np
import pyarrow.parquet as pq
import pytest

from kinid.data.rig import Rig
from kinid.robotics.reading import read


@pytest.fixture
def foreign(log, tmp_path_factory):
    """The same log in another's words: German-style separators, degrees, milliseconds, other names."""
    table = pq.read_table(log)
    folder = tmp_path_factory.mktemp("foreign")
    heads, rows = [], []
    for name in table.column_names:
        values = table[name].to_numpy()
        if name == "t":
            heads.append("Time [ms]")
            rows.append(1e3 * values)
        elif name.startswith("q") and name[1:].isdigit():
            heads.append(f"Joint_{int(name[1:]) - 1}_deg")
            rows.append(np.rad2deg(values))
        elif name in ("fx", "fy", "fz"):
            heads.append(f"tcp_force_{name[1]}")
            rows.append(values)
        elif name in ("tx", "ty", "tz"):
            heads.append(f"Moment {name[1].upper()} (Nmm)")
            rows.append(1e3 * values)
    path = folder / "theirs.csv"
    lines = [";".join(heads), *(";".join(f"{v:.9g}" for v in row) for row in zip(*rows))]
    path.write_text("\n".join([*lines[:1], *lines[1:]]) + "\n", encoding="utf-8")
    return path, table


def test_a_foreign_log_is_read_with_the_rig_that_it_wrote(run, foreign):
    path, table = foreign
    code, out, err = run("init", path, "--robot", "lwr4plus")
    assert code == 0, err
    assert "fx: column 'tcp_force_x'" in out
    made = read(path, Rig.load(path.parent / "rig.toml"))
    assert made.q is not None
    assert made.wrench is not None
    # nine digits were written; 1e-7 of a radian, a newton or a second is below them
    assert np.allclose(made.t - made.t[0], table["t"].to_numpy() - table["t"].to_numpy()[0], atol=1e-6)
    assert np.allclose(made.q, np.column_stack([table[f"q{i}"].to_numpy() for i in range(1, 8)]), atol=1e-7)
    names = ("fx", "fy", "fz", "tx", "ty", "tz")
    assert np.allclose(made.wrench, np.column_stack([table[n].to_numpy() for n in names]), atol=1e-6)
    code, _, err = run("contact", path)
    assert code == 0, err


def test_degrees_and_milliseconds_without_a_word_in_the_names_are_guessed(run, tmp_path):
    t = np.arange(500) * 2.0
    table = np.column_stack([t, *(100.0 + 10 * np.sin(t / 100 + i) for i in range(6))])
    head = "timestamp," + ",".join(f"joint{i}" for i in range(1, 7))
    np.savetxt(tmp_path / "a.csv", table, delimiter=",", header=head, comments="")
    code, _, err = run("init", tmp_path / "a.csv", "--robot", "ur5")
    assert code == 0, err
    rig = Rig.load(tmp_path / "rig.toml")
    assert rig.columns["q1"].unit == "deg"
    assert rig.columns["t"].unit == "ms"


def test_names_with_more_blanks_than_separators_are_names(run, tmp_path):
    t = np.arange(500) * 2.0
    table = np.column_stack([t, *(10 * np.sin(t / 100 + i) for i in range(6))])
    head = "time [ms]," + ",".join(f"joint no {i} [deg]".replace(" no", "") for i in range(1, 7)) + " "
    np.savetxt(tmp_path / "a b.csv", table, delimiter=",", header=head, comments="")
    code, out, err = run("init", tmp_path / "a b.csv", "--robot", "lwr4plus")
    assert code == 0, err
    assert Rig.load(tmp_path / "rig.toml").columns["q6"].unit == "deg"
    assert f"kinid contact '{tmp_path / 'a b.csv'}' --rig" in out  # as a shell takes it


def test_a_table_without_a_header_is_refused(run, refused, tmp_path):
    (tmp_path / "a.csv").write_text("0,1\n1,2\n", encoding="utf-8")
    refused(run("init", tmp_path / "a.csv"), "no header", "column = 0")


def test_what_is_wrong_with_the_log_is_said_as_it_is(run, refused, tmp_path):
    (tmp_path / "a.csv").write_text("t,joint1\n0,1\n2,2\n1,3\n", encoding="utf-8")
    refused(run("init", tmp_path / "a.csv", "--robot", "ur5"), "runs backwards", "if the clock was set back")


def test_frames_that_the_robot_lacks_are_asked_for(run, log, tmp_path):
    """And once they are stated, the command that it names runs."""
    rig = tmp_path / "six.toml"
    table = pq.read_table(log)
    table = table.drop([name for name in table.column_names if name.endswith("7")])
    pq.write_table(table, tmp_path / "six.parquet")
    code, out, err = run("init", tmp_path / "six.parquet", "--robot", "ur5", "-o", rig)
    assert code == 0, err
    assert "to fill in: [robot] sensor_frame" in out
    assert "to fill in: [robot] tip_frame" in out
    text = rig.read_text(encoding="utf-8")
    assert "tool0" in text
    rig.write_text(
        text.replace('# sensor_frame = "…"', 'sensor_frame = "tool0"').replace(
            '# tip_frame = "…"', 'tip_frame = "tool0"'
        )
    )
    (line,) = [line for line in out.splitlines() if line.startswith("wrote")]
    code, _, err = run(*shlex.split(line.split("then: kinid ")[1]), "--trust-wrench")
    assert code == 0, err


def test_a_second_time_it_says_how_to_go_on(run, log, tmp_path):
    rig = tmp_path / "mine.toml"
    assert run("init", log, "--robot", "lwr4plus", "-o", rig)[0] == 0
    code, _, err = run("init", log, "--robot", "lwr4plus", "-o", rig)
    assert code == 2
    advised = re.search(r"go on with it: kinid (.*?); or", err)
    assert advised is not None
    assert run(*shlex.split(advised[1]))[0] == 0


def test_what_it_cannot_know_is_asked_or_refused(run, log, tmp_path):
    code, _, err = run("init", log)
    assert code == 2
    assert "already" in err


@pytest.mark.parametrize(
    ("head", "words"),
    [
        ("time,joint1", ("[robot] model", "--robot")),
        ("x,y", ("[columns] t = {", "[columns] q = {", "'x', 'y'")),
        ("t,fx,fy,left over", ("[columns] fz tx ty tz", "'left over'")),
    ],
)
def test_what_it_cannot_know_stands_in_the_rig_to_be_filled_in(run, tmp_path, head, words):
    rows = "".join(f"{i % 3}," * head.count(",") + "2\n" for i in (0, 1))
    (tmp_path / "b.csv").write_text(f"{head}\n{rows}", encoding="utf-8")
    code, out, err = run("init", tmp_path / "b.csv")
    assert code == 0, err
    text = (tmp_path / "rig.toml").read_text(encoding="utf-8")
    for word in words:
        assert word in out
        assert word in text
    Rig.load(tmp_path / "rig.toml")


URDF = """<robot name="six">{links}{joints}</robot>"""


def arm(path, names):
    """A URDF of an arm with joints of these names."""
    links = "".join(f'<link name="l{i}"/>' for i in range(len(names) + 1))
    joints = "".join(
        f'<joint name="{name}" type="revolute"><parent link="l{i}"/><child link="l{i + 1}"/><origin xyz="0 0 0.2"/>'
        f'<axis xyz="0 {i % 2} {1 - i % 2}"/><limit lower="-3" upper="3" velocity="2" effort="99"/></joint>'
        for i, name in enumerate(names)
    )
    path.write_text(URDF.format(links=links, joints=joints), encoding="utf-8")


@pytest.mark.parametrize(
    ("names", "angles", "time", "wrench"),
    [
        (("hip", "knee_pitch"), "ang_hip,ang_knee_pitch", "clock_s", "Fx_w,Fy_w,Fz_w,Mx_w,My_w,Mz_w"),
        (("Achse_A", "Achse_B"), "Winkel A,Winkel B", "Zeit [s]", "Kraft X,Kraft Y,Kraft Z,Moment X,Moment Y,Moment Z"),
        (("m1", "m2"), "pos_m1,pos_m2", "stamp", "fx,fy,fz,tx,ty,tz"),
    ],
)
def test_columns_with_the_names_of_joints_are_theirs(run, tmp_path, monkeypatch, names, angles, time, wrench):
    """In any order, in degrees where they are beyond a turn; torques that no lever gives are in N·mm."""
    (tmp_path / "logs").mkdir()
    arm(tmp_path / "arm.urdf", names)
    t = np.arange(50) * 0.01
    turns = [100 + 10 * np.sin(t), 20 * np.cos(t)]
    loads = [2.0 + np.sin(t + i) for i in range(3)] + [90.0 * np.cos(t + i) for i in range(3)]
    table = np.column_stack([*loads, *turns[::-1], t])
    head = ",".join([wrench, *angles.split(",")[::-1], time])
    np.savetxt(tmp_path / "logs" / "a.csv", table, delimiter=",", header=head, comments="")
    monkeypatch.chdir(tmp_path)
    code, out, err = run("init", "logs/a.csv", "--robot", "arm.urdf")  # as typed where one stands
    assert code == 0, err
    assert "to fill in: [robot] tip_frame" in out
    rig = Rig.load("logs/rig.toml")
    made = read("logs/a.csv", rig)
    assert made.q is not None
    assert made.wrench is not None
    assert np.allclose(made.q, np.deg2rad(turns).T)
    assert np.allclose(made.wrench[:, 3:], 1e-3 * np.array(loads[3:]).T)
