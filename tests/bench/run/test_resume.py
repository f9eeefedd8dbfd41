"""A run that was killed after one of its stages goes on there."""

import shutil
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from handbench.bench.run import engine
from handbench.bench.stages.calibrate import REGISTRATION
from handbench.calibration.transforms import Transform
from handbench.groundtruth.pipeline import CLOUD, MESH, VIEW
from tests.bench.run.faults import execute, figures, stand_in


@pytest.fixture
def photographed(recorded, small_bench, undoubted, monkeypatch) -> Path:
    """The benchmark of a capture with a photograph, and of that as a target. What they would give
    is written at once."""
    (recorded / "photos").mkdir()
    Image.new("RGB", (40, 30)).save(recorded / "photos" / "a.jpg")
    target = shutil.copytree(recorded, recorded.with_name("target")) / "capture.toml"
    target.write_text(target.read_text().replace('name = "ball"', 'name = "target"'))
    more = '[[calibration]]\npath = "target"\n[[method]]'
    small_bench.write_text(small_bench.read_text().replace("[[method]]", more, 1))
    monkeypatch.setenv("HANDBENCH_WORKERS", "1")  # other processes would do the real work

    def sparse(folder, photos, options):
        (folder / "images.txt").write_text(photos)

    def dense(folder, photos, options, sparse):
        shutil.copyfile(Path(sparse) / "images.txt", folder / CLOUD)

    def mesh(folder, photos, options, sparse, dense):
        assert (Path(dense) / CLOUD).is_file()
        shutil.copyfile(recorded / "truth.ply", folder / MESH)
        shutil.copyfile(Path(photos) / "a.jpg", folder / VIEW)

    def calibrate(folder, captures, clouds):
        assert all(Path(cloud).is_file() for cloud in clouds)
        registration = Transform("photo", "radar", np.eye(4), 1e-10 * np.eye(6), (1e-5,))
        registration.save(folder / REGISTRATION)

    stand_in(monkeypatch, "groundtruth.pipeline.find_cameras", sparse)
    stand_in(monkeypatch, "groundtruth.pipeline.fuse_points", dense)
    stand_in(monkeypatch, "groundtruth.pipeline.make_mesh", mesh)
    stand_in(monkeypatch, "bench.run.runner.calibrate", calibrate)
    return small_bench


def test_a_run_killed_after_a_stage_goes_on_there(
    photographed, small_result, monkeypatch, tmp_path
):
    cached, out = engine.cached, tmp_path / "out"

    def end(root, stage):
        made = cached(root, stage)
        if stage.name == "dense":
            raise KeyboardInterrupt
        return made

    with monkeypatch.context() as patch, pytest.raises(KeyboardInterrupt):
        patch.setattr(engine, "cached", end)
        execute(photographed, out)
    assert not (out / "result.json").exists()
    (out / "work" / ".reconstruct-abc-half").mkdir()  # what a kill inside a stage leaves behind
    kept = execute(photographed, out).tasks.groupby("stage").cached.agg(list)
    new = {"mesh": [False], "calibrate": [False], "repeat": [False], "score": [False]}
    assert kept.to_dict() == {
        "inspect": [True],
        "sparse": [True, False],  # of the target, then of the capture
        "dense": [True, False],
        "reconstruct": [False, False],
        **new,
    }
    of_truth = [line for line in figures(small_result) if line.endswith(",truth")]
    assert set(of_truth) <= set(figures(out))
