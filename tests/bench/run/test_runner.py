"""The runner: complete result folders, resumed after a kill, never mixed and never stale."""

import csv
import json
import os
import re
import shutil
import signal
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from handbench.bench import results
from handbench.bench.run.benchmark_file import load_benchmark
from handbench.bench.run.runner import run
from handbench.calibration.transforms import Transform
from handbench.groundtruth.mesh.mesh_files import read_mesh, write_mesh
from handbench.radar.data.echoes_file import load_capture, save_capture
from handbench.support.errors import HandbenchError
from handbench.support.folder import locked
from tests.faults.processes import Runs


def execute(bench_file: Path, folder: Path, **options: bool) -> results.Result:
    bench, base = load_benchmark(str(bench_file))
    return run(bench, base, folder, **options)


def figures(folder: Path) -> list[str]:
    """The table without its times."""
    return [
        line
        for line in (folder / "table.csv").read_text().splitlines()
        if not line.startswith("seconds")
    ]


def test_result_folder_is_complete_and_plausible(small_result):
    result = results.load(small_result)
    mae = result.table[result.table.metric == "mae_mm"].set_index("method").value
    assert set(mae.index) == {"2fsk", "narrowband"}
    assert 0 < mae["2fsk"] < 10  # σ_z is 3.6 mm at the strongest pixel and 11 mm at the threshold
    assert result.row("precision_mm", "2fsk", "truth").value > 0
    assert result.row("precision_mm", "narrowband", "truth") is None
    assert len(result.repeats) == 3
    assert set(result.tasks.stage) == {"simulate", "inspect", "reconstruct", "repeat", "score"}
    assert (result.tasks[["seconds", "peak_memory_mb"]] > 0).all(
        axis=None
    ) and not result.tasks.cached.any()
    by_amplitude = (
        result.causes[result.causes.cause == "below_maximum_db"].groupby("method").n_pixels.sum()
    )
    observed = result.table[result.table.metric == "n_observed"].set_index("method").value
    assert by_amplitude.to_dict() == observed.to_dict() and (result.causes.n_captures == 1).all()
    assert set(result.reliability.method) == {"2fsk"}  # a projection tells no σ


def test_second_run_is_cached_and_gives_the_same_table(small_bench, small_result, tmp_path):
    shutil.copytree(small_result, tmp_path / "out")
    before = (tmp_path / "out" / "table.csv").read_text()
    again = execute(small_bench, tmp_path / "out")
    assert again.tasks.cached.all()
    assert (tmp_path / "out" / "table.csv").read_text() == before


def test_a_changed_input_is_never_taken_from_the_cache(small_bench, small_result, tmp_path):
    shutil.copytree(small_result, tmp_path / "out")
    scene = small_bench.parent / "ball.toml"
    scene.write_text(scene.read_text().replace("seed = 3", "seed = 4"))
    again = execute(small_bench, tmp_path / "out")
    assert not again.tasks.cached.any()


def test_another_configuration_is_refused_unless_asked_for(small_bench, small_result, tmp_path):
    shutil.copytree(small_result, tmp_path / "out")
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
    with locked(tmp_path / "out"), pytest.raises(HandbenchError, match="another run"):
        execute(small_bench, tmp_path / "out")


def content(folder: Path) -> dict[str, bytes]:
    """Every file of a result folder, those of its stages too, without times: the rows and columns
    that hold them, the machine's rate, and whether a stage was cached."""
    times = {
        "table.csv": rb"(?m)^seconds,.*$",
        "scores.csv": rb"(?m)^.*,seconds,.*$",
        "result.json": rb'"(gemm_gflops|seconds)":.*',
        "capture.toml": rb"(?m)^seconds = .*$",
        "stage.json": rb"(?s).*",
        "timing.json": rb"(?s).*",
        "tasks.csv": rb"[0-9.]+,[0-9.]+,[0-9.]+,.*",
        "manifest.json": rb"(?s).*",  # the checksums of these too
    }
    files = [path for path in folder.rglob("*") if path.is_file()]
    return {
        str(path.relative_to(folder)): re.sub(times[path.name], b"", path.read_bytes())
        if path.name in times
        else path.read_bytes()
        for path in files
    }


@pytest.mark.slow
def test_a_killed_run_resumes_to_the_same_folder(small_bench, tmp_path):
    """Killed once the first stage is done; HANDBENCH_KILLS=10 adds as many runs, killed at random
    moments. Each run is a process of its own, forked from one that has imported what it needs."""
    runs = Runs(small_bench, tmp_path, photographs=False)
    assert runs.run(tmp_path / "whole")[0] == 0
    whole_s, expected = runs.seconds, content(tmp_path / "whole")

    def killed_and_resumed(out: Path, wait: Callable[[], None]) -> bool:
        process = runs.started(out)
        wait()
        os.kill(process, signal.SIGKILL)
        killed = (
            int(runs.forks.stdout.readline()) == -signal.SIGKILL
            and not (out / "result.json").exists()
        )
        if killed and (out / "work").exists():
            (
                out / "work" / ".reconstruct-abc-half"
            ).mkdir()  # what a kill inside a stage leaves behind
        assert runs.run(out)[0] == 0
        assert content(out) == expected
        return killed

    def first_stage() -> None:
        deadline = time.monotonic() + 600  # a hang
        while (
            not list((tmp_path / "first" / "work").glob("simulate-*"))
            and time.monotonic() < deadline
        ):
            time.sleep(0.01)

    assert killed_and_resumed(tmp_path / "first", first_stage)
    assert results.load(tmp_path / "first").tasks.cached[0]
    moments_s = (
        np.random.default_rng(0).uniform(0.3, 0.85, int(os.environ.get("HANDBENCH_KILLS", "0")))
        * whole_s
    )
    killed = [
        killed_and_resumed(tmp_path / f"{m:.3f}", lambda m=m: time.sleep(m)) for m in moments_s
    ]
    print(
        f"{sum(killed)} of {len(killed)} runs had not ended when they were killed, after "
        f"{moments_s.round(2)} s"
    )
    runs.end()


@pytest.fixture
def recorded(small_bench, small_result, tmp_path) -> Path:
    """The benchmark's capture as a folder, "ball"."""
    shutil.copytree(small_result, tmp_path / "simulated")
    folder = small_bench.parent / "ball"
    shutil.copytree(next((tmp_path / "simulated" / "work").glob("simulate-*")) / "capture", folder)
    return folder


def with_another(small_bench: Path, recorded: Path, frequencies: int) -> None:
    """Benchmark both the recorded capture and a copy, "other", that keeps its highest
    frequencies."""
    other = recorded.parent / "other"
    shutil.copytree(recorded, other)
    description = (other / "capture.toml").read_text()
    (other / "capture.toml").write_text(description.replace('name = "ball"', 'name = "other"'))
    echoes = load_capture(recorded / "echoes.h5")
    kept = slice(-frequencies, None)
    echoes = replace(
        echoes, samples=echoes.samples[:, kept], frequencies_hz=echoes.frequencies_hz[kept]
    )
    save_capture(other / "echoes.h5", echoes)
    both = 'path = "other"\n[[capture]]\npath = "ball"'
    small_bench.write_text(small_bench.read_text().replace('scene = "ball.toml"', both))


def test_what_one_method_cannot_do_is_left_out_for_all_and_said(
    small_bench, recorded, tmp_path, capsys, monkeypatch
):
    monkeypatch.setattr(
        "handbench.bench.validation.capture_warnings.warnings_of_capture", lambda recorded: iter(())
    )  # takes long with two tones
    with_another(small_bench, recorded, frequencies=2)  # enough for 2-FSK alone
    result = execute(small_bench, tmp_path / "out")
    [failure] = result.about.failures
    assert (failure.capture, failure.method, failure.stage) == (
        "other",
        "narrowband",
        "reconstruct",
    )
    assert failure.line in capsys.readouterr().err.splitlines()
    assert result.about.protocol["basis"].startswith("1 of 2 captures")
    assert figures(tmp_path / "out") == figures(tmp_path / "simulated")
    assert [c.name for c in result.about.captures] == ["ball"] and set(result.repeats.capture) == {
        "ball"
    }
    assert set(result.tasks.capture) == {"ball", "other"}


def test_a_broken_capture_does_not_sink_the_run(small_bench, recorded, tmp_path):
    with_another(small_bench, recorded, frequencies=3)
    broken = recorded.parent / "other"
    (broken / "echoes.h5").write_bytes((recorded / "echoes.h5").read_bytes()[:5000])
    assert {f.method for f in execute(small_bench, tmp_path / "echoes").about.failures} == {
        "2fsk",
        "narrowband",
    }
    (broken / "capture.toml").unlink()
    result = execute(small_bench, tmp_path / "description")
    assert [(f.capture, f.stage) for f in result.about.failures] == [("other", "open")]
    for name in ("echoes", "description"):
        assert figures(tmp_path / name) == figures(tmp_path / "simulated")
    (recorded / "truth.ply").unlink()
    with pytest.raises(HandbenchError, match=r"every capture failed; the first: .*other"):
        execute(small_bench, tmp_path / "none")


def test_captures_as_folders_score_as_simulated_ones(small_bench, small_result, tmp_path):
    shutil.copytree(small_result, tmp_path / "out")
    capture = next((tmp_path / "out" / "work").glob("simulate-*")) / "capture"
    shutil.copytree(capture, small_bench.parent / "recorded")
    small_bench.write_text(
        small_bench.read_text().replace('scene = "ball.toml"', 'path = "recorded"')
    )
    execute(small_bench, tmp_path / "recorded")
    assert figures(tmp_path / "recorded") == figures(tmp_path / "out")


def test_a_mesh_in_the_photo_frame_scores_as_the_truth_does(small_bench, small_result, tmp_path):
    shutil.copytree(small_result, tmp_path / "out")
    recorded = small_bench.parent / "recorded"
    shutil.copytree(next((tmp_path / "out" / "work").glob("simulate-*")) / "capture", recorded)
    matrix = np.eye(4)
    matrix[:3, :3], matrix[:3, 3] = (
        Rotation.from_rotvec([0.3, -0.2, 0.5]).as_matrix(),
        (0.1, 0.2, 0.5),
    )
    radar_from_photo = Transform("photo", "radar", matrix)
    surface = read_mesh(recorded / "truth.ply")
    write_mesh(recorded / "mesh.ply", surface.transform(radar_from_photo.inverse().matrix))
    radar_from_photo.save(recorded / "radar_from_photo.json")
    small_bench.write_text(
        small_bench.read_text().replace('scene = "ball.toml"', 'path = "recorded"')
    )
    result = execute(small_bench, tmp_path / "recorded")
    for method in ("2fsk", "narrowband"):
        values = [result.row("mae_mm", method, r).value for r in ("photogrammetry", "truth")]
        assert values[0] == pytest.approx(
            values[1], abs=1e-3
        )  # the mesh is stored in float32: 1e-7 of 0.5 m
    radar_from_photo.inverse().save(recorded / "radar_from_photo.json")
    with pytest.raises(HandbenchError, match="leads from 'radar' to 'photo'"):
        execute(small_bench, tmp_path / "inverted")


def test_a_capture_without_any_reference_is_an_error(small_bench, small_result, tmp_path):
    shutil.copytree(small_result, tmp_path / "out")
    capture = next((tmp_path / "out" / "work").glob("simulate-*")) / "capture"
    recorded = small_bench.parent / "recorded"
    shutil.copytree(capture, recorded)
    (recorded / "truth.ply").unlink()
    description = (recorded / "capture.toml").read_text()
    (recorded / "capture.toml").write_text(description.replace('"truth.ply", ', ""))
    small_bench.write_text(
        small_bench.read_text().replace('scene = "ball.toml"', 'path = "recorded"')
    )
    with pytest.raises(HandbenchError, match="nothing to score against"):
        execute(small_bench, tmp_path / "recorded")


def test_paths_do_not_leave_the_benchmark_s_folder(small_bench, tmp_path):
    small_bench.write_text(small_bench.read_text().replace('"ball.toml"', '"../../etc/passwd"'))
    with pytest.raises(HandbenchError, match="leaves the folder"):
        execute(small_bench, tmp_path / "out")


def test_result_json_says_how_it_came_about(small_result, tmp_path):
    shutil.copytree(small_result, tmp_path / "out")
    about = json.loads((tmp_path / "out" / "result.json").read_text())
    assert about["protocol"]["id"] == "paper"
    assert about["inputs"].keys() == {"ball"}
    assert "numpy" in about["versions"]
    assert about["machine"]["cores"] >= 1
    assert about["machine"]["imaging_device"] == "cpu"
    assert about["machine"]["gemm_gflops"] > 0
    assert about["metrics"]["mae_mm"]["definition"]
    assert about["failures"] == [] and about["protocol"]["basis"].startswith("1 of 1 captures")
    with (tmp_path / "out" / "tasks.csv").open() as stream:
        assert {(t["host"], float(t["gemm_gflops"])) for t in csv.DictReader(stream)} == {
            (about["machine"]["host"], about["machine"]["gemm_gflops"])
        }


def test_results_of_before_failures_and_machines_are_read(small_result, tmp_path):
    shutil.copytree(small_result, tmp_path / "out")
    about, tasks = tmp_path / "out" / "result.json", tmp_path / "out" / "tasks.csv"
    about.write_text(
        json.dumps({k: v for k, v in json.loads(about.read_text()).items() if k != "failures"})
    )
    tasks.write_text(
        "".join(f"{line.rsplit(',', 5)[0]}\n" for line in tasks.read_text().splitlines())
    )
    result = results.load(tmp_path / "out")
    assert (
        result.about.failures == ()
        and np.isnan(result.tasks.gemm_gflops[0])
        and result.tasks.seconds[0] > 0
    )
    tasks.write_text(
        "".join(f"{line.rsplit(',', 1)[0]}\n" for line in tasks.read_text().splitlines())
    )
    with pytest.raises(HandbenchError, match="the columns are"):
        results.load(tmp_path / "out")
