"""The registration where geometry is unkind, against ball arithmetic and closed forms of its own.

The reference takes the float64 coordinates as exact. Rotation and scale are then wanted to 1e-9
(absolute, relative); carried points to 1e-9 of the target's extent, plus four roundings of the
largest number on the way: with coordinates of 1e6 m a float64 matrix cannot say where a point is to
better than some 1e-10 m.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from flint import arb
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from handbench.calibration.registration import Pairs, fit
from handbench.calibration.target import Candidate
from handbench.calibration.transforms import Transform, umeyama
from tests.calibration.seen_target import align, candidates
from tests.references.balls import Balls, balls, off, rotation
from tests.refusals import refuse
from tests.strategies import examples

BAR = 1e-9
seeds = st.integers(0, 2**32 - 1)
EXTENT_M = 0.12
FIVE = EXTENT_M * np.array(
    [[-0.5, -0.5, 0], [0.5, -0.5, 0], [0.5, 0.5, 0], [-0.5, 0.5, 0], [0.15, 0.25, -0.08]]
)
PLANE = FIVE * [1, 1, 0]
SOLID = EXTENT_M * np.array([[0.0, 0, 0], [1, 0, 0], [0, 0.8, 0], [0, 0, 0.6], [0.5, 0.4, 0.7]])
RIBBON = EXTENT_M * np.array(
    [[-0.5, 0, 0], [-0.2, 0.06, 0], [0.1, -0.05, 0], [0.3, 0.02, 0], [0.5, 0, 0.0]]
)
TWINS = SOLID[[0, 1, 1, 2, 2]]
SHAPES = {"five": FIVE, "plane": PLANE, "solid": SOLID, "ribbon": RIBBON, "twins": TWINS}


def horn(p: np.ndarray, q: np.ndarray, with_scale: bool) -> tuple[Balls, arb, Balls]:
    """Rotation, scale and translation of least squares (Horn 1987)."""
    turn, p_mean, q_mean = rotation(p, q), balls(p).mean(axis=0), balls(q).mean(axis=0)
    p, q = balls(p) - p_mean, balls(q) - q_mean
    scale = (p @ turn.T * q).sum() / (p * p).sum() if with_scale else arb(1)
    return turn, scale, q_mean - scale * (turn @ p_mean)


def errors(
    matrix: np.ndarray, p: np.ndarray, q: np.ndarray, with_scale: bool = False
) -> tuple[float, float, float]:
    """Of the rotation, the scale and the carried points; the last relative to the target's extent,
    after what four roundings explain."""
    turn, scale, shift = horn(p, q, with_scale)
    found = Transform("photo", "radar", matrix)
    miss_m = off(found.points(p), balls(p) @ (scale * turn).T + shift).max()
    rounding_m = 4 * np.finfo(float).eps * max(found.scale * np.abs(p).max(), np.abs(q).max())
    return (
        float(off(0.0, balls(matrix[:3, :3]) / scale - turn).max()),
        float(off(0.0, found.scale / scale - 1)),
        float(max(0, miss_m - rounding_m) / np.ptp(q, axis=0).max()),
    )


def scenario(
    seed: int,
    shape: np.ndarray,
    scale: float = 1.0,
    source_far: bool = False,
    target_far: bool = False,
    rotation: np.ndarray | None = None,
) -> tuple[np.ndarray, np.ndarray]:
    """Centres in both frames, the target's with errors of 0.2 % of the extent, so that no transform
    fits exactly."""
    rng = np.random.default_rng(seed)
    p = shape @ Rotation.random(rng=rng).as_matrix().T + rng.uniform(-1, 1, 3) * (
        1e6 if source_far else 0.5
    )
    rotation = Rotation.random(rng=rng).as_matrix() if rotation is None else rotation
    q = scale * (p - p.mean(axis=0)) @ rotation.T + scale * 2e-3 * EXTENT_M * rng.standard_normal(
        p.shape
    )
    return p, q + rng.uniform(-1, 1, 3) * (1e6 if target_far else 0.5)


def aligned(p: np.ndarray, q: np.ndarray) -> Transform:
    """With equal covariances, so large that all pairs agree: then weighted least squares are
    plain ones."""
    spread_m2 = (0.01 * EXTENT_M) ** 2 * np.eye(3)
    return align(*(candidates(side, covariance_m2=spread_m2) for side in (p, q)))


@given(
    seed=seeds,
    shape=st.sampled_from(list(SHAPES)),
    with_scale=st.booleans(),
    log_scale=st.floats(-3, 3),
    source_far=st.booleans(),
    target_far=st.booleans(),
    short_rad=st.sampled_from([None, 0.0, 1e-15, 1e-12, 1e-8, 1e-4]),
)
@examples(80)
def test_least_squares_are_those_of_50_digits(
    seed, shape, with_scale, log_scale, source_far, target_far, short_rad
):
    """A plane, a ribbon (condition 12 or so), points that coincide; a thousandth to a thousand
    times as large, where a scale is fitted in closed form; frames a million metres away; half
    turns, or short of it."""
    scale = 10**log_scale if with_scale else 1.0
    turn = None
    if short_rad is not None:
        axis = np.random.default_rng(seed).integers(-2, 3, 3) + [0.5, 0, 0]
        turn = Rotation.from_rotvec((np.pi - short_rad) * axis / np.linalg.norm(axis)).as_matrix()
    p, q = scenario(seed, SHAPES[shape], scale, source_far, target_far, turn)
    if not with_scale:
        assert max(errors(aligned(p, q).matrix, p, q)) < BAR
    if not source_far and not target_far:
        assert max(errors(umeyama(p, q, with_scale), p, q, with_scale)) < BAR


@pytest.mark.parametrize("seed", [1, 2])
def test_the_weighted_fit_is_the_best_one_and_knows_how_well(seed):
    """Each pair with two ellipsoids of its own, four times as large as the errors: no further step
    lowers Σ dᵀC⁻¹d, and the covariance is the inverse of its curvature, both in units of the
    motion's own standard deviations. A million metres away the residuals are the same."""
    rng = np.random.default_rng(seed)
    p, q = scenario(seed, SOLID)
    roots = 8e-3 * EXTENT_M * (np.eye(3) + 0.3 * rng.standard_normal((2, 5, 3, 3)))
    p_cov, q_cov = roots @ roots.swapaxes(2, 3)
    pairs = Pairs(p, q, p_cov, q_cov, np.arange(5))
    matrix, found = fit(pairs)
    turn, normal, right = matrix[:3, :3], 0, 0
    for x, y, c_p, c_q in zip(p @ turn.T + matrix[:3, 3], q, p_cov, q_cov, strict=True):
        jacobian = np.hstack([np.eye(3), np.cross(np.eye(3), x).T])
        information = np.linalg.inv(turn @ c_p @ turn.T + c_q)
        normal = normal + jacobian.T @ information @ jacobian
        right = right + jacobian.T @ information @ (y - x)
    covariance = np.linalg.inv(normal)
    deviations = np.sqrt(np.diag(covariance))
    assert (pairs.distances(matrix) ** 2).sum() < 3 * 5 - 6
    assert np.abs(covariance @ right / deviations).max() < BAR
    assert np.abs((found - covariance) / np.outer(deviations, deviations)).max() < BAR
    far, shift_m = replace(pairs, target_m=q + 1e6), 4 * np.finfo(float).eps * 1e6
    np.testing.assert_allclose(far.offsets(fit(far)[0]), pairs.offsets(matrix), atol=shift_m)


LINE = EXTENT_M * np.array([[0.0, 0, 0], [0.25, 0, 0], [0.4, 0, 0], [0.75, 0, 0], [1, 0, 0]])
RECTANGLE = np.array([[x, y, 0] for x in (-0.06, 0.06) for y in (-0.0025, 0.0025)])
WITH_ONE_BESIDE = np.vstack([LINE + 1e-3 * np.eye(5, 3), [0.05, 0.06, 0]])
MIRRORED = FIVE * [1, 1, -1] @ Rotation.from_rotvec([0.3, -1.1, 2.0]).as_matrix()


@pytest.mark.parametrize(
    ("source_m", "target_m", "last_m2", "place"),
    [
        (LINE[:2], LINE[:2], 1e-8, "2 elements"),
        (LINE, LINE, 1e-8, "number inf,"),
        (RECTANGLE, RECTANGLE, 1e-8, "number 24,"),
        (WITH_ONE_BESIDE, WITH_ONE_BESIDE, 1e-2, "6 common elements"),
        (WITH_ONE_BESIDE, WITH_ONE_BESIDE + 0.03 * np.eye(6, 3, -5), 1e-8, "its 6 pairs"),
        (SOLID[:4], SOLID[:4] + 0.05 * np.eye(4, 3, -3), 1e-8, "pair 4 25.1"),
        (FIVE, MIRRORED, 1e-8, "5 of 5 pairs"),
    ],
)
def test_what_leaves_the_rotation_open_is_refused(source_m, target_m, last_m2, place):
    """A line; a narrow rectangle of half length a and half width b, √((a² + b²)/b²) = 24.02; the
    one centre off the line (the last) badly known, or wrong. Of four, three that agree are no
    majority: triangles that fit are no rarity. Of the five, four lie in a plane and would outvote
    the fifth, which the mirror image moves."""
    target = candidates(target_m)
    target[-1] = Candidate(target_m[-1], last_m2 * np.eye(3), ())
    refuse(lambda: align(candidates(source_m), target), place)
