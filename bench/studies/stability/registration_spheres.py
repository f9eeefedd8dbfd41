"""Hard cases of the target's spheres: caps that shrink in photographs, balls that draw together in echoes."""

from functools import partial
from itertools import product

import numpy as np

from bench.studies.stability.cases import Seen, Works
from bench.studies.stability.scenes import capture, small_array
from calibration.target.ball_fit import fit_balls
from calibration.target.description import Candidate, Target, default_target
from calibration.target.optical_detection import Cloud, Sphere, fit_sphere
from calibration.target.radar_detection import Ball
from radar.simulation.physics.spheres import sphere_echo

RADIUS_M, RADIUS_SIGMA_M = 0.025, 5e-5
POINTS_M2 = 6e5
TONES_HZ = np.linspace(72e9, 82e9, 16)
PLACE_M = np.array([0.01, -0.02, 0.3])


def outward(z: np.ndarray, azimuth: np.ndarray) -> np.ndarray:
    """Unit vectors [n, 3] of heights z and azimuths [n], radians."""
    ring = np.sqrt(1 - z**2)
    return np.stack([ring * np.cos(azimuth), ring * np.sin(azimuth), z], axis=1)


def _fit(rng: np.random.Generator, normals: np.ndarray, noise_m: float) -> Sphere | None:
    """The fit to places about the origin of a sphere with the radius that is expected, to its tolerance."""
    made_m = RADIUS_M + RADIUS_SIGMA_M * rng.standard_normal()
    points_m = (made_m + noise_m * rng.standard_normal(len(normals)))[:, None] * normals
    start_m = 1e-3 * np.array([1, -1, 1])
    return fit_sphere(Cloud(points_m, normals, oriented=True), start_m, RADIUS_M, (0,), RADIUS_SIGMA_M)


def in_sigmas(found: Candidate, centre_m: np.ndarray) -> float:
    """Distance of a centre from the true one, in its own standard deviations."""
    off_m = found.centre_m - centre_m
    return float(np.sqrt(off_m @ np.linalg.solve(found.covariance_m2, off_m)))


def _caps() -> Seen:
    rng = np.random.default_rng(0)
    parts = (0.45, 0.3, 0.2, 0.15, 0.12, 0.1, 0.09, 0.08, 0.06, 0.03, 0.01)
    for part, noise_m, _ in product(parts, (0.0, 1e-4, 5e-4), range(2)):
        points = int(part * 4 * np.pi * RADIUS_M**2 * POINTS_M2)  # of a thinned cloud
        cap = outward(2 * part * rng.random(points) - 1, 2 * np.pi * rng.random(points))
        found = _fit(rng, cap, noise_m)
        yield f"{part:.0%}, noise {1e3 * noise_m:g} mm", in_sigmas(found, np.zeros(3)) if found else 0.0


def _circles() -> Seen:
    rng = np.random.default_rng(0)
    for height, width, noise_m in product((0.0, 0.03, 0.3, 0.6, 0.99), (0.0, 0.02, 0.1), (0.0, 1e-5, 3e-4)):
        z = np.clip(height + width * rng.uniform(-1, 1, 800), -1, 1)
        found = _fit(rng, outward(z, 2 * np.pi * rng.random(800)), noise_m)
        place = f"{height:g} ± {width:g} radii up, noise {1e3 * noise_m:g} mm"
        yield place, in_sigmas(found, np.zeros(3)) if found else 0.0


def heard(centres_m: np.ndarray, noise: float, off_m: float) -> dict[int, Ball]:
    """The fit to the echoes of up to three balls that stand at centres [n, 3], from places off_m away along each axis;
    noise: its power over the echoes'."""
    first, second = default_target().element[:2]
    target, rng = Target(element=(first, second, second)), np.random.default_rng(1)
    radius_m, delay_m = target.element[0].ball_radius_m, target.foam_delay_m[0]
    samples = sum(sphere_echo(c, radius_m, delay_m, TONES_HZ, small_array()) for c in centres_m).astype(np.complex128)
    level = np.sqrt(noise * np.mean(np.abs(samples) ** 2) / 2)
    white = rng.standard_normal((2, *samples.shape))
    seeds = {i: Ball(c + off_m, np.eye(3), (i,), c, 0.0) for i, c in enumerate(centres_m)}
    return fit_balls(capture(samples + level * (white[0] + 1j * white[1]), TONES_HZ), target, seeds)


def _apart(gap_m: float) -> np.ndarray:
    return PLACE_M + np.array([[0, 0, 0], [gap_m, 0, 0]])


def _near_balls() -> Seen:
    for gap_m, noise in product((0.05, 0.02, 0.015, 0.012, 0.0101), (1e-4, 1.0)):
        for i, ball in heard(_apart(gap_m), noise, off_m=1e-4).items():
            yield f"{1e3 * gap_m:g} mm apart, noise {noise:g}", in_sigmas(ball, _apart(gap_m)[i])


def _one_place() -> Works:
    for gap_m in (0.0099, 0.005, 1e-3, 1e-5, 1e-7, 0.0):
        yield f"{gap_m:g} m apart", partial(heard, _apart(gap_m), noise=0.01, off_m=0.0)
