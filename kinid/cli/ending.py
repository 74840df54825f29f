"""How a command ends: its exit code, and one line on stderr for whatever went wrong, foreseen or not."""

from __future__ import annotations

import contextlib
import errno
import os
import platform
import shlex
import signal
import sys
import tempfile
import traceback
from collections.abc import Callable, Sequence
from typing import Any

from kinid.cli.advice import EFFECTS, filled
from kinid.errors import KinidError

#: bad input; an error that nobody foresaw (EX_SOFTWARE of sysexits.h); stopped by the user or by a supervisor; the
#: reader of the output has gone, as a shell says of a program that SIGPIPE ended
BAD_INPUT, UNFORESEEN, STOPPED, READER_GONE = 2, 70, 130, 141
#: what a stream says that takes no more: full, too large, beyond a quota, broken, not open for writing
REFUSED_OUTPUT = (errno.ENOSPC, errno.EFBIG, errno.EDQUOT, errno.EIO, errno.EBADF)
#: set by a shell that asks what a word can be completed to; the answer ends the process
COMPLETION = "_KINID_COMPLETE"
#: options of the library that write what a shell needs
SHELLS = {"--show-completion", "--install-completion"}
#: characters of a file's name that are shown
LONGEST_NAME = 100
#: names of modules that hold effects of the user's own begin so, see `kinid.effects`
OWN_EFFECTS = "kinid_effects_"
#: parsers of text, which go as deep as the text does
PARSERS = ("json", "tomllib")
TOO_LARGE = "found input that needs more memory than there is; expected what fits; to mend it, give a part of it"
TOO_DEEP = "found text nested too deeply to be read; expected a rig, a fit or a log; to mend it, name another file"


def ended(command: Callable[[], int | None], words: Sequence[str], version: str) -> int:
    """Run a command, and say in one line what stopped it; its exit code.

    Args:
        command: what to run; its result is an exit code, or None for 0. words: of the command line, for a report.
        version: of kinid, for a report.
    """
    if hasattr(signal, "SIGTERM"):
        signal.signal(signal.SIGTERM, _stop)
    _make_streams_lenient()
    try:
        code = command()
        # what is still in the buffer may find its reader gone
        sys.stdout.flush()
        if code == STOPPED:  # typer has caught Ctrl-C
            _say("stopped; nothing was left half-written")
        return int(code or 0)
    except BaseException as error:
        if isinstance(error, SystemExit):
            if COMPLETION in os.environ:
                raise
            if not error.code and SHELLS.intersection(words):  # the library has printed, and ends the process
                return 0
            # the libraries that print end a program whose reader has gone
            error = error.__context__ if isinstance(error.__context__, BrokenPipeError) else error
        return _exit_code(error, words, version)


def _make_streams_lenient() -> None:
    """Standard streams show a sign in place of one that their encoding lacks; those that are closed become nowhere."""
    for name in ("stdin", "stdout", "stderr"):
        stream = getattr(sys, name)
        if stream is None:
            setattr(sys, name, open(os.devnull, "r" if name == "stdin" else "w", encoding="utf-8"))  # noqa: SIM115
        elif name == "stdout" and hasattr(stream, "reconfigure"):
            with contextlib.suppress(OSError, ValueError):  # it flushes what a caller has left, which may fail
                stream.reconfigure(errors="replace")


def _exit_code(error: BaseException, words: Sequence[str], version: str) -> int:
    """One line about what ended a command, and its exit code."""
    if isinstance(error, BrokenPipeError):  # the reader of a pipe has gone: nobody is left to tell
        _let_go_of_output()
        code = READER_GONE
    elif isinstance(error, KeyboardInterrupt) or type(error).__name__ == "Abort":  # typer's word for Ctrl-C
        code = _say("stopped; nothing was left half-written", STOPPED)
    elif isinstance(error, KinidError):
        code = _say(filled(str(error), words), BAD_INPUT)
    elif isinstance(error, MemoryError):
        code = _say(TOO_LARGE, BAD_INPUT)
    elif isinstance(error, RecursionError) and _in_parser(error):
        code = _say(TOO_DEEP, BAD_INPUT)
    elif own := _of_an_own_effect(error):
        code = _say(own, BAD_INPUT)
    elif isinstance(error, OSError) and (found := _of_a_file(error)):
        code = _say(found, BAD_INPUT)
    elif hasattr(error, "format_message") and hasattr(error, "exit_code"):
        code = _misused(error)
    else:
        code = _unforeseen(error, words, version)
    return code


def _of_a_file(error: OSError) -> str:
    """What to say where the system refuses a file that a user named, or the output; "" where it is about neither."""
    if error.filename is not None and error.strerror:
        name = os.fsdecode(error.filename) if isinstance(error.filename, bytes) else str(error.filename)
        shown = name if len(name) <= LONGEST_NAME else f"{name[:LONGEST_NAME]}…"
        found = f"found {shown} ({error.strerror}); expected a file or a folder that can be used"
        return f"{found}; to mend it, check its name and its permissions"
    if isinstance(error, FileNotFoundError) and _is_nowhere():
        return "found no working folder: it has been removed; expected one; to mend it, change to another folder"
    if error.errno in REFUSED_OUTPUT:
        _let_go_of_output()
        found = f"found an output that can't be written to ({error.strerror}); expected room for what is printed"
        return (
            f"{found}, and for temporary files and compiled code; to mend it, make room, or name other places for them"
        )
    return ""


def _is_nowhere() -> bool:
    """Whether the folder that the command was started in has been removed."""
    try:
        os.getcwd()
    except FileNotFoundError:
        return True
    return False


def _stop(*_: object) -> None:
    """SIGTERM ends a command as Ctrl-C does, so that what it was writing is removed."""
    raise KeyboardInterrupt


def _misused(error: Any) -> int:
    """Wrong use of options, whichever command-line library typer carries: it knows its message and its exit code."""
    context = getattr(error, "ctx", None)
    if type(error).__name__ == "NoArgsIsHelpError" and context is not None:
        print(context.get_help(), file=sys.stderr)
        return BAD_INPUT
    where = f"{context.command_path} --help" if context is not None else "kinid --help"
    return _say(f"{error.format_message()} See '{where}'.", BAD_INPUT)


def _in_parser(error: BaseException) -> bool:
    frames = [frame for frame, _ in traceback.walk_tb(error.__traceback__)]
    return bool(frames) and str(frames[-1].f_globals.get("__name__", "")).split(".")[0] in PARSERS


def _of_an_own_effect(error: BaseException) -> str:
    """What to say where the code of an effect of the user's own raised it; "" elsewhere."""
    places = [
        (frame.f_code.co_filename, line)
        for frame, line in traceback.walk_tb(error.__traceback__)
        if str(frame.f_globals.get("__name__", "")).startswith(OWN_EFFECTS)
    ]
    if not places:
        return ""
    said = f"{type(error).__name__}: {str(error)[:LONGEST_NAME]}".removesuffix(": ")
    file, line = places[-1]
    return (
        f"found an effect of your own that fails, {file}, line {line} ({said}); expected a law that computes; to mend "
        f"it, correct it there, and see what kinid effect check {shlex.quote(file)} says"
    )


def _unforeseen(error: BaseException, words: Sequence[str], version: str) -> int:
    """The traceback goes into a file that only its user can read, and a line says where that is."""
    report = (
        f"kinid {version}, Python {platform.python_version()}, {platform.platform()}\n"
        f"{shlex.join(['kinid', *words])}\n\n{''.join(traceback.format_exception(error))}"
    )
    summary = f"{type(error).__name__}: {str(error)[:200]}" if str(error) else type(error).__name__
    try:
        handle, path = tempfile.mkstemp(prefix="kinid-error-", suffix=".txt")
        with os.fdopen(handle, "w", encoding="utf-8", errors="backslashreplace") as file:
            file.write(report)
        where = f"please report it with {path}, which holds the traceback"
    except OSError:
        where = "please report it; there was no way to write its traceback to a file"
    own = [str(module.__file__) for name, module in sys.modules.items() if name.startswith(OWN_EFFECTS)]
    if own and os.environ.get(EFFECTS):  # what breaks the contract of effects may fail anywhere beside it
        checks = " and ".join(f"kinid effect check {shlex.quote(file)}" for file in own[:3])
        found = f"found an error beside effects of your own ({summary}); expected effects that keep the contract"
        return _say(f"{found}; to mend it, see what {checks} finds; where that is nothing, {where}", BAD_INPUT)
    return _say(f"an error that was not foreseen: {summary}; {where}", UNFORESEEN)


def _let_go_of_output() -> None:
    """Neither a flush at exit nor a late remark may meet the closed pipe again."""
    nowhere = os.open(os.devnull, os.O_WRONLY)
    for stream in (sys.stdout, sys.stderr):
        try:
            stream.flush()
        except (OSError, ValueError):
            try:
                os.dup2(nowhere, stream.fileno())
            except (OSError, ValueError):  # no file behind it, as in a test
                continue


def _say(message: str, code: int = STOPPED) -> int:
    """One line on stderr, also of names that no encoding holds; the code, to go on with."""
    line = f"kinid: {' '.join(message.split())}"
    try:
        print(line.encode("utf-8", "backslashreplace").decode("utf-8"), file=sys.stderr)
    except OSError:
        _let_go_of_output()
    return code
