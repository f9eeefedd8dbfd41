"""The result folder: what is written comes back, and a broken folder is one line."""

from __future__ import annotations

import shutil

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


def test_captures_of_earlier_results_measured_both(folder):
    """They had no `measures`, but a `kind`, which was "accuracy" for all that runs wrote."""
    about = read_json(folder / "result.json", "a result")
    about["captures"] = [{"name": "B", "references": ["truth"], "kind": "accuracy"}, {"name": "C"}]
    read = results.About.model_validate(about).captures
    assert [capture.measures for capture in read] == [("accuracy", "precision")] * 2
    about["captures"] = [{"name": "C", "kind": "precision"}]
    assert results.About.model_validate(about).captures[0].measures == ("precision",)


def test_what_is_written_comes_back(folder):
    """The floor stands directly after the MAE, and is unknown here, since nothing tells how the
    reference errs: an empty cell, never a zero. No frame was timed: no figure."""
    result = results.load(folder)
    assert result.table.equals(rows())
    assert result.tasks.equals(TASK) and result.repeats.equals(REPEATED)
    assert result.config == 'name = "ü"\n' and result.photo("B") is None
    assert result.about.protocol == {"nested": {"list": [1, 2]}}
    assert result.about.metrics == results.metric_facts()
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
    (folder / "repeats.csv").unlink()
    assert results.load(folder).repeats.equals(frame(REPEATS))


def test_a_folder_of_version_0_2_has_the_same_tables(small_result, tmp_path):
    """It had them as files, and no scores.csv, whose figures come back from captures.csv and the
    maps of errors. Earlier ones had neither failures nor machines."""
    new, old = results.load(small_result), tmp_path / "old"
    shutil.copytree(small_result, old, ignore=shutil.ignore_patterns("work"))
    (old / "scores.csv").unlink()
    about = read_json(old / "result.json", "a result")
    write_json(old / "result.json", {key: about[key] for key in about.keys() - {"failures"}})
    tasks = (old / "tasks.csv").read_text().splitlines()
    (old / "tasks.csv").write_text("".join(f"{line.rsplit(',', 5)[0]}\n" for line in tasks))
    names = "repeats", "comparisons", "equal", "causes", "reliability"
    derived = {name: getattr(new, name) for name in names}
    scored = new.scores[(new.scores.reference != "") & (new.scores.frame == 0)]
    captures = scored.assign(unit="mm")[scored.metric.isin(["mae_mm", "aurc_mm"])][CAPTURES.names]
    results.write_tables(old, **derived, captures=captures)
    read = results.load(old)
    assert read.about.failures == () and np.isnan(read.tasks.gemm_gflops[0])
    for name, table in derived.items():
        assert len(table) and getattr(read, name).equals(table), name
    keys = ["method", "treatment"]
    expected, found = (
        result.scores.query("metric == 'mae_mm' and frame == 0").set_index(keys).value.sort_index()
        for result in (new, read)
    )
    assert len(found) == 6 and found.equals(expected)
    with (old / "scores.csv").open("w") as stream:
        stream.write((small_result / "scores.csv").read_text() + "ball,2fsk,truth,,0,mae_mm,7\n")
    with pytest.raises(HandbenchError, match=r"scores\.csv: has two lines for the same figure"):
        results.load(old)


HEADER = "metric,method,value,low,high,unit,paper,reference\n"
MISSING = (
    *("result.json", "table.csv", "tasks.csv", "config.toml", "depth/B__truth.npz"),
    *("depth/B__3fsk.npz", "errors/B__3fsk__truth.npz"),
)
REFUSED = {
    **{name: (name, None, name.split("/")[-1]) for name in MISSING},
    "schema": ("result.json", {"schema_version": 2}, "schema_version is 2"),
    "key": ("result.json", {"surprise": 1}, "unknown key 'surprise'"),
    "name": ("result.json", {"captures": [{"name": "../B"}]}, "cannot be the name of a file"),
    "empty": ("table.csv", "", r"table\.csv"),
    "columns": ("table.csv", "metric,method\n", r"table\.csv"),
    "text": ("table.csv", f"{HEADER}mae_mm,3fsk,abc,,,mm,,truth\n", r"table\.csv"),
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
        results.load(folder)
    assert "\n" not in str(caught.value)


def test_maps_of_other_shapes_and_names_that_lead_outside_are_refused(folder):
    path = results.depth_path(folder, "B", "3fsk")
    write_npz(path, x_m=AXIS, y_m=AXIS, z_m=Z[1:])
    with pytest.raises(HandbenchError, match="'z_m' is float64"):
        results.load(folder).surface("B", "3fsk")
    for name in ("", "..", "../x", "a\\b", "a__b", "a\nb", "x" * 81):
        with pytest.raises(HandbenchError, match="cannot be the name of a file"):
            results.depth_path(folder, name, "3fsk")
    with pytest.raises(HandbenchError, match="expected a folder"):
        results.load(folder / "nothing")


def test_photographs_are_small_upright_and_anonymous(tmp_path):
    source, exif = tmp_path / "source.jpg", Image.Exif()
    exif[0x0112], exif[0x010F] = 6, "camera"  # to be turned by 90°
    Image.new("RGB", (1500, 900), "red").save(source, exif=exif)
    results.write_photo(tmp_path, "B", source)
    with Image.open(tmp_path / "photos" / "B.jpg") as photo:
        assert photo.size == (360, 600) and not photo.getexif()
