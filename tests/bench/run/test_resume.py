"""A run killed after any of its stages goes on there; an edit of the code makes again what it must,
and no more."""

import csv
import os
import subprocess
import sys
from pathlib import Path

import pytest

from tests.bench.run.faults import figures
from tests.bench.run.photographed import RUN, with_photographs
from tests.installed_copy import copy_package

ROOT = Path(__file__).parents[3]
STAGES = {
    *("simulate", "inspect", "sparse", "dense", "mesh", "calibrate"),
    *("reconstruct", "repeat", "score"),
}


@pytest.fixture
def photographed(small_bench) -> Path:
    """The small benchmark with one method and with photographs."""
    first, *_ = small_bench.read_text().partition('[[method]]\nid = "narrowband"')
    small_bench.write_text(first)
    return with_photographs(small_bench)


def execute(bench: Path, out: Path, last: str = "never", code: Path = ROOT) -> int:
    """Run in a process of its own, killed after the first stage named `last`; return its exit code.
    code: folder from which handbench is imported."""
    words = [sys.executable, "-c", RUN, str(bench), str(out), last]
    environment = {**os.environ, "PYTHONPATH": str(code), "HANDBENCH_WORKERS": "1"}
    return subprocess.run(words, cwd=code, env=environment, capture_output=True).returncode


def tasks(out: Path) -> dict[str, list[bool]]:
    """Whether each of a stage's tasks was cached, in the order of the run."""
    found: dict[str, list[bool]] = {}
    with (out / "tasks.csv").open() as stream:
        for task in csv.DictReader(stream):
            found.setdefault(task["stage"], []).append(task["cached"] == "1")
    return found


@pytest.mark.slow
def test_a_run_killed_after_a_stage_goes_on_there(photographed, tmp_path):
    """The killed run, the one that goes on and an undisturbed one are processes."""
    out = tmp_path / "out"
    assert execute(photographed, out, "dense") == 9
    assert not (out / "result.json").exists()
    (out / "work" / ".reconstruct-abc-half").mkdir()  # what a kill inside a stage leaves behind
    assert execute(photographed, out) == 0
    assert execute(photographed, tmp_path / "whole") == 0
    found = tasks(out)
    assert set(found) == STAGES
    assert all(found["simulate"]) and all(found["sparse"])
    assert found["dense"] == [True, False]  # of the target, then of the capture
    assert figures(out) == figures(tmp_path / "whole")


TWICE = """
_single = deviation_map


def deviation_map(x_m, y_m, z_m):
    found = _single(x_m, y_m, z_m)
    return type(found)(x_m, y_m, 2 * found.error_m, found.reference_z_m)
"""
IMAGING = {"inspect", "reconstruct", "repeat", "score"}
EDITS = {  # files → what is made again
    "bench/evaluation/metrics.py cli/main.py reports/page/html.py": {"score"},
    "radar/methods/fsk.py": IMAGING,
    "groundtruth/sparse/adjust.py": {"sparse", "dense", "mesh", "calibrate", "score"},
    "bench/scenes/build.py": {"simulate", *IMAGING},
}


@pytest.mark.slow
def test_an_edit_shows_in_the_next_run_and_makes_no_more_than_it_must(photographed, tmp_path):
    copied, out = copy_package(tmp_path / "code"), tmp_path / "out"
    assert execute(photographed, out, code=copied.parent) == 0
    for names, expected in EDITS.items():
        for name in names.split():
            with (copied / name).open("a") as stream:
                stream.write("# edited\n")
        assert execute(photographed, out, code=copied.parent) == 0
        made = {stage for stage, cached in tasks(out).items() if not all(cached)}
        assert made == expected, names
    before = precision(out)
    with (copied / "bench" / "evaluation" / "depth_errors.py").open("a") as stream:
        stream.write(TWICE)
    assert execute(photographed, out, code=copied.parent) == 0
    assert precision(out) == pytest.approx(2 * before, rel=1e-9)


def precision(out: Path) -> float:
    """The precision of the pixels, as table.csv has it."""
    with (out / "table.csv").open() as stream:
        rows = [row for row in csv.DictReader(stream) if row["metric"] == "pixel_precision_mm"]
    return float(rows[0]["value"])
