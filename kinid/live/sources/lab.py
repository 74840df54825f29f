"""The virtual laboratory as a live robot: `lab:ecoflex-50`, or with a seed `lab:mould:7`.

The experiment is worked out first, then its streams come as they would from the robot: each with its own rate and
clock.
"""

from __future__ import annotations

from collections.abc import Iterator

from kinid.errors import InputError
from kinid.lab.experiments import prepare
from kinid.lab.setup import Setup
from kinid.lab.writing import stamped
from kinid.live.messages import Item, Joints, Source, Wrench
from kinid.live.sources import Asked, Pace

SCHEME = "lab"
HELP = "lab:EXPERIMENT[:SEED] is the virtual laboratory"


def open_source(address: str, asked: Asked) -> Source:
    """Run an experiment.

    Raises:
        InputError: no such experiment, or a seed that is none.
    """
    name, _, seed = address.partition(":")
    if seed and not seed.isdigit():
        raise InputError(f"seed '{seed}' in lab:{address}", "a whole number, 0 or more", "name it as lab:mould:7")
    setup = prepare(name or "ecoflex-50", seed=int(seed or 0))
    return Laboratory(address, setup, asked.speed)


class Laboratory:
    """An experiment that ran, as streams.

    Args:
        name: for people. setup: of the experiment. speed: of the streams.

    Attributes:
        rig: of the laboratory.
    """

    def __init__(self, name: str, setup: Setup, speed: float) -> None:
        self.name, self.live = f"lab:{name}", speed > 0.0
        self.rig, self._result = setup.rig, setup.run()
        self._speed = speed

    def items(self) -> Iterator[Item]:
        """See `Source`."""
        result, pace = self._result, Pace(self._speed)
        streams = stamped(result)
        periods = result.motion.t
        # sorted by when they were measured; of one time joints first
        order = sorted(
            (float(periods[row]), kind, row, stamp)
            for kind, (rows, stamps) in enumerate(streams)
            for row, stamp in zip(rows.tolist(), stamps.tolist())
        )
        for measured, kind, row, stamp in order:
            at = round(1e9 * (measured + 1.0))
            received, sent = pace.wait(at), round(1e9 * (stamp + 1.0))
            if kind == 0:
                yield Joints(received, sent, result.q[row], (), result.tau[row])
            else:
                yield Wrench(received, sent, result.wrench[row])

    def close(self) -> None:
        """See `Source`."""
