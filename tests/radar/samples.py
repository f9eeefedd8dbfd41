"""Samples and comparisons that the tests of imaging share."""

import numpy as np


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
