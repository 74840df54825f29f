"""The session in a browser: arm, forces, marks and map come while it goes on, to this machine alone."""

from __future__ import annotations

import base64
import json
import threading
import time
import urllib.error
import urllib.request
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from live.prepared import NAMES, Prepared, listening
from scripted import Scripted

from kinid.contact.series import contact_series
from kinid.data.rig import Rig
from kinid.errors import InputError
from kinid.live import Pipeline, Session
from kinid.live.growing import Growing
from kinid.live.messages import Item
from kinid.live.viewing import Viewing

MODEL = ("kelvin-voigt", "coulomb-friction")


class Slowly(Prepared):
    """The same at some ten times its own speed, so that pictures come in between."""

    def items(self) -> Any:
        for number, item in enumerate(super().items()):
            if number % 500 == 0:
                time.sleep(0.05)
            yield item


def floats(text: str) -> np.ndarray:
    return np.frombuffer(base64.b64decode(text), "<f4")


def listen(url: str, out: list[dict[str, Any]]) -> threading.Thread:
    """Take in what the page is sent, until the server ends."""
    stream = urllib.request.urlopen(f"{url}live", timeout=20.0)

    def read() -> None:
        for line in stream:
            if line.startswith(b"data: "):
                out.append(json.loads(line[6:]))

    thread = threading.Thread(target=read)
    thread.start()
    return thread


def test_arm_forces_marks_and_map_while_it_goes_on(
    rig: Rig, rows: list[Item], tmp_path: Path, scripted: Scripted
) -> None:
    pipeline = Pipeline(rig, MODEL)
    viewing = Viewing(pipeline, rig, "stream")
    page = urllib.request.urlopen(viewing.url, timeout=20.0).read().decode()
    assert '"live": true' in page or '"live":true' in page
    messages: list[dict[str, Any]] = []
    thread = listen(viewing.url, messages)
    growing = Growing(tmp_path / "map.parquet", pipeline, rig, "stream", [viewing.show])
    session = Session(Slowly(rows), pipeline, NAMES, sinks=[viewing, growing])
    session.run()
    thread.join(10.0)
    assert not thread.is_alive()  # the stream ends with the session
    motions = [message["motion"] for message in messages if "motion" in message]
    assert len(motions) >= 3
    # frames of 20 Hz miss the peaks of a poke of 4 Hz: what is usual is compared
    touch = contact_series(scripted.log, rig)
    assert touch.normal_force is not None
    assert touch.tangential_force1 is not None
    shown = np.linalg.norm(floats(motions[-1]["measured"]).reshape(-1, 3), axis=1)
    logged = np.hypot(touch.normal_force, touch.tangential_force1)[touch.in_contact]
    assert np.quantile(shown[shown > 0.0], 0.75) == pytest.approx(float(np.quantile(logged, 0.75)), rel=0.05)
    apart = [floats(m["measured"]) - floats(m["predicted"]) for m in motions]
    assert np.median(np.abs(np.concatenate(apart))) < 0.1
    tips = np.concatenate([floats(m["tip"]).reshape(-1, 3) for m in motions])
    assert np.abs(tips - (0.55, 0.0, 0.10)).max() < 0.2
    marks = [message["marks"] for message in messages if "marks" in message]
    assert any("touch" in mark["says"] for mark in marks[-1])
    assert any("map" in message for message in messages)


def test_nothing_listens_but_the_page(rig: Rig) -> None:
    """Which takes in nothing: there is no other socket that another user could draw through."""
    before = listening()
    viewing = Viewing(Pipeline(rig, MODEL), rig, "stream")
    assert len(listening() - before) == 1
    for method in ("POST", "PUT", "DELETE"):
        with pytest.raises(urllib.error.HTTPError, match="501"):
            urllib.request.urlopen(urllib.request.Request(viewing.url, data=b"{}", method=method), timeout=20.0)
    viewing.close()


def test_a_port_that_is_taken_is_refused(rig: Rig) -> None:
    pipeline = Pipeline(rig, MODEL)
    first = Viewing(pipeline, rig, "stream")
    with pytest.raises(InputError, match="choose another --view"):
        Viewing(pipeline, rig, "stream", int(first.url.rsplit(":", 1)[1].strip("/")))
    first.close()
