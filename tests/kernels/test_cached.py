"""Compiled code on disk: an edit of what it calls must reach it."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path
from types import FunctionType

import pytest
from numba.core.registry import CPUDispatcher

from kinid.controllers import _line, _rigid_line
from kinid.kernels.cached import stamp
from kinid.lab import closed_loop

INNER = "from numba import njit\n@njit(cache=True)\ndef inner(x):\n    return x + {}\n"
OUTER = """
import inner
from kinid.kernels.cached import cached
_inner = inner.inner
@cached(inner)
def outer(x):
    return 10 * _inner(x)
"""


def test_an_edit_of_what_is_called_reaches_the_caller(tmp_path: Path) -> None:
    found = []
    (tmp_path / "outer.py").write_text(OUTER)
    for added in (1, 2):
        (tmp_path / "inner.py").write_text(INNER.format(added))
        done = subprocess.run(
            [sys.executable, "-c", "import outer; print(outer.outer(5))"],
            cwd=tmp_path,
            text=True,
            capture_output=True,
            check=True,
            env={**os.environ, "PYTHONDONTWRITEBYTECODE": "1", "NUMBA_CACHE_DIR": ""},
        )
        found.append(int(done.stdout))
    assert found == [60, 70]
    assert len(list((tmp_path / "__pycache__").glob("outer*.nbi"))) == 2


@pytest.mark.parametrize("module", [closed_loop, _line, _rigid_line])
def test_all_that_a_loop_calls_is_in_its_stamp(module) -> None:
    """Compiled functions of other files that it or its own file's functions call: each file's source must be in the
    name of the cache.
    """
    function = module.run.py_func
    assert isinstance(function, FunctionType)
    compiled = {name: value for name, value in vars(module).items() if isinstance(value, CPUDispatcher)}
    # those of its own file are compiled into it
    own = [value.py_func for value in compiled.values() if value.py_func.__module__ == module.__name__]
    names = {name for each in own for name in each.__code__.co_names}
    called = {value.py_func.__module__ for name, value in compiled.items() if name in names}
    others = sorted(called - {module.__name__})
    assert others
    modules = {name: sys.modules[name] for name in others}
    expected = {
        "kinid.lab.closed_loop": ["kinid.kernels.dynamics", "kinid.lab._law", "kinid.controllers.impedance"],
        "kinid.controllers._line": [
            "kinid.controllers.passivity",
            "kinid.kernels.contact_laws",
            "kinid.controllers.waves",
        ],
        # that loop's own file calls others in turn
        "kinid.controllers._rigid_line": ["kinid.controllers._line"],
    }[module.__name__]
    assert sorted(expected) == others
    if module is _rigid_line:
        expected = ["kinid.controllers._line", "kinid.controllers.passivity", "kinid.controllers.waves"]
        modules |= {name: sys.modules[name] for name in expected}
    assert function.__qualname__ == f"run_{stamp(*(modules[name] for name in expected))}"
