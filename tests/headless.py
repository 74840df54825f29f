"""A page in a real browser, without a window and without a network."""

from __future__ import annotations

import re
import shutil
import subprocess
import threading
from pathlib import Path

import pytest

CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser")
needs_chromium = pytest.mark.skipif(CHROMIUM is None, reason="no chromium")
#: what a page says after it was loaded and had a second and a half to draw; virtual time would wait for each frame of a
#: scene that is drawn without a graphics card, fifteen seconds a page
DRAWN = "the page had its time"
AT_THE_END = f"""<script>
addEventListener("load", () => requestAnimationFrame(() => setTimeout(() => console.log("{DRAWN}"), 1500)));
</script>"""


def complaints(page: Path, profile: Path, size: str = "1280,900") -> list[str]:
    """Errors that a page writes to the console while it is loaded and drawn.

    Args:
        page: HTML file. profile: folder for the browser's own files. size: of the window [pixels].
    """
    assert CHROMIUM is not None
    text = page.read_text(encoding="utf-8")
    assert "</body>" in text
    head, tail = text.rsplit("</body>", 1)
    # beside the page, so that what it loads by relative names is there
    watched = page.with_name(f"watched-{page.name}")
    watched.write_text(f"{head}{AT_THE_END}</body>{tail}", encoding="utf-8")
    command = [
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
        "--enable-logging=stderr",
        watched.resolve().as_uri(),
    ]
    lines: list[str] = []
    with subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, errors="replace") as browser:
        late = threading.Timer(120, browser.kill)
        late.start()
        assert browser.stderr is not None
        for line in browser.stderr:
            lines.append(line)
            if DRAWN in line:
                browser.terminate()
                break
    late.cancel()
    watched.unlink()
    assert lines, f"{page} was not drawn"
    assert DRAWN in lines[-1], f"{page} was not drawn: {lines[-5:]}"
    said = re.findall(r"CONSOLE[^\]]*\] (\".*)", "".join(lines))
    return [line for line in said if re.search(r"error|uncaught|refused|failed|ERR_", line, re.IGNORECASE)]
