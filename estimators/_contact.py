"""What all estimators of a contact law share: a sample is depth, depth rate, normal force, and whether there is
contact.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable

import numpy as np
from numpy.typing import ArrayLike

from kinid.errors import InputError
from kinid.estimators._machine import UNKNOWN_TIME, Columns, Machine, Online, Out, vectors
from kinid.estimators.estimate import Array, Mask, Track

#: shapes of depth, depth rate, normal force and the flag of contact, for a `Machine`
COLUMNS: tuple[tuple[int, ...], ...] = ((), (), (), ())


class ContactEstimator(ABC):
    """Settings of an estimator that learns a contact law, from a log or sample by sample."""

    def run(
        self,
        depth: Array,
        depth_rate: Array,
        normal_force: Array,
        t: Array | None = None,
        in_contact: Mask | None = None,
    ) -> Track:
        """All samples of a log; `conditions` of the track say where approximations hold, if the estimator rests on any.

        Args:
            depth: [m], (n,), positive inside the material.
            depth_rate: [m/s], (n,).
            normal_force: [N], (n,).
            t: time [s], (n,); needed where forgetting is scheduled or parameters walk.
            in_contact: samples that may be used, (n,); by default all.

        Raises:
            InputError: shapes that don't fit, no samples, time that doesn't grow.
        """
        time, columns = contact_columns(t, depth, depth_rate, normal_force, in_contact)
        return self._machine().run(columns, time)

    def online(self) -> Online:
        """`update(depth, depth_rate, normal_force, [in_contact,] t=…)` → `Estimate`."""
        return Online(self._machine())

    @abstractmethod
    def _machine(self) -> Machine:
        """Fresh memory."""


class ContactMachine(Machine):
    """A machine whose kernels take contacts. Columns: depth, depth rate, force, contact.

    Its two kernels, one for logs and one for a single sample, come late: loading them loads the compiler.
    """

    @property
    @abstractmethod
    def kernels(self) -> tuple[Callable[..., None], Callable[..., None]]:
        """The kernel for logs, and that of one sample."""

    def advance(self, columns: Columns, t: Array | None, out: Out) -> None:
        """See `Machine`."""
        room = self.room
        self.kernels[0](
            self.shape,
            room.state,
            *columns,
            self.forgetting.factors(t),
            UNKNOWN_TIME if t is None else t,
            room.settings,
            room.limit,
            room.window,
            room.length,
            room.threshold,
            room.scratch,
            out,
        )

    @property
    def once(self) -> Callable[..., None]:
        """See `Machine`."""
        return self.kernels[1]


def contact_columns(
    t: ArrayLike | None, depth: ArrayLike, depth_rate: ArrayLike, normal_force: ArrayLike, in_contact: ArrayLike | None
) -> tuple[Array | None, Columns]:
    """Checked contact quantities, each (n,), with the mask of contact as the last column; errors as `vectors`."""
    columns = {"depth": depth, "depth_rate": depth_rate, "normal_force": normal_force}
    time, arrays = vectors(t, **columns)
    contact = np.ones(len(arrays[0]), np.bool_) if in_contact is None else np.ascontiguousarray(in_contact, np.bool_)
    if any(array.ndim != 1 for array in arrays) or contact.shape != arrays[0].shape:
        shapes = ", ".join(f"{name} {np.shape(value)}" for name, value in columns.items())
        raise InputError(f"{shapes}, in_contact {contact.shape}", "(n,) each", "give one number a sample")
    return time, (*arrays, contact)
