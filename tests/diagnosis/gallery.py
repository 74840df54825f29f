"""Reports on measured logs as pages; `make gallery` keeps them. They hold measured samples: no part of the
repository.
"""

from __future__ import annotations

import html
import os
from pathlib import Path

from kinid.diagnosis import Diagnosis
from kinid.reports.diagnosis_page import diagnosis_page
from kinid.writers import write_text


def keep(found: Diagnosis, name: str) -> None:
    """Make a page of what was found, and keep it where `KINID_GALLERY` says."""
    page = diagnosis_page(found, title=name)
    assert name in page
    where = os.environ.get("KINID_GALLERY")
    if not where:
        return
    folder = Path(where)
    folder.mkdir(parents=True, exist_ok=True)
    write_text(folder / f"{name}.html", page)
    write_text(folder / f"{name}.txt", _line(found))
    rows = "".join(
        f'<li><a href="{html.escape(p.stem)}.html">{html.escape(p.stem)}</a>: {html.escape(p.read_text("utf-8"))}</li>'
        for p in sorted(folder.glob("*.txt"))
    )
    write_text(
        folder / "index.html",
        f"<!doctype html><meta charset=utf-8><meta name=viewport content='width=device-width'>"
        f"<title>Diagnoses of measured logs</title><h1>Diagnoses of measured logs</h1><ul>{rows}</ul>",
    )


def _line(found: Diagnosis) -> str:
    rungs = " → ".join(f"{step.held_out:.3g}{f' (+ {step.added})' if step.added else ''}" for step in found.steps)
    return f"{found.model}: {found.verdict}; {rungs} {found.unit}, noise {found.noise_floor:.2g}"
