"""Fit of a rigid motion to pairs of centres by weighted least squares, with rejection of pairs that
contradict the majority.

Coordinates are relative to the pairs' middle: far from it, rotation and translation are numerically
indistinguishable. For the rejection, every triple of pairs gives a transform; the one with the
least trimmed squares (Rousseeuw 1984; over the nearest majority of the pairs, weighted by
covariances) selects a majority. A forward search (Atkinson & Riani 2000) then adds further pairs,
nearest first, as long as they agree with the fit's prediction.
"""

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from math import ceil

import numpy as np
from scipy.spatial.transform import Rotation
from scipy.special import chdtri

from handbench.calibration.spheres.description import Candidate
from handbench.calibration.transforms import (
    MAJORITY,
    adjoint,
    condition_number,
    perturbation_jacobian,
    triples,
    umeyama,
)
from handbench.support.errors import HandbenchError

# residuals beyond this many standard deviations lose weight
HUBER = float(np.sqrt(chdtri(3, 0.01)))
MAX_STEPS = 50
SIDES = ("source_m", "target_m", "source_m2", "target_m2")
SETTLED = 1e-13  # of the centres' extent: a step that moves no centre further is the last
# standard deviations beyond which a pair is an outlier; smaller misfits are handled by Huber's
# weights and χ²
GROSS = 10.0
LEAST = 4  # pairs that must agree before another is called wrong
CONDITION = 20.0  # of the rotation, at most: planar centres whose second extent is 5 % of the first
DEGENERATE = 1e3  # condition of three pairs that propose nothing


@dataclass(frozen=True)
class Pairs:
    """The same points (balls' centres) as measured by two sensors, called source and target.

    source_m, target_m [n, 3]: positions, metres, each in its sensor's frame; source_m2, target_m2
    [n, 3, 3]: their covariances, m²; names [n]: names of the pairs, for messages.
    """

    source_m: np.ndarray
    target_m: np.ndarray
    source_m2: np.ndarray
    target_m2: np.ndarray
    names: tuple[str, ...]

    @classmethod
    def of(
        cls, source: Sequence[Candidate], target: Sequence[Candidate], names: Sequence[str] = ()
    ) -> "Pairs":
        """Make pairs from the measured centres of two sensors, listed in the same order. Raises
        HandbenchError for fewer than three, for numbers that are not finite, and for covariances
        that are not positive definite."""
        if len(source) != len(target) or len(source) < 3:
            raise HandbenchError(
                f"target: only {min(len(source), len(target))} elements are found both in the "
                "photographs and in the echoes; expected 3 or more; check that all elements are "
                "in view"
            )
        names = tuple(names) or tuple(f"pair {i + 1}" for i in range(len(source)))
        source_m, target_m = (
            np.array([c.centre_m for c in side], np.float64) for side in (source, target)
        )
        source_m2, target_m2 = (
            np.array([c.covariance_m2 for c in side], np.float64) for side in (source, target)
        )
        for name, *numbers in zip(names, source_m, target_m, source_m2, target_m2, strict=True):
            if (
                not all(np.isfinite(n).all() for n in numbers)
                or np.linalg.eigvalsh(numbers[2] + numbers[3])[0] <= 0
            ):
                raise HandbenchError(
                    f"{name}: the centre or its covariance is not finite, or the covariance is "
                    "not positive; expected metres and a positive 3×3 matrix in square metres"
                )
        return cls(source_m, target_m, source_m2, target_m2, names)

    def __len__(self) -> int:
        return len(self.names)

    def __getitem__(self, chosen: np.ndarray | Sequence[int]) -> "Pairs":
        """Return the pairs with these indices, or where a mask [n] is True."""
        chosen = np.arange(len(self))[np.asarray(chosen)]
        sides = {side: getattr(self, side)[chosen] for side in SIDES}
        return Pairs(**sides, names=tuple(self.names[i] for i in chosen))

    def __add__(self, other: "Pairs") -> "Pairs":
        both = {side: np.concatenate([getattr(self, side), getattr(other, side)]) for side in SIDES}
        return Pairs(**both, names=self.names + other.names)

    def mirrored(self) -> "Pairs":
        """Return the pairs with all source points mirrored at the plane z = 0."""
        flip = np.array([1.0, 1.0, -1.0])
        return replace(
            self, source_m=self.source_m * flip, source_m2=self.source_m2 * np.outer(flip, flip)
        )

    @property
    def weights(self) -> np.ndarray:
        """The weight of each pair [n], 1/m², for the closed-form fit: the inverse of its residual's
        variance, averaged over the axes."""
        return 3 / np.trace(self.source_m2 + self.target_m2, axis1=1, axis2=2)

    def covariances(self, rotation: np.ndarray) -> np.ndarray:
        """Compute the covariances [n, 3, 3] of the residuals, m², for a rotation R [3, 3]:
        R·C_p·Rᵀ + C_q, with the covariances C_p of source points and C_q of target points."""
        return rotation @ self.source_m2 @ rotation.T + self.target_m2

    def offsets(self, matrix: np.ndarray) -> np.ndarray:
        """Compute the residuals [n, 3], metres, of a rigid motion [4, 4]: target minus transformed
        source points, q − R·p − t."""
        return self.target_m - self.source_m @ matrix[:3, :3].T - matrix[:3, 3]

    def distances(self, matrix: np.ndarray) -> np.ndarray:
        """Compute the lengths [n] of the residuals of a rigid motion [4, 4] in standard deviations
        (Mahalanobis distances)."""
        return mahalanobis(self.offsets(matrix), np.linalg.inv(self.covariances(matrix[:3, :3])))

    @property
    def condition(self) -> float:
        """How unevenly the pairs determine the rotation: its uncertainty about the worst axis
        divided by that about the best one."""
        return condition_number(self.source_m, self.target_m, self.weights)


@dataclass(frozen=True)
class RigidFit:
    """A rigid motion fitted to pairs of points, matrix [4, 4], and its quality.

    covariance [6, 6]: that of [translation_m, rotation_rad] about the point pivot_m [3] in the
    target's frame; distances [n]: residuals in standard deviations; freedom: degrees of freedom,
    number of residuals minus that of unknowns.
    """

    matrix: np.ndarray
    pivot_m: np.ndarray
    covariance: np.ndarray
    distances: np.ndarray
    freedom: int

    def covariance_about_origin(self) -> np.ndarray:
        """Convert the covariance, which is about pivot_m, to one about the origin of the target
        frame, as in `Transform`."""
        carry = adjoint(-self.pivot_m)
        return carry @ self.covariance @ carry.T

    def predicted_distances(self, pairs: Pairs) -> np.ndarray:
        """Compute the residuals [n] of pairs that were not fitted, in standard deviations: those of
        the pairs' own errors and the fit's uncertainty together."""
        offsets = pairs.offsets(self.matrix)
        jacobian = perturbation_jacobian(pairs.target_m - offsets - self.pivot_m)[..., :6]
        spread = jacobian @ self.covariance @ np.swapaxes(jacobian, -1, -2)
        return mahalanobis(offsets, np.linalg.inv(pairs.covariances(self.matrix[:3, :3]) + spread))


def fit(pairs: Pairs) -> RigidFit:
    """Fit the rigid motion from source to target points by maximum likelihood, without rejecting
    any pair. The pairs must determine a rotation.

    The fit starts from the closed form (Umeyama 1991, weighted). Gauss–Newton steps then minimise Σ
    dᵀC⁻¹d with d = q − R·p − t and C = R·C_p·Rᵀ + C_q; large residuals have reduced weights
    (Huber). The covariance is the inverse of the normal matrix; if the residuals contradict it (99
    %), it is enlarged by χ² over the degrees of freedom. Raises HandbenchError if the pairs
    contradict one another so far that the equations are singular.
    """
    p_mean, q_mean = pairs.source_m.mean(axis=0), pairs.target_m.mean(axis=0)
    near = replace(pairs, source_m=pairs.source_m - p_mean, target_m=pairs.target_m - q_mean)
    extent_m = np.linalg.norm(near.target_m, axis=1).max()
    matrix = umeyama(near.source_m, near.target_m, weights=near.weights)
    for _ in range(MAX_STEPS):
        offsets = near.offsets(matrix)
        information = np.linalg.inv(near.covariances(matrix[:3, :3]))
        distances = mahalanobis(offsets, information)
        information *= np.minimum(1, HUBER / np.maximum(distances, HUBER))[:, None, None]
        jacobian = perturbation_jacobian(near.target_m - offsets)[:, :, :6]
        normal = np.einsum("nia,nij,njb->ab", jacobian, information, jacobian)
        step = _solve(normal, np.einsum("nia,nij,nj->a", jacobian, information, offsets))
        # pairs that contradict one another drive it anywhere
        step /= max(1.0, np.abs(step[3:]).max())
        change = np.eye(4)
        change[:3, :3] = Rotation.from_rotvec(step[3:]).as_matrix()
        change[:3, 3] = step[:3]
        matrix = change @ matrix
        if np.abs(jacobian @ step).max() <= SETTLED * extent_m:
            break
    freedom = 3 * len(pairs) - 6
    misfit = float(distances @ distances)
    inflation = max(1.0, misfit / freedom) if misfit > chdtri(freedom, 0.01) else 1.0
    whole = matrix.copy()
    whole[:3, 3] += q_mean - matrix[:3, :3] @ p_mean
    return RigidFit(whole, q_mean, inflation * _solve(normal, np.eye(6)), distances, freedom)


def mahalanobis(offsets: np.ndarray, information: np.ndarray) -> np.ndarray:
    """Compute the lengths √(dᵀ·I·d) [n] of offsets d [n, 3] in standard deviations. information [n,
    3, 3]: I, the inverse covariances of the offsets."""
    return np.sqrt(np.einsum("ni,nij,nj->n", offsets, information, offsets))


def _solve(normal: np.ndarray, right: np.ndarray) -> np.ndarray:
    """Solve the normal equations normal · x = right for x. They are scaled to a unit diagonal
    first, since the unknowns have different units. Raises HandbenchError for a singular matrix."""
    root = np.sqrt(np.diag(normal))
    right = (right.T / root).T
    try:
        return (np.linalg.solve(normal / np.outer(root, root), right).T / root).T
    except np.linalg.LinAlgError as error:
        raise HandbenchError(
            "target: the centres found in the photographs and in the echoes disagree so far that "
            "no transform fits; check the matching and the covariances"
        ) from error


def majority(pairs: Pairs) -> tuple[np.ndarray, RigidFit]:
    """Find the majority of pairs that agree on one rigid motion: (boolean mask [n], fit to these
    pairs).

    Raises HandbenchError if the pairs do not determine the rotation (with their condition number),
    if more of them agree as a mirror image, and if fewer than four, or fewer than 60 %, agree.
    Three of four are not enough: in a plane they equal their mirror image, and three distances
    agree by chance more often than six.
    """
    kept, found = _largest_agreement(pairs)
    agree = int(kept.sum())
    mirrored = 0
    with suppress(HandbenchError):  # every three of the mirror image leave a rotation open
        mirrored = int(_largest_agreement(pairs.mirrored())[0].sum()) if agree < len(pairs) else 0
    if mirrored > agree:
        raise HandbenchError(
            f"target: {mirrored} of {len(pairs)} pairs of centres fit a mirror image of the "
            f"target and only {agree} fit the target; check that both frames are right-handed"
        )
    if agree == 0:
        residuals_mm = 1e3 * np.linalg.norm(pairs.offsets(found.matrix), axis=1)
        shown = ", ".join(
            f"{name} {mm:.3g}"
            for name, mm in list(zip(pairs.names, residuals_mm, strict=True))[:12]
        )
        raise HandbenchError(
            f"target: its {len(pairs)} pairs of centres disagree by more than {GROSS:g} standard "
            f"deviations (residuals in mm: {shown}); expected at least {LEAST} pairs and "
            f"{MAJORITY:.0%} to agree; check the matching and that the target stood still, or "
            "record it again"
        )
    require_condition(pairs[kept])
    return kept, found


def require_condition(pairs: Pairs) -> None:
    """Raise HandbenchError, with the condition number, if the pairs do not determine the rotation
    because they are almost on a line."""
    condition = pairs.condition
    if condition > CONDITION:
        raise HandbenchError(
            f"target: its {len(pairs)} common elements are on a line (condition number "
            f"{condition:.3g}, expected at most {CONDITION:g}), so the rotation about this line "
            "is unknown; use elements that span a plane"
        )


def _largest_agreement(pairs: Pairs) -> tuple[np.ndarray, RigidFit]:
    """Find the pairs that agree on one rigid motion: (boolean mask [n], fit to these pairs). If
    there is no majority, the mask is False everywhere and the fit is that to the best attempt."""
    if pairs.condition <= CONDITION:
        matrix = umeyama(pairs.source_m, pairs.target_m, weights=pairs.weights)
        if pairs.distances(matrix).max() <= GROSS:
            found = fit(pairs)
            if found.distances @ found.distances <= chdtri(found.freedom, 0.01):
                return np.ones(
                    len(pairs), dtype=bool
                ), found  # a pair far off would have raised χ² by its distance²
    kept = _nearest_majority(pairs)
    found = fit(pairs[kept])
    if found.distances.max() > GROSS:
        return np.zeros(len(pairs), dtype=bool), found
    while not kept.all():
        outside = np.flatnonzero(~kept)
        distances = found.predicted_distances(pairs[outside])
        if distances.min() > GROSS:
            break
        kept[outside[distances.argmin()]] = True
        found = fit(pairs[kept])
    return kept, found


def _nearest_majority(pairs: Pairs) -> np.ndarray:
    """Choose the 60 % of the pairs (four or more) that agree best: a boolean mask [n].

    Every triple of pairs gives a transform; chosen are the pairs with the smallest residuals under
    the transform for which the sum of their squares is least.
    """
    needed = min(len(pairs), max(LEAST, ceil(MAJORITY * len(pairs))))
    best, least = np.arange(needed), np.inf
    for triple in triples(len(pairs)):
        three = pairs[triple]
        if three.condition <= DEGENERATE:
            distances = pairs.distances(umeyama(three.source_m, three.target_m))
            nearest = np.argsort(distances, kind="stable")[:needed]
            if (distances[nearest] ** 2).sum() < least:
                best, least = nearest, (distances[nearest] ** 2).sum()
    if least == np.inf:
        require_condition(pairs)
    return np.isin(np.arange(len(pairs)), best)
