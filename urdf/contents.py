"""What a URDF may hold: so many links and joints, numbers that bodies and axes can have, mimics that end somewhere."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from kinid.errors import InputError

#: more links or moving joints than any robot has make parsers run for minutes, or fall
MOST_LINKS, MOST_MOVING = 1000, 500
#: of one link [kg], of its inertia [kg·m²], and of a joint's or a body's place in its parent [m]
MOST_MASS, MOST_INERTIA, FARTHEST = 1e4, 1e6, 1e4
#: below zero, of an inertia that a program wrote [kg·m²]
ROUNDING = 1e-9
#: length of an axis, which is to be 1
SHORTEST, LONGEST = 1e-3, 1e3
#: of an inertia, by how much its largest moment may be beyond the sum of the others, as a share of that and [kg·m²]:
#: hands and cameras are often estimated worse than that, and matter to no torque
TRIANGLE, MATTERS = 1.25, 0.05
#: radius of gyration of no link of an arm [m]
WIDEST = 10.0
BODY = ("robot", "link", "inertial")
MOMENTS = ("ixx", "iyy", "izz", "ixy", "ixz", "iyz")
TYPES = ("revolute", "continuous", "prismatic", "fixed", "floating", "planar")
#: shapes, and what they are measured by
SHAPES = {"sphere": ("radius",), "cylinder": ("radius", "length"), "box": ("size",)}


@dataclass
class Contents:
    """What was seen of a URDF so far. Its methods refuse what can't be.

    Attributes:
        source: the file, for messages. links: how many. moving: joints that aren't fixed. joint: name and type of the
            one that is read. body: mass and moments of the link that is read. ends: links of the joint that is read.
            above: link → the one that it hangs on. mimics: joint → the one that it follows, with the line.
    """

    source: str
    links: int = 0
    moving: int = 0
    joint: tuple[str, str] = ("", "fixed")
    body: dict[str, float] = field(default_factory=dict)
    above: dict[str, str] = field(default_factory=dict)
    ends: dict[str, str] = field(default_factory=dict)
    mimics: dict[str, tuple[str, int]] = field(default_factory=dict)

    def start(self, path: tuple[str, ...], attributes: Mapping[str, str], line: int) -> None:
        """Look at an element.

        Args:
            path: tags from the root to it. attributes: its own. line: of the file.

        Raises:
            InputError: what can't be, with the line.
        """
        if path == ("robot", "link"):
            self.links += 1
            self._few(self.links, MOST_LINKS, "links")
        elif path == ("robot", "joint"):
            self.joint = attributes.get("name", ""), attributes.get("type", "")
            if self.joint[1] not in TYPES:
                raise InputError(
                    f"joint '{self.joint[0]}' of type '{self.joint[1]}' in {self.source}, line {line}",
                    f"one of {', '.join(TYPES)}",
                    "correct it",
                )
            self.moving += self.joint[1] != "fixed"
            self._few(self.moving, MOST_MOVING, "moving joints")
        elif path[:2] == ("robot", "joint") and len(path) == 3:
            self._joint(path[-1], attributes, line)
        elif path[:3] == BODY and len(path) == 4:
            self._body(path[-1], attributes, line)
        elif path[:2] == ("robot", "link") and len(path) == 5 and path[-1] in SHAPES:
            self._shape(path[-1], attributes, line)

    def close(self, path: tuple[str, ...], line: int) -> None:
        """Look at an element whose end was read; `path` and `line` as in `start`.

        Raises:
            InputError: a body that can't be, with the line.
        """
        if path == BODY:
            self._whole_body(f"{self.source}, line {line}")
            self.body.clear()
        elif path == ("robot", "joint"):
            self.above[self.ends.pop("child", "")] = self.ends.pop("parent", "")

    def end(self) -> None:
        """Refuse joints in a ring, and joints that mimic each other; what follows a joint that isn't there moves by
        itself.
        """
        for link in self.above:
            ring = [link]
            while (parent := self.above.get(ring[-1], "")) not in ("", *ring):
                ring.append(parent)
            if parent:
                raise InputError(
                    f"links in a ring ({' → '.join([parent, *ring[::-1]][:12])}) in {self.source}",
                    "joints that lead from a base outward",
                    "correct <parent> of one of their joints",
                )
        for name, (_, line) in self.mimics.items():
            ring = [name]
            while (leader := self.mimics.get(ring[-1], ("", 0))[0]) not in ("", *ring):
                ring.append(leader)
            if leader:
                raise InputError(
                    f"joints that mimic each other ({' → '.join([*ring, leader])}) in {self.source}, line {line}",
                    "one that leads",
                    "take one <mimic> out",
                )

    def _few(self, found: int, most: int, what: str) -> None:
        if found > most:
            raise InputError(
                f"more than {most} {what} in {self.source}",
                f"a robot of {most} at most",
                "leave out what isn't the arm",
            )

    def _joint(self, tag: str, attributes: Mapping[str, str], line: int) -> None:
        """Axis, place, limits and mimic of a joint."""
        name, kind = self.joint
        where = f"joint '{name}' of {self.source}, line {line}"
        if tag == "origin":
            self._place(attributes, where)
        elif tag == "axis" and kind not in ("fixed", "floating"):
            # without an axis it is 1 0 0; of one that says nothing parsers make 0 0 0, and the joint never moves
            axis = _numbers(attributes.get("xyz", ""), f"axis of {where}", 3)
            if not SHORTEST < math.hypot(*axis) < LONGEST:
                raise InputError(f"axis {attributes.get('xyz')} of {where}", "a direction, as 0 0 1", "correct it")
        elif tag == "limit" and kind in ("revolute", "prismatic"):
            low, high = (_number(attributes.get(end, "0"), f"{end} limit of {where}") for end in ("lower", "upper"))
            if low > high:
                raise InputError(f"limits from {low:g} to {high:g} of {where}", "lower below upper", "swap them")
        elif tag in ("parent", "child"):
            self.ends[tag] = attributes.get("link", "")
        elif tag == "mimic":
            self.mimics[name] = attributes.get("joint", ""), line

    def _body(self, tag: str, attributes: Mapping[str, str], line: int) -> None:
        """Mass, inertia and centre of a link."""
        where = f"{self.source}, line {line}"
        if tag == "origin":
            self._place(attributes, where)
        elif tag == "mass":
            text = attributes.get("value", "")
            mass = _number(text, f"mass in {where}")
            if not 0.0 <= mass <= MOST_MASS:
                raise InputError(f"a mass of {text} kg in {where}", f"0 to {MOST_MASS:g} kg", "correct it")
            self.body["mass"] = mass
        elif tag == "inertia":
            for name, text in attributes.items():
                value = _number(text, f"{name} in {where}")
                if abs(value) > MOST_INERTIA or (name in ("ixx", "iyy", "izz") and value < -ROUNDING):
                    raise InputError(f"{name} = {text} kg·m² in {where}", "what a body can have", "correct it")
                self.body[name] = value

    def _whole_body(self, where: str) -> None:
        """Mass and inertia of a link together."""
        absent = [name for name in ("mass", *MOMENTS) if name not in self.body]
        if absent:
            raise InputError(
                f"<inertial> without {', '.join(absent)} in {where}",
                "mass and all of ixx, iyy, izz, ixy, ixz, iyz, without which it counts for nothing",
                "add them, or take the <inertial> out",
            )
        mass, (xx, yy, zz, xy, xz, yz) = self.body["mass"], (self.body[name] for name in MOMENTS)
        low, middle, high = np.linalg.eigvalsh([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
        if high > TRIANGLE * (low + middle) and high - low - middle > MATTERS:
            raise InputError(
                f"moments of inertia of {low:.3g}, {middle:.3g} and {high:.3g} kg·m² in {where}",
                "those of a body, none of them above the others' sum",
                "correct its <inertia>",
            )
        if mass > 0.0 and high > mass * WIDEST**2:
            raise InputError(
                f"an inertia of {high:.3g} kg·m² of {mass:g} kg in {where}",
                f"{mass * WIDEST**2:.3g} kg·m² at most, of a link that is no wider than {2 * WIDEST:g} m",
                "correct it, to kg·m²",
            )

    def _shape(self, tag: str, attributes: Mapping[str, str], line: int) -> None:
        """Sizes of a shape that is seen or collided with."""
        for name in SHAPES[tag]:
            what = f"{name} of a {tag} in {self.source}, line {line}"
            if min(_numbers(attributes.get(name, ""), what, 3 if name == "size" else 1)) < 0.0:
                raise InputError(f"{what}, '{attributes[name]}'", "one that isn't negative", "correct it, in m")

    def _place(self, attributes: Mapping[str, str], where: str) -> None:
        for name in ("xyz", "rpy"):
            values = _numbers(attributes.get(name, "0 0 0"), f"{name} of an origin in {where}", 3)
            if max(map(abs, values)) > FARTHEST:
                unit = "m" if name == "xyz" else "rad"
                raise InputError(
                    f"{name} = {attributes[name]} in {where}", f"{FARTHEST:g} {unit} at most", "correct it"
                )


def _numbers(text: str, what: str, count: int) -> list[float]:
    values = [_number(part, what) for part in text.split()]
    if len(values) != count:
        raise InputError(f"{what}, '{text}'", f"{count} numbers", "correct it")
    return values


def _number(text: str, what: str) -> float:
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise InputError(f"{what}, '{text[:40]}'", "a finite number", "correct it")
    return value
