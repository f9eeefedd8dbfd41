"""Selection of the pairs that agree with one another; outliers take no part in a registration.

Every three pairs propose a transform; the one with the least trimmed squares (Rousseeuw 1984: of the nearest majority,
each counted by its own covariance) names that majority. From it a forward search (Atkinson & Riani 2000) goes on: pair
by pair joins, the nearest first, as long as it lies within reach of what those inside predict.
"""

from contextlib import suppress
from math import ceil

import numpy as np
from scipy.stats import chi2

from handbench.calibration.registration.rigid_fit import Fit, Pairs, fit
from handbench.calibration.transforms import MAJORITY, triples, umeyama
from handbench.support.errors import HandbenchError

GROSS = 10.0  # standard deviations beyond which a pair is wrong; below, its covariance may be: Huber and χ² see to it
LEAST = 4  # pairs that must agree before another is called wrong
CONDITION = 20.0  # of the rotation, at most: planar centres whose second extent is 5 % of the first
DEGENERATE = 1e3  # condition of three pairs that propose nothing


def majority(pairs: Pairs, with_scale: bool = False) -> tuple[np.ndarray, Fit]:
    """Mask [n] of the pairs that agree, and their fit.

    HandbenchError when they leave the rotation open (with its condition number), when they contradict one another and
    no four of them, or no 60 %, agree (three of four do not outvote the fourth: in a plane they are their own mirror
    image, and three distances agree by chance sooner than six), or when more of them agree as a mirror image.
    """
    kept, found = _largest_agreement(pairs, with_scale)
    agree = int(kept.sum())
    mirrored = 0
    with suppress(HandbenchError):  # every three of the mirror image leave a rotation open
        mirrored = int(_largest_agreement(pairs.mirrored(), with_scale)[0].sum()) if agree < len(pairs) else 0
    if mirrored > agree:
        raise HandbenchError(
            f"target: {mirrored} of {len(pairs)} pairs of centres lie as the target's mirror image, {agree} as the "
            "target; a reflection is no motion: check that both frames are right-handed"
        )
    if agree == 0:
        residuals_mm = 1e3 * np.linalg.norm(pairs.offsets(found.matrix), axis=1)
        shown = ", ".join(f"{name} {mm:.3g}" for name, mm in list(zip(pairs.names, residuals_mm, strict=True))[:12])
        raise HandbenchError(
            f"target: its {len(pairs)} pairs of centres contradict one another by more than {GROSS:g} standard "
            f"deviations (residuals in mm: {shown}); expected that {LEAST} or more agree, and {MAJORITY:.0%}; check "
            "the matching and that the target stood still, or record it again"
        )
    require_condition(pairs[kept], with_scale)
    return kept, found


def require_condition(pairs: Pairs, with_scale: bool = False) -> None:
    """HandbenchError, with the condition number, when the pairs leave a rotation open."""
    condition = pairs.condition(with_scale)
    if condition > CONDITION:
        raise HandbenchError(
            f"target: the {len(pairs)} common elements lie on a line, so that the rotation about it stays open "
            f"(condition number {condition:.3g}, expected at most {CONDITION:g}); use elements that span a plane"
        )


def _largest_agreement(pairs: Pairs, with_scale: bool) -> tuple[np.ndarray, Fit]:
    """Mask [n] of the pairs that agree, none of them without a majority that does, and the fit."""
    if pairs.condition(with_scale) <= CONDITION:
        matrix = umeyama(pairs.source_m, pairs.target_m, with_scale, pairs.weights(with_scale))
        if pairs.distances(matrix).max() <= GROSS:
            found = fit(pairs, with_scale)
            if found.distances @ found.distances <= chi2.ppf(0.99, found.freedom):
                return np.ones(len(pairs), dtype=bool), found  # a pair far off would have raised χ² by its distance²
    kept = _nearest_majority(pairs, with_scale)
    found = fit(pairs[kept], with_scale)
    if found.distances.max() > GROSS:
        return np.zeros(len(pairs), dtype=bool), found
    while not kept.all():
        outside = np.flatnonzero(~kept)
        distances = found.predicted_distances(pairs[outside])
        if distances.min() > GROSS:
            break
        kept[outside[distances.argmin()]] = True
        found = fit(pairs[kept], with_scale)
    return kept, found


def _nearest_majority(pairs: Pairs, with_scale: bool) -> np.ndarray:
    """Mask [n] of the majority with the least squares under a transform that three pairs propose."""
    needed = min(len(pairs), max(LEAST, ceil(MAJORITY * len(pairs))))
    best, least = np.arange(needed), np.inf
    for triple in triples(len(pairs)):
        three = pairs[triple]
        if three.condition(with_scale) <= DEGENERATE:
            distances = pairs.distances(umeyama(three.source_m, three.target_m, with_scale))
            nearest = np.argsort(distances, kind="stable")[:needed]
            if (distances[nearest] ** 2).sum() < least:
                best, least = nearest, (distances[nearest] ** 2).sum()
    if least == np.inf:
        require_condition(pairs, with_scale)
    return np.isin(np.arange(len(pairs)), best)
