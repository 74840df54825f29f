"""Effects of a user's own: found in their folders, and refused with a line where they are none."""

from __future__ import annotations

import shutil
from importlib.metadata import EntryPoint
from pathlib import Path

import pytest

from kinid import effects
from kinid.effects import _foreign
from kinid.errors import InputError

HOME = Path(effects.__file__).parent


def copied(folder: Path, name: str, id: str, own: str) -> None:
    """A file of the catalogue as a file of one's own."""
    text = (HOME / f"{name}.py").read_text(encoding="utf-8")
    (folder / own).write_text(text.replace(f'id = "{name.replace("_", "-")}"', f'id = "{id}"'), encoding="utf-8")


def test_a_file_is_an_effect(folder: Path) -> None:
    copied(folder, "viscous_damping", "my-damping", "my_damping.py")
    (folder / "_helper.py").write_text("nothing here is read")
    assert effects.get("my-damping").title == effects.get("viscous-damping").title
    assert [effect.id for effect in _foreign.foreign_effects()] == ["my-damping"]


@pytest.mark.parametrize(
    ("name", "text", "said"),
    [
        ("broken.py", "x =", "broken.py can't be imported (SyntaxError"),
        ("empty.py", "x = 1", "0 effects in"),
        ("raises.py", "1 / 0", "ZeroDivisionError"),
        ("leaves.py", "import sys; sys.exit(0)", "leaves.py can't be imported (SystemExit: 0)"),
        ("stops.py", "raise KeyboardInterrupt", "stops.py can't be imported (KeyboardInterrupt)"),
        ("ends.py", "raise BaseException('so')", "ends.py can't be imported (BaseException: so)"),
    ],
)
def test_what_is_no_effect_is_refused(folder: Path, name: str, text: str, said: str) -> None:
    (folder / name).write_text(text)
    with pytest.raises(InputError, match="expected") as refused:
        effects.catalogue()
    assert said in str(refused.value)


@pytest.mark.parametrize(
    ("name", "si", "unit"),
    [
        ("surface_offset", "m", "mm"),
        ("sensor_misalignment", "rad", "deg"),
        ("hooke", "N/m", "kN/m"),
        ("tool_mass", "kg", "g"),
    ],
)
def test_parameters_in_other_than_si_units_are_refused(folder: Path, name: str, si: str, unit: str) -> None:
    copied(folder, name, "my-law", "my_law.py")
    text = (folder / "my_law.py").read_text(encoding="utf-8")
    assert f'"{si}"' in text
    assert effects.get("my-law").id == "my-law"
    effects.catalogue.cache_clear()
    (folder / "my_law.py").write_text(text.replace(f'"{si}"', f'"{unit}"'), encoding="utf-8")
    with pytest.raises(InputError, match="parameters in SI units") as refused:
        effects.catalogue()
    assert f"of effect 'my-law' in '{unit}', in {folder / 'my_law.py'}" in refused.value.found


def test_names_are_taken_once(folder: Path) -> None:
    shutil.copy(HOME / "hooke.py", folder)
    with pytest.raises(InputError, match="a second effect 'hooke'"):
        effects.catalogue()
    (folder / "hooke.py").unlink()
    copied(folder, "hooke", "spring", "springs.py")
    with pytest.raises(InputError, match='id = "springs"'):
        effects.catalogue()


def test_a_folder_that_is_not_there(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("KINID_EFFECTS", str(folder / "none"))
    with pytest.raises(InputError, match="no folder"):
        effects.catalogue()


def test_packages_offer_effects(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    copied(folder, "viscous_damping", "my-damping", "my_damping.py")
    monkeypatch.setenv("KINID_EFFECTS", "")
    monkeypatch.syspath_prepend(folder)
    offered = [EntryPoint("my-damping", "my_damping:ViscousDamping", _foreign.GROUP)]
    monkeypatch.setattr(_foreign, "entry_points", lambda group: offered if group == _foreign.GROUP else [])
    assert "my-damping" in effects.catalogue()
    offered[:] = [EntryPoint("path", "pathlib:Path", _foreign.GROUP)]
    effects.catalogue.cache_clear()
    with pytest.raises(InputError, match="entry point 'path'"):
        effects.catalogue()
    (folder / "leaves.py").write_text("raise SystemExit(0)")
    offered[:] = [EntryPoint("absent", "no_such_package:Law", _foreign.GROUP)]
    offered += [EntryPoint("leaves", "leaves:Law", _foreign.GROUP)]
    for _ in range(2):
        effects.catalogue.cache_clear()
        with pytest.raises(InputError, match=f"entry point '{offered[0].name}' .* can't be imported"):
            effects.catalogue()
        del offered[0]
