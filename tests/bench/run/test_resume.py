"""A run killed after any of its stages goes on there; an edit of the code shows in the next run."""

import csv
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from PIL import Image

from bench.datasets.simulated import simulate_capture
from bench.scenes.build import load_scene
from radar.support.closure import PACKAGES, ROOT

STAGES = ("simulate", "inspect", "sparse", "dense", "mesh", "calibrate", "reconstruct", "repeat", "score")

# Photographs and their registration stand for themselves: what they would give is written at once. os._exit is a kill.
RUN = """
import os, shutil, sys
from pathlib import Path
import numpy as np
from bench.cli.main import main
from bench.run import calibrate_stage
from calibration.transforms import Transform
from groundtruth import dense_stage, mesh_stage, sparse_stage
from radar.support import store

bench, out, last = Path(sys.argv[1]), sys.argv[2], sys.argv[3]
exact = np.diag([1e-5] * 6) ** 2

def sparse(folder, photos, options):
    (folder / "images.txt").write_text(photos)

def dense(folder, photos, options, sparse):
    assert (Path(sparse) / "images.txt").is_file()
    (folder / dense_stage.CLOUD).write_text("points")

def mesh(folder, photos, options, sparse, dense):
    assert (Path(dense) / dense_stage.CLOUD).is_file()
    shutil.copyfile(bench.parent / "recorded" / "truth.ply", folder / mesh_stage.MESH)
    shutil.copyfile(next(Path(photos).iterdir()), folder / mesh_stage.VIEW)

def calibrate(folder, captures, clouds):
    assert all(Path(cloud).is_file() for cloud in clouds)
    Transform("photo", "radar", np.eye(4), exact, np.array([1e-5])).save(folder / calibrate_stage.REGISTRATION)

sparse_stage.make, dense_stage.make, mesh_stage.make, calibrate_stage.calibrate = sparse, dense, mesh, calibrate
keep = store.keep

def killed(folder, make):
    cached = keep(folder, make)
    if folder.name.startswith(f"{last}-"):
        os._exit(9)
    return cached

store.keep = killed
sys.exit(main(["run", str(bench), "-o", out]))
"""


@pytest.fixture
def photographed(small_bench) -> Path:
    """See `with_photographs`."""
    return with_photographs(small_bench)


def with_photographs(small_bench: Path) -> Path:
    """The small benchmark with photographs too: its scene, the capture with photographs, and that as a target."""
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


def tasks(out: Path) -> dict[str, list[bool]]:
    """Whether each of a stage's tasks was cached, in the order of the run."""
    found: dict[str, list[bool]] = {}
    with (out / "tasks.csv").open() as stream:
        for task in csv.DictReader(stream):
            found.setdefault(task["stage"], []).append(task["cached"] == "1")
    return found


def figures(folder: Path) -> list[str]:
    """The table without its times."""
    return [line for line in (folder / "table.csv").read_text().splitlines() if not line.startswith("seconds")]


def start(bench: Path, out: Path, last: str) -> int:
    command = [sys.executable, "-c", RUN, str(bench), str(out), last]
    return subprocess.run(command, capture_output=True, text=True, cwd=ROOT).returncode


@pytest.mark.slow
def test_a_run_killed_after_any_stage_goes_on_there(photographed, tmp_path):
    """One folder, killed after the first stage of each kind in turn: no kill costs a stage that was done."""
    out, made = tmp_path / "out", set()
    for last in STAGES:
        assert start(photographed, out, last) == 9
        folders = {path.name: path.stat().st_ino for path in (out / "work").iterdir() if path.name[0] != "."}
        assert made <= set(folders.items()) and any(name.startswith(f"{last}-") for name in folders)
        made = set(folders.items())
        assert not (out / "result.json").exists()
    assert start(photographed, out, "none") == 0
    found = tasks(out)
    assert set(found) == set(STAGES)
    assert all(found[stage][0] for stage in STAGES)  # those after which it was killed
    assert found["sparse"] == [True] * 2 and found["dense"] == [True] * 2  # of the target, then of the capture
    assert start(photographed, tmp_path / "whole", "none") == 0
    assert figures(out) == figures(tmp_path / "whole")


@pytest.fixture
def copied(tmp_path) -> Path:
    """The five packages, to be edited."""
    for package in PACKAGES:
        shutil.copytree(ROOT / package, tmp_path / "code" / package, ignore=shutil.ignore_patterns("__pycache__"))
    return tmp_path / "code"


@pytest.mark.slow
def test_an_edit_shows_in_the_next_run_and_makes_no_more_than_it_must(small_bench, copied, tmp_path):
    out = tmp_path / "out"

    def python(*arguments: str) -> None:
        environment = {**os.environ, "PYTHONPATH": str(copied)}
        subprocess.run([sys.executable, *arguments], check=True, capture_output=True, cwd=copied, env=environment)

    def run_copy() -> dict[str, float]:
        python("-m", "bench.cli.main", "run", str(small_bench), "-o", str(out))
        with (out / "table.csv").open() as stream:
            return {f"{r['metric']} {r['method']}": float(r["value"]) for r in csv.DictReader(stream) if r["value"]}

    python("-c", "from radar.warmup import compile_kernels; compile_kernels()")  # just compiled, they round otherwise
    before = run_copy()
    [errors] = [f for f in (copied / "bench" / "evaluation").glob("*.py") if "\ndef deviation_map(" in f.read_text()]
    code = errors.read_text()
    twice = "\n\n_single = deviation_map\n\n\ndef deviation_map(x_m, y_m, z_m):\n    found = _single(x_m, y_m, z_m)\n"
    errors.write_text(f"{code}{twice}    return type(found)(x_m, y_m, 2 * found.error_m, found.reference_z_m)\n")
    after, found = run_copy(), tasks(out)
    doubled = {key for key in before if after[key] == pytest.approx(2 * before[key], rel=1e-9) and before[key]}
    assert doubled == {"pixel_precision_mm 2fsk"}
    assert found["repeat"] == [False] and found["simulate"] == [True] and found["reconstruct"] == [True, True]
    for name in ("bench/cli/main.py", "radar/support/store.py", "reports/page/html.py"):
        (copied / name).write_text((copied / name).read_text() + "# edited\n")
    assert run_copy() == after
    assert all(all(cached) for cached in tasks(out).values())
