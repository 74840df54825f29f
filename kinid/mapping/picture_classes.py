"""Properties guessed from a picture: colour and local texture at a place → class of material, with a probability.

Two classifiers: the study's support-vector machine with a Gaussian kernel of "fine" scale, √P/4 for P features, and a
calibrated one, logistic regression of the machine's scores (Platt 1999), whose probabilities mean what they say. Both
are held out twice: in random folds, as the study did, and in spatial blocks. Neighbours of a random fold's samples are
in its training set, and pictures are smooth, so that random folds flatter; blocks don't. What looks like nothing that
was learnt is said to be unknown.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from kinid.errors import InputError, MissingDependencyError
from kinid.inputs import check_regular, raised, size_limit

if TYPE_CHECKING:
    from types import ModuleType

    from sklearn.base import ClassifierMixin

Array = NDArray[np.float64]
#: of single precision where they come from a file, which has no more
Pixels = NDArray[np.float64] | NDArray[np.float32]

#: a picture of more pixels is refused before it is unpacked: each costs some twenty bytes
MOST_PIXELS = 16_000_000
#: what is expected of a file, and how to mend another one
PICTURE = ("a PNG or JPEG image", "name another file, or save the picture anew")
#: half the side of the patch that features are taken from [pixels]
HALF = 4
#: features are worked out for tiles of such a side, of which so many are remembered: whole pictures of two million
#: pixels [pixels]
TILE, REMEMBERED = 512, 8
#: beyond a tile's border, features depend on so many pixels more: half a patch, and a Gaussian's four deviations
REACH = HALF + 4
#: names of the features
FEATURES = ("red", "green", "blue", "spread of red", "spread of green", "spread of blue", "gradient", "curvature")
#: the study's number of random folds
FOLDS = 20
#: what lies further from the nearest samples than this share of the samples from each other, by this factor, is unknown
STRANGE, FAR, NEIGHBOURS = 0.98, 1.3, 3
UNKNOWN = "unknown"
#: a gain of so many standard errors is no chance
BEYOND_CHANCE = 2.0


@dataclass(frozen=True, eq=False)
class Picture:
    """An RGB image registered to a plane.

    Attributes:
        pixels: (rows, columns, 3), 0…1. low, high: places along both tangents [m] of the first pixel's and the last
            pixel's outer corner; rows run along the first tangent, columns along the second.
    """

    pixels: Pixels
    low: tuple[float, float]
    high: tuple[float, float]
    _tiles: dict[tuple[int, int], Array] = field(init=False, repr=False, default_factory=dict)

    def __post_init__(self) -> None:
        if self.pixels.ndim != 3 or self.pixels.shape[2] != 3 or min(self.pixels.shape[:2]) < 2 * HALF + 1:
            raise InputError(
                f"a picture of shape {self.pixels.shape}",
                f"(rows, columns, 3) of {2 * HALF + 1} pixels at least",
                "give an RGB image",
            )
        size = np.subtract(self.high, self.low) if np.isfinite((*self.low, *self.high)).all() else np.zeros(2)
        if not (size > 0.0).all():
            raise InputError(
                f"a picture from {self.low} to {self.high} m", "two corners, the lower one first", "correct it"
            )

    @classmethod
    def read(cls, path: Path, low: tuple[float, float], high: tuple[float, float]) -> Picture:
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
                    return cls(np.repeat(grey[..., None], 3, axis=2), low, high)
                pixels = np.array(image.convert("RGB"), dtype=np.float32)
                pixels /= np.float32(255.0)
                return cls(pixels, low, high)
        except (OSError, ValueError, UnidentifiedImageError, Image.DecompressionBombError) as error:
            raise InputError(f"no picture at {path} ({str(error)[:60]})", *PICTURE) from None

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
        """Of the patches around places (n, 2) [m], (n, 8), as in `FEATURES`."""
        at = self.pixel(places)
        out = np.empty((len(at), len(FEATURES)))
        tiles, which = np.unique(at // TILE, axis=0, return_inverse=True)
        for k, (row, column) in enumerate(tiles.tolist()):
            here = np.flatnonzero(which.ravel() == k)
            inside = at[here] - TILE * np.array([row, column])
            out[here] = self._tile(row, column)[inside[:, 0], inside[:, 1]]
        return out

    def _tile(self, row: int, column: int) -> Array:
        """Features of the pixels of a tile, (rows, columns, 8); those of a few tiles are remembered."""
        if (row, column) not in self._tiles:
            while len(self._tiles) >= REMEMBERED:
                del self._tiles[next(iter(self._tiles))]
            near, far, shape = [], [], self.pixels.shape[:2]
            for begin, most in zip((TILE * row, TILE * column), shape):
                near.append(max(begin - REACH, 0))
                far.append(min(begin + TILE + REACH, most))
            fields = _features(self.pixels[near[0] : far[0], near[1] : far[1]])
            first = TILE * row - near[0], TILE * column - near[1]
            self._tiles[row, column] = fields[first[0] :, first[1] :][:TILE, :TILE].copy()
        return self._tiles[row, column]


def _features(given: Pixels) -> Array:
    """Of every pixel (rows, columns, 3), (rows, columns, 8)."""
    from scipy.ndimage import gaussian_gradient_magnitude, gaussian_laplace, uniform_filter

    pixels, size = np.asarray(given, dtype=np.float64), (2 * HALF + 1, 2 * HALF + 1, 1)
    mean = uniform_filter(pixels, size, mode="nearest")
    spread = np.sqrt(np.maximum(uniform_filter(pixels**2, size, mode="nearest") - mean**2, 0.0))
    grey = pixels @ np.array([0.299, 0.587, 0.114])
    gradient = uniform_filter(gaussian_gradient_magnitude(grey, 1.0, mode="nearest"), size[:2], mode="nearest")
    curvature = uniform_filter(np.abs(gaussian_laplace(grey, 1.0, mode="nearest")), size[:2], mode="nearest")
    return np.concatenate([mean, spread, gradient[..., None], curvature[..., None]], axis=2)


@dataclass(frozen=True, eq=False)
class Sight:
    """What was recognised at m places: class (or "unknown"), its probability, and that of each class, (m, classes)."""

    label: NDArray[np.str_]
    probability: Array
    probabilities: Array
    classes: tuple[str, ...]


@dataclass(frozen=True, eq=False)
class MaterialClassifier:
    """Learns classes from features; make it with `learn`.

    Attributes:
        classes: names. centre, scale: of the features, (p,). machine: scikit-learn's. samples: learnt from, (n, p), in
            units of what is usual within a class, (p,), in scaled features. strange: mean distance to the nearest of
            them beyond which features are unknown.
    """

    classes: tuple[str, ...]
    centre: Array
    scale: Array
    machine: ClassifierMixin
    samples: Array
    usual: Array
    strange: float

    @classmethod
    def learn(cls, features: Array, labels: Sequence[str], *, calibrated: bool = True) -> MaterialClassifier:
        """From features (n, p) with their classes (n,).

        Args:
            calibrated: the logistic scores; else the study's machine, whose probability is its share of votes.

        Raises:
            InputError: one class only, or fewer than 5 samples of one.
        """
        features, names = np.asarray(features, dtype=float), np.asarray(labels, dtype=str)
        classes, counts = np.unique(names, return_counts=True)
        if len(classes) < 2 or counts.min() < 5:
            raise InputError(
                f"classes {dict(zip(classes.tolist(), counts.tolist()))}",
                "two at least with 5 samples each",
                "poke more places",
            )
        centre, scale = features.mean(axis=0), np.maximum(features.std(axis=0), 1e-9)
        z = (features - centre) / scale
        machine = _machine(z.shape[1], calibrated).fit(z, names)
        # distances count in what is usual within a class: colours differ little there, noise of texture much
        away = np.abs(np.concatenate([z[names == name] - np.median(z[names == name], axis=0) for name in classes]))
        usual = np.maximum(1.4826 * np.median(away, axis=0), 0.02)
        apart = _apart(z / usual, z / usual, own=True)
        return cls(
            tuple(classes.tolist()), centre, scale, machine, z / usual, usual, FAR * float(np.quantile(apart, STRANGE))
        )

    def at(self, features: Array) -> Sight:
        """Classes of features (m, p)."""
        z = (np.asarray(features, dtype=float) - self.centre) / self.scale
        if hasattr(self.machine, "predict_proba"):
            probabilities = np.asarray(self.machine.predict_proba(z))
        else:
            scores = np.asarray(self.machine.decision_function(z))
            scores = np.column_stack([-scores, scores]) if scores.ndim == 1 else scores
            scores = np.exp(scores - scores.max(axis=1, keepdims=True))
            probabilities = scores / scores.sum(axis=1, keepdims=True)
        best = probabilities.argmax(axis=1)
        strange = _apart(z / self.usual, self.samples) > self.strange
        label = np.where(strange, UNKNOWN, np.array(self.classes)[best])
        return Sight(label, np.where(strange, 0.0, probabilities.max(axis=1)), probabilities, self.classes)


@dataclass(frozen=True)
class HeldOut:
    """Share of places that were recognised: in random folds, in spatial blocks, and how far probabilities were off
    there.

    `commonest` is the share of the commonest class, which needs no picture to be right so often; `gain` is what the
    picture adds to that, and `gain_error` its standard error over blocks.
    """

    random_folds: float
    spatial_blocks: float
    calibration_error: float
    commonest: float
    gain_error: float

    @property
    def gain(self) -> float:
        """Share recognised in spatial blocks beyond that of the commonest class."""
        return self.spatial_blocks - self.commonest

    @property
    def tells(self) -> bool:
        """Whether classes are recognised more often than chance makes so."""
        return self.gain > max(BEYOND_CHANCE * self.gain_error, 0.0)


def held_out(
    features: Array,
    labels: Sequence[str],
    places: Array,
    *,
    calibrated: bool = True,
    block: float = 0.02,
    folds: int = FOLDS,
    seed: int = 0,
) -> HeldOut:
    """Both ways of holding out, side by side.

    Args:
        features: (n, p). labels: (n,). places: (n, 2) [m]. block: side of a spatial block [m]. folds: of the random
            kind.
    """
    features, names = np.asarray(features, dtype=float), np.asarray(labels, dtype=str)
    random, _, _ = _scores(features, names, random_folds(len(names), folds, seed), calibrated)
    fold = spatial_blocks(places, block, folds, seed)
    spatial, probability, right = _scores(features, names, fold, calibrated)
    bins = np.clip((probability * 10).astype(int), 0, 9)
    gap = sum(
        abs(float(np.mean(probability[bins == b]) - np.mean(right[bins == b]))) * np.mean(bins == b)
        for b in np.unique(bins)
    )
    classes, counts = np.unique(names, return_counts=True)
    plain = names == classes[counts.argmax()]
    return HeldOut(random, spatial, float(gap), float(plain.mean()), error_of_mean(right.astype(float) - plain, fold))


def random_folds(n: int, folds: int = FOLDS, seed: int = 0) -> NDArray[np.int64]:
    """Fold of each of n samples, (n,)."""
    return np.asarray(np.random.default_rng(seed).permutation(n) % folds, dtype=np.int64)


def spatial_blocks(places: Array, block: float, folds: int = FOLDS, seed: int = 0) -> NDArray[np.int64]:
    """Fold of places (n, 2) [m], (n,): squares of side `block` [m] go into a fold whole."""
    cell = np.floor((np.asarray(places) - np.min(places, axis=0)) / block).astype(int)
    number = np.unique(cell, axis=0, return_inverse=True)[1].ravel()
    count = int(number.max()) + 1
    return np.asarray(np.random.default_rng(seed).permutation(count)[number] % min(folds, count), dtype=np.int64)


def value_classes(values: Array, most: int = 6) -> NDArray[np.int64]:
    """Classes of positive values by their size, (n,): as many as a mixture of lognormals asks for (BIC)."""
    mixture = sklearn("mixture")
    y = np.log(np.asarray(values, dtype=float))[:, None]
    best = None
    for k in range(1, min(most, len(y) // 3) + 1):
        found = mixture.GaussianMixture(k, random_state=0, reg_covar=1e-4, n_init=2).fit(y)
        score = found.bic(y)
        if best is None or score < best[0]:
            best = (score, found)
    assert best is not None
    order = np.argsort(np.argsort(best[1].means_.ravel()))
    return np.asarray(order[best[1].predict(y)], dtype=np.int64)


def _scores(
    features: Array, names: NDArray[np.str_], fold: NDArray[np.int64], calibrated: bool
) -> tuple[float, Array, NDArray[np.bool_]]:
    right, probability = np.zeros(len(names), np.bool_), np.zeros(len(names))
    for k in np.unique(fold):
        train, test = fold != k, fold == k
        counts = np.unique(names[train], return_counts=True)[1]
        if len(counts) < 2 or counts.min() < 5:
            continue  # nothing to learn from: its samples count as missed
        seen = MaterialClassifier.learn(features[train], names[train].tolist(), calibrated=calibrated).at(
            features[test]
        )
        right[test] = np.array(seen.classes)[seen.probabilities.argmax(axis=1)] == names[test]
        probability[test] = seen.probabilities.max(axis=1)
    return float(right.mean()), probability, right


def error_of_mean(values: Array, fold: NDArray[np.int64]) -> float:
    """Standard error of a mean whose samples go together within folds (cluster-robust: Liang & Zeger, Biometrika 73,
    1986).
    """
    sums = np.bincount(fold, values - values.mean())
    count = len(np.unique(fold))
    return float(np.sqrt(np.sum(sums**2) * count / max(count - 1, 1))) / len(values)


def _machine(count: int, calibrated: bool) -> ClassifierMixin:
    """The study's: exp(−|x − x'|²/s²) with s = √P/4, which scikit-learn writes as γ = 1/s²; and the calibrated
    alternative.
    """
    if not calibrated:
        return sklearn("svm").SVC(kernel="rbf", gamma=16.0 / count, C=1.0)
    # a wider kernel generalises to places that were not touched; the logistic curve on left-out scores calibrates it
    machine = sklearn("svm").SVC(kernel="rbf", gamma=1.0 / count, C=1.0)
    return sklearn("calibration").CalibratedClassifierCV(machine, method="sigmoid", cv=3, ensemble=False)


def _apart(z: Array, samples: Array, own: bool = False) -> Array:
    """Mean distance of features to the `NEIGHBOURS` nearest samples, (m,); their own place left out if they are the
    samples.
    """
    from scipy.spatial import cKDTree

    k = min(NEIGHBOURS + own, len(samples))
    distance = cKDTree(samples).query(z, k=k)[0].reshape(len(z), k)
    return np.asarray(distance[:, int(own) :].mean(axis=1))


def sklearn(module: str) -> ModuleType:
    """One of scikit-learn's modules.

    Raises:
        MissingDependencyError: it isn't installed.
    """
    import importlib

    try:
        return importlib.import_module(f"sklearn.{module}")
    except ImportError:
        raise MissingDependencyError("scikit-learn", "vision") from None
