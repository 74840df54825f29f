"""`kinid demo`: the main job from end to end, on data that kinid makes itself."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Annotated

import typer

EXAMPLES = """Examples:

kinid demo

kinid demo -o somewhere --real path/to/measured/logs
"""

#: how the measured LWR4+ logs name their arrays
LWR4PLUS_MOTION = """\
[robot]
model = "lwr4plus"

[columns]
t    = { column = "times" }
q    = { column = "positions" }
dq   = { column = "velocities" }
ddq  = { column = "accelerations" }
tau  = { column = "torques" }
"""


def demo(
    out: Annotated[Path, typer.Option("-o", "--out", help="Folder for logs, tables and pictures.")] = Path("kinid-demo"),
    real: Annotated[
        Path | None,
        typer.Option(help="Folder of measured logs; default: KINID_REAL_DATA, else ../shared/real; skipped where absent."),
    ] = None,
    seed: Annotated[int, typer.Option(help="Seed of the virtual experiment.")] = 0,
) -> None:
    """From raw joint logs to contact-frame quantities, on a virtual poke and, where found, on a measured LWR4+ log."""
    from kinid.cli.compare import compare
    from kinid.cli.contact import contact
    from kinid.cli.fit import fit
    from kinid.cli.show import console
    from kinid.lab.scripted import scripted_poke
    from kinid.writers import make_folder, write_text

    say = console().print
    make_folder(out)
    say("A virtual LWR4+ turns its tool in the air, pokes a soft material, slides on it and retracts …")
    log = scripted_poke(seed).write(out)
    say(f"its raw log: {log} (joints, joint torques, wrench), what measured it: {out / 'rig.toml'}\n", soft_wrap=True)
    say(f"$ kinid contact {log} -o {out / 'contact.parquet'} --plot {out / 'contact.html'}", soft_wrap=True)
    contact(log, out=out / "contact.parquet", plot=out / "contact.html")
    say(f"\n$ kinid fit {log} --model kelvin-voigt,coulomb-friction --plot {out / 'fit.html'}", soft_wrap=True)
    fit(log, "kelvin-voigt,coulomb-friction", plot=out / "fit.html", json_file=out / "fit.json")
    say(f"the truth, which no other command reads: {out / 'truth' / 'truth.json'}\n", soft_wrap=True)
    models = ["hooke", "kelvin-voigt", "hertz"]
    say(f"$ kinid compare {log} --model " + " --model ".join(models), soft_wrap=True)
    compare(log, models, plot=out / "compare.html")
    folder = real or Path(os.environ.get("KINID_REAL_DATA") or "../shared/real")
    measured = folder / "lwr4plus-motion" / "measurements_1.npz"
    if measured.is_file():
        rig = out / "lwr4plus-motion.toml"
        write_text(rig, LWR4PLUS_MOTION)
        page = out / "lwr4plus-motion.html"
        say("\nA real LWR4+ moving freely, measured; the model that kinid ships predicts its joint torques:")
        say(f"$ kinid contact {measured} --rig {rig} --plot {page}", soft_wrap=True)
        contact(measured, rig=rig, out=out / "lwr4plus-motion.parquet", plot=page)
    else:
        say(f"\nno measured logs at {folder} (KINID_REAL_DATA names their folder): that part is left out")
    pages = ["contact.html", "fit.html", "compare.html", *(["lwr4plus-motion.html"] if measured.is_file() else [])]
    say(f"\nlook at the pictures in {out}: {', '.join(pages)}")
