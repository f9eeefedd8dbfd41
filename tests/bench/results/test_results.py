"""The result folder: what is written comes back, and a broken folder is one line."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest
from PIL import Image

from handbench.bench.evaluation.depth_errors import error_map
from handbench.bench.evaluation.main_table import main_table
from handbench.bench.evaluation.metrics import figures
from handbench.bench.evaluation.scoring_protocols import PAPER
from handbench.bench.evaluation.tables import SCORES, TASKS, frame
from handbench.bench.results.about import About, CaptureFacts, MethodFacts, metric_facts
from handbench.bench.results.maps import (
    SurfaceMap,
    depth_path,
    write_errors,
    write_photo,
    write_surface,
)
from handbench.bench.results.result_folder import load, write_about, write_tables
from handbench.support.errors import HandbenchError
from handbench.support.files import read_json, write_json, write_npz, write_text

AXIS = np.arange(-0.01, 0.0101, 0.002)
Z = np.where(np.hypot(*np.meshgrid(AXIS, AXIS)) < 0.01, 0.3, np.nan)
ERRORS = error_map(AXIS, AXIS, Z + 1e-3, Z)
TASK = frame(
    TASKS, [("B, 3-FSK", "B", "3fsk", "image", 0.5, 0.9, None, True, None, "", None, None)]
)
STRONGEST_M = (0.3, None, 0.301)
FIGURES = figures(ERRORS)
SCORED = frame(
    SCORES,
    [("B", "3fsk", "truth", "", 0, *figure) for figure in FIGURES.items()]
    + [("hand1", "3fsk", "", "", i, "strongest_z_m", z) for i, z in enumerate(STRONGEST_M)],
)


def rows() -> pd.DataFrame:
    return main_table(SCORED, PAPER, seed=0, with_paper=True)


@pytest.fixture
def folder(tmp_path):
    """The smallest complete result: one capture, one method, one reference."""
    write_surface(tmp_path, "B", "truth", SurfaceMap(AXIS, AXIS, Z))
    write_surface(tmp_path, "B", "3fsk", SurfaceMap(AXIS, AXIS, Z + 1e-3))
    write_errors(tmp_path, "B", "3fsk", "truth", ERRORS)
    write_tables(tmp_path, table=rows(), tasks=TASK, scores=SCORED)
    write_text(tmp_path / "config.toml", 'name = "ü"\n')
    write_about(
        tmp_path,
        About(
            name="test",
            protocol={"nested": {"list": [1, 2]}},
            metrics=metric_facts(),
            inputs={},
            versions={},
            machine={},
            captures=(
                CaptureFacts(name="B", references=("truth",)),
                CaptureFacts(name="hand1", measures=("precision",)),
            ),
            methods=(MethodFacts(name="3fsk", title="3-FSK", config={"filter_px": 3}),),
        ),
    )
    return tmp_path


def test_what_is_written_comes_back(folder):
    """The floor stands directly after the MAE, and is unknown here, since nothing tells how the
    reference errs: an empty cell, never a zero. No frame was timed: no figure."""
    result = load(folder)
    assert result.table.equals(rows())
    assert result.tasks.equals(TASK) and result.scores.equals(SCORED)
    np.testing.assert_array_equal(result.repeats.z_m, np.array(STRONGEST_M, float))
    assert result.config == 'name = "ü"\n' and result.photo("B") is None
    assert result.about.protocol == {"nested": {"list": [1, 2]}}
    assert result.about.metrics == metric_facts()
    errors = result.errors("B", "3fsk", "truth")
    np.testing.assert_array_equal(errors.error_m, ERRORS.error_m)
    np.testing.assert_array_equal(errors.reference_z_m, ERRORS.reference_z_m)
    np.testing.assert_array_equal(result.surface("B", "truth").z_m, Z)
    assert [capture.name for capture in result.scored()] == ["B"]
    assert [capture.name for capture in result.repeated()] == ["B", "hand1"]
    lines = (folder / "table.csv").read_text().splitlines()
    assert lines[0] == "metric,method,value,low,high,unit,paper,reference"
    assert lines[2] == "floor_mm,3fsk,,,,mm,,truth" and "seconds,3fsk,,,,s,,truth" in lines
    mae = result.row("mae_mm", "3fsk", "truth")
    assert mae.value == pytest.approx(1, rel=1e-9) and mae.paper == 1.7


HEADER = "metric,method,value,low,high,unit,paper,reference\n"
SCORE_HEADER = "capture,method,reference,treatment,frame,metric,value\n"
SCORE = "B,3fsk,truth,,0,mae_mm,7\n"
MISSING = (
    *("result.json", "table.csv", "tasks.csv", "scores.csv", "config.toml", "depth/B__truth.npz"),
    *("depth/B__3fsk.npz", "errors/B__3fsk__truth.npz"),
)
REFUSED = {
    **{name: (name, None, name.split("/")[-1]) for name in MISSING},
    "schema": ("result.json", {"schema_version": 2}, "'schema_version' is 2"),
    "key": ("result.json", {"surprise": 1}, "unknown key 'surprise'"),
    "name": ("result.json", {"captures": [{"name": "../B"}]}, "cannot be the name of a file"),
    "empty": ("table.csv", "", r"table\.csv"),
    "columns": ("table.csv", "metric,method\n", r"table\.csv"),
    "text": ("table.csv", f"{HEADER}mae_mm,3fsk,abc,,,mm,,truth\n", r"table\.csv"),
    "twice": ("scores.csv", f"{SCORE_HEADER}{2 * SCORE}", "two lines for the same figure"),
    "nan": ("table.csv", f"{HEADER}mae_mm,3fsk,nan,,,mm,,truth\n", r"table\.csv"),
}


@pytest.mark.parametrize(("name", "content", "words"), REFUSED.values(), ids=REFUSED)
def test_broken_folders_are_refused_in_one_line(folder, name, content, words):
    file = folder / name
    if content is None:
        file.unlink()
    elif isinstance(content, dict):
        write_json(file, read_json(file, "") | content)
    else:
        file.write_text(content)
    with pytest.raises(HandbenchError, match=words) as caught:
        load(folder)
    assert "\n" not in str(caught.value)


def test_maps_of_other_shapes_and_names_that_lead_outside_are_refused(folder):
    path = depth_path(folder, "B", "3fsk")
    write_npz(path, x_m=AXIS, y_m=AXIS, z_m=Z[1:])
    with pytest.raises(HandbenchError, match="'z_m' is float64"):
        load(folder).surface("B", "3fsk")
    for name in ("", "..", "../x", "a\\b", "a__b", "a\nb", "x" * 101):
        with pytest.raises(HandbenchError, match="cannot be the name of a file"):
            depth_path(folder, name, "3fsk")
    with pytest.raises(HandbenchError, match="expected a folder"):
        load(folder / "nothing")


def test_photographs_are_small_upright_and_anonymous(tmp_path):
    source, exif = tmp_path / "source.jpg", Image.Exif()
    exif[0x0112], exif[0x010F] = 6, "camera"  # to be turned by 90°
    Image.new("RGB", (1500, 900), "red").save(source, exif=exif)
    write_photo(tmp_path, "B", source)
    with Image.open(tmp_path / "photos" / "B.jpg") as photo:
        assert photo.size == (360, 600) and not photo.getexif()
