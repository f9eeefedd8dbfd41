"""Imaging on a CUDA device: its tests, times, errors, and where a frame's time goes.

The echoes are those of a bumpy surface at 0.28 m; grid, tones and array are the paper's. Times are
between CUDA events, copies to and from the device included. --device cpu and --device numpy
measure the same on the processor, numpy in CuPy's place.

python -m tests.radar.imaging.measure_gpu [--device cuda|cpu|numpy] [--repeats 10] [-o DIR]
"""

from __future__ import annotations

import argparse
import os
import statistics
import subprocess
import sys
import time
from collections import defaultdict
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from dataclasses import dataclass, field
from functools import cached_property, partial
from pathlib import Path
from typing import Any
from unittest.mock import patch
from xml.etree import ElementTree

import numpy as np

from handbench.bench.evaluation.tables import Column
from handbench.bench.studies.engine.turns import named
from handbench.bench.studies.study import Record, Study, Table, measured, relative_error
from handbench.radar.data.capture import RadarCapture
from handbench.radar.data.grid import Axis, VoxelGrid
from handbench.radar.imaging import api
from handbench.radar.imaging.api import image_volume, project_volume
from handbench.radar.imaging.device import array_module, current_device, use_device
from handbench.radar.imaging.gpu import executor
from handbench.radar.imaging.plan import fresh_plans
from handbench.radar.methods.depth_uncertainty import Uncertainty, fsk_with_uncertainty
from handbench.radar.methods.fsk_config import ThreeToneConfig
from handbench.radar.methods.projection_config import BroadbandConfig
from handbench.support.errors import HandbenchError
from tests.radar.direct_sums import direct_sum
from tests.radar.samples import noise
from tests.radar.simulated_points import bumpy, points_capture, surface_points

SUITES = {  # tests that image on the current device
    "imaging": ["tests/radar/imaging"],
    "methods": ["tests/radar/methods"],
    "hard cases": [f"tests/hard_cases/test_{g}_cases.py" for g in ("phase", "data", "geometry")],
    "MAROON's kernels": ["tests/bench/datasets/test_maroon_kernels.py"],
}
SUITE_S = 150.0  # after which a suite is ended and fails
TESTS = (
    Column("suite", str, "tests that image on the device", heading="tests"),
    Column("passed", int, "of them that pass; none fails", heading="passed", form="{}"),
    Column("skipped", int, "of them that are skipped", heading="skipped", form="{}"),
    Column("minutes", float, "that they take", heading="min"),
)
FIRST = "the first call: with the plan and, once per machine, the compilation"
PLAN = "the first call with an empty cache of plans, compiled before, over the median of the others"
WHOLE = "of the exact sum of the whole volume, from the part's"
ERROR = "relative L2 error at random voxels, against a direct sum in float64 on the processor"
COLUMNS = (
    Column("what", str, "what is imaged, to which tolerance", heading="imaging"),
    Column("first_ms", float, FIRST, heading="first ms", form="{:,.0f}"),
    Column("plan_ms", float, PLAN, heading="plan ms", form="{:,.0f}"),
    Column("ms", float, "median of the calls that follow", heading="ms"),
    Column("per_s", float, "such images or frames per second", heading="per s"),
    Column("whole_volume_ms", float, WHOLE, heading="whole volume ms", form="{:,.0f}"),
    Column("error", float, ERROR, heading="error", form="{:.1e}"),
    Column("noise_error", float, f"{ERROR}, of white noise", heading="on noise", form="{:.1e}"),
    Column(
        "depth_um",
        float,
        "root mean square deviation of a frame's depths from those of the processor's exact sum",
        heading="Δz µm",
    ),
)
PARTS = {  # of a frame's time
    "up": "copies to the device",
    "device": "code on the device: the calls of its kernels, and these, by CUDA events",
    "down": "copies from the device",
    "uncertainty": "σ and flags of a depth map, on the processor",
    "rest": "all else on the processor",
}
SPENT = (
    COLUMNS[0],
    *(
        Column(f"{part}_ms", float, meaning, heading=f"{part} ms")
        for part, meaning in PARTS.items()
    ),
    *(
        Column(f"{way}_mb", float, f"{PARTS[way]}, megabytes", heading=f"{way} MB")
        for way in ("up", "down")
    ),
    Column("copies", int, "number of copies, in both directions", heading="copies"),
)


@dataclass(frozen=True)
class Imaging:
    """What is imaged. part: x and y of the exact sum's part of the volume; tolerances: of volumes
    and their projections; checked: number of random voxels whose error is measured."""

    repeats: int
    volume: BroadbandConfig = field(default_factory=BroadbandConfig)
    frame: ThreeToneConfig = field(default_factory=ThreeToneConfig)
    part: Axis = Axis(start_m=-0.01, stop_m=0.01, step_m=0.001)  # noqa: RUF009
    tolerances: tuple[float, ...] = (1e-2, 1e-3, 1e-4, 1e-5)
    checked: int = 1000

    def cases(self) -> dict[str, Callable[[], Record]]:
        """What is measured, by its name in the tables."""
        volumes = {"volume": self._volume, "projection": self._projection}
        return {
            "exact sum of a part": self._part,
            **{
                named(name, tolerance): partial(measure, tolerance)
                for tolerance in self.tolerances
                for name, measure in volumes.items()
            },
            "3-FSK frame, exact": partial(self._frame, None),
            **{named("3-FSK frame", t): partial(self._frame, t) for t in (1e-3, 1e-5)},
        }

    @cached_property
    def wide(self) -> tuple[Any, ...]:
        """Samples [f, t, r] of the volume's tones, these, and the array."""
        return _first_frame(points_capture(_surface_m(), self.volume.tones_hz()))

    @cached_property
    def white(self) -> tuple[Any, ...]:
        """The same of white noise."""
        return noise(self.wide[0].shape), *self.wide[1:]

    @cached_property
    def tones(self) -> RadarCapture:
        """A frame at the tones of 3-FSK."""
        return points_capture(_surface_m(), self.frame.ladder_hz)

    @cached_property
    def exact_z_m(self) -> np.ndarray:
        """The depths of that frame by the processor's exact sum [ny, nx]."""
        exact = self.frame.model_copy(update={"tolerance": None})
        with use_device("cpu"):
            return fsk_with_uncertainty(self.tones, exact).z_m

    def _part(self) -> Record:
        grid = self.volume.model_copy(update={"x": self.part, "y": self.part}).grid()
        record = self._volume(None, grid)
        share = np.prod(grid.shape) / np.prod(self.volume.grid().shape)
        return record | {"per_s": None, "whole_volume_ms": record["ms"] / float(share)}

    def _volume(self, tolerance: float | None, grid: VoxelGrid | None = None) -> Record:
        grid = grid or self.volume.grid()
        volume, record = timed(
            lambda: image_volume(*self.wide, grid, tolerance), self.repeats if tolerance else 1
        )
        white = image_volume(*self.white, grid, tolerance)
        voxels = self._random(volume.size)
        points_m = grid.points_at_m(voxels)
        return record | {
            "error": relative_error(volume.ravel()[voxels], direct_sum(*self.wide, points_m)),
            "noise_error": relative_error(white.ravel()[voxels], direct_sum(*self.white, points_m)),
        }

    def _projection(self, tolerance: float) -> Record:
        grid = self.volume.grid()
        peaks, record = timed(lambda: project_volume(*self.wide, grid, tolerance), self.repeats)
        pixels = self._random(peaks.index.size)
        points_m = grid.points_at_m(peaks.index.ravel()[pixels] * peaks.index.size + pixels)
        exact = np.abs(direct_sum(*self.wide, points_m))
        return record | {"error": relative_error(peaks.magnitude[1].ravel()[pixels], exact)}

    def _frame(self, tolerance: float | None) -> Record:
        config = self.frame.model_copy(update={"tolerance": tolerance})
        depth, record = timed(lambda: fsk_with_uncertainty(self.tones, config), self.repeats)
        plane = VoxelGrid(depth.x_m, depth.y_m, np.array([config.first_depth_m]))
        frame = _first_frame(self.tones)
        images = image_volume(*frame, plane, tolerance, apart=True).reshape(len(frame[0]), -1)
        pixels = self._random(images.shape[1])
        exact = direct_sum(*frame, plane.points_at_m(pixels), apart=True)
        off_m = (depth.z_m - self.exact_z_m)[np.isfinite(self.exact_z_m)]
        return record | {
            "error": relative_error(images[:, pixels], exact),
            "depth_um": 1e6 * float(np.sqrt(np.nanmean(off_m**2))),
        }

    def _random(self, size: int) -> np.ndarray:
        return np.random.default_rng(0).integers(0, size, self.checked)


def _surface_m() -> np.ndarray:
    return surface_points(bumpy, 0.03, 5e-4)


def _first_frame(capture: RadarCapture) -> tuple[Any, ...]:
    return capture.samples[0], capture.frequencies_hz, capture.aperture


def timed(work: Callable[[], Any], repeats: int) -> tuple[Any, Record]:
    """The value of work(), and its times: of the first call, of the plan, the median of `repeats`
    further calls, and the median of the parts of as many."""
    result, first_ms = _milliseconds(work)
    ms = statistics.median(_milliseconds(work)[1] for _ in range(repeats))
    parts = [_profile(work) for _ in range(repeats)]
    spent = {name: statistics.median(part[name] for part in parts) for name in parts[0]}
    with fresh_plans():
        _, planned_ms = _milliseconds(work)
    times = {"first_ms": first_ms, "plan_ms": max(planned_ms - ms, 0.0), "ms": ms}
    return result, {**times, "per_s": 1e3 / ms, **spent}


def _milliseconds(work: Callable[[], Any]) -> tuple[Any, float]:
    """The value of work() and its time, until the device has finished."""
    if current_device() != "cuda":
        start = time.perf_counter()
        return work(), 1e3 * (time.perf_counter() - start)
    cuda = array_module().cuda
    begin, end = cuda.Event(), cuda.Event()
    begin.record()
    result = work()
    end.record()
    end.synchronize()
    return result, float(cuda.get_elapsed_time(begin, end))


def _profile(work: Callable[[], Any]) -> Record:
    """Milliseconds of the PARTS of work(), each without the parts within it, and megabytes."""
    spent: Record = defaultdict(float)
    within_ms = [0.0]

    def watched(part: str, call: Callable[..., Any]) -> Callable[..., Any]:
        def timed(*args: Any, **options: Any) -> Any:
            within_ms.append(0.0)
            result, ms = _milliseconds(lambda: call(*args, **options))
            spent[f"{part}_ms"] += ms - within_ms.pop()
            within_ms[-1] += ms
            if part in ("up", "down"):
                spent[f"{part}_mb"] += result.nbytes / 1e6
                spent["copies"] += 1
            return result

        return timed

    with ExitStack() as stack:
        for part, owner, name in _parts():
            stack.enter_context(patch.object(owner, name, watched(part, getattr(owner, name))))
        watched("rest", work)()
    return {column.name: spent[column.name] for column in SPENT[1:]}


def _parts() -> Iterator[tuple[str, Any, str]]:
    """The functions whose calls make up a part: (part, owner, name)."""
    yield "uncertainty", Uncertainty, "add"
    yield "uncertainty", Uncertainty, "added_to"
    yield "device", executor, "exact_images"
    yield "device", executor.GpuExecutor, "image"
    yield "device", executor.GpuUpsampler, "volume"
    yield "device", executor.GpuUpsampler, "project"
    if current_device() == "cuda":
        yield "up", array_module(), "asarray"
        yield "down", executor, "to_host"
        yield "down", api, "to_host"


def run_tests(suite: str, work: Path) -> Record:
    """Run a suite of tests on the current device, without the plug-ins of this interpreter, and
    with its libraries' warnings as warnings: their versions are not the pinned ones. Raises
    HandbenchError if a test fails."""
    work.mkdir(parents=True, exist_ok=True)
    file = work / f"{suite.replace(' ', '_')}.xml"
    file.unlink(missing_ok=True)
    options = ["-p", "no:cacheprovider", "-W", "default", "--durations=5", f"--junitxml={file}"]
    command = [sys.executable, "-m", "pytest", *options, *SUITES[suite]]
    environment = {**os.environ, "PYTEST_DISABLE_PLUGIN_AUTOLOAD": "1"}
    subprocess.run(command, env=environment, stdout=sys.stderr, check=False, timeout=SUITE_S)
    if not file.is_file():
        raise HandbenchError(f"{suite}: pytest did not end; its messages are above")
    [counts] = ElementTree.parse(file).getroot()
    total, skipped, *broken = (
        int(counts.attrib[n]) for n in ("tests", "skipped", "failures", "errors")
    )
    if sum(broken) or not total:
        raise HandbenchError(
            f"{suite}: {sum(broken)} of {total} tests fail; their messages are above"
        )
    minutes = float(counts.attrib["time"]) / 60
    return {"suite": suite, "passed": total - skipped, "skipped": skipped, "minutes": minutes}


def study(work: Path, device: str, repeats: int) -> Study:
    """The tests and the imaging, each a case."""
    imaging = Imaging(max(repeats, 1)).cases()

    def measure(case: str) -> Record:
        return run_tests(case, work) if case in SUITES else {"what": case, **imaging[case]()}

    return Study("gpu", [*imaging, *SUITES], measure, tables)


def tables(records: list[Record]) -> list[Table]:
    """The images' times and errors, where the time goes, and the tests."""
    images, suites = ([r for r in records if name in r] for name in ("what", "suite"))
    return [
        Table("rows", COLUMNS, images),
        Table("spent", SPENT, images),
        Table("tests", TESTS, suites),
    ]


def main() -> None:
    """Run the tests, time, write the files of a study, print the tables."""
    prog, purpose = "python -m tests.radar.imaging.measure_gpu", (__doc__ or "").partition("\n")[0]
    parser = argparse.ArgumentParser(prog=prog, description=purpose)
    parser.add_argument(
        "--device", choices=("cuda", "cpu", "numpy"), default="cuda", help="default cuda"
    )
    parser.add_argument(
        "--repeats", type=int, default=10, help="timings after the first (default 10)"
    )
    measured(parser, study, "gpu")


if __name__ == "__main__":
    main()
