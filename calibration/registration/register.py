"""Registration: the transform from the photo frame to the radar frame, from a calibration target
that both sensors measure.

The objects that each sensor detects are matched to the target's elements. The elements that both
sensors have found give the transform, by weighted least squares with the covariance of each centre.
The target's description serves only to identify the elements; the transform is between the two
measurements.
"""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from handbench.calibration.registration.rigid_fit import Pairs, fit, majority
from handbench.calibration.spheres.ball_fit import fit_balls
from handbench.calibration.spheres.description import Candidate, Target, match
from handbench.calibration.spheres.optical_detection import TOWARDS_CAMERAS_PX, find_spheres
from handbench.calibration.spheres.radar_detection import find_balls
from handbench.calibration.transforms import Transform, umeyama
from handbench.radar.data.capture import RadarCapture
from handbench.support.progress import say

HAND_M = np.array([0.0, 0.0, 0.3])  # the hand's centre, radar frame


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
