"""Run the notebooks from the first cell to the last and keep what they show: text, and figures as small pictures.

`make notebooks` does it; the tests run the cells the same way and hold the kept outputs against what the code says now.
Each notebook runs in an empty folder and without measured logs, so that no path, user or measured sample of this
machine gets into it. Pictures are drawn by Chromium, which must be installed; readers need none.
"""

from __future__ import annotations

import ast
import base64
import io
import json
import os
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Callable
from contextlib import chdir, redirect_stdout
from pathlib import Path
from typing import Any

NOTEBOOKS = sorted(Path(__file__).parent.glob("*.ipynb"))
#: width of pictures, and their height where a figure names none [pixels]
WIDTH, HEIGHT = 760, 400
#: colours of a picture's palette: enough for a map, and a fifth of the bytes
COLOURS = 160

Names = dict[str, Any]
Cell = dict[str, Any]
Draw = Callable[[Any], bytes]


def run(cells: list[Cell], names: Names, draw: Draw | None = None) -> list[list[dict[str, Any]]]:
    """Outputs of each code cell, in the form that notebooks keep.

    Args:
        cells: of a notebook. names: what the cells know; they add to it. draw: a plotly figure as PNG; without it
            figures are left empty.
    """
    out = []
    code = [cell for cell in cells if cell["cell_type"] == "code"]
    for count, cell in enumerate(code, start=1):
        tree = ast.parse("".join(cell["source"]))
        last = ast.Expression(tree.body.pop().value) if tree.body and isinstance(tree.body[-1], ast.Expr) else None
        said, value = io.StringIO(), None
        with redirect_stdout(said):
            exec(compile(tree, f"cell {count}", "exec"), names)
            if last is not None:
                value = eval(compile(last, f"cell {count}", "eval"), names)
        outputs: list[dict[str, Any]] = []
        if said.getvalue():
            outputs.append(
                {"name": "stdout", "output_type": "stream", "text": said.getvalue().splitlines(keepends=True)}
            )
        if value is not None:
            outputs.append(
                {"data": _shown(value, draw), "execution_count": count, "metadata": {}, "output_type": "execute_result"}
            )
        out.append(outputs)
    return out


def _shown(value: Any, draw: Draw | None) -> dict[str, Any]:
    if not hasattr(value, "to_html"):
        return {"text/plain": [repr(value)]}
    return {"image/png": base64.b64encode(b"" if draw is None else draw(value)).decode(), "text/plain": ["a figure"]}


def png(figure: Any) -> bytes:
    """A plotly figure as a picture with a palette."""
    from PIL import Image

    height = figure.layout.height or HEIGHT
    figure.update_layout(width=WIDTH, height=height)
    drawn = figure.to_html(include_plotlyjs=True, config={"displayModeBar": False})
    small = io.BytesIO()
    with Image.open(io.BytesIO(shot(drawn.replace("<body>", '<body style="margin:0">'), WIDTH, height))) as picture:
        picture.convert("RGB").quantize(COLOURS, dither=Image.Dither.NONE).save(small, "PNG", optimize=True)
    return small.getvalue()


def shot(page: str, width: int, height: int) -> bytes:
    """What a browser without a network shows of an HTML page, as PNG; sizes in pixels."""
    chromium = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
    if chromium is None:
        sys.exit("no Chromium found, which draws the pictures: install it")
    with tempfile.TemporaryDirectory() as folder:
        source, drawn = Path(folder, "page.html"), Path(folder, "page.png")
        source.write_text(page, encoding="utf-8")
        subprocess.run(
            [
                chromium,
                "--headless",
                "--no-sandbox",
                "--disable-gpu",
                "--enable-unsafe-swiftshader",
                "--no-first-run",
                "--disable-background-networking",
                "--host-resolver-rules=MAP * ~NOTFOUND",
                f"--user-data-dir={folder}/profile",
                "--hide-scrollbars",
                "--virtual-time-budget=6000",
                f"--window-size={width},{height}",
                f"--screenshot={drawn}",
                source.as_uri(),
            ],
            check=True,
            capture_output=True,
            timeout=240,
        )
        return drawn.read_bytes()


def keep(path: Path) -> None:
    """Execute a notebook and write it with its outputs."""
    notebook = json.loads(path.read_text(encoding="utf-8"))
    with tempfile.TemporaryDirectory() as folder, chdir(folder):
        outputs = run(notebook["cells"], {"__name__": "__main__"}, png)
    code = [cell for cell in notebook["cells"] if cell["cell_type"] == "code"]
    for count, (cell, shown) in enumerate(zip(code, outputs), start=1):
        cell |= {"execution_count": count, "outputs": shown}
    unfinished = path.with_suffix(".part")
    unfinished.write_text(json.dumps(notebook, indent=1, ensure_ascii=False, sort_keys=True) + "\n", encoding="utf-8")
    unfinished.replace(path)
    print(f"{path.name}: {path.stat().st_size / 1024:.0f} KiB")


if __name__ == "__main__":
    os.environ.pop("KINID_REAL_DATA", None)
    asked = sys.argv[1:]
    for each in NOTEBOOKS:
        if not asked or any(word in each.name for word in asked):
            keep(each)
