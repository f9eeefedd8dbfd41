"""The tables of README and docs/results.md: made from a result, and every way in which they can be
stale is noticed."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import pytest

from docs import readme
from handbench.bench import results
from handbench.bench.evaluation.tables import COMPARISONS, frame
from handbench.support.errors import HandbenchError
from tests.reports.synthetic_result import METHODS, write_synthetic

CONFIG = 'name = "x"\n[[capture]]\nscene = "hand.toml"\n[[capture]]\npath = "elsewhere"\n'


@pytest.fixture
def result(tmp_path) -> results.Result:
    """A synthetic result, of a scene, with comparisons as the methods are and under equal
    treatment, and a report's figure."""
    lines = [
        (
            "mae_mm",
            better,
            worse,
            1.0,
            0.5,
            1.5,
            "mm",
            1e-4,
            2.0,
            "photogrammetry",
            3,
            30,
            f"{better} is better than {worse}",
            treatment,
        )
        for better, worse in (("3fsk", "2fsk"), ("3fsk", "broadband"), ("3fsk", "narrowband"))
        for treatment in ("", "none")
    ]
    found = results.load(write_synthetic(tmp_path / "run", alike=True))
    machine = {"processor": "an | odd_one", "cores": 2, "imaging_device": "cpu"}
    picture = tmp_path / "run" / "report" / "figures" / "depth_F.png"
    picture.parent.mkdir(parents=True)
    picture.write_bytes(b"a figure")
    about = found.about.model_copy(update={"machine": machine})
    return replace(
        found,
        folder=tmp_path / "run",
        config=CONFIG,
        files={**found.files, "comparisons": frame(COMPARISONS, lines)},
        about=about,
    )


@pytest.fixture
def root(result, tmp_path) -> Path:
    """A repository whose README was just written."""
    root = tmp_path / "repository"
    (root / "docs").mkdir(parents=True)
    (root / readme.SCENES).mkdir(parents=True)
    (root / readme.SCENES / "hand.toml").write_text('pose = "F"\n', "utf-8")
    for page in readme.PAGES:
        (root / page).write_text(
            "before\n<!-- table: begin -->\nstale words\n<!-- table: end -->\nafter\n", "utf-8"
        )
    readme.write(result, root)
    return root


def changed(result: results.Result, metric: str, factor: float) -> results.Result:
    """The figures of 3-FSK in one metric times `factor`."""
    table = result.table.copy()
    table.loc[(table.metric == metric) & (table.method == "3fsk"), "value"] *= factor
    return replace(result, table=table)


def test_what_was_written_is_the_results_and_not_stale(result, root):
    text, alike_text = ((root / page).read_text("utf-8") for page in readme.PAGES)
    for page in (text, alike_text):
        assert (
            page.startswith("before\n<!--")
            and page.endswith("-->\nafter\n")
            and "stale words" not in page
        )
    row = result.row("mae_mm", "3fsk", "photogrammetry")
    [mae] = [line for line in text.splitlines() if line.startswith("| MAE (mm) |")]
    assert (
        f"| **{row.value:.2f}** \\[{row.low:.2f}, {row.high:.2f}\\] *1.7* |" in mae
        and mae.count("**") == 2
    )
    assert mae.endswith("| – | – |")  # this result has no methods of ours
    sentences = [line for line in alike_text.splitlines() if line.startswith("- ")]
    assert sentences[0] == (
        "- 3-FSK and 2-FSK, on the pixels that all see: 3-FSK better by 1.0 mm unsmoothed "
        "\\[0.5, 1.5\\]; "
        "over completeness: not compared."
    )
    assert len(sentences) == 2 and "Broadband" in sentences[1]
    [alike] = [
        line
        for line in alike_text.splitlines()
        if line.startswith("| MAE on common pixels, unsmoothed (mm) |")
    ]
    equal = result.equal[
        (result.equal.metric == "mae_mm") & (result.equal.treatment == "none")
    ].set_index("method")
    assert f"| **{equal.value['3fsk']:.2f}**" in alike and alike.count("**") == 2
    assert "(fitted) *3.6*" in text and "2 cores of an an \\| odd\\_one, no GPU." in text
    assert (root / "docs" / "depth_F.png").read_bytes() == b"a figure"
    assert readme.stale(root) == readme.disagreements(result, root) == []


@pytest.mark.parametrize(
    ("file", "content", "problem"),
    [
        (
            "README.md",
            "<!-- table: begin -->\nby hand\n<!-- table: end -->\n",
            "the table is not what",
        ),
        (
            "docs/results.md",
            "<!-- table: begin -->\nby hand\n<!-- table: end -->\n",
            "the table is not what",
        ),
        ("docs/depth_F.png", "another", "docs/depth_F.png: is not the figure"),
        ("docs/depth_F.png", None, "docs/depth_F.png: is not the figure"),
        ("bench/run/benchmarks/hand.toml", 'pose = "B"\n', "hand.toml: has changed"),
        ("bench/run/benchmarks/hand.toml", None, "hand.toml: has changed"),
    ],
)
def test_each_change_of_the_repository_is_noticed(root, file, content, problem):
    (root / file).unlink() if content is None else (root / file).write_text(content, "utf-8")
    [found] = readme.stale(root)
    assert problem in found


def test_a_comment_in_a_scene_changes_nothing(root):
    (root / readme.SCENES / "hand.toml").write_text('# a note\npose = "F"\n', "utf-8")
    assert readme.stale(root) == []


def test_a_record_edited_by_hand_is_noticed(root):
    recorded = json.loads((root / "docs" / "table.json").read_text("utf-8"))
    recorded["rows"][0]["value"] *= 1.1
    (root / "docs" / "table.json").write_text(json.dumps(recorded), "utf-8")
    assert readme.stale(root) == ["README.md: the table is not what docs/table.json says"]
    recorded["equal"][0]["value"] *= 1.1
    (root / "docs" / "table.json").write_text(json.dumps(recorded), "utf-8")
    assert readme.stale(root) == [
        f"{page}: the table is not what docs/table.json says" for page in readme.PAGES
    ]


def test_a_fresh_result_that_prints_other_figures_is_noticed(result, root):
    assert readme.disagreements(changed(result, "mae_mm", 1.001), root) == []  # 1.2 µm, of 1.20 mm
    [found] = readme.disagreements(changed(result, "mae_mm", 1.1), root)
    assert found.startswith("mae_mm of 3fsk: ")
    assert readme.disagreements(changed(result, "seconds", 3.0), root) == []
    fewer = result.table[result.table.method != "2fsk"]
    assert len(readme.disagreements(replace(result, table=fewer), root)) == 6  # all but the time
    worse = result.equal.assign(value=1.1 * result.equal.value)
    assert any(
        "none" in line
        for line in readme.disagreements(
            replace(result, files={**result.files, "equal": worse}), root
        )
    )
    [found] = readme.disagreements(
        replace(result, files={**result.files, "comparisons": frame(COMPARISONS)}), root
    )
    assert found.startswith("best: ")


def test_nothing_is_written_without_what_it_needs(result, root, tmp_path):
    before = (root / "README.md").read_text("utf-8")
    with pytest.raises(HandbenchError, match="run `handbench report"):
        readme.write(replace(result, folder=tmp_path), root)
    other = write_synthetic(tmp_path / "other", ("B",), {"mine": METHODS["3fsk"]}, ("truth",))
    with pytest.raises(HandbenchError, match="has no figure of the README's table"):
        readme.write(results.load(other), root)
    assert (root / "README.md").read_text("utf-8") == before and readme.stale(root) == []
    (root / "README.md").write_text("no markers\n", "utf-8")
    with pytest.raises(HandbenchError, match="lacks its one pair of lines"):
        readme.write(result, root)
    with pytest.raises(HandbenchError, match="make it with --write"):
        readme.stale(tmp_path)


def test_the_command_line_says_what_is_stale(result_folder, monkeypatch, capsys):
    monkeypatch.setattr(readme, "stale", lambda: [])
    monkeypatch.setattr(
        readme, "disagreements", lambda result: ["mae_mm of 3fsk: 1 was recorded, 2 found"]
    )
    assert readme.main(["--check"]) == 0 and "up to date" in capsys.readouterr().out
    assert (
        readme.main([str(result_folder), "--check"]) == 1
        and "1 was recorded, 2 found" in capsys.readouterr().out
    )
    assert readme.main(["--write"]) == 2 and "RESULT: is missing" in capsys.readouterr().err
