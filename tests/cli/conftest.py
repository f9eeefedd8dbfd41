"""A capture of a ball, made by the commands once for all tests."""

from __future__ import annotations

from pathlib import Path

import pytest

from handbench.cli.main import main
from tests.small_benchmark import write_bench

# 21 × 21 pixels before the ball
PIXELS = [
    f"--set={axis}.{end}={value}"
    for axis in "xy"
    for end, value in (("start_m", -0.01), ("stop_m", 0.01))
]


@pytest.fixture(scope="session")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with bench/ (small.toml, ball.toml), capture/, depth.npz by narrowband with its
    volume.npz; a test that changes them copies them."""
    folder = tmp_path_factory.mktemp("made")
    scene = write_bench(folder / "bench").parent / "ball.toml"
    assert main(["simulate", str(scene), "-o", str(folder / "capture")]) == 0
    depths = ["--set=z.start_m=0.275", "--set=z.stop_m=0.285", "--set=z.step_m=0.002"]
    command = ["reconstruct", str(folder / "capture"), "--method", "narrowband", *PIXELS, *depths]
    files = ["-o", str(folder / "depth.npz"), "--volume", str(folder / "volume.npz")]
    assert main([*command, *files]) == 0
    return folder
