"""What tests of benchmarks share beside the small one."""

import shutil
from pathlib import Path

import pytest


@pytest.fixture
def recorded(small_bench: Path, small_result: Path) -> Path:
    """The small benchmark's capture as a folder, "ball", of a benchmark of that folder."""
    folder = small_bench.parent / "ball"
    shutil.copytree(next((small_result / "work").glob("simulate-*")) / "capture", folder)
    small_bench.write_text(small_bench.read_text().replace('scene = "ball.toml"', 'path = "ball"'))
    return folder


@pytest.fixture
def undoubted(monkeypatch: pytest.MonkeyPatch) -> None:
    """Nothing is doubted of any capture: what a run looks for takes longer than the run
    (test_inspect)."""
    monkeypatch.setattr(
        "handbench.bench.validation.capture_warnings.capture_warnings", lambda *_: iter(())
    )
