"""Numbers, shares and channels as a reader speaks of them."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from kinid.residuals.view import View


def channel_words(view: View, row: int) -> str:
    """A channel as a reader speaks of it."""
    name, layout = view.channels[row], view.experiment.layout
    if name == "normal_force":
        return "the normal force"
    if name.startswith("tangential_force"):
        return f"the tangential force along tangent {name[-1]}"
    if layout.kind == "joints":
        joint = layout.joints[row] if row < len(layout.joints) else f"joint {row + 1}"
        return f"the {'force' if name.startswith('force') else 'torque'} of {joint}"
    about = " about the tip" if view.turned else ""
    return f"the {'force' if name.startswith('f') else 'torque'}{about} along the sensor's {name[-1]} axis"


def percent(share: float) -> str:
    """A share in words."""
    return f"{100 * share:.0f} %" if share >= 0.01 else "less than 1 %"


def sentence(words: str) -> str:
    """With a capital, without its article."""
    words = words.removeprefix("the ")
    return words[:1].upper() + words[1:]


def span(a: float, b: float) -> str:
    """From one number to another, with as many digits as tell them apart; "about" one where next to nothing lies
    between.
    """
    if abs(b - a) < 1e-3 * max(abs(a), abs(b)):
        return f"about {number((a + b) / 2)}"
    digits = int(np.clip(1 - np.floor(np.log10(max(abs(b - a), 1e-9))), 0, 9))
    return f"{a:.{digits}f} to {b:.{digits}f}".replace("-", "−")


def number(x: float) -> str:
    """Three digits, a true minus."""
    text = f"{x:.3g}"
    return ("0" if text in ("-0", "0") else text).replace("-", "−")
