"""Hard cases of registration: turns, lines, planes, mirror images, symmetry, wrong pairs, and places far away.

Pairs fit exactly unless a case is about their errors, so that the transform that made them is the reference.
"""

import io
from contextlib import redirect_stderr
from functools import partial
from itertools import product

import numpy as np
from scipy.spatial.transform import Rotation

from bench.studies.stability.cases import Seen, Works
from calibration.registration import ransac
from calibration.registration.register import solve
from calibration.registration.rigid_fit import HUBER, Pairs
from calibration.target.description import Candidate, Element, Target, default_target
from calibration.target.matching import match
from calibration.transforms import Transform, condition_number
from radar.support.errors import HandbenchError

EPS = np.finfo(float).eps
SIGMA_M = 1e-4  # of a centre, per axis
HALF_M = 0.06  # of the target's square
SHIFT_M = np.array([0.1, -0.2, 0.3])
FIVE = default_target().centres_m
PLANE = FIVE * [1, 1, 0]
TURN = Rotation.from_rotvec([0.3, -1.1, 2.0]).as_matrix()
BOUNDS = {"shrinking_mirror": ransac.GROSS, "one_wrong": float(np.sqrt(HUBER * ransac.GROSS))}


def candidates(centres_m: np.ndarray) -> list[Candidate]:
    """Centres [n, 3] as a sensor gives them."""
    return [Candidate(c, SIGMA_M**2 * np.eye(3), tuple(range(len(centres_m)))) for c in centres_m]


def registered(source_m: np.ndarray, target_m: np.ndarray) -> Transform:
    """The product's transform, without what it says of pairs that it leaves out."""
    with redirect_stderr(io.StringIO()):
        return solve(Pairs.of(candidates(source_m), candidates(target_m)))


def turn_roundings(source_m: np.ndarray, moved_m: np.ndarray, turn: np.ndarray) -> float:
    """Angle from the rotation [3, 3] that made the pairs to the one found, over what four roundings of the largest
    coordinate turn across the target's half width."""
    angle_rad = np.linalg.norm(Rotation.from_matrix(registered(source_m, moved_m).rotation @ turn.T).as_rotvec())
    return float(angle_rad / (4 * EPS * max(np.abs(source_m).max(), np.abs(moved_m).max()) / HALF_M))


def _half_turns() -> Seen:
    axes = ((1, 0, 0), (0, 1, 0), (0, 0, 1), (1, 1, 0), (1, -2, 3))
    shorts_rad = (0, 1e-16, 1e-15, 1e-12, 1e-8, 1e-4, 0.1, 3.1)
    for axis, short_rad, (name, points_m) in product(axes, shorts_rad, (("solid", FIVE), ("plane", PLANE))):
        turn = Rotation.from_rotvec((np.pi - short_rad) * np.array(axis) / np.linalg.norm(axis)).as_matrix()
        place = f"{name}, axis {axis}, 180° less {short_rad:g} rad"
        yield place, turn_roundings(points_m, points_m @ turn.T + SHIFT_M, turn)


def _rectangle(half_m: float) -> np.ndarray:
    return np.array([[x, y, 0] for x in (-HALF_M, HALF_M) for y in (-half_m, half_m)])


def _nearly_collinear() -> Seen:
    for half_m in HALF_M / np.array([1, 2, 5, 10, 15, 19, 19.9]):
        points_m = _rectangle(half_m)
        kappa = np.hypot(HALF_M, half_m) / half_m
        yield f"κ = {kappa:.3g}", turn_roundings(points_m, points_m @ TURN.T + SHIFT_M, TURN) / kappa


def _collinear() -> Works:
    for half_m in (*HALF_M / np.array([20.1, 1e2, 1e4, 1e8, 1e15]), 0.0):
        points_m = _rectangle(half_m)
        yield f"half width {half_m:.2g} m", partial(registered, points_m, points_m @ TURN.T + SHIFT_M)


def _condition() -> Seen:
    for half_m in HALF_M * np.logspace(0, -12, 49):
        points_m = _rectangle(half_m)
        kappa, found = np.hypot(HALF_M, half_m) / half_m, condition_number(points_m, points_m @ TURN.T)
        lost = EPS * kappa**2 > 0.1
        yield f"κ = {kappa:.3g}", 0.0 if lost and found > 1e7 else abs(found / kappa - 1) / (EPS * kappa**2)
    yield "on a line", 0.0 if condition_number(_rectangle(0), _rectangle(0)) > 1e7 else np.inf


def _far_away() -> Seen:
    for away_m in (1e0, 1e2, 1e4, 1e6, 1e7):
        for name, source_m, extra_m in (("source", FIVE + away_m, 0), ("target", FIVE, away_m)):
            moved_m = (source_m - source_m.mean(axis=0)) @ TURN.T + extra_m
            yield f"{name} {away_m:g} m away", turn_roundings(source_m, moved_m, TURN)


def _solid(height_m: float) -> np.ndarray:
    """The target's square with its fifth centre at a height."""
    return np.array([*PLANE[:4], [*PLANE[4, :2], height_m]])


def _shrinking_mirror() -> Seen:
    for height_m in (0, 1e-6, 1e-5, *np.logspace(-4, -1, 25)):
        points_m = _solid(height_m)
        try:
            found = registered(points_m, points_m * [1, 1, -1] @ TURN.T + SHIFT_M)
        except HandbenchError:
            yield f"refused at a height of {height_m:g} m", 0.0
        else:
            yield f"height {height_m:g} m", float(found.residuals_m.max() / (np.sqrt(2) * SIGMA_M))


def _triangle(skew_m: float) -> Target:
    places = ((-HALF_M, 0.0, 0.0), (HALF_M, 0.0, 0.0), (skew_m / 2, 0.09, 0.0))
    return Target(element=tuple(Element(centre_m=p, sphere_radius_m=0.02, ball_radius_m=0.005) for p in places))


def _nearly_symmetric() -> Seen:
    rng = np.random.default_rng(1)
    for skew_m in (*np.linspace(0.02, 0.001, 20), 1e-4, 0.0):
        target = _triangle(skew_m)
        moved_m = target.centres_m @ TURN.T + SHIFT_M + SIGMA_M * rng.standard_normal((3, 3))
        try:
            found = match(candidates(moved_m), target, "echoes")
        except HandbenchError:
            yield f"refused at a skew of {1e3 * skew_m:.3g} mm", 0.0
        else:
            wrong = sum(bool((c.centre_m != moved_m[element]).any()) for element, c in found.items())
            yield f"skew of {1e3 * skew_m:.3g} mm", float(wrong)


def _symmetric() -> Works:
    square = Target(element=default_target().element[:4])
    for name, t in (("a square", square), ("an even triangle", _triangle(0.0)), ("nearly so", _triangle(5e-4))):
        yield name, partial(match, candidates(t.centres_m @ TURN.T), t, "echoes")


def _shift_in_sigmas(found: Transform) -> float:
    """Distance of a transform from the shift alone, in its own standard deviations."""
    step = np.r_[found.matrix[:3, 3] - found.rotation @ SHIFT_M, Rotation.from_matrix(found.rotation).as_rotvec()]
    return float(np.sqrt(step @ np.linalg.solve(found.covariance, step)))


def _one_wrong() -> Seen:
    rng = np.random.default_rng(0)
    for size_m, wrong in product(np.logspace(-6, 6, 37), range(5)):
        way = rng.standard_normal(3)
        moved_m = FIVE + SHIFT_M
        moved_m[wrong] += size_m * way / np.linalg.norm(way)
        yield f"pair {wrong + 1}, {size_m:.2g} m off", _shift_in_sigmas(registered(FIVE, moved_m))


def _two_wrong() -> Works:
    bent = np.array([[1, 0, 0], [0, -1, 1], [0, 0, 0], [0, 0, 0], [0, 0, 0]])
    for size_m in (0.01, 0.03, 0.3, 30.0, 3e3, 1e6):
        yield f"{size_m:g} m off", partial(registered, FIVE, FIVE + SHIFT_M + size_m * bent)
