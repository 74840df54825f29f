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
