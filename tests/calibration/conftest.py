"""The target of the calibration tests, and how finely they search for it."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pytest

from handbench.calibration.target import Target, default_target
from tests.calibration.seen_target import search_coarsely


@pytest.fixture
def rng() -> np.random.Generator:
    return np.random.default_rng(20240607)


@pytest.fixture(scope="session")
def target() -> Target:
    return default_target()


@pytest.fixture(scope="module", autouse=True)
def coarse_search() -> Iterator[None]:
    with pytest.MonkeyPatch.context() as patch:
        search_coarsely(patch)
        yield
