"""Published materials, poked and slid on, and found again: what was published, what is true here, and what a fit
says.
"""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from kinid.contact.series import ContactSeries, contact_series
from kinid.identification.fit import fit_model
from kinid.identification.fitted import FittedParameter
from kinid.lab.experiments import prepare
from kinid.modeling.model import Model
from kinid.signal.derivative import Differentiator
from kinid.writers import make_folder, write_json

#: stiffness [N/m], damping [N·s/m], friction [1]
PUBLISHED = {"sponge": (280.0, 8.1, 0.27), "ecoflex-50": (732.0, 9.9, 0.82), "dragon-skin-10": (994.0, 14.5, 0.77)}
NAMES, UNITS = ("stiffness", "damping", "friction"), ("N/m", "N·s/m", "1")
#: of the differentiator: the pokes' 5 Hz and their phase come through [Hz]
BANDWIDTH = 40.0


class Row(NamedTuple):
    """One parameter of one material: published, true here, estimated with its 95 % interval, and the unit."""

    material: str
    parameter: str
    published: float
    true: float
    estimated: float
    low: float
    high: float
    unit: str


def study(seed: int = 0) -> list[Row]:
    """Each published material poked and slid on, from raw logs with the sensor's faults of a seed."""
    rows = []
    for name, published in PUBLISHED.items():
        setup = prepare(name, seed=seed)
        touch = contact_series(setup.run().log, setup.rig, differentiator=Differentiator(bandwidth=BANDWIDTH))
        m = setup.material
        true = (m.stiffness, m.damping, m.friction)
        for k, found in enumerate(_estimates(touch)):
            rows.append(Row(name, NAMES[k], published[k], true[k], found.value, found.low, found.high, UNITS[k]))
    return rows


def _estimates(touch: ContactSeries) -> list[FittedParameter]:
    """Stiffness and damping from the poke, friction from the slide; an offset of each force is fitted along."""
    poke, slide = _parts(touch)
    normal = fit_model(
        Model("kelvin-voigt", "sensor-bias"), touch, channels=("normal_force",), train=poke, held_out=False
    )
    sliding = fit_model(
        Model("kelvin-voigt", "coulomb-friction", "sensor-bias"),
        touch,
        train=slide,
        held_out=False,
        channels=("normal_force", "tangential_force1", "tangential_force2"),
    )
    return [normal["stiffness"], normal["damping"], sliding["coefficient"]]


def _parts(touch: ContactSeries) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """Samples of the poke and of the slide, each with the air before and after it.

    Without the retraction: these materials let go where the equation of Kelvin-Voigt would pull.
    """
    assert touch.phase is not None
    rest = np.flatnonzero(touch.phase == "rest")
    between = rest[: int(np.flatnonzero(np.diff(rest) > 1)[0]) + 1]
    at, pull = np.arange(len(touch)), touch.phase == "retract"
    return (at <= between[-1]) & ~pull, (at >= between[0]) & ~pull


def write(folder: Path, rows: list[Row]) -> Path:
    """Write `study.json` into a folder; its path."""
    make_folder(folder)
    path = folder / "study.json"
    write_json(path, [row._asdict() for row in rows])
    return path
