"""The ground-truth floor: closed forms, and what is not known."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from handbench.bench.evaluation.depth_errors import ErrorMap, budget
from handbench.bench.evaluation.metrics import figures
from handbench.calibration.transforms import Transform, perturbation_jacobian
from handbench.groundtruth.mesh.depth import Reference

AXIS_M = 2.5e-3 * np.arange(24)
ALONG_Z = (0, 0, 2e-4, 0, 0, 0)


def level(mesh_sigma_m, deviations) -> tuple[ErrorMap, Reference]:
    """A plane z = 0.3 m, its error map (an eighth of the pixels unobserved) and what is known of
    it. deviations: standard deviations of the registration (None: not known)."""
    x, y = np.meshgrid(AXIS_M, AXIS_M)
    z_m = np.full_like(x, 0.3)
    error_m = np.where((np.arange(x.size) % 8 == 0).reshape(x.shape), np.nan, 1e-3)
    known = None, None
    if deviations is not None:
        leverage = perturbation_jacobian(np.stack([x, y, z_m], axis=-1))[..., 2, : len(deviations)]
        known = leverage, Transform("photo", "radar", np.eye(4), np.diag(deviations) ** 2)
    mesh_m = np.broadcast_to(mesh_sigma_m, x.shape)
    return ErrorMap(AXIS_M, AXIS_M, error_m, z_m), Reference(z_m, mesh_m, *known)


def floor_mm(errors: ErrorMap, reference: Reference) -> float | None:
    return figures(replace(errors, sigma_m=reference.sigma_m))["floor_mm"]


def test_the_floor_is_the_mean_of_the_parts_together():
    x, y = np.meshgrid(AXIS_M, AXIS_M)
    errors, reference = level(1e-4, (0, 0, 2e-4, 3e-3, 2e-3, 0))
    sigma_m = np.sqrt(1e-8 + 4e-8 + (3e-3 * y) ** 2 + (2e-3 * x) ** 2)
    expected = 1e3 * np.sqrt(2 / np.pi) * sigma_m[np.isfinite(errors.error_m)].mean()
    assert floor_mm(errors, reference) == pytest.approx(expected, rel=1e-9)


def test_only_observed_pixels_count():
    near = np.arange(AXIS_M.size) < 12
    m, r = level(np.where(near, 1e-4, np.nan), np.zeros(6))
    half = ErrorMap(AXIS_M, AXIS_M, np.where(near, m.error_m, np.nan), m.reference_z_m)
    assert floor_mm(half, r) == pytest.approx(0.1 * np.sqrt(2 / np.pi), rel=1e-12)


@pytest.mark.parametrize(
    ("mesh_m", "placed"),
    [(np.where(np.arange(24) == 9, np.nan, 1e-4), ALONG_Z), (1e-4, None), (np.nan, None)],
)
def test_partial_knowledge_is_none(mesh_m, placed):
    """Neither all pixels but one nor one part of two makes a floor."""
    assert floor_mm(*level(mesh_m, placed)) is None


def test_the_budget_is_the_root_mean_square_and_names_what_is_missing():
    placed = 9e-8 + 1e-4 * np.mean(AXIS_M**2)
    expected = {"mesh_mm": 1e-8, "registration_mm": placed, "together_mm": 1e-8 + placed}
    found = budget(level(1e-4, (0, 0, 3e-4, 0, 0.01, 0))[1])
    assert found == pytest.approx({key: 1e3 * m2**0.5 for key, m2 in expected.items()}, rel=1e-12)
    assert budget(level(np.nan, ALONG_Z)[1])["unknown"] == ["mesh"]
    alone = budget(level(1e-4, None)[1])
    assert alone["unknown"] == ["registration"] and alone["mesh_mm"] == pytest.approx(0.1)
    assert alone["registration_mm"] is alone["together_mm"] is None
