"""Samples and comparisons that the tests of imaging share."""

from collections.abc import Iterator
from contextlib import contextmanager
from unittest.mock import patch

import numpy as np

from handbench.radar.imaging.plan import fresh_plans


@contextmanager
def always_planned() -> Iterator[None]:
    """Images of points are made by plans, few as they are: a test's points are so few that their
    exact sum costs less, which would then be compared with itself. Whether a grid is planned stays
    as it is."""
    with fresh_plans(), patch("handbench.radar.imaging.api.exact_terms", lambda *_: np.inf):
        yield


def noise(shape: tuple[int, ...], seed: int = 0) -> np.ndarray:
    """White complex noise, the hardest input of a skeleton: nothing is concentrated where it is
    accurate."""
    generator = np.random.default_rng(seed)
    return (generator.standard_normal(shape) + 1j * generator.standard_normal(shape)).astype(
        np.complex64
    )


def relative_error(image: np.ndarray, reference: np.ndarray) -> float:
    """Relative L2 error."""
    return float(np.linalg.norm(image - reference) / np.linalg.norm(reference))
