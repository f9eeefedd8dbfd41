"""Registration: the transform from the photo frame to the radar frame, from a calibration target
that both sensors measure.

The objects that each sensor detects are matched to the target's elements. The elements that both
sensors have found give the transform; the target's description serves only to identify them. With
source points p, target points q and their covariances P, Q, the fit minimises Σ dᵀC⁻¹d of the
residuals d = q − R·p − t, C = R·P·Rᵀ + Q, without pairs that contradict the majority.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from math import ceil

import numpy as np
from scipy.linalg import cho_factor, cho_solve
from scipy.spatial.transform import Rotation
from scipy.special import chdtri

from handbench.calibration.ball_fit import fit_balls
from handbench.calibration.optical_detection import TOWARDS_CAMERAS_PX, find_spheres
from handbench.calibration.radar_detection import find_balls
from handbench.calibration.target import Candidate, Target, match
from handbench.calibration.transforms import Transform, adjoint, perturbation_jacobian, umeyama
from handbench.radar.data.capture import RadarCapture
from handbench.support.errors import HandbenchError
from handbench.support.points import MAJORITY, nearest_majority
from handbench.support.progress import say

HAND_M = np.array([0.0, 0.0, 0.3])  # the hand's centre, radar frame
MAX_STEPS = 20
SETTLED = 1e-13  # of the centres' extent: a step that moves no centre further is the last
GROSS = 10.0  # standard deviations beyond which a pair contradicts a transform
LEAST = 4  # pairs that must agree before another is called wrong
CONDITION = 20.0  # of the rotation, at most: planar centres whose second extent is 5 % of the first
EPS = np.finfo(float).eps


@dataclass(frozen=True)
class Pairs:
    """The same points (balls' centres) as measured by two sensors, called source and target.

    source_m, target_m [n, 3]: positions p and q, each in its sensor's frame; source_cov_m2,
    target_cov_m2 [n, 3, 3]: their covariances P and Q; names [n]: names of the pairs, for messages.
    """

    source_m: np.ndarray
    target_m: np.ndarray
    source_cov_m2: np.ndarray
    target_cov_m2: np.ndarray
    names: np.ndarray

    @classmethod
    def of(
        cls, source: Sequence[Candidate], target: Sequence[Candidate], names: Sequence[str]
    ) -> "Pairs":
        """Make pairs from the measured centres of two sensors, listed in the same order. Raises
        HandbenchError for fewer than three."""
        if len(source) < 3:
            raise HandbenchError(
                f"target: only {len(source)} elements are found both in the "
                "photographs and in the echoes; expected 3 or more; check that all elements are "
                "in view"
            )
        p, q = (np.array([c.centre_m for c in side]) for side in (source, target))
        p_cov, q_cov = (np.array([c.covariance_m2 for c in side]) for side in (source, target))
        return cls(p, q, p_cov, q_cov, np.array(names))

    def __len__(self) -> int:
        return len(self.names)

    def __getitem__(self, chosen: np.ndarray) -> "Pairs":
        """Return the pairs with these indices, or where a mask [n] is True."""
        return Pairs(*(values[chosen] for values in vars(self).values()))

    def __add__(self, other: "Pairs") -> "Pairs":
        both = zip(vars(self).values(), vars(other).values(), strict=True)
        return Pairs(*map(np.concatenate, both))

    @property
    def weights(self) -> np.ndarray:
        """The weight of each pair [n], 1/m², for the closed-form fit: the inverse of its residual's
        variance, averaged over the axes."""
        return 3 / np.trace(self.source_cov_m2 + self.target_cov_m2, axis1=1, axis2=2)

    def information(self, rotation: np.ndarray) -> np.ndarray:
        """Compute the inverse covariances C⁻¹ [n, 3, 3] of the residuals for a rotation R [3, 3]:
        C = R·P·Rᵀ + Q."""
        return np.linalg.inv(rotation @ self.source_cov_m2 @ rotation.T + self.target_cov_m2)

    def offsets(self, matrix: np.ndarray) -> np.ndarray:
        """Compute the residuals d = q − R·p − t [n, 3], metres, of a rigid motion [4, 4]."""
        return self.target_m - self.source_m @ matrix[:3, :3].T - matrix[:3, 3]

    def distances(self, matrix: np.ndarray) -> np.ndarray:
        """Compute the lengths √(dᵀC⁻¹d) [n] of the residuals of a rigid motion [4, 4] in standard
        deviations (Mahalanobis distances)."""
        d = self.offsets(matrix)
        return np.sqrt(np.einsum("ni,nij,nj->n", d, self.information(matrix[:3, :3]), d))

    @property
    def condition(self) -> float:
        """How unevenly the pairs determine the rotation: its uncertainty about the worst axis
        divided by that about the best one. A rotation about axis i is determined by σ_j² + σ_k² of
        the variances σ² along the target points' principal axes; on a line, two of them are 0."""
        away_m = self.target_m - np.average(self.target_m, axis=0, weights=self.weights)
        scatter = (self.weights[:, None] * away_m).T @ away_m
        weak, middle, strong = np.linalg.eigvalsh(scatter)
        worst = weak + middle
        return np.sqrt((middle + strong) / worst) if worst > EPS * strong else np.inf


def motion(step: np.ndarray) -> np.ndarray:
    """Return a small motion [translation_m, rotation_rad] [6] as a matrix [4, 4]."""
    matrix = np.eye(4)
    matrix[:3, :3] = Rotation.from_rotvec(step[3:]).as_matrix()
    matrix[:3, 3] = step[:3]
    return matrix


def fit(pairs: Pairs) -> tuple[np.ndarray, np.ndarray]:
    """Fit the rigid motion from source to target points by maximum likelihood, without rejecting
    any pair, which must determine a rotation: (matrix [4, 4], covariance [6, 6] of [translation_m,
    rotation_rad] about the origin of the target's frame, as in `Transform`).

    Gauss–Newton steps start from the closed form (Umeyama 1991, weighted). The covariance is the
    inverse of JᵀC⁻¹J; if the residuals contradict it (99 %), it is enlarged by χ² over the degrees
    of freedom. Coordinates are relative to the pairs' middle: far from it, rotation and translation
    are numerically indistinguishable.
    """
    p_mean, q_mean = pairs.source_m.mean(axis=0), pairs.target_m.mean(axis=0)
    near = replace(pairs, source_m=pairs.source_m - p_mean, target_m=pairs.target_m - q_mean)
    extent_m = np.linalg.norm(near.target_m, axis=1).max()
    matrix = umeyama(near.source_m, near.target_m, weights=near.weights)
    units = np.diag([extent_m] * 3 + [1.0] * 3)  # of the unknowns
    for _ in range(MAX_STEPS):
        offsets, information = near.offsets(matrix), near.information(matrix[:3, :3])
        jacobian = perturbation_jacobian(near.target_m - offsets) @ units
        normal = np.einsum("nia,nij,njb->ab", jacobian, information, jacobian)
        factor = cho_factor(normal)
        step = cho_solve(factor, np.einsum("nia,nij,nj->a", jacobian, information, offsets))
        matrix = motion(units @ step) @ matrix
        if np.abs(jacobian @ step).max() <= SETTLED * extent_m:
            break
    distances = near.distances(matrix)
    freedom, misfit = 3 * len(pairs) - 6, distances @ distances
    inflation = misfit / freedom if misfit > chdtri(freedom, 0.01) else 1.0
    matrix[:3, 3] += q_mean - matrix[:3, :3] @ p_mean
    to_origin = adjoint(-q_mean) @ units
    covariance = inflation * to_origin @ cho_solve(factor, np.eye(6)) @ to_origin.T
    return matrix, covariance


def majority(pairs: Pairs) -> np.ndarray:
    """Find the majority of pairs that agree on one rigid motion: a boolean mask [n].

    Raises HandbenchError if the pairs do not determine the rotation (with their condition number),
    if more of them agree as a mirror image, and if fewer than four, or fewer than 60 %, agree.
    Three of four are not enough: in a plane they equal their mirror image, and three distances
    agree by chance more often than six.
    """
    needed = min(len(pairs), max(LEAST, ceil(MAJORITY * len(pairs))))
    agree = _agreeing(pairs, needed)
    inverted = replace(pairs, source_m=-pairs.source_m)  # a mirror image, turned by 180°
    mirrored = _agreeing(inverted, needed).sum()
    if mirrored >= needed and mirrored > agree.sum():
        raise HandbenchError(
            f"target: {mirrored} of {len(pairs)} pairs of centres fit a mirror image of the target "
            f"and only {agree.sum()} fit the target; check that both frames are right-handed"
        )
    if agree.sum() < needed:
        residuals_mm = 1e3 * np.linalg.norm(
            pairs.offsets(umeyama(pairs.source_m, pairs.target_m)), axis=1
        )
        shown = [f"{name} {mm:.3g}" for name, mm in zip(pairs.names, residuals_mm, strict=True)]
        raise HandbenchError(
            f"target: its {len(pairs)} pairs of centres disagree by more than {GROSS:g} standard "
            f"deviations (residuals in mm: {', '.join(shown[:12])}); expected at least {needed} "
            "pairs to agree; check the matching and that the target stood still, or record it again"
        )
    condition = pairs[agree].condition
    if condition > CONDITION:
        raise HandbenchError(
            f"target: its {agree.sum()} common elements are on a line (condition number "
            f"{condition:.3g}, expected at most {CONDITION:g}), so the rotation about this line "
            "is unknown; use elements that span a plane"
        )
    return agree


def _agreeing(pairs: Pairs, needed: int) -> np.ndarray:
    """Find the pairs that agree within GROSS with the transform of the `needed` ones that agree
    best: a boolean mask [n]."""

    def distances(chosen: np.ndarray) -> np.ndarray:
        some = pairs[chosen]
        return pairs.distances(umeyama(some.source_m, some.target_m, weights=some.weights))

    def usable(chosen: np.ndarray) -> bool:
        return pairs[chosen].condition <= CONDITION

    best = nearest_majority(len(pairs), needed, usable, distances)
    return np.asarray(distances(best) <= GROSS)


def find_centres(
    points_m: np.ndarray, normals: np.ndarray, capture: RadarCapture, target: Target, pixel_m: float
) -> tuple[Mapping[int, Candidate], Mapping[int, Candidate]]:
    """Measure the target's elements with both sensors: (foam spheres in the photo frame, balls in
    the radar frame), each by element index.

    points_m, normals [n, 3]: point cloud from photographs; pixel_m: size on the surface of a pixel
    of its depth maps. Raises HandbenchError if the objects that a sensor detects do not match the
    target in exactly one way.
    """
    optical = match(find_spheres(points_m, normals, target, pixel_m), target, "photographs")
    balls = find_balls(capture, target)
    return optical, fit_balls(capture, target, match(balls, target, "echoes"), balls)


def common_covariance(target: Target, pixel_m: float = 0.0) -> np.ndarray:
    """Compute the covariance [3, 3] (m²) of the error that all centres share and that residuals
    therefore do not show. It is along z only.

    It comes from the uncertainty σ_ε of the foam's delay (√ε − 1)·(R − a), σ_ε·(R − a)/(2√ε), and
    from the bias of photogrammetry towards the cameras, which are around the radar. pixel_m: size
    on the surface of a pixel of the depth maps.
    """
    deepest_m = max(e.sphere_radius_m - e.ball_radius_m for e in target.element)
    delay_m = target.foam_permittivity_sigma * deepest_m / (2 * np.sqrt(target.foam_permittivity))
    return np.diag([0.0, 0.0, delay_m**2 + (TOWARDS_CAMERAS_PX * pixel_m) ** 2])


def common_pairs(
    optical: Mapping[int, Candidate],
    radar: Mapping[int, Candidate],
    target: Target,
    capture: str,
    captures: int,
) -> Pairs:
    """Pair the balls' centres from photographs and radar, for the elements (by index) that both
    have found. Raises HandbenchError for fewer than three.

    Photographs show the foam sphere only: its ball is at the sphere's centre plus the offset in the
    target's description. capture: its name, for messages; captures: number of captures of this
    target that are fitted together. Each has that many times the variance of the offset, so that
    more captures do not reduce it.
    """
    common = sorted(optical.keys() & radar.keys())
    names = [f"{capture}, element {i + 1}" for i in common]
    pairs = Pairs.of([optical[i] for i in common], [radar[i] for i in common], names)
    photo_from_target = umeyama(target.centres_m[common], pairs.source_m)[:3, :3]
    offset_cov_m2 = captures * target.ball_offset_sigma_m**2 * np.eye(3)
    return replace(
        pairs,
        source_m=pairs.source_m + target.ball_offsets_m[common] @ photo_from_target.T,
        source_cov_m2=pairs.source_cov_m2 + offset_cov_m2,
    )


def solve(pairs: Pairs, common_cov_m2: np.ndarray | float = 0.0) -> Transform:
    """Compute the transform from the photo frame to the radar frame from pairs of centres, by
    maximum likelihood, with its covariance and the residual of every pair.

    Pairs that contradict the majority are reported and left out. common_cov_m2 [3, 3]: covariance
    (m²) of an error common to all pairs, added to the translation's. Raises HandbenchError if the
    pairs do not determine the rotation, or contradict one another so that there is no majority.
    """
    agree = majority(pairs)
    matrix, covariance = fit(pairs[agree])
    residuals_m = np.linalg.norm(pairs.offsets(matrix), axis=1)
    for i in np.flatnonzero(~agree):
        say(
            f"registration: {pairs.names[i]} is {1e3 * residuals_m[i]:.3g} mm away from where the "
            "other elements place it, and is left out"
        )
    covariance[:3, :3] += common_cov_m2  # all centres move together: a translation
    return Transform("photo", "radar", matrix, covariance, residuals_m)
