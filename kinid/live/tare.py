"""The sensor's bias from the first seconds of a stream, the tool in the air."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator

import numpy as np
from numpy.typing import NDArray

from kinid.contact.series import contact_series
from kinid.contact.surface_frame import CLEARANCE
from kinid.data.log import Log, Provenance
from kinid.data.rig import Rig
from kinid.errors import InputError
from kinid.live.alignment import Aligner
from kinid.live.messages import NO_SAMPLE, Source
from kinid.robotics.robot import Robot
from kinid.robotics.wrench import FEWEST_FREE

#: a source that sends nothing is waited for so long [s]
PATIENCE = 10.0


def tare(
    source: Source, rig: Rig, robot: Robot, seconds: float, tell: Callable[[str], None] = lambda _says: None
) -> Rig:
    """The rig with the bias that the first samples of a source have, as logs' free motion gives it.

    Args:
        source: whose first samples are taken, with the tool clear of the surface. seconds: of them.
        tell: is told where the bias is of less than that.

    Raises:
        InputError: too few samples, none for `PATIENCE`, or none clear of the surface.
    """
    aligner = Aligner(
        robot.joint_names, lambda _kind, _says: None, wrench_offset=rig.streams.wrench_clock_offset or 0.0
    )
    t, q, wrench = [], [], []
    heard = time.monotonic()
    for item in source.items():
        if item is None or isinstance(item, NO_SAMPLE):
            if time.monotonic() - heard > PATIENCE:
                raise InputError(
                    f"no sample for {PATIENCE:g} s from {source.name}", "joints and wrench", "begin the sender first"
                )
            continue
        heard = time.monotonic()
        aligner.put(item)
        while aligner.pair():
            t.append(aligner.t)
            q.append(aligner.q.copy())
            wrench.append(aligner.wrench.copy())
        if aligner.t > seconds:
            break
    if len(t) < FEWEST_FREE:
        raise InputError(
            f"{len(t)} samples for the bias", f"{FEWEST_FREE} or more", "give --tare more seconds, or leave it out"
        )
    log = Log(np.array(t), q=np.array(q), wrench=np.array(wrench), provenance=Provenance(source.name))
    without = Rig.parse(
        {**rig.model_dump(exclude={"folder"}), "sensor": rig.sensor.model_dump(exclude={"bias"})}, folder=rig.folder
    )
    touch = contact_series(log, without, robot=robot)
    facts = next((step.facts for step in touch.provenance.steps if step.name == "wrench"), {})
    used = facts.get("free_samples_used")
    if touch.bias is None or not isinstance(used, int) or used < FEWEST_FREE:
        raise InputError(
            f"a tool near the surface in the first {seconds:g} s", "a tool in the air", "lift it, or leave --tare out"
        )
    for says in _less(seconds, log.t, touch.depth > -CLEARANCE):
        tell(says)
    return Rig.parse(
        {
            **rig.model_dump(exclude={"folder"}),
            "sensor": {**rig.sensor.model_dump(exclude={"bias"}), "bias": touch.bias.tolist()},
        },
        folder=rig.folder,
    )


def _less(asked: float, t: NDArray[np.float64], near: NDArray[np.bool_]) -> Iterator[str]:
    """Of what less than the time that was asked for [s] a bias is; near: rows at the surface."""
    if t[-1] <= asked:
        yield f"--tare {asked:g}: nothing came after {t[-1]:.3g} s, and the bias is of that time"
    if near.any():
        share = 100.0 * (1.0 - np.mean(near))
        yield (
            f"--tare {asked:g}: the tool was near the surface from {t[np.argmax(near)]:.3g} s on; "
            f"the bias is of the {share:.0f} % in the air"
        )
