"""Corners of squares from their edges, where a corner detector is half a pixel off."""

import cv2
import numpy as np
import pytest

from handbench.groundtruth.markers import crossings_of_edges, refine_corners, to_light

FINE = 8  # sub-pixels of the drawing
QUAD = np.array(
    [(60.3, 40.7), (150.9, 52.2), (141.6, 139.8), (52.4, 131.1)]
)  # clockwise, as indices


def straight(pixels, bend):
    """Places [..., 2] of pixels without the lens: farther from the origin by bend r²."""
    return pixels * (1 + bend * (pixels**2).sum(axis=-1, keepdims=True))


def drawing(blur_px=1.0, cover=None, bend=0.0):
    """A dark square on white as light [200, 220] float32. bend: of a lens, as in `straight`."""
    y, x = (np.mgrid[: 200 * FINE, : 220 * FINE] + 0.5) / FINE - 0.5
    x, y = straight(np.stack([x, y], axis=-1), bend).transpose(2, 0, 1)
    edges = zip(QUAD, np.roll(QUAD, -1, axis=0) - QUAD, strict=True)
    inside = [along[0] * (y - a[1]) > along[1] * (x - a[0]) for a, along in edges]
    large = np.where(np.all(inside, axis=0), 0.03, 0.8).astype(np.float32)
    if cover is not None:
        large[cover[0] * FINE : cover[1] * FINE, cover[2] * FINE : cover[3] * FINE] = 0.5
    small = cv2.resize(large, (220, 200), interpolation=cv2.INTER_AREA)
    return cv2.GaussianBlur(small, (0, 0), blur_px) + np.random.default_rng(0).normal(
        0, 0.004, (200, 220)
    ).astype("f4")


def to_tones(light):
    curve = 1.055 * light.clip(0.0031308) ** (1 / 2.4) - 0.055
    return np.where(light < 0.0031308, 12.92 * light, curve).astype(np.float32)


@pytest.mark.parametrize("blur_px", [0.7, 1.5])
def test_corners_are_exact_where_a_detector_draws_them_inwards(blur_px):
    tones = to_tones(drawing(blur_px))
    guess = QUAD.astype(np.float32).reshape(-1, 1, 2).copy()
    cv2.cornerSubPix((tones * 255).round().astype(np.uint8), guess, (5, 5), (-1, -1), (3, 30, 0.01))
    detected = guess.reshape(4, 2).astype(np.float64)
    assert np.linalg.norm(detected - QUAD, axis=1).mean() > 0.3
    assert np.linalg.norm(refine_corners(to_light(tones), detected) - QUAD, axis=1).max() < 0.08


def test_a_guess_two_pixels_off_is_enough():
    guess = QUAD + [(1.5, 1.0), (-1.2, 1.3), (-1.0, -1.5), (1.0, -1.0)]
    assert np.linalg.norm(refine_corners(drawing(), guess) - QUAD, axis=1).max() < 0.08


def test_corners_beside_a_covered_edge_are_left_out():
    corners = refine_corners(drawing(cover=(125, 160, 60, 130)), QUAD)  # most of the lower edge
    assert np.isnan(corners[2:]).all()
    assert np.linalg.norm(corners[:2] - QUAD[:2], axis=1).max() < 0.08


def test_corners_of_edges_that_a_lens_bends_are_where_it_is_predicted():
    bend = 2e-6

    def project(places):
        pixels = places
        for _ in range(100):
            pixels = places / (1 + bend * (pixels**2).sum(axis=-1, keepdims=True))
        return pixels

    predicted = crossings_of_edges(project, QUAD)
    assert np.linalg.norm(predicted - project(QUAD), axis=1).max() > 0.3
    found = refine_corners(drawing(bend=bend), project(QUAD))
    assert np.linalg.norm(found - predicted, axis=1).max() < 0.08
