"""The runner: complete result folders, resumed after a kill, never mixed and never stale."""

import json
import os
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from bench import results
from bench.cache import claimed
from bench.protocol import load_benchmark
from bench.runner import run
from calibration.meshes import read_mesh, write_mesh
from calibration.transforms import Transform
from radar.errors import HandbenchError


def execute(bench_file: Path, folder: Path, **options: bool) -> results.Result:
    bench, base = load_benchmark(str(bench_file))
    return run(bench, base, folder, **options)


def figures(folder: Path) -> list[str]:
    """The table without its times."""
    return [line for line in (folder / "table.csv").read_text().splitlines() if not line.startswith("seconds")]


def numbers(folder: Path) -> list[float]:
    """The table's values and intervals, one after another."""
    rows = [line.split(",")[2:5] for line in figures(folder)[1:]]
    return [float(cell) for row in rows for cell in row if cell]


def names(folder: Path) -> list[list[str]]:
    """What the table's rows are about, and which cells are empty."""
    rows = [line.split(",") for line in figures(folder)]
    return [[*row[:2], *row[5:], *(str(bool(cell)) for cell in row[2:5])] for row in rows]


def test_result_folder_is_complete_and_plausible(small_bench, tmp_path):
    result = execute(small_bench, tmp_path / "out")
    mae = {row.method: row.value for row in result.rows if row.metric == "mae_mm"}
    assert mae.keys() == {"2fsk", "narrowband"}
    assert 0 < mae["2fsk"] < 10  # σ_z is 3.6 mm at the strongest pixel and 11 mm at the threshold
    assert result.row("precision_mm", "2fsk", "truth").value > 0
    assert result.row("precision_mm", "narrowband", "truth") is None
    assert len(result.repeats) == 3
    assert {task.stage for task in result.tasks} == {"simulate", "reconstruct", "repeat"}
    assert all(task.seconds > 0 and task.peak_memory_mb > 0 and not task.cached for task in result.tasks)


def test_second_run_is_cached_and_gives_the_same_table(small_bench, tmp_path):
    execute(small_bench, tmp_path / "out")
    before = (tmp_path / "out" / "table.csv").read_text()
    again = execute(small_bench, tmp_path / "out")
    assert all(task.cached for task in again.tasks)
    assert (tmp_path / "out" / "table.csv").read_text() == before


def test_a_changed_input_is_never_taken_from_the_cache(small_bench, tmp_path):
    execute(small_bench, tmp_path / "out")
    scene = small_bench.parent / "ball.toml"
    scene.write_text(scene.read_text().replace("seed = 3", "seed = 4"))
    again = execute(small_bench, tmp_path / "out")
    assert not any(task.cached for task in again.tasks)


def test_another_configuration_is_refused_unless_asked_for(small_bench, tmp_path):
    execute(small_bench, tmp_path / "out")
    kept = figures(tmp_path / "out")
    small_bench.write_text(small_bench.read_text().replace("seed = 1", "seed = 2"))
    with pytest.raises(HandbenchError, match="another configuration"):
        execute(small_bench, tmp_path / "out")
    assert figures(tmp_path / "out") == kept
    execute(small_bench, tmp_path / "out", overwrite=True)


def test_a_stranger_s_folder_is_left_alone(small_bench, tmp_path):
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / "thesis.tex").write_text("mine")
    with pytest.raises(HandbenchError, match="no run wrote"):
        execute(small_bench, tmp_path / "out")
    assert (tmp_path / "out" / "thesis.tex").read_text() == "mine"


def test_a_folder_of_photographs_is_not_taken_for_a_result(small_bench, tmp_path):
    (tmp_path / "session" / "photos").mkdir(parents=True)
    (tmp_path / "session" / "photos" / "hand.jpg").write_text("mine")
    with pytest.raises(HandbenchError, match="no run wrote"):
        execute(small_bench, tmp_path / "session")
    assert [p.name for p in (tmp_path / "session").rglob("*")] == ["photos", "hand.jpg"]


def test_two_runs_do_not_share_a_folder(small_bench, tmp_path):
    with claimed(tmp_path / "out"), pytest.raises(HandbenchError, match="another run"):
        execute(small_bench, tmp_path / "out")


def test_a_killed_run_resumes_to_the_same_table(small_bench, tmp_path):
    execute(small_bench, tmp_path / "whole")
    out = tmp_path / "killed"
    command = [sys.executable, "-m", "bench.cli", "run", str(small_bench), "-o", str(out)]
    process = subprocess.Popen(command, stderr=subprocess.DEVNULL, stdout=subprocess.DEVNULL)
    deadline = time.monotonic() + 60
    while not list((out / "work").glob("simulate-*")) and time.monotonic() < deadline:
        time.sleep(0.02)
    os.kill(process.pid, signal.SIGKILL)
    process.wait()
    assert not (out / "result.json").exists()
    (out / "work" / ".reconstruct-abc-half").mkdir()  # what a kill inside a stage leaves behind
    resumed = execute(small_bench, out)
    assert next(task for task in resumed.tasks if task.stage == "simulate").cached
    # Kernels just compiled and the same ones from numba's cache differ in rounding, 1e-7 of an echo: 1e-5 mm of 2-FSK.
    assert numbers(out) == pytest.approx(numbers(tmp_path / "whole"), abs=1e-4)
    assert names(out) == names(tmp_path / "whole")
    assert not list((out / "work").glob(".reconstruct*"))


def test_captures_as_folders_score_as_simulated_ones(small_bench, tmp_path):
    execute(small_bench, tmp_path / "out")
    capture = next((tmp_path / "out" / "work").glob("simulate-*")) / "capture"
    shutil.copytree(capture, small_bench.parent / "recorded")
    small_bench.write_text(small_bench.read_text().replace('scene = "ball.toml"', 'path = "recorded"'))
    execute(small_bench, tmp_path / "recorded")
    assert figures(tmp_path / "recorded") == figures(tmp_path / "out")


def test_a_mesh_in_the_photo_frame_scores_as_the_truth_does(small_bench, tmp_path):
    execute(small_bench, tmp_path / "out")
    recorded = small_bench.parent / "recorded"
    shutil.copytree(next((tmp_path / "out" / "work").glob("simulate-*")) / "capture", recorded)
    matrix = np.eye(4)
    matrix[:3, :3], matrix[:3, 3] = Rotation.from_rotvec([0.3, -0.2, 0.5]).as_matrix(), (0.1, 0.2, 0.5)
    radar_from_photo = Transform("photo", "radar", matrix)
    surface = read_mesh(recorded / "truth.ply")
    write_mesh(recorded / "mesh.ply", surface.transform(radar_from_photo.inverse().matrix))
    radar_from_photo.save(recorded / "radar_from_photo.json")
    small_bench.write_text(small_bench.read_text().replace('scene = "ball.toml"', 'path = "recorded"'))
    result = execute(small_bench, tmp_path / "recorded")
    for method in ("2fsk", "narrowband"):
        values = [result.row("mae_mm", method, r).value for r in ("photogrammetry", "truth")]
        assert values[0] == pytest.approx(values[1], abs=1e-3)  # the mesh is stored in float32: 1e-7 of 0.5 m
    radar_from_photo.inverse().save(recorded / "radar_from_photo.json")
    with pytest.raises(HandbenchError, match="leads from 'radar' to 'photo'"):
        execute(small_bench, tmp_path / "inverted")


def test_a_capture_without_any_reference_is_an_error(small_bench, tmp_path):
    execute(small_bench, tmp_path / "out")
    capture = next((tmp_path / "out" / "work").glob("simulate-*")) / "capture"
    recorded = small_bench.parent / "recorded"
    shutil.copytree(capture, recorded)
    (recorded / "truth.ply").unlink()
    description = (recorded / "capture.toml").read_text()
    (recorded / "capture.toml").write_text(description.replace('"truth.ply", ', ""))
    small_bench.write_text(small_bench.read_text().replace('scene = "ball.toml"', 'path = "recorded"'))
    with pytest.raises(HandbenchError, match="nothing to score against"):
        execute(small_bench, tmp_path / "recorded")


def test_paths_do_not_leave_the_benchmark_s_folder(small_bench, tmp_path):
    small_bench.write_text(small_bench.read_text().replace('"ball.toml"', '"../../etc/passwd"'))
    with pytest.raises(HandbenchError, match="leaves the folder"):
        execute(small_bench, tmp_path / "out")


def test_result_json_says_how_it_came_about(small_bench, tmp_path):
    execute(small_bench, tmp_path / "out")
    about = json.loads((tmp_path / "out" / "result.json").read_text())
    assert about["protocol"]["id"] == "paper"
    assert about["inputs"].keys() == {"ball"}
    assert "numpy" in about["versions"]
    assert about["machine"]["cores"] >= 1
    assert about["machine"]["imaging_device"] == "cpu"
    assert about["metrics"]["mae_mm"]["definition"]
