"""Radial velocities against those of a plane that tips, and frames against their own surfaces; no
echo is imaged."""

from __future__ import annotations

import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from handbench.bench.datasets.native import CaptureFile, save_capture_file
from handbench.bench.evaluation.depth_errors import mean_speed_m_s
from handbench.bench.evaluation.score import reference_of_file, score
from handbench.bench.evaluation.tables import SCORES, read
from handbench.bench.stages.reconstruct import DEPTH, TIMING, write_frames
from handbench.bench.stages.score import SCORED, score_capture
from handbench.calibration.transforms import Transform, identity
from handbench.groundtruth.mesh.surface import Surface, read_surface
from handbench.radar.data.depthmap import DepthMap
from handbench.radar.data.grid import PixelGrid
from handbench.support.files import write_json
from tests.refusals import refuse

AXIS_M = np.linspace(-0.04, 0.04, 21)
HALF_M, Z_M, RATE_RAD_S = 0.05, 0.3, 2.0
X_M, Y_M = np.meshgrid(AXIS_M, AXIS_M)
# that tips about x through its middle
RADIAL_M_S = RATE_RAD_S * Y_M * Z_M / np.sqrt(X_M**2 + Y_M**2 + Z_M**2)


def plate(file: Path, z_m: float = Z_M, moves: bool = True) -> Path:
    """Write a square plate that faces the radar at z_m and tips about x, or is at rest."""
    corners_m = np.array([(x, y, z_m) for y in (-HALF_M, HALF_M) for x in (-HALF_M, HALF_M)])
    velocity_m_s = RATE_RAD_S * corners_m[:, 1:2] * (0, 0, 1) if moves else None
    faces = np.array([(0, 2, 1), (1, 2, 3)])
    file.parent.mkdir(parents=True, exist_ok=True)
    Surface(corners_m, faces, np.zeros(4), np.ones(4, bool), velocity_m_s).save(file)
    return file


def seen(velocity_m_s, z_m: float = Z_M, **fields) -> DepthMap:
    flat = np.full(X_M.shape, z_m)
    v_m_s = None if velocity_m_s is None else np.broadcast_to(velocity_m_s, X_M.shape).copy()
    return DepthMap(AXIS_M, AXIS_M, flat, 0 * flat, "2fsk", velocity_m_s=v_m_s, **fields)


def figures(depth: DepthMap, file: Path) -> dict[str, float | None]:
    reference = reference_of_file(file, identity("radar"), PixelGrid(AXIS_M, AXIS_M), exact=True)
    found = score(depth, reference).figures
    return {name: value for name, value in found.items() if name.startswith("velocity")}


MEAN_MM_S = 1e3 * np.abs(RADIAL_M_S).mean()


@pytest.mark.parametrize(
    ("velocity_m_s", "mae_mm_s", "bias_mm_s"),
    [(RADIAL_M_S, 0, 0), (0.0, MEAN_MM_S, 0), (RADIAL_M_S + 0.01, 10, 10)],
    ids=["right", "zero", "too fast"],
)
def test_a_plate_that_tips(tmp_path, velocity_m_s, mae_mm_s, bias_mm_s):
    found = figures(seen(velocity_m_s), plate(tmp_path / "truth.ply"))
    assert found["velocity_mae_mm_s"] == pytest.approx(mae_mm_s, abs=1e-9)
    assert found["velocity_bias_mm_s"] == pytest.approx(bias_mm_s, abs=1e-9)
    assert found["velocity_within_percent"] is found["velocity_beyond_percent"] is None


def test_intervals_and_limit(tmp_path):
    """A fifth of the velocities is off by 2 σ; the rows that move fastest are beyond the limit."""
    sigma_m_s, wrong = np.full(X_M.shape, 0.01), np.arange(X_M.size).reshape(X_M.shape) % 5 == 0
    depth = seen(RADIAL_M_S + np.where(wrong, 0.02, 0.019), velocity_sigma_m_s=sigma_m_s)
    depth = replace(depth, velocity_limit_m_s=0.06)
    found = figures(depth, plate(tmp_path / "truth.ply"))
    assert found["velocity_within_percent"] == pytest.approx(100 * (~wrong).mean())
    expected = 100 * (np.abs(RADIAL_M_S) > 0.06).mean()
    assert 0 < expected < 100 and found["velocity_beyond_percent"] == pytest.approx(expected)


def test_without_velocities_there_are_no_figures(tmp_path):
    """A simulator's surface without velocities is at rest."""
    assert figures(seen(None), plate(tmp_path / "a.ply")) == {}
    resting = plate(tmp_path / "b.ply", moves=False)
    measured = reference_of_file(resting, identity("radar"), PixelGrid(AXIS_M, AXIS_M), exact=False)
    assert mean_speed_m_s(measured) is None
    at_rest = figures(seen(0.003), resting)
    assert at_rest["velocity_mae_mm_s"] == pytest.approx(3)


def test_velocities_turn_with_the_surface(tmp_path):
    """By 90° about z, x and y of the velocity change places."""
    turned = np.eye(4)
    turned[:2, :2] = [[0, -1], [1, 0]]
    before = read_surface(plate(tmp_path / "a.ply"))
    before = replace(before, velocity_m_s=np.tile([1.0, 2.0, 3.0], (4, 1)))
    after = before.moved(Transform("photo", "radar", turned))
    np.testing.assert_allclose(after.velocity_m_s, np.tile([-2.0, 1.0, 3.0], (4, 1)))


@pytest.fixture
def moving(tmp_path):
    """Three frames of a plate that moves away, imaged without an error; its folder, and that of the
    imaging stage."""
    capture, imaged = tmp_path / "capture", tmp_path / "imaged"
    z_m = (0.3, 0.31, 0.325)
    for frame, at_m in enumerate(z_m):
        plate(capture / "truth" / f"{frame:03d}.ply", at_m)
    plate(capture / "truth.ply")
    save_capture_file(capture, CaptureFile(name="plate"))
    imaged.mkdir()
    depths = [seen(RADIAL_M_S, at_m) for at_m in z_m]
    depths[0].save(imaged / DEPTH)
    write_frames(imaged, depths)
    times = {"seconds": [0.1], "step_time_s": 1e-3, "frame_times_s": [0.0, 0.1, 0.2]}
    write_json(imaged / TIMING, times)
    return capture, imaged


def scores_of(capture: Path, imaged: Path, folder: Path):
    files = {"2fsk": imaged / DEPTH}
    truth = {"truth": (capture / "truth.ply", identity("radar"))}
    score_capture(folder, str(capture), files, truth, "paper")
    scores = read(folder / SCORED, SCORES)
    return scores[scores.treatment == ""].set_index(["metric", "frame"]).value


def test_each_frame_has_its_own_truth(moving, tmp_path):
    found = scores_of(*moving, tmp_path / "scored")
    assert found["mae_mm"].to_list() == pytest.approx([0, 0, 0], abs=1e-4)  # maps are float32
    assert found["velocity_mae_mm_s"].max() < 1  # the plate is at another distance
    assert found["start_s"].to_list() == [0.0, 0.1, 0.2]
    assert found["speed_mm_s", 0] == pytest.approx(MEAN_MM_S)
    assert found["step_time_s", 0] == 1e-3


def test_without_further_truths_all_frames_have_one(moving, tmp_path):
    capture, imaged = moving
    shutil.rmtree(capture / "truth")
    found = scores_of(capture, imaged, tmp_path / "scored")
    assert found["mae_mm"].to_list() == pytest.approx([0, 10, 25], abs=1e-4)


def test_a_missing_truth_is_named(moving, tmp_path):
    capture, imaged = moving
    (capture / "truth" / "002.ply").unlink()
    refuse(lambda: scores_of(capture, imaged, tmp_path / "scored"), "002.ply")
