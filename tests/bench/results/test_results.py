"""The result folder: what is written comes back, and a broken folder is one line."""

from __future__ import annotations

import numpy as np
import pytest
from PIL import Image

from handbench.bench.results.about import CaptureFacts
from handbench.bench.results.maps import SurfaceMap, depth_path, write_errors, write_surface
from handbench.bench.results.result_folder import Result, load, write_about, write_tables
from handbench.bench.run.write_result import write_photo
from handbench.support.files import read_json, write_json, write_npz, write_text
from tests.bench.results.flat_results import AXIS_M, REFERENCE_M, errors_of, flat_result
from tests.refusals import refuse

ERRORS_MM = np.where(np.hypot(*np.mgrid[-18:18, -18:18]) < 10, 1.0, np.nan)


@pytest.fixture
def written(tmp_path) -> Result:
    """The smallest complete result: one capture, one method, one reference; and a hand that is
    repeated."""
    captures = (
        CaptureFacts(name="B", references=("truth",)),
        CaptureFacts(name="hand1", measures=("precision",)),
    )
    result = flat_result(tmp_path, ERRORS_MM[None], ("B",), captures=captures)
    z_m = REFERENCE_M + 1e-3 * ERRORS_MM
    write_surface(tmp_path, "B", "3fsk", SurfaceMap(AXIS_M, AXIS_M, z_m))
    write_errors(tmp_path, "B", "3fsk", "truth", errors_of(ERRORS_MM))
    write_tables(tmp_path, table=result.table, tasks=result.tasks, scores=result.scores)
    write_text(tmp_path / "config.toml", result.config)
    write_about(tmp_path, result.about)
    return result


def test_what_is_written_comes_back(written):
    """The floor stands directly after the MAE, and is unknown here, since nothing tells how the
    reference errs: an empty cell, never a zero."""
    result = load(written.folder)
    for name in ("table", "tasks", "scores"):
        assert getattr(result, name).equals(getattr(written, name))
    assert (result.about, result.config) == (written.about, written.config)
    assert len(result.repeats.z_m) == 10 and result.photo("B") is None
    errors = result.errors("B", "3fsk", "truth")
    np.testing.assert_array_equal(errors.error_m, errors_of(ERRORS_MM).error_m)
    np.testing.assert_array_equal(errors.reference_z_m, REFERENCE_M)
    np.testing.assert_array_equal(result.surface("B", "truth").z_m, REFERENCE_M)
    assert [capture.name for capture in result.scored()] == ["B"]
    assert [capture.name for capture in result.repeated()] == ["B", "hand1"]
    lines = (written.folder / "table.csv").read_text().splitlines()
    assert lines[0] == "metric,method,value,low,high,unit,paper,reference"
    assert lines[2] == "floor_mm,3fsk,,,,mm,,truth"
    assert result.row("mae_mm", "3fsk", "truth").value == pytest.approx(1, rel=1e-9)


HEADER = "metric,method,value,low,high,unit,paper,reference\n"
SCORE_HEADER = "capture,method,reference,treatment,frame,metric,value\n"
SCORE = "B,3fsk,truth,,0,mae_mm,7\n"


@pytest.mark.parametrize(
    ("name", "content", "place"),
    [
        ("result.json", None, ""),
        ("scores.csv", None, ""),
        ("config.toml", None, ""),
        ("depth/B__3fsk.npz", None, ""),
        ("errors/B__3fsk__truth.npz", None, ""),
        ("result.json", {"schema_version": 2}, "'schema_version'"),
        ("result.json", {"surprise": 1}, "'surprise'"),
        ("result.json", {"captures": [{"name": "../B"}]}, "../B"),
        ("table.csv", "metric,method\n", ""),
        ("table.csv", f"{HEADER}mae_mm,3fsk,abc,,,mm,,truth\n", "abc"),
        ("table.csv", f"{HEADER}mae_mm,3fsk,nan,,,mm,,truth\n", "nan"),
        ("scores.csv", f"{SCORE_HEADER}{2 * SCORE}", ""),
        ("scores.csv", f"{SCORE_HEADER}{SCORE}", "table.csv"),  # cut at the end of a line
        ("scores.csv", f"{SCORE_HEADER}{SCORE[:-1]}", ""),
        ("table.csv", HEADER, ""),
        ("result.json", {"metrics": {}}, "table.csv"),
        ("result.json", {"methods": []}, "table.csv"),
        ("result.json", {"facts": {"warnings": ["x"]}}, "'warnings'"),
    ],
)
def test_a_broken_folder_is_refused(written, name, content, place):
    file = written.folder / name
    if content is None:
        file.unlink()
    elif isinstance(content, dict):
        write_json(file, read_json(file, "") | content)
    else:
        file.write_text(content)
    refuse(lambda: load(written.folder), name, place)


def test_maps_of_other_shapes_and_names_that_lead_outside_are_refused(written):
    path = depth_path(written.folder, "B", "3fsk")
    write_npz(path, x_m=AXIS_M, y_m=AXIS_M, z_m=REFERENCE_M[1:])
    refuse(lambda: load(written.folder).surface("B", "3fsk"), path.name, "'z_m'")
    for name in ("", "..", "../x", "a\\b", "a__b", "a\nb", "-o", " ", "x" * 101):
        refuse(lambda name=name: depth_path(written.folder, name, "3fsk"))


def test_photographs_are_small_upright_and_anonymous(tmp_path):
    source, exif = tmp_path / "source.jpg", Image.Exif()
    exif[0x0112], exif[0x010F] = 6, "camera"  # to be turned by 90°
    Image.new("RGB", (1500, 900), "red").save(source, exif=exif)
    write_photo(tmp_path, "B", source)
    with Image.open(tmp_path / "photos" / "B.jpg") as photo:
        assert photo.size == (360, 600) and not photo.getexif()
