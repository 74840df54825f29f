"""Running a command line inside the test's own process."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest
from scripted import Scripted, scripted_poke

Run = Callable[..., tuple[int, str, str]]


@pytest.fixture(scope="session")
def scripted() -> Scripted:
    return scripted_poke(seed=5)


@pytest.fixture
def log(scripted: Scripted, tmp_path: Path) -> Path:
    return scripted.write(tmp_path)


@pytest.fixture
def refused() -> Callable[..., None]:
    """One line on stderr that says what was found, expected and to be mended; exit 2; no traceback."""

    def check(result: tuple[int, str, str], *words: str) -> None:
        code, _, err = result
        assert code == 2, err
        assert err.count("\n") == 1, err
        assert "Traceback" not in err
        for word in ("found", "expected", "to mend it", *words):
            assert word in err, err

    return check
