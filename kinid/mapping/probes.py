"""Logs to probes of a property map: each touch of a log becomes one probe, with its place on the surface."""

from __future__ import annotations

import dataclasses
import itertools
import os
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from kinid.contact import touching
from kinid.contact.series import ContactSeries, contact_series, tip_motion
from kinid.contact.touching import SHORTEST
from kinid.data.log import Log
from kinid.data.rig import Rig
from kinid.effects import Stage
from kinid.errors import InputError, KinidError
from kinid.identification.fit import Fit
from kinid.inputs import check_regular, digest, read_json
from kinid.mapping.boundaries import SlidePath, paths
from kinid.mapping.layers import estimates, fit_touch, mapped
from kinid.mapping.map_file import is_map
from kinid.mapping.origin import PRIOR, origin, refuse_another
from kinid.mapping.property_map import Probe, Property, PropertyMap
from kinid.mapping.warm_start import Neighbourhood
from kinid.modeling.model import Model
from kinid.robotics.reading import read
from kinid.robotics.robot import Robot
from kinid.robotics.surface import Mesh, Plane
from kinid.robotics.surface import load as load_surface

Array = NDArray[np.float64]
#: properties of a log, and a probe for each touch
Found = tuple[tuple[Property, ...], list[Probe]]

#: a slide further than this is cut into pieces, each a probe: one estimate would be of no place [m]
FAR = 0.02
#: neighbouring bins of a slide share their errors: so many count as one
SHARED = 3.0
#: what touches are fitted with unless the user says more
MODEL = ("kelvin-voigt",)
#: files of logs in a folder
LOG_SUFFIXES = (".parquet", ".csv", ".csv.gz", ".npz", ".mat", ".mcap", ".bag")


class Exponent(NamedTuple):
    """n of an elastic law F_e = K δⁿ, and its variance; 0 where the law fixes it."""

    value: float
    variance: float


def logs_in(paths: Sequence[Path]) -> list[Path]:
    """The logs that files and folders name, in order; of the laboratory's campaign, which has a manifest, its pokes and
    slides, of any other folder every file of a log's kind that is no map.

    Raises:
        InputError: a folder without logs, or nothing there.
    """
    out: list[Path] = []
    for path in paths:
        if not path.is_dir():
            check_regular(path, "log", "a log in a file", "copy it into one")
            if not path.is_file():
                raise InputError(f"no log at {path}", "a log, or a folder of logs", "correct the name")
            out.append(path)
            continue
        if (path / "campaign.json").is_file():
            out += sorted((*path.glob("poke_*.parquet"), *path.glob("slide_*.parquet")))
            continue
        found = sorted(
            file
            for file in path.iterdir()
            if file.name.lower().endswith(LOG_SUFFIXES) and not file.name.startswith(".") and not is_map(file)
        )
        if not found:
            raise InputError(f"no logs in {path}", f"files ending in {', '.join(LOG_SUFFIXES)}", "name another folder")
        out += found
    return list(dict.fromkeys(out))


def expected(paths: Sequence[Path]) -> int | None:
    """How many logs there will be when running campaigns are done; None when nobody says."""
    total = 0
    for path in paths:
        manifest = path / "campaign.json"
        if manifest.is_file():
            try:
                facts = read_json(
                    manifest, "manifest", "the manifest of a campaign", "make the campaign anew", open_ends=True
                )
                total += int(facts["rows"]) * int(facts["columns"])
            except (KinidError, ValueError, KeyError, TypeError):
                return None
        elif path.is_dir():
            return None
        else:
            total += 1
    return total


def touches(touch: ContactSeries) -> list[tuple[int, int]]:
    """Rows [begin, end) of each touch, knocks left out."""
    spans = touching.touches(touch.t, touch.in_contact, touch.valid)
    return [(a, b) for a, b in spans if touch.t[b - 1] - touch.t[a] >= SHORTEST]


@dataclasses.dataclass(frozen=True, eq=False)
class Prober:
    """Turns logs of one rig into probes.

    Attributes:
        rig: what measured. model: effects to fit; layers (`Effect.above`) where touches show them. robot, surface: the
            rig's. along: length of the pieces that slides further than `FAR` are cut into [m]; 0 for none.
    """

    rig: Rig
    model: Model
    robot: Robot
    surface: Plane | Mesh
    along: float = 0.002

    @classmethod
    def of(cls, rig: Rig, model: Sequence[str] | None = None, along: float = 0.002) -> Prober:
        """For a rig; default model: `MODEL`.

        Raises:
            InputError: no robot or no surface in the rig, no such effect or none at all, or pieces of slides without a
                length.
        """
        if not (along == 0 or 5e-4 <= along <= FAR):
            raise InputError(f"pieces of slides of {along} m", f"0.0005 to {FAR} m, or 0 for none", "correct it")
        surface = load_surface(rig)
        if not isinstance(surface, Plane | Mesh):
            raise InputError(
                "a rig without [surface]",
                "the surface that is mapped",
                "add [surface] with point and normal, or a mesh",
            )
        made = Model(*(MODEL if model is None else model))
        if not made.effects:
            raise InputError(
                f"a map of the model '{made if model else ''}', which has no property of a material",
                "effects that are fitted to each touch",
                "name a law of contact, as kelvin-voigt",
            )
        return cls(rig, made, Robot.load(rig), surface, along)

    @property
    def name(self) -> str:
        """Of the model."""
        return str(self.model)

    def probes(self, path: Path, source: str | None = None) -> Found:
        """Of a log in a file: its properties, and a probe for each touch.

        Args:
            path: of the file. source: what it is called, where that isn't its path.

        Raises:
            InputError: a log that can't carry the model.
        """
        log = read(path, self.rig, robot=self.robot)
        properties, probes = self.of_log(log, source or str(path))
        known = digest(path) if path.is_file() else ""  # a bag may be a folder
        return properties, [dataclasses.replace(probe, digest=known) for probe in probes]

    def each(self, sources: Sequence[str]) -> Iterator[tuple[str, Found | str]]:
        """The same of many files, or why one has none."""
        for source in sources:
            try:
                yield source, self.probes(Path(source))
            except KinidError as error:
                yield source, str(error)

    def of_log(self, log: Log, source: str) -> Found:
        """The same of a log in memory."""
        touch = contact_series(log, self.rig, robot=self.robot)
        spans = touches(touch)
        if not spans:
            raise InputError(
                f"no touch of {SHORTEST} s in {source}",
                "a log in which the tool touches the surface",
                "leave it out, or look at it with kinid contact LOG",
            )
        position = tip_motion(log, self.rig, robot=self.robot).position
        edges = [0, *((a[1] + b[0]) // 2 for a, b in itertools.pairwise(spans)), len(touch)]
        parts = [_cut(touch, *ends) for ends in itertools.pairwise(edges)] if len(spans) > 1 else [touch]
        fits = [fit_touch(self.model, part) for part in parts]
        ways = [self._ways(part) for part in parts]
        exponent = _exponent([fit for fit, slides in zip(fits, ways) if not slides]) or _exponent(fits, fixed=True)
        if any(effect.above for effect in self.model.effects):
            exponent = None  # one depth tells film and body as little
        called = mapped(self.model, fits)
        properties = tuple(Property(*item) for item in zip(called.names, called.units))
        out: list[Probe] = []
        for i, ((a, b), fit, slides) in enumerate(zip(spans, fits, ways)):
            name = source if len(spans) == 1 else f"{source}#{i}"
            if slides:
                out += self._pieces(slides, exponent, [p.name for p in properties], name)
                continue
            inside = slice(a, b)
            # the deeper, the more a place says about the estimate
            weight = np.maximum(np.nan_to_num(touch.depth[inside]), 0.0) + 1e-9
            mean = np.average(np.nan_to_num(position[inside], nan=0.0), axis=0, weights=weight)
            place = self.surface.locate(mean[None]).closest[0]
            out.append(
                Probe(
                    place,
                    *estimates(fit, self.model, called),
                    fit.error.train,
                    fit.error.noise_floor,
                    name,
                )
            )
        return properties, out

    def _ways(self, touch: ContactSeries) -> list[SlidePath]:
        """Straight ways of a slide that is long enough to be cut into pieces; none of another touch."""
        if not (self.along and isinstance(self.surface, Plane)):
            return []
        inside = touch.in_contact
        if not inside.any() or np.hypot(np.ptp(touch.slip1[inside]), np.ptp(touch.slip2[inside])) < FAR:
            return []
        try:
            return [way for way in paths(touch) if np.ptp(way.x) >= 0.25 * FAR]
        except InputError:
            return []

    def _pieces(
        self, ways: Sequence[SlidePath], exponent: Exponent | None, names: Sequence[str], source: str
    ) -> list[Probe]:
        """A probe for each piece of a long slide: force over a power of the depth as stiffness, tangential over normal
        force as friction.

        Passes over the same place are taken together. What a steady slide doesn't tell, as damping, is left open; so is
        stiffness without the law's exponent, since one depth can't tell it.
        """
        assert isinstance(self.surface, Plane)
        flat = np.concatenate([way.origin + way.x[:, None] * way.direction for way in ways])
        normal, tangential, depth = (
            np.concatenate([getattr(way, name) for way in ways]) for name in ("normal", "tangential", "depth")
        )
        felt, shared = {"friction": tangential / normal}, {"friction": 0.0}
        if exponent is not None:
            felt["stiffness"] = normal / depth**exponent.value
            shared["stiffness"] = exponent.variance * np.log(depth.mean()) ** 2  # relative: d ln K = −ln δ dn
        cell = np.unique(np.round(flat / self.along).astype(int), axis=0, return_inverse=True)[1].ravel()
        out: list[Probe] = []
        for k in range(int(cell.max()) + 1):
            rows = cell == k
            if rows.sum() < 3:
                continue
            means = {name: float(values[rows].mean()) for name, values in felt.items()}
            own = {name: values[rows].var(ddof=1) / max(rows.sum() / SHARED, 1.0) for name, values in felt.items()}
            variance = [own[n] + shared[n] * means[n] ** 2 if n in means else np.inf for n in names]
            covariance = np.where(np.eye(len(names)) > 0, variance, 0.0)
            place = self.surface.point + flat[rows].mean(axis=0) @ self.surface.axes[:2]
            name = f"{source}#piece{k}" if "#" not in source else f"{source}.piece{k}"
            out.append(Probe(place, np.array([means.get(n, 0.0) for n in names]), covariance, source=name))
        return out


def build(
    paths: Sequence[Path | str],
    prober: Prober,
    start: PropertyMap | None = None,
    skipped: Callable[[str, str], None] | None = None,
    elsewhere: Callable[[Sequence[str]], Iterator[tuple[str, Found | str]]] | None = None,
    near: Neighbourhood | None = None,
) -> Iterator[PropertyMap]:
    """The map as it grows, log by log; logs that `start` holds already, by their path, are passed over.

    Args:
        paths: of logs. prober: fits them. start: a map to go on with. skipped: told of logs that can't be used, and
            why; without it, such a log ends it. elsewhere: gives the probes of each log in order, or why it has none;
            default: they are made here. near: what is expected of a place, which each probe is joined with; without
            it, probes say what their own touches do.

    Raises:
        InputError: as `Prober.probes`; a log that is there under another name; or a start that has another surface,
            model or properties, or was made by another rig.
    """
    made_with = origin(prober.rig) | ({} if near is None else {PRIOR: near.source})
    if start is not None and (start.model != prober.name or not same_surface(start.surface, prober.surface)):
        raise InputError(
            f"a map of {start.model}, perhaps on another surface",
            f"a map of {prober.name} on the rig's surface",
            "write to another file",
        )
    if start is not None:
        refuse_another(start.origin, made_with)
    grown = start
    before = () if start is None else start.probes
    there = {os.path.realpath(p.source.split("#")[0]) for p in before}
    # behind other names, of links or of copies, the same log would count as two that agree
    known = {p.digest: p.source for p in before if p.digest}
    todo = [str(path) for path in paths if os.path.realpath(path) not in there]
    for source, found in (elsewhere or prober.each)(todo):
        try:
            if isinstance(found, str):
                raise KinidError(found)
            properties, probes = found
            if twin := next((known[probe.digest] for probe in probes if probe.digest in known), ""):
                raise InputError(f"the same log twice, {twin} and {source}", "each log once", "leave one of them out")
            empty = PropertyMap(prober.surface, properties, (), prober.name, made_with) if grown is None else grown
            for probe in probes:
                own = probe if near is None else near.applied(empty, [p.name for p in properties], probe)
                empty = empty.added(own)
            grown = empty
            known |= {probe.digest: source for probe in probes if probe.digest}
        except KinidError as error:
            if skipped is None:
                raise
            skipped(source, str(error))
            continue
        yield grown


def same_surface(a: Plane | Mesh, b: Plane | Mesh) -> bool:
    """Whether two surfaces are one."""
    if isinstance(a, Plane) and isinstance(b, Plane):
        return np.array_equal(a.point, b.point) and np.allclose(a.axes, b.axes, atol=1e-12)
    return (
        isinstance(a, Mesh)
        and isinstance(b, Mesh)
        and np.array_equal(a.vertices, b.vertices)
        and np.array_equal(a.faces, b.faces)
    )


def _exponent(fits: Sequence[Fit], fixed: bool = False) -> Exponent | None:
    """That of the elastic law, over the fits that tell it; None where none does.

    What they differ by beyond their errors, as touches of several materials do, adds to its variance.

    Args:
        fits: of one model. fixed: whether only a law counts whose exponent is no parameter.
    """
    values, variances = [], []
    for fit in fits:
        s, p = fit.experiment.signals.fresh(), fit.values
        elastic = [effect for effect in fit.model.effects if Stage.ELASTIC in effect.stages()]
        for effect in sorted(elastic, key=lambda effect: effect.order):
            effect.elastic(s, p[fit.model.place(effect.id, fit.layout)])
        free = [list(fit.parameters).index(n) for e in elastic if (n := f"{e.id}.exponent") in fit.parameters]
        variance = float(fit.solution.covariance[free[-1], free[-1]]) if free else 0.0
        if not free:
            return Exponent(s.exponent, 0.0)
        if not fixed and 0.0 < variance < np.inf:
            values.append(s.exponent)
            variances.append(variance)
    if not values:
        return None
    trust = 1.0 / np.array(variances)
    mean = float(np.average(values, weights=trust))
    scatter = float(np.average((np.array(values) - mean) ** 2, weights=trust))
    chance = 1.0 / float(trust.sum())
    return Exponent(mean, chance + max(0.0, scatter - (len(values) - 1) * chance))


def _cut(touch: ContactSeries, low: int, high: int) -> ContactSeries:
    """Rows of a contact series."""
    rows = {
        f.name: value[..., low:high]
        for f in dataclasses.fields(touch)
        if isinstance(value := getattr(touch, f.name), np.ndarray) and f.name != "bias"
    }
    # without its source, which is of the whole log
    return dataclasses.replace(touch, **rows, source=None)  # type: ignore[arg-type]
