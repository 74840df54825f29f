"""From messages to a `Log`: topics chosen, joints put in order by name, streams brought onto one clock."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from kinid.data.log import Array, Log, Provenance, Step
from kinid.data.readers._joints import Names, arrange
from kinid.data.rig import WRENCH, Rig
from kinid.data.streams import Merged, Stream, merge
from kinid.errors import InputError, near

#: what a message type means here, by the last part of its name
KINDS: dict[str, str] = {
    "JointState": "joints",
    "JointStates": "joints",
    "WrenchStamped": "wrench",
    "String": "text",
    "Event": "event",
}
#: what a library makes of a message: its fields as attributes, by names that differ from one encoding to another
Message = Any
_FIELDS = ("position", "velocity", "effort")
#: a topic of text with this name tells the protocol's phase
_PHASE = "phase"


@dataclass(frozen=True)
class Topic:
    """A topic of a bag: its name, message type, `joints`, `wrench`, `text`, `event` or None, and number of messages."""

    name: str
    type: str
    kind: str | None
    count: int


class Bag(Protocol):
    """What a format gives: its topics, and messages with the fields of JointState and WrenchStamped."""

    @property
    def source(self) -> str:
        """Path, for messages."""

    @property
    def topics(self) -> Sequence[Topic]:
        """All topics."""

    def messages(self, names: Sequence[str]) -> Iterator[tuple[str, int, Message]]:
        """Topic, time of reception [ns] and message."""


#: a phase that begins so shortly after a sample began with it [s]
_JITTER = 1e-4
#: messages that seem to travel longer than this [ns] carry the stamps of another clock
LONGEST_DELAY = 1_000_000_000


@dataclass
class _Samples:
    """Messages of one source as they come: one row of numbers each, or a word."""

    received: list[int] = field(default_factory=list)
    stamped: list[int] = field(default_factory=list)
    rows: list[ArrayLike] = field(default_factory=list)

    def clock(self) -> tuple[list[int], str]:
        """Stamps [ns] and whose they are: the header's, unless it was left at zero or never moves."""
        if all(self.stamped) and (len(self.stamped) == 1 or len(set(self.stamped)) > 1):
            return self.stamped, "header"
        return self.received, "reception"


@dataclass(frozen=True)
class _Part:
    """Samples of one source, and the log's quantity and its column that each of its columns is."""

    name: str
    samples: _Samples
    values: Array  # (n, k)
    targets: tuple[tuple[str, int], ...]  # (k,)


def to_log(bag: Bag, rig: Rig, joints: Sequence[str] | None) -> Log:
    """Read the joint and wrench topics of a bag.

    Args:
        bag: an open recording.
        rig: [streams] chooses topics, the reference clock and the wrench's clock offset; [columns] may give
            units, scales and offsets of q, dq, tau, q_cmd and wrench.
        joints: names of q1..qN; None: those of the source with the most joints, in its order.

    Raises:
        InputError: no topic or several candidates, joints that are missing, streams that share no time.
    """
    topics = topics_of(bag, rig)
    samples = _collect(bag, topics)
    facts: dict[str, object] = {"format": "bag", "topics": topics}
    parts: list[_Part] = []
    if "joints" in topics:
        names, found = _joint_parts("joints", ("q", "dq", "tau"), samples["joints"], joints, bag.source, facts)
        parts, joints = found, joints or names
    if "joint_commands" in topics:
        commands = samples["joint_commands"]
        parts += _joint_parts("joint_commands", ("q_cmd",), commands, joints, bag.source, facts)[1]
    if "wrench" in topics:
        wrench = samples["wrench"][()]
        targets = tuple(("wrench", i) for i in range(len(WRENCH)))
        parts.insert(0, _Part("wrench", wrench, np.array(wrench.rows, dtype=np.float64), targets))
    for part in parts:
        if not np.isfinite(part.values).any():
            what = f"messages without any value for {part.name} in {bag.source}"
            raise InputError(what, "positions or forces", "record a topic that has them")
    clocks = {part.name: part.samples.clock() for part in parts}
    delay = _reception_delay(parts, clocks)
    if delay is not None:
        # one clock for all: what came without stamps was sent about as long before it was received as the others were
        clocks = {
            name: ([s - delay for s in stamps], whose) if whose == "reception" else (stamps, whose)
            for name, (stamps, whose) in clocks.items()
        }
        facts["reception_delay_removed_s"] = delay * 1e-9
    origin = min(min(stamps) for stamps, _ in clocks.values())
    facts |= {"clocks": {name: whose for name, (_, whose) in clocks.items()}, "time_origin": origin * 1e-9}
    streams = [_stream(part, clocks[part.name][0], origin) for part in parts]
    merged = _merge(streams, rig, bag.source)
    phase = _phase(samples["phase"][()], parts, clocks, origin, merged.t) if "phase" in topics else None
    return _log(parts, merged, rig, bag.source, facts, phase)


def _reception_delay(parts: Sequence[_Part], clocks: dict[str, tuple[list[int], str]]) -> int | None:
    """How long after their stamps messages were received [ns], the median; None where all streams keep one clock."""
    if len({whose for _, whose in clocks.values()}) < 2:
        return None
    waits = [
        np.array(part.samples.received) - np.array(part.samples.stamped)
        for part in parts
        if clocks[part.name][1] == "header"
    ]
    delay = int(np.median(np.concatenate(waits)))
    return delay if 0 <= delay < LONGEST_DELAY else None  # anything else is another epoch, not a delay


def _phase(
    words: _Samples, parts: Sequence[_Part], clocks: Mapping[str, tuple[list[int], str]], origin: int, t: Array
) -> NDArray[np.str_]:
    """The word that held at each time, (len(t),): from its message on, empty before the first.

    Text has no stamps: it came as long after it was sent as the others did.
    """
    waits = [np.array(part.samples.received) - np.array(clocks[part.name][0]) for part in parts]
    delay = int(np.median(np.concatenate(waits)))
    sent = np.array(words.received) - origin - (delay if 0 <= delay < LONGEST_DELAY else 0)
    order = np.argsort(sent, kind="stable")
    # a stamp and a time of reception that are meant to be one differ by their jitter
    last = np.searchsorted(1e-9 * sent[order], t + _JITTER, side="right")
    return np.array(["", *(str(words.rows[i]) for i in order)])[last]


def _stream(part: _Part, stamps: Sequence[int], origin: int) -> Stream:
    t = np.array([stamp - origin for stamp in stamps], dtype=np.float64) * 1e-9
    return Stream(part.name, t, part.values, tuple(f"{q}{i + 1}" for q, i in part.targets))


def in_si(rig: Rig, quantity: str) -> tuple[float, float]:
    """Factor and offset that a rig gives for a quantity of messages, which have no columns."""
    spec = rig.columns.get(quantity)
    if spec is None or spec.column is not None or spec.columns is not None:
        return 1.0, 0.0
    return spec.to_si, spec.offset


def _merge(streams: Sequence[Stream], rig: Rig, source: str) -> Merged:
    """All streams on the clock that the rig names, the wrench's by default."""
    wanted = rig.streams.reference
    reference = next((s for s in streams if s.name.split(" ")[0] == wanted), None) if wanted else streams[0]
    if reference is None:
        there = " or ".join(s.name for s in streams)
        found = f"no {wanted} in {source} for the reference clock"
        raise InputError(found, there, "correct [streams] reference of the rig")
    offset = rig.streams.wrench_clock_offset
    offsets = {"wrench": offset} if offset else None
    others = [s for s in streams if s is not reference]
    return merge(reference, others, max_gap=rig.streams.max_gap, offsets=offsets)


def _log(
    parts: Sequence[_Part],
    merged: Merged,
    rig: Rig,
    source: str,
    facts: dict[str, object],
    phase: NDArray[np.str_] | None,
) -> Log:
    """The log's arrays from the streams' columns."""
    fields: dict[str, Array] = {}
    width: dict[str, int] = {}
    for part in parts:
        for quantity, index in part.targets:
            width[quantity] = max(width.get(quantity, 0), index + 1)
    for part in parts:
        for column, (quantity, index) in enumerate(part.targets):
            array = fields.setdefault(quantity, np.full((len(merged.t), width[quantity]), np.nan))
            array[:, index] = merged.values[part.name][:, column]
    # a driver without velocities or efforts leaves them out of every message
    fields = {q: v for q, v in fields.items() if np.isfinite(v).any()}
    scales = {}
    for quantity in fields:
        scale, offset = in_si(rig, quantity)
        if (scale, offset) != (1.0, 0.0):
            scales[quantity] = scale
            fields[quantity] = fields[quantity] * scale + offset
    facts |= {"to_si": scales} if scales else {}
    slower = merged.interpolated.get("joints", 0.0)
    log = Log(merged.t, phase=phase, provenance=Provenance(source), joint_period=slower, **fields)  # type: ignore[arg-type]
    facts |= {"rows": len(merged.t), "invalid_rows": int((~log.valid).sum())}
    return dataclasses.replace(log, provenance=Provenance(source, (Step("read", facts), *merged.steps)))


# ---------------------------------------------------------------------------------------- topics and messages


def topics_of(bag: Bag, rig: Rig) -> dict[str, str]:
    """Topic by role: wrench, joints, joint_commands, phase."""
    streams = rig.streams
    chosen: dict[str, str] = {}
    if streams.joint_commands is not None:
        chosen["joint_commands"] = _named(bag, streams.joint_commands, "joint_commands", "joints")
    for role, name in (("joints", streams.joints), ("wrench", streams.wrench)):
        if name is not None:
            chosen[role] = _named(bag, name, role, role)
            continue
        candidates = [t for t in bag.topics if t.kind == role and t.count and t.name not in chosen.values()]
        if len(candidates) > 1:
            shown = ", ".join(f"{t.name} ({t.count} messages)" for t in candidates)
            raise InputError(
                f"several topics for the {role} in {bag.source}: {shown}",
                "one topic",
                f'choose: [streams] {role} = "{candidates[0].name}" in the rig',
            )
        if candidates:
            chosen[role] = candidates[0].name
    if not chosen:
        shown = ", ".join(f"{t.name} ({t.type})" for t in bag.topics[:12]) or "no messages"
        raise InputError(
            f"{shown} in {bag.source}",
            "sensor_msgs/JointState or geometry_msgs/WrenchStamped",
            "record a topic of one of these types",
        )
    words = [t.name for t in bag.topics if t.kind == "text" and t.count and t.name.rsplit("/", 1)[-1] == _PHASE]
    return chosen | ({"phase": words[0]} if len(words) == 1 else {})


def _named(bag: Bag, name: str, role: str, kind: str) -> str:
    """The topic that the rig names."""
    of_kind = [t.name for t in bag.topics if t.kind == kind and t.count]
    if name not in of_kind:
        there = next((t for t in bag.topics if t.name == name), None)
        what = f"topic '{name}', {there.count} messages of {there.type}," if there else f"no topic '{name}'"
        mend = near(name, of_kind) if of_kind else f"remove [streams] {role}: the bag holds none"
        message = "JointState" if kind == "joints" else "WrenchStamped"
        raise InputError(f"{what} in {bag.source}", f"a topic with {message} messages for {role}", mend)
    return name


def _collect(bag: Bag, topics: Mapping[str, str]) -> dict[str, dict[Names, _Samples]]:
    """Messages by role, and those of joints by the joints that they name."""
    roles = {name: role for role, name in topics.items()}
    samples: dict[str, dict[Names, _Samples]] = {role: {} for role in topics}
    # names as in a message -> in the order kept, and where they stand in the message
    orders: dict[Names, tuple[Names, list[int]]] = {}
    for topic, received, message in bag.messages(list(roles)):
        role = roles[topic]
        try:
            if role == "wrench":
                names: Names = ()
                row: ArrayLike = wrench_row(message)
            elif role == "phase":
                names, row = (), message.data
            else:
                found, values = joint_values(message)
                names, places = orders.setdefault(found, _order(found, samples[role]))
                row = _joint_row(values, places)
            stamp = stamp_of(message)
        except (AttributeError, TypeError, ValueError, KeyError) as error:
            raise InputError(
                f"a message on {topic} of {bag.source} that is no {role} ({error})",
                "fields as in JointState or WrenchStamped",
                "choose another topic in [streams]",
            ) from None
        of_source = samples[role].setdefault(names, _Samples())
        of_source.received.append(received)
        of_source.stamped.append(stamp)
        of_source.rows.append(row)
    for role, name in topics.items():
        if not samples[role]:
            raise InputError(f"no messages on {name} in {bag.source}", "at least one", "record that topic")
    return samples


def _order(found: Names, known: Mapping[Names, _Samples]) -> tuple[Names, list[int]]:
    """The order kept for these joints, that of the first message with them, and their places in this one."""
    kept = next((names for names in known if set(names) == set(found)), found)
    return kept, [found.index(name) for name in kept]


def wrench_row(message: Message) -> tuple[float, ...]:
    """The six numbers fx … tz of a message with a wrench or one that is a wrench."""
    wrench = message.wrench if hasattr(message, "wrench") else message
    force, torque = wrench.force, wrench.torque
    return force.x, force.y, force.z, torque.x, torque.y, torque.z


def joint_values(message: Message) -> tuple[Names, tuple[Sequence[float | None], ...]]:
    """Names, and positions, velocities and efforts, each empty where the message has none."""
    if hasattr(message, "joints"):  # one record a joint, instead of one list a quantity
        joints = message.joints
        return tuple(j.name for j in joints), tuple([getattr(j, f, None) for j in joints] for f in _FIELDS)
    return tuple(message.name), tuple(getattr(message, f, ()) for f in _FIELDS)


def _joint_row(values: Sequence[Sequence[float | None]], places: Sequence[int]) -> Array:
    """Positions, velocities, efforts in the order kept, (3, J); NaN where there is not one for each name."""
    row = np.full((len(_FIELDS), len(places)), np.nan)
    for i, value in enumerate(values):
        if len(value) == len(places):
            row[i] = np.asarray(value, dtype=np.float64)[places]
    return row


def stamp_of(message: Message) -> int:
    """Stamp of the header [ns], 0 without one."""
    header = getattr(message, "header", None)
    stamp = getattr(header, "stamp", None) if header is not None else getattr(message, "timestamp", None)
    if stamp is None:
        return 0
    fraction = stamp.nanosec if hasattr(stamp, "nanosec") else stamp.nsec  # ROS, Foxglove
    return int(stamp.sec) * 10**9 + int(fraction)


def _joint_parts(
    role: str,
    quantities: Sequence[str],
    found: Mapping[Names, _Samples],
    joints: Sequence[str] | None,
    source: str,
    facts: dict[str, object],
) -> tuple[Names, list[_Part]]:
    """Names of the joints, and one part for each set of them, the largest first; adds to `facts` what was found."""
    counts = {names: len(samples.rows) for names, samples in found.items()}
    plan = arrange(counts, joints, source)
    facts |= {role: list(plan.names), f"{role}_order": "given" if joints else "as recorded"}
    if plan.ignored:
        facts[f"{role}_ignored"] = list(plan.ignored)
    parts = []
    for number, (names, places) in enumerate(plan.sources.items()):
        rows = np.array(found[names].rows)[:, : len(quantities), list(places)]  # (n, quantities, joints)
        targets = tuple((quantity, joint) for quantity in quantities for joint in places.values())
        name = role if number == 0 else f"{role} {number + 1}"
        parts.append(_Part(name, found[names], rows.reshape(len(rows), -1), targets))
    return plan.names, parts
