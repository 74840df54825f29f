"""What effects see and change: the measured motion, and the quantities of the chain that grow from it."""

from __future__ import annotations

import copy
import dataclasses
import itertools
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from kinid.kernels.memory import ELASTIC

Array = NDArray[np.float64]

#: readings of a force/torque sensor, contact-frame quantities, or joint torques
Kind = Literal["wrench", "contact", "joints"]

#: length of the bristles by which friction turns around, unless an effect states another [m]
BRISTLE = 1e-4
#: over longer gaps another measurement may have begun [s]
REMEMBERED = 10.0


@dataclass(frozen=True)
class Layout:
    """Which channels a log has, so that effects know how many parameters they have.

    Attributes:
        channels: names of the readings: fx…tz of a wrench, normal_force and tangential_force1/2 of a contact frame, or
            tau of each joint.
        kind: what they are readings of.
        joints: joint names, for `kind` "joints".
    """

    channels: tuple[str, ...]
    kind: Kind
    joints: tuple[str, ...] = ()

    @property
    def units(self) -> tuple[str, ...]:
        """Unit of each channel."""
        return tuple(
            "N·m" if (name.startswith("t") and len(name) == 2) or name.startswith("tau") else "N"
            for name in self.channels
        )


@dataclass(frozen=True, eq=False)
class SensorMotion:
    """Motion of the force/torque sensor, in its own axes; what tool and sensor effects need.

    Attributes:
        to_contact: rotation from sensor axes to contact axes (tangent1, tangent2, normal), (n, 3, 3).
        tip: position of the tip in the sensor frame [m], (3,).
        specific: gravity less acceleration of the sensor's origin, g − a [m/s²], (3, n).
        omega, alpha: angular velocity [rad/s] and acceleration [rad/s²], (3, n).
        load: wrench of the rig's tool (weight and inertia) [N, N·m], (6, n); zero without a tool in the rig.
        mass: mass of the rig's tool [kg]; com: its centre [m], (3,). moments: of inertia about the sensor's axes, as
            the rig states them [kg·m²], (3,); 0 where it states none.
    """

    to_contact: Array
    tip: Array
    specific: Array
    omega: Array
    alpha: Array
    load: Array
    mass: float
    com: Array
    moments: Array = field(default_factory=lambda: np.zeros(3))


@dataclass(frozen=True, eq=False)
class AsRead:
    """What the rig states of a sensor's faults, which are taken out of readings: raw = crosstalk · true + bias.

    Converters act on raw readings: a range and a lattice show there alone.

    Attributes:
        crosstalk, inverse: (6, 6). bias: (6,) [N, N·m].
    """

    crosstalk: Array
    inverse: Array
    bias: Array

    @classmethod
    def stated(cls, inverse: Array, bias: Array) -> AsRead | None:
        """What was taken out of readings, None where nothing was."""
        if np.array_equal(inverse, np.eye(len(inverse))) and not bias.any():
            return None
        return cls(np.asarray(np.linalg.inv(inverse), dtype=np.float64), inverse, bias)

    def raw(self, readings: Array) -> Array:
        """As the converter gave them, (6, n)."""
        out: Array = self.crosstalk @ readings + self.bias[:, None]
        return out

    def true(self, raw: Array) -> Array:
        """Without the faults, (6, n)."""
        out: Array = self.inverse @ (raw - self.bias[:, None])
        return out


@dataclass(frozen=True, eq=False)
class JointMotion:
    """Motion of the joints, for joint torques; arrays (N, n).

    Attributes:
        q, dq, ddq: positions, velocities, accelerations.
        rigid: torque of rigid-body inverse dynamics; zero for an axis without a robot.
        known: whether `rigid` comes from a robot; if not, the inertia is a parameter.
        payload: torques per unit of a payload's parameters m, m·com (3) at the last link [N·m per unit], (4, N, n), or
            None.
        tool: mass [kg] and first moment about the payload's frame [kg·m] of the tool that the rig states; zeros without
            one.
        gravity: torques per unit of gravity along the axes of the base [N·m per m/s²], (3, N, n), or None.
        moments: torques at rest per unit of each link's first moment, of positions (n, N) [N·m per kg·m], (3 N, N, n),
            or None.
        slopes: change of the torques of a motion q, q̇, q̈ (n, N) per radian of each joint [N·m/rad], per rad/s and per
            rad/s², (3, N, N, n), or None.
    """

    q: Array
    dq: Array
    ddq: Array
    rigid: Array
    known: bool
    payload: Array | None = None
    gravity: Array | None = None
    tool: tuple[float, float] = (0.0, 0.0)
    moments: Callable[[Array], Array] | None = None
    slopes: Callable[[Array, Array, Array], Array] | None = None


@dataclass(frozen=True, eq=False)
class Recall:
    """Memory of S parts of the path of a law N = … + A z, to first order: dz = K dz₋ + a dv₋ + b dv + d dx, v the rate
    of x.

    Attributes:
        keep: K, (n, S, S). before, now: a and b, reach: d, size: A, each (n, S); see `kinid.kernels.recall`.
    """

    keep: Array
    before: Array
    now: Array
    reach: Array
    size: Array

    @classmethod
    def blank(cls, n: int, parts: int) -> Recall:
        """Of so many samples, to write into."""
        return cls(np.zeros((n, parts, parts)), *np.zeros((4, n, parts)))

    @property
    def parts(self) -> tuple[Array, Array, Array, Array, Array]:
        """K, a, b, d, A."""
        return self.keep, self.before, self.now, self.reach, self.size

    @classmethod
    def joined(cls, n: int, several: Sequence[Recall]) -> Recall:
        """All of them, which know nothing of each other."""
        if len(several) == 1:
            return several[0]
        ends = np.cumsum([0, *(one.size.shape[1] for one in several)])
        out = cls.blank(n, int(ends[-1]))
        for one, begin, end in zip(several, ends[:-1], ends[1:]):
            out.keep[:, begin:end, begin:end] = one.keep
            for name in ("before", "now", "reach", "size"):
                getattr(out, name)[:, begin:end] = getattr(one, name)
        return out


@dataclass(frozen=True, eq=False)
class Agreement:
    """What a law and an arm that gives way agreed on, all (n,).

    Attributes:
        force: N [N]. slope, loss: of the law over depth [N/m] and over its rate [N·s/m].
        share: of its depth that a tool keeps which a search wants to leave the material.
        kinks: where slopes are those: whether a sample is inside. memory: what the law remembers of its path there.
    """

    force: Array
    slope: Array
    loss: Array
    share: Array
    kinks: NDArray[np.bool_]
    memory: Recall

    @classmethod
    def none(cls, n: int) -> Agreement:
        """Of so many samples: no force, and nothing known."""
        nothing = np.zeros(n)
        return cls(nothing, nothing, nothing, np.full(n, 0.1), nothing > 0.0, Recall.blank(n, 0))


@dataclass(frozen=True)
class RestForm:
    """How dry friction behaves at rest, of which motion tells little, and how torques were filtered: no effect's
    parameters, a form that a fit chooses.

    Attributes:
        share: of the bristles' length over which they are elastic. length: of a contact's bristles, unless an effect
            has one [m].
        speed: above which a contact's friction is full [m/s], in place of such bristles; 0 for bristles.
        joint: length of the bristles of a joint's friction, in stated ones (`effects._axes.BRISTLE`).
        joint_speed: above which a joint's friction is full [rad/s, m/s], in place of bristles; 0 for bristles.
        kept: whether a contact's bristles stay bent, and turn, where the tool is outside, as of a tip that something
            sticks to.
        tremor: mean speed of a contact's motion that is too fast to be seen, under which bent bristles creep back
            [m/s].
        anew: whether a material remembers nothing of the touch before, as where each touch is at a place of its own.
        smoothing: standard deviation of what torques were smoothed with afterwards, forwards and backwards [s]; 0 for
            none.
        lag: time constant of the low-pass that a drive's torques come through [s]; 0 for none.
    """

    share: float = ELASTIC
    length: float = BRISTLE
    speed: float = 0.0
    joint: float = 1.0
    joint_speed: float = 0.0
    kept: bool = False
    tremor: float = 0.0
    anew: bool = False
    smoothing: float = 0.0
    lag: float = 0.0


@dataclass(eq=False)
class Signals:
    """The chain's quantities for one prediction. Inputs are shared and read-only; effects replace, never write into.

    Attributes:
        layout: the channels of `reading`.
        t: time from the first sample [s], (n,).
        dt: time since the sample before [s], (n,); 0 where memory begins anew (first sample, after a gap).
        depth [m], depth_rate [m/s]: (n,). slip [m], slip_rate [m/s]: (2, n).
        rest: form of dry friction at rest.
        measured: measured readings, (channels, n); no law is driven by them but springs of joints, which they wind up.
        compliance: of the arm along the normal, which the contact law is behind [m/N].
        elastic: elastic force F_e [N], (n,). exponent: of its power law. normal: N [N], (n,). pull: of bonds, which
            is in N already [N], (n,). pressing: share of it that presses rubbing surfaces together.
        recalls: how laws that remember the path behind them do, for those that look through a compliance.
        agreed: behind a compliance: on the way, what was agreed on beside this prediction, None for nothing; in the
            end, here.
        beside: whether only what changes from there is asked for, and to a share of that.
        touch: behind a compliance, a depth of the same sign, which more predictions share if there is one (n,).
        mu: friction coefficient, (2, n) along the tangents. tangential: (2, n) [N].
        bristle: length over which friction turns around [m]. rounding: in place of that a speed above which it is full
            [m/s], 0 for bristles.
        reading: what the sensor delivers, (channels, n).
        sensor: motion of the sensor, for wrenches. joints: motion of the joints, for joint torques.
        as_read: the sensor's stated faults, None where `reading` is what the converter gives.
        surface_sd: standard deviations that the rig states of its surface, along the normal [m] and of the tilt [rad];
            0 where it states none. gain_sd: the same of the sensor's gain.
    """

    layout: Layout
    t: Array
    dt: Array
    depth: Array
    depth_rate: Array
    slip: Array
    slip_rate: Array
    rest: RestForm = RestForm()
    measured: Array | None = None
    sensor: SensorMotion | None = None
    joints: JointMotion | None = None
    as_read: AsRead | None = None
    surface_sd: tuple[float, float] = (0.0, 0.0)
    gain_sd: float = 0.0
    compliance: float = 0.0
    elastic: Array = dataclasses.field(default_factory=lambda: np.zeros(0))
    exponent: float = 1.0
    normal: Array = dataclasses.field(default_factory=lambda: np.zeros(0))
    pull: Array = dataclasses.field(default_factory=lambda: np.zeros(0))
    pressing: float = 1.0
    recalls: tuple[Callable[[], Recall], ...] = ()
    agreed: Agreement | None = None
    beside: bool = False
    touch: Array | None = None
    mu: Array = dataclasses.field(default_factory=lambda: np.zeros((2, 0)))
    bristle: float = BRISTLE
    rounding: float = 0.0
    tangential: Array = dataclasses.field(default_factory=lambda: np.zeros((2, 0)))
    reading: Array = dataclasses.field(default_factory=lambda: np.zeros((0, 0)))

    def __len__(self) -> int:
        return len(self.t)

    def copy(self) -> Signals:
        """A copy that shares all arrays."""
        return copy.copy(self)

    def with_rest(self, rest: RestForm) -> Signals:
        """The same with another form of friction at rest; nothing that is kept of a log depends on it."""
        out = self.copy()
        out.rest = rest
        return out

    def fresh(self) -> Signals:
        """A copy to predict with: inputs shared, the chain's quantities zero."""
        none, pair, reading = self.zeros
        out = self.copy()
        out.compliance, out.exponent, out.bristle, out.rounding = 0.0, 1.0, self.rest.length, self.rest.speed
        out.pressing = 1.0
        out.recalls, out.agreed, out.touch = (), None, self.everywhere if self.rest.kept else None
        out.elastic, out.normal, out.pull, out.mu, out.tangential, out.reading = none, none, none, pair, pair, reading
        return out

    @cached_property
    def zeros(self) -> tuple[Array, Array, Array]:
        """What all predictions begin with: (n,), (2, n), and (channels, n) of torques; forces are read in the end."""
        n = len(self)
        return (
            np.zeros(n),
            np.zeros((2, n)),
            np.zeros((len(self.layout.channels), n if self.layout.kind == "joints" else 0)),
        )

    @cached_property
    def everywhere(self) -> Array:
        """A depth that is inside the material all the time [m], (n,)."""
        return np.ones(len(self))

    @cached_property
    def lasting(self) -> Array:
        """Steps of time for what a material remembers from one touch to the next: a gap of moderate length is one of
        them, on which the motion is taken to run straight [s], (n,).
        """
        gone = np.diff(self.t, prepend=self.t[:1])
        return np.where((self.dt == 0.0) & (gone <= REMEMBERED), gone, self.dt)

    @property
    def flowing(self) -> Array:
        """The same for what flows in a material: where each touch begins anew, memory does [s], (n,)."""
        if not self.rest.anew:
            return self.lasting
        return np.where(self.inside & ~np.r_[False, self.inside[:-1]], 0.0, self.lasting)

    @property
    def runs(self) -> list[slice]:
        """The samples between two gaps, each piece by itself; memory begins anew in each."""
        edges = [*np.flatnonzero(self.dt == 0.0).tolist(), len(self)]
        return [slice(begin, end) for begin, end in itertools.pairwise(edges)]

    @property
    def inside(self) -> NDArray[np.bool_]:
        """Whether the tip is in the material, (n,)."""
        return np.asarray(self.depth > 0.0)

    @property
    def load(self) -> Array:
        """What presses the rubbing surfaces together: N, and as much of a bond's pull as does so [N], (n,).

        The rest of the pull takes off no more than there is: surfaces that nothing presses together don't rub.
        """
        whole = self.normal + self.pull
        if self.pressing == 1.0:
            return whole
        return whole - np.minimum((1.0 - self.pressing) * self.pull, np.maximum(whole, 0.0))

    @property
    def penetration(self) -> Array:
        """Depth where it is positive, else zero [m], (n,)."""
        return np.maximum(self.depth, 0.0)
