"""What results show of themselves: a short line, a table in a notebook, a data frame, a figure."""

from __future__ import annotations

import html
from abc import ABC, abstractmethod
from collections.abc import Iterable, Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from kinid.errors import InputError

if TYPE_CHECKING:
    from plotly.graph_objects import Figure

Columns = Mapping[str, NDArray[np.generic]]

#: rows of a table that are shown one by one; of a longer one the range of each column
MOST_ROWS = 60


class Shown(ABC):
    """A result with columns. `repr` is its first line."""

    @abstractmethod
    def columns(self) -> Columns:
        """Its table: name → one value a row."""

    def notes(self) -> Sequence[str]:
        """Sentences below the table in a notebook."""
        return ()

    def to_dataframe(self) -> Any:
        """Its table as a `pandas.DataFrame`.

        Raises:
            InputError: pandas isn't installed.
        """
        try:
            import pandas as pd  # type: ignore[import-not-found, import-untyped, unused-ignore]
        except ImportError:
            raise InputError(
                "no pandas", "pandas for a data frame", "pip install pandas, or take the arrays of columns()"
            ) from None
        return pd.DataFrame(dict(self.columns()))

    def plot(self) -> Figure:
        """Its figure (plotly), which a notebook shows and `.show()` opens in a browser."""
        import kinid  # pictures stand above results, which can't name them

        figure: Figure = kinid.figure_of(self)
        return figure

    def _repr_html_(self) -> str:
        """For notebooks."""
        columns = self.columns()
        rows = len(next(iter(columns.values()), ()))
        if rows > MOST_ROWS:
            heads: Sequence[str] = ("", "lowest", "highest")
            body: Iterable[Sequence[object]] = [(name, *_ends(values)) for name, values in columns.items()]
        else:
            heads, body = list(columns), zip(*(values.tolist() for values in columns.values()))
        notes = "".join(f"<p>{html.escape(note)}</p>" for note in self.notes())
        return f"<p>{html.escape(repr(self))}</p>{_table(heads, body)}{notes}"


def _ends(values: NDArray[np.generic]) -> tuple[object, object]:
    """Lowest and highest of a column; of text how many there are, of flags how often."""
    if values.dtype == np.bool_:
        return f"{100 * np.count_nonzero(values) / len(values):.3g} %", ""
    if not np.issubdtype(values.dtype, np.number):
        return ", ".join(dict.fromkeys(map(str, values.tolist()))), ""
    known = np.asarray(values, dtype=float)[np.isfinite(np.asarray(values, dtype=float))]
    return ("unknown", "unknown") if not len(known) else (float(known.min()), float(known.max()))


def _table(heads: Sequence[str], rows: Iterable[Sequence[object]]) -> str:
    def cell(value: object) -> str:
        return f"<td>{html.escape(f'{value:.5g}' if isinstance(value, float) else str(value))}</td>"

    body = "".join(f"<tr>{''.join(map(cell, row))}</tr>" for row in rows)
    return f"<table><tr>{''.join(f'<th>{html.escape(head)}</th>' for head in heads)}</tr>{body}</table>"
