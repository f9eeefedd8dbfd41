"""The synthetic result, written once for all tests."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.reports.synthetic_result import write_synthetic


@pytest.fixture(scope="session")
def result_folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The synthetic result, written once."""
    return write_synthetic(tmp_path_factory.mktemp("result") / "table")
