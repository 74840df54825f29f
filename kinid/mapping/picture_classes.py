"""Properties guessed from a picture: colour and local texture at a place → class of material, with a probability.

Two classifiers: the study's support-vector machine with a Gaussian kernel of "fine" scale, √P/4 for P features, and a
calibrated one, logistic regression of the machine's scores (Platt 1999), whose probabilities mean what they say. Both
are held out twice: in random folds, as the study did, and in spatial blocks. Neighbours of a random fold's samples are
in its training set, and pictures are smooth, so that random folds flatter; blocks don't. What looks like nothing that
was learnt is said to be unknown.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from kinid.errors import InputError, MissingDependencyError

if TYPE_CHECKING:
    from types import ModuleType

    from sklearn.base import ClassifierMixin

Array = NDArray[np.float64]
#: the study's number of random folds; a class of fewer samples teaches nothing
FOLDS, FEWEST = 20, 5
#: what lies further from the nearest samples than this share of the samples from each other, by this factor, is unknown
STRANGE, FAR, NEIGHBOURS = 0.98, 1.3, 3
UNKNOWN = "unknown"
#: a gain of so many standard errors is no chance
BEYOND_CHANCE = 2.0


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
    def learn(
        cls, features: Array, labels: Sequence[str], *, calibrated: bool = True, balanced: bool = False
    ) -> MaterialClassifier:
        """From features (n, p) with their classes (n,).

        Args:
            calibrated: the logistic scores; else the study's machine, whose probability is its share of votes.
            balanced: class weights inverse to the classes' frequencies (the study's oversampling, without a copy of a
                sample in another fold).

        Raises:
            InputError: one class only, or fewer than 5 samples of one.
        """
        features, names = np.asarray(features, dtype=float), np.asarray(labels, dtype=str)
        classes, counts = np.unique(names, return_counts=True)
        if len(classes) < 2 or counts.min() < FEWEST:
            raise InputError(
                f"classes {dict(zip(classes.tolist(), counts.tolist()))}",
                f"two at least with {FEWEST} samples each",
                "poke more places",
            )
        centre, scale = features.mean(axis=0), np.maximum(features.std(axis=0), 1e-9)
        z = (features - centre) / scale
        machine = _machine(z.shape[1], calibrated, balanced).fit(z, names)
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


@dataclass(frozen=True, eq=False)
class HeldOut:
    """Share of places that were recognised: in random folds, in spatial blocks, and how far probabilities were off
    there.

    `commonest` is the share of the commonest class, which needs no picture to be right so often; `gain` is what the
    picture adds to that, and `gain_error` its standard error over blocks. `confusion` are places by their class (rows)
    and by what was recognised (columns), (c, c), in the order of `classes`, without those that nothing
    could be learnt for: of random folds, and of spatial blocks.
    """

    random_folds: float
    spatial_blocks: float
    calibration_error: float
    commonest: float
    gain_error: float
    classes: tuple[str, ...]
    confusion: tuple[NDArray[np.int64], NDArray[np.int64]]

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
    balanced: bool = False,
    block: float = 0.02,
    folds: int = FOLDS,
    seed: int = 0,
) -> HeldOut:
    """Both ways of holding out, side by side.

    Args:
        features: (n, p). labels: (n,). places: (n, 2) [m]. block: side of a spatial block [m]. folds: of the random
            kind. calibrated, balanced: of `MaterialClassifier.learn`.
    """
    features, names = np.asarray(features, dtype=float), np.asarray(labels, dtype=str)
    by_chance, _ = _recognised(features, names, random_folds(len(names), folds, seed), calibrated, balanced)
    fold = spatial_blocks(places, block, folds, seed)
    in_blocks, probability = _recognised(features, names, fold, calibrated, balanced)
    right = in_blocks == names
    bins = np.clip((probability * 10).astype(int), 0, 9)
    gap = sum(
        abs(float(np.mean(probability[bins == b]) - np.mean(right[bins == b]))) * np.mean(bins == b)
        for b in np.unique(bins)
    )
    classes, counts = np.unique(names, return_counts=True)
    counted = sklearn("metrics").confusion_matrix
    plain = names == classes[counts.argmax()]
    return HeldOut(
        float(np.mean(by_chance == names)),
        float(right.mean()),
        float(gap),
        float(plain.mean()),
        error_of_mean(right.astype(float) - plain, fold),
        tuple(classes.tolist()),
        (counted(names, by_chance, labels=classes), counted(names, in_blocks, labels=classes)),
    )


def random_folds(n: int, folds: int = FOLDS, seed: int = 0) -> NDArray[np.int64]:
    """Fold of each of n samples, (n,)."""
    return np.asarray(np.random.default_rng(seed).permutation(n) % folds, dtype=np.int64)


def spatial_blocks(places: Array, block: float, folds: int = FOLDS, seed: int = 0) -> NDArray[np.int64]:
    """Fold of places (n, 2) [m], (n,): squares of side `block` [m] go into a fold whole."""
    cell = np.floor((np.asarray(places) - np.min(places, axis=0)) / block).astype(int)
    number = np.unique(cell, axis=0, return_inverse=True)[1].ravel()
    count = int(number.max()) + 1
    return np.asarray(np.random.default_rng(seed).permutation(count)[number] % min(folds, count), dtype=np.int64)


def value_classes(
    values: Array, count: int | None = None, limits: Sequence[float] = (), most: int = 6
) -> NDArray[np.int64]:
    """Classes of positive values by their size, (n,), from 0 on.

    Args:
        values: (n,). count: of classes; None: as many as a mixture of lognormals asks for (BIC), `most` at most.
        limits: between the classes, which are counted then.

    Raises:
        InputError: limits that don't rise, another count than they make, or fewer values than classes.
    """
    y = np.log(np.asarray(values, dtype=float))[:, None]
    if len(limits):
        if not (np.diff(limits) > 0.0).all() or limits[0] <= 0.0 or count not in (None, len(limits) + 1):
            raise InputError(
                f"limits {', '.join(f'{limit:g}' for limit in limits)}" + (f" for {count} classes" if count else ""),
                "positive ones that rise, one less than there are classes",
                "correct them",
            )
        return np.asarray(np.searchsorted(np.log(limits), y[:, 0], side="right"), dtype=np.int64)
    if count is not None and not 2 <= count <= len(y):
        raise InputError(f"{count} classes of {len(y)} values", f"2 to {len(y)}", "correct it")
    mixture = sklearn("mixture")
    best = None
    for k in range(1, min(most, len(y) // 3) + 1) if count is None else (count,):
        found = mixture.GaussianMixture(k, random_state=0, reg_covar=1e-4, n_init=2 if count is None else 10).fit(y)
        score = found.bic(y)
        if best is None or score < best[0]:
            best = (score, found)
    assert best is not None
    order = np.argsort(np.argsort(best[1].means_.ravel()))
    return np.asarray(order[best[1].predict(y)], dtype=np.int64)


def _recognised(
    features: Array, names: NDArray[np.str_], fold: NDArray[np.int64], calibrated: bool, balanced: bool
) -> tuple[NDArray[np.str_], Array]:
    """Class and its probability of each sample (n,), learnt from the other folds; unknown where those don't do."""
    label, probability = np.full(len(names), UNKNOWN, dtype=object), np.zeros(len(names))
    for k in np.unique(fold):
        train, test = fold != k, fold == k
        counts = np.unique(names[train], return_counts=True)[1]
        if len(counts) < 2 or counts.min() < FEWEST:
            continue  # nothing to learn from: its samples count as missed
        seen = MaterialClassifier.learn(
            features[train], names[train].tolist(), calibrated=calibrated, balanced=balanced
        ).at(features[test])
        label[test] = np.array(seen.classes)[seen.probabilities.argmax(axis=1)]
        probability[test] = seen.probabilities.max(axis=1)
    return label.astype(str), probability


def error_of_mean(values: Array, fold: NDArray[np.int64]) -> float:
    """Standard error of a mean whose samples go together within folds (cluster-robust: Liang & Zeger, Biometrika 73,
    1986).
    """
    sums = np.bincount(fold, values - values.mean())
    count = len(np.unique(fold))
    return float(np.sqrt(np.sum(sums**2) * count / max(count - 1, 1))) / len(values)


def _machine(count: int, calibrated: bool, balanced: bool) -> ClassifierMixin:
    """The study's: exp(−|x − x'|²/s²) with s = √P/4, which scikit-learn writes as γ = 1/s²; and the calibrated
    alternative.
    """
    weight = "balanced" if balanced else None
    if not calibrated:
        return sklearn("svm").SVC(kernel="rbf", gamma=16.0 / count, C=1.0, class_weight=weight)
    # a wider kernel generalises to places that were not touched; the logistic curve on left-out scores calibrates it
    machine = sklearn("svm").SVC(kernel="rbf", gamma=1.0 / count, C=1.0, class_weight=weight)
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
