"""The viewer: a map, a log or a running campaign in the browser of this machine, or recorded in one HTML file."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum
from pathlib import Path

from kinid.data.rig import Rig
from kinid.errors import InputError, KinidError, near
from kinid.mapping.map_file import is_map
from kinid.mapping.probes import Prober, build, expected, logs_in, same_surface
from kinid.mapping.property_map import Probe, PropertyMap
from kinid.modeling.model import Model
from kinid.robotics.reading import read
from kinid.robotics.robot import Robot
from kinid.robotics.surface import Mesh, Plane
from kinid.robotics.surface import load as load_surface
from kinid.viewer import scene as scenes
from kinid.viewer.page import page
from kinid.writers import Json

#: logs of a folder that are read before the picture is drawn anew
AT_ONCE = 25


class Kind(StrEnum):
    """Of what is looked at."""

    MAP = "map"
    LOG = "log"
    FOLDER = "folder"

    @classmethod
    def of(cls, target: Path) -> Kind:
        """What stands there."""
        return cls.FOLDER if target.is_dir() else cls.MAP if is_map(target) else cls.LOG


@dataclass(eq=False)
class View:
    """What is looked at, and how it changes: `scene()` is all of it, `changed()` what is new since it was last asked.

    Attributes:
        target: a map, a log, or a folder of logs. rig: default beside the target. shown: property. method: between
            probes.
        model: that predicts the forces of a log, and that is fitted to the touches of a folder.
    """

    target: Path
    rig: Path | None = None
    shown: str | None = None
    method: str = "gp"
    model: str | None = None

    def __post_init__(self) -> None:
        if not self.target.exists():
            raise InputError(f"nothing at {self.target}", "a map, a log, or a campaign's folder", "correct the name")
        self._map: PropertyMap | None = None
        self._stamp: tuple[int, int] | None = None
        self._shown_log: Path | None = None
        self._bad: set[str] = set()
        self.kind = Kind.of(self.target)
        self._check_options()
        self._rig: Rig | None = None
        self._robot: Robot | None = None
        self._prober: Prober | None = None
        rig = self.rig or (self.target if self.kind is Kind.FOLDER else self.target.parent) / "rig.toml"
        if self.kind is not Kind.MAP or self.rig is not None:
            self._rig = Rig.load(rig)
            if self._rig.robot is None:
                raise InputError(
                    f"no [robot] in {rig}", "a robot to show", 'add [robot] with model = "lwr4plus" or your URDF'
                )
            self._robot = Robot.load(self._rig)
        else:
            self._find_arm()
        if self.kind is Kind.FOLDER:
            assert self._rig is not None
            self._prober = Prober.of(self._rig, self._effects)
        self._update()

    def _find_arm(self) -> None:
        """The arm that a map was made with, where its last log and the rig beside that still tell: else there is
        none.
        """
        self._map = PropertyMap.read(self.target)
        log = self._log()
        if log is None:
            return
        try:
            rig = Rig.load(log.parent / "rig.toml")
            surface = load_surface(rig)
            if (
                rig.robot is None
                or not isinstance(surface, Plane | Mesh)
                or not same_surface(surface, self._map.surface)
            ):
                return
            self._rig, self._robot = rig, Robot.load(rig)
            self._moving(log)
        except KinidError:
            self._rig = self._robot = self._shown_log = None

    @property
    def robot(self) -> Robot | None:
        """The arm that is shown, None without one."""
        return self._robot

    @property
    def _effects(self) -> list[str] | None:
        return None if self.model is None else [part.strip() for part in self.model.split(",") if part.strip()]

    def _check_options(self) -> None:
        """Refuse what says nothing about the target, and effects that nobody knows."""
        if self.kind is Kind.MAP and self.model is not None:
            raise InputError(
                f"--model {self.model} for a map, which is fitted already",
                "a log or a folder of logs",
                "leave --model out, or map the logs anew with kinid map LOGS --model MODEL -o MAP.parquet",
            )
        if self.kind is Kind.LOG and self.shown is not None:
            raise InputError(
                f"--property {self.shown} for a log, which has no properties",
                "a map or a folder of logs",
                "leave --property out, or map the log with kinid map LOG -o MAP.parquet",
            )
        if self.model is not None:
            effects = self._effects
            if not effects:
                raise InputError(
                    "--model without an effect", "names of effects, separated by commas", "name one, as kelvin-voigt"
                )
            Model(*effects)

    def _check_shown(self) -> None:
        """Refuse a property that the map doesn't hold; before the first probe of a campaign that isn't known."""
        if self.shown is None or self._map is None or not len(self._map):
            return
        layers = scenes.layers_of(self._map)
        if self.shown not in layers:
            raise InputError(f"property '{self.shown}'", f"one of {', '.join(layers)}", near(self.shown, layers))

    def scene(self) -> Json:
        """Everything."""
        out: Json = {"title": self.target.resolve().name, "play": self.kind is Kind.LOG}
        log = None
        if self._rig is not None and self._robot is not None:
            log = self._log()
            out["robot"] = scenes.robot_scene(self._rig, self._robot)
            out |= {"ground": {"centre": [0.3, 0.0, -2e-3], "size": 0.9}, "patch": scenes.patch_scene(self._rig)}
            if log is not None:
                out |= self._moving(log)
        out |= self._mapped()
        if self.kind is Kind.MAP:
            # what is looked at is the map: the arm is a view beside it
            out["views"] = [*out["views"][1:], *out["views"][:1]] if "robot" in out else out["views"]
            out["play"] = False
        return {name: part for name, part in out.items() if part is not None}

    def _mapped(self) -> Json:
        """The map with what stands around it, and the views of all that is shown."""
        grown = self._map if self._map is not None and len(self._map) else None
        out: Json = {"views": scenes.views(grown, self._robot is not None, self._shown_log is not None)}
        if grown is None:
            return out
        out["map"] = scenes.map_scene(grown, shown=self.shown, method=self.method)
        count = expected([self.target]) if self.kind is Kind.FOLDER else None
        if count is not None:
            out["map"]["facts"] += f"; {len(self._good_logs())} of {count} logs are there"
        out["axes"] = scenes.axes_scene(grown)
        if self._robot is None:
            out["ground"] = scenes.ground_scene(grown)
        patch = scenes.map_patch(grown, out["ground"]["centre"][2] if self._robot is None else 0.0)
        return out if patch is None else out | {"patch": patch}

    def facts(self) -> Json:
        """What is shown, in the words of JSON: the kind of target, the map's model, probes and colours, the log that
        moves.
        """
        out: Json = {
            "target": str(self.target),
            "kind": self.kind,
            "method": self.method,
            "log": None if self._shown_log is None else str(self._shown_log),
        }
        if self._map is not None and len(self._map):
            layers = scenes.layers_of(self._map)
            out |= {
                "model": self._map.model,
                "probes": len(self._map),
                "colours": layers,
                "shown": self.shown or layers[0],
            }
        return out

    def changed(self) -> Json | None:
        """What is new; None when nothing is."""
        had = (None if self._map is None else len(self._map), self._shown_log)
        if not self._update():
            return None
        if self.kind is Kind.LOG:
            try:
                return self._moving(self.target) | {"follow": True}
            except KinidError:  # in the middle of being written: the next look finds it whole
                self._stamp = None
                return None
        out: Json = {}
        if self._map is not None and len(self._map) and (len(self._map) != had[0] or self.kind is Kind.MAP):
            out |= self._mapped()
        log = self._log() if self._robot is not None else None
        if log is not None and log != had[1]:
            out |= self._moving(log) | {"play": True}
        return {name: part for name, part in out.items() if part is not None} or None

    def _moving(self, path: Path) -> Json:
        assert self._rig is not None
        assert self._robot is not None
        log = read(path, self._rig, robot=self._robot)
        if log.q is None:
            raise InputError(
                f"no joint positions in {path}", "q1…qN, to show the arm with", "view the map of it instead"
            )
        self._shown_log = path
        motion = scenes.motion_scene(log, self._rig, self._robot, self.model)
        return {"motion": motion, "facts": f"{path.name}: {len(log)} samples, {log.t[-1] - log.t[0]:.1f} s"}

    def _log(self) -> Path | None:
        """The log that moves the arm: of a map that of its last probe, of a folder the last one."""
        if self.kind is Kind.LOG:
            return self.target
        if self.kind is Kind.FOLDER:
            return next(reversed(self._good_logs()), None)
        probes = [] if self._map is None else self._map.probes[-1:]
        return next((path for path in map(_log_of, probes) if path.is_file()), None)

    def _good_logs(self) -> list[Path]:
        """Of a folder, but for those that can't be used."""
        return [path for path in logs_in([self.target]) if str(path) not in self._bad]

    def _update(self) -> bool:
        """Read what has changed on disk; whether anything has."""
        if self.kind is Kind.FOLDER:
            return self._grow()
        try:
            state = self.target.stat()
        except OSError:  # between being removed and being written anew
            return False
        stamp = (state.st_mtime_ns, state.st_size)
        if stamp == self._stamp:
            return False
        self._stamp = stamp
        if self.kind is Kind.MAP:
            self._map = PropertyMap.read(self.target)
            self._check_shown()
        return True

    def _grow(self) -> bool:
        """Probe a folder's new logs, a few at a time, so that the picture grows while a long campaign is read."""
        assert self._prober is not None
        known = set() if self._map is None else {_log_of(probe) for probe in self._map.probes}
        before = 0 if self._map is None else len(self._map)
        fresh = [path for path in self._good_logs() if path not in known][:AT_ONCE]
        for grown in build(fresh, self._prober, self._map, lambda path, _: self._bad.add(str(path))):
            self._map = grown
        self._check_shown()
        return (0 if self._map is None else len(self._map)) > before


def _log_of(probe: Probe) -> Path:
    """The log in which a probe was measured; behind `#` its source names the place within it."""
    return Path(probe.source.split("#")[0])


def record(view: View) -> str:
    """The view as one self-contained HTML text, all of a folder's logs in it."""
    while view.kind is Kind.FOLDER and view._update():
        pass
    return page(view.scene())
