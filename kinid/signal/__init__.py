"""Motion as an estimate: positions and rates smoothed together, and how sure they are. No robot is in it."""

from kinid.signal.contradictions import contradictions
from kinid.signal.smoother import Smoothed, smooth_motion

__all__ = ["Smoothed", "contradictions", "smooth_motion"]
