"""Loaded by workers of dask on this machine: Ctrl-C is the first process' affair, which then ends them."""

import signal


def dask_setup(worker: object) -> None:
    """What dask calls as a worker begins."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
