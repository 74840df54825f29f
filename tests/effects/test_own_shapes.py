"""An effect from outside this package that leaves arrays of another shape is said with its file and line."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest
from scripted import scripted_poke

Run = Callable[..., tuple[int, str, str]]

LAW = '''"""A law."""

from kinid.effects._effect import Effect
from kinid.effects._example import Example
from kinid.parameter import Parameter


class OddLaw(Effect):
    """N += b δ."""

    id = "odd-law"
    title = "a law"
    equation = "N += b δ"
    source = "nobody"
    signature = "none"
    confusions = {}
    excited_by = "anything"
    null = {"damping": 0.0}
    example = Example(("hooke",), {"damping": 1.0})

    def parameters(self, layout):
        return (Parameter("damping", "b", "N/m", 0.0, -1e8, 1e8, scale=50.0, linear=True),)

    def normal(self, s, p):
        s.normal = CHANGE
'''


@pytest.mark.parametrize(
    ("change", "found"),
    [
        ("s.normal[:-1] + p[0] * s.depth[:-1]", "shape (7499,)"),
        ("(s.normal + p[0] * s.depth)[None, :]", "shape (1, 7500)"),
        ("p[0]", "shape ()"),
        ("None", "type NoneType"),
        ("s.normal + p[0] * s.depth", ""),
    ],
)
def test_a_wrong_shape_is_bad_input_with_file_and_line(run: Run, folder: Path, change: str, found: str) -> None:
    log, law = scripted_poke().write(folder), folder / "odd_law.py"
    law.write_text(LAW.replace("CHANGE", change), encoding="utf-8")
    code, _, err = run("--effects", folder, "fit", log, "--model", "kelvin-voigt,odd-law")
    if not found:
        assert code == 0, err
        return
    assert code == 2
    assert f"s.normal of {found}" in err
    assert "expected shape (7500,)" in err
    assert f"{law}, line 24" in err
