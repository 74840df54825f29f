"""Writes docs/licences.md: what the locked packages are licensed under, by what they say of themselves.

`python docs/licences.py docs/licences.md` in the environment of the tests, after a change of a lock file.
"""

from __future__ import annotations

import json
import re
import sys
import tomllib
from importlib.metadata import PackageNotFoundError, metadata
from pathlib import Path

from packaging.markers import Marker
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

ROOT = Path(__file__).parent.parent
#: what packages call their licence, where that isn't its SPDX name
NAMES = {
    "Apache 2.0": "Apache-2.0",
    "Apache License 2.0": "Apache-2.0",
    "Apache Software License": "Apache-2.0",
    "BSD": "BSD-3-Clause",
    "BSD 2-Clause License": "BSD-2-Clause",
    "BSD License": "BSD-3-Clause",
    "GNU Lesser General Public License v3 or later (LGPLv3+)": "LGPL-3.0-or-later",
    "ISC License (ISCL)": "ISC",
    "ISC License": "ISC",
    "ISC license": "ISC",
    "MIT License": "MIT",
    "Mozilla Public License 2.0 (MPL 2.0)": "MPL-2.0",
}
#: of those that don't say it, or say less than their licence files do, and of those that some systems don't install
READ = {
    "apsw": "Zlib",
    "backports-zstd": "PSF-2.0",
    "cmeel-qhull": "Qhull",
    "colorama": "BSD-3-Clause",
    "docutils": "BSD-2-Clause",
    "eclipse-zenoh": "Apache-2.0 OR EPL-2.0",
    "embreex": "BSD-2-Clause",
    "importlib-metadata": "Apache-2.0",
    "lazy-importer": "Apache-2.0",
    "ptyprocess": "ISC",
    "python-dateutil": "Apache-2.0 OR BSD-3-Clause",
    "scikit-fem": "BSD-3-Clause",
    "scipy": "BSD-3-Clause",
    "traitlets": "BSD-3-Clause",
    "trimesh": "MIT",
    "vhacdx": "MIT",
    "zipp": "MIT",
}
#: ask for no more than that their notices stay
PERMISSIVE = {"0BSD", "Apache-2.0", "BSD-2-Clause", "BSD-3-Clause", "BSL-1.0", "CC0-1.0", "ISC", "LLVM-exception"} | {
    *("MIT", "MIT-0", "MIT-CMU", "PSF-2.0", "Qhull", "Zlib")
}
#: ask that their own files stay free, which they do: each is installed by itself, unchanged, and can be replaced
OF_THEIR_OWN_FILES = {"LGPL-3.0-or-later", "MPL-2.0", "EPL-2.0"}
GROUPS = ("bags", "batch", "live", "vision", "docs", "test")
#: without a release for three years: version, month of it, and why it stays
OLD = {
    "colorama": ("0.4.6", "2022-10", "colours on Windows, for pytest and click; complete, and not installed elsewhere"),
    "locket": ("1.0.0", "2022-04", "locks of files, for partd of dask; complete"),
    "mdurl": ("0.1.2", "2022-08", "links of Markdown, for rich and the site; complete"),
    "meshcat": ("0.3.2", "2021-11", "only its JavaScript is used, in kinid's own pages; no server of it runs"),
    "ptyprocess": ("0.7.0", "2020-12", "for pexpect of IPython, which meshcat asks for; kinid doesn't load it"),
    "shellingham": ("1.5.4", "2023-10", "tells the shell, for typer's completion; complete"),
    "sortedcontainers": ("2.4.0", "2021-05", "for distributed and hypothesis; complete, in plain Python"),
    "sphinx-basic-ng": ("1.0.0b2", "2023-07", "base of the site's theme, furo, which pins it"),
    "stack-data": ("0.6.3", "2023-09", "tracebacks of IPython, which meshcat asks for; kinid doesn't load it"),
    "u-msgpack-python": ("2.8.0", "2023-05", "messages of meshcat; complete, in plain Python"),
    "zict": ("3.0.0", "2023-04", "mappings of distributed; complete, in plain Python"),
}  # fmt: skip
#: of requirements/mcap-cli.lock, as its packages say it
APART = {
    "cyclopts": "Apache-2.0",
    "docstring-parser": "MIT",
    "mcap-ros2-support-fast": "GPL-3.0",
    "platformdirs": "MIT",
    "pymcap-cli": "GPL-3.0",
    "rich-rst": "MIT",
    "ros-parser": "GPL-3.0",
    "small-mcap": "GPL-3.0",
}
HEAD = """\
# Licences

kinid is under the BSD-3-Clause licence. What `requirements/test.lock` pins, extras and tools of the tests included, is
listed here by what the packages say of themselves, and where they don't by their licence files. `docs/licences.py`
writes this page; a test fails where it isn't what that would write now, or where a licence is neither of the two kinds
below.

- {permissive}: permissive. They ask that their notices stay.
- {own}: they ask that their own files stay free. kinid holds none of these files: each such package is
  installed by itself, unchanged, and can be replaced. {users}.

A package of several parts names the licences of all (`AND`); of several to choose from, `OR`.

## Without a release for three years

By the month in which the registry got the version that is pinned, looked up in November 2026.

| package | version | month | why it stays |
|---|---|---|---|
{old}

## Apart from kinid

Foxglove's client library and readers of MCAP, which tests of live sessions run as programs on what kinid serves and
records. `make counterparts` installs them, each in a folder of its own. kinid neither imports nor holds any of it and
needs none of it; those tests skip by name without it.

| package | licence | from |
|---|---|---|
{apart}

## All

`for` is the first that needs it: kinid itself, else an extra.

| package | licence | for |
|---|---|---|
{rows}
"""


def locked(of: str = "test") -> dict[str, str]:
    """Versions that a lock pins, that of the tests' environment or another, by name."""
    lock = (ROOT / "requirements" / f"{of}.lock").read_text(encoding="utf-8")
    return {canonicalize_name(name): version for name, version in re.findall(r"^([\w.\-]+)==([^\s;]+)", lock, re.M)}


def licence(name: str) -> str:
    """What a package is under, by SPDX names joined with AND and OR.

    Raises:
        ValueError: it doesn't say, and nobody has looked.
    """
    if name in READ:
        return READ[name]
    try:
        said = metadata(name)
    except PackageNotFoundError:
        raise ValueError(f"{name} isn't installed: add it to READ") from None
    kinds = [c.split(" :: ")[-1] for c in said.get_all("Classifier") or () if c.startswith("License ::")]
    texts = [text for text in (said.get("License-Expression"), said.get("License"), *kinds) if text]
    for text in texts:
        if _terms(found := NAMES.get(text, text)) <= PERMISSIVE | OF_THEIR_OWN_FILES:
            return found
    raise ValueError(f"{name} says {', '.join(texts) or 'nothing'}: read its licence file, add it to READ")


def apart() -> dict[str, tuple[str, str]]:
    """Licence and registry of what tests run as programs, by name.

    Raises:
        ValueError: a licence that nobody has looked at, or one of JavaScript that asks for more.
    """
    names = set(locked("mcap-cli"))
    if names != set(APART):
        raise ValueError(f"{', '.join(sorted(names ^ set(APART)))}: look at their licences, mend APART")
    out = {name: (APART[name], "PyPI") for name in sorted(names)}
    lock = ROOT / "tests" / "live" / "foxglove_client" / "package-lock.json"
    for path, entry in json.loads(lock.read_text(encoding="utf-8"))["packages"].items():
        name, under = path.removeprefix("node_modules/"), entry.get("license", "nothing")
        if not name:  # the folder itself
            continue
        if not _terms(under) <= PERMISSIVE:
            raise ValueError(f"{name} of npm says {under}")
        out[name] = (under, "npm")
    return out


def _terms(expression: str) -> set[str]:
    return set(re.findall(r"[\w.\-]+", expression)) - {"AND", "OR", "WITH"}


def needed_by(names: set[str]) -> dict[str, str]:
    """For each package what asks for it first: kinid, an extra, or the build."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    out: dict[str, str] = {}
    asked = [("kinid", project["dependencies"]), *((g, project["optional-dependencies"][g]) for g in GROUPS)]
    for group, requirements in asked:
        waiting = [Requirement(text) for text in requirements]
        while waiting:
            one = waiting.pop()
            name = canonicalize_name(one.name)
            if name not in names or (name in out and not one.extras):
                continue
            out.setdefault(name, group)
            waiting += _requires(name, one.extras)
    return {name: out.get(name, "build") for name in names}


def _requires(name: str, extras: set[str]) -> list[Requirement]:
    """What a package asks for on any system, with some of its extras."""
    try:
        texts = metadata(name).get_all("Requires-Dist") or ()
    except PackageNotFoundError:
        return []
    chosen = {"", *extras}
    return [one for one in map(Requirement, texts) if _applies(one.marker, chosen)]


def _applies(marker: Marker | None, extras: set[str]) -> bool:
    """Whether a requirement is of one of the extras, or of none, whatever the system."""
    return marker is None or "extra" not in str(marker) or any(marker.evaluate({"extra": e}) for e in extras)


def page() -> str:
    """The page as it is now."""
    names = locked()
    under = {name: licence(name) for name in sorted(names)}
    groups = needed_by(set(names))
    users = {kind: [n for n, text in under.items() if kind in _terms(text)] for kind in sorted(OF_THEIR_OWN_FILES)}
    return HEAD.format(
        permissive=", ".join(sorted(PERMISSIVE)),
        own=", ".join(sorted(OF_THEIR_OWN_FILES)),
        users="; ".join(f"{kind}: {', '.join(which)}" for kind, which in users.items() if which),
        old="\n".join(f"| {name} | {version} | {month} | {why} |" for name, (version, month, why) in OLD.items()),
        apart="\n".join(f"| {name} | {text} | {registry} |" for name, (text, registry) in apart().items()),
        rows="\n".join(f"| {name} | {text} | {groups[name]} |" for name, text in under.items()),
    )


if __name__ == "__main__":
    Path(sys.argv[1]).write_text(page(), encoding="utf-8")
