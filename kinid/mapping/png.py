"""Fields as 16-bit pictures, whose grey is a number and not a colour."""

from __future__ import annotations

import struct
import zlib

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def to_png(field: Array, low: float, high: float) -> bytes:
    """A field (rows, columns) as 16-bit grey PNG: 0 is unknown, 1…65535 spans low…high."""
    share = np.clip((np.nan_to_num(field) - low) / (high - low if high > low else 1.0), 0.0, 1.0)
    grey = np.where(np.isfinite(field), 1 + np.round(share * 65534), 0).astype(">u2")
    rows = b"".join(b"\x00" + row.tobytes() for row in grey)
    head = struct.pack(">IIBBBBB", grey.shape[1], grey.shape[0], 16, 0, 0, 0, 0)
    chunks = ((b"IHDR", head), (b"IDAT", zlib.compress(rows, 9)), (b"IEND", b""))
    return b"\x89PNG\r\n\x1a\n" + b"".join(
        struct.pack(">I", len(d)) + k + d + struct.pack(">I", zlib.crc32(k + d)) for k, d in chunks
    )
