"""From a map and a picture of what was mapped to a map of what a picture shows: the prior of the next exploration.

Two things are learnt at the probes: classes of their values (a mixture of lognormals), which a classifier recognises,
and the values themselves, by a Gaussian process over the picture's features, whose uncertainty goes with the
prediction. Places that look like nothing that was learnt stay unknown.
"""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from kinid.errors import InputError
from kinid.mapping.interpolation import Prior
from kinid.mapping.picture import Picture
from kinid.mapping.picture_classes import (
    BEYOND_CHANCE,
    FEWEST,
    UNKNOWN,
    HeldOut,
    MaterialClassifier,
    error_of_mean,
    held_out,
    random_folds,
    sklearn,
    spatial_blocks,
    value_classes,
)
from kinid.mapping.property_map import PICTURE, Probe, Property, PropertyMap
from kinid.robotics.surface import Plane
from kinid.writers import Json

if TYPE_CHECKING:
    from sklearn.gaussian_process import GaussianProcessRegressor
    from sklearn.gaussian_process.kernels import Kernel

Array = NDArray[np.float64]

#: folds of spatial blocks in which the regression is learnt anew
LEARNT_ANEW = 5
#: a spatial block is this share of the map's longer side
BLOCKS = 5.0


@dataclass(frozen=True, eq=False)
class Sighted:
    """What pictures say of a property; make it with `learn`.

    Attributes:
        item: the property. classifier: of classes of its values. figures: how often left-out probes were recognised.
        levels: mean of the property in each class, (c,). counts: probes of each class, (c,).
        regression: scikit-learn's, of the logarithm of the property by the scaled features. centre, scale: of the
            features.
        errors: relative error (root mean square) of left-out probes: random folds, spatial blocks.
        explained: share of the variance of the property's logarithm that the picture explains in left-out spatial
            blocks, and the standard error of that over blocks.
    """

    item: Property
    classifier: MaterialClassifier
    figures: HeldOut
    levels: Array
    counts: NDArray[np.int64]
    regression: GaussianProcessRegressor
    centre: Array
    scale: Array
    errors: tuple[float, float]
    explained: tuple[float, float]

    @property
    def tells(self) -> bool:
        """Whether the picture says anything of the property: recognises classes, or explains values, beyond chance."""
        share, error = self.explained
        return self.figures.tells or share > max(BEYOND_CHANCE * error, 0.0)

    @classmethod
    def learn(
        cls,
        grown: PropertyMap,
        name: str,
        picture: Picture,
        *,
        calibrated: bool = True,
        balanced: bool = False,
        classes: int | None = None,
        limits: Sequence[float] = (),
    ) -> Sighted:
        """From the probes of a map on a plane and a picture of it.

        Args:
            calibrated, balanced: of `MaterialClassifier.learn`. classes, limits: of `value_classes`.

        Raises:
            InputError: values that aren't all positive, fewer than two classes, or probes beside the picture.
        """
        values, flat = grown.values(name), grown.flat(grown.places)
        usable = np.isfinite(values) & picture.shows(flat)
        if usable.sum() < 2 * FEWEST:
            raise InputError(
                f"{usable.sum()} of {len(grown)} probes of {name} in the picture",
                f"{2 * FEWEST} at least",
                "correct the picture's corners, or poke more places",
            )
        if not (values[usable] > 0).all():
            raise InputError(
                f"{name} that is not positive everywhere", "a positive property", "choose another --property"
            )
        flat, values = flat[usable], values[usable]
        features, kind = picture.features(flat), value_classes(values, classes, limits)
        kept = np.isin(kind, np.flatnonzero(np.bincount(kind) >= FEWEST))
        labels = np.array([f"class {z + 1}" for z in kind.tolist()])
        known, named = features[kept], labels[kept].tolist()
        classifier = MaterialClassifier.learn(known, named, calibrated=calibrated, balanced=balanced)
        block = float(np.ptp(flat, axis=0).max()) / BLOCKS
        figures = held_out(known, named, flat[kept], calibrated=calibrated, balanced=balanced, block=block)
        centre, scale = features.mean(axis=0), np.maximum(features.std(axis=0), 1e-9)
        z, log = (features - centre) / scale, np.log(values)
        with warnings.catch_warnings():
            warnings.simplefilter(
                "ignore"
            )  # a length at its bound is of a feature that tells nothing: nothing to warn of
            regression = _regression(z.shape[1]).fit(z, log)
        # lengths that were learnt on all samples know which features happen to go with values that are left out: in
        # blocks, of which a figure is to be honest, they are learnt anew
        blocks = spatial_blocks(flat, block, folds=len(flat))
        wrong = [_left_out(z, log, random_folds(len(z)), regression.kernel_), _left_out(z, log, blocks % LEARNT_ANEW)]
        errors = [float(np.sqrt(np.mean(np.expm1(part) ** 2))) for part in wrong]
        spread = max(float(np.var(log)), 1e-300)
        gain = ((log - log.mean()) ** 2 - wrong[1] ** 2) / spread
        return cls(
            grown.properties[grown.index(name)],
            classifier,
            figures,
            np.array([values[labels == c].mean() for c in classifier.classes]),
            np.array([np.sum(labels == c) for c in classifier.classes]),
            regression,
            centre,
            scale,
            (errors[0], errors[1]),
            (float(gain.mean()), error_of_mean(gain, blocks)),
        )

    def to_dict(self) -> Json:
        """Classes and figures, in the words of JSON."""
        seen, (random, spatial) = self.figures, self.errors
        classes = [
            {"name": name, "probes": int(count), "mean": float(level)}
            for name, count, level in zip(self.classifier.classes, self.counts, self.levels)
        ]
        return {
            "property": self.item.name,
            "unit": self.item.unit,
            "classes": classes,
            "held_out": {
                "random_folds": {
                    "recognised": seen.random_folds,
                    "error": random,
                    "confusion": seen.confusion[0].tolist(),
                },
                "spatial_blocks": {
                    "recognised": seen.spatial_blocks,
                    "error": spatial,
                    "calibration_error": seen.calibration_error,
                    "confusion": seen.confusion[1].tolist(),
                },
                "commonest_class": {"recognised": seen.commonest},
            },
            "tells": self.tells,
            "recognised_gain": {"value": seen.gain, "error": seen.gain_error},
            "explained_variance": {"value": self.explained[0], "error": self.explained[1]},
        }

    def prior(self, picture: Picture) -> Prior:
        """What a picture lets expect: mean and standard deviation at places (m, 2); NaN where it is unknown.

        Everything is, if the picture that was learnt from tells no more than the probes do without it.
        """

        def at(q: Array) -> tuple[Array, Array]:
            q = np.asarray(q, dtype=float)
            if not self.tells:
                return np.full(len(q), np.nan), np.full(len(q), np.nan)
            features = picture.features(q)
            log, sd = self.regression.predict((features - self.centre) / self.scale, return_std=True)
            recognised = (self.classifier.at(features).label != UNKNOWN) & picture.shows(q)
            return np.where(recognised, np.exp(log), np.nan), np.where(recognised, np.exp(log) * sd, np.nan)

        return at

    def predicted(self, picture: Picture, surface: Plane, cells: int = 30) -> tuple[PropertyMap, int]:
        """A map of what a picture shows, a probe a cell, and how many cells are unknown, which have none."""
        span = np.subtract(picture.high, picture.low)
        counts = np.maximum(2, np.round(cells * span / span.max()).astype(int))
        ticks = [low + s * (np.arange(n) + 0.5) / n for low, s, n in zip(picture.low, span, counts)]
        q = np.stack(np.meshgrid(*ticks, indexing="ij"), axis=-1).reshape(-1, 2)
        mean, sd = self.prior(picture)(q)
        finite = np.isfinite(mean)
        empty = PropertyMap(surface, (self.item,), (), PICTURE)
        probes = [
            Probe(p, np.array([m]), np.array([[s**2]]), source=f"picture#{i}")
            for i, (p, m, s) in enumerate(zip(empty.raised(q[finite]), mean[finite], sd[finite]))
        ]
        return empty.added(*probes), int((~finite).sum())


def _regression(count: int) -> GaussianProcessRegressor:
    """A Gaussian process over features, each with its own length, with what no feature explains as noise."""
    kernels, process = sklearn("gaussian_process.kernels"), sklearn("gaussian_process")
    kernel = kernels.ConstantKernel(1.0) * kernels.Matern(np.full(count, 3.0), (0.3, 1e3), nu=1.5)
    return process.GaussianProcessRegressor(
        kernel + kernels.WhiteKernel(0.1, (1e-3, 1.0)), normalize_y=True, random_state=0
    )


def _left_out(z: Array, log: Array, fold: NDArray[np.int64], kernel: Kernel | None = None) -> Array:
    """Error of the logarithm of what was left out fold by fold, (n,), with a given kernel, else one learnt without the
    fold.
    """
    process = sklearn("gaussian_process")
    wrong = np.empty(len(log))
    for k in np.unique(fold):
        train, test = fold != k, fold == k
        part = _regression(z.shape[1])
        if kernel is not None:
            part = process.GaussianProcessRegressor(kernel, optimizer=None, normalize_y=True)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            wrong[test] = part.fit(z[train], log[train]).predict(z[test]) - log[test]
    return wrong


def prior_of(grown: PropertyMap, name: str, method: str = "triangles") -> Prior:
    """An earlier map, of another specimen or predicted from a picture, as what to expect."""
    between = grown.interpolator(name, method)

    def at(q: Array) -> tuple[Array, Array]:
        guess = between.at(q)
        return guess.mean, guess.sd

    return at
