"""`handbench show`: a capture, a depth map and a mesh become pictures of what lies in them."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest
from PIL import Image

from handbench.bench.evaluation.depth_errors import ErrorMap, error_map
from handbench.bench.evaluation.metrics import figures
from handbench.bench.results.maps import SurfaceMap
from handbench.bench.validation.checks import figure_warnings
from handbench.cli.main import main
from handbench.groundtruth.mesh.surface import read_surface
from handbench.radar.data.capture import range_profile
from handbench.radar.data.depthmap import DepthMap
from handbench.reports.figures.layers import depth_layers, error_layer, layers_figure
from handbench.reports.tables.rounding import figure
from tests.radar.simulated_points import point_capture
from tests.refusals import refuse_command


@pytest.fixture(scope="module")
def shown(made, tmp_path_factory):
    """A folder with a file of each kind, made by the commands where they make it."""
    folder = tmp_path_factory.mktemp("show")
    for name in ("capture", "depth.npz"):
        (folder / name).symlink_to(made / name)
    surface = read_surface(folder / "capture" / "truth.ply")
    replace(surface, sigma_m=np.full(len(surface.sigma_m), 1e-4)).save(folder / "mesh.ply")
    names = ("x_m", "y_m", "z_m", "amplitude_db")  # others are not needed
    with np.load(folder / "depth.npz") as map:
        row = {name: map[name] if name == "x_m" else map[name][10:11] for name in names}
    np.savez(folder / "row.npz", **row)
    return folder


def pixels(file) -> np.ndarray:
    with Image.open(file) as picture:
        return np.asarray(picture.convert("L"))


@pytest.mark.parametrize("name", ["capture", "depth.npz", "row.npz", "mesh.ply"])
def test_every_kind_becomes_a_picture_in_the_current_folder(
    shown, name, tmp_path, monkeypatch, capsys
):
    """It is neither empty nor filled."""
    monkeypatch.chdir(tmp_path)
    assert main(["show", str(shown / name)]) == 0
    [file] = capsys.readouterr().out.split()
    picture = pixels(tmp_path / file)
    assert min(picture.shape) > 300 and 0.01 < (picture < 128).mean() < 0.9
    refuse_command(["show", str(shown / name)], file, "--overwrite")


@pytest.mark.parametrize(("z_m", "span_hz"), [(0.3, 10e9), (3.94, 1e9)])
def test_a_sweep_s_range_profile_has_its_maximum_at_half_the_path(z_m, span_hz):
    """Of a point on the axis of the array, whose antennas are at most 0.1 m from its centre."""
    point = point_capture((0.0, 0.0, z_m), 82e9 - np.linspace(span_hz, 0, 64))
    range_m, level_db = range_profile(point)
    assert z_m - range_m[1] < range_m[np.argmax(level_db)] < np.hypot(z_m, 0.1) + range_m[1]


@pytest.mark.parametrize("name", ["depth.npz", "row.npz", "mesh.ply"])
def test_a_surface_turns_on_a_page_that_needs_nothing_else(shown, name, tmp_path):
    assert main(["show", str(shown / name), "-o", str(tmp_path / "page.html")]) == 0
    text = (tmp_path / "page.html").read_text("utf-8")
    scene = json.loads(text.split('id="scene-1">')[1].split("</script>")[0])
    assert scene["references"] == [] and scene["surfaces"][0]["pixels"] > 10
    assert "http" not in text.split("</head>")[1].split("<script>")[0]


def test_x_grows_to_the_left_and_y_upwards_on_every_panel():
    axis_m = 1e-3 * np.arange(5)
    errors = ErrorMap(axis_m, axis_m, np.zeros((5, 5)), np.full((5, 5), 0.3))
    depths = depth_layers(SurfaceMap(axis_m, axis_m, np.eye(5)), {})
    for axis in layers_figure([error_layer(errors, "3-FSK"), *depths]).axes:
        assert axis.xaxis_inverted() and not axis.yaxis_inverted()


def flat(z_m) -> DepthMap:
    """A map of one depth, all of it on target."""
    axis_m = np.linspace(-0.05, 0.05, 40)
    depths = np.full((40, 40), z_m), np.zeros((40, 40), np.float32)
    return DepthMap(axis_m, axis_m, *depths, "broadband")


def test_warnings_come_first(shown, tmp_path, capsys):
    """A map ten times as far as the ball."""
    flat(3.0).save(tmp_path / "far.npz")
    assert main(["evaluate", str(tmp_path / "far.npz"), "--mesh", str(shown / "mesh.ply")]) == 0
    printed = capsys.readouterr()
    assert next(iter(json.loads(printed.out))) == "warnings"
    assert "far.npz: " in printed.err and "100 %" in printed.err


@pytest.mark.parametrize(("z_m", "words"), [(0.34, "50 mm"), (np.nan, "no pixel"), (0.301, "")])
def test_figures_that_can_hardly_be_are_warned_of(z_m, words):
    """Of a surface at 0.29 m."""
    depth = flat(z_m)
    errors = error_map(depth.x_m, depth.y_m, depth.z_m, np.full((40, 40), 0.29))
    [*warnings] = figure_warnings(figures(errors))
    assert len(warnings) == bool(words) and all(words in warning for warning in warnings)


def test_evaluate_is_a_table_on_a_terminal_json_on_request_and_a_picture(
    shown, tmp_path, monkeypatch, capsys
):
    command = ["evaluate", str(shown / "depth.npz"), "--mesh", str(shown / "mesh.ply")]
    plot = ["--plot", str(tmp_path / "a.png")]
    assert main([*command, *plot]) == 0
    printed = capsys.readouterr().out  # stdout holds the metrics alone
    assert pixels(tmp_path / "a.png").shape[1] > 500
    refuse_command([*command, *plot], "a.png", "--overwrite")
    monkeypatch.setattr("sys.stdout.isatty", lambda: True)
    assert main(command) == 0
    table = capsys.readouterr().out
    assert figure(json.loads(printed)["mae_mm"], unit="mm") in table and "MAE" in table
    assert main([*command, "--json"]) == 0
    defined = json.loads(capsys.readouterr().out)
    assert defined.pop("definitions")["mae_mm"] and defined == json.loads(printed)
