"""The target of the calibration tests."""

from __future__ import annotations

import numpy as np
import pytest

from handbench.calibration.spheres.description import Target, default_target


@pytest.fixture
def rng() -> np.random.Generator:
    return np.random.default_rng(20240607)


@pytest.fixture(scope="session")
def target() -> Target:
    return default_target()
