"""A run killed after any of its stages goes on there; an edit of the code shows in the next run."""

import csv
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from tests.bench.run.faults import figures
from tests.bench.run.photographed import RUN, with_photographs
from tests.installed_copy import copy_package

ROOT = Path(__file__).parents[3]
STAGES = (
    *("simulate", "inspect", "sparse", "dense", "mesh", "calibrate"),
    *("reconstruct", "repeat", "score"),
)


def tasks(out: Path) -> dict[str, list[bool]]:
    """Whether each of a stage's tasks was cached, in the order of the run."""
    found: dict[str, list[bool]] = {}
    with (out / "tasks.csv").open() as stream:
        for task in csv.DictReader(stream):
            found.setdefault(task["stage"], []).append(task["cached"] == "1")
    return found


@pytest.mark.slow
def test_a_run_killed_after_a_stage_goes_on_there(small_bench, tmp_path):
    """The killed run, the one that goes on and an undisturbed one are processes."""
    first, *_ = small_bench.read_text().partition('[[method]]\nid = "narrowband"')
    small_bench.write_text(first)
    bench, out = with_photographs(small_bench), tmp_path / "out"

    def exit_code(folder: Path, last: str) -> int:
        words = [sys.executable, "-c", RUN, str(bench), str(folder), last]
        return subprocess.run(words, cwd=ROOT, capture_output=True).returncode

    assert exit_code(out, "dense") == 9
    assert not (out / "result.json").exists()
    (out / "work" / ".reconstruct-abc-half").mkdir()  # what a kill inside a stage leaves behind
    assert exit_code(out, "never") == 0
    assert exit_code(tmp_path / "whole", "never") == 0
    found = tasks(out)
    assert set(found) == set(STAGES)
    assert all(found["simulate"]) and all(found["sparse"])
    assert found["dense"] == [True, False]  # of the target, then of the capture
    assert figures(out) == figures(tmp_path / "whole")


TWICE = """
_single = deviation_map


def deviation_map(x_m, y_m, z_m):
    found = _single(x_m, y_m, z_m)
    return type(found)(x_m, y_m, 2 * found.error_m, found.reference_z_m)
"""


@pytest.mark.slow
def test_an_edit_shows_in_the_next_run_and_makes_no_more_than_it_must(
    small_bench, small_result, tmp_path
):
    copied, out = copy_package(tmp_path / "code"), tmp_path / "out"
    shutil.copytree(small_result, out)
    command = [sys.executable, "-m", "handbench.cli.main", "run", str(small_bench), "-o", str(out)]
    environment = {**os.environ, "PYTHONPATH": str(copied.parent)}

    def values() -> dict[str, float]:
        with (out / "table.csv").open() as stream:
            return {
                f"{r['metric']} {r['method']}": float(r["value"])
                for r in csv.DictReader(stream)
                if r["value"]
            }

    before = values()
    with (copied / "bench" / "evaluation" / "depth_errors.py").open("a") as stream:
        stream.write(TWICE)
    for name in ("cli/main.py", "support/store.py", "reports/page/html.py"):  # of no stage
        (copied / name).write_text((copied / name).read_text() + "# edited\n")
    subprocess.run(command, check=True, capture_output=True, cwd=copied, env=environment)
    after, found = values(), tasks(out)
    key = "pixel_precision_mm 2fsk"
    assert after[key] == pytest.approx(2 * before[key], rel=1e-9)
    made = {stage for stage, cached in found.items() if not all(cached)}
    assert made == {"repeat", "score"}
