"""The public face, `import handbench as hb`: a script of a few lines, on files that the commands
made."""

from __future__ import annotations

import copy
import json
import os
import pickle
import subprocess
import sys
from dataclasses import replace
from importlib.metadata import version
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

import handbench as hb
from handbench.cli.main import main
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


@pytest.fixture(scope="module")
def depth(ball) -> hb.Depth:
    """Its map by 2-FSK."""
    return ball.reconstruct("2fsk", **PIXELS)


def python(*words, cwd=None):
    """What a Python process prints."""
    env = {**os.environ, "PYTHONPATH": str(ROOT)}
    done = subprocess.run(
        [sys.executable, *words], cwd=cwd, env=env, capture_output=True, text=True
    )
    assert done.returncode == 0, done.stderr
    return done.stdout


@pytest.mark.slow
def test_a_script_loads_images_scores_and_draws_beside_files_named_as_ours_were(ball, tmp_path):
    for name in ROOMS:
        (tmp_path / f"{name}.py").write_text("raise RuntimeError('the user's own file')")
    (tmp_path / "script.py").write_text(f"""import handbench as hb
ball = hb.load({str(ball.folder)!r})
depth = ball.reconstruct("3fsk", x={PIXELS["x"]}, y={PIXELS["y"]})
score = depth.evaluate()
print(score["mae_mm"])
score.plot("errors.png")
""")
    # as `handbench evaluate` on the same ball, in tests/cli
    assert float(python("script.py", cwd=tmp_path)) < 1.0
    assert (tmp_path / "errors.png").read_bytes().startswith(b"\x89PNG")


def test_importing_loads_the_standard_library_alone():
    code = "import sys; before = {*sys.modules}; import handbench; print(*{*sys.modules} - before)"
    found = {name.partition(".")[0] for name in python("-c", code).split()}
    assert found - set(sys.stdlib_module_names) == {"handbench"}


def test_the_module_is_the_command(tmp_path):
    printed = python("-m", "handbench", "--version", cwd=tmp_path)
    assert printed == f"handbench {version('handbench')}\n"


def test_maps_and_figures_are_those_of_the_commands(ball, depth, tmp_path, capsys):
    file = tmp_path / "depth.npz"
    assert main(["reconstruct", str(ball.folder), "--method", "2fsk", "-o", str(file), *SET]) == 0
    ours, theirs = depth.map, hb.load(file).map
    assert theirs.config == ours.config
    for name in ("z_m", "amplitude_db", "sigma_m", "p_gross"):
        np.testing.assert_array_equal(getattr(ours, name), getattr(theirs, name))
    assert main(["evaluate", str(file), "--mesh", str(ball.truth)]) == 0
    printed = json.loads(capsys.readouterr().out)
    assert {name: printed[name] for name in depth.evaluate()} == depth.evaluate().values


def test_a_stream_images_frames_as_they_arrive(ball):
    """Depths are those of the capture's frame: plans in place of exact sums move the last tone's
    phases by the tolerance, 1e-5, of ±30 mm."""
    echoes, expected = ball.echoes, ball.reconstruct("3fsk", **PIXELS)
    samples, tones_hz = echoes.samples[0], echoes.frequencies_hz
    in_order = [tones_hz.tolist().index(hz) for hz in (82e9, 81.8e9, 79.5e9)]
    for given, live in (
        (samples, hb.stream("3fsk", echoes.aperture, tones_hz, **PIXELS)),
        (samples[in_order], hb.stream("3fsk", echoes.aperture, **PIXELS)),
    ):
        for _ in range(2):
            depth = live(given)
            np.testing.assert_allclose(depth.z_m, expected.z_m, rtol=0, atol=1e-6)
            np.testing.assert_allclose(depth.sigma_m, expected.sigma_m, rtol=1e-2)
    with pytest.raises(hb.HandbenchError, match=r"samples: have shape \(1, 2, 94, 94\)"):
        live(samples[:2])


def test_a_depth_map_is_drawn_saved_and_turned_into_points(depth, tmp_path):
    assert "2fsk: 21 × 21 pixels" in repr(depth)
    for drawn in (depth, depth.evaluate()):
        assert drawn._repr_png_().startswith(b"\x89PNG")
    for suffix in ("pdf", "svg"):
        depth.plot(tmp_path / f"depth.{suffix}")
        assert (tmp_path / f"depth.{suffix}").stat().st_size > 1000
    np.testing.assert_array_equal(depth.points_m()[:, 2], depth.z_m[np.isfinite(depth.z_m)])
    for other in (copy.deepcopy(depth.map), pickle.loads(pickle.dumps(hb.Depth(depth.map))).map):
        np.testing.assert_array_equal(other.z_m, depth.z_m)
    depth.save(tmp_path / "saved.npz")
    assert repr(hb.load(tmp_path / "saved.npz")) == repr(depth)


def test_load_knows_files_by_what_they_are(ball, tmp_path):
    write_synthetic(tmp_path / "result", step_m=6e-3)
    matrix = {"from": "photo", "to": "radar", "matrix": np.eye(4).tolist()}
    (tmp_path / "T.json").write_text(json.dumps(matrix))
    places = ball.folder, ball.truth, tmp_path / "result", tmp_path / "T.json"
    found = [hb.load(path) for path in places]
    assert [type(one) for one in found] == [hb.Capture, hb.Surface, hb.RunResult, hb.Transform]
    assert not found[2].table.empty
    assert "<handbench.RunResult synthetic: 5 captures" in repr(found[2])
    assert "ball: 1 frames, 3 tones from 79.5 to 82 GHz, 94 × 94 channels" in repr(found[0])


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (lambda ball, depth, folder: hb.load(folder), "not a capture"),
        (lambda ball, depth, folder: ball.reconstruct("2fsk", frame=1), "frames 0 to 0"),
        (lambda ball, depth, folder: ball.reconstruct("2fsk", toleranec=1e-3), "toleranec"),
        (
            lambda ball, depth, folder: hb.Depth(depth.map).evaluate(),
            "pass the path of a mesh file",
        ),
        (lambda ball, depth, folder: depth.plot(folder / "depth.gif"), r"ends in \.png"),
        (
            lambda ball, depth, folder: hb.simulate(ball.folder.parent / "ball.toml", ball.folder),
            "exists already",
        ),
        (  # the truth lies in the radar's frame already
            lambda ball, depth, folder: depth.evaluate(
                transform=hb.Transform("photo", "radar", np.eye(4))
            ),
            "pass the path of a mesh file",
        ),
    ],
)
def test_a_mistake_is_one_sentence(ball, depth, tmp_path, call, words):
    with pytest.raises(hb.HandbenchError, match=words):
        call(ball, depth, tmp_path)


@pytest.fixture(scope="module")
def synthetic(tmp_path_factory) -> hb.RunResult:
    """A result of five captures, with errors of a second frame, 1 mm larger."""
    folder = tmp_path_factory.mktemp("synthetic")
    found = hb.load(write_synthetic(folder, step_m=6e-3))
    second = found.scores[found.scores.metric == "mae_mm"].assign(frame=1)
    second["value"] += 1
    return hb.RunResult(replace(found.result, scores=pd.concat([found.scores, second])))


def test_two_results_are_compared_in_a_data_frame(synthetic):
    """Paths or results, with the figures of the result's own table."""
    lines = hb.compare(synthetic, str(synthetic.folder))
    means = lines[lines.capture == ""].set_index(["metric", "method", "reference"])
    assert list(dict.fromkeys(lines.metric))[:3] == ["mae_mm", "max_mm", "complete_2mm_percent"]
    for metric in ("mae_mm", "max_mm", "precision_mm"):
        reference = "" if metric == "precision_mm" else "truth"
        mean = means.loc[metric, "3fsk", reference]
        assert mean.a == mean.b == pytest.approx(synthetic.row(metric, "3fsk", "truth").value)
        assert mean.difference == 0
    maes = lines[(lines.metric == "mae_mm") & (lines.method == "3fsk")]
    assert maes.capture.tolist() == 2 * ["", "B", "F", "U", "V", "W"]


def test_a_result_is_drawn_by_the_name_of_the_figure(synthetic, tmp_path):
    """The points are the figures of the tables."""
    maes = synthetic.scores[synthetic.scores.metric == "mae_mm"]
    first = maes[(maes.method == "3fsk") & (maes.reference == "truth") & (maes.frame == 0)].value
    points = {line.get_marker(): line for line in synthetic.plot("captures").axes[1].lines}
    np.testing.assert_allclose(points["s"].get_ydata(), first)
    [over] = [x for x in synthetic.plot("frames").axes[1].lines if x.get_label() == "3-FSK"]
    np.testing.assert_allclose(over.get_ydata(), [first.mean(), first.mean() + 1])
    synthetic.plot("ecdf", tmp_path / "ecdf.png")
    assert (tmp_path / "ecdf.png").read_bytes().startswith(b"\x89PNG")
    with pytest.raises(hb.HandbenchError, match=r"unknown kind 'ecd'; did you mean 'ecdf'\?"):
        synthetic.plot("ecd")


def test_everything_that_it_names_is_there():
    assert hb.__version__ == version("handbench")
    assert set(dir(hb)) == set(hb.__all__)
    assert all(getattr(hb, name).__doc__ for name in hb.__all__)
    assert "3fsk" in hb.methods()
    with pytest.raises(AttributeError, match="no attribute"):
        _ = hb.nothing
