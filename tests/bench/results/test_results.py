"""The result folder: what is written comes back, and a broken folder is one line."""

from __future__ import annotations

import shutil
from itertools import product

import numpy as np
import pandas as pd
import pytest
from PIL import Image

from handbench.bench import results
from handbench.bench.evaluation.depth_errors import error_map
from handbench.bench.evaluation.metrics import of_captures
from handbench.bench.evaluation.rows import accuracy_rows, precision_rows, time_rows
from handbench.bench.evaluation.tables import CAPTURES, REPEATS, TASKS, frame
from handbench.support.errors import HandbenchError
from handbench.support.files import read_json, write_json, write_npz

AXIS = np.arange(-0.01, 0.0101, 0.002)
Z = np.where(np.hypot(*np.meshgrid(AXIS, AXIS)) < 0.01, 0.3, np.nan)
ERRORS = error_map(AXIS, AXIS, Z + 1e-3, Z)
TASK = frame(
    TASKS, [("B, 3-FSK", "B", "3fsk", "image", 0.5, 0.9, None, True, None, "", None, None, None)]
)
REPEATED = frame(REPEATS, [("hand1", "3fsk", i, z) for i, z in enumerate((0.3, None, 0.301))])


def rows() -> pd.DataFrame:
    parts = (
        accuracy_rows("3fsk", "truth", of_captures([ERRORS])),
        precision_rows("3fsk", "truth", [np.array([0.3, np.nan, 0.301])]),
        time_rows("3fsk", "truth", []),
    )
    return pd.concat(parts, ignore_index=True)


@pytest.fixture
def folder(tmp_path):
    """The smallest complete result: one capture, one method, one reference."""
    results.write_surface(tmp_path, "B", "truth", results.SurfaceMap(AXIS, AXIS, Z))
    results.write_surface(tmp_path, "B", "3fsk", results.SurfaceMap(AXIS, AXIS, Z + 1e-3))
    results.write_errors(tmp_path, "B", "3fsk", "truth", ERRORS)
    results.write_tables(tmp_path, table=rows(), tasks=TASK, repeats=REPEATED)
    results.write_config(tmp_path, 'name = "ü"\n')
    results.write_about(
        tmp_path,
        results.About(
            name="test",
            protocol={"nested": {"list": [1, 2]}},
            metrics=results.metric_facts(),
            inputs={},
            versions={},
            machine={},
            captures=(
                results.CaptureFacts(name="B", references=("truth",)),
                results.CaptureFacts(name="hand1", measures=("precision",)),
            ),
            methods=(results.MethodFacts(name="3fsk", title="3-FSK", config={"filter_px": 3}),),
        ),
    )
    return tmp_path


def test_round_trip(folder):
    result = results.load(folder)
    assert result.table.equals(rows())
    assert result.tasks.equals(TASK) and result.repeats.equals(REPEATED)
    assert result.config == 'name = "ü"\n'
    assert (
        result.about.protocol == {"nested": {"list": [1, 2]}}
        and result.about.metrics == results.metric_facts()
    )
    errors = result.errors("B", "3fsk", "truth")
    for name in ("x_m", "y_m", "error_m", "reference_z_m"):
        np.testing.assert_array_equal(getattr(errors, name), getattr(ERRORS, name))
    np.testing.assert_array_equal(result.surface("B", "truth").z_m, Z)
    assert [capture.name for capture in result.scored()] == ["B"]
    assert result.photo("B") is None


def test_captures_of_earlier_results_measured_both(folder):
    """They had no `measures`, but a `kind`, which was "accuracy" for all that runs wrote."""
    about = read_json(folder / "result.json", "a result")
    about["captures"] = [{"name": "B", "references": ["truth"], "kind": "accuracy"}, {"name": "C"}]
    read = results.About.model_validate(about).captures
    assert [capture.measures for capture in read] == [("accuracy", "precision")] * 2
    about["captures"] = [{"name": "B", "references": ["truth"]}, {"name": "C", "kind": "precision"}]
    write_json(folder / "result.json", about)
    result = results.load(folder)
    assert [capture.name for capture in result.scored()] == ["B"]
    assert [capture.name for capture in result.repeated()] == ["B", "C"]


def test_the_table_has_exactly_the_agreed_columns(folder):
    lines = (folder / "table.csv").read_text().splitlines()
    assert lines[0] == "metric,method,value,low,high,unit,paper,reference"
    assert "seconds,3fsk,,,,s,,truth" in lines  # no frame was timed: no figure
    assert results.load(folder).row("mae_mm", "3fsk", "truth").paper == 1.7
    assert results.load(folder).row("mae_mm", "3fsk", "photogrammetry") is None


def test_the_floor_stands_directly_after_the_mae(folder):
    """It is unknown here, since nothing tells how the reference errs: an empty cell, never a
    zero."""
    lines = (folder / "table.csv").read_text().splitlines()
    assert [line.split(",")[0] for line in lines[:4]] == ["metric", "mae_mm", "floor_mm", "max_mm"]
    assert lines[2] == "floor_mm,3fsk,,,,mm,,truth"
    assert results.load(folder).table.query("metric == 'floor_mm'").value.isna().all()


def test_figures_in_the_table_are_those_of_the_raw_errors(folder):
    """A reader can recompute the mean from the stored pixels."""
    result = results.load(folder)
    error_m = result.errors("B", "3fsk", "truth").error_m
    assert result.row("mae_mm", "3fsk", "truth").value == pytest.approx(
        1e3 * np.nanmean(np.abs(error_m)), rel=1e-12
    )


def test_times_have_a_median_and_an_interval():
    (row,) = time_rows("3fsk", "truth", [0.1, 0.2, 0.4, 0.3, 0.2]).itertuples()
    assert row.value == 0.2 and row.low <= 0.2 <= row.high and row.unit == "s"


@pytest.mark.parametrize(
    "missing",
    [
        "result.json",
        "table.csv",
        "tasks.csv",
        "config.toml",
        "depth/B__truth.npz",
        "depth/B__3fsk.npz",
        "errors/B__3fsk__truth.npz",
    ],
)
def test_a_partial_folder_names_what_is_missing(folder, missing):
    (folder / missing).unlink()
    with pytest.raises(HandbenchError, match=missing.split("/")[-1]) as caught:
        results.load(folder)
    assert "\n" not in str(caught.value)


def test_no_folder(tmp_path):
    with pytest.raises(HandbenchError, match="expected a folder"):
        results.load(tmp_path / "nothing")


def test_a_folder_of_version_0_2_has_the_same_tables(small_result, tmp_path):
    """It had them as files, and no scores.csv, whose figures come back from captures.csv and the
    maps of errors."""
    new, old = results.load(small_result), tmp_path / "old"
    shutil.copytree(small_result, old, ignore=shutil.ignore_patterns("work"))
    (old / "scores.csv").unlink()
    derived = {
        name: getattr(new, name)
        for name in ("repeats", "comparisons", "equal", "causes", "reliability")
    }
    scored = new.scores[(new.scores.reference != "") & (new.scores.frame == 0)]
    captures = scored.assign(unit="mm")[scored.metric.isin(["mae_mm", "aurc_mm"])][CAPTURES.names]
    results.write_tables(old, **derived, captures=captures)
    read = results.load(old)
    for name, table in derived.items():
        assert len(table) and getattr(read, name).equals(table), name
    keys = ["method", "treatment", "metric"]
    expected, found = (result.scores.set_index(keys).value for result in (new, read))
    for method, treatment in product(("2fsk", "narrowband"), ("", "none", "window")):
        assert (
            found[method, treatment, "mae_mm"].item()
            == expected[method, treatment, "mae_mm"].item()
        )


def test_a_figure_that_stands_twice_is_refused(small_result, tmp_path):
    shutil.copytree(small_result, tmp_path / "twice", ignore=shutil.ignore_patterns("work"))
    with (tmp_path / "twice" / "scores.csv").open("a") as stream:
        stream.write("ball,2fsk,truth,,0,mae_mm,7\n")
    with pytest.raises(HandbenchError, match=r"scores\.csv: has two lines of one figure"):
        results.load(tmp_path / "twice")


def test_repeats_are_optional(folder):
    (folder / "repeats.csv").unlink()
    assert results.load(folder).repeats.equals(frame(REPEATS))


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"schema_version": 2}, "schema_version is 2"),
        ({"surprise": 1}, "unknown key 'surprise'"),
        ({"captures": [{"name": "../B"}]}, "cannot name a file"),
        ({"captures": [{"name": "B", "references": ["guess"]}]}, "references"),
    ],
)
def test_refuses_what_it_does_not_know(folder, change, message):
    write_json(folder / "result.json", read_json(folder / "result.json", "") | change)
    with pytest.raises(HandbenchError, match=message) as caught:
        results.load(folder)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    "text",
    [
        "",
        "metric,method\n",
        "metric,method,value,low,high,unit,paper,reference\nmae_mm,3fsk,abc,,,mm,,truth\n",
        "metric,method,value,low,high,unit,paper,reference\nmae_mm,3fsk,nan,,,mm,,truth\n",
        "metric,method,value,low,high,unit,paper,reference\nmae_mm,3fsk\n",
    ],
)
def test_refuses_a_broken_table(folder, text):
    (folder / "table.csv").write_text(text)
    with pytest.raises(HandbenchError, match=r"table\.csv"):
        results.load(folder)


def test_refuses_maps_of_other_shapes_and_pickles(folder):
    path = results.depth_path(folder, "B", "3fsk")
    write_npz(path, x_m=AXIS, y_m=AXIS, z_m=Z[1:])
    with pytest.raises(HandbenchError, match="'z_m' is float64"):
        results.load(folder).surface("B", "3fsk")
    np.savez(path, x_m=AXIS, y_m=AXIS, z_m=np.array([[{}]], dtype=object))
    with pytest.raises(HandbenchError, match="not a readable"):
        results.load(folder).surface("B", "3fsk")


@pytest.mark.parametrize("name", ["", ".", "..", "../x", "a/b", "a\\b", "a__b", "a\nb", "x" * 81])
def test_names_stay_inside_the_folder(tmp_path, name):
    with pytest.raises(HandbenchError, match="cannot name a file"):
        results.depth_path(tmp_path, name, "3fsk")


def test_photographs_are_small_upright_and_anonymous(tmp_path):
    source = tmp_path / "source.jpg"
    exif = Image.Exif()
    exif[0x0112] = 6  # to be turned by 90°
    exif[0x010F] = "camera"
    Image.new("RGB", (1500, 900), "red").save(source, exif=exif)
    results.write_photo(tmp_path, "B", source)
    with Image.open(tmp_path / "photos" / "B.jpg") as photo:
        assert photo.size == (360, 600)
        assert not photo.getexif()


def test_a_photograph_that_is_none(tmp_path):
    shutil.copy(__file__, tmp_path / "photo.jpg")
    with pytest.raises(HandbenchError, match="not a readable photograph"):
        results.write_photo(tmp_path, "B", tmp_path / "photo.jpg")
