"""The command line as a user meets it."""

import json
import re
import subprocess
import sys
from pathlib import Path

import h5py
import numpy as np
import pytest

from handbench.bench.datasets.native import NativeCapture
from handbench.cli.main import FORMER, main
from handbench.cli.options import COMMANDS, declared_commands
from handbench.radar.data.arrays import qar50
from handbench.radar.data.capture import RadarCapture
from handbench.radar.data.echoes_file import save_capture
from handbench.radar.simulation.known_effects import IDS

LATERAL = [
    "--set",
    "x.start_m=-0.01",
    "--set",
    "x.stop_m=0.01",
    "--set",
    "y.start_m=-0.01",
    "--set",
    "y.stop_m=0.01",
]


@pytest.fixture
def capture(small_bench, tmp_path) -> Path:
    """A capture folder made by the command itself."""
    assert (
        main(["simulate", str(small_bench.parent / "ball.toml"), "-o", str(tmp_path / "capture")])
        == 0
    )
    return tmp_path / "capture"


def fails(capsys, arguments: list[str], *words: str) -> None:
    """The command ends with exit code 2 and one line that holds the words."""
    assert main(arguments) == 2
    error = capsys.readouterr().err.strip().splitlines()[-1]
    assert error.startswith("handbench: ")
    for word in words:
        assert word in error


def test_capture_to_metrics(capture, tmp_path, capsys):
    depth = tmp_path / "depth.npz"
    assert main(["reconstruct", str(capture), "--method", "3fsk", "-o", str(depth), *LATERAL]) == 0
    assert main(["evaluate", str(depth), "--mesh", str(capture / "truth.ply")]) == 0
    metrics = json.loads(capsys.readouterr().out)
    assert (
        metrics["mae_mm"] < 1.0
    )  # noise-free, near the axis of a sphere: what is left are the averaging filters
    assert metrics["definitions"]["mae_mm"]
    with np.load(depth, allow_pickle=False) as content:
        assert content["z_m"].shape == (21, 21)


def test_explaining_simulates_nothing(small_bench, tmp_path, capsys, monkeypatch):
    monkeypatch.setattr("handbench.bench.datasets.simulated.echoes", lambda *_: 1 / 0)
    scene = small_bench.parent / "ball.toml"
    assert main(["simulate", str(scene), "--explain"]) == 0
    lines = {line.split()[0]: line for line in capsys.readouterr().out.splitlines() if line.strip()}
    assert set(IDS) < set(lines)
    assert "on" in lines["obliquity"].split() and "needs [noise]" in lines["noise"]
    assert not list(tmp_path.glob("out*"))
    fails(capsys, ["simulate", str(scene)], "-o", "--explain")


def test_a_simulated_capture_says_what_its_echoes_show(capture):
    rows = {row.effect: row for row in NativeCapture(capture).about.effects}
    assert set(rows) == {*IDS, "echoes"}
    assert (
        rows["obliquity"].on
        and "of the time" in rows["obliquity"].why
        and rows["obliquity"].seconds >= 0
    )
    assert (
        not rows["noise"].on
        and rows["noise"].seconds is None
        and "needs [noise]" in rows["noise"].why
    )


def test_volume_is_written_on_request(capture, tmp_path):
    files = tmp_path / "depth.npz", tmp_path / "volume.npz"
    depths = ["--set", "z.start_m=0.275", "--set", "z.stop_m=0.285", "--exact"]
    command = [
        "reconstruct",
        str(capture),
        "--method",
        "narrowband",
        "-o",
        str(files[0]),
        "--volume",
        str(files[1]),
    ]
    assert main([*command, *LATERAL, *depths]) == 0
    with np.load(files[1], allow_pickle=False) as content:
        assert content["volume"].shape == (11, 21, 21)
        assert content["volume"].dtype == np.complex64
        assert content["z_m"][0] == 0.275


def test_a_volume_is_checked_against_the_exact_sum_on_request(
    capture, tmp_path, capsys, monkeypatch
):
    out = tmp_path / "depth.npz"
    command = [
        "reconstruct",
        str(capture),
        "--method",
        "narrowband",
        "-o",
        str(out),
        *LATERAL,
        "--check",
        "50",
    ]
    assert main([*command, "--tolerance", "1e-3"]) == 0
    assert "checked at 50 random voxels" in capsys.readouterr().err
    monkeypatch.setattr("handbench.cli.reconstruct.imaging_error", lambda *_: 0.01)
    fails(
        capsys,
        [*command, "--tolerance", "1e-3", "--overwrite"],
        "relative error is 1.0e-02",
        "at most 0.001",
    )
    flat = [
        "reconstruct",
        str(capture),
        "--method",
        "2fsk",
        "-o",
        str(tmp_path / "flat.npz"),
        "--check",
        "5",
    ]
    fails(capsys, flat, "makes no volume")


def test_a_tolerance_relative_to_the_image_is_certified(capture, tmp_path, capsys, monkeypatch):
    monkeypatch.setattr(
        "handbench.radar.imaging.certificate.FACTOR", 10.0
    )  # so that the tolerance as asked is not enough
    command = [
        "reconstruct",
        str(capture),
        "--method",
        "narrowband",
        *LATERAL,
        "--set",
        "z.start_m=0.2",
    ]
    command += ["--set", "z.stop_m=0.21", "--tolerance", "1e-2"]
    bounds = []
    for relative_to in ("samples", "image"):
        assert (
            main(
                [*command, "-o", str(tmp_path / f"{relative_to}.npz"), "--relative-to", relative_to]
            )
            == 0
        )
        said = capsys.readouterr().err
        bounds.append(float(said.strip().splitlines()[-1].rsplit(maxsplit=1)[-1]))
    assert bounds[0] > 1e-2 >= bounds[1] and "imaging anew, to 0.001" in said


def test_outputs_are_not_overwritten_silently(capture, tmp_path, capsys):
    out = tmp_path / "depth.npz"
    out.write_text("mine")
    fails(
        capsys,
        ["reconstruct", str(capture), "--method", "2fsk", "-o", str(out)],
        "exists already",
        "--overwrite",
    )
    assert out.read_text() == "mine"


def test_unknown_names_are_met_with_a_suggestion(capture, small_bench, tmp_path, capsys):
    out = ["-o", str(tmp_path / "out")]
    depth = ["-o", str(tmp_path / "out.npz")]
    fails(capsys, ["reconstruct", str(capture), "--method", "3fks", *depth], "'3fks'", "'3fsk'")
    wrong = ["--set", "treshold_db=-9"]
    fails(
        capsys,
        ["reconstruct", str(capture), "--method", "2fsk", *wrong, *depth],
        "treshold_db",
        "'threshold_db'",
    )
    fails(capsys, ["run", "paper_tabel", *out], "'paper_table'")
    small_bench.write_text(small_bench.read_text().replace("repeats", "repeat"))
    fails(capsys, ["run", str(small_bench), *out], "repeat", "'repeats'")
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    "command", ["run", "simulate", "groundtruth", "calibrate", "reconstruct", "evaluate"]
)
def test_missing_inputs_are_named(command, tmp_path, capsys):
    missing = str(tmp_path / "nowhere.toml")
    suffix = {"groundtruth": ".ply", "calibrate": ".json", "reconstruct": ".npz"}.get(command, "")
    arguments = [command, missing, "-o", str(tmp_path / f"out{suffix}")]
    arguments = [command, missing, "--mesh", missing] if command == "evaluate" else arguments
    arguments += ["--method", "2fsk"] if command == "reconstruct" else []
    fails(capsys, arguments, missing, "expected")
    assert not list(tmp_path.iterdir())


def test_nan_in_the_echoes_and_wrong_sizes_are_named(capture, tmp_path, capsys):
    with h5py.File(capture / "echoes.h5", "a") as file:
        file["samples"][0, 1, 2, 3] = np.nan
    command = ["reconstruct", str(capture), "--method", "2fsk", "-o", str(tmp_path / "depth.npz")]
    fails(capsys, command, "echoes.h5", "1 of 26508", "(0, 1, 2, 3)")
    with h5py.File(capture / "echoes.h5", "a") as file:
        del file["rx_m"]
        file["rx_m"] = qar50().rx_m[:-1]
    fails(capsys, command, "echoes.h5", "expected [frame, 3, 94, 93]")


def test_full_disk_is_one_line_and_leaves_nothing(capture, tmp_path, capsys, monkeypatch):
    def full(*arguments, **keywords):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(np.lib.format, "write_array", full)
    out = tmp_path / "results"
    out.mkdir()
    command = [
        "reconstruct",
        str(capture),
        "--method",
        "2fsk",
        "-o",
        str(out / "depth.npz"),
        *LATERAL,
    ]
    fails(capsys, command, "No space left on device")
    assert list(out.iterdir()) == []


def test_interrupt_is_one_line(capture, tmp_path, capsys, monkeypatch):
    def interrupt(*arguments):
        raise KeyboardInterrupt

    monkeypatch.setattr("handbench.cli.simulate.run", interrupt)
    assert main(["simulate", "x.toml", "-o", str(tmp_path / "out")]) == 130
    assert capsys.readouterr().err.startswith("handbench: interrupted")


def test_inspect_reports_every_problem(capture, small_bench, tmp_path, capsys):
    assert main(["inspect", str(capture), str(small_bench), "paper_table"]) == 0
    broken = tmp_path / "broken"
    broken.mkdir()
    save_capture(
        broken / "echoes.h5",
        RadarCapture(np.ones((1, 1, 94, 94), np.complex64), np.ones(1), qar50()),
    )
    capsys.readouterr()
    assert main(["inspect", str(broken), str(tmp_path / "missing.toml")]) == 2
    said = capsys.readouterr()
    assert [line.split(": ")[0] for line in said.out.splitlines()] == [
        str(broken / "capture.toml"), str(broken / "echoes.h5"), str(broken), str(tmp_path / "missing.toml")
    ]  # fmt: skip
    # 1 Hz is suspect
    last = "handbench: inspect: 2 problems, 2 warnings, 2 inputs; what is wrong is listed above"
    assert said.err.strip() == last


def test_list_and_doctor_speak(capsys):
    assert main(["list"]) == 0
    listing = capsys.readouterr().out
    assert "broadband" in listing and "paper_table" in listing and "threshold_db" in listing
    assert main(["doctor"]) == 0
    assert "CUDA" in capsys.readouterr().out


@pytest.mark.parametrize(
    "command", [[], ["run"], ["simulate"], ["groundtruth"], ["reconstruct"], ["report"]]
)
def test_help_imports_nothing_heavy(command):
    heavy = ["numpy", "open3d", "pycolmap", "cv2", "numba", "matplotlib", "pandas"]
    script = (
        "import sys\nfrom handbench.cli.main import parser\n"
        f"try: parser().parse_args({[*command, '--help']!r})\nexcept SystemExit: pass\n"
        f"sys.exit(', '.join(m for m in {heavy!r} if m in sys.modules) or None)"
    )
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr


@pytest.mark.parametrize("command", FORMER)
def test_a_former_command_names_its_successor(command, capsys):
    assert main([command, "anything", "--overwrite"]) == 2
    [line] = capsys.readouterr().err.splitlines()
    assert line == f"handbench: {command!r} is now {FORMER[command]}"
    assert command not in declared_commands(COMMANDS)
    for successor in re.findall(r"'handbench ([a-z-]+)", FORMER[command]):
        assert successor in declared_commands(COMMANDS)
