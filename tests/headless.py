"""A page in a real browser, without a window and without a network."""

from __future__ import annotations

import re
import shutil
import subprocess
from pathlib import Path

import pytest

CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser")
needs_chromium = pytest.mark.skipif(CHROMIUM is None, reason="no chromium")


def complaints(page: Path, profile: Path, size: str = "1280,900") -> list[str]:
    """Errors that a page writes to the console while it is loaded and drawn.

    Args:
        page: HTML file. profile: folder for the browser's own files. size: of the window [pixels].
    """
    assert CHROMIUM is not None
    done = subprocess.run(
        [
            CHROMIUM,
            "--headless",
            "--no-sandbox",
            "--disable-gpu",
            "--enable-unsafe-swiftshader",
            "--no-first-run",
            "--disable-sync",
            "--disable-background-networking",
            "--disable-component-update",
            "--disable-quic",
            "--host-resolver-rules=MAP * ~NOTFOUND",
            f"--user-data-dir={profile}",
            f"--window-size={size}",
            "--virtual-time-budget=5000",
            "--enable-logging=stderr",
            "--dump-dom",
            page.resolve().as_uri(),
        ],
        check=True,
        capture_output=True,
        text=True,
        timeout=120,
    )
    assert "<body" in done.stdout
    said = re.findall(r"CONSOLE[^\]]*\] (\".*)", done.stderr)
    return [line for line in said if re.search(r"error|uncaught|refused|failed|ERR_", line, re.IGNORECASE)]
