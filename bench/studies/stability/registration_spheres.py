"""Hard cases of the target's spheres: caps that shrink in photographs, balls that draw together in echoes."""

from functools import partial
from itertools import product

import numpy as np

from bench.studies.stability.cases import Seen, Works
from bench.studies.stability.scenes import capture, small_array
from calibration.target.ball_fit import fit_balls
from calibration.target.description import Candidate, Target, default_target
from calibration.target.matching import match
from calibration.target.optical_detection import Cloud, Sphere, find_spheres, fit_sphere
from calibration.target.radar_detection import Ball
from radar.simulation.physics.spheres import sphere_echo

RADIUS_M, RADIUS_SIGMA_M = 0.025, 5e-5
POINTS_M2 = 6e5
TONES_HZ = np.linspace(72e9, 82e9, 16)
PLACE_M = np.array([0.01, -0.02, 0.3])


def cap(rng: np.random.Generator, part: float, points: int) -> np.ndarray:
    """Outward unit vectors [points, 3], even on the part of a sphere that is nearest to −z."""
    return outward(2 * part * rng.random(points) - 1, 2 * np.pi * rng.random(points))


def outward(z: np.ndarray, azimuth: np.ndarray) -> np.ndarray:
    """Unit vectors [n, 3] of heights z and azimuths [n], radians."""
    ring = np.sqrt(1 - z**2)
    return np.stack([ring * np.cos(azimuth), ring * np.sin(azimuth), z], axis=1)


def points_on(part: float) -> int:
    """Points of a thinned cloud on such a part."""
    return int(part * 4 * np.pi * RADIUS_M**2 * POINTS_M2)


def fitted(rng: np.random.Generator, part: float, noise_m: float) -> Sphere | None:
    """The fit to a cap about the origin of a sphere with the radius that is expected, to its tolerance."""
    return _fit(rng, cap(rng, part, points_on(part)), noise_m)


def _fit(rng: np.random.Generator, normals: np.ndarray, noise_m: float) -> Sphere | None:
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
        found = fitted(rng, part, noise_m)
        yield f"{part:.0%}, noise {1e3 * noise_m:g} mm", in_sigmas(found, np.zeros(3)) if found else 0.0


def _tenth() -> Seen:
    rng = np.random.default_rng(1)
    found = (fitted(rng, 0.1, 1e-4) for _ in range(5))
    return ((f"trial {n + 1}", 1e3 * np.linalg.norm(f.centre_m) if f else 0.0) for n, f in enumerate(found))


def _circles() -> Seen:
    rng = np.random.default_rng(0)
    for height, width, noise_m in product((0.0, 0.03, 0.3, 0.6, 0.99), (0.0, 0.02, 0.1), (0.0, 1e-5, 3e-4)):
        z = np.clip(height + width * rng.uniform(-1, 1, 800), -1, 1)
        found = _fit(rng, outward(z, 2 * np.pi * rng.random(800)), noise_m)
        place = f"{height:g} ± {width:g} radii up, noise {1e3 * noise_m:g} mm"
        yield place, in_sigmas(found, np.zeros(3)) if found else 0.0


def _no_spheres() -> Seen:
    along = np.linspace(-0.1, 0.1, 40)
    plane_m = np.stack(np.meshgrid(along, along, [0.3]), axis=-1).reshape(-1, 3)
    clouds = {
        "line": np.outer(along, [1, 2, 3]),
        "plane": plane_m,
        "plane 10⁶ m away": plane_m + 1e6,
        "one place": np.ones((50, 3)),
        "two places": np.repeat(np.eye(3)[:2], 50, axis=0),
    }
    for (name, points_m), normal in product(clouds.items(), (None, (0.0, 0.0, -1.0), (0.0, 0.0, 0.0))):
        normals = None if normal is None else np.tile(normal, (len(points_m), 1))
        found = find_spheres(points_m, normals, default_target())
        yield f"{name}, normals {'unknown' if normal is None else normal}", len(found)


def _exact_sphere() -> Seen:
    whole = np.array(list(product(range(-9, 10), repeat=3)), float)
    whole = whole[(whole**2).sum(axis=1) == 81] * 2.0**-9  # lengths that have no rounding
    radius_m, clouds = 9 * 2.0**-9, (("whole", whole), ("half", whole[whole[:, 2] > 0]))
    for (name, points_m), sigma_m in product(clouds, (0.0, RADIUS_SIGMA_M)):
        found = fit_sphere(Cloud(points_m, points_m / radius_m, oriented=True), np.zeros(3), radius_m, (0,), sigma_m)
        bad = found is None or not np.isfinite(found.covariance_m2).all()
        off_m = np.inf if bad else np.linalg.norm(found.centre_m)
        yield f"{name}, radius known to {sigma_m:g} m", float(off_m / (np.finfo(float).eps * radius_m))


def _too_little() -> Works:
    target, rng = default_target(), np.random.default_rng(2)
    for part in (0.05, 0.03):
        normals = np.array([cap(rng, part, points_on(part)) for _ in target.element])  # [element, n, 3]
        radii_m = np.array([[[element.sphere_radius_m]] for element in target.element])
        points_m = radii_m + 1e-4 * rng.standard_normal((*normals.shape[:2], 1))
        points_m = target.centres_m[:, None] + points_m * normals
        seen = find_spheres(points_m.reshape(-1, 3), normals.reshape(-1, 3), target)
        yield f"{part:.0%}", partial(match, seen, target, "photographs")


def _pair() -> Target:
    return Target(element=(*default_target().element[:2], default_target().element[1]))


def heard(centres_m: np.ndarray, noise: float, off_m: float, seed: int = 1) -> dict[int, Ball]:
    """The fit to the echoes of up to three balls that stand at centres [n, 3], from places off_m away along each axis;
    noise: its power over the echoes'."""
    target, rng = _pair(), np.random.default_rng(seed)
    radius_m, delay_m = target.element[0].ball_radius_m, target.foam_delay_m[0]
    samples = sum(sphere_echo(c, radius_m, delay_m, TONES_HZ, small_array()) for c in centres_m).astype(np.complex128)
    level = np.sqrt(noise * np.mean(np.abs(samples) ** 2) / 2)
    white = rng.standard_normal((2, *samples.shape))
    return _balls(samples + level * (white[0] + 1j * white[1]), centres_m, off_m)


def _balls(samples: np.ndarray, centres_m: np.ndarray, off_m: float = 0.0) -> dict[int, Ball]:
    seeds = {i: Ball(c + off_m, np.eye(3), (i,), c, 0.0) for i, c in enumerate(centres_m)}
    return fit_balls(capture(samples, TONES_HZ), _pair(), seeds)


def _apart(gap_m: float) -> np.ndarray:
    return PLACE_M + np.array([[0, 0, 0], [gap_m, 0, 0]])


def _near_balls() -> Seen:
    for gap_m, noise in product((0.05, 0.02, 0.015, 0.012, 0.0101), (1e-4, 1.0)):
        for i, ball in heard(_apart(gap_m), noise, off_m=1e-4).items():
            yield f"{1e3 * gap_m:g} mm apart, noise {noise:g}", in_sigmas(ball, _apart(gap_m)[i])


def _one_place() -> Works:
    for gap_m in (0.0099, 0.005, 1e-3, 1e-5, 1e-7, 0.0):
        yield f"{gap_m:g} m apart", partial(heard, _apart(gap_m), noise=0.01, off_m=0.0)


def _silent() -> Works:
    yield "zeros", partial(_balls, np.zeros((len(TONES_HZ), *small_array().channels)), _apart(0.05))
