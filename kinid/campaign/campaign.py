"""A campaign: many logs that one model is asked about."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from kinid.campaign.files import Source, names_of, refuse_copies, sources
from kinid.contact.series import ContactSeries
from kinid.data.log import Log
from kinid.data.rig import Rig
from kinid.errors import InputError, expect
from kinid.identification.fit import checked_experiment
from kinid.identification.pooling.fit import fit_logs
from kinid.identification.pooling.logs import Elsewhere, PooledLog
from kinid.identification.pooling.result import PooledFit
from kinid.modeling.experiment import Experiment
from kinid.modeling.model import Model
from kinid.robotics.reading import read

if TYPE_CHECKING:
    from kinid.campaign.compare import CampaignComparison
    from kinid.campaign.diagnosis import CampaignDiagnosis

Progress = Callable[[str], None]
Data = Log | ContactSeries


@dataclass(frozen=True, eq=False)
class Member:
    """One log: its name, columns, the name of its rig, and how it is read, wherever that is done."""

    name: str
    columns: dict[str, str]
    rig: str
    data: Callable[[], tuple[Data, Rig | None]] = field(repr=False)

    @classmethod
    def of(cls, name: str, columns: Mapping[str, str], rig: Rig, data: Callable[[], tuple[Data, Rig | None]]) -> Member:
        """A log of this rig; what that says is in its columns too."""
        return cls(name, {**_columns(rig), **columns}, _key(rig), data)

    def experiment(self, model: Model) -> Experiment:
        """The log as a fit of a model takes it."""
        return checked_experiment(model, *self.data())[0]


class Campaign:
    """Many logs, of which `fit`, `compare` and `diagnose` say the same as of one.

    Material parameters are shared, those of a touch, a zeroing or a clock are each log's own (`Effect.per_log`), and
    `sharing` says otherwise: "shared", "per-log", "population" (a normal one, of learnt spread) or "per COLUMN".

    Args:
        logs: paths of logs, of folders and of `campaign.toml` files; or logs and contact series that were read.
        rig: what was measured with what, where it isn't told beside a log. sharing: parameter or effect → how.
        columns: name of a column → a value for each log, in order: day, robot, tool, operator …

    Raises:
        InputError: no logs, or files that are none.
    """

    def __init__(
        self,
        logs: Sequence[str | Path | Data],
        rig: Rig | str | Path | None = None,
        *,
        sharing: Mapping[str, str] | None = None,
        columns: Mapping[str, Sequence[str]] | None = None,
    ) -> None:
        if isinstance(logs, str | Path | Log | ContactSeries):
            logs = [logs]
        expect(logs, Sequence, "logs of a campaign", "paths, or logs that were read", "give them as a list")
        for log in logs:
            expect(log, (str, Path, Log, ContactSeries), "a log", "a path, or a log that was read", "read it first")
        paths = [Path(log) for log in logs if isinstance(log, str | Path)]
        if paths and len(paths) < len(logs):
            raise InputError("paths and logs in one campaign", "one of them", "read all logs, or none")
        ways: dict[str, str] = {}
        if paths:
            found, ways = sources(paths, Path(rig) if isinstance(rig, str | Path) else None)
            refuse_copies([source.path for source in found])
            self._members = _of_files(found, rig if isinstance(rig, Rig) else None)
        else:
            known = Rig.load(rig) if isinstance(rig, str | Path) else rig
            self._members = _of_data([log for log in logs if not isinstance(log, str | Path)], known)
        if not self._members:
            raise InputError("a campaign without logs", "logs", "name files, folders or a campaign.toml")
        for column, values in (columns or {}).items():
            if len(values) != len(self._members):
                raise InputError(
                    f"{len(values)} values of column '{column}'", f"one for each of {len(self)} logs", "count them"
                )
        added = [{column: str(values[i]) for column, values in (columns or {}).items()} for i in range(len(self))]
        self._members = [Member(m.name, {**m.columns, **more}, m.rig, m.data) for m, more in zip(self._members, added)]
        self.sharing = ways | dict(sharing or {})
        self.elsewhere: Elsewhere | None = None

    @classmethod
    def of(cls, members: Sequence[Member], sharing: Mapping[str, str], elsewhere: Elsewhere | None = None) -> Campaign:
        """Of logs that are named and read in a way of their own.

        Args:
            members, sharing: the logs, and how parameters are shared. elsewhere: where their visits are worked out.
        """
        out = object.__new__(cls)
        out._members, out.sharing, out.elsewhere = list(members), dict(sharing), elsewhere
        return out

    def __len__(self) -> int:
        return len(self._members)

    def __repr__(self) -> str:
        many, more = f"{len(self)} log{'s' * (len(self) != 1)}", ", …" * (len(self) > 3)
        return f"<Campaign of {many}: {', '.join(self.names[:3])}{more}>"

    @property
    def names(self) -> list[str]:
        """Names of the logs, in order."""
        return [member.name for member in self._members]

    def fit(self, model: Model, *, progress: Progress = lambda _: None) -> PooledFit:
        """One model fitted to all logs.

        Args:
            model: what is fitted. progress: called with what is being done, in words.

        Raises:
            InputError: no log that can carry the model.
        """
        return fit_logs(model, self.logs(model), self.sharing_for(model), progress=progress, elsewhere=self.elsewhere)

    def compare(
        self, models: Sequence[Model], *, reference: str | None = None, progress: Progress = lambda _: None
    ) -> CampaignComparison:
        """Models side by side on blocks and on logs that their fits have not seen; see `campaign.compare`."""
        from kinid.campaign.compare import compare

        return compare(self, models, reference=reference, progress=progress)

    def diagnose(self, model: Model, *, max_effects: int = 8, progress: Progress = lambda _: None) -> CampaignDiagnosis:
        """Which effects the model lacks, over all logs and in each; see `campaign.diagnosis`."""
        from kinid.campaign.diagnosis import diagnose

        return diagnose(self, model, max_effects=max_effects, progress=progress)

    def logs(self, model: Model) -> list[PooledLog]:
        """The logs as a fit of this model takes them."""
        return [PooledLog(m.name, partial(m.experiment, model), m.rig, m.columns) for m in self._members]

    def sharing_for(self, model: Model) -> dict[str, str]:
        """What was asked of parameters that this model has; of others, other models of a comparison may have them."""
        ids = {effect.id for effect in model.effects}
        named = {given: way for given, way in self.sharing.items() if given.split(".", 1)[0].partition("[")[0] in ids}
        from kinid import effects

        for given in self.sharing:
            first = given.split(".", 1)[0].partition("[")[0]
            if first not in ids and first not in effects.catalogue():
                named[given] = self.sharing[given]
        return named


def _of_files(found: Sequence[Source], rig: Rig | None) -> list[Member]:
    rigs: dict[Path, Rig] = {}
    out = []
    for name, source in zip(names_of([source.path for source in found]), found):
        file = source.rig or source.path.parent / "rig.toml"
        if rig is None and file not in rigs:
            # a log that says everything itself needs no rig
            rigs[file] = Rig.load(file) if source.rig is not None or file.is_file() else Rig()
        own = rig or rigs[file]

        out.append(Member.of(name, source.columns, own, partial(_read, source.path, own)))
    return out


def _of_data(logs: Sequence[Data], rig: Rig | None) -> list[Member]:
    out = []
    _refuse_same(logs)
    for i, log in enumerate(logs):
        if not isinstance(log, Log | ContactSeries):
            raise InputError(
                f"{type(log).__name__} in a campaign", "paths, logs or contact series", "read it with kinid.read"
            )
        own = rig if isinstance(log, Log) or log.source is None else log.source[1]

        out.append(Member.of(f"log {i + 1}", {}, own or Rig(), partial(_given, log, own)))
    return out


def _refuse_same(logs: Sequence[Data]) -> None:
    """Refuse a log that is there twice, as files are (`refuse_copies`)."""
    seen: dict[bytes, int] = {}
    for i, log in enumerate(logs):
        if not isinstance(log, Log | ContactSeries):
            continue
        digest = hashlib.sha256()
        for name, column in log.columns().items():
            digest.update(name.encode())
            digest.update(np.ascontiguousarray(column).tobytes())
        first = seen.setdefault(digest.digest(), i)
        if first != i:
            raise InputError(
                f"the same log twice, as numbers {first + 1} and {i + 1} of the campaign",
                "each log once: counted twice, it makes intervals too narrow",
                "leave one of them out",
            )


def _read(path: Path, rig: Rig) -> tuple[Data, Rig | None]:
    return read(path, rig), rig


def _given(log: Data, rig: Rig | None) -> tuple[Data, Rig | None]:
    return log, rig if isinstance(log, Log) else None


def _columns(rig: Rig) -> dict[str, str]:
    """What a rig says that logs may be grouped by."""
    out = {}
    if rig.robot is not None:
        out["robot"] = rig.robot.model
    if rig.tool is not None:
        out["tool"] = f"{rig.tool.mass:g} kg"
    return out


def _key(rig: Rig) -> str:
    """What rigs of one calibration have in common: all but where the surface is."""
    return rig.model_dump_json(exclude={"surface", "folder", "columns", "streams"})
