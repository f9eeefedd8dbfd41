"""The public face, `import handbench as hb`: a script of a few lines, on files that the commands
made."""

from __future__ import annotations

import copy
import json
import os
import pickle
import subprocess
import sys
from importlib.metadata import version
from pathlib import Path

import numpy as np
import pytest

import handbench as hb
from handbench.cli.main import main
from handbench.radar.data.depthmap import DepthMap
from tests.installed_copy import ROOMS
from tests.reports.synthetic_result import write_synthetic
from tests.small_benchmark import write_bench

ROOT = Path(__file__).parents[1]
PIXELS = {axis: {"start_m": -0.01, "stop_m": 0.01} for axis in "xy"}
SET = [
    f"--set={axis}.{end}={value}" for axis, ends in PIXELS.items() for end, value in ends.items()
]


@pytest.fixture(scope="module")
def ball(tmp_path_factory) -> hb.Capture:
    """The capture of a small ball, simulated by the face itself."""
    bench = write_bench(tmp_path_factory.mktemp("face") / "bench")
    return hb.simulate(bench.parent / "ball.toml", bench.parent / "capture")


def test_a_script_of_six_lines_loads_images_scores_and_draws(ball, tmp_path):
    script = f"""import handbench as hb
ball = hb.load({str(ball.folder)!r})
depth = ball.reconstruct("3fsk", x={PIXELS["x"]}, y={PIXELS["y"]})
score = depth.evaluate()
print(score["mae_mm"])
score.plot("errors.png")
"""
    done = subprocess.run(
        [sys.executable, "-c", script], cwd=tmp_path, env=_env(), capture_output=True, text=True
    )
    assert done.returncode == 0, done.stderr
    assert float(done.stdout) < 1.0  # as `handbench evaluate` on the same ball, in tests/cli
    assert (tmp_path / "errors.png").read_bytes().startswith(b"\x89PNG")


@pytest.mark.parametrize("kind", ["files", "folders"])
def test_a_script_works_beside_files_and_folders_named_as_ours_were(ball, tmp_path, kind):
    """Version 0.2 installed packages of these five names, so that such a file hid one of them."""
    for name in ROOMS:
        if kind == "files":
            (tmp_path / f"{name}.py").write_text("raise RuntimeError('the user's own file')")
        else:
            (tmp_path / name).mkdir()
            (tmp_path / name / "__init__.py").write_text(
                "raise RuntimeError('the user's own package')"
            )
    write_synthetic(tmp_path / "result", step_m=6e-3)
    (tmp_path / "script.py").write_text(f"""import handbench as hb
from handbench.cli.main import main
depth = hb.load({str(ball.folder)!r}).reconstruct("3fsk", x={PIXELS["x"]}, y={PIXELS["y"]})
print(depth.evaluate()["mae_mm"])
assert main(["report", "result", "-o", "report"]) == 0
""")
    command = [sys.executable, "script.py"]
    done = subprocess.run(command, cwd=tmp_path, env=_env(), capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert float(done.stdout.split()[0]) < 1.0 and (tmp_path / "report" / "index.html").is_file()


def test_the_package_of_the_ground_truth_can_be_called_as_the_function_of_version_0_2(tmp_path):
    with pytest.raises(hb.HandbenchError, match="photos"):
        hb.groundtruth(tmp_path / "photos")
    with pytest.raises(hb.HandbenchError, match="photos"):
        hb.reconstruct_mesh(tmp_path / "photos")


def test_importing_loads_the_standard_library_alone():
    code = (
        "import sys; before = set(sys.modules); import handbench; print(*set(sys.modules) - before)"
    )
    found = subprocess.run(
        [sys.executable, "-c", code], env=_env(), capture_output=True, text=True, check=True
    ).stdout
    assert {name.partition(".")[0] for name in found.split()} - set(sys.stdlib_module_names) == {
        "handbench"
    }


def test_maps_and_figures_are_those_of_the_commands(ball, tmp_path, capsys):
    depth = ball.reconstruct("2fsk", **PIXELS)
    file = tmp_path / "depth.npz"
    assert main(["reconstruct", str(ball.folder), "--method", "2fsk", "-o", str(file), *SET]) == 0
    ours, theirs = depth.map, hb.load(file).map
    assert isinstance(theirs, DepthMap) and theirs.config == ours.config
    for name in ("z_m", "amplitude_db", "sigma_m", "p_gross"):
        np.testing.assert_array_equal(getattr(ours, name), getattr(theirs, name))
    assert main(["evaluate", str(file), "--mesh", str(ball.truth)]) == 0
    told = json.loads(capsys.readouterr().out)
    assert {name: told[name] for name in depth.evaluate()} == depth.evaluate().values


def test_a_depth_map_is_drawn_saved_and_turned_into_points(ball, tmp_path):
    depth = ball.reconstruct("2fsk", **PIXELS)
    assert "2fsk: 21 × 21 pixels" in repr(depth)
    assert depth._repr_png_().startswith(b"\x89PNG") and depth.evaluate()._repr_png_().startswith(
        b"\x89PNG"
    )
    for suffix in ("pdf", "svg"):
        depth.plot(tmp_path / f"depth.{suffix}")
        assert (tmp_path / f"depth.{suffix}").stat().st_size > 1000
    points = np.asarray(depth.to_pointcloud().points)
    assert len(points) == np.isfinite(depth.z_m).sum() > 0
    np.testing.assert_array_equal(points[:, 2], depth.z_m[np.isfinite(depth.z_m)])
    for other in (copy.deepcopy(depth.map), pickle.loads(pickle.dumps(hb.Depth(depth.map))).map):
        np.testing.assert_array_equal(other.z_m, depth.z_m)
    depth.save(tmp_path / "saved.npz")
    assert repr(hb.load(tmp_path / "saved.npz")) == repr(depth)


def test_a_dataset_of_xarray_has_the_maps_over_their_axes(ball):
    found = ball.reconstruct("2fsk", **PIXELS).to_xarray()
    assert found.z_m.dims == ("y_m", "x_m") and {
        "z_m",
        "amplitude_db",
        "sigma_m",
        "p_gross",
    } <= set(found)
    assert found.attrs["method"] == "2fsk"


def test_load_knows_files_by_what_they_are(ball, tmp_path):
    write_synthetic(tmp_path / "result", step_m=6e-3)
    (tmp_path / "T.json").write_text(
        json.dumps({"from": "photo", "to": "radar", "matrix": np.eye(4).tolist()})
    )
    found = [
        hb.load(path)
        for path in (ball.folder, ball.truth, tmp_path / "result", tmp_path / "T.json")
    ]
    assert [type(one) for one in found] == [hb.Capture, hb.Surface, hb.Result, hb.Transform]
    assert not found[2].table.empty
    assert (
        repr(found[2])
        == "<handbench.Result synthetic: 8 captures; 2fsk, 3fsk, broadband, narrowband>"
    )
    assert "ball: 1 frames, 3 tones from 79.5 to 82 GHz, 94 × 94 channels" in repr(found[0])


def test_mistakes_are_told_in_a_sentence(ball, tmp_path):
    depth = ball.reconstruct("2fsk", **PIXELS)
    with pytest.raises(hb.HandbenchError, match="no capture"):
        hb.load(tmp_path)
    with pytest.raises(hb.HandbenchError, match="frames 0 to 0"):
        ball.reconstruct("2fsk", frame=1)
    with pytest.raises(hb.HandbenchError, match="toleranec"):
        ball.reconstruct("2fsk", toleranec=1e-3)
    with pytest.raises(hb.HandbenchError, match="name a mesh file"):
        hb.Depth(depth.map).evaluate()
    with pytest.raises(hb.HandbenchError, match=r"ends in \.png"):
        depth.plot(tmp_path / "depth.gif")
    with pytest.raises(hb.HandbenchError, match="exists already"):
        hb.simulate(ball.folder.parent / "ball.toml", ball.folder)
    with pytest.raises(
        hb.HandbenchError, match="name a mesh file"
    ):  # the truth lies in the radar's frame already
        depth.evaluate(transform=hb.Transform("photo", "radar", np.eye(4)))
    with pytest.raises(AttributeError, match="no attribute"):
        _ = hb.nothing


def test_everything_that_it_names_is_there():
    assert set(dir(hb)) == set(hb.__all__)
    assert all(getattr(hb, name).__doc__ for name in hb.__all__)
    assert "3fsk" in hb.methods()


def test_the_module_is_the_command(tmp_path):
    command = [sys.executable, "-m", "handbench", "--version"]
    done = subprocess.run(
        command, env=_env(), cwd=tmp_path, capture_output=True, text=True, check=True
    )
    assert done.stdout == f"handbench {version('handbench')}\n"


def _env() -> dict[str, str]:
    return {**os.environ, "PYTHONPATH": str(ROOT)}
