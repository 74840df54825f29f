"""Rigs whose numbers no robot has: refused in one line, with what was expected."""

from __future__ import annotations

import numpy as np
import pytest

from kinid.data.rig import Rig
from kinid.errors import InputError

ROBOT = '[robot]\nmodel = "ur5"\n'
TOOL = "[tool]\nmass = 0.24\n"
SENSOR = "[sensor]\nrange = [40, 40, 120, 2, 2, 2]\n"
SURFACE = "[surface]\nnormal = [0, 0, 1]\n"


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("[tool]\nmass = true", "no true or false in 'mass'"),
        ("[tool]\nmass = 1e-300", "0 or 1e-06 at least"),
        ("[tool]\nmass = 1e300", "less than or equal to 1000"),
        (TOOL + "com = [0, 0, true]", "no true or false in 'com'"),
        ("[sensor]\nbias = [1e300, 0, 0, 0, 0, 0]", "a bias within"),
        ("[columns]\nfx = { scale = 1e300 }", "a scale within"),
        ("[columns]\nq1 = { offset = 1e300 }", "an offset within"),
        ("[columns]\nq1 = { scale = true }", "no true or false in 'scale'"),
        (SURFACE + "point = [0, 0, 1e300]", "a point within"),
        ("[surface]\npoint = [0, 0, 0]\nnormal = [0, 0, 1e200]", "a direction"),
        (ROBOT + "gravity = [0, 0, 0]", "a gravity of about 9.81"),
        (ROBOT + "gravity = [0, 0, -9810]", "a gravity of about 9.81"),
        (ROBOT + "compliance = [[-1e-5, 0, 0], [0, 1e-5, 0], [0, 0, 1e-5]]", "a compliance in m/N, not negative"),
        (ROBOT + "compliance = [[1e5, 0, 0], [0, 1e5, 0], [0, 0, 1e5]]", "1 / stiffness"),
        (ROBOT + "compliance = [[1e-5, 2e-5, 0], [0, 1e-5, 0], [0, 0, 1e-5]]", "a symmetric compliance"),
        (SURFACE + "point = [0, 0, 0]\noffset_sd = 1e300", "a deviation in m within ±1"),
        (SURFACE + "point = [0, 0, 0]\ntilt_sd = 5", "a deviation in rad within ±1"),
        ('[columns]\nwrench = { unit = "V" }', "newtons or newton metres in one V"),
        ('[columns]\nfz = { unit = "A" }', "newtons or newton metres in one A"),
        (SENSOR + "bias = [1000, 0, 0, 0, 0, 0]", "a bias within the sensor's range of [40, 40, 120, 2, 2, 2]"),
        (SENSOR + "gain_sd = 3", "a deviation within ±0.5"),
        (SENSOR + "noise = [0.1, 0.1, 0.1, 3, 0, 0]", "a noise within the sensor's range"),
        (f"[sensor]\ncrosstalk = {(1000 * np.eye(6)).tolist()}", "near the identity: within 0.5"),
        (f"[sensor]\ncrosstalk = {(np.eye(6) + np.eye(6, k=-3)).tolist()}", "0.5 m for moments by forces"),
        (TOOL + "inertia = [100, 100, 100, 0, 0, 0]", "0.96 kg·m² at most"),
        ("[streams]\nwrench_clock_offset = 1e300", "an offset within"),
        ('[columns]\nq = { unit = "N" }', "a unit of q, as rad"),
        ('[columns]\nq3 = { unit = "Nm" }', "a unit of q3, as rad"),
        ('[columns]\nfx = { unit = "mm" }', "a unit of fx, as N"),
        ('[columns]\nt = { unit = "deg" }', "a unit of t, as s"),
        ('[columns]\ndepth = { unit = "m/s" }', "a unit of depth, as m"),
    ],
)
def test_what_no_robot_has_is_refused(text: str, expected: str) -> None:
    with pytest.raises(InputError) as refused:
        Rig.parse_text(text)
    assert expected in refused.value.expected
    assert "\n" not in str(refused.value)


@pytest.mark.parametrize(
    "text",
    [
        ROBOT + "gravity = [0, 0, -1.62]",  # on the Moon
        ROBOT + "gravity = [9.81, 0, 0]",  # from a wall
        ROBOT + "compliance = [[1e-5, 0, 0], [0, 1e-5, 0], [0, 0, 2e-5]]",
        ROBOT + "compliance = [[1e-5, 1.1e-6, 0], [1e-6, 1e-5, 0], [0, 0, 2e-5]]",  # as it was measured
        SURFACE + "point = [0, 0, 0]\noffset_sd = 0.002\ntilt_sd = 0.02",
        '[columns]\nwrench = { unit = "V", scale = 20.0 }',
        '[columns]\nq = { unit = "deg" }\ntau = { unit = "A", scale = 0.12 }\nfx = { unit = "1", scale = 0.001 }',
        '[columns]\nq1 = { unit = "mm" }',  # a linear axis
        "[tool]\nmass = 0",
        "[sensor]\ngain_sd = 0.01",
        f"[sensor]\ncrosstalk = {(np.eye(6) + 0.2 * np.eye(6, k=3)).tolist()}",  # N per N·m: a lever's reciprocal
    ],
)
def test_what_a_robot_may_have_is_taken(text: str) -> None:
    Rig.parse_text(text)
