"""Effects that live outside this package: in folders of a user's own, and in installed packages."""

from __future__ import annotations

import importlib.util
import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from importlib.metadata import entry_points
from pathlib import Path
from types import ModuleType

from kinid.effects._effect import Effect
from kinid.effects._signals import Layout
from kinid.errors import InputError
from kinid.inputs import check_regular
from kinid.units import SI

#: the environment variable that names folders of effects, written like PATH; processes that are begun inherit it
VARIABLE = "KINID_EFFECTS"
#: packages offer effects under this group: name = "package.module:Class"
GROUP = "kinid.effects"
#: kinds of logs that an effect's parameters are asked for
LAYOUTS = (
    Layout(("normal_force", "tangential_force1", "tangential_force2"), "contact"),
    Layout(("fx", "fy", "fz", "tx", "ty", "tz"), "wrench"),
    Layout(("tau1",), "joints", ("joint_1",)),
)


def effect_options() -> list[str]:
    """Words of a command line that name the folders of effects of this one: commands that it advises need them, too."""
    return [word for folder in _folders() for word in ("--effects", folder)]


def _folders() -> list[str]:
    return [folder for folder in os.environ.get(VARIABLE, "").split(os.pathsep) if folder]


def foreign_effects() -> Iterator[type[Effect]]:
    """Effects of the folders that `KINID_EFFECTS` names, file by file, then those of installed packages.

    Raises:
        InputError: a folder that isn't there, a file that can't be imported or doesn't hold one effect of its own name,
            an entry point that is no effect, parameters that aren't in SI units.
    """
    for folder in _folders():
        if not Path(folder).is_dir():
            raise InputError(
                f"no folder {folder}", "a folder of effects, one a file", f"check --effects, or {VARIABLE}"
            )
        for path in sorted(Path(folder).glob("[!_.]*.py")):
            yield _in_si(load_effect(path), str(path))
    for point in entry_points(group=GROUP):
        with _importing(
            f"entry point '{point.name}' of {GROUP}", "a class of kinid.effects.Effect", "mend its package"
        ):
            effect = point.load()
        if not (isinstance(effect, type) and issubclass(effect, Effect)):
            raise InputError(
                f"entry point '{point.name}' of {GROUP}", "a class of kinid.effects.Effect", "mend its package"
            )
        yield _in_si(effect, f"entry point '{point.name}' of {GROUP}")


def _in_si(effect: type[Effect], where: str) -> type[Effect]:
    """An effect whose parameters are in SI units: what a log holds is, so that another unit would go into its law, and
    onto every page, a power of ten off.

    Raises:
        InputError: a parameter in another unit.
    """
    for layout in LAYOUTS:
        try:
            parameters = effect().parameters(layout)
        except Exception:  # it isn't made for such logs, or broken, which shows where it is used
            continue
        for p in parameters:
            if not SI.fullmatch(p.unit):
                raise InputError(
                    f"{p.name} of effect '{effect.id}' in '{p.unit}', in {where}",
                    "parameters in SI units, as m, rad, N/m, or 1 for none",
                    "write the law, bounds and scale in SI; what else there is: kinid effect check FILE",
                )
    return effect


def load_effect(path: Path) -> type[Effect]:
    """The one effect that a file holds.

    Raises:
        InputError: it is no file with an end, can't be imported, or see `only_effect`.
    """
    check_regular(path, "effect", "a Python file that holds one effect", "take it out of the folder")
    name = f"kinid_effects_{path.stem}"
    spec = importlib.util.spec_from_file_location(name, path)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[name] = module  # dataclasses look their module up
    try:
        with _importing(str(path), "a Python file that holds one effect", "mend the file"), _no_bytecode():
            spec.loader.exec_module(module)
    except InputError:
        del sys.modules[name]
        raise
    return only_effect(module, path.stem)


@contextmanager
def _importing(what: str, expected: str, mend: str) -> Iterator[None]:
    """Code of somebody else runs: whatever ends it, be it sys.exit, is said of it, and ends nothing else.

    Raises:
        InputError: it can't be imported.
    """
    try:
        yield
    except BaseException as error:
        line = f"{type(error).__name__}: {error}".removesuffix(": ")
        raise InputError(f"{what} can't be imported ({line})", expected, mend) from error


@contextmanager
def _no_bytecode() -> Iterator[None]:
    """Nothing is written into a folder of a user's own by reading it."""
    before, sys.dont_write_bytecode = sys.dont_write_bytecode, True
    try:
        yield
    finally:
        sys.dont_write_bytecode = before


def only_effect(module: ModuleType, file_name: str) -> type[Effect]:
    """The one effect of a module, which has the name of its file.

    Raises:
        InputError: it holds none or several, or one whose `id` isn't the file's name.
    """
    classes = [
        value
        for value in vars(module).values()
        if isinstance(value, type) and issubclass(value, Effect) and value.__module__ == module.__name__
    ]
    if len(classes) != 1:
        raise InputError(
            f"{len(classes)} effects in {module.__file__}", "one class of kinid.effects.Effect", "one a file"
        )
    found, expected = getattr(classes[0], "id", ""), file_name.replace("_", "-")
    if found != expected:
        raise InputError(
            f"effect '{found}' in {module.__file__}", f'id = "{expected}"', "file and effect have one name"
        )
    return classes[0]
