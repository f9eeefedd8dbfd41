"""The command line as a user meets it."""

import shutil
from contextlib import suppress
from pathlib import Path

import h5py
import numpy as np
import pytest
from rich.cells import cell_len

from handbench import __main__
from handbench.bench.datasets.native import NativeCapture
from handbench.cli.main import main
from handbench.cli.options import COMMANDS
from handbench.radar.data.arrays import qar50
from handbench.radar.simulation.catalogue import EFFECTS
from tests.cli.conftest import PIXELS
from tests.refusals import refuse_command

IMAGE = "reconstruct made/capture -o out.npz --method"
REFUSALS = [  # a command line, and places of its one line; `made` is the folder of conftest.py
    ("run missing.toml -o out", "missing.toml"),
    ("run paper_tabel -o out", "'paper_table'"),
    ("run misspelt.toml -o out", "'repeat'", "'repeats'"),
    ("demo -o made", "made", "-o"),
    ("simulate missing.toml -o out", "missing.toml"),
    ("simulate made/bench/ball.toml", "-o", "--explain"),
    ("groundtruth missing -o out.ply", "missing"),
    ("groundtruth photos -o x.txt", "x.txt", ".ply"),
    ("calibrate missing -o out.json", "missing"),
    ("calibrate -o t.json", "TARGET_CAPTURE"),
    ("calibrate cap -o t.json --mesh m.ply", "--mesh", "--refine"),
    ("calibrate cap -o t.json --refine d.npz --mesh m.ply", "--refine", "target"),
    ("calibrate -o t.json --refine d.npz", "--refine", "surface"),
    ("calibrate capture -o x.txt", "x.txt", ".json"),
    ("reconstruct missing -o out.npz --method 2fsk", "missing"),
    (f"{IMAGE} 3fks", "'3fks'", "'3fsk'"),
    (f"{IMAGE} fsk3", "'fsk3'", "'3fsk'"),
    (f"{IMAGE} 3fsk --tolerance 5", "--tolerance", "5", "less than 1"),
    (f"{IMAGE} 2fsk --set treshold_db=-9", "treshold_db", "'threshold_db'"),
    (f"{IMAGE} 2fsk --check 5", "2fsk", "--check"),
    (f"{IMAGE} 2fsk --volume x.txt", "x.txt", ".npz"),
    ("reconstruct made/capture -o made/depth.npz --method 2fsk", "depth.npz", "--overwrite"),
    ("reconstruct nan -o out.npz --method 2fsk", "echoes.h5", "1 of 26508", "(0, 1, 2, 3)"),
    ("reconstruct short -o out.npz --method 2fsk", "echoes.h5", "[frame, 3, 94, 93]"),
    ("inspect missing.toml", "1 problem"),
    ("evaluate missing.npz --mesh missing.ply", "missing.npz"),
    ("evaluate made/depth.npz --mesh m.ply --plot misspelt.toml/x.png", "misspelt.toml"),
    ("evaluate made/depth.npz --mesh missing.ply", "missing.ply"),
    ("evaluate made/depth.npz --mesh m.ply --plot x.txt", "x.txt", ".png"),
    ("show missing.npz -o x.png", "missing.npz"),
    ("show made/capture -o a.html", "a.html", ".png"),
    ("show silent -o a.png", "silent", "echo"),
    ("show target -o full", "full", ".toml"),
    ("report missing -o out", "missing"),
    ("tradeoff missing.toml -o out", "missing.toml"),
    ("compare missing made -o out", "missing"),
    ("import mapping missing -o out", "missing"),
    ("list methods nothing-like-it", "nothing-like-it"),
]


@pytest.fixture(scope="module")
def wrong(made: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with what REFUSALS name."""
    folder = tmp_path_factory.mktemp("wrong")
    (folder / "made").symlink_to(made)
    bench = (made / "bench" / "small.toml").read_text().replace("repeats", "repeat")
    (folder / "misspelt.toml").write_text(bench)
    for name in ("nan", "short", "silent"):
        shutil.copytree(made / "capture", folder / name)
        with h5py.File(folder / name / "echoes.h5", "a") as file:
            if name == "nan":
                file["samples"][0, 1, 2, 3] = np.nan
            elif name == "silent":
                file["samples"][:] = 0
            else:
                del file["rx_m"]
                file["rx_m"] = qar50().rx_m[:-1]
    return folder


@pytest.mark.parametrize(("line", "places"), [(line, places) for line, *places in REFUSALS])
def test_what_is_wrong_is_one_line_and_nothing_is_written(wrong, monkeypatch, line, places):
    monkeypatch.chdir(wrong)
    files = sorted(wrong.rglob("*"))
    refuse_command(line.split(), "handbench", *places)
    assert sorted(wrong.rglob("*")) == files


def test_what_is_printed_of_a_map_is_in_its_file(made, tmp_path, capsys):
    capture, depth = made / "capture", tmp_path / "depth.npz"
    assert main(["reconstruct", str(capture), "--method", "3fsk", "-o", str(depth), *PIXELS]) == 0
    with np.load(depth) as content:
        assert content["z_m"].shape == (21, 21)
        on_target = np.isfinite(content["z_m"])
        doubted = content["wrapped"] | (content["p_gross"] > 0.5)
        doubted_percent = 100 * doubted[on_target].mean()
    printed = capsys.readouterr().err
    assert f"{on_target.sum()} pixels" in printed and f"{doubted_percent:.1f} %" in printed


@pytest.mark.slow
def test_effects_are_explained_before_and_kept_after_a_simulation(made, capsys, monkeypatch):
    monkeypatch.setattr("handbench.bench.datasets.simulated.echoes", lambda *_: 1 / 0)
    assert main(["simulate", str(made / "bench" / "ball.toml"), "--explain"]) == 0
    lines = {line.split()[0]: line for line in capsys.readouterr().out.splitlines() if line.strip()}
    names = {effect.id for effect in EFFECTS}
    assert names < set(lines)
    assert "needs [noise]" in lines["noise"]
    assert [*lines].index("on") < [*lines].index("obliquity") < [*lines].index("off")
    rows = {row.effect: row for row in NativeCapture(made / "capture").about.effects}
    assert set(rows) == {*names, "echoes"}
    on, off = rows["obliquity"], rows["noise"]
    assert on.on and "cause" in on.why and on.seconds >= 0
    assert not off.on and off.seconds is None and "needs [noise]" in off.why


def test_the_volume_is_written_and_checked_against_the_exact_sum(
    made, tmp_path, capsys, monkeypatch
):
    with np.load(made / "volume.npz") as content:
        assert content["volume"].shape == (6, 21, 21) and content["volume"].dtype == np.complex64
        assert content["z_m"][0] == 0.275
    given = "--method narrowband --set=z.start_m=0.275 --set=z.stop_m=0.285 --tolerance 1e-3"
    command = ["reconstruct", str(made / "capture"), *given.split(), *PIXELS, "--check", "50"]
    assert main([*command, "-o", str(tmp_path / "depth.npz")]) == 0
    assert "checked at 50 random voxels" in capsys.readouterr().err
    monkeypatch.setattr("handbench.radar.imaging.exact.imaging_error", lambda *_: 0.01)
    assert main([*command, "-o", str(tmp_path / "another.npz")]) == 2
    error = capsys.readouterr().err.splitlines()[-1]
    assert "relative error is 1.0e-02" in error and "at most 0.001" in error


def test_no_memory_is_one_line_and_leaves_nothing(made, tmp_path, monkeypatch):
    def stop(*arguments, **keywords):
        raise MemoryError("7 GB")

    monkeypatch.setattr(np.lib.format, "write_array", stop)
    command = ["reconstruct", str(made / "capture"), "--method", "2fsk", *PIXELS]
    refuse_command([*command, "-o", str(tmp_path / "depth.npz")], "7 GB")
    assert not list(tmp_path.iterdir())


def test_an_interrupt_while_the_command_line_is_imported_is_one_line(monkeypatch, capsys):
    def stop():
        raise KeyboardInterrupt

    monkeypatch.setattr("handbench.cli.main.main", stop)
    assert __main__.main() == 130 and capsys.readouterr().err.count("\n") == 1


@pytest.mark.parametrize(
    ("given", "words"),
    [
        ("", ("3fsk", "mae_mm", "paper_table", "noise", "touchstone")),
        ("methods 3fsk", ("tones_hz = [82e9, 81.8e9, 79.5e9]",)),
        ("metrics mae_mm", ("|z − z_ref|",)),
        ("effects noise", ("thermal",)),
    ],
)
def test_list_has_a_line_for_each_thing_and_each_thing_in_full(given, words, capsys):
    assert main(["list", *given.split()]) == 0
    listing = capsys.readouterr().out
    assert all(word in listing for word in words)


@pytest.mark.parametrize(
    "line", ["list", "list methods 3fsk", "doctor", *(f"{command} --help" for command in COMMANDS)]
)
def test_a_command_prints_lines_of_at_most_eighty_columns(line, capsys, monkeypatch):
    monkeypatch.setenv("COLUMNS", "80")
    with suppress(SystemExit):  # argparse's own, after the help
        main(line.split())
    lines = capsys.readouterr().out.splitlines()
    assert lines and max(map(cell_len, lines)) <= 80
    assert line != "doctor" or len(lines) <= 24  # a screen
