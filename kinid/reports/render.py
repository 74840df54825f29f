"""Pages from the templates beside this file: one self-contained HTML text each, which asks nobody for anything."""

from __future__ import annotations

import base64
import gzip
import re
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from jinja2 import Environment, FileSystemLoader, StrictUndefined
from markupsafe import Markup

from kinid.identification.fitted import FittedParameter
from kinid.residuals.words import number, percent

if TYPE_CHECKING:
    from plotly.graph_objects import Figure

TEMPLATES = Path(__file__).parent / "templates"
#: share of its span by which a coordinate may be off in a picture, where that halves the bytes of it
PICTURED = 1e-4


def render(template: str, title: str, **facts: object) -> str:
    """A page.

    Args:
        template: its file in `templates/`. title: of the page. facts: what the template speaks of.
    """
    return _environment().get_template(template).render(title=title, contents=[], **facts)


@cache
def _environment() -> Environment:
    out = Environment(
        loader=FileSystemLoader(TEMPLATES),
        autoescape=True,
        undefined=StrictUndefined,
        extensions=["jinja2.ext.do"],
        trim_blocks=True,
        lstrip_blocks=True,
    )
    out.policies["json.dumps_kwargs"] = {"allow_nan": False, "ensure_ascii": False}
    out.filters |= {"number": number, "percent": percent, "digits": digits, "interval": interval, "bound": bound}
    out.filters |= {"plotted": _plotted, "slug": _slug}
    out.tests["finite"] = _finite
    out.globals |= {"asset": _asset, "plotly": _plotly, "finite": _finite, "zip": zip}
    return out


def _finite(value: float) -> bool:
    return bool(np.isfinite(value))


def digits(value: float, count: int = 4) -> str:
    """A figure of so many digits; a dash for none."""
    return f"{value:.{count}g}" if np.isfinite(value) else "–"


def bound(value: float, count: int = 3) -> str:
    """An end of an interval; open where there is none."""
    return f"{value:.{count}g}".replace("-", "−") if np.isfinite(value) else "open"


def interval(p: FittedParameter) -> str:
    """An estimate with half its 95 % interval."""
    half = 0.5 * (p.high - p.low)
    return f"{p.value:.4g} ± {half:.2g}" if np.isfinite(half) else f"{p.value:.4g}, open"


def _slug(words: str) -> str:
    """A name for a link within the page."""
    return re.sub(r"\W+", "-", words.lower()).strip("-")


def _asset(name: str) -> Markup:
    """Text of a stylesheet or a script beside the templates."""
    return Markup((TEMPLATES / name).read_text(encoding="utf-8"))  # the house's own text


@cache
def _plotly() -> Markup:
    """The library that draws figures, packed: a page unpacks it in the browser."""
    from plotly.offline import get_plotlyjs

    packed = gzip.compress(get_plotlyjs().encode(), mtime=0)  # without a time, the same page each time
    return Markup(base64.b64encode(packed).decode())


def _plotted(figure: Figure) -> Markup:
    """A figure as JSON within a page, without the template: the page has colours of its own, for light and dark."""
    from plotly.graph_objects import Figure as NewFigure

    light = NewFigure(figure)
    light.update_layout(template="none")
    light.layout.template = None
    for trace in light.data:
        for name in {"x", "y", "z", "intensity"}.intersection(trace):
            values = trace[name]
            if isinstance(values, np.ndarray) and values.dtype == np.float64:
                trace[name] = _single(values)
    # "<" opens no tag inside JSON text, whatever a figure's words hold
    return Markup(light.to_json().replace("<", "\\u003c"))


def _single(values: np.ndarray[tuple[int, ...], np.dtype[np.float64]]) -> object:
    """The same in half the bytes, where a picture can't show the difference."""
    short, known = values.astype(np.float32), values[np.isfinite(values)]
    if len(known) and np.abs(known.astype(np.float32) - known).max() > PICTURED * np.ptp(known):
        return values
    return short
