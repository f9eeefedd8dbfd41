"""Errors by cause, against shapes whose angles, edges and parts follow from a closed form."""

from __future__ import annotations

from itertools import pairwise

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
    surface_causes,
)
from handbench.bench.evaluation.tables import CAUSES, RELIABILITY, read, write
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
    at_centre = incidence_deg(AXIS_M, AXIS_M, z_m)[100, 100]
    assert at_centre == pytest.approx(
        np.degrees(np.arctan(np.hypot(a, b)))
    )  # where the sight is along z


def test_incidence_on_a_sphere_is_the_sine_rule_s():
    """On a sphere about (0, 0, d) the ray at the angle θ from the axis meets the normal at i with R
    sin i = d sin θ."""
    radius_m, distance_m = 0.05, 0.3
    across_m = np.hypot(X_M, Y_M)
    z_m = distance_m - np.sqrt(
        np.where(across_m < 0.8 * radius_m, radius_m**2 - across_m**2, np.nan)
    )
    expected = np.degrees(np.arcsin(distance_m / radius_m * across_m / np.hypot(across_m, z_m)))
    inner = (
        across_m < 0.75 * radius_m
    )  # central differences of both neighbours: an error of h²·z'''/6
    found = incidence_deg(AXIS_M, AXIS_M, z_m)
    np.testing.assert_allclose(found[inner], expected[inner], atol=0.1)
    assert (np.isfinite(found) == np.isfinite(z_m)).all()


def test_no_slope_is_taken_across_a_jump():
    z_m = np.where(X_M < 0, 0.30, 0.32)
    np.testing.assert_allclose(
        incidence_deg(AXIS_M, AXIS_M, z_m),
        np.degrees(np.arctan(np.hypot(X_M, Y_M) / z_m)),
        atol=1e-6,
    )
    lonely = np.full((5, 5), np.nan)
    lonely[2, 2] = 0.3
    assert np.isnan(incidence_deg(AXIS_M[:5], AXIS_M[:5], lonely)).all()


@pytest.mark.parametrize("beyond_m", [np.nan, 0.32])
def test_the_distance_to_the_edge_of_a_half_plane_is_that_to_its_line(beyond_m):
    """The reference ends, or jumps, between the pixels at −1 and 0 mm: the edge is the line x =
    −0.5 mm."""
    z_m = np.where(X_M < -1e-9, 0.30, beyond_m)
    distance_m = edge_distance_m(AXIS_M, AXIS_M, z_m)
    np.testing.assert_allclose(
        distance_m[np.isfinite(z_m)], np.abs(X_M + 0.5e-3)[np.isfinite(z_m)], atol=1e-12
    )
    assert (np.isnan(distance_m) == np.isnan(z_m)).all()


def test_causes_of_a_surface_come_in_their_units():
    """A plate across the axis that ends at x = 10.5 mm: the pixel 30 mm from there is 30 mm from
    the edge."""
    axis_m = 1e-3 * np.arange(-40, 41)
    z_m = np.where(axis_m > 0.0105, np.nan, 0.3) * np.ones((81, 1))
    causes = surface_causes(axis_m, axis_m, z_m)
    steps_mm = np.diff(causes["edge_distance_mm"][40, 5:45])
    np.testing.assert_allclose(steps_mm, -1.0, rtol=1e-9)
    assert causes["edge_distance_mm"][40, 20] == pytest.approx(30.5, abs=0.51)
    assert causes["incidence_deg"][40, 10] == pytest.approx(
        np.degrees(np.arctan2(30, 300)), rel=1e-9
    )


def test_the_image_s_border_is_no_edge():
    assert np.isinf(edge_distance_m(AXIS_M, AXIS_M, np.full(X_M.shape, 0.3))).all()


@pytest.mark.parametrize("half_m", [0.009, 0.018])  # one finger, and two side by side
def test_a_disc_with_a_stem_is_a_palm_with_a_finger(half_m):
    """The opening gives the disc back, and of the stem only the fillets at its root: a disc of
    radius r that touches a disc of radius R and both sides of the stem would have to fit between
    them, so none is deeper in the stem than r."""
    disc = np.hypot(X_M, Y_M + 0.04) <= 0.04
    stem = (np.abs(X_M) <= half_m) & (Y_M > -0.04) & (Y_M < 0.08)
    z_m = np.where(disc | stem, 0.3, np.nan)
    z_m[60, 100] = np.nan  # a hole in the palm, as of a mesh
    part = parts(AXIS_M, AXIS_M, z_m)
    sure = (
        np.abs(np.hypot(X_M, Y_M + 0.04) - 0.04) > 1.5e-3
    )  # rasterised circles differ by a pixel along their rim
    assert (part[disc & sure & np.isfinite(z_m)] == 1).all()
    root = (Y_M < PALM_RADIUS_M) & stem
    assert (part[stem & ~disc & ~root] == 0).all()
    assert (np.isnan(part) == np.isnan(z_m)).all()


@pytest.mark.parametrize("radius_m", [0.01, 0.06])
def test_what_is_all_finger_or_all_palm_is_no_hand(radius_m):
    z_m = np.where(np.hypot(X_M, Y_M) < radius_m, 0.3, np.nan)
    assert np.isnan(parts(AXIS_M, AXIS_M, z_m)).all()


def scored(error_m: np.ndarray, level_db: np.ndarray, method: str = "3fsk") -> Scored:
    reference_m = np.where(np.abs(X_M) < 0.05, 0.3, np.nan)
    depth = DepthMap(AXIS_M, AXIS_M, reference_m + error_m, level_db, method)
    return Scored(
        method, "truth", depth, ErrorMap(AXIS_M, AXIS_M, depth.z_m - reference_m, reference_m)
    )


def test_figures_are_formed_for_each_capture_and_then_averaged(tmp_path):
    """One capture has errors of 1 mm at 0–3 dB and −4 mm at 13 dB and more, the other 3 mm at 0–3
    dB alone."""
    first = scored(np.where(Y_M > 0, 1e-3, -4e-3), np.where(Y_M > 0, -1.0, -13.0))
    other = scored(np.where(Y_M > 0.05, 3e-3, np.nan), np.full(X_M.shape, -2.0))
    found = explain([first, other])
    write(tmp_path / "causes.csv", found["causes"], CAUSES)
    table = read(tmp_path / "causes.csv", CAUSES)
    amplitude = table[table.cause == "below_maximum_db"].reset_index()
    assert amplitude.low.tolist() == [0, 13]
    assert amplitude.n_captures.tolist() == [2, 1]
    strong, weak = amplitude.loc[0], amplitude.loc[1]
    assert strong[["mean_mm", "median_mm", "absolute_mm", "p95_mm"]].tolist() == pytest.approx(
        [2, 2, 2, 2]
    )
    assert weak[["mean_mm", "median_mm", "absolute_mm", "p95_mm"]].tolist() == pytest.approx(
        [-4, -4, 4, 4]
    )
    assert (
        strong.n_pixels
        == np.isfinite(other.errors.error_m).sum() + (first.errors.error_m > 0).sum()
    )
    edges = table[table.cause == "edge_distance_mm"]
    assert edges.n_pixels.sum() == amplitude.n_pixels.sum()
    assert edges.low.tolist() == list(BINS["edge_distance_mm"][:-1])
    assert not len(found["reliability"])


def test_percentiles_and_medians_are_of_the_pixels():
    """Errors that grow evenly from 0 to 10 mm have the median 5 and the 95th percentile 9.5 mm."""
    error_m = 0.01 * (Y_M - Y_M.min()) / np.ptp(Y_M)
    [line] = (
        explain([scored(error_m, np.zeros(X_M.shape))])["causes"]
        .query("cause == 'below_maximum_db'")
        .itertuples()
    )
    assert (line.mean_mm, line.median_mm, line.absolute_mm, line.p95_mm) == pytest.approx(
        (5, 5, 5, 9.5)
    )


def test_a_surface_without_an_edge_is_far_from_one():
    reference_m, error_m = np.full(X_M.shape, 0.3), np.full(X_M.shape, 1e-3)
    depth = DepthMap(AXIS_M, AXIS_M, reference_m + error_m, np.zeros(X_M.shape), "3fsk")
    table = explain(
        [Scored("3fsk", "truth", depth, ErrorMap(AXIS_M, AXIS_M, error_m, reference_m))]
    )["causes"]
    [line] = table[table.cause == "edge_distance_mm"].itertuples()
    assert line.low == 16 and np.isinf(line.high) and line.n_pixels == X_M.size


def test_a_line_for_each_method_and_reference_and_none_without_maps():
    maps = [scored(np.full(X_M.shape, 1e-3), np.zeros(X_M.shape), name) for name in ("a", "b")]
    assert explain(maps)["causes"].method.unique().tolist() == ["a", "b"]
    for name, schema in (("causes", CAUSES), ("reliability", RELIABILITY)):
        assert list(explain([])[name].columns) == schema.names


def test_parts_of_hands_have_lines_of_their_own():
    """A palm with errors of 1 mm and a finger with 3 mm, in two captures of which one shows the
    palm alone."""
    disc = np.hypot(X_M, Y_M + 0.04) <= 0.04
    stem = (np.abs(X_M) <= 0.009) & (Y_M > -0.04) & (Y_M < 0.08)
    reference_m = np.where(disc | stem, 0.3, np.nan)
    part = parts(AXIS_M, AXIS_M, reference_m)
    error_m = np.choose(np.nan_to_num(part, nan=1).astype(int), [3e-3, 1e-3]) + 0 * reference_m
    depth = DepthMap(AXIS_M, AXIS_M, reference_m + error_m, np.zeros(X_M.shape), "3fsk")
    palm_m = np.where(part == 1, error_m, np.nan)
    both = [
        Scored("3fsk", "truth", depth, ErrorMap(AXIS_M, AXIS_M, e, reference_m))
        for e in (error_m, palm_m)
    ]
    found = explain(both)["causes"].query("cause == 'part'").set_index("part")
    assert found.mean_mm.to_dict() == pytest.approx({"finger": 3.0, "palm": 1.0})
    assert found.n_captures.to_dict() == {"finger": 1, "palm": 2}
    assert found.n_pixels.to_dict() == {"finger": (part == 0).sum(), "palm": 2 * (part == 1).sum()}


@pytest.mark.parametrize(
    ("cause", "edges"),
    [
        ("incidence_deg", [0, 5, 10, 15, 20, 30, 45, np.inf]),
        ("below_maximum_db", [0, 3, 6, 10, 13, np.inf]),
        ("edge_distance_mm", [0, 2, 4, 8, 16, np.inf]),
    ],
)
def test_a_bin_holds_its_lower_edge_and_what_is_just_below_the_next(cause, edges):
    """Two pixels a bin: one on its lower edge, one just below its upper; the last holds what is
    infinitely far."""
    at = np.array(
        [
            [low, np.nextafter(high, 0) if np.isfinite(high) else np.inf]
            for low, high in pairwise(edges)
        ]
    )
    error_m, axes_m = (
        1e-3 * (1 + np.arange(len(at)))[:, None] * np.ones(2),
        (np.arange(2.0), np.arange(len(at)) * 1.0),
    )
    reference_m = np.full(at.shape, 0.3)
    depth = DepthMap(*axes_m, reference_m + error_m, -at, "3fsk")
    surface = {name: np.full(at.shape, np.nan) for name in BINS} | {cause: at}
    lines = cause_lines(depth, ErrorMap(*axes_m, error_m, reference_m), surface)
    found = [line for line in lines if line["cause"] == cause]
    assert [line["low"] for line in found] == edges[:-1] and [
        line["high"] for line in found
    ] == edges[1:]
    assert [line["n_pixels"] for line in found] == [2] * len(at)
    assert [line["mean_mm"] for line in found] == pytest.approx(range(1, len(at) + 1))


@pytest.mark.parametrize(("jump_m", "edge"), [(4.99e-3, False), (5.01e-3, True)])
def test_five_millimetres_between_neighbours_are_an_edge(jump_m, edge):
    z_m = np.where(X_M < -1e-9, 0.30, 0.30 + jump_m)
    for x_m, y_m, at_m in ((AXIS_M, AXIS_M, z_m), (AXIS_M, AXIS_M, z_m.T)):
        assert np.isfinite(edge_distance_m(x_m, y_m, at_m)).all() == edge
        steepest = incidence_deg(x_m, y_m, at_m).max()
        assert (steepest > 60) != edge  # a slope of 5 in 2 mm, unless it is an edge


@pytest.mark.parametrize(("length_m", "told"), [(0.02, False), (0.05, True)])
def test_a_tenth_of_a_hand_must_be_finger(length_m, told):
    """A disc of 7854 mm² with a stem 30 mm wide: 20 mm of it are 7 %, 50 mm are 16 %."""
    disc = np.hypot(X_M, Y_M + 0.05) <= 0.05
    stem = (np.abs(X_M) <= 0.015) & (Y_M > -0.05) & (length_m >= Y_M)
    part = parts(AXIS_M, AXIS_M, np.where(disc | stem, 0.3, np.nan))
    assert np.isfinite(part).any() == told
