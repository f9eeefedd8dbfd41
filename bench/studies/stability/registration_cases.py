"""Hard cases of registration: turns, lines, planes, mirror images, symmetry, wrong pairs, and places far away.

Pairs fit exactly unless a case is about their errors, so that the transform that made them is the reference.
"""

from __future__ import annotations

import io
from collections.abc import Callable, Iterable
from contextlib import redirect_stderr

import numpy as np
from scipy.spatial.transform import Rotation

from bench.studies.stability import registration_board, registration_cameras, registration_spheres  # noqa: F401  (cases)
from bench.studies.stability.cases import Refused, Worst, case, refused, refused_throughout, worst
from calibration.registration.ransac import CONDITION, GROSS
from calibration.registration.register import solve
from calibration.registration.rigid_fit import HUBER, Pairs
from calibration.target.description import Candidate, Element, Target, default_target
from calibration.target.matching import match
from calibration.transforms import Transform, condition_number, umeyama
from radar.support.errors import HandbenchError

EPS = np.finfo(float).eps
SIGMA_M = 1e-4  # of a centre, per axis
HALF_M = 0.06  # of the target's square
SHIFT_M = np.array([0.1, -0.2, 0.3])
FIVE = default_target().centres_m
PLANE = FIVE * [1, 1, 0]
TURN = Rotation.from_rotvec([0.3, -1.1, 2.0]).as_matrix()


def candidates(centres_m: np.ndarray) -> list[Candidate]:
    """Centres [n, 3] as a sensor gives them."""
    return [Candidate(c, SIGMA_M**2 * np.eye(3), tuple(range(len(centres_m)))) for c in centres_m]


def registered(source_m: np.ndarray, target_m: np.ndarray, with_scale: bool = False) -> Transform:
    """The product's transform, without what it says of pairs that it leaves out."""
    with redirect_stderr(io.StringIO()):
        return solve(Pairs.of(candidates(source_m), candidates(target_m)), with_scale)


def angle_rad(matrix: np.ndarray, rotation: np.ndarray) -> float:
    """Angle between the rotation of a 4×4 matrix and another [3, 3]."""
    return float(np.linalg.norm(Rotation.from_matrix(matrix[:3, :3] @ rotation.T).as_rotvec()))


def roundings_rad(*points_m: np.ndarray) -> float:
    """What four roundings of the largest coordinate turn, over the target's half width."""
    return 4 * EPS * max(np.abs(p).max() for p in points_m) / HALF_M


@case(
    "registration",
    "turns of nearly 180°",
    quantity="rotation error",
    reference="the rotation that made the pairs",
    unit="roundings",
    bound=1.0,
    reason="four roundings of the largest coordinate over the target's half width",
)
def half_turns() -> Worst:
    def seen() -> Iterable[tuple[str, float]]:
        for axis in ((1, 0, 0), (0, 1, 0), (0, 0, 1), (1, 1, 0), (1, -2, 3)):
            for short_rad in (0, 1e-16, 1e-15, 1e-12, 1e-8, 1e-4, 0.1, 3.1):
                turn = Rotation.from_rotvec((np.pi - short_rad) * np.array(axis) / np.linalg.norm(axis)).as_matrix()
                for name, points_m in (("solid", FIVE), ("plane", PLANE)):
                    moved_m = points_m @ turn.T + SHIFT_M
                    error = angle_rad(registered(points_m, moved_m).matrix, turn)
                    yield f"{name}, axis {axis}, 180° less {short_rad:g} rad", error / roundings_rad(moved_m)

    return worst(seen())


def _rectangle(half_m: float) -> np.ndarray:
    return np.array([[x, y, 0] for x in (-HALF_M, HALF_M) for y in (-half_m, half_m)])


@case(
    "registration",
    "centres nearly on a line",
    quantity="rotation error over the condition number",
    reference="the rotation that made the pairs",
    unit="roundings",
    bound=1.0,
    reason="the worst axis turns κ times as far as the best one, which four roundings turn; κ ≤ 20 is given",
)
def nearly_collinear() -> Worst:
    def seen() -> Iterable[tuple[str, float]]:
        for half_m in HALF_M / np.array([1, 2, 5, 10, 15, 19, 19.9]):
            points_m = _rectangle(half_m)
            moved_m = points_m @ TURN.T + SHIFT_M
            kappa = np.hypot(HALF_M, half_m) / half_m
            error = angle_rad(registered(points_m, moved_m).matrix, TURN)
            yield f"κ = {kappa:.3g}", error / kappa / roundings_rad(moved_m)

    return worst(seen())


@case(
    "registration",
    "centres on a line",
    quantity="answer",
    reference="a refusal that gives the condition number",
    unit="",
    bound=0.0,
    reason=f"beyond κ = {CONDITION:g} the turn about the line stays open",
)
def collinear() -> Refused | Worst:
    def narrow(half_m: float) -> Callable[[], Transform]:
        return lambda: registered(_rectangle(half_m), _rectangle(half_m) @ TURN.T + SHIFT_M)

    lines = {f"half width {h:.2g} m": narrow(h) for h in (*HALF_M / np.array([20.1, 1e2, 1e4, 1e8, 1e15]), 0.0)}
    return refused_throughout(lines, "condition number", "on a line")


@case(
    "registration",
    "condition number of a narrowing rectangle",
    quantity="relative error over κ²",
    reference="closed form √(a² + b²)/b",
    unit="ε",
    bound=8.0,
    reason="b² is told from sums of a² by some roundings each, ε·a²: ε·κ² of itself; infinite where that is all",
)
def condition() -> Worst:
    def seen() -> Iterable[tuple[str, float]]:
        for half_m in HALF_M * np.logspace(0, -12, 49):
            points_m = _rectangle(half_m)
            kappa, found = np.hypot(HALF_M, half_m) / half_m, condition_number(points_m, points_m @ TURN.T)
            lost = EPS * kappa**2 > 0.1
            yield f"κ = {kappa:.3g}", 0.0 if lost and found > 1e7 else abs(found / kappa - 1) / (EPS * kappa**2)
        yield "on a line", 0.0 if condition_number(_rectangle(0), _rectangle(0)) > 1e7 else np.inf

    return worst(seen())


@case(
    "registration",
    "a million metres from the origin",
    quantity="rotation error",
    reference="the rotation that made the pairs",
    unit="roundings",
    bound=1.0,
    reason="four roundings of the largest coordinate over the target's half width; swept to the farthest file, 10⁷ m",
)
def far_away() -> Worst:
    def seen() -> Iterable[tuple[str, float]]:
        for away_m in (1e0, 1e2, 1e4, 1e6, 1e7):
            for name, source_m, extra_m in (("source", FIVE + away_m, 0), ("target", FIVE, away_m)):
                moved_m = (source_m - source_m.mean(axis=0)) @ TURN.T + extra_m
                error = angle_rad(registered(source_m, moved_m).matrix, TURN)
                yield f"{name} {away_m:g} m away", error / roundings_rad(source_m, moved_m)

    return worst(seen())


@case(
    "registration",
    "a mirror image whose height shrinks",
    quantity="largest distance of a pair after the fit",
    reference="the pair's own standard deviation",
    unit="σ",
    bound=GROSS,
    reason="what is given must agree within the limit of a wrong pair; a plane is its own mirror image",
)
def shrinking_mirror() -> Worst:
    def seen() -> Iterable[tuple[str, float]]:
        for height_m in (0, 1e-6, 1e-5, *np.logspace(-4, -1, 25)):
            points_m = np.array([*PLANE[:4], [*PLANE[4, :2], height_m]])
            moved_m = points_m * [1, 1, -1] @ TURN.T + SHIFT_M
            try:
                found = registered(points_m, moved_m)
            except HandbenchError:
                yield f"refused at a height of {height_m:g} m", 0.0
            else:
                yield f"height {height_m:g} m", float(found.residuals_m.max() / (np.sqrt(2) * SIGMA_M))

    return worst(seen())


@case(
    "registration",
    "a mirror image",
    quantity="answer",
    reference="a refusal that names it",
    unit="",
    bound=0.0,
    reason="no rotation carries a solid to its mirror image",
)
def mirror() -> Refused | Worst:
    tall = {h: np.array([*PLANE[:4], [*PLANE[4, :2], h]]) for h in (0.01, 0.02, 0.1)}
    return refused_throughout(
        {f"height {h} m": lambda p=p: registered(p, p * [1, 1, -1] @ TURN.T) for h, p in tall.items()}, "mirror image"
    )


def _triangle(skew_m: float) -> Target:
    places = ((-HALF_M, 0.0, 0.0), (HALF_M, 0.0, 0.0), (skew_m / 2, 0.09, 0.0))
    return Target(element=tuple(Element(centre_m=p, sphere_radius_m=0.02, ball_radius_m=0.005) for p in places))


@case(
    "registration",
    "a target that grows symmetric",
    quantity="elements that are taken for another",
    reference="the elements' order",
    unit="elements",
    bound=0.0,
    reason="two readings within the tolerance of 2 mm are refused, one beyond it is the right one",
)
def nearly_symmetric() -> Worst:
    def seen() -> Iterable[tuple[str, float]]:
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

    return worst(seen())


@case(
    "registration",
    "a symmetric target",
    quantity="answer",
    reference="a refusal that counts the readings",
    unit="",
    bound=0.0,
    reason="nothing tells one reading from another",
)
def symmetric() -> Refused | Worst:
    square = Target(element=default_target().element[:4])
    targets = {"a square": square, "an even triangle": _triangle(0.0), "nearly so": _triangle(5e-4)}
    return refused_throughout(
        {name: lambda t=t: match(candidates(t.centres_m @ TURN.T), t, "echoes") for name, t in targets.items()},
        "matched in",
        "without symmetry",
    )


def _shift_in_sigmas(found: Transform) -> float:
    """How far a transform is off the shift alone, in its own standard deviations."""
    step = np.r_[found.matrix[:3, 3] - found.rotation @ SHIFT_M, Rotation.from_matrix(found.rotation).as_rotvec()]
    return float(np.sqrt(step @ np.linalg.solve(found.covariance, step)))


@case(
    "registration",
    "one wrong pair in five",
    quantity="error of the transform",
    reference="the other four, exact",
    unit="σ",
    bound=float(np.sqrt(HUBER * GROSS)),
    reason="a pair D σ off pulls by √(w·D²) of the transform's own σ at most, w = 3.37/D (Huber), and D ≤ 10 is kept",
)
def one_wrong() -> Worst:
    def seen() -> Iterable[tuple[str, float]]:
        rng = np.random.default_rng(0)
        for size_m in np.logspace(-6, 6, 37):
            for wrong in range(5):
                way = rng.standard_normal(3)
                moved_m = FIVE + SHIFT_M
                moved_m[wrong] += size_m * way / np.linalg.norm(way)
                found = registered(FIVE, moved_m)
                yield f"pair {wrong + 1}, {size_m:.2g} m off", _shift_in_sigmas(found)

    return worst(seen())


@case(
    "registration",
    "two wrong pairs in five",
    quantity="answer",
    reference="a refusal that lists the residuals",
    unit="",
    bound=0.0,
    reason="three that agree are no majority: in a plane they are their own mirror image",
)
def two_wrong() -> Refused | Worst:
    def bent(size_m: float) -> np.ndarray:
        return FIVE + SHIFT_M + size_m * np.array([[1, 0, 0], [0, -1, 1], [0, 0, 0], [0, 0, 0], [0, 0, 0]])

    sizes_m = (0.01, 0.03, 0.3, 30.0, 3e3, 1e6)
    return refused_throughout(
        {f"{size:g} m off": lambda size=size: registered(FIVE, bent(size)) for size in sizes_m},
        "contradict",
        "residuals",
    )


@case(
    "registration",
    "points that coincide give no scale",
    quantity="answer",
    reference="a refusal",
    unit="",
    bound=0.0,
    reason="no extent, no scale",
)
def coinciding() -> Refused | Worst:
    return refused(lambda: umeyama(np.ones((5, 3)), FIVE, with_scale=True), "scale", "coincide")
