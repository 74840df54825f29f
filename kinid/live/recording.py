"""A session on disk as MCAP, which holds all but the last moments whatever becomes of the program.

Everything that waits is written, with the end that makes a file whole, in one go every `sink.FLUSH` seconds; the next
go writes over that end (`kinid.live.container`). So the file can be read at any moment, and a program that is killed
has lost no more than that time. What is read again is what was used: samples that were left out stand on a topic of
their own, with the reason.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path

from kinid.errors import InputError, MissingDependencyError
from kinid.live.container import Container, GrowingFile
from kinid.live.encoding import Coder
from kinid.live.messages import Joints, Wrench
from kinid.live.sink import Sink
from kinid.writers import Json


class Recorder(Sink):
    """Writes a session.

    Args:
        path: of the file, which is replaced.
        joints: names of the robot's joints. sensor: frame of the wrench.
        provenance: what is to be known of the session: source, model, rig, …; plain types.
        epoch: from the clock of times of reception to that of log times [ns].

    Raises:
        MissingDependencyError: no library for MCAP. InputError: a file that can't be written.
    """

    def __init__(
        self, path: Path, joints: Sequence[str], sensor: str, provenance: Mapping[str, object], epoch: int = 0
    ) -> None:
        try:
            import mcap.records  # noqa: F401
        except ImportError:
            raise MissingDependencyError("mcap", "live") from None
        super().__init__("recorder")
        self._coder, self.path, self._epoch = Coder(joints, sensor), path, epoch
        self._first = self._last = self._held = 0
        try:
            self._file = GrowingFile(path)
        except OSError as error:
            raise _unwritable(path, error) from None
        known = {key: _plain(value) for key, value in provenance.items()}
        self._container = Container(self._file, self._coder.channels, known)
        try:
            self._file.commit()
        except OSError as error:  # nothing of it is there yet
            path.unlink(missing_ok=True)
            raise _unwritable(path, error) from None
        self._thread.start()

    def close(self) -> None:
        """Write what waits, and the summary."""
        super().close()
        if not self.error:
            try:
                self._container.finish()
            except OSError as error:  # without its summary the file is whole
                self.error = str(error)

    def _write(self, topic: str, received: int, stamp: int, what: Joints | Wrench | Json) -> None:
        self._container.add(topic, received + self._epoch, stamp, self._coder(stamp, what))
        self._first, self._last = self._first or stamp, max(self._last, stamp)

    def _commit(self) -> None:
        try:
            self._file.commit()
        except OSError as error:  # what was written in goes before is whole
            raise OSError(f"{error}; the file holds the first {1e-9 * self._held:.2f} s") from None
        self._held = self._last - self._first


def _unwritable(path: Path, error: OSError) -> InputError:
    expected, mend = "a folder with room that can be written", "choose another --record"
    return InputError(f"no way to write {path} ({error.strerror})", expected, mend)


def _plain(value: object) -> str:
    return value if isinstance(value, str) else json.dumps(value, default=str)
