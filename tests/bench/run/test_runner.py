"""The runner: complete result folders, resumed after a kill, never mixed and never stale."""

import json
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from handbench.bench.datasets.dataset import open_capture
from handbench.bench.results.result_folder import load
from handbench.bench.run import runner
from handbench.calibration.transforms import Transform
from handbench.cli.main import main
from handbench.groundtruth.mesh.surface import read_mesh, write_mesh
from handbench.radar.data.echoes_file import load_capture, save_capture
from tests.bench.run.faults import execute, figures
from tests.refusals import refuse

pytestmark = pytest.mark.usefixtures("undoubted")


def test_the_result_folder_is_complete_and_says_how_it_came_about(small_result):
    result = load(small_result)
    mae = result.table[result.table.metric == "mae_mm"].set_index("method").value
    assert set(mae.index) == {"2fsk", "narrowband"}
    assert 0 < mae["2fsk"] < 10  # σ_z is 3.6 mm at the strongest pixel and 11 mm at the threshold
    assert result.row("precision_mm", "2fsk", "truth").value > 0 and len(result.repeats) == 3
    assert result.row("precision_mm", "narrowband", "truth") is None
    assert (result.tasks[["seconds", "peak_memory_mb"]] > 0).all(axis=None)
    assert set(result.reliability.method) == {"2fsk"}  # a projection tells no σ
    about = json.loads((small_result / "result.json").read_text())
    assert about["protocol"]["id"] == "paper" and about["inputs"].keys() == {"ball"}
    assert "numpy" in about["versions"] and about["metrics"]["mae_mm"]["definition"]
    assert set(result.tasks.host) == {about["machine"]["host"]}


def test_what_is_the_same_is_taken_from_before_and_nothing_else_is(
    small_bench, small_result, tmp_path, monkeypatch
):
    """What may be overwritten once may be, although the run is interrupted."""
    out = tmp_path / "out"
    shutil.copytree(small_result, out)
    before = (out / "table.csv").read_text()
    assert execute(small_bench, out).tasks.cached.all()
    assert (out / "table.csv").read_text() == before
    bench = small_bench.read_text()
    small_bench.write_text(bench.replace("seed = 1", "seed = 2"))
    refuse(lambda: execute(small_bench, out), str(out), "overwrite=True")
    assert (out / "table.csv").read_text() == before
    with monkeypatch.context() as patch, pytest.raises(ZeroDivisionError):
        patch.setattr(runner, "write", lambda *_: 1 / 0)
        execute(small_bench, out, overwrite=True)
    execute(small_bench, out)
    assert "seed = 2" in (out / "config.toml").read_text()
    small_bench.write_text(bench)
    scene = small_bench.parent / "ball.toml"
    scene.write_text(scene.read_text().replace("seed = 3", "seed = 4"))
    assert not execute(small_bench, out, overwrite=True).tasks.cached.any()


def test_a_stranger_s_folder_is_left_alone(small_bench, tmp_path):
    file = tmp_path / "out" / "thesis.tex"
    file.parent.mkdir()
    file.write_text("mine")
    refuse(lambda: execute(small_bench, tmp_path / "out"), f"{tmp_path}/out")
    assert list(file.parent.iterdir()) == [file] and file.read_text() == "mine"


@pytest.fixture
def other(small_bench, recorded) -> Path:
    """A copy of the capture, "other", in the benchmark before it."""
    other = shutil.copytree(recorded, recorded.with_name("other"))
    text = (other / "capture.toml").read_text()
    (other / "capture.toml").write_text(text.replace('name = "ball"', 'name = "other"'))
    both = 'path = "other"\n[[capture]]\npath = "ball"'
    small_bench.write_text(small_bench.read_text().replace('path = "ball"', both))
    return other


def test_what_one_method_cannot_do_is_left_out_for_all_and_reported(
    small_bench, small_result, other, tmp_path, capsys
):
    echoes = load_capture(other / "echoes.h5")
    two = {"samples": echoes.samples[:, -2:], "frequencies_hz": echoes.frequencies_hz[-2:]}
    save_capture(other / "echoes.h5", replace(echoes, **two))  # enough for 2-FSK alone
    result = execute(small_bench, tmp_path / "out")
    [failure] = result.about.failures
    what = failure.capture, failure.method, failure.stage
    assert what == ("other", "narrowband", "reconstruct")
    assert failure.line in capsys.readouterr().err.splitlines()
    assert main(["run", str(small_bench), "-o", str(tmp_path / "out")]) == 1
    assert "other narrowband" in capsys.readouterr().err.splitlines()[-1]
    assert result.about.protocol["basis"].startswith("1 of 2 captures")
    assert figures(tmp_path / "out") == figures(small_result)
    assert {c.name for c in result.about.captures} == set(result.repeats.capture) == {"ball"}


def test_a_broken_capture_does_not_sink_the_run(small_bench, small_result, other, tmp_path):
    (other / "echoes.h5").write_bytes((other / "echoes.h5").read_bytes()[:5000])
    failures = execute(small_bench, tmp_path / "out").about.failures
    assert {f.method for f in failures} == {"2fsk", "narrowband"}
    assert figures(tmp_path / "out") == figures(small_result)
    (other / "capture.toml").unlink()
    failures = execute(small_bench, tmp_path / "out").about.failures
    assert [(f.capture, f.stage) for f in failures] == [("other", "open")]
    (other.parent / "ball" / "capture.toml").unlink()
    refuse(lambda: execute(small_bench, tmp_path / "out"), "the first", "other")


def test_a_mesh_in_the_photo_frame_scores_as_the_truth_does(
    small_bench, small_result, recorded, tmp_path
):
    """And as the simulated capture does; without any surface there is nothing to score."""
    matrix = np.eye(4)
    matrix[:3, :3] = Rotation.from_rotvec([0.3, -0.2, 0.5]).as_matrix()
    matrix[:3, 3] = 0.1, 0.2, 0.5
    radar_from_photo, file = Transform("photo", "radar", matrix), recorded / "radar_from_photo.json"
    surface = read_mesh(recorded / "truth.ply")
    write_mesh(recorded / "mesh.ply", surface.transform(radar_from_photo.inverse().matrix))
    radar_from_photo.save(file)
    result, simulated = execute(small_bench, tmp_path / "out"), load(small_result)
    mesh, truth = (result.row("mae_mm", "2fsk", r).value for r in ("photogrammetry", "truth"))
    assert truth == simulated.row("mae_mm", "2fsk", "truth").value
    assert mesh == pytest.approx(truth, abs=1e-3)  # stored in float32: 1e-7 of 0.5 m
    radar_from_photo.inverse().save(file)
    refuse(open_capture(recorded).transform, file.name, "'radar'", "'photo'")
    for name in ("truth.ply", "mesh.ply", file.name):
        (recorded / name).unlink()
    about = recorded / "capture.toml"
    about.write_text(about.read_text().replace('"truth.ply", ', ""))
    refuse(lambda: execute(small_bench, tmp_path / "none"), str(recorded))
