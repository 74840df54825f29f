"""The command line in a process of its own: `kinid` and `python -m kinid`."""

from __future__ import annotations

import _thread
import atexit
import contextlib
import os
import signal
import sys
import threading
import warnings


def run() -> None:
    """`kinid.cli.main`, and the process ends with it.

    A command can be over so soon that threads of a library still begin, and they abort an interpreter that takes itself
    apart. So the process leaves as soon as whatever is to be done at its exit has been done. Whoever calls
    `kinid.cli.main` in a process of their own keeps it.
    """
    # threads of linear algebra wait busily for each other; beside another process that took 200 times as long
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    # what overflows on the way is said of the result, in words; of an effect of the user's own, by its check
    warnings.simplefilter("ignore", RuntimeWarning)
    code = 1

    def leave() -> None:
        for stream in (sys.stdout, sys.stderr):
            with contextlib.suppress(OSError, ValueError, AttributeError):  # it may be closed, or none
                stream.flush()
        os._exit(code)

    def again(lost: sys.UnraisableHookArgs) -> None:
        # Ctrl-C came where nothing can be raised, as in the middle of an import: it comes once more
        if issubclass(lost.exc_type, KeyboardInterrupt):
            threading.Timer(0.02, _thread.interrupt_main).start()
        else:
            sys.__unraisablehook__(lost)

    sys.unraisablehook = again
    # what is registered first is called last: the command line is imported behind it
    atexit.register(leave)
    # nothing is begun while modules are loaded: Ctrl-C ends the process as it does any other, where it isn't ignored
    handler = signal.getsignal(signal.SIGINT)
    if handler is signal.default_int_handler:
        signal.signal(signal.SIGINT, lambda *_: os._exit(130))
    from kinid.cli import main

    signal.signal(signal.SIGINT, handler)
    try:
        main()
    except SystemExit as end:
        code = end.code if isinstance(end.code, int) else int(end.code is not None)
        raise


if __name__ == "__main__":
    run()
