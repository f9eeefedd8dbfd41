"""The public face, `import handbench as hb`: a script of a few lines, on files that the commands
made."""

from __future__ import annotations

import os
import pickle
import subprocess
import sys
from dataclasses import replace
from importlib.metadata import version
from pathlib import Path

import numpy as np
import pytest

import handbench as hb
from tests.golden_files import RESULT
from tests.refusals import refuse
from tests.small_benchmark import write_bench

ROOT = Path(__file__).parents[1]
EYE = np.eye(4)
PIXELS = {axis: {"start_m": -0.01, "stop_m": 0.01} for axis in "xy"}


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


def test_importing_loads_the_standard_library_alone():
    code = "import sys; before = {*sys.modules}; import handbench; print(*{*sys.modules} - before)"
    found = {name.partition(".")[0] for name in python("-c", code).split()}
    assert found - set(sys.stdlib_module_names) == {"handbench"}


def test_a_stream_images_frames_as_they_arrive(ball):
    """Depths are those of the capture's frame, and a refused frame changes nothing."""
    echoes, expected = ball.echoes, ball.reconstruct("3fsk", **PIXELS)
    samples, tones_hz = echoes.samples[0], echoes.frequencies_hz
    in_order = [tones_hz.tolist().index(hz) for hz in (82e9, 81.8e9, 79.5e9)]
    for given, live in (
        (samples, hb.stream("3fsk", echoes.aperture, tones_hz, **PIXELS)),
        (samples[in_order], hb.stream("3fsk", echoes.aperture, **PIXELS)),
    ):
        for _ in range(2):
            depth = live(given)
            np.testing.assert_array_equal(depth.z_m, expected.z_m)
            np.testing.assert_allclose(depth.sigma_m, expected.sigma_m, rtol=1e-2)
    refuse(lambda: live(samples[:2]), "samples", "(1, 2, 94, 94)")
    refuse(lambda: live(samples[in_order] + np.nan), "samples")
    np.testing.assert_array_equal(live(samples[in_order]).z_m, depth.z_m)  # and goes on


def test_a_depth_map_is_drawn_saved_and_turned_into_points(depth, tmp_path):
    assert "2fsk: 65 pixels" in repr(depth)
    for drawn in (depth, depth.evaluate()):
        assert drawn._repr_png_().startswith(b"\x89PNG")
    depth.plot(tmp_path / "depth.pdf")
    assert (tmp_path / "depth.pdf").read_bytes().startswith(b"%PDF")
    np.testing.assert_array_equal(depth.points_m()[:, 2], depth.z_m[np.isfinite(depth.z_m)])
    copied = pickle.loads(pickle.dumps(hb.Depth(depth.map)))
    np.testing.assert_array_equal(copied.z_m, depth.z_m)


def test_a_map_in_millimetres_is_warned_of(ball, depth, capsys):
    hb.Depth(replace(depth.map, z_m=100 * depth.z_m)).evaluate(ball.truth)
    assert "millimetres" in capsys.readouterr().err


def test_load_knows_files_by_what_they_are(ball, depth, tmp_path):
    file = tmp_path / "T.json"
    hb.Transform("photo", "radar", EYE).save(file)
    depth.map.save(tmp_path / "d.npz")
    assert repr(hb.load(tmp_path / "d.npz")) == repr(depth)
    loaded = [hb.load(path) for path in (ball.folder, ball.truth, RESULT, file)]
    assert [type(one) for one in loaded] == [hb.Capture, hb.Surface, hb.RunResult, hb.Transform]
    assert "golden <b>: 2 captures" in repr(loaded[2])
    assert "ball: 1 frame, 3 tones from 79.5 to 82 GHz, 94 × 94 channels" in repr(loaded[0])


REFUSALS = [  # calls of a capture, its depth map and an empty folder, and the places that they name
    (lambda ball, depth, folder: hb.load(folder), ["{folder}"]),
    (lambda ball, depth, folder: ball.reconstruct("2fsk", frame=-1), ["frame", "-1", "0 to 0"]),
    (lambda ball, depth, folder: hb.calibrate([]), ["captures"]),
    (lambda ball, depth, folder: depth.evaluate(ball.truth, EYE), ["transform"]),
    (lambda ball, depth, folder: hb.Depth(depth.map).evaluate(), ["mesh"]),
    (lambda ball, depth, folder: depth.plot(folder / "depth.gif"), ["depth.gif", ".png"]),
    (
        lambda ball, depth, folder: hb.simulate(ball.folder.parent / "ball.toml", ball.folder),
        ["{ball}"],
    ),
    (  # the truth lies in the radar's frame already
        lambda ball, depth, folder: depth.evaluate(transform=hb.Transform("photo", "radar", EYE)),
        ["mesh"],
    ),
    (lambda ball, depth, folder: depth.evaluate()["mae"], ["'mae'", "'mae_mm'"]),
    (lambda ball, depth, folder: hb.load(RESULT).plot("ecd"), ["'ecd'", "'ecdf'"]),
]


@pytest.mark.parametrize(("call", "places"), REFUSALS)
def test_a_mistake_is_one_sentence(ball, depth, tmp_path, call, places):
    named = [place.format(folder=tmp_path, ball=ball.folder) for place in places]
    refuse(lambda: call(ball, depth, tmp_path), *named)


def test_two_results_are_compared_in_a_data_frame():
    """Paths or results, with the figures of the result's own table."""
    result = hb.load(RESULT)
    lines = hb.compare(result, str(RESULT))
    assert list(dict.fromkeys(lines.metric))[:3] == ["mae_mm", "max_mm", "complete_2mm_percent"]
    maes = lines[(lines.metric == "mae_mm") & (lines.method == "3fsk")]
    maes = maes[maes.reference == "truth"].set_index("capture")
    assert maes.index.tolist() == ["", "B", "F"] and (maes.difference == 0).all()
    assert maes.a[""] == maes.b[""] == pytest.approx(result.row("mae_mm", "3fsk", "truth").value)


def test_a_result_is_drawn_by_the_name_of_the_figure(tmp_path):
    """The points are the figures of the table of scores."""
    result = hb.load(RESULT)
    maes = result.scores[(result.scores.metric == "mae_mm") & (result.scores.treatment == "")]
    mine = maes[(maes.method == "3fsk") & (maes.reference == "truth")].value
    points = {line.get_marker(): line for line in result.plot("captures").axes[1].lines}
    np.testing.assert_allclose(points["s"].get_ydata(), mine)
    result.plot("ecdf", tmp_path / "ecdf.png")
    assert (tmp_path / "ecdf.png").read_bytes().startswith(b"\x89PNG")


def test_everything_that_it_names_is_there():
    assert set(dir(hb)) == set(hb.__all__)
    assert all(getattr(hb, name).__doc__ for name in hb.__all__)
    assert "3fsk" in hb.methods() and hb.__version__ == version("handbench")
    with pytest.raises(AttributeError, match="no attribute"):
        _ = hb.nothing
