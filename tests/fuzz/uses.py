"""What is done with each kind of input; a `KinidError` is a refusal."""

from __future__ import annotations

import contextlib
import io
import json
import os
import socket
import sys
from functools import cache
from pathlib import Path

import numpy as np

import kinid
from fuzz import sound
from kinid.calibration.coupling import load_fit
from kinid.campaign.files import sources
from kinid.cli import main
from kinid.errors import KinidError
from kinid.lab import campaign as campaigns
from kinid.live.sources.udp import parse
from kinid.mapping.picture import Picture
from kinid.robotics.robot import Robot
from kinid.robotics.surface import load
from kinid.viewer.server import ViewServer
from kinid.viewer.viewer import View, record


def log(path: Path) -> object:
    """Read it, and put it into the contact frame."""
    known = kinid.Rig.parse_text(sound.RIG)
    return kinid.contact_series(kinid.read(path, known), known)


def messages(path: Path) -> object:
    """Read it."""
    return kinid.read(path, kinid.Rig.parse_text(sound.RIG))


def picture(path: Path) -> object:
    """Look at it."""
    return Picture.read(path, (0.0, 0.0), (1.0, 1.0)).features(np.array([[0.5, 0.5]]))


def rig(path: Path) -> object:
    """Read a sound log by it."""
    rig = kinid.Rig.load(path)
    (path.parent / "sound.csv").write_bytes(sound.csv(sound.joints()))
    return kinid.contact_series(kinid.read(path.parent / "sound.csv", rig), rig)


def urdf(path: Path) -> object:
    """Move the robot."""
    rig = kinid.Rig.parse_text(sound.RIG.replace("lwr4plus", path.name), path.parent)
    robot = Robot.load(rig)
    return robot.kinematics(robot.tip_frame, np.zeros((3, len(robot.joint_names))))


def mesh(path: Path) -> object:
    """Ask it where a point is."""
    (path.parent / "rig.toml").write_text(f'[surface]\nmesh = "{path.name}"\n', encoding="utf-8")
    surface = load(kinid.Rig.load(path.parent / "rig.toml"))
    return surface.locate(np.array([[0.2, 0.1, -0.01]])) if surface else None


def tester(path: Path) -> object:
    """Fit a model to it."""
    return kinid.Model("kelvin-voigt").fit(kinid.contact_series(kinid.read(path, kinid.Rig()), kinid.Rig()))


def diagnosis(path: Path) -> object:
    """Diagnose it."""
    return kinid.diagnose(tester(path), max_effects=1)


def fit(path: Path) -> object:
    """Predict with it, in both ways that it is read."""
    kinid.Fit.load(path).predict(sound.touched(sound.csv(sound.tester())))
    return load_fit(path)


def campaign(path: Path) -> object:
    """Read the logs that it names."""
    (path.parent / "a.csv").write_bytes(sound.csv(sound.tester()))
    return [kinid.read(source.path) for source in sources([path])[0]]


def manifest(path: Path) -> object:
    """Go on with a campaign that left it."""
    return campaigns._claim(campaigns.Campaign(1, 2, seed=4), path.parent.parent)


def map_(path: Path) -> object:
    """Make a page of it."""
    return record(View(path))


def lines(path: Path) -> object:
    """Take them for what a socket received; a notice is a refusal."""
    return [item for line in path.read_bytes().splitlines() for item in parse(line, 0)]


@cache
def server() -> ViewServer:
    return ViewServer(lambda: "<p>page</p>")


def request(path: Path) -> object:
    """Send it; afterwards the server answers a sound one."""
    port = server().port
    for data in (path.read_bytes(), sound.request(port)):
        with socket.create_connection(("127.0.0.1", port), timeout=10.0) as link:
            link.sendall(data)
            link.shutdown(socket.SHUT_WR)
            link.settimeout(10.0)
            answer = link.recv(1 << 16) if b"/live" not in data else b""
    assert answer.startswith(b"HTTP/1.1 200"), answer
    return answer


def command(path: Path) -> object:
    """Run the command line that the file holds, word by word, in its folder."""
    return run(json.loads(path.read_text(encoding="utf-8")), path.parent)


def run(words: list[str], folder: Path) -> int:
    """Run a command line in a folder that holds a sound log and rig; an exit code of 2 is a refusal."""
    (folder / "rig.toml").write_text(sound.RIG, encoding="utf-8")
    (folder / "log.csv").write_bytes(sound.csv(sound.joints()))
    (folder / "bench").mkdir(exist_ok=True)
    (folder / "bench" / "tester.csv").write_bytes(sound.csv(sound.tester()))
    before, argv, here = io.StringIO(), sys.argv, Path.cwd()
    os.chdir(folder)
    sys.argv = ["kinid", *words]
    try:
        with contextlib.redirect_stderr(before), contextlib.redirect_stdout(io.StringIO()):
            main()
    except SystemExit as end:
        said = before.getvalue()
        assert end.code in (0, 2), said
        assert "Traceback" not in said
        if end.code == 2:
            raise KinidError(said) from None
        return 0
    finally:
        os.chdir(here)
        sys.argv = argv
