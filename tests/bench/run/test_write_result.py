"""What a run's result folder says of its reference, from mesh and transform to table: no echo is
imaged."""

from __future__ import annotations

import csv
import json
from pathlib import Path

import numpy as np
import pytest

from handbench.bench.benchmarks.benchmark_file import BenchFile, load_benchmark
from handbench.bench.datasets.native import CaptureFile, save_capture_file
from handbench.bench.results.about import MEASURES, Failure
from handbench.bench.results.maps import depth_path
from handbench.bench.run.captures import RunCapture, common_subset
from handbench.bench.run.engine import Engine
from handbench.bench.run.runner import by_pair
from handbench.bench.run.write_result import Imaged, RunOutcome, write
from handbench.bench.stages.reconstruct import DEPTH, TIMING, reconstruct
from handbench.bench.stages.score import score_capture
from handbench.calibration.transforms import Transform, identity
from handbench.groundtruth.mesh.surface import Surface
from handbench.radar.data.depthmap import DepthMap
from handbench.support.files import write_json
from handbench.support.progress import Work
from handbench.support.store import Stage

AXIS_M = np.linspace(-0.03, 0.03, 31)
SIGMA_M, ALONG_Z_M = 4e-5, 3e-4


@pytest.fixture
def written(small_bench, tmp_path) -> Path:
    """The result of two methods that see a plate at 0.3 m perfectly, on grids of their own; its
    mesh is known to SIGMA_M, and the transform of that to ALONG_Z_M along z."""
    bench, _ = load_benchmark(str(small_bench))
    corners_m = np.array([(x, y, 0.3) for x in (-0.1, 0.1) for y in (-0.1, 0.1)])
    faces = np.array([[0, 2, 1], [1, 2, 3]])
    mesh, folder = tmp_path / "plate.ply", tmp_path / "plate"
    Surface(corners_m, faces, np.full(4, SIGMA_M), np.ones(4, bool)).save(mesh)
    transform = Transform("photo", "radar", np.eye(4), np.diag([0, 0, ALONG_Z_M, 0, 0, 0]) ** 2)
    save_capture_file(folder, CaptureFile(name="plate"))
    files = {"photogrammetry": (mesh, transform), "truth": (mesh, identity("radar"))}
    maps, images = dict[str, Path](), list[Imaged]()
    for entry, axis_m in zip(bench.method, (AXIS_M, AXIS_M[5:-5]), strict=True):
        z_m, imaged = np.full((len(axis_m), len(axis_m)), 0.3), tmp_path / entry.id
        maps[entry.id] = imaged / DEPTH
        imaged.mkdir()
        DepthMap(axis_m, axis_m, z_m, np.zeros_like(z_m), entry.id).save(maps[entry.id])
        write_json(imaged / TIMING, {"seconds": [0.1]})
        stage = Stage(reconstruct, {"config": {}}, "plate", entry.label)
        images.append((stage, imaged))
    score_capture(tmp_path / "scored", str(folder), maps, files, bench.protocol)
    outcome = RunOutcome(
        bench=bench,
        captures=[RunCapture(folder, "0" * 64, CaptureFile(name="plate"))],
        targets=[],
        engine=Engine(tmp_path, Work(0)),
        images=by_pair(images),
        qualities=[],
        references={"plate": tuple(files)},
        scores={"plate": tmp_path / "scored"},
        meshes={},
        facts={},
    )
    (tmp_path / "out").mkdir()
    write(tmp_path / "out", outcome, "")
    return tmp_path / "out"


def floors(folder: Path, reference: str) -> list[str]:
    """Each method's floor, as table.csv has it."""
    with (folder / "table.csv").open() as stream:
        rows = [r for r in csv.DictReader(stream) if r["metric"] == "floor_mm"]
    return [row["value"] for row in rows if row["reference"] == reference]


def test_mesh_and_registration_reach_the_table_together(written):
    found, together_m = floors(written, "photogrammetry"), np.hypot(SIGMA_M, ALONG_Z_M)
    assert len(found) == 2  # a perfect radar on its own grid: the same floor
    for value in found:  # σ is float32 in a mesh
        expected_mm = 1e3 * np.sqrt(2 / np.pi) * together_m
        assert float(value) == pytest.approx(expected_mm, rel=1e-6)
    assert floors(written, "truth") == ["0.0"] * 2  # exact whatever its file says
    with np.load(depth_path(written, "plate", "photogrammetry")) as content:
        np.testing.assert_allclose(content["sigma_m"], np.full((31, 31), together_m), rtol=1e-6)
    facts = json.loads((written / "result.json").read_text())["facts"]["groundtruth_sigma_rms"]
    parts_m = {"mesh_mm": SIGMA_M, "registration_mm": ALONG_Z_M, "together_mm": together_m}
    assert facts["plate"] == pytest.approx(
        {key: 1e3 * value for key, value in parts_m.items()}, rel=1e-6
    )


@pytest.mark.parametrize(
    ("lost", "captures", "repeated", "methods", "counts"),
    [
        ({"": "wa", "3fsk": "x"}, "bc", "cyz", "2fsk 3fsk", ("2 of 3", "2 of 4")),
        ({"": "wxyz"}, "abc", "c", "2fsk 3fsk", ("3 of 3", "0 of 4")),
        ({"3fsk": "wxy"}, "abc", "cwxyz", "2fsk 3fsk", ("3 of 3", "4 of 4", "3fsk (1 of 4)")),
        ({"3fsk": "ab"}, "abc", "cwxyz", "2fsk", ("3fsk (1 of 3)",)),
        ({"2fsk": "ab", "3fsk": "c"}, "ab", "wxyz", "3fsk", ()),  # the weakest is left out
    ],
)
def test_every_method_of_the_table_stands_on_the_same_captures(
    lost, captures, repeated, methods, counts
):
    """A method that finished fewer than half as many is left out and named; captures of the
    precision take none from the accuracy. "ab" are scored, "wxyz" repeated, and "c" is both.
    lost: by a method, captures; "": by all."""
    measures = {"c": MEASURES} | dict.fromkeys("wxyz", ("precision",))
    measures = {name: measures.get(name, ("accuracy",)) for name in "abcwxyz"}
    bench = BenchFile(
        version=1,
        name="x",
        capture=[{"path": name, "measures": of} for name, of in measures.items()],
        method=[{"id": "2fsk", "precision": True}, {"id": "3fsk", "precision": True}],
    )
    failures = [
        Failure(capture=name, method=method, stage="reconstruct", message="broke")
        for method, names in lost.items()
        for name in names
    ]
    opened = [
        RunCapture(Path(name), "", CaptureFile(name=name), of) for name, of in measures.items()
    ]
    subset = common_subset(bench, opened, failures)
    assert [capture.name for capture in subset.captures] == list(captures)
    assert [capture.name for capture in subset.repeated] == list(repeated)
    assert [entry.id for entry in subset.methods] == methods.split()
    assert [count for count in counts if count not in subset.text] == []
