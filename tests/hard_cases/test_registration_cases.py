"""Hard cases of registration: centres nearly on a line, mirror images, symmetry, wrong pairs; and
of the target's spheres: caps that shrink in photographs, balls that draw together in echoes; and of
a board with wrong corners.

Pairs fit exactly unless a case is about their errors, so that the transform that made them is the
reference.
"""

import io
from contextlib import redirect_stderr
from functools import partial
from itertools import product

import numpy as np
from scipy.spatial.transform import Rotation
from scipy.stats import chi2

from handbench.calibration.registration.rigid_fit import GROSS
from handbench.calibration.spheres.ball_fit import fit_balls
from handbench.calibration.spheres.description import (
    Candidate,
    Element,
    Target,
    default_target,
    match,
)
from handbench.calibration.spheres.optical_detection import find_spheres, fit_sphere
from handbench.calibration.spheres.radar_detection import DetectedBall
from handbench.calibration.transforms import Transform
from handbench.groundtruth.sparse.frame import TRIM, trimmed_similarity
from handbench.radar.simulation.physics.spheres import sphere_echo
from handbench.support.errors import HandbenchError
from tests.calibration.seen_target import align
from tests.hard_cases.cases import Seen, Works, hard_case, refusal
from tests.hard_cases.scenes import capture, small_array
from tests.references.balls import off, rotation

EPS = np.finfo(float).eps
SIGMA_M = 1e-4  # of a centre, per axis
HALF_M = 0.06  # of the target's square
SHIFT_M = np.array([0.1, -0.2, 0.3])
FIVE = default_target().centres_m
PLANE = FIVE * [1, 1, 0]
TURN = Rotation.from_rotvec([0.3, -1.1, 2.0]).as_matrix()
PARTS = (0.45, 0.3, 0.2, 0.15, 0.12, 0.1, 0.09, 0.08, 0.06, 0.03, 0.01)  # of a sphere that caps are
GAPS_M = (0.05, 0.02, 0.015, 0.012, 0.0101)  # between balls


def normal_errors(count: int) -> float:
    """Distance, in σ, that the largest of so many normal errors of three coordinates exceeds once
    in a thousand sweeps."""
    return float(np.sqrt(chi2.isf(1e-3 / count, 3)))


def candidates(centres_m: np.ndarray) -> list[Candidate]:
    """Centres [n, 3] as a sensor gives them."""
    return [Candidate(c, SIGMA_M**2 * np.eye(3), tuple(range(len(centres_m)))) for c in centres_m]


def registered(source_m: np.ndarray, target_m: np.ndarray) -> Transform:
    """The product's transform, without what it says of pairs that it leaves out."""
    with redirect_stderr(io.StringIO()):
        return align(candidates(source_m), candidates(target_m))


def _rectangle(half_m: float) -> np.ndarray:
    return np.array([[x, y, 0] for x in (-HALF_M, HALF_M) for y in (-half_m, half_m)])


@hard_case(
    "centres nearly on a line",
    kind="rigorous",
    bound=1.0,
    unit="roundings",
    quantity="rotation error over the condition number",
    reference="least squares of the same pairs, in balls (Horn's quaternion)",
)
def test_nearly_collinear() -> Seen:
    """The worst axis turns κ times as far as the best one, which four roundings turn; κ ≤ 20 is
    given."""
    for half_m in HALF_M / np.array([1, 2, 5, 10, 15, 19, 19.9]):
        points_m = _rectangle(half_m)
        moved_m, kappa = points_m @ TURN.T + SHIFT_M, np.hypot(HALF_M, half_m) / half_m
        apart = off(registered(points_m, moved_m).rotation, rotation(points_m, moved_m))
        off_rad = np.linalg.norm(apart) / np.sqrt(2)  # of matrices a small angle apart
        four_rad = (
            4 * EPS * max(np.abs(points_m).max(), np.abs(moved_m).max()) / HALF_M
        )  # across the half width
        yield f"κ = {kappa:.3g}", float(off_rad / four_rad) / kappa


@hard_case(
    "a mirror image whose height shrinks",
    kind="derived",
    bound=GROSS,
    unit="σ",
    quantity="largest distance of a pair after the fit",
    reference="the pair's own standard deviation",
)
def test_shrinking_mirror() -> Seen:
    """The pairs of a given transform must agree within the limit of a wrong pair; a plane is
    its own mirror image."""
    for height_m in (0, 1e-6, 1e-5, *np.logspace(-4, -1, 25)):
        points_m = np.array([*PLANE[:4], [*PLANE[4, :2], height_m]])
        try:
            found = registered(points_m, points_m * [1, 1, -1] @ TURN.T + SHIFT_M)
        except HandbenchError:
            yield f"refused at a height of {height_m:g} m", 0.0
        else:
            yield f"height {height_m:g} m", float(max(found.residuals_m) / (np.sqrt(2) * SIGMA_M))


@hard_case(
    "a target that grows symmetric",
    kind="derived",
    bound=0.0,
    unit="elements",
    quantity="elements that are taken for another",
    reference="the elements' order",
)
def test_nearly_symmetric() -> Seen:
    """Two readings within the tolerance of 2 mm are refused, one beyond it is the right one."""
    rng = np.random.default_rng(1)
    for skew_m in (*np.linspace(0.02, 0.001, 20), 1e-4, 0.0):
        places = ((-HALF_M, 0.0, 0.0), (HALF_M, 0.0, 0.0), (skew_m / 2, 0.09, 0.0))
        target = Target(
            element=tuple(
                Element(centre_m=p, sphere_radius_m=0.02, ball_radius_m=0.005) for p in places
            )
        )
        moved_m = target.centres_m @ TURN.T + SHIFT_M + SIGMA_M * rng.standard_normal((3, 3))
        try:
            found = match(candidates(moved_m), target, "echoes")
        except HandbenchError:
            yield f"refused at a skew of {1e3 * skew_m:.3g} mm", 0.0
        else:
            wrong = sum(
                bool((c.centre_m != moved_m[element]).any()) for element, c in found.items()
            )
            yield f"skew of {1e3 * skew_m:.3g} mm", float(wrong)


@hard_case(
    "one wrong pair in five",
    kind="derived",
    bound=GROSS,
    unit="σ",
    quantity="error of the transform",
    reference="the other four, exact",
)
def test_one_wrong() -> Seen:
    """A pair D σ off pulls by D of the transform's own σ at most, and D ≤ 10 is kept."""
    rng = np.random.default_rng(0)
    for size_m, wrong in product(np.logspace(-6, 6, 37), range(5)):
        way = rng.standard_normal(3)
        moved_m = FIVE + SHIFT_M
        moved_m[wrong] += size_m * way / np.linalg.norm(way)
        found = registered(FIVE, moved_m)
        step = np.r_[
            found.matrix[:3, 3] - found.rotation @ SHIFT_M,
            Rotation.from_matrix(found.rotation).as_rotvec(),
        ]
        yield (
            f"pair {wrong + 1}, {size_m:.2g} m off",
            float(np.sqrt(step @ np.linalg.solve(found.require_covariance(), step))),
        )


RADIUS_M, RADIUS_SIGMA_M = 0.025, 5e-5
POINTS_M2 = 6e5
TONES_HZ = np.linspace(72e9, 82e9, 16)
PLACE_M = np.array([0.01, -0.02, 0.3])


def outward(z: np.ndarray, azimuth: np.ndarray) -> np.ndarray:
    """Unit vectors [n, 3] of heights z and azimuths [n], radians."""
    ring = np.sqrt(1 - z**2)
    return np.stack([ring * np.cos(azimuth), ring * np.sin(azimuth), z], axis=1)


def _cap(rng: np.random.Generator, part: float) -> np.ndarray:
    """Unit vectors [n, 3] to a thinned cloud's points on the part of a sphere that is nearest to
    −z."""
    points = int(part * 4 * np.pi * RADIUS_M**2 * POINTS_M2)
    return outward(2 * part * rng.random(points) - 1, 2 * np.pi * rng.random(points))


def _fit(rng: np.random.Generator, normals: np.ndarray, noise_m: float) -> Candidate | None:
    """The fit to places about the origin of a sphere with the radius that is expected, to its
    tolerance."""
    made_m = RADIUS_M + RADIUS_SIGMA_M * rng.standard_normal()
    points_m = (made_m + noise_m * rng.standard_normal(len(normals)))[:, None] * normals
    start_m = 1e-3 * np.array([1, -1, 1])
    found = fit_sphere(points_m, normals, start_m, RADIUS_M, RADIUS_SIGMA_M)
    return found and Candidate(*found, ())


def in_sigmas(found: Candidate, centre_m: np.ndarray) -> float:
    """Distance of a centre from the true one, in its own standard deviations."""
    off_m = found.centre_m - centre_m
    return float(np.sqrt(off_m @ np.linalg.solve(found.covariance_m2, off_m)))


@hard_case(
    "spheres of which a cap is seen",
    kind="derived",
    bound=normal_errors(6 * sum(part >= 0.08 for part in PARTS)),
    unit="σ",
    quantity="error of the centre",
    reference="the sphere's own",
)
def test_caps() -> Seen:
    """Its stated σ must cover it: a normal error of one of the sweep's centres is beyond it
    once in a thousand sweeps (χ² of three); caps of 45 % to 1 %, below 8 % none is given."""
    rng = np.random.default_rng(0)
    for part, noise_m, _ in product(PARTS, (0.0, 1e-4, 5e-4), range(2)):
        found = _fit(rng, _cap(rng, part), noise_m)
        yield (
            f"{part:.0%}, noise {1e3 * noise_m:g} mm",
            in_sigmas(found, np.zeros(3)) if found else 0.0,
        )


@hard_case(
    "points that lie on a sphere exactly",
    kind="derived",
    bound=0.0,
    unit="m",
    quantity="error of the centre",
    reference="the sphere's own",
)
def test_exact_sphere() -> Seen:
    """Lengths, distances and residuals are exact in binary: nothing is left to fit, and nothing
    to divide by."""
    points_m = np.array(list(product(range(-9, 10), repeat=3)), float)
    points_m = points_m[(points_m**2).sum(axis=1) == 81] * 2.0**-9  # lengths without a rounding
    radius_m = 9 * 2.0**-9
    for sigma_m in (0.0, RADIUS_SIGMA_M):
        found = fit_sphere(points_m, points_m / radius_m, np.zeros(3), radius_m, sigma_m)
        known = found is not None and np.isfinite(found[1]).all()
        yield f"radius known to {sigma_m:g} m", np.linalg.norm(found[0]) if known else np.inf


@refusal("a target of which 5 % is seen", "in view")
def test_too_little() -> Works:
    """Below a coverage of 8 %, a cap is no sphere."""
    target, rng = default_target(), np.random.default_rng(2)
    for part in (0.05, 0.03):
        normals = np.array([_cap(rng, part) for _ in target.element])  # [element, n, 3]
        radii_m = np.array([[[element.sphere_radius_m]] for element in target.element])
        radii_m = radii_m + 1e-4 * rng.standard_normal((*normals.shape[:2], 1))
        points_m = target.centres_m[:, None] + radii_m * normals
        seen = find_spheres(points_m.reshape(-1, 3), normals.reshape(-1, 3), target)
        yield f"{part:.0%}", partial(match, seen, target, "photographs")


def fitted(centres_m: np.ndarray, noise: float, off_m: float) -> dict[int, DetectedBall]:
    """The fit to the echoes of up to three balls that stand at centres [n, 3], from places off_m
    away along each axis; noise: its power over the echoes'."""
    first, second = default_target().element[:2]
    target, rng = Target(element=(first, second, second)), np.random.default_rng(1)
    radius_m, delay_m = target.element[0].ball_radius_m, target.foam_delay_m[0]
    one_by_one = [sphere_echo(c, radius_m, delay_m, TONES_HZ, small_array()) for c in centres_m]
    samples = np.sum(one_by_one, axis=0, dtype=np.complex128)
    level = np.sqrt(noise * np.mean(np.abs(samples) ** 2) / 2)
    white = rng.standard_normal((2, *samples.shape))
    seeds = {i: DetectedBall(c + off_m, np.eye(3), (i,), c) for i, c in enumerate(centres_m)}
    return fit_balls(capture(samples + level * (white[0] + 1j * white[1]), TONES_HZ), target, seeds)


def _apart(gap_m: float) -> np.ndarray:
    return PLACE_M + np.array([[0, 0, 0], [gap_m, 0, 0]])


@hard_case(
    "balls that draw together",
    kind="derived",
    bound=normal_errors(4 * len(GAPS_M)),
    unit="σ",
    quantity="error of a centre",
    reference="the ball's own",
)
def test_near_balls() -> Seen:
    """Its stated σ must cover it: a normal error of one of the sweep's centres is beyond it
    once in a thousand sweeps (χ² of three); 50 mm apart until they touch, at 10 mm."""
    for gap_m, noise in product(GAPS_M, (1e-4, 1.0)):
        for i, ball in fitted(_apart(gap_m), noise, off_m=1e-4).items():
            yield f"{1e3 * gap_m:g} mm apart, noise {noise:g}", in_sigmas(ball, _apart(gap_m)[i])


@refusal("balls in one place", "would overlap")
def test_one_place() -> Works:
    """Nearer than their radii balls overlap; fitted all the same, they are off by 100 σ from
    0.7 mm on."""
    for gap_m in (0.0099, 0.005, 1e-3, 1e-5, 1e-7, 0.0):
        yield f"{gap_m:g} m apart", partial(fitted, _apart(gap_m), noise=0.01, off_m=0.0)


GRID = np.array(
    [[x, y, 0] for x in np.linspace(-0.1, 0.1, 5) for y in np.linspace(-0.07, 0.07, 4)]
)  # of a board


@hard_case(
    "one board corner in five wrong",
    kind="derived",
    bound=TRIM * 2 * float(np.sqrt(chi2.median(3))),
    unit="σ",
    quantity="root mean square of the others' error",
    reference="the similarity that made the corners",
)
def test_wrong_corners() -> Seen:
    """Corners lie within 4 medians of the fit, the median within 2 of the majority's own, 1.54
    σ: 12.3 σ."""
    for size_m, apart in product(np.logspace(-5, 4, 28), (True, False)):
        rng = np.random.default_rng(3)
        chosen = 5 * np.arange(4) if apart else np.arange(4)
        way = rng.standard_normal((4, 3)) if apart else np.array([[0.0, 0.0, 1.0]] * 4)
        source = GRID + SIGMA_M * rng.standard_normal(GRID.shape)
        source[chosen] += size_m * way / np.linalg.norm(way, axis=1, keepdims=True)
        matrix = trimmed_similarity(source, GRID, "board corners")[0]
        off_m = np.delete(GRID @ matrix[:3, :3].T + matrix[:3, 3] - GRID, chosen, axis=0)
        place = f"{'each its own way' if apart else 'a whole side'}, {size_m:.2g} m off"
        yield place, float(np.sqrt((off_m**2).sum(axis=1).mean()) / SIGMA_M)
