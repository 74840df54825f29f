"""Random changes of sound inputs: bytes, text, trees of lists and tables, columns of numbers, words of a command."""

from __future__ import annotations

import copy
import re
from collections.abc import Callable, Sequence
from random import Random
from typing import Any

import numpy as np

#: what stands in place of a value, in text
ODD_WORDS = (
    "", "nan", "inf", "-inf", "1e300", "-1e300", "1e-320", "0", "-1", "1e", "9" * 400, "0x10", "true", "null", "[]",
    "{}", '"', "'", "text", "größe", "\u202e\u0000", "😀", "/dev/null", "..", "../../etc/passwd", "%s%n", "a" * 5000,
    "1,5", "=",
)  # fmt: skip
#: the same, as a value of JSON or TOML
ODD_VALUES: tuple[Any, ...] = (
    None, True, 0, -1, 1, 10**400, 2**63, 1e300, -1e300, 5e-324, float("nan"), float("inf"), "", "text", "größe\n😀",
    "\x00", "../../etc/passwd", [], {}, [None], [[]], [1, 2, 3], [0.0] * 3, [1e308] * 3, [float("nan")] * 6,
    {"a": 1}, list(range(40)),
)  # fmt: skip
ODD_NUMBERS = (np.nan, np.inf, -np.inf, 1e300, -1e300, 5e-324, 0.0, -1.0, 1e10)
_TOKEN = re.compile(r"[\w.+\-]+")


def change_bytes(rng: Random, data: bytes) -> bytes:
    """One to four of: bytes overwritten, cut out, doubled or put in, the end cut off."""
    out = bytearray(data)
    for _ in range(rng.choice((1, 1, 1, 2, 3))):
        at, size = rng.randrange(len(out) + 1), rng.choice((1, 1, 2, 4, 16, 200))
        how = rng.randrange(6)
        if how <= 1:
            out[at : at + size] = rng.randbytes(min(size, len(out) - at))
        elif how == 2:
            del out[at : at + size]
        elif how == 3:
            out[at:at] = out[at : at + size]
        elif how == 4:
            out[at : at + size] = rng.choice((b"\x00", b"\xff", b"\x7f")) * min(size, len(out) - at)
        else:
            del out[at:]
    return bytes(out)


def change_text(rng: Random, text: str) -> str:
    """One to three of: a word replaced, lines cut, doubled, exchanged or emptied, a line within another."""
    for _ in range(rng.choice((1, 1, 1, 2, 3))):
        how, lines = rng.randrange(6), text.split("\n")
        at, other = rng.randrange(len(lines)), rng.randrange(len(lines))
        if how <= 2 and (tokens := list(_TOKEN.finditer(text))):
            token = rng.choice(tokens)
            text = text[: token.start()] + rng.choice(ODD_WORDS) + text[token.end() :]
            continue
        if how == 3:
            del lines[at]
        elif how == 4:
            lines.insert(at, lines[other])
        else:
            lines[at], lines[other] = lines[other], lines[at]
        text = "\n".join(lines)
    return text


def change_tree(rng: Random, tree: Any) -> Any:
    """One to three values of lists and tables within each other replaced, removed, renamed, nested or lengthened."""
    out = copy.deepcopy(tree)
    for _ in range(rng.choice((1, 1, 1, 2, 3))):
        places = list(_places(out))
        if not places:
            return out
        owner, key = rng.choice(places)
        how = rng.randrange(7)
        if how <= 2:
            owner[key] = copy.deepcopy(rng.choice(ODD_VALUES))
        elif how == 3:
            del owner[key]
        elif how == 4:
            owner[key] = [owner[key]] if rng.random() < 0.5 else {"value": owner[key]}
        elif isinstance(owner, dict):
            owner[rng.choice((key + "x", key.upper(), "", "größe", "a.b"))] = owner.pop(key)
        else:
            owner.append(owner[key])
    return out


def _places(tree: Any) -> Any:
    """Each value within, as its owner and its key there."""
    for key in list(tree) if isinstance(tree, dict) else range(len(tree)):
        yield tree, key
        if isinstance(tree[key], dict | list):
            yield from _places(tree[key])


def change_columns(rng: Random, columns: dict[str, Any]) -> dict[str, Any]:
    """One to three columns with odd values, of another type or shape or length, renamed, or gone."""
    out = {name: np.array(values) for name, values in columns.items()}
    for _ in range(rng.choice((1, 1, 1, 2, 3))):
        if not out:
            return out
        name = rng.choice(list(out))
        values, how = np.atleast_1d(out[name]), rng.randrange(9)
        if how <= 2:
            values = values.astype(float) if values.dtype.kind in "fiub" else values
            odd = rng.choice(ODD_NUMBERS) if values.dtype.kind == "f" else rng.choice(ODD_WORDS)
            some = slice(*sorted((rng.randrange(len(values) + 1), rng.randrange(len(values) + 1))))
            values = values.astype(object if values.dtype.kind != "f" else float)
            values[some] = odd
            out[name] = values if values.dtype.kind == "f" else values.astype(str)
        elif how == 3:
            out[rng.choice((name + "x", "t", "q1", "fx", "", "größe", "depth", "q12"))] = out.pop(name)
        elif how == 4:
            del out[name]
        elif how == 5:
            out[name] = np.resize(values, rng.choice((0, 1, 2, max(0, len(values) - 1), len(values) + 1)))
        elif how == 6:
            out[name] = values.astype(rng.choice(("str", "bool" if values.dtype.kind == "f" else "str")))
        elif how == 7:
            out[name] = rng.choice(
                (np.zeros((len(values), 2)), np.zeros((len(values), 0)), np.zeros((2, 2, 2)), np.zeros(()))
            )
        else:
            out = {key: np.atleast_1d(whole)[: rng.choice((0, 1, 2, 5))] for key, whole in out.items()}
    return out


def change_words(rng: Random, words: Sequence[str]) -> list[str]:
    """One to three words of a command line replaced, cut out, doubled or exchanged; the command's name stays."""
    out = list(words)
    for _ in range(rng.choice((1, 1, 1, 2, 3))):
        if len(out) < 2:
            break
        at, other = rng.randrange(1, len(out)), rng.randrange(1, len(out))
        how = rng.randrange(5)
        if how <= 1:
            out[at] = rng.choice(ODD_WORDS)
        elif how == 2:
            del out[at]
        elif how == 3:
            out.insert(at, out[other])
        else:
            out[at], out[other] = out[other], out[at]
    return [word.replace("\x00", "") for word in out]  # no shell hands over a zero byte


def either(*ways: Callable[[Random], bytes]) -> Callable[[Random], bytes]:
    """One of several ways to change an input, by lot."""
    return lambda rng: rng.choice(ways)(rng)
