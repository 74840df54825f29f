"""The picture at the top of README.md, made of what a demo wrote: `make story`, or `python docs/story.py OUT.png
[DEMO-FOLDER]`.

Left the demo's recorded scene of its map, right the head of its report, below both the map and where on it the model
fails.
"""

from __future__ import annotations

import io
import runpy
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

#: width of the left and of the right half, height of the whole and of the report's head [pixels]
LEFT, RIGHT, HEIGHT, HEAD = 640, 760, 900, 572
#: the scene alone, without what one clicks on
BARE = "<style>body > :not(canvas):not(:has(canvas)){visibility:hidden!important}</style>"
#: the browser's window on the scene, and what is kept of it: the arm and what it touches
WINDOW, KEPT = (1040, 1000), (340, 16, 1040, 1000)


def story(folder: Path, out: Path) -> None:
    """Put a demo's pages together."""
    from PIL import Image

    from kinid.mapping.map_page import residual_figure
    from kinid.mapping.property_map import PropertyMap

    draw: Any = runpy.run_path(str(Path(__file__).parent.parent / "notebooks" / "execute.py"))

    def picture(page: str, width: int, height: int) -> Any:
        return Image.open(io.BytesIO(draw["shot"](page, width, height))).convert("RGB")

    scene = (folder / "map-scene.html").read_text(encoding="utf-8")
    arm = picture(scene.replace("</head>", BARE + "</head>", 1), *WINDOW).crop(KEPT)
    arm = arm.resize((LEFT, round(LEFT * arm.height / arm.width)), Image.Resampling.LANCZOS)
    report = picture((folder / "report.html").read_text(encoding="utf-8"), RIGHT, HEAD)
    grown = PropertyMap.read(folder / "map.parquet")
    maps = [
        _page(_stiffness(grown), f"Map of a mould from {len(grown)} pokes", RIGHT // 2, HEIGHT - HEAD),
        _page(residual_figure(grown), "Where on it the model fails", RIGHT // 2, HEIGHT - HEAD),
    ]
    whole = Image.new("RGB", (LEFT + RIGHT, HEIGHT), "white")
    whole.paste(arm.crop((0, max(0, arm.height - HEIGHT), LEFT, arm.height)), (0, 0))
    whole.paste(report, (LEFT, 0))
    for k, page in enumerate(maps):
        whole.paste(picture(page, RIGHT // 2, HEIGHT - HEAD), (LEFT + k * RIGHT // 2, HEAD))
    whole.quantize(256, dither=Image.Dither.NONE).save(out, "PNG", optimize=True)


def _stiffness(grown: Any) -> Any:
    from plotly.graph_objects import Figure, Heatmap

    ticks = grown.grid(140)
    mean = grown.over_grid("stiffness", ticks, "gp").mean
    figure = Figure(
        Heatmap(
            x=1e3 * ticks[0],
            y=1e3 * ticks[1],
            z=mean.T,
            colorscale="Viridis",
            colorbar={"title": {"text": "stiffness<br>[N/m]"}},
        )
    )
    at = 1e3 * grown.flat(grown.places)
    figure.add_scatter(x=at[:, 0], y=at[:, 1], mode="markers", marker={"size": 4, "color": "white"}, showlegend=False)
    figure.update_xaxes(title_text="along tangent 1 [mm]", constrain="domain")
    figure.update_yaxes(title_text="along tangent 2 [mm]", scaleanchor="x", constrain="domain")
    return figure


def _page(figure: Any, title: str, width: int, height: int) -> str:
    figure.update_layout(
        width=width,
        height=height,
        title={"text": title, "x": 0.02, "font": {"size": 16}},
        margin={"t": 40, "l": 50, "r": 10, "b": 50},
        font={"size": 11},
    )
    figure.update_traces(colorbar_thickness=12, selector={"type": "heatmap"})
    drawn: str = figure.to_html(include_plotlyjs=True, config={"displayModeBar": False})
    return drawn.replace("<body>", '<body style="margin:0">')


if __name__ == "__main__":
    if len(sys.argv) == 3:
        story(Path(sys.argv[2]), Path(sys.argv[1]))
    else:
        with tempfile.TemporaryDirectory() as temporary:
            command = [
                sys.executable,
                "-c",
                "from kinid.cli import main; main()",
                "demo",
                "-o",
                f"{temporary}/kinid-demo",
            ]
            subprocess.run(command, check=True)
            story(Path(temporary, "kinid-demo"), Path(sys.argv[1]))
