"""A run killed after any of its stages goes on there; an edit of the code shows in the next run."""

import csv
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from tests.bench.run.faults import figures
from tests.bench.run.photographed import with_photographs
from tests.faults.processes import Runs
from tests.installed_copy import copy_package

STAGES = (
    *("simulate", "inspect", "sparse", "dense", "mesh", "calibrate"),
    *("reconstruct", "repeat", "score"),
)


KILLED = ("simulate", "dense", "reconstruct", "score")  # all before the last are then kept


def tasks(out: Path) -> dict[str, list[bool]]:
    """Whether each of a stage's tasks was cached, in the order of the run."""
    found: dict[str, list[bool]] = {}
    with (out / "tasks.csv").open() as stream:
        for task in csv.DictReader(stream):
            found.setdefault(task["stage"], []).append(task["cached"] == "1")
    return found


@pytest.mark.slow
def test_a_run_killed_after_a_stage_goes_on_there(small_bench, tmp_path):
    """One folder, killed after the first stage of some kinds in turn: no kill costs a stage that
    was done. Each run, of one method, is a process of its own, forked from one that has imported
    what it needs."""
    first, *_ = small_bench.read_text().partition('[[method]]\nid = "narrowband"')
    small_bench.write_text(first)
    photographed = Runs(with_photographs(small_bench), tmp_path)
    out, made = tmp_path / "out", set()
    for last in KILLED:
        assert photographed.run(out, last)[0] == 9
        folders = {
            path.name: path.stat().st_ino
            for path in (out / "work").iterdir()
            if path.name[0] != "."
        }
        assert made <= set(folders.items()) and any(name.startswith(f"{last}-") for name in folders)
        made = set(folders.items())
        assert not (out / "result.json").exists()
    (out / "work" / ".reconstruct-abc-half").mkdir()  # what a kill inside a stage leaves behind
    assert photographed.run(out)[0] == 0
    found = tasks(out)
    assert set(found) == set(STAGES)
    assert all(found[stage][0] for stage in STAGES)  # done before it was killed
    assert (
        found["sparse"] == [True] * 2 and found["dense"] == [True] * 2
    )  # of the target, then of the capture
    assert photographed.run(tmp_path / "whole")[0] == 0
    photographed.end()
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
