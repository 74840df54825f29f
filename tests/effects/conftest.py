"""A catalogue with effects of a user's own."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest

from kinid import effects


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """A folder that the catalogue reads; nothing of it stays behind."""
    monkeypatch.setenv("KINID_EFFECTS", str(tmp_path))
    effects.catalogue.cache_clear()
    yield tmp_path
    monkeypatch.undo()
    effects.catalogue.cache_clear()
