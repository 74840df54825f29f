"""ROS 2 payloads: what is decoded by a learnt layout is what the library decodes, whatever comes after what."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

pytest.importorskip("rosbags")

from rosbags.typesys import Stores, get_typestore
from rosbags.typesys.store import Typestore

from kinid.live.cdr import TYPES, Decoder
from kinid.live.messages import Joints, Wrench

STORE = get_typestore(Stores.ROS2_HUMBLE)
NAMES = st.lists(st.text("abcdefg_é1", max_size=9), max_size=8)
NUMBERS = st.lists(st.floats(allow_nan=False), max_size=8).map(np.array)
STAMPS = st.tuples(st.integers(-(2**31), 2**31 - 1), st.integers(0, 2**32 - 1))


def _header(stamp: tuple[int, int], frame: str) -> Any:
    return STORE.types["std_msgs/msg/Header"](STORE.types["builtin_interfaces/msg/Time"](*stamp), frame)


def _joints(stamp, frame, names, q, dq, tau, little_endian=True) -> bytes:
    message = STORE.types[TYPES["joints"]](_header(stamp, frame), names, *(np.asarray(v, float) for v in (q, dq, tau)))
    return bytes(STORE.serialize_cdr(message, TYPES["joints"], little_endian=little_endian))


def _wrench(stamp, frame, values, little_endian=True) -> bytes:
    vector = STORE.types["geometry_msgs/msg/Vector3"]
    wrench = STORE.types["geometry_msgs/msg/Wrench"](vector(*values[:3]), vector(*values[3:]))
    message = STORE.types[TYPES["wrench"]](_header(stamp, frame), wrench)
    return bytes(STORE.serialize_cdr(message, TYPES["wrench"], little_endian=little_endian))


def _equals(sample: Joints | Wrench, stamp: tuple[int, int], *numbers: Any, names: Any = None) -> None:
    assert sample.stamp == (stamp[0] * 10**9 + stamp[1] or None)
    ours = [sample.q, sample.dq, sample.tau] if isinstance(sample, Joints) else [sample.wrench]
    for mine, theirs in zip(ours, numbers, strict=True):
        np.testing.assert_array_equal(np.asarray(mine), theirs)
    if isinstance(sample, Joints):
        assert sample.names == tuple(names)


MESSAGES = st.tuples(STAMPS, st.sampled_from(["", "base", "tool0"]), NAMES, NUMBERS, NUMBERS, NUMBERS, st.booleans())


@settings(max_examples=150, deadline=None)
@given(st.lists(MESSAGES, min_size=1, max_size=4), st.lists(st.integers(0, 3), min_size=4, max_size=12))
def test_joints_in_any_order(messages, order) -> None:
    decode = Decoder()
    for i in order:
        stamp, frame, names, q, dq, tau, little = messages[i % len(messages)]
        sample = decode("joints", 7, _joints(stamp, frame, names, q, dq, tau, little))
        assert sample.received == 7
        _equals(sample, stamp, q, dq, tau, names=names)


@settings(max_examples=80, deadline=None)
@given(STAMPS, st.text("abc/_", max_size=9), st.lists(st.floats(allow_nan=False), min_size=18, max_size=18))
def test_wrenches_of_one_publisher(stamp, frame, values) -> None:
    decode = Decoder()
    for k in range(3):
        now = (stamp[0], (stamp[1] + k) % 2**32)
        _equals(decode("wrench", 0, _wrench(now, frame, values[6 * k : 6 * k + 6])), now, values[6 * k : 6 * k + 6])


def test_the_library_is_asked_once_a_layout(monkeypatch) -> None:
    """A message costs the library only where its layout is new: twice then, once to check what was learnt."""
    asked, library = [], Typestore.deserialize_cdr
    monkeypatch.setattr(Typestore, "deserialize_cdr", lambda *given: (asked.append(1), library(*given))[1])
    decode = Decoder()
    for k in range(50):
        decode("joints", 0, _joints((1, k), "base", ["a", "bc"], [k, 1.0], [], []))
    assert len(asked) == 2


@settings(max_examples=200, deadline=None)
@given(st.data())
def test_damage_is_what_the_library_makes_of_it(data) -> None:
    """A payload cut or with other bytes: the same sample as without anything learnt, or the same kind of error."""
    whole = _joints((1, 2), "base", ["a", "bc"], [0.5, 1.0], [], [3.0, 4.0])
    learnt, fresh = Decoder(), Decoder()
    learnt("joints", 0, whole)
    damaged = bytearray(whole[: data.draw(st.integers(0, len(whole)))])
    for at in data.draw(st.lists(st.integers(0, len(whole) - 1), max_size=3)):
        if at < len(damaged):
            damaged[at] = data.draw(st.integers(0, 255))
    outcomes = []
    for decode in (learnt, fresh):
        try:
            sample = decode("joints", 0, bytes(damaged))
        except Exception as error:
            outcomes.append(type(error))
        else:
            outcomes.append(
                (sample.stamp, sample.names, *(np.asarray(v).tobytes() for v in (sample.q, sample.dq, sample.tau)))
            )
    assert outcomes[0] == outcomes[1]
