"""What packages are licensed under is written down as it is, and all of it goes with kinid's own licence."""

from __future__ import annotations

import runpy
import sys
from email.message import Message
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
LICENCES = runpy.run_path(str(ROOT / "docs" / "licences.py"))


@pytest.mark.skipif(sys.version_info[:2] != (3, 11), reason="the page is of the oldest Python that the lock serves")
def test_the_page_is_of_the_packages_that_are_locked() -> None:
    """A licence that is neither permissive nor of a package's own files alone has the page refused."""
    assert (ROOT / "docs" / "licences.md").read_text(encoding="utf-8") == LICENCES["page"]()


def test_what_has_had_no_release_for_long_is_still_what_is_locked() -> None:
    locked = LICENCES["locked"]()
    for name, (version, _, why) in LICENCES["OLD"].items():
        assert locked.get(name) == version, f"{name}: look at its releases again"
        assert why


def test_a_licence_that_asks_for_more_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    said = Message()
    said["License-Expression"] = "AGPL-3.0-only"
    licence = LICENCES["licence"]
    monkeypatch.setitem(licence.__globals__, "metadata", lambda name: said)
    with pytest.raises(ValueError, match="AGPL"):
        licence("some-package")


def test_what_tests_run_as_programs_is_looked_at_too(monkeypatch: pytest.MonkeyPatch) -> None:
    apart = LICENCES["apart"]
    with monkeypatch.context() as without:
        without.setitem(apart.__globals__, "PERMISSIVE", LICENCES["PERMISSIVE"] - {"ISC"})
        with pytest.raises(ValueError, match="md5-typescript of npm says ISC"):
            apart()
    monkeypatch.delitem(LICENCES["APART"], "small-mcap")
    with pytest.raises(ValueError, match="small-mcap"):
        apart()
