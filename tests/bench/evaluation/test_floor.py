"""The ground-truth floor: closed forms, its definition by simulation, and what is not known."""

from __future__ import annotations

import numpy as np
import pytest

from handbench.bench.evaluation.floor import BLOCK_M, budget, floor_interval, floor_mm
from handbench.bench.evaluation.metrics import ErrorMap
from handbench.calibration.transforms import Transform, perturbation_jacobian
from handbench.groundtruth.mesh.depth import Reference

AXIS_M = BLOCK_M / 6 * np.arange(24)  # 4 × 4 blocks of 6 × 6 pixels
ALONG_Z = (0, 0, 2e-4, 0, 0, 0)


def level(mesh_sigma_m, deviations, place_m: float = 0.0) -> tuple[ErrorMap, Reference]:
    """A plane z = 0.3 m, its error map (an eighth of the pixels unobserved) and what is known of
    it. deviations: standard deviations of the registration (None: not known), which lies at place_m
    along x."""
    x, y = np.meshgrid(AXIS_M, AXIS_M)
    z_m = np.full_like(x, 0.3)
    error_m = np.where((np.arange(x.size) % 8 == 0).reshape(x.shape), np.nan, 1e-3)
    known = None, None
    if deviations is not None:
        matrix = np.eye(4)
        matrix[0, 3] = place_m
        leverage = perturbation_jacobian(np.stack([x, y, z_m], axis=-1))[..., 2, : len(deviations)]
        known = leverage, Transform("photo", "radar", matrix, np.diag(deviations) ** 2)
    mesh_m = np.broadcast_to(mesh_sigma_m, x.shape)
    return ErrorMap(AXIS_M, AXIS_M, error_m, z_m), Reference(z_m, mesh_m, *known)


def simulated_mm(pairs: list[tuple[ErrorMap, Reference]], draws: int = 4000) -> np.ndarray:
    """MAE [draws] of a perfect radar, by moving each surface as a whole and each of its blocks."""
    rng, errors = np.random.default_rng(5), []
    motion = rng.multivariate_normal(np.zeros(6), pairs[0][1].registration.covariance, draws)
    z, about_x, about_y = motion[:, 2:5, None, None].swapaxes(0, 1)
    x, y = np.meshgrid(AXIS_M, AXIS_M)
    for m, r in pairs:
        blocks = np.kron(rng.standard_normal((draws, 4, 4)), np.ones((6, 6)))
        moved = z + about_x * y - about_y * x + blocks * r.mesh_sigma_m
        errors.append(np.abs(moved)[:, np.isfinite(m.error_m)])
    return 1e3 * np.concatenate(errors, axis=1).mean(axis=1)


def test_the_definition_is_what_a_perfect_radar_shows():
    """Shift, turns and patches together, over two captures. The mean of 4000 draws is known to 1 %
    (their spread is about half of it), so 3 %; the quantiles of both simulations together to 4 to 7
    %, so 15 %."""
    mesh_m = 1e-4 * (1 + AXIS_M / AXIS_M.max())
    pairs = [level(k * mesh_m, (0, 0, 1e-4, 3e-3, 2e-3, 0)) for k in (1, 2)]
    maps, references = zip(*pairs, strict=True)
    seen = simulated_mm(pairs)
    assert floor_mm(maps, references) == pytest.approx(seen.mean(), rel=0.03)
    expected = np.quantile(seen, [0.025, 0.975])
    assert floor_interval(maps, references) == pytest.approx(expected, rel=0.15)


def width(pairs: list[tuple[ErrorMap, Reference]]) -> float:
    return float(np.diff(floor_interval(*zip(*pairs, strict=True)))[0])


def test_only_observed_pixels_count():
    near = np.arange(AXIS_M.size) < 12
    m, r = level(np.where(near, 1e-4, np.nan), np.zeros(6))
    half = ErrorMap(AXIS_M, AXIS_M, np.where(near, m.error_m, np.nan), m.reference_z_m)
    assert floor_mm([half], [r]) == pytest.approx(0.1 * np.sqrt(2 / np.pi), rel=1e-12)


@pytest.mark.parametrize(
    ("mesh_m", "placed"),
    [(np.where(np.arange(24) == 9, np.nan, 1e-4), ALONG_Z), (1e-4, None), (np.nan, None)],
)
def test_partial_knowledge_is_none(mesh_m, placed):
    """Neither all pixels but one, nor one capture of two, nor one part of two makes a floor."""
    for pairs in ([level(mesh_m, placed)], [level(mesh_m, placed), level(1e-4, ALONG_Z)]):
        maps, references = zip(*pairs, strict=True)
        assert floor_mm(maps, references) is None and floor_interval(maps, references) is None


def test_the_budget_is_the_root_mean_square_and_names_what_is_missing():
    placed = 9e-8 + 1e-4 * np.mean(AXIS_M**2)
    expected = {"mesh_mm": 1e-8, "registration_mm": placed, "together_mm": 1e-8 + placed}
    found = budget(level(1e-4, (0, 0, 3e-4, 0, 0.01, 0))[1])
    assert found == pytest.approx({key: 1e3 * m2**0.5 for key, m2 in expected.items()}, rel=1e-12)
    assert budget(level(np.nan, ALONG_Z)[1])["unknown"] == ["mesh"]
    alone = budget(level(1e-4, None)[1])
    assert alone["unknown"] == ["registration"] and alone["mesh_mm"] == pytest.approx(0.1)
    assert alone["registration_mm"] is alone["together_mm"] is None


def test_one_registration_errs_in_common_several_do_not_and_a_mesh_by_blocks():
    """Four captures of one registration say no more than one; with one each, their mean is half as
    wide. The same σ of 16 independent blocks has a mean that is 4 times narrower."""
    one = width([level(0, ALONG_Z)])
    assert width([level(0, ALONG_Z)] * 4) == pytest.approx(one, rel=1e-9)
    assert 0.4 < width([level(0, ALONG_Z, place_m=0.1 * i) for i in range(4)]) / one < 0.65
    assert 3 < one / width([level(2e-4, np.zeros(6))]) < 5.5
