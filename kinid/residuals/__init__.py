"""What a residual looks like, whatever made it: where it sits in a log, what it follows there, in words that a reader
has.
"""

from kinid.residuals.localization import Cell, where

__all__ = ["Cell", "where"]
