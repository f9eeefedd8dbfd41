"""The ground-truth floor: closed forms, its definition by simulation, and what is not known."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import stats

from handbench.bench.evaluation.floor import BLOCK_M, budget, floor_interval, floor_mm
from handbench.bench.evaluation.metrics import ErrorMap, of_captures
from handbench.bench.evaluation.rows import accuracy_rows
from handbench.calibration.transforms import Transform, perturbation_jacobian
from handbench.groundtruth.mesh.depth import Reference

HALF_NORMAL = np.sqrt(2 / np.pi)
AXIS_M = BLOCK_M / 6 * np.arange(24)  # 4 × 4 blocks of 6 × 6 pixels
ALONG_Z = (0, 0, 2e-4, 0, 0, 0)


def level(mesh_sigma_m, deviations, place_m: float = 0.0) -> tuple[ErrorMap, Reference]:
    """A plane z = 0.3 m, its error map (an eighth of the pixels unobserved) and what is known of
    it. deviations: standard deviations of the registration (None: not told), which lies at place_m
    along x."""
    x, y = np.meshgrid(AXIS_M, AXIS_M)
    z_m = np.full_like(x, 0.3)
    error_m = np.where((np.arange(x.size) % 8 == 0).reshape(x.shape), np.nan, 1e-3)
    known = None, None
    if deviations is not None:
        matrix = np.eye(4)
        matrix[0, 3] = place_m
        transform = Transform("photo", "radar", matrix, np.diag(deviations) ** 2)
        known = (
            perturbation_jacobian(np.stack([x, y, z_m], axis=-1))[..., 2, : len(deviations)],
            transform,
        )
    return ErrorMap(AXIS_M, AXIS_M, error_m, z_m), Reference(
        z_m, np.broadcast_to(mesh_sigma_m, x.shape), *known
    )


def simulated_mm(pairs: list[tuple[ErrorMap, Reference]], draws: int = 4000) -> np.ndarray:
    """MAE [draws] of a perfect radar, by moving each surface as a whole and each of its blocks."""
    rng = np.random.default_rng(5)
    motion = rng.multivariate_normal(np.zeros(6), pairs[0][1].registration.covariance, draws)
    errors = []
    for m, r in pairs:
        x, y = np.meshgrid(AXIS_M, AXIS_M)
        moved = (
            motion[:, 2, None, None] + motion[:, 3, None, None] * y - motion[:, 4, None, None] * x
        )
        blocks = np.kron(rng.standard_normal((draws, 4, 4)), np.ones((6, 6)))
        errors.append(np.abs(moved + blocks * r.mesh_sigma_m)[:, np.isfinite(m.error_m)])
    return 1e3 * np.concatenate(errors, axis=1).mean(axis=1)


def test_a_common_error_along_z():
    """σ everywhere: the floor is √(2/π)σ, and the interval that of |N(0, σ²)|; 1000 draws know its
    ends to 0.02σ and 0.1σ (standard error √(p(1 − p)/n) over the density), tolerated up to 0.05σ
    and 0.25σ."""
    m, r = level(0, ALONG_Z)
    assert floor_mm([m], [r]) == pytest.approx(0.2 * HALF_NORMAL, rel=1e-12)
    low, high = floor_interval([m], [r])
    expected = 0.2 * stats.halfnorm.ppf([0.025, 0.975])
    assert low == pytest.approx(expected[0], abs=0.01) and high == pytest.approx(
        expected[1], abs=0.05
    )


def test_the_definition_is_what_a_perfect_radar_shows():
    """Shift, turns and patches together, over two captures. The mean of 4000 draws is known to 1 %
    (their spread is about half of it), so 3 %; the quantiles of both simulations together to 4 to 7
    %, so 15 %."""
    mesh_m = 1e-4 * (1 + AXIS_M / AXIS_M.max())
    pairs = [
        level(mesh_m, (0, 0, 1e-4, 3e-3, 2e-3, 0)),
        level(2 * mesh_m, (0, 0, 1e-4, 3e-3, 2e-3, 0)),
    ]
    maps, references = [m for m, _ in pairs], [r for _, r in pairs]
    seen = simulated_mm(pairs)
    assert floor_mm(maps, references) == pytest.approx(seen.mean(), rel=0.03)
    assert floor_interval(maps, references) == pytest.approx(
        np.quantile(seen, [0.025, 0.975]), rel=0.15
    )


def width(pairs: list[tuple[ErrorMap, Reference]]) -> float:
    return float(np.diff(floor_interval([m for m, _ in pairs], [r for _, r in pairs]))[0])


def test_one_registration_errs_alike_in_all_captures_and_several_do_not():
    """Four captures of one registration say no more than one; with one each, their mean is half as
    wide."""
    one = width([level(0, ALONG_Z)])
    assert width([level(0, ALONG_Z)] * 4) == pytest.approx(one, rel=1e-9)
    assert 0.4 < width([level(0, ALONG_Z, place_m=0.1 * i) for i in range(4)]) / one < 0.65


def test_the_mesh_errs_by_blocks():
    """The same σ: common to all pixels, or 16 independent blocks, whose mean is 4 times
    narrower."""
    common, blocks = width([level(0, ALONG_Z)]), width([level(2e-4, np.zeros(6))])
    assert 3 < common / blocks < 5.5


def test_only_observed_pixels_count():
    m, r = level(np.where(np.arange(AXIS_M.size) < 12, 1e-4, 3e-4), np.zeros(6))
    half = ErrorMap(
        AXIS_M, AXIS_M, np.where(np.arange(AXIS_M.size) < 12, m.error_m, np.nan), m.reference_z_m
    )
    assert floor_mm([half], [r]) == pytest.approx(0.1 * HALF_NORMAL, rel=1e-12)
    holes = Reference(
        r.z_m, np.where(np.isnan(m.error_m), np.nan, r.mesh_sigma_m), r.leverage, r.registration
    )
    assert floor_mm([m], [holes]) == floor_mm(
        [m], [r]
    )  # unknown where nothing was observed is not asked for


@pytest.mark.parametrize(
    "unknown", [level(np.nan, ALONG_Z), level(1e-4, None), level(np.nan, None)]
)
def test_partial_knowledge_is_none(unknown):
    """Neither one capture of two nor one part of two makes a floor."""
    for pairs in ([unknown], [unknown, level(1e-4, ALONG_Z)]):
        maps, references = [m for m, _ in pairs], [r for _, r in pairs]
        assert floor_mm(maps, references) is None and floor_interval(maps, references) is None


def test_one_unknown_pixel_is_none():
    m, r = level(np.where(np.arange(AXIS_M.size) == 9, np.nan, 1e-4), ALONG_Z)
    assert floor_mm([m], [r]) is None


def test_nothing_observed_has_no_floor():
    m, r = level(1e-4, ALONG_Z)
    nothing = ErrorMap(AXIS_M, AXIS_M, np.full_like(m.error_m, np.nan), m.reference_z_m)
    assert floor_mm([nothing], [r]) is None and floor_mm([], []) is None
    alone = floor_interval([m], [r], seed=3)
    assert (
        floor_interval([m, nothing], [r, r], seed=3) == alone
    )  # a capture without pixels adds none


def test_a_surface_without_error_has_a_floor_of_zero_that_does_not_scatter():
    m, r = level(0, np.zeros(6))
    assert floor_mm([m], [r]) == 0.0 and floor_interval([m], [r]) is None


def test_is_seeded():
    m, r = level(1e-4, ALONG_Z)
    assert (
        floor_interval([m], [r], seed=7)
        == floor_interval([m], [r], seed=7)
        != floor_interval([m], [r], seed=8)
    )


def test_the_budget_is_the_root_mean_square_and_names_what_is_missing():
    x = np.meshgrid(AXIS_M, AXIS_M)[0]
    found = budget(level(1e-4, (0, 0, 3e-4, 0, 0.01, 0))[1])
    assert found == pytest.approx(
        {
            "mesh_mm": 0.1,
            "registration_mm": 1e3 * np.sqrt(9e-8 + 1e-4 * np.mean(x**2)),
            "together_mm": 1e3 * np.sqrt(1e-8 + 9e-8 + 1e-4 * np.mean(x**2)),
        },
        rel=1e-12,
    )
    assert budget(level(np.nan, ALONG_Z)[1])["unknown"] == ["mesh"]
    alone = budget(level(1e-4, None)[1])
    assert alone["unknown"] == ["registration"] and alone["mesh_mm"] == pytest.approx(0.1)
    assert alone["registration_mm"] is None and alone["together_mm"] is None


def test_the_row_stands_directly_after_the_mae_known_or_not():
    m, r = level(0, ALONG_Z)
    known = of_captures([m]).assign(floor_mm=floor_mm([m], [r]))
    for captures, interval in ((known, floor_interval([m], [r])), (of_captures([m]), None)):
        rows = accuracy_rows("3fsk", "photogrammetry", captures, floor=interval)
        assert rows.metric[:3].tolist() == ["mae_mm", "floor_mm", "max_mm"]
        floor = rows.loc[1]
        assert floor.unit == "mm" and np.isnan(floor.paper)
        assert np.isnan(floor.value) == np.isnan(floor.low) == (interval is None)
    assert rows.value[0] == pytest.approx(
        1.0
    )  # the MAE is shown as measured: nothing is subtracted from it
