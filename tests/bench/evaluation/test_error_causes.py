"""Errors by cause, against shapes whose angles, edges and parts follow from a closed form."""

from __future__ import annotations

import numpy as np
import pytest

from handbench.bench.evaluation.depth_errors import ErrorMap
from handbench.bench.evaluation.error_causes import (
    BINS,
    PALM_RADIUS_M,
    cause_lines,
    edge_distance_m,
    incidence_deg,
    parts,
)
from handbench.radar.data.depthmap import DepthMap
from tests.bench.evaluation.explained import Scored, explain

AXIS_M = np.linspace(-0.1, 0.1, 201)
X_M, Y_M = np.meshgrid(AXIS_M, AXIS_M)


def test_incidence_on_a_tilted_plane_is_that_of_its_normal():
    """z = z0 + a·x + b·y has the normal n = (a, b, −1)/√(1 + a² + b²) ; its angle to −p/|p| is the
    incidence."""
    z0_m, a, b = 0.3, 0.4, -0.2
    z_m = z0_m + a * X_M + b * Y_M
    expected = np.arccos(z0_m / np.sqrt(1 + a**2 + b**2) / np.sqrt(X_M**2 + Y_M**2 + z_m**2))
    np.testing.assert_allclose(incidence_deg(AXIS_M, AXIS_M, z_m), np.degrees(expected), atol=1e-9)


@pytest.mark.parametrize("beyond_m", [np.nan, 0.32, 0.30501, 0.30499])
def test_the_distance_to_the_edge_of_a_half_plane_is_that_to_its_line(beyond_m):
    """The reference ends, or jumps by 5 mm or more, between the pixels at −1 and 0 mm: the edge is
    the line x = −0.5 mm, and no slope is taken across it. The image's border is none."""
    z_m = np.where(X_M < -1e-9, 0.30, beyond_m)
    off_m = np.abs(X_M + 0.5e-3) if beyond_m != 0.30499 else np.full(X_M.shape, np.inf)
    off_m[np.isnan(z_m)] = np.nan
    for axis in (z_m, z_m.T):
        found_m = edge_distance_m(AXIS_M, AXIS_M, axis)
        np.testing.assert_allclose(found_m, off_m if axis is z_m else off_m.T, atol=1e-12)
        steepest = np.nanmax(incidence_deg(AXIS_M, AXIS_M, axis))
        assert (steepest > 60) == (beyond_m == 0.30499)  # of 5 in 2 mm


@pytest.mark.parametrize("half_m", [0.009, 0.018])  # one finger, and two side by side
def test_a_disc_with_a_stem_is_a_palm_with_a_finger(half_m):
    """The opening gives the disc back, and of the stem only the fillets at its root: a disc of
    radius r that touches a disc of radius R and both sides of the stem would have to fit between
    them, so none is deeper in the stem than r."""
    disc, stem = disc_and_stem(0.04, half_m, 0.08)
    z_m = np.where(disc | stem, 0.3, np.nan)
    z_m[60, 100] = np.nan  # a hole in the palm, as of a mesh
    part = parts(AXIS_M, AXIS_M, z_m)
    # rasterised circles differ by a pixel along their rim
    sure = np.abs(np.hypot(X_M, Y_M + 0.04) - 0.04) > 1.5e-3
    assert (part[disc & sure & np.isfinite(z_m)] == 1).all()
    assert (part[stem & ~disc & (Y_M >= PALM_RADIUS_M)] == 0).all()
    assert (np.isnan(part) == np.isnan(z_m)).all()


def scored(error_m: np.ndarray, level_db: np.ndarray) -> Scored:
    z_m = np.where(np.abs(X_M) < 0.05, 0.3, np.nan)
    depth = DepthMap(AXIS_M, AXIS_M, z_m + error_m, level_db, "3fsk")
    return Scored("3fsk", "truth", depth, ErrorMap(AXIS_M, AXIS_M, depth.z_m - z_m, z_m))


def test_figures_are_formed_for_each_capture_and_then_averaged():
    """One capture has errors of 1 mm at 0–3 dB and −4 mm at 13 dB and more, the other 3 mm at 0–3
    dB alone."""
    first = scored(np.where(Y_M > 0, 1e-3, -4e-3), np.where(Y_M > 0, -1.0, -13.0))
    other = scored(np.where(Y_M > 0.05, 3e-3, np.nan), np.full(X_M.shape, -2.0))
    found = explain([first, other])
    table = found["causes"]
    amplitude = table[table.cause == "below_maximum_db"].reset_index()
    assert amplitude.low.tolist() == [0, 13] and amplitude.n_captures.tolist() == [2, 1]
    figures = amplitude[["mean_mm", "median_mm", "absolute_mm", "p95_mm"]].to_numpy()
    np.testing.assert_allclose(figures, [[2, 2, 2, 2], [-4, -4, 4, 4]], rtol=1e-9)
    counted = np.isfinite(other.errors.error_m).sum() + (first.errors.error_m > 0).sum()
    assert amplitude.n_pixels[0] == counted and not len(found["reliability"])


@pytest.mark.parametrize("cause", [cause for cause, edges in BINS.items() if edges])
def test_a_bin_holds_its_lower_edge_and_what_is_just_below_the_next(cause):
    """Two pixels a bin: one on its lower edge, one just below its upper; the last holds what is
    infinitely far."""
    low, high = BINS[cause][:-1], BINS[cause][1:]
    at = np.stack([low, [np.nextafter(end, 0) if end < np.inf else end for end in high]], axis=1)
    error_m = 1e-3 * np.arange(len(at))[:, None] * np.ones(2)
    axes_m, reference_m = (np.arange(2.0), 1.0 * np.arange(len(at))), np.full(at.shape, 0.3)
    depth = DepthMap(*axes_m, reference_m + error_m, -at, "3fsk")
    surface = {name: np.full(at.shape, np.nan) for name in BINS} | {cause: at}
    lines = cause_lines(depth, ErrorMap(*axes_m, error_m, reference_m), surface)
    found = [line for line in lines if line["cause"] == cause]
    assert [(line["low"], line["high"]) for line in found] == [*zip(low, high, strict=True)]
    assert [line["n_pixels"] for line in found] == [2] * len(at)
    assert [line["mean_mm"] for line in found] == pytest.approx(range(len(at)))


def disc_and_stem(radius_m: float, half_m: float, top_m: float) -> tuple[np.ndarray, np.ndarray]:
    """A disc whose uppermost point is the origin, and a stem from its centre up to y = top_m."""
    disc = np.hypot(X_M, Y_M + radius_m) <= radius_m
    return disc, (np.abs(X_M) <= half_m) & (-radius_m < Y_M) & (top_m >= Y_M)


@pytest.mark.parametrize(("radius_m", "length_m", "split"), [
    (0.05, 0.02, False), (0.05, 0.05, True), (0.01, -0.01, False), (0.05, -0.05, False)
])  # fmt: skip
def test_a_tenth_of_a_hand_must_be_finger_and_another_palm(radius_m, length_m, split):
    """A disc of 7854 mm² with a stem 30 mm wide: 20 mm of it are 7 %, 50 mm are 16 %. Discs
    alone are all finger or all palm."""
    disc, stem = disc_and_stem(radius_m, 0.015, length_m)
    part = parts(AXIS_M, AXIS_M, np.where(disc | stem, 0.3, np.nan))
    assert np.isfinite(part).any() == split
