"""Runs of a benchmark with photographs that take no photogrammetry, killed after any stage if need
be."""

from __future__ import annotations

import shutil
from pathlib import Path

from PIL import Image

from handbench.bench.datasets.simulated import simulate_capture
from handbench.bench.scenes.build import load_scene

# Photographs and their registration stand for themselves: what they would give is written at once.
# os._exit is a kill.
RUN = """
import os, shutil, sys
from pathlib import Path
import numpy as np
from handbench.cli.main import main
from handbench.bench.run import engine, runner
from handbench.bench.stages import calibrate as calibration
from handbench.bench.stages import reconstruct
from handbench.calibration.transforms import Transform
from handbench.groundtruth import pipeline
from handbench.support.store import DECLARED

bench, out, last = Path(sys.argv[1]), sys.argv[2], sys.argv[3]
exact = np.diag([1e-5] * 6) ** 2

def sparse(folder, photos, options):
    (folder / "images.txt").write_text(photos)

def dense(folder, photos, options, sparse):
    assert (Path(sparse) / "images.txt").is_file()
    (folder / pipeline.CLOUD).write_text("points")

def mesh(folder, photos, options, sparse, dense):
    assert (Path(dense) / pipeline.CLOUD).is_file()
    shutil.copyfile(bench.parent / "recorded" / "truth.ply", folder / pipeline.MESH)
    shutil.copyfile(next(Path(photos).iterdir()), folder / pipeline.VIEW)

def calibrate(folder, captures, clouds):
    assert all(Path(cloud).is_file() for cloud in clouds)
    found = Transform("photo", "radar", np.eye(4), exact, np.array([1e-5]))
    found.save(folder / calibration.REGISTRATION)

for place, name, function in (
    (pipeline, "find_cameras", sparse),
    (pipeline, "fuse_points", dense),
    (pipeline, "make_mesh", mesh),
    (runner, "calibrate", calibrate),
):
    DECLARED[function] = DECLARED[getattr(place, name)]  # whose code is the stage's
    setattr(place, name, function)
reconstruct.REPEATED_S = 0.0  # nobody reads the times
cached = engine.cached

def killed(root, stage):
    made = cached(root, stage)
    if stage.name == last:
        os._exit(9)
    return made

engine.cached = killed
sys.exit(main(["run", str(bench), "-o", out]))
"""


def with_photographs(small_bench: Path) -> Path:
    """The small benchmark with photographs too: its scene, the capture with photographs, and that
    as a target."""
    recorded = small_bench.parent / "recorded"
    simulate_capture(load_scene(small_bench.parent / "ball.toml"), recorded, frames=3)
    about = (recorded / "capture.toml").read_text()
    (recorded / "capture.toml").write_text(about.replace('name = "ball"', 'name = "recorded"'))
    (recorded / "photos").mkdir()
    Image.new("RGB", (40, 30)).save(recorded / "photos" / "a.jpg")
    shutil.copytree(recorded, small_bench.parent / "target")
    target = small_bench.parent / "target" / "capture.toml"
    target.write_text(target.read_text().replace('"recorded"', '"target"'))
    more = '[[capture]]\npath = "recorded"\n[[calibration]]\npath = "target"\n[[method]]'
    small_bench.write_text(small_bench.read_text().replace("[[method]]", more, 1))
    return small_bench
