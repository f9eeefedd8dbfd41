"""The typed commands: a foreign method is run on a benchmark, checked, scored beside our own, and ranked."""

import shutil
import sys

import numpy as np
import pandas as pd
import pytest

from handbench.bench.results import load
from handbench.bench.submissions.submission import DEPTHS, load_submission
from handbench.cli.main import main
from handbench.radar.data.depthmap import load_depthmap
from tests.small_benchmark import write_bench
from tests.test_docs import DOCS, blocks

FLAT_M = 0.2825  # of the foreign method's answer, whatever it sees
PROGRAM = f"""
import sys
import numpy as np
x = y = np.linspace(-0.02, 0.02, 21)
z = np.where(np.hypot(*np.meshgrid(x, y)) < 0.015, {FLAT_M}, np.nan)
np.savez(sys.argv[2], x_m=x, y_m=y, z_m=z, amplitude_db=-1e3 * np.hypot(*np.meshgrid(x, y)))
"""


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A benchmark of a captured ball, and a submission made for it."""
    folder = tmp_path_factory.mktemp("entering")
    scenes = write_bench(folder / "scenes").parent
    assert main(["simulate", str(scenes / "ball.toml"), "-o", str(folder / "ball")]) == 0
    text = (scenes / "small.toml").read_text().replace('scene = "ball.toml"', 'path = "ball"\nmeasures = ["accuracy"]')
    (folder / "bench.toml").write_text(text.replace("precision = true\n", "").replace("phase_noise_rad = 0.03\n", ""))
    (folder / "mine.py").write_text(PROGRAM)
    assert main(submit(folder)) == 0
    return folder


def submit(folder):
    command = f"{sys.executable} {folder / 'mine.py'} {{capture}} {{depth}}"
    return ["submit", str(folder / "bench.toml"), "--command", command, "--name", "mine", "-o", str(folder / "sub")]


def test_it_is_scored_beside_our_own_and_ranked(folder, capsys):
    bench, sub, result = (str(folder / name) for name in ("bench.toml", "sub", "result"))
    assert main(["submit", bench, "--check", sub]) == 0
    assert main(["evaluate-submission", sub, bench, "-o", result]) == 0
    table = load(result).table
    x_m = np.linspace(-0.02, 0.02, 21)
    beside_m = np.hypot(*np.meshgrid(x_m, x_m))
    near_m = 0.30 - np.sqrt(0.02**2 - np.minimum(beside_m, 0.015) ** 2)  # the ball: nothing of ours
    expected_mm = 1e3 * np.abs(FLAT_M - near_m)[beside_m < 0.015].mean()
    [mae_mm] = table[(table.method == "mine") & (table.metric == "mae_mm")].value
    assert mae_mm == pytest.approx(expected_mm, abs=0.03)  # the ball's mesh has 40 rings: flat by up to 0.03 mm
    [seconds] = table[(table.method == "mine") & (table.metric == "seconds")].value
    assert seconds == load_submission(sub)[1]["ball"].seconds
    assert set(load(result).equal.method) == {"2fsk", "narrowband", "mine"}  # on common pixels, treated alike
    assert main(["leaderboard", result, "-o", str(folder / "board")]) == 0
    text = (folder / "board" / "leaderboard.md").read_text()
    assert "| mine | echoes (submitted, time of the whole command) |" in text and "too few captures to test" in text
    values = pd.read_csv(folder / "result" / "equal.csv").query("metric == 'aurc_mm' and treatment == 'window'")
    by_value = values.sort_values("value").method
    titles = {"2fsk": "2-FSK", "narrowband": "narrowband", "mine": "mine"}
    places = [text.index(f"| {titles[method]} |") for method in by_value]
    assert places == sorted(places) and (folder / "board" / "report" / "index.html").is_file()
    capsys.readouterr()


def test_a_second_try_runs_nothing_again_and_another_command_is_refused(folder, capsys):
    before = (folder / "sub" / "maps" / "ball.npz").stat().st_mtime_ns
    assert main(submit(folder)) == 0
    assert (folder / "sub" / "maps" / "ball.npz").stat().st_mtime_ns == before
    assert main([*submit(folder)[:3], "other {capture} {depth}", *submit(folder)[4:]]) == 2
    said = capsys.readouterr().err
    assert "1 depth maps are kept" in said and "holds a submission of another command" in said
    assert main([*submit(folder), "--own-seconds"]) == 2 and "timing" in capsys.readouterr().err
    (folder / "mine.py").write_text(PROGRAM.replace("0.015", "0.014"))
    assert main([*submit(folder), "--overwrite"]) == 0
    assert (folder / "sub" / "maps" / "ball.npz").stat().st_mtime_ns > before


def test_a_submission_with_a_hole_is_refused_in_words(folder, tmp_path, capsys):
    lines = (folder / "sub" / DEPTHS).read_text().splitlines()
    (tmp_path / "submission.toml").write_bytes((folder / "sub" / "submission.toml").read_bytes())
    (tmp_path / DEPTHS).write_text(lines[0] + "\n")
    assert main(["evaluate-submission", str(tmp_path), str(folder / "bench.toml"), "-o", str(tmp_path / "r")]) == 2
    said = capsys.readouterr().err
    assert "1 of 1 captures are missing: ball" in said and "cannot be scored" in said and not (tmp_path / "r").exists()


def test_a_name_of_our_own_and_scenes_are_refused(folder, tmp_path, capsys):
    bench = str(folder / "bench.toml")
    command = submit(folder)
    assert main([*command[:5], "3fsk", "-o", str(tmp_path / "s")]) == 2
    assert "expected a name of your own" in capsys.readouterr().err
    shutil.copytree(folder / "sub", tmp_path / "s")
    about = tmp_path / "s" / "submission.toml"
    about.write_text(about.read_text().replace('"mine"', '"3fsk"'))
    assert main(["submit", bench, "--check", str(tmp_path / "s")]) == 2
    assert "'3fsk' is one of handbench's own methods" in capsys.readouterr().err
    twice = ["evaluate-submission", str(folder / "sub"), str(folder / "sub"), bench, "-o", str(tmp_path / "r")]
    assert main(twice) == 2 and "two submissions are of a method 'mine'" in capsys.readouterr().err
    scenes = str(folder / "scenes" / "small.toml")
    assert main([command[0], scenes, *command[2:6], "-o", str(tmp_path / "t")]) == 2
    assert "which nobody has simulated" in capsys.readouterr().err
    assert main(["submit", bench, "--name", "x"]) == 2 and "one is missing" in capsys.readouterr().err


def test_the_page_s_method_finds_the_ball(folder, tmp_path, capsys):
    """Its 2-FSK in NumPy, on fewer pixels, against the sphere itself: at the glint: 30 mm behind the plane
    imaged, where the path's slope, taken as 2, is up to 3 % smaller before this array."""
    [code] = blocks(DOCS / "submissions.md", "python")
    fewer = "np.arange(-20, 21, 2)"
    (tmp_path / "page.py").write_text(code.replace("np.arange(-150, 151)", fewer))
    command = f"{sys.executable} {tmp_path / 'page.py'} {{capture}} {{depth}}"
    words = ["submit", str(folder / "bench.toml"), "--command", command, "--name", "page", "--own-seconds"]
    assert fewer in (tmp_path / "page.py").read_text() and main([*words, "-o", str(tmp_path / "sub")]) == 0
    depth = load_depthmap(tmp_path / "sub" / "maps" / "ball.npz")
    assert depth.z_m[10, 10] == pytest.approx(0.28, abs=1e-3)
    capsys.readouterr()


def test_a_benchmark_may_list_a_submission(folder, capsys):
    text = (folder / "bench.toml").read_text()
    (folder / "listed.toml").write_text(f'{text}\n[[method]]\nid = "mine"\nsubmission = "sub"\n')
    assert main(["validate", str(folder / "listed.toml")]) == 0
    (folder / "listed.toml").write_text(f'{text}\n[[method]]\nid = "mine"\nsubmission = "../sub"\n')
    assert main(["validate", str(folder / "listed.toml")]) == 2
    assert "leaves the folder" in capsys.readouterr().out


def test_a_board_needs_two_methods(folder, tmp_path, capsys):
    alone = (folder / "bench.toml").read_text()
    first, second = alone.index("[[method]]"), alone.rindex("[[method]]")
    (folder / "one.toml").write_text(alone[:first] + alone[second:])
    assert main(["run", str(folder / "one.toml"), "-o", str(tmp_path / "r")]) == 0
    assert main(["leaderboard", str(tmp_path / "r"), "-o", str(tmp_path / "b")]) == 2
    assert "expected two or more" in capsys.readouterr().err
