"""ROS 2 messages of joints and wrenches, from CDR to samples.

The rosbags library decodes. Two messages of one publisher differ in their stamp and in their numbers alone, so that the
second needn't be taken apart again: where all other bytes are those of a message that the library has decoded, the
numbers lie where they lay there. Decoding is most of what a sample costs between a socket and its estimate.
"""

from __future__ import annotations

import struct
from collections.abc import Callable, Sequence
from itertools import count, pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from kinid.data.readers import _bag
from kinid.errors import MissingDependencyError
from kinid.live.messages import Joints, Wrench

#: message type of each role
TYPES = {"joints": "sensor_msgs/msg/JointState", "wrench": "geometry_msgs/msg/WrenchStamped"}
#: a little-endian payload begins so; positions in it count from behind that
_LITTLE_ENDIAN = b"\x00\x01\x00\x00"
#: the header's stamp: seconds and nanoseconds, first in both messages
_STAMP = struct.Struct("<iI")
_STAMP_END = len(_LITTLE_ENDIAN) + _STAMP.size

Decode = Callable[[bytes], Any]


class Decoder:
    """Decodes payloads of two roles, `joints` and `wrench`.

    Raises:
        MissingDependencyError: rosbags isn't installed.
    """

    def __init__(self) -> None:
        try:
            from rosbags.typesys import Stores, get_typestore
        except ImportError:
            raise MissingDependencyError("rosbags", "live") from None
        self._deserialize = get_typestore(Stores.ROS2_HUMBLE).deserialize_cdr
        self._layouts: dict[str, Layout] = {}

    def __call__(self, role: str, received: int, payload: bytes) -> Joints | Wrench:
        """The sample of a payload that came at `received` [ns]; whatever the library raises where it is no message."""
        layout = self._layouts.get(role)
        if layout is None or not layout.fits(payload):
            message = self._deserialize(payload, TYPES[role])
            layout = Layout(payload, message, lambda other: self._deserialize(other, TYPES[role]))
            if layout.is_sure:
                self._layouts[role] = layout
            return _sample(role, received, _stamp(message), _numbers(message), layout.names)
        return _sample(role, received, layout.stamp(payload), layout.numbers(payload), layout.names)


class Layout:
    """Where a message's stamp and numbers lie in its payload.

    Args:
        payload: of a message. message: what `decode` makes of it. decode: of a payload.

    Attributes:
        names: of the joints, empty for a wrench.
        is_sure: whether other numbers, written to where these lie, were decoded as these: only then it is of use.
    """

    def __init__(self, payload: bytes, message: Any, decode: Decode) -> None:
        self.names = tuple(getattr(message, "name", ()))
        sizes = [len(numbers) for numbers in _numbers(message)]
        self._areas = _areas(len(payload), sizes, is_listed=hasattr(message, "position"))
        varying = [(len(_LITTLE_ENDIAN), _STAMP_END), *((at, at + 8 * n) for at, n in self._areas if n)]
        between = pairwise([(0, 0), *varying, (len(payload), len(payload))])
        self._fixed = [(slice(end, start), payload[end:start]) for (_, end), (start, _) in between]
        self._size = len(payload)
        self.is_sure = self._is_read(payload, decode)

    def fits(self, payload: bytes) -> bool:
        """Whether all that isn't stamp or number is as it was."""
        return len(payload) == self._size and all(payload[where] == held for where, held in self._fixed)

    def stamp(self, payload: bytes) -> int | None:
        """The header's stamp [ns]; None where the sender says nothing."""
        seconds, fraction = _STAMP.unpack_from(payload, len(_LITTLE_ENDIAN))
        return seconds * 1_000_000_000 + fraction or None

    def numbers(self, payload: bytes) -> list[NDArray[np.float64]]:
        """The arrays of a payload that fits, each with its own size."""
        return [np.frombuffer(payload, "<f8", n, at) for at, n in self._areas]

    def _is_read(self, payload: bytes, decode: Decode) -> bool:
        """Whether `decode` finds other numbers where this finds them."""
        areas = [(at, n) for at, n in self._areas if n]
        ends = [at + 8 * n for at, n in areas]
        if payload[:4] != _LITTLE_ENDIAN or any(at < end for (at, _), end in zip(areas, [_STAMP_END, *ends])):
            return False
        other, values = bytearray(payload), count(1)
        _STAMP.pack_into(other, len(_LITTLE_ENDIAN), next(values), next(values))
        for at, n in areas:
            struct.pack_into(f"<{n}d", other, at, *(next(values) for _ in range(n)))
        try:
            message = decode(bytes(other))
        except Exception:  # what lies there is no number
            return False
        ours = self.numbers(bytes(other))
        return (
            _stamp(message) == self.stamp(bytes(other))
            and tuple(getattr(message, "name", ())) == self.names
            and all(np.array_equal(a, b) for a, b in zip(ours, _numbers(message)))
        )


def _areas(size: int, sizes: Sequence[int], is_listed: bool) -> list[tuple[int, int]]:
    """Offset [bytes] and count of arrays of doubles that end a payload of `size` bytes.

    Each lies at a multiple of eight behind the payload's first four bytes, and has its length as four bytes before it
    where it is listed (OMG CDR, XCDR1).
    """
    end, offsets = 0, list[int]()
    for n in sizes:
        if is_listed and offsets:
            end += 4
        if n:
            end += -end % 8
        offsets.append(end)
        end += 8 * n
    return [(size - end + offset, n) for offset, n in zip(offsets, sizes)]


def _stamp(message: Any) -> int | None:
    return _bag.stamp_of(message) or None


def _numbers(message: Any) -> list[NDArray[np.float64]]:
    """Positions, velocities and efforts, or the wrench."""
    if hasattr(message, "position"):
        return [message.position, message.velocity, message.effort]
    return [np.array(_bag.wrench_row(message))]


def _sample(
    role: str,
    received: int,
    stamp: int | None,
    numbers: Sequence[NDArray[np.float64]],
    names: tuple[str, ...],
) -> Joints | Wrench:
    if role == "wrench":
        return Wrench(received, stamp, numbers[0])
    q, dq, tau = numbers
    return Joints(received, stamp, q, dq, tau, names)
