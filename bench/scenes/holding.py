"""A letter as a person holds it: joint angles at which the digits touch where the mean hand's do, and nowhere else."""

import itertools
from functools import cache

import numpy as np

from handbench.bench.scenes.bones import FINGERS, Bone, radii_m, skeleton_of_palm
from handbench.bench.scenes.hand_pose import Pose
from handbench.bench.scenes.people import MEAN, Person, person

TOUCHING_M = 2e-3  # parts that are nearer than this touch, and keep their distance; others stay as far apart at least
CONTACT_M, ANGLE_DEG = 2e-4, 5.0  # deviations from contact and from the letter's angles that weigh alike
BALLS = 6  # of each bone
ANGLES: dict[str, tuple[str, ...]] = {name: ("mcp_deg", "pip_deg", "dip_deg", "spread_deg") for name in FINGERS}
ANGLES["thumb"] = ("radial_deg", "palmar_deg", "opposition_deg", "mcp_deg", "ip_deg")
Balls = tuple[np.ndarray, np.ndarray]  # centres [n, 3] and radii [n], metres


@cache
def held(pose: Pose, number: int) -> Pose:
    """The pose as a person, by number, holds it; the mean hand's is the pose itself."""
    if number == 0:
        return pose
    from scipy.optimize import least_squares

    known = _gaps_m(pose, MEAN)
    touch = known < TOUCHING_M
    given = np.array([getattr(getattr(pose, digit), angle) for digit, names in ANGLES.items() for angle in names])

    def misfit(angles_deg: np.ndarray) -> np.ndarray:
        off_m = _gaps_m(_posed(pose, angles_deg), person(number)) - np.where(touch, known, TOUCHING_M)
        return np.r_[np.where(touch, off_m, np.minimum(off_m, 0)) / CONTACT_M, (angles_deg - given) / ANGLE_DEG]

    limits = np.array([_limits(pose, digit, angle) for digit, names in ANGLES.items() for angle in names]).T
    inside = np.clip(given, limits[0] + 1e-6, limits[1] - 1e-6)
    found = least_squares(misfit, inside, bounds=limits, diff_step=1e-4, x_scale=ANGLE_DEG, max_nfev=40)
    return _posed(pose, np.round(found.x, 3))


def _limits(pose: Pose, digit: str, angle: str) -> tuple[float, float]:
    """The smallest and the largest that an angle can be."""
    bounds = type(getattr(pose, digit)).model_fields[angle].metadata
    return next(b.ge for b in bounds if hasattr(b, "ge")), next(b.le for b in bounds if hasattr(b, "le"))


def _posed(pose: Pose, angles_deg: np.ndarray) -> Pose:
    """The pose with other angles of its digits, in the order of ANGLES."""
    values = iter(map(float, angles_deg))
    digits = {
        digit: getattr(pose, digit).model_copy(update={angle: next(values) for angle in names})
        for digit, names in ANGLES.items()
    }
    return pose.model_copy(update=digits)


def _gaps_m(pose: Pose, of: Person) -> np.ndarray:
    """Distances between the flesh of thumb and fingers, neighbouring fingers beyond their webs, and palm; negative:
    inside each other."""
    bones = skeleton_of_palm(pose, of)
    radii = {name: radii_m(name, of) for name in bones}  # of each phalanx at both ends
    flesh = {name: list(map(_balls, bones[name][1:], radii[name], radii[name][1:])) for name in bones}
    palm = _all([_balls(bones[name][0], radii[name][0], radii[name][0]) for name in FINGERS])
    thumb = _all(flesh["thumb"])
    gaps = [_gap_m(thumb, _all(flesh[name])) for name in FINGERS] + [_gap_m(thumb, palm)]
    gaps += [_gap_m(_all(flesh[a][1:]), _all(flesh[b][1:])) for a, b in itertools.pairwise(FINGERS)]
    gaps += [_gap_m(_all(flesh[name][1:]), palm) for name in FINGERS]
    return np.array(gaps)


def _balls(bone: Bone, start_radius_m: float, end_radius_m: float) -> Balls:
    along = np.linspace(0, 1, BALLS)
    radius_m = start_radius_m + along * (end_radius_m - start_radius_m)
    return bone.start_m + along[:, None] * bone.length_m * bone.axis, radius_m


def _all(parts: list[Balls]) -> Balls:
    return np.concatenate([centres for centres, _ in parts]), np.concatenate([radii for _, radii in parts])


def _gap_m(a: Balls, b: Balls) -> float:
    apart = np.linalg.norm(a[0][:, None] - b[0], axis=2)
    return float((apart - a[1][:, None] - b[1]).min())
