"""Live: from a robot's streams to contact frame, estimates, events and a recording, one sample at a time.

Nothing here commands a robot: a controller asks `Guard.check`, and decides by itself.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from kinid.live.alignment import Aligner
    from kinid.live.events import Event
    from kinid.live.guard import Guard
    from kinid.live.pipeline import Pipeline
    from kinid.live.recording import Recorder
    from kinid.live.session import Session
    from kinid.live.sources import open_source

__all__ = ["Aligner", "Event", "Guard", "Pipeline", "Recorder", "Session", "open_source"]

_HOME_OF = {
    "Aligner": "alignment",
    "Event": "events",
    "Guard": "guard",
    "Pipeline": "pipeline",
    "Recorder": "recording",
    "Session": "session",
    "open_source": "sources",
}


def __getattr__(name: str) -> Any:
    if name not in _HOME_OF:
        raise AttributeError(f"module 'kinid.live' has no attribute '{name}'")
    return getattr(importlib.import_module(f"kinid.live.{_HOME_OF[name]}"), name)


def __dir__() -> list[str]:
    return sorted(__all__)
