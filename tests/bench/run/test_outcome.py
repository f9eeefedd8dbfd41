"""What a run's result folder says of its reference, from mesh and transform to table: no echo is
imaged."""

from __future__ import annotations

import csv
import json
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.ndimage import binary_erosion

from handbench.bench import results
from handbench.bench.datasets.dataset import open_capture
from handbench.bench.datasets.native import CaptureFile, save_capture_file
from handbench.bench.evaluation.scoring_protocols import protocol
from handbench.bench.pipeline.score import reference_of_file, score
from handbench.bench.results.about import MEASURES
from handbench.bench.run import outcome, scoring, write_result
from handbench.bench.run.benchmark_file import BenchFile, load_benchmark
from handbench.bench.run.outcome import CommonSubset, Outcome, RunCapture
from handbench.calibration.transforms import Transform, identity
from handbench.groundtruth.mesh.depth import Reference
from handbench.groundtruth.mesh.surface import Surface
from handbench.radar.data.depthmap import DepthMap, load_depthmap
from handbench.radar.data.grid import PixelGrid
from handbench.support.errors import HandbenchError

AXIS_M = np.linspace(-0.03, 0.03, 31)
SIGMA_M, ALONG_Z_M = 4e-5, 3e-4


@pytest.fixture
def written(small_bench, tmp_path):
    """Write the result of two methods that see a plate at 0.3 m perfectly, on grids of their own;
    the plate's mesh and its transform may know how they err or not."""
    bench, _ = load_benchmark(str(small_bench))

    def write(sigma_m: float, covariance: np.ndarray | None, spoil: bool = False) -> Path:
        corners_m = np.array(
            [(-0.1, -0.1, 0.3), (0.1, -0.1, 0.3), (0.1, 0.1, 0.3), (-0.1, 0.1, 0.3)]
        )
        plate = Surface(
            corners_m, np.array([[0, 1, 2], [0, 2, 3]]), np.full(4, sigma_m), np.ones(4, bool)
        )
        plate.save(tmp_path / "plate.ply")
        transform = Transform("photo", "radar", np.eye(4), covariance)
        names = ("spoilt", "plate") if spoil else ("plate",)
        found = Outcome(
            bench,
            [RunCapture(tmp_path / name, "0" * 64, CaptureFile(name=name)) for name in names],
            [],
        )
        found.references["spoilt"] = (
            {"truth": (tmp_path / "nowhere.ply", identity("radar"))} if spoil else {}
        )
        found.references["plate"] = {
            "photogrammetry": (tmp_path / "plate.ply", transform),
            "truth": (tmp_path / "plate.ply", identity("radar")),
        }
        for entry, axis_m in zip(bench.method, (AXIS_M, AXIS_M[5:-5]), strict=True):
            z_m = np.full((len(axis_m), len(axis_m)), 0.3)
            DepthMap(axis_m, axis_m, z_m, np.zeros_like(z_m), entry.id).save(
                tmp_path / f"{entry.id}.npz"
            )
            for about in [(name, entry.id) for name in names]:
                found.maps[about] = tmp_path / f"{entry.id}.npz"
                found.configs[about], found.seconds[about] = {}, [0.1]
        for capture in found.captures:
            save_capture_file(capture.folder, capture.about)
            maps = {entry.id: tmp_path / f"{entry.id}.npz" for entry in bench.method}
            with outcome.recorded_failure(found.failures, capture.name, "score"):
                files, scored = found.references[capture.name], tmp_path / "scored" / capture.name
                scoring.make(scored, str(capture.folder), maps, files, bench.protocol)
                found.scores[capture.name] = scored
        folder = tmp_path / "out"
        folder.mkdir(exist_ok=True)
        write_result.write(folder, found, "")
        return folder

    return write


def floors(folder: Path, reference: str) -> list[list[str]]:
    """Value, low and high of each method's floor, as table.csv has them."""
    with (folder / "table.csv").open() as stream:
        lines = list(csv.DictReader(stream))
    rows = [
        line for line in lines if (line["metric"], line["reference"]) == ("floor_mm", reference)
    ]
    return [[row[column] for column in ("value", "low", "high")] for row in rows]


def sigma_m(folder: Path, reference: str) -> np.ndarray:
    with np.load(results.depth_path(folder, "plate", reference)) as content:
        return content["sigma_m"]


def test_mesh_and_registration_reach_the_table_together(written):
    folder = written(SIGMA_M, np.diag([0, 0, ALONG_Z_M, 0, 0, 0]) ** 2)
    together_m = np.hypot(SIGMA_M, ALONG_Z_M)
    for value, low, high in floors(
        folder, "photogrammetry"
    ):  # a perfect radar on its own grid: the same floor
        assert float(value) == pytest.approx(
            1e3 * np.sqrt(2 / np.pi) * together_m, rel=1e-6
        )  # σ is float32 in a mesh
        assert 0 < float(low) < float(value) < float(high)
    assert len(floors(folder, "photogrammetry")) == 2
    np.testing.assert_allclose(
        sigma_m(folder, "photogrammetry"), np.full((31, 31), together_m), rtol=1e-6
    )
    facts = json.loads((folder / "result.json").read_text())["facts"]["groundtruth_sigma_rms"]
    expected = {
        "mesh_mm": 1e3 * SIGMA_M,
        "registration_mm": 1e3 * ALONG_Z_M,
        "together_mm": 1e3 * together_m,
    }
    assert facts == {"plate": pytest.approx(expected, rel=1e-6)}


def test_the_truth_is_exact_whatever_its_file_says(written):
    folder = written(SIGMA_M, None)
    assert floors(folder, "truth") == [["0.0", "", ""]] * 2
    assert np.all(sigma_m(folder, "truth") == 0)


@pytest.mark.parametrize(
    ("mesh_m", "covariance", "unknown"),
    [
        (np.nan, 1e-8 * np.eye(6), ["mesh"]),
        (SIGMA_M, None, ["registration"]),
        (np.nan, None, ["mesh", "registration"]),
    ],
)
def test_what_is_missing_is_named_and_no_floor_is_invented(written, mesh_m, covariance, unknown):
    folder = written(mesh_m, covariance)
    assert floors(folder, "photogrammetry") == [["", "", ""]] * 2
    assert np.isnan(sigma_m(folder, "photogrammetry")).all()
    facts = json.loads((folder / "result.json").read_text())["facts"]["groundtruth_sigma_rms"][
        "plate"
    ]
    assert facts["unknown"] == unknown and facts["together_mm"] is None
    assert [facts[f"{part}_mm"] is None for part in ("mesh", "registration")] == [
        part in unknown for part in ("mesh", "registration")
    ]


def on(
    lost: dict[str, tuple[str, ...]],
    captures: str = "abcd",
    methods: tuple[str, ...] = ("2fsk", "3fsk"),
) -> CommonSubset:
    """The basis of a run in which captures were lost by method; "": by all."""
    bench = BenchFile(
        version=1,
        name="x",
        capture=[{"path": name} for name in captures],
        method=[{"id": id} for id in methods],
    )
    failures = [
        results.Failure(capture=name, method=method, stage="reconstruct", message=f"{name} broke")
        for method, names in lost.items()
        for name in names
    ]
    found = [RunCapture(Path(name), "", CaptureFile(name=name)) for name in captures]
    return outcome.common_subset(Outcome(bench, found, [], failures))


def names(basis: CommonSubset) -> tuple[str, tuple[str, ...]]:
    return "".join(capture.name for capture in basis.captures), tuple(
        entry.id for entry in basis.methods
    )


def repeated(lost: dict[str, str]) -> tuple[str, str, str]:
    """The basis of "ab", scored, "c", which is both, and "wxyz", repeated: the captures of the
    accuracy, those of the precision, and the text on these. lost: by a method, captures; "": by
    all."""
    measures = (
        dict.fromkeys("ab", ("accuracy",)) | {"c": MEASURES} | dict.fromkeys("wxyz", ("precision",))
    )
    methods = [
        {"id": "2fsk", "precision": True},
        {"id": "3fsk", "precision": True},
        {"id": "broadband"},
    ]
    captures = [{"path": name, "measures": of} for name, of in measures.items()]
    bench = BenchFile(version=1, name="x", capture=captures, method=methods)
    failures = [
        results.Failure(capture=name, method=method, stage="repeat", message=f"{name} broke")
        for method, names in lost.items()
        for name in names
    ]
    found = [
        RunCapture(Path(name), "", CaptureFile(name=name), of) for name, of in measures.items()
    ]
    basis = outcome.common_subset(Outcome(bench, found, [], failures))
    assert names(basis)[1] == ("2fsk", "3fsk", "broadband")
    accuracy, _, precision = basis.text.partition("; the precision alone: ")
    assert accuracy.startswith(f"{len(basis.captures)} of 3 captures")
    return names(basis)[0], "".join(capture.name for capture in basis.repeated), precision


def test_captures_of_the_precision_take_none_from_the_accuracy():
    assert repeated({}) == (
        "abc",
        "cwxyz",
        "4 of 4 captures: those that every method of the table finished",
    )
    accuracy, precision, text = repeated({"": "wa", "3fsk": "x"})
    assert (accuracy, precision) == ("bc", "cyz") and text.startswith("2 of 4 captures")
    assert repeated({"": "wxyz"})[:2] == ("abc", "c")
    assert repeated({"broadband": "c"})[:2] == (
        "ab",
        "wxyz",
    )  # as ever: all stages of a capture that is both


def test_a_method_that_lost_most_of_the_repeats_is_left_out_of_them_alone():
    accuracy, precision, text = repeated({"3fsk": "wxy"})
    assert (accuracy, precision) == (
        "abc",
        "cwxyz",
    ) and "left out, with the captures that they finished: 3fsk (1 of 4)" in text


def test_every_method_of_the_table_stands_on_the_same_captures():
    assert names(on({})) == ("abcd", ("2fsk", "3fsk"))
    assert names(on({"2fsk": ("a",), "3fsk": ("c",), "": ("d",)})) == ("b", ("2fsk", "3fsk"))
    assert "1 of 4 captures" in on({"2fsk": ("a",), "3fsk": ("c",), "": ("d",)}).text


def test_a_method_that_finished_fewer_than_half_as_many_is_left_out_and_named():
    basis = on({"3fsk": ("a", "b", "c")})
    assert (
        names(basis) == ("abcd", ("2fsk",))
        and "left out" in basis.text
        and "3fsk (1 of 4)" in basis.text
    )
    assert names(on({"3fsk": ("a", "b")})) == ("cd", ("2fsk", "3fsk"))


def test_without_a_common_capture_the_weakest_method_is_left_out():
    assert names(on({"2fsk": ("a", "b"), "3fsk": ("c", "d")})) == ("cd", ("2fsk",))


def test_when_nothing_was_finished_the_first_reason_is_given():
    with pytest.raises(HandbenchError, match="every capture failed; the first: a broke"):
        on({"": tuple("abcd")})
    with pytest.raises(HandbenchError, match="every capture failed"):
        on({"2fsk": tuple("abcd"), "3fsk": tuple("abcd")})


def test_a_capture_that_cannot_be_scored_fails_alone(written, tmp_path, capsys):
    folder = written(SIGMA_M, None, spoil=True)
    [failure] = results.load(folder).about.failures
    assert (failure.capture, failure.stage) == ("spoilt", "score")
    assert (
        floors(folder, "truth") == [["0.0", "", ""]] * 2 and failure.line in capsys.readouterr().err
    )


@pytest.mark.parametrize(
    ("chosen", "scored"), [("paper", 441), ("maroon", 231), ("maroon-eroded", 171)]
)
def test_the_data_sets_own_mask_counts_under_its_protocol(chosen, scored):
    """A plate over 21 × 21 pixels, of which the data set's mask keeps the 11 columns at x ≥ 0, or
    of these 9 × 19."""
    axis_m = np.linspace(-0.02, 0.02, 21)
    z_m = np.full((21, 21), 0.3)
    half = np.broadcast_to(axis_m >= -1e-12, (21, 21))
    data = SimpleNamespace(mask=lambda depth, erode: binary_erosion(half) if erode else half)
    depth = DepthMap(axis_m, axis_m, z_m, np.zeros_like(z_m), "2fsk")
    found = score(
        depth, Reference(z_m, np.zeros_like(z_m), None, None, z_m > 0), protocol(chosen), data
    )
    assert np.isfinite(found.errors.error_m).sum() == scored


def test_what_was_scored_is_read_back_as_it_was(written, tmp_path):
    """Errors with all that is known beside them, and the reference with its registration's
    error."""
    covariance = np.diag([0, 0, ALONG_Z_M, 0, 0, 0]) ** 2
    written(SIGMA_M, covariance)
    folder, transform = (
        tmp_path / "scored" / "plate",
        Transform("photo", "radar", np.eye(4), covariance),
    )
    depth = load_depthmap(tmp_path / "2fsk.npz")
    for name, given in (("photogrammetry", transform), ("truth", identity("radar"))):
        grid = PixelGrid(depth.x_m, depth.y_m)
        reference = reference_of_file(tmp_path / "plate.ply", given, grid, exact=name == "truth")
        kept = scoring.read_reference(folder, "plate", "2fsk", name, given)
        np.testing.assert_array_equal(
            kept.registration.covariance, reference.registration.covariance
        )
        for field in ("z_m", "mesh_sigma_m", "leverage", "met"):
            np.testing.assert_array_equal(getattr(kept, field), getattr(reference, field))
        errors = score(depth, reference, protocol("paper"), open_capture(tmp_path / "plate")).errors
        for field, values in vars(results.read_errors(folder, "plate", "2fsk", name)).items():
            np.testing.assert_array_equal(values, getattr(errors, field))
