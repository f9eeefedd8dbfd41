"""Registration: the transform from the photo frame to the radar frame, from a calibration target
that both sensors measure.

The objects that each sensor detects are matched to the target's elements. The elements that both
sensors have found give the transform: first in closed form (`majority`), then by weighted least
squares with the covariance of each centre (`fit`). The target's description serves only to identify
the elements; the transform is between the two measurements.

Two captures of the target give two transforms with covariances, whose difference shows whether the
rig of radar and cameras has moved. Errors that are common to all balls (such as those of creeping
waves) are the same in every capture: they cancel in the difference, and averaging captures does not
reduce them.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np
from scipy.spatial.transform import Rotation
from scipy.special import chdtrc, chdtri

from handbench.calibration.registration.rigid_fit import Pairs, majority
from handbench.calibration.spheres.ball_fit import fit_balls
from handbench.calibration.spheres.description import Candidate, Target, match
from handbench.calibration.spheres.optical_detection import TOWARDS_CAMERAS_PX, find_spheres
from handbench.calibration.spheres.radar_detection import find_balls
from handbench.calibration.transforms import Transform, adjoint, perturbation_jacobian, umeyama
from handbench.radar.data.capture import RadarCapture
from handbench.support.errors import HandbenchError
from handbench.support.progress import say

HAND_M = np.array([0.0, 0.0, 0.3])  # the hand's centre, radar frame
FALSE_ALARM = 0.01  # probability that a rig at rest is reported as moved


def measure(
    points_m: np.ndarray,
    normals: np.ndarray | None,
    capture: RadarCapture,
    target: Target,
    pixel_m: float = 0.0,
) -> tuple[Pairs, np.ndarray]:
    """Measure the balls' centres with both sensors in one capture of the target: (pairs of centres
    from photographs and radar, covariance [3, 3] (m²) of the error common to all of them).

    points_m, normals [n, 3]: point cloud from photographs; pixel_m: size on the surface of a pixel
    of its depth maps. Raises HandbenchError if the objects that a sensor detects do not match the
    target in exactly one way, or if the sensors share fewer than three elements.
    """
    optical = match(find_spheres(points_m, normals, target, pixel_m), target, "photographs")
    balls = find_balls(capture, target)
    radar = fit_balls(capture, target, match(balls, target, "echoes"), balls)
    return common_pairs(optical, radar, target), common_covariance(target, pixel_m)


def common_covariance(target: Target, pixel_m: float = 0.0) -> np.ndarray:
    """Compute the covariance [3, 3] (m²) of the error that all centres share and that residuals
    therefore do not show. It is along z only.

    It comes from the uncertainty of the foam's delay (√ε − 1)·(R − a), and from the bias of
    photogrammetry towards the cameras, which are around the radar. pixel_m: size on the surface of
    a pixel of the depth maps.
    """
    deepest_m = max(e.sphere_radius_m - e.ball_radius_m for e in target.element)
    delay_m = target.foam_permittivity_sigma * deepest_m / (2 * np.sqrt(target.foam_permittivity))
    return np.diag([0.0, 0.0, delay_m**2 + (TOWARDS_CAMERAS_PX * pixel_m) ** 2])


def common_pairs(
    optical: Mapping[int, Candidate], radar: Mapping[int, Candidate], target: Target
) -> Pairs:
    """Pair the balls' centres from photographs and radar, for the elements (by index) that both
    have found. Raises HandbenchError for fewer than three.

    Photographs show the foam sphere only: its ball is at the sphere's centre plus the offset in the
    target's description, whose tolerance is added to the covariance.
    """
    common = sorted(optical.keys() & radar.keys())
    elements = [f"element {i + 1}" for i in common]
    pairs = Pairs.of([optical[i] for i in common], [radar[i] for i in common], elements)
    photo_from_target = umeyama(target.centres_m[common], pairs.source_m)[:3, :3]
    offsets_m = target.ball_offsets_m[common] @ photo_from_target.T
    placed_m2 = target.ball_offset_sigma_m**2 * np.eye(3)
    return replace(
        pairs, source_m=pairs.source_m + offsets_m, source_m2=pairs.source_m2 + placed_m2
    )


def solve(pairs: Pairs, common_m2: np.ndarray | None = None) -> Transform:
    """Compute the transform from the photo frame to the radar frame from pairs of centres, by
    maximum likelihood, with its covariance and the residual of every pair.

    Pairs that contradict the majority are reported and left out. common_m2 [3, 3]: covariance (m²)
    of an error common to all pairs, added to the translation's. Raises HandbenchError if the pairs
    do not determine the rotation, or contradict one another so that there is no majority.
    """
    kept, found = majority(pairs)
    residuals_m = np.linalg.norm(pairs.offsets(found.matrix), axis=1)
    for i in np.flatnonzero(~kept):
        say(
            f"registration: {pairs.names[i]} is {1e3 * residuals_m[i]:.3g} mm away from where the "
            "other elements place it, and is left out"
        )
    covariance = found.covariance_about_origin()
    if common_m2 is not None:
        covariance[:3, :3] += common_m2  # all centres move together: a translation
    return Transform("photo", "radar", found.matrix, covariance, residuals_m)


@dataclass(frozen=True)
class RigMotion:
    """Motion of the rig (radar and cameras relative to each other) between two captures.

    step: change of the transform about the hand's centre, [shift_m, rotation_rad(, log scale)];
    covariance [6, 6] or [7, 7]: that of the step; first, second: names of the captures.
    """

    step: np.ndarray
    covariance: np.ndarray
    first: str
    second: str

    @property
    def chi2(self) -> float:
        """Squared Mahalanobis distance of the step (change of the transform) from zero."""
        return float(self.step @ np.linalg.solve(self.covariance, self.step))

    @property
    def probability(self) -> float:
        """p-value of the step: the probability that a rig at rest shows a step this large or
        larger."""
        return float(chdtrc(len(self.step), max(self.chi2, 0.0)))

    @property
    def moved(self) -> bool:
        """True if the rig moved: fewer than 1 % of all pairs of captures of a rig at rest would
        show so large a step."""
        return self.probability < FALSE_ALARM

    @property
    def shift_m(self) -> float:
        """Distance by which a point at the hand's centre is displaced, metres."""
        return float(np.linalg.norm(self.step[:3]))

    @property
    def interval_m(self) -> tuple[float, float]:
        """Confidence interval of `shift_m`, metres, which contains the true distance with a
        probability of 95 % or more.

        It follows from the confidence ellipsoid of the shift (Scheffé 1953): its radius along the
        estimated shift gives the lower end, its longest radius the upper end.
        """
        reach, spread = np.sqrt(chdtri(3, 0.05)), self.covariance[:3, :3]
        along = self.step[:3] / max(self.shift_m, 1e-300)
        low = self.shift_m - reach * np.sqrt(along @ spread @ along)
        return max(0.0, float(low)), self.shift_m + float(
            reach * np.sqrt(np.linalg.eigvalsh(spread)[-1])
        )

    @property
    def sentence(self) -> str:
        """The result of the test in one sentence, with distance, interval and p-value."""
        low_mm, high_mm = (1e3 * limit for limit in self.interval_m)
        verb = "moved" if self.moved else "did not measurably move"
        return (
            f"the rig {verb} between {self.first} and {self.second}: {1e3 * self.shift_m:.3g} mm "
            "at the hand's centre "
            f"(95 % interval {low_mm:.3g} to {high_mm:.3g} mm; χ² = {self.chi2:.3g} for "
            f"{len(self.step)} degrees of "
            f"freedom, p = {self.probability:.2g})"
        )


def motion(
    first: Transform,
    second: Transform,
    names: tuple[str, str] = ("the first capture", "the second"),
) -> RigMotion:
    """Estimate the rig's motion between two captures of the target from the transforms (photo to
    radar frame) of both.

    names: names of the captures, for messages. Raises HandbenchError if frames or unknowns differ,
    or if a covariance is missing or zero.
    """
    second.require(first.source, first.target, names[1])
    one, other = first.covariance, second.covariance
    if one is None or other is None or len(one) != len(other):
        sizes = [0 if covariance is None else len(covariance) for covariance in (one, other)]
        raise HandbenchError(
            f"{names[0]}, {names[1]}: their covariances have the sizes {sizes[0]} and {sizes[1]}; "
            "expected 6 and 6, or 7 and 7 with a scale; calibrate both again"
        )
    carry = adjoint(HAND_M, len(one))
    covariance = carry @ (one + other) @ carry.T
    if np.linalg.eigvalsh(covariance)[0] <= 0:
        raise HandbenchError(
            f"{names[0]}, {names[1]}: their covariances are zero in some direction; expected "
            "positive ones; calibrate both again"
        )
    turn = Rotation.from_matrix(second.rotation @ first.rotation.T).as_rotvec()
    shift_m = second.points(first.inverse().points(HAND_M)) - HAND_M
    step = np.array([*shift_m, *turn, np.log(second.scale / first.scale)])[: len(one)]
    return RigMotion(step, covariance, *names)


def combine(
    captures: Sequence[Pairs],
    common_m2: np.ndarray | None = None,
    names: Sequence[str] = (),
    ball_offset_sigma_m: float = 0.0,
) -> Transform:
    """Compute the transform from the photo frame to the radar frame from several captures of one
    target, by joint weighted least squares. Residuals are in the order of the captures.

    names: names of the captures, for messages. common_m2 [3, 3]: covariance (m²) of an error common
    to all pairs and captures, which averaging does not reduce. ball_offset_sigma_m: standard
    deviation of the balls' offsets in their spheres, part of the pairs' covariances; it is not
    reduced either, since the target is assumed to keep its orientation. Raises HandbenchError if
    the rig moved between two captures.
    """
    names = list(names) or [f"capture {i + 1}" for i in range(len(captures))]
    both = zip(names, captures, strict=True)
    named = [
        replace(pairs, names=tuple(f"{name}, {pair}" for pair in pairs.names))
        for name, pairs in both
    ]
    require_no_motion([solve(pairs) for pairs in named], names)
    found = solve(sum(named[1:], named[0]), common_m2)
    covariance = found.require_covariance()
    # covariance by the balls' offsets only, about the origin
    offsets = []
    for pairs in named:
        middle_m = pairs.target_m.mean(axis=0)
        jacobian = perturbation_jacobian(pairs.target_m - middle_m)[..., :6].reshape(-1, 6)
        carry = adjoint(-middle_m, 6)
        offsets.append(
            ball_offset_sigma_m**2 * carry @ np.linalg.inv(jacobian.T @ jacobian) @ carry.T
        )
    covariance += (1 - 1 / len(named)) * np.mean(offsets, axis=0)
    return found


def require_no_motion(transforms: Sequence[Transform], names: Sequence[str]) -> None:
    """Raise HandbenchError if the rig moved between any two captures. All combinations of two
    captures are tested together at a false-alarm probability of 1 % (Bonferroni)."""
    every_two = combinations(zip(transforms, names, strict=True), 2)
    motions = [motion(first, second, names=(a, b)) for (first, a), (second, b) in every_two]
    worst = min(motions, key=lambda m: m.probability, default=None)
    if worst is not None and worst.probability < FALSE_ALARM / len(motions):
        raise HandbenchError(
            f"{worst.sentence}; use only the captures before or only those after the move"
        )
