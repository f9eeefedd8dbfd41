"""The transform between the photographs' frame and the radar's, from one target that both have seen.

Both sensors' candidates are matched to the target's elements; the elements that both have seen give the transform, in
closed form first (`majority`) and then by weighted least squares with every centre's own covariance (`fit`). The
target's drawing serves only to tell the elements apart: what is registered are the two measurements.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from calibration.registration.ransac import majority
from calibration.registration.rigid_fit import Pairs
from calibration.target.ball_fit import fit_balls
from calibration.target.description import Candidate, Target
from calibration.target.matching import match
from calibration.target.optical_detection import TOWARDS_CAMERAS_PX, find_spheres
from calibration.target.radar_detection import find_balls
from calibration.transforms import Transform, umeyama
from radar.data.capture import RadarCapture
from radar.support.progress import say


def calibrate(points_m: np.ndarray, normals: np.ndarray | None, capture: RadarCapture, target: Target) -> Transform:
    """`radar_from_photo` from a cloud of the target ([n, 3], metres, photo frame; normals outward or None) and its
    echoes (radar frame). Raises HandbenchError as `measure` and `solve` do."""
    pairs, common_m2 = measure(points_m, normals, capture, target)
    return solve(pairs, common_m2=common_m2)


def measure(
    points_m: np.ndarray, normals: np.ndarray | None, capture: RadarCapture, target: Target, pixel_m: float = 0.0
) -> tuple[Pairs, np.ndarray]:
    """Measurements of one capture of the target: the balls' centres as both sensors see them, and the covariance [3, 3]
    (m²) of the error that all of them share. pixel_m: of the cloud's depth maps, see `find_spheres`. Raises
    HandbenchError when a sensor's candidates cannot be matched to the target in exactly one way, or both share fewer
    than three elements."""
    seen = match(find_spheres(points_m, normals, target, pixel_m), target, "photographs")
    balls = find_balls(capture, target)
    heard = fit_balls(capture, target, match(balls, target, "echoes"), balls)
    return common_pairs(seen, heard, target), common_covariance(target, pixel_m)


def common_covariance(target: Target, pixel_m: float = 0.0) -> np.ndarray:
    """Covariance [3, 3] (m²) of the error that all centres share, which no residual can show, along z: the foam's delay
    (√ε − 1)·(R − a), and what photographs see all spheres too near by, for the cameras stand around the radar."""
    deepest_m = max(e.sphere_radius_m - e.ball_radius_m for e in target.element)
    delay_m = target.foam_permittivity_sigma * deepest_m / (2 * np.sqrt(target.foam_permittivity))
    return np.diag([0.0, 0.0, delay_m**2 + (TOWARDS_CAMERAS_PX * pixel_m) ** 2])


def common_pairs(seen: Mapping[int, Candidate], heard: Mapping[int, Candidate], target: Target) -> Pairs:
    """The balls' centres of the elements (by index) that both sensors have recognised: in the photographs a ball lies
    where its sphere does, but for the offset and the tolerance of the target's description. Raises HandbenchError for
    fewer than three."""
    common = sorted(seen.keys() & heard.keys())
    elements = [f"element {i + 1}" for i in common]
    pairs = Pairs.of([seen[i] for i in common], [heard[i] for i in common], elements)
    photo_from_target = umeyama(target.centres_m[common], pairs.source_m)[:3, :3]
    offsets_m = target.ball_offsets_m[common] @ photo_from_target.T
    placed_m2 = target.ball_offset_sigma_m**2 * np.eye(3)
    return replace(pairs, source_m=pairs.source_m + offsets_m, source_m2=pairs.source_m2 + placed_m2)


def solve(pairs: Pairs, with_scale: bool = False, common_m2: np.ndarray | None = None) -> Transform:
    """`radar_from_photo` of the pairs that agree, by maximum likelihood, with its covariance and a residual for every
    pair. A pair that the others call wrong is named on stderr; common_m2 [3, 3] is added to the translation's
    covariance.

    Raises HandbenchError when the pairs leave a rotation open or contradict one another without a majority.
    """
    kept, found = majority(pairs, with_scale)
    residuals_m = np.linalg.norm(pairs.offsets(found.matrix), axis=1)
    for i in np.flatnonzero(~kept):
        say(f"registration: {pairs.names[i]} lies {1e3 * residuals_m[i]:.3g} mm off where the others agree; left out")
    covariance = found.covariance_about_origin()
    if common_m2 is not None:
        covariance[:3, :3] += common_m2  # all centres move together: a translation
    return Transform("photo", "radar", found.matrix, covariance, residuals_m)
