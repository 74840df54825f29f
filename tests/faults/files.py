"""Whether a file is whole."""

from __future__ import annotations

import json
import tomllib
from pathlib import Path

import numpy as np
import pyarrow.parquet


def assert_whole(path: Path) -> None:
    """Read a result to its end, by the ending of its name."""
    match path.suffix:
        case ".parquet":
            pyarrow.parquet.read_table(path)
        case ".json":
            json.loads(path.read_text(encoding="utf-8"))
        case ".toml":
            tomllib.loads(path.read_text(encoding="utf-8"))
        case ".html":
            assert path.read_text(encoding="utf-8").rstrip().endswith("</html>"), path
        case ".npz":
            with np.load(path, allow_pickle=False) as archive:
                assert dict(archive), path
        case ".mcap":
            from mcap.reader import make_reader

            with path.open("rb") as file:
                list(make_reader(file, validate_crcs=True).iter_messages())
        case _:
            assert path.stat().st_size > 0 or path.suffix == ".begun", path  # a mark that something was begun is empty
