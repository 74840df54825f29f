"""Compiled: a raw sample into the contact frame, those that are due into both estimators, the watch over all."""

from __future__ import annotations

import sys
from collections.abc import Callable
from types import FunctionType

import numpy as np
from numba import float64, int64, njit, types
from numpy.typing import NDArray

from kinid.kernels import causal, chain, mesh, on_mesh, window
from kinid.kernels.cached import stamp
from kinid.kernels.types import Compiled
from kinid.live import _watch_kernels
from kinid.live._watch_kernels import is_cut, seek_change, watch

Array = NDArray[np.float64]


def _learn(
    t: float,
    q: Array,
    wrench: Array,
    dq: Array,
    contact: Array,
    rows: Compiled,
    start: int,
    shape: Compiled,
    memory: Array,
    friction_rows: Compiled,
    friction_start: int,
    friction_shape: Compiled,
    friction_memory: Array,
    state: Array,
) -> int:
    rates = dq[:0] if np.isnan(dq[0]) else dq
    code: int = causal.take(t, q, wrench, rates, dq[:0], contact)
    if code > causal.NOT_FINITE:
        return -code
    p, k = len(shape), len(friction_shape)
    normal, friction, room = memory[: 2 * p + 6], friction_memory[: 2 * k + 6], carve(contact)  # type: ignore[name-defined]  # noqa: F821
    event_bits: int = 0
    while causal.next_late(room):
        at = causal.late_time(room)
        if is_cut(at, state):
            continue
        causal.hand_over(room, rows, memory[start:])
        once(at, shape, memory)  # type: ignore[name-defined]  # noqa: F821
        causal.hand_over(room, friction_rows, friction_memory[friction_start:])
        friction_once(at, friction_shape, friction_memory)  # type: ignore[name-defined]  # noqa: F821
        event_bits |= seek_change(at, room.late, normal, friction, state)
    event_bits |= int(watch(t, wrench, room.quantities, normal, state))
    return event_bits


_GIVEN = types.Array(float64, 1, "A", readonly=True)
_SOURCES = stamp(sys.modules[__name__], _watch_kernels, causal, chain, mesh, on_mesh, window)


def compile_learn(once: Compiled, parameters: int, friction_once: Compiled) -> Callable[..., int]:
    """Contact frame, both estimators and the watch as one compiled call, which allocates nothing.

    Args:
        once: the normal law's kernel of one sample; parameters: of it. friction_once: that of friction.

    Returns:
        A function of time, positions, wrench, velocities (the first NaN where there are none) and the contact's store;
        for the normal law and for friction the rows, the place of the inputs, the shape and the store; and the watch.
        It answers with the bits of its events, or minus the code of `kinid.kernels.causal` of a sample left out.
    """
    # kernels are constants of the compiled code, as in causal.compile_step_and_learn
    known = {**globals(), "once": once, "friction_once": friction_once, "carve": causal._carve}
    function = FunctionType(_learn.__code__, known, f"learn_{once.py_func.__qualname__}_{_SOURCES}")
    function.__qualname__ = function.__name__
    compiled = njit(error_model="numpy", cache=True, _nrt=False)(function)
    estimator = (types.Array(int64, 1, "C"), int64)
    compiled.compile(
        (float64, _GIVEN, _GIVEN, _GIVEN, float64[::1])
        + (*estimator, types.UniTuple(float64, parameters), float64[::1])
        + (*estimator, types.UniTuple(float64, 2), float64[::1], float64[::1])
    )
    compiled.disable_compile()
    return compiled  # type: ignore[no-any-return]
