"""The notebooks run from the first cell to the last, show what they say they show, and keep it in small outputs without
paths.
"""

from __future__ import annotations

import base64
import importlib.util
import json
import re
import struct
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

FOLDER = Path(__file__).parent.parent / "notebooks"
NOTEBOOKS = sorted(FOLDER.glob("*.ipynb"))
#: those that take a minute; the demo asks the same of the same log, and the laboratory's tests touch smaller moulds
LONG = ("04-find-the-hidden-effect", "05-explore-a-mould", "09-control-with-a-map")
#: bytes of a notebook with its outputs, at most
LARGEST = 300_000
Names = dict[str, Any]
each = pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)


def execute() -> Any:
    """What `make notebooks` runs."""
    spec = importlib.util.spec_from_file_location("execute", FOLDER / "execute.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def words(outputs: list[dict[str, Any]]) -> list[str]:
    """What stands in outputs, without its figures: another processor may round them otherwise."""
    text = "".join("".join(o.get("text") or o["data"]["text/plain"]) for o in outputs)
    return re.findall(r"[^\W\d_]+", re.sub(r"[-+−]?\d[\d.]*(e[-+]?\d+)?", " ", text))


def contact_frame(names: Names, said: str) -> None:
    assert np.nanstd(names["force_error"]) < 2 * names["rig"].sensor.noise[2]
    assert np.nanmax(np.abs(names["depth_error"])) < 1e-5
    assert "residual rms" in said


def excitation(names: Names, said: str) -> None:
    assert all(names["found"].intervals[name].half < 0.8 * each.half for name, each in names["before"].items())
    assert names["motion"].normal_force.max() <= names["force"]
    assert "refused: found" in said


def comparison(names: Names, said: str) -> None:
    assert [str(row.fit.model) for row in names["table"].rows] == ["hunt-crossley", "kelvin-voigt", "hooke"]
    for material, truth in names["truth"].items():
        for value, name in zip(truth, ("stiffness", "damping", "coefficient")):
            assert names["fits"][material][name].value == pytest.approx(value, rel=0.1)


def hidden_effect(names: Names, said: str) -> None:
    assert names["found"].added[0] == "relaxation"
    assert "missing ('relaxation'," in said
    assert names["found"].steps[-1].held_out < 0.5 * names["found"].steps[0].held_out


def mould(names: Names, said: str) -> None:
    assert len(names["grown"]) == 36
    residual_over_noise, film = names["grown"].residual_over_noise, names["film"]
    assert film.any()
    # a surface that is open within its tolerance takes up a part of what a film leaves: 5 times the noise without, 3.8
    # with it, where it acts itself and not its first order
    assert np.median(residual_over_noise[film]) > 3 > 1.5 > np.median(residual_over_noise[~film])


def picture(names: Names, said: str) -> None:
    figures = names["figures"]
    assert figures.random_folds > 0.8
    assert 0.5 < figures.spatial_blocks <= figures.random_folds + 0.02
    assert np.mean(names["strangers"] == "unknown") > 0.95


def another_robot(names: Names, said: str) -> None:
    assert names["fit"]["stiffness"].value == pytest.approx(900.0, rel=0.01)
    assert "did you mean 'tool_tip'" in said


def teleoperation(names: Names, said: str) -> None:
    stable = {(row.delay, row.method): row.stable for row in names["found"].rows}
    assert all(stable[delay, "impedance"] for delay in (0.05, 0.2))
    assert not any(stable[delay, "direct"] for delay in (0.05, 0.2))


def control(names: Names, said: str) -> None:
    found = names["found"]
    assert found.gain("slides at 3 N", holding=True) > 2.0
    assert found.gain("pushes of 10 mm", beyond=True) > 1.5
    assert "the map's model fails" in said


SHOWN: dict[str, Callable[[Names, str], None]] = {
    "01-raw-logs-to-contact-frame": contact_frame,
    "02-plan-an-excitation": excitation,
    "03-fit-and-compare": comparison,
    "04-find-the-hidden-effect": hidden_effect,
    "05-explore-a-mould": mould,
    "06-picture-to-properties": picture,
    "07-another-robot": another_robot,
    "08-teleoperation": teleoperation,
    "09-control-with-a-map": control,
}


def test_each_notebook_has_its_number_and_its_check() -> None:
    assert [path.stem for path in NOTEBOOKS] == sorted(SHOWN)
    assert [path.stem[:2] for path in NOTEBOOKS] == [f"{i + 1:02d}" for i in range(len(NOTEBOOKS))]


@pytest.mark.parametrize(
    "path",
    [pytest.param(path, marks=pytest.mark.slow) if path.stem in LONG else path for path in NOTEBOOKS],
    ids=lambda path: path.stem,
)
def test_notebook_runs(path: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Its claims hold, and the outputs that it keeps are those of the code as it is: `make notebooks` renews them."""
    if "picture" in path.stem:
        pytest.importorskip("sklearn")
    monkeypatch.chdir(tmp_path)
    monkeypatch.delenv("KINID_REAL_DATA", raising=False)
    cells = json.loads(path.read_text(encoding="utf-8"))["cells"]
    names: Names = {"__name__": "__main__"}
    shown = execute().run(cells, names)
    said = "".join("".join(o.get("text", [])) for outputs in shown for o in outputs)
    SHOWN[path.stem](names, said)
    kept = [cell["outputs"] for cell in cells if cell["cell_type"] == "code"]
    for count, (old, new) in enumerate(zip(kept, shown, strict=True), start=1):
        assert words(old) == words(new), f"code cell {count} shows something else now: make notebooks"


@each
def test_outputs_are_small_and_tell_nothing_of_a_machine(path: Path) -> None:
    text = path.read_text(encoding="utf-8")
    assert len(text.encode()) < LARGEST
    code = [cell for cell in json.loads(text)["cells"] if cell["cell_type"] == "code"]
    assert [cell["execution_count"] for cell in code] == list(range(1, len(code) + 1))
    outputs = [output for cell in code for output in cell["outputs"]]
    assert any(output["output_type"] == "stream" for output in outputs)
    pictures = 0
    for output in outputs:
        assert output["output_type"] in ("stream", "execute_result")  # neither an error nor a program
        for kind, value in output.get("data", {}).items():
            assert kind in ("text/plain", "image/png")
            if kind == "image/png":
                head = base64.b64decode(value)[:24]
                assert head.startswith(b"\x89PNG")
                width, height = struct.unpack(">II", head[16:24])
                assert 300 < width < 1000
                assert 100 < height < 1000
                pictures += 1
        said = "".join(output.get("text") or output["data"]["text/plain"])
        assert not re.search(r"(?<![\w.])/[a-z]+/|[A-Z]:\\|~/|\d\d:\d\d:\d\d", said), said
    assert pictures
