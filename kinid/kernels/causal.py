"""Inside a loop, one raw sample at a time: differences through low-passes, then the contact frame, and no allocation.

What a loop watches is of the present sample. What is estimated from it is not: low-passes make velocities late or
noisy, and both put estimates off. So estimators get each sample a little later (`kinid.kernels.window`), in the contact
frame with the motion that the samples on both sides of it show, and with its own wrench.

All that a contact remembers is one float64 array, its store, because what a call of compiled code costs is its
arguments:

    head (6) | columns (N) | prismatic (N) | turns 9 (N + 1) | shifts 3 (N + 1) | tip (3) | reader (42) | tool (16)
    | plane (12) | compliance (9) | motion 3 N | low-passes 3 N | quantities (9) | delayed motion 3 N, quantities (9)
    and head of the sheet (41) | scratch | window | sheet

for N joints, the sheet of a mesh as in `kinid.kernels.on_mesh`; what isn't named here is as in
`kinid.kernels.chain.contacts`.
"""

from __future__ import annotations

import math
import sys
from collections.abc import Callable
from types import FunctionType
from typing import Any, NamedTuple

import numpy as np
from numba import float64, int64, njit, types
from numpy.typing import NDArray

from kinid.kernels import chain, mesh, on_mesh
from kinid.kernels import window as past
from kinid.kernels.cached import stamp
from kinid.kernels.types import Compiled

Array = NDArray[np.float64]

#: contact quantities of a sample: those of `chain` up to the tangential forces
QUANTITIES = chain.TANGENT2 + 1

#: places of the head: time of the last sample [s], −inf before the first; cut-off of the low-passes [rad/s]; normal
#: force from which the tool touches [N]; whether the tip gives way; whether the sensor has faults to undo; joints N
TIME, CUTOFF, TOUCHING, BENDS, CLEANS, JOINTS = range(6)

#: a joint position [rad or m] beyond it is a fault of the log: sine and cosine are good to 10⁵
FAR = 1e5

#: what became of a sample: all well; positions or rates that aren't finite, quantities NaN; and two that change
#: nothing: arrays of another length; a time that isn't finite or doesn't grow
FINE, NOT_FINITE, MISSHAPEN, LATE = range(4)

#: what an estimator has to be given of the last sample: what is due; all of it at once, since the loop knows its
#: velocities and accelerations; that it isn't finite; nothing more
DUE, AT_ONCE, BROKEN, DONE = range(4)

#: rows that are no contact quantity: whether the tool touches, and a plain yes
FLAG, YES = -1, -2


class Contact(NamedTuple):
    """Views of a store's parts; it has all that `chain.contact_block` asks of a frame."""

    head: Array
    columns: Array
    prismatic: Array
    turns: Array  # (N + 1, 9)
    shifts: Array  # (N + 1, 3)
    tip: Array
    reader: Array
    tool: Array
    plane: Array
    compliance: Array
    motion: Array  # position, velocity, acceleration, (3, N)
    passed: Array  # velocities behind one low-pass, accelerations behind two and three, (3, N)
    quantities: Array
    late_motion: Array  # as `motion`, of the sample that estimators are given
    late: Array  # its quantities
    late_sheet: Array  # what the sheet remembers of the one before it
    scratch: Array
    window: Array
    sheet: Array  # empty on a plane


def carve(store: Array) -> Contact:
    """The parts of a store."""
    n = int(store[JOINTS])
    joints, rest = store[6:], store[6 + 14 * n + 12 :]
    turns, shifts, motion = joints[2 * n :], joints[11 * n + 9 :], rest[82:]
    quantities = motion[6 * n :]
    late = quantities[QUANTITIES:]
    scratch = late[3 * n + QUANTITIES + on_mesh.HEAD :]
    size = (3 * n + 36) * chain.BLOCK
    end = size + past.FIXED + past.EACH * n
    return Contact(
        store[:6],
        joints[:n],
        joints[n : 2 * n],
        turns[: 9 * (n + 1)].reshape(n + 1, 9),
        shifts[: 3 * (n + 1)].reshape(n + 1, 3),
        rest[:3],
        rest[3:45],
        rest[45:61],
        rest[61:73],
        rest[73:82],
        motion[: 3 * n].reshape(3, n),
        motion[3 * n : 6 * n].reshape(3, n),
        quantities[:QUANTITIES],
        late[: 3 * n].reshape(3, n),
        late[3 * n : 3 * n + QUANTITIES],
        late[3 * n + QUANTITIES : 3 * n + QUANTITIES + on_mesh.HEAD],
        scratch[:size],
        scratch[size:end],
        scratch[end:],
    )


def build(
    columns: NDArray[np.int64],
    prismatic: NDArray[np.bool_],
    turns: Array,
    shifts: Array,
    tip: Array,
    reader: Array,
    tool: Array,
    plane: Array,
    compliance: Array,
    cutoff: float,
    touching: float,
    sheet: Array,
) -> Array:
    """A store at rest that has seen no sample; arguments as the parts. On a mesh the plane is `BASE_FRAME`."""
    n = len(columns)
    bends, cleans = chain.needed.py_func(reader, compliance)  # type: ignore[attr-defined]
    head = (-math.inf, cutoff, touching, float(bends), float(cleans), float(n))
    room = np.zeros(9 * n + 2 * QUANTITIES + on_mesh.HEAD + (3 * n + 36) * chain.BLOCK + past.FIXED + past.EACH * n)
    parts = (head, columns, prismatic, turns, shifts, tip, reader, tool, plane, compliance, room, sheet)
    return np.concatenate([np.asarray(part, dtype=np.float64).ravel() for part in parts])


_carve = njit(forceinline=True)(carve)


@njit(error_model="numpy", forceinline=True)
def advance(
    t: float, q: Array, dq: Array, ddq: Array, head: Array, columns: Array, motion: Array, passed: Array
) -> None:
    """Take in one sample of joint positions; arguments as `take`.

    Velocities that aren't given are differences through a first-order low-pass, accelerations differences of these
    through a second and a third. What each low-pass is late by, the next derivative takes away, so that what
    accelerates evenly, or with an even jerk, is followed without a lag. The first sample starts at rest.
    """
    dt = t - head[TIME]
    first = dt == np.inf
    gain = 0.0 if first else head[CUTOFF] * dt / (1.0 + head[CUTOFF] * dt)
    if first:
        passed[:] = 0.0
    for j in range(columns.shape[0]):
        i = int(columns[j])
        before = passed[0, j]
        if len(dq) > 0:
            passed[0, j] = dq[i]
        elif not first:
            passed[0, j] += gain * ((q[i] - motion[0, j]) / dt - before)
        if not first:
            passed[1, j] += gain * ((passed[0, j] - before) / dt - passed[1, j])
            passed[2, j] += gain * (passed[1, j] - passed[2, j])
        # lags of the velocity: that of its low-pass, and half a period of the difference
        lag = 0.0 if first or len(dq) > 0 else 1.0 / head[CUTOFF] + 0.5 * dt
        jerk = head[CUTOFF] * (passed[1, j] - passed[2, j])
        motion[1, j] = passed[0, j] + lag * passed[1, j]
        motion[2, j] = ddq[i] if len(ddq) > 0 else passed[2, j] + (2.0 / head[CUTOFF] + lag) * jerk
        motion[0, j] = q[i]
    head[TIME] = t


@njit(error_model="numpy", forceinline=True)
def take(t: float, q: Array, wrench: Array, dq: Array, ddq: Array, store: Array) -> int:
    """One raw sample into the contact frame; says what became of it.

    Args:
        t: time [s].
        q: positions, (N,), in the log's order; dq, ddq their derivatives, or of length 0.
        wrench: fx fy fz tx ty tz in sensor axes [N, N·m].
        store: of the contact. After a sample whose motion isn't finite its motion and time are as before it.
    """
    room = _carve(store)
    n = len(room.columns)
    if len(q) != n or len(wrench) != 6 or len(dq) not in (0, n) or len(ddq) not in (0, n):
        return MISSHAPEN
    if not (room.head[TIME] < t < np.inf):
        return LATE
    fine = True
    for j in range(n):
        fine &= abs(q[j]) < FAR
    for j in range(len(dq)):
        fine &= abs(dq[j]) < np.inf
    for j in range(len(ddq)):
        fine &= abs(ddq[j]) < np.inf
    if not fine:
        room.quantities[:] = np.nan
        room.window[past.PENDING] = BROKEN
        return NOT_FINITE
    first = room.head[TIME] == -np.inf
    advance(t, q, dq, ddq, room.head, room.columns, room.motion, room.passed)
    if first and len(room.sheet) > 0:
        room.sheet[on_mesh.SEEN] = 0.0
    _into_frame(room, room.motion, wrench, room.quantities)
    if first:
        past.clear(room.window)
        for i in range(on_mesh.HEAD if len(room.sheet) > 0 else 0):
            room.late_sheet[i] = room.sheet[i]
    known = abs(room.quantities[chain.NORMAL]) < np.inf
    room.window[past.PENDING] = DUE if known else BROKEN
    if len(dq) == 0 or len(ddq) == 0:
        past.push(t, q, dq, wrench, room.columns, room.window)
    else:
        past.clear(room.window)
        room.window[past.PENDING] = AT_ONCE if known else BROKEN
    return FINE


@njit(error_model="numpy", forceinline=True)
def _into_frame(room: Compiled, motion: Array, wrench: Array, out: Array) -> None:
    """Contact quantities, (9,), of a motion (3, N) and a wrench (6,)."""
    n, block = len(room.columns), chain.BLOCK
    end_x, end_w = 3 * n * block, (3 * n + 24) * block
    x, w = room.scratch[:end_x], room.scratch[end_x:end_w]
    f, o = room.scratch[end_w : end_w + 6 * block], room.scratch[end_w + 6 * block :]
    for k in range(3):
        for j in range(n):
            x[(k * n + j) * block] = motion[k, j]
    for i in range(6):
        f[i * block] = wrench[i]
    bends, cleans = room.head[BENDS] > 0.0, room.head[CLEANS] > 0.0
    scratch = chain.Scratch(x, w, f, o)
    chain.contact_block(0, 1, True, bends, cleans, scratch, room, QUANTITIES, out.reshape(QUANTITIES, 1))
    if len(room.sheet) > 0:
        on_mesh.onto_mesh(room.sheet, out)


@njit(error_model="numpy", forceinline=True)
def next_late(room: Contact) -> bool:
    """Work out the next sample that an estimator is to be given, into `late` and the window's `AT`; False for none.

    To be called after `take` until there is none. The time is NaN for a sample that isn't finite: nothing of it may
    be learnt, and those before it are still to come.
    """
    window, pending = room.window, room.window[past.PENDING]
    if pending in (AT_ONCE, BROKEN):
        window[past.PENDING] = DONE
        at_once = pending == AT_ONCE
        for i in range(QUANTITIES):
            room.late[i] = room.quantities[i] if at_once else np.nan
        window[past.AT] = room.head[TIME] if at_once else np.nan
        return True
    if pending == DONE:
        return False
    n = len(room.columns)
    samples = past.parts(window, n)
    k = past.due(window, n)
    while k >= 0:
        past.move_to(k, window, n, room.late_motion)
        _swap_sheet(room)
        _into_frame(room, room.late_motion, samples.wrench[:, k], room.late)
        _swap_sheet(room)
        window[past.AT] = samples.times[k]
        if abs(room.late[chain.NORMAL]) < np.inf:
            return True
        k = past.due(window, n)  # of a wrench that isn't finite was told as it came
    return False


@njit(error_model="numpy", forceinline=True)
def _swap_sheet(room: Contact) -> None:
    """A mesh remembers the sample before: the present one's, or that of those which estimators are given."""
    if len(room.sheet) > 0:
        for i in range(on_mesh.HEAD):
            room.sheet[i], room.late_sheet[i] = room.late_sheet[i], room.sheet[i]


@njit(error_model="numpy", forceinline=True)
def hand_over(room: Contact, rows: NDArray[np.int64], inputs: Array) -> None:
    """The quantities of the sample of `next_late` that an estimator asked for, or flags, into its inputs."""
    for i in range(len(rows)):
        if rows[i] == FLAG:
            inputs[i] = room.late[chain.NORMAL] > room.head[TOUCHING]
        elif rows[i] == YES:
            inputs[i] = 1.0
        else:
            inputs[i] = room.late[rows[i]]


@njit(error_model="numpy", forceinline=True)
def late_time(room: Contact) -> float:
    """Time of the sample of `next_late` [s]; NaN where it isn't finite."""
    return float(room.window[past.AT])


# --- what Python calls

#: positions and the like may be read-only, or columns of a table
_GIVEN = types.Array(float64, 1, "A", readonly=True)
_RAW = (float64, _GIVEN, _GIVEN, _GIVEN, _GIVEN, float64[::1])

#: names the cache of compiled code, which on its own would miss a change in what is inlined
_SOURCES = stamp(sys.modules[__name__], chain, mesh, on_mesh, past)


def _step(t: float, q: Array, wrench: Array, dq: Array, ddq: Array, store: Array) -> int:
    code: int = take(t, q, wrench, dq, ddq, store)
    return code


def _step_and_learn(
    t: float,
    q: Array,
    wrench: Array,
    dq: Array,
    ddq: Array,
    store: Array,
    rows: NDArray[np.int64],
    start: int,
    shape: tuple[float, ...],
    memory: Array,
) -> int:
    code: int = take(t, q, wrench, dq, ddq, store)
    room = _carve(store)
    while code <= NOT_FINITE and next_late(room):
        hand_over(room, rows, memory[start:])
        once(late_time(room), shape, memory)  # type: ignore[name-defined]  # noqa: F821
    return code


def _next(store: Array) -> bool:
    more: bool = next_late(_carve(store))
    return more


def compile_step() -> Callable[..., int]:
    """`take` as one compiled call."""
    return _compiled(_step, "step", _RAW)


def compile_next() -> Callable[..., bool]:
    """`next_late` as one compiled call."""
    return _compiled(_next, "next", (float64[::1],))


def compile_step_and_learn(once: Callable[..., object], parameters: int) -> Callable[..., int]:
    """`take` and an estimator's kernel of one sample as one compiled call.

    Args:
        once: that kernel: time, shape, store, as `kinid.estimators` has them.
        parameters: of the estimator.

    Returns:
        A function of the arguments of `take`, then the rows of the quantities that the estimator takes (`FLAG`, `YES`),
        the place of its inputs in its store, its shape and its store.
    """
    # a kernel is a constant of the compiled code, so that LLVM can inline it. A closure would hold it too, but closures
    # over kernels are compiled anew in each process
    name = f"step_and_learn_{once.py_func.__qualname__}"  # type: ignore[attr-defined]
    function = FunctionType(_step_and_learn.__code__, {**globals(), "once": once}, name)
    extra = (types.Array(int64, 1, "C"), int64, types.UniTuple(float64, parameters), float64[::1])
    return _compiled(function, name, (*_RAW, *extra))


def _compiled(function: Callable[..., Any], name: str, signature: tuple[types.Type, ...]) -> Callable[..., Any]:
    """Compiled now, and for no other types: a loop mustn't wait for a compiler because somebody passed another
    array.
    """
    function.__qualname__ = f"{name}_{_SOURCES}"
    # _nrt=False: the compiler refuses code that allocates. The global lock is kept: to get it back may take
    # milliseconds
    compiled = njit(error_model="numpy", cache=True, _nrt=False)(function)
    compiled.compile(signature)
    compiled.disable_compile()
    return compiled  # type: ignore[no-any-return]
