"""What the laboratory has to touch: contact laws, and properties that change over a surface."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from kinid.controllers._given import closest
from kinid.errors import InputError
from kinid.lab import _law as law

Array = NDArray[np.float64]
#: a property at places along both tangents [m], each (n,)
Field = Callable[[Array, Array], Array]

#: names of the properties that may change over a surface, in the order of the law's fields
PROPERTIES = ("stiffness", "damping", "friction", "layer", "layer_depth")
#: half the side of the raster on which fields are tabled [m], and its step
SURFACE, _STEP = 0.06, 5e-4


@dataclass(frozen=True, eq=False)
class Patch:
    """A rectangle of a surface, along both tangents from `low` to `high` [m], where another material lies."""

    low: tuple[float, float]
    high: tuple[float, float]
    material: Material

    def __post_init__(self) -> None:
        if not (
            np.isfinite([*self.low, *self.high]).all() and self.low[0] < self.high[0] and self.low[1] < self.high[1]
        ):
            raise InputError(
                f"a patch from {self.low} to {self.high} m", "two corners, the lower one first", "correct it"
            )

    def holds(self, x: Array, y: Array) -> NDArray[np.bool_]:
        """Whether places along both tangents [m], each (n,), lie in it."""
        return np.asarray((x >= self.low[0]) & (x <= self.high[0]) & (y >= self.low[1]) & (y <= self.high[1]))


@dataclass(frozen=True, eq=False)
class Material:
    """A contact law and its parameters; what is zero isn't there.

    N = (K δⁿ + K₂ max(0, δ − δ₂)) with, in this order, softening, drift, relaxation, a loop, damping and adhesion;
    T = −μ N u − c v with a bristle's deflection u. The names are those of the catalogue's effects.

    Attributes:
        name: of the material. color: RGB of its glitter, 0…1.
        stiffness: K [N/mⁿ]. exponent: n. damping: B [N·s/m]. loss: λ [s/m], N += λ F_e δ̇.
        friction: μ. layer: K₂ [N/m] beyond layer_depth δ₂ [m].
        relaxation: a branch's stiffness over K and its time constant [s], two at most. hysteresis: amplitude, length
            [m].
        softening: ratio, length [m]. adhesion: force [N], length [m]. drift: [1/min].
        stribeck: Δμ, speed [m/s]. viscous: [N·s/m]. bristle: [m]. load_exponent, anisotropy: see the effects.
        coupling: K (3, 3) and C (3, 3) over (x₁, x₂, δ), added to the force. compliance: in series [m/N].
        rounding: speed over which friction vanishes, instead of bristles [m/s]; 0 for bristles.
        fields: properties that change over the surface. patches: where another material lies; the last one holds.
        colors: colour at places, (n, 3), where it changes. side: of a square piece [m]; beyond it nothing lies.
    """

    name: str = "kelvin-voigt"
    color: tuple[float, float, float] = (0.5, 0.5, 0.5)
    stiffness: float = 0.0
    exponent: float = 1.0
    damping: float = 0.0
    loss: float = 0.0
    friction: float = 0.0
    layer: float = 0.0
    layer_depth: float = 0.0
    relaxation: tuple[tuple[float, float], ...] = ()
    hysteresis: tuple[float, float] = (0.0, 1e-3)
    softening: tuple[float, float] = (0.0, 1e-3)
    adhesion: tuple[float, float] = (0.0, 5e-4)
    drift: float = 0.0
    stribeck: tuple[float, float] = (0.0, 5e-3)
    viscous: float = 0.0
    bristle: float = 1e-4
    load_exponent: float = 0.0
    anisotropy: float = 0.0
    coupling: tuple[Array, Array] | None = None
    compliance: float = 0.0
    rounding: float = 0.0
    fields: dict[str, Field] = field(default_factory=dict)
    patches: tuple[Patch, ...] = ()
    colors: Callable[[Array, Array], Array] | None = None
    side: float = np.inf

    def replace(self, **changes: object) -> Material:
        """The same with other parameters."""
        return dataclasses.replace(self, **changes)  # type: ignore[arg-type]

    def at(self, x: Array, y: Array) -> dict[str, Array]:
        """Its properties at places along both tangents [m], each (n,)."""
        x, y = np.asarray(x, dtype=float), np.asarray(y, dtype=float)
        out = {
            name: np.array(self.fields[name](x, y) if name in self.fields else np.full(x.shape, getattr(self, name)))
            for name in PROPERTIES
        }
        for patch in self.patches:
            inside = patch.holds(x, y)
            for name, values in patch.material.at(x, y).items():
                out[name][inside] = values[inside]
        return out

    def press(self, x: Array, y: Array, depth: Array) -> Array:
        """Elastic force of a slow press [N], without memory: at places along both tangents and depths [m], each
        (n,).
        """
        values = self.at(x, y)
        exponent = np.full(np.shape(depth), self.exponent)
        for patch in self.patches:
            exponent[patch.holds(x, y)] = patch.material.exponent
        inside = np.maximum(depth, 0.0)
        out: Array = values["stiffness"] * inside**exponent + values["layer"] * np.maximum(
            0.0, depth - values["layer_depth"]
        )
        return out

    def raster(self) -> tuple[Array, NDArray[np.int64], Array]:
        """For the loop: tables of the properties, (5, nx, ny), the number of the patch, (nx, ny), and x0, y0, dx,
        dy.
        """
        if not self.fields and not self.patches:
            flat = np.array([getattr(self, name) for name in PROPERTIES])
            return (
                np.ascontiguousarray(np.broadcast_to(flat[:, None, None], (law.FIELDS, 2, 2))),
                np.zeros((2, 2), dtype=np.int64),
                np.array([0.0, 0.0, 1.0, 1.0]),
            )
        ticks = np.arange(-SURFACE, SURFACE + _STEP / 2, _STEP)
        x, y = np.meshgrid(ticks, ticks, indexing="ij")
        values = self.at(x.ravel(), y.ravel())
        tables = np.stack([values[name].reshape(x.shape) for name in PROPERTIES])
        number = np.zeros(x.shape, dtype=np.int64)
        for i, patch in enumerate(self.patches, start=1):
            number[patch.holds(x, y)] = i
        return np.ascontiguousarray(tables), number, np.array([ticks[0], ticks[0], _STEP, _STEP])

    def packed(self) -> Array:
        """What is the same throughout a patch, for the loop, a row each: outside of them, then of each patch."""
        return np.stack([self._row(), *(patch.material._row() for patch in self.patches)])

    def _row(self) -> Array:
        """What is the same everywhere but in patches."""
        p = np.zeros(law.PARAMETERS)
        branches = [*self.relaxation, (0.0, 1.0), (0.0, 1.0)]
        p[: law.COUPLED_K] = [
            self.exponent,
            self.loss,
            *branches[0],
            *branches[1],
            *self.hysteresis,
            *self.softening,
            *self.adhesion,
            self.drift,
            *self.stribeck,
            self.viscous,
            self.bristle,
            self.load_exponent,
            self.anisotropy,
            self.compliance,
            self.rounding,
        ]
        if self.coupling is not None:
            p[law.COUPLED_K : law.COUPLED_C] = np.ravel(self.coupling[0])
            p[law.COUPLED_C :] = np.ravel(self.coupling[1])
        return p

    def truth(self) -> dict[str, object]:
        """Its numbers, for the folder that no other command reads."""
        out: dict[str, object] = {}
        for item in dataclasses.fields(self):
            value = getattr(self, item.name)
            if item.name == "coupling" and value is not None:
                value = [np.asarray(part).tolist() for part in value]
            if item.name == "fields":
                value = sorted(value)
            if item.name == "patches":
                value = [{"low": patch.low, "high": patch.high, "material": patch.material.truth()} for patch in value]
            if item.name == "side" and not np.isfinite(value):
                value = None
            if item.name != "colors":
                out[item.name] = value
        return out


def _silicone(
    name: str, stiffness: float, damping: float, friction: float, color: tuple[float, float, float]
) -> Material:
    return Material(name, color, stiffness=stiffness, damping=damping, friction=friction)


ECOFLEX = _silicone("ecoflex-50", 732.0, 9.9, 0.82, (0.87, 0.63, 0.16))
DRAGON_SKIN = _silicone("dragon-skin-10", 994.0, 14.5, 0.77, (0.16, 0.42, 0.78))
#: the two further silicones of the mould, softer and harder than those that were measured
ECOFLEX_30 = _silicone("ecoflex-30", 510.0, 7.2, 0.88, (0.80, 0.22, 0.30))
DRAGON_SKIN_30 = _silicone("dragon-skin-30", 2400.0, 21.0, 0.66, (0.20, 0.60, 0.32))
SPONGE = Material("sponge", (0.25, 0.25, 0.28), stiffness=280.0, damping=8.1, friction=0.27)
#: The band was published as three fits to one log, K = 99.4 (Hooke), 98.1 (Kelvin-Voigt) and 92.5 N/m (power law, n =
#: 1.028). They are of one band where the power law counts depth in cm: 92.5 N/m · 1 cm · (8 cm / 1 cm)ⁿ is 98.0 N/m at
#: the mean depth.
_BAND_EXPONENT = 1.028
_BAND_STIFFNESS = 92.5 * 0.01 ** (1.0 - _BAND_EXPONENT)  # [N/mⁿ]
#: quasi-elastic: a power law near one with losses that grow with force. A stretched band also resists sideways, and
#: pulls the tip aside as it is pressed, because it hangs between posts of unequal height
BAND = Material(
    "band",
    (0.72, 0.55, 0.35),
    stiffness=_BAND_STIFFNESS,
    exponent=_BAND_EXPONENT,
    loss=3.37 / _BAND_STIFFNESS,
    friction=0.0,
    coupling=(
        np.array([[-60.0, 0.0, 9.0], [0.0, -45.0, -5.0], [0.0, 0.0, 0.0]]),
        np.array([[-0.6, 0.0, 0.0], [0.0, -0.6, 0.0], [0.0, 0.0, 0.0]]),
    ),
)

_SIDE, _BORDER, _RIM = 0.10, 2e-3, 4e-3
_QUARTERS = ((ECOFLEX_30, ECOFLEX), (DRAGON_SKIN, DRAGON_SKIN_30))


def _quarters(x: Array, y: Array, values: tuple[tuple[Array, Array], tuple[Array, Array]]) -> Array:
    """Four values blended over borders that wind a little: silicones were poured one beside the other."""
    u = 0.5 * (1.0 + np.tanh((x - 1.5e-3 * np.sin(90.0 * y)) / _BORDER))
    v = 0.5 * (1.0 + np.tanh((y + 1.2e-3 * np.sin(110.0 * x)) / _BORDER))
    (a, b), (c, d) = values
    u, v = (w[(...,) + (None,) * (np.ndim(a))] for w in (u, v))
    out: Array = (1 - u) * ((1 - v) * a + v * b) + u * ((1 - v) * c + v * d)
    return out


def _rim(x: Array, y: Array) -> Array:
    """How much of its stiffness the material has: less towards the free edge."""
    out: Array = 0.45 + 0.55 * 0.5 * (1.0 + np.tanh((_to_side(x, y) - _RIM) / (0.5 * _RIM)))
    return out


def _to_side(x: Array, y: Array) -> Array:
    """Distance to the nearest side [m]."""
    out: Array = np.minimum(_SIDE / 2 - np.abs(x), _SIDE / 2 - np.abs(y))
    return out


@dataclass(frozen=True)
class Side:
    """What a side of a block does to stiffness and damping of a press e [m] from it: 1 + a exp(−e / l).

    Fitted to plane-strain finite elements of a silicone (Poisson's ratio 0.49) that is 10 mm deep on a rigid ground,
    under a tip 4 mm wide, by tests/independent/test_block_sides.py: within 0.03.

    Attributes:
        change: a. length: l [m].
    """

    change: float
    length: float

    def __call__(self, x: Array, y: Array) -> Array:
        """Share of what there is far from all sides, at places along both tangents [m]."""
        out: Array = 1.0 + self.change * np.exp(-np.maximum(_to_side(x, y), 0.0) / self.length)
        return out


#: a side that nothing holds, and one that sticks to a rigid wall, there from 4 mm on: nearer the tip meets the wall
FREE_SIDE, WALLED_SIDE = Side(-0.69, 4.6e-3), Side(0.37, 7.2e-3)


def _film(x: Array, y: Array) -> Array:
    """1 where a soft film that ran over covers the quarter x > 0, y > 0, else 0."""
    out: Array = 0.5 * (1.0 + np.tanh((np.minimum(x, y) - 0.012) / 1.5e-3))
    return out


#: stiffness of the film, and how thick it lies [m]
_FILM_STIFFNESS, _FILM_THICKNESS = 350.0, 8e-4


def _mould_of(name: str, side: Field | None = None) -> Field:
    """A property of the mould; with what its sides do to it."""
    values = tuple(tuple(np.asarray(getattr(m, name), dtype=float) for m in row) for row in _QUARTERS)

    def value(x: Array, y: Array) -> Array:
        body = _quarters(x, y, values)  # type: ignore[arg-type]
        film = _film(x, y)
        if side is not None:
            body = body * side(x, y)
        if name == "stiffness":
            return (1 - film) * body + film * _FILM_STIFFNESS
        if name == "friction":
            return body * (1 + 0.15 * film)  # sticky
        return body

    return value


def _mould_layer(side: Field) -> Field:
    """What the body is stiffer by than its film."""
    values = tuple(tuple(np.asarray(m.stiffness) for m in row) for row in _QUARTERS)

    def value(x: Array, y: Array) -> Array:
        body = _quarters(x, y, values) * side(x, y)  # type: ignore[arg-type]
        out: Array = _film(x, y) * (body - _FILM_STIFFNESS)
        return out

    return value


def _mould_colors(x: Array, y: Array) -> Array:
    body = _quarters(np.asarray(x), np.asarray(y), tuple(tuple(np.asarray(m.color) for m in row) for row in _QUARTERS))  # type: ignore[arg-type]
    film = _film(x, y)[..., None]
    out: Array = (1 - 0.5 * film) * body + 0.5 * film * np.asarray(ECOFLEX_30.color)
    return out


MOULD = Material(
    "mould",
    (0.5, 0.45, 0.4),
    fields={
        "stiffness": _mould_of("stiffness", _rim),
        "damping": _mould_of("damping"),
        "friction": _mould_of("friction"),
        "layer": _mould_layer(_rim),
        "layer_depth": lambda x, y: np.full(np.shape(x), _FILM_THICKNESS),
    },
    colors=_mould_colors,
    side=_SIDE,
)


def _with_sides(name: str, side: Side) -> Material:
    """The mould whose sides are those of a finite block: they change stiffness and damping alike."""
    changed = {
        "stiffness": _mould_of("stiffness", side),
        "damping": _mould_of("damping", side),
        "layer": _mould_layer(side),
    }
    return MOULD.replace(name=name, fields=MOULD.fields | changed)


#: the same four silicones taken out of their mould, and still in it
FREE_MOULD, WALLED_MOULD = _with_sides("free-mould", FREE_SIDE), _with_sides("walled-mould", WALLED_SIDE)

_ALL = (BAND, SPONGE, ECOFLEX, DRAGON_SKIN, ECOFLEX_30, DRAGON_SKIN_30, MOULD, FREE_MOULD, WALLED_MOULD)
MATERIALS = {m.name: m for m in _ALL}


def material(name: str) -> Material:
    """A material by its name.

    Raises:
        InputError: no such material.
    """
    if name not in MATERIALS:
        raise InputError(f"material '{name}'", f"one of {', '.join(MATERIALS)}", closest(name, MATERIALS))
    return MATERIALS[name]
