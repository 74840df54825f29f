"""The one exception root. Whoever calls kinid catches `KinidError`; the command line turns it into one line, exit 2."""

from __future__ import annotations

import difflib
from collections.abc import Iterable, Mapping
from pathlib import PurePath

#: characters of a word that a message repeats, at most; of a part of it, twice as many
LONGEST = 600


class KinidError(Exception):
    """Root of every error that kinid raises on purpose."""


class InputError(KinidError):
    """Something a user gave can't be used: what was found, what was expected, how to mend it, in one line.

    Args:
        found: what is there, with the place (file, row, column).
        expected: what kinid needs.
        mend: the next thing to do.
    """

    def __init__(self, found: str, expected: str, mend: str) -> None:
        self.found, self.expected, self.mend = (
            shortened(" ".join(map(shortened, part.split())), 2 * LONGEST) for part in (found, expected, mend)
        )
        super().__init__(f"found {self.found}; expected {self.expected}; to mend it, {self.mend}")


def shortened(text: str, most: int = LONGEST) -> str:
    """A text without its middle, where it is longer than so many characters."""
    return text if len(text) <= most else f"{text[: most // 2]} … {text[-most // 2 :]}"


class MissingDependencyError(KinidError):
    """A library of an optional extra is not installed."""

    def __init__(self, library: str, extra: str) -> None:
        super().__init__(f"found no {library}; expected it for this format; to mend it, pip install 'kinid[{extra}]'")


def expect(value: object, kinds: type | tuple[type, ...], what: str, expected: str, mend: str) -> None:
    """Refuse an argument of another type.

    Args:
        value: as given. kinds: that it may be of. what: it is for. expected, mend: of the message.

    Raises:
        InputError: another type.
    """
    if not isinstance(value, kinds):
        shown = f" {value!r}" if isinstance(value, str | int | float) and len(repr(value)) < 60 else ""
        raise InputError(f"{type(value).__name__}{shown} for {what}", expected, mend)


def check_name(path: PurePath) -> None:
    """Refuse a name of a table that is no UTF-8: Arrow takes no other.

    Raises:
        InputError: the name.
    """
    try:
        str(path).encode()
    except UnicodeEncodeError:
        shown = str(path).encode(errors="backslashreplace").decode()[:200]
        raise InputError(
            f"the name {shown}, which is no UTF-8", "a name in UTF-8", "rename the file or its folder"
        ) from None


def near(name: str, valid: Iterable[str], limit: int = 12, also: Mapping[str, str] | None = None) -> str:
    """A list of valid names for a message: the near ones first, all of them when they are few.

    Args:
        limit: of names that aren't near. also: other words for valid names; asked for where no name is near.
    """
    names = sorted(set(valid))
    turned = {_in_order(n): n for n in names}  # anisotropic-friction means friction-anisotropy
    close = [n for n in names if n.lower() == name.lower()]
    close = close or [turned[n] for n in difflib.get_close_matches(_in_order(name), turned, n=3, cutoff=0.8)]
    close = close or difflib.get_close_matches(name, names, n=3, cutoff=0.52)
    close = close or [n for n in names if len(name) > 2 and name in n][:3]
    close = close or [n for n, words in (also or {}).items() if len(name) > 2 and name.lower() in words.lower()][:3]
    if close:
        return "did you mean " + " or ".join(f"'{c}'" for c in close) + "?"
    shown = ", ".join(f"'{n}'" for n in names[:limit])
    return f"valid names: {shown}" + (", …" if len(names) > limit else "")


def _in_order(name: str) -> str:
    """The words of a name in the order of the alphabet."""
    return "-".join(sorted(name.replace("_", "-").split("-")))
