"""What a URDF from somewhere may not do: expand entities, or have files opened outside the robot's folder."""

from __future__ import annotations

import os
import re
from pathlib import Path
from urllib.parse import unquote
from xml.parsers import expat

from kinid.errors import InputError
from kinid.inputs import raised, size_limit
from kinid.urdf.contents import Contents

#: of a URDF: without its meshes it is a text of some hundred kB
MOST_BYTES, MOST_LEVELS = 20_000_000, 100

_PACKAGE = ("package://", "model://")  # resolved by the loader inside the folder of that package
_SCHEME = re.compile(r"[A-Za-z][A-Za-z0-9+.-]+:")  # two letters and more: "C:" is a drive


def check(path: Path) -> None:
    """Refuse a URDF that is broken or unsafe, before another parser sees it. Nothing is expanded or fetched.

    The robot's own folder, which mesh and texture files must not leave, is the URDF's, or its parent where
    the URDF lies in a folder named `urdf` or `robots`.

    Raises:
        InputError: not readable, not (complete) XML, not a `<robot>`, a DOCTYPE or entity, an unexpanded
            xacro, a mesh outside the robot's folder, more links or joints than a robot has, or numbers that no body
            and no axis can have.
    """
    _Reader(path).read()


class _Reader:
    """One pass of expat over one file. Its handlers raise, and expat stops at the first offence."""

    def __init__(self, path: Path) -> None:
        self.path = path
        folder = Path(os.path.realpath(path)).parent  # Path.resolve fails on a loop of links
        self.near = folder  # what relative mesh files are relative to
        self.folder = folder.parent if folder.name in ("urdf", "robots") else folder
        self.tags: list[str] = []
        self.contents = Contents(str(path))
        self.parser = expat.ParserCreate()
        self.parser.StartDoctypeDeclHandler = self._doctype
        self.parser.EntityDeclHandler = self._doctype
        self.parser.StartElementHandler = self._start
        self.parser.EndElementHandler = self._end

    def read(self) -> None:
        if self.path.suffix.lower() == ".xacro":
            raise self._xacro("")
        try:
            if not os.path.isfile(self.path):  # nothing, or a folder, a device, a pipe
                raise InputError(f"no file at {self.path}", "a URDF file", "correct the path")
            if (size := self.path.stat().st_size) > (most := size_limit(MOST_BYTES)):
                found, mend = f"{size / 1e6:.3g} MB in {self.path}", f"name another file, {raised(size, MOST_BYTES)}"
                raise InputError(found, f"a URDF of {most / 1e6:.3g} MB at most", mend)
            data = self.path.read_bytes()
        except OSError as error:
            raise InputError(
                f"no readable file at {self.path} ({error.strerror})",
                "a URDF file",
                "correct the path or its permissions",
            ) from None
        try:
            self.parser.Parse(data, True)
            self.contents.end()
        except (expat.ExpatError, ValueError, LookupError) as error:  # the latter two: an unknown encoding
            raise InputError(
                f"{self.path}: {error}", "a complete URDF, which is XML", "restore the file, it may be truncated"
            ) from None

    def _doctype(self, *_: object) -> None:
        raise InputError(
            f"a DOCTYPE or entity {self._where()}",
            "a URDF without document types and entities",
            "remove the <!DOCTYPE …> block and write its values out",
        )

    def _start(self, tag: str, attributes: dict[str, str]) -> None:
        if tag.startswith("xacro:"):
            raise self._xacro(f"<{tag}> ")
        if not self.tags and tag != "robot":
            raise InputError(
                f"<{tag}> as the root {self._where()}", "<robot>", "name a URDF file (SDF and MJCF are other formats)"
            )
        self.tags.append(tag)
        if len(self.tags) > MOST_LEVELS:
            raise InputError(
                f"elements nested more than {MOST_LEVELS} levels deep {self._where()}", "a URDF", "name another file"
            )
        for value in attributes.values():
            if "${" in value:
                raise self._xacro(f"'{value}' ")
        self.contents.start(tuple(self.tags), attributes, self.parser.CurrentLineNumber)
        if tag in ("mesh", "texture") and (name := attributes.get("filename")):
            self._inside(name)

    def _end(self, _: str) -> None:
        self.contents.close(tuple(self.tags), self.parser.CurrentLineNumber)
        self.tags.pop()

    def _inside(self, name: str) -> None:
        """Refuse a file name that leaves the robot's folder, however it is spelt."""
        spelt = unquote(name.strip()).replace("\\", "/")
        if spelt.startswith(_PACKAGE):
            parts = spelt.split("/")[2:]
            outside = ".." in parts or not parts[0]
        else:
            spelt = re.sub("^file:(//)?", "", spelt)
            target = Path(os.path.realpath(self.near / spelt))
            outside = bool(_SCHEME.match(spelt)) or not target.is_relative_to(self.folder)
        if outside:
            raise InputError(
                f"the file '{name}' {self._where()}",
                f"meshes within {self.folder}, or package:// without '..'",
                "copy the mesh there and write a relative path",
            )

    def _xacro(self, what: str) -> InputError:
        return InputError(
            f"an unexpanded xacro, {what}{self._where()}",
            "a URDF file",
            "expand it first: xacro robot.urdf.xacro > robot.urdf",
        )

    def _where(self) -> str:
        line = self.parser.CurrentLineNumber
        return f"in {self.path}, line {line}" if self.tags or line > 1 else f"in {self.path}"
