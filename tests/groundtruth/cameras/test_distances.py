"""The scale from distances between cameras."""

import numpy as np
import pytest

from handbench.groundtruth.cameras.cameras import registered_images
from handbench.groundtruth.options import Distance
from handbench.groundtruth.sparse.frame import apply, distances_from_model
from handbench.support.errors import HandbenchError
from tests.groundtruth.synthetic_model import synthetic_model

CENTRES = np.array(
    [(1.0, 0.0, 0.2), (1.0, 0.3, 0.2), (1.0, 0.3, 0.6), (0.9, -0.2, 0.1)]
)  # 0.3, 0.4 and 0.5 apart


def pair(a, b, metres):
    return Distance(first=f"p{a}.png", second=f"p{b}.png", distance_m=metres)


@pytest.fixture
def model():
    return synthetic_model(CENTRES)


def test_one_distance_scales_and_leaves_the_frame(model):
    matrix, scale = distances_from_model(model, (pair(0, 2, 1.25),))
    np.testing.assert_allclose(matrix, np.diag([2.5, 2.5, 2.5, 1]))
    assert (scale.source, scale.features, scale.used, scale.residual_m) == ("distances", 1, 1, None)
    apply(model, matrix)
    np.testing.assert_allclose(
        [image.projection_center() for image in registered_images(model)], 2.5 * CENTRES, atol=1e-9
    )


def test_several_are_balanced_and_their_residual_reported(model):
    """(0.3 · 0.304 + 0.4 · 0.397)/0.25 is 1, and the residuals are −4 and 3 mm."""
    matrix, scale = distances_from_model(model, (pair(0, 1, 0.304), pair(1, 2, 0.397)))
    assert matrix[0, 0] == pytest.approx(1)
    assert scale.residual_m == pytest.approx(5e-3 / 2**0.5)


@pytest.mark.parametrize(
    ("pairs", "words"),
    [
        ([(0, 9, 1.0)], r"p9\.png is not among the registered photographs \(p0\.png, p1"),
        ([(0, 1, 0.3), (1, 2, 0.45)], r"p0\.png to p1\.png is given as 0\.3 m.*agree to 2%"),
        ([(0, 0, 0.3)], "taken from the same point"),
    ],
)
def test_what_cannot_be_is_refused(model, pairs, words):
    with pytest.raises(HandbenchError, match=words):
        distances_from_model(model, tuple(pair(*each) for each in pairs))
