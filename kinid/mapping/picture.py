"""A picture registered to a plane, and features of the patches around places."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from kinid.errors import InputError, MissingDependencyError
from kinid.inputs import check_regular, raised, size_limit

Array = NDArray[np.float64]
#: of single precision where they come from a file, which has no more
Pixels = NDArray[np.float64] | NDArray[np.float32]

#: a picture of more pixels is refused before it is unpacked: each costs some twenty bytes
MOST_PIXELS = 16_000_000
#: what is expected of a file, and how to mend another one
PICTURE = ("a PNG or JPEG image", "name another file, or save the picture anew")
#: side of the patch that features are taken from, and the range of it [pixels]
PATCH, PATCHES = 9, (3, 201)
#: features are worked out for tiles of such a side, of which so many are remembered: whole pictures of two million
#: pixels [pixels]
TILE, REMEMBERED = 512, 8
#: beyond half a patch, features depend on so many pixels more: a Gaussian's four deviations
GAUSSIAN = 4
#: names of the features: the first three are a patch's mean colour, the others its texture
COLOURS = ("red", "green", "blue")
FEATURES = (*COLOURS, "spread of red", "spread of green", "spread of blue", "gradient", "curvature")


@dataclass(frozen=True, eq=False)
class Picture:
    """An RGB image registered to a plane.

    Attributes:
        pixels: (rows, columns, 3), 0…1. low, high: places along both tangents [m] of the first pixel's and the last
            pixel's outer corner; rows run along the first tangent, columns along the second.
        patch: side of the patch that features are taken from [pixels]. texture: whether its texture is a feature, or
            its mean colour alone.
    """

    pixels: Pixels
    low: tuple[float, float]
    high: tuple[float, float]
    patch: int = PATCH
    texture: bool = True
    _tiles: dict[tuple[int, int], Array] = field(init=False, repr=False, default_factory=dict)

    def __post_init__(self) -> None:
        if not PATCHES[0] <= self.patch <= PATCHES[1]:
            raise InputError(f"patches of {self.patch} pixels", f"{PATCHES[0]} to {PATCHES[1]}", "correct it")
        if self.pixels.ndim != 3 or self.pixels.shape[2] != 3 or min(self.pixels.shape[:2]) < self.patch:
            raise InputError(
                f"a picture of shape {self.pixels.shape}",
                f"(rows, columns, 3) of {self.patch} pixels at least",
                "give an RGB image, or a smaller patch",
            )
        size = np.subtract(self.high, self.low) if np.isfinite((*self.low, *self.high)).all() else np.zeros(2)
        if not (size > 0.0).all():
            raise InputError(
                f"a picture from {self.low} to {self.high} m", "two corners, the lower one first", "correct it"
            )

    @classmethod
    def read(
        cls,
        path: Path,
        low: tuple[float, float],
        high: tuple[float, float],
        *,
        patch: int = PATCH,
        texture: bool = True,
    ) -> Picture:
        """From a PNG or JPEG file.

        Raises:
            InputError: no image there. MissingDependencyError: no library for images.
        """
        try:
            from PIL import Image, UnidentifiedImageError
        except ImportError:
            raise MissingDependencyError("pillow", "vision") from None
        check_regular(path, "picture", *PICTURE)
        try:
            with Image.open(path, formats=("PNG", "JPEG")) as image:
                count = image.width * image.height
                if count > (most := size_limit(MOST_PIXELS)):
                    raise InputError(
                        f"a picture of {image.width} × {image.height} pixels at {path}",
                        f"{most / 1e6:.3g} million pixels at most",
                        f"make it smaller: a tip is tens of pixels wide then, too; {raised(count, MOST_PIXELS)}",
                    )
                if image.mode.startswith("I"):  # 16 bits of grey, which a conversion to colours would clip to 8
                    grey = np.asarray(image, dtype=np.float32) / np.float32(65535.0)
                    return cls(np.repeat(grey[..., None], 3, axis=2), low, high, patch, texture)
                pixels = np.array(image.convert("RGB"), dtype=np.float32)
                pixels /= np.float32(255.0)
                return cls(pixels, low, high, patch, texture)
        except (OSError, ValueError, UnidentifiedImageError, Image.DecompressionBombError) as error:
            raise InputError(f"no picture at {path} ({str(error)[:60]})", *PICTURE) from None

    def grey_world(self) -> Picture:
        """The same with each channel's mean at 0.5, so that lamp, white balance and exposure matter less.

        It takes for granted that pictures which are held against each other show like materials in like shares (G.
        Buchsbaum, J. Franklin Inst. 310, 1980).
        """
        mean = np.asarray(self.pixels, dtype=np.float64).mean(axis=(0, 1))
        pixels: Array = self.pixels * (0.5 / np.maximum(mean, 1e-3))
        return Picture(pixels, self.low, self.high, self.patch, self.texture)

    def shows(self, places: Array) -> NDArray[np.bool_]:
        """Whether places (n, 2) [m] are in the picture, (n,)."""
        at = np.asarray(places)
        return np.asarray(((at >= self.low) & (at <= self.high)).all(axis=1))

    def pixel(self, places: Array) -> NDArray[np.int64]:
        """Row and column of places (n, 2) [m], clipped to the picture, (n, 2)."""
        span = np.array(self.high) - np.array(self.low)
        shape = np.array(self.pixels.shape[:2])
        at = np.floor((np.asarray(places) - np.array(self.low)) / span * shape).astype(np.int64)
        return np.asarray(np.clip(at, 0, shape - 1))

    def features(self, places: Array) -> Array:
        """Of the patches around places (n, 2) [m], (n, 8), as in `FEATURES`; or (n, 3), the mean colour."""
        at = self.pixel(places)
        out = np.empty((len(at), len(FEATURES if self.texture else COLOURS)))
        tiles, which = np.unique(at // TILE, axis=0, return_inverse=True)
        for k, (row, column) in enumerate(tiles.tolist()):
            here = np.flatnonzero(which.ravel() == k)
            inside = at[here] - TILE * np.array([row, column])
            out[here] = self._tile(row, column)[inside[:, 0], inside[:, 1]]
        return out

    def _tile(self, row: int, column: int) -> Array:
        """Features of the pixels of a tile, (rows, columns, 8) or 3; those of a few tiles are remembered."""
        if (row, column) not in self._tiles:
            while len(self._tiles) >= REMEMBERED:
                del self._tiles[next(iter(self._tiles))]
            near, far, shape, reach = [], [], self.pixels.shape[:2], self.patch // 2 + GAUSSIAN
            for begin, most in zip((TILE * row, TILE * column), shape):
                near.append(max(begin - reach, 0))
                far.append(min(begin + TILE + reach, most))
            fields = _features(self.pixels[near[0] : far[0], near[1] : far[1]], self.patch, self.texture)
            first = TILE * row - near[0], TILE * column - near[1]
            self._tiles[row, column] = fields[first[0] :, first[1] :][:TILE, :TILE].copy()
        return self._tiles[row, column]


def _features(given: Pixels, patch: int, texture: bool) -> Array:
    """Of every pixel (rows, columns, 3), (rows, columns, 8), or 3 without texture."""
    from scipy.ndimage import gaussian_gradient_magnitude, gaussian_laplace, uniform_filter

    pixels, size = np.asarray(given, dtype=np.float64), (patch, patch, 1)
    mean: Array = uniform_filter(pixels, size, mode="nearest")
    if not texture:
        return mean
    spread = np.sqrt(np.maximum(uniform_filter(pixels**2, size, mode="nearest") - mean**2, 0.0))
    grey = pixels @ np.array([0.299, 0.587, 0.114])
    gradient = uniform_filter(gaussian_gradient_magnitude(grey, 1.0, mode="nearest"), size[:2], mode="nearest")
    curvature = uniform_filter(np.abs(gaussian_laplace(grey, 1.0, mode="nearest")), size[:2], mode="nearest")
    return np.concatenate([mean, spread, gradient[..., None], curvature[..., None]], axis=2)
