"""`handbench show`: every file that the tool reads or writes becomes a picture that shows what lies
in it."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest
from PIL import Image

from handbench.bench.results import ErrorMap, SurfaceMap
from handbench.cli.main import main
from handbench.groundtruth.mesh.surface import read_surface
from handbench.radar.data.depthmap import DepthMap
from handbench.reports.figures.layers import error_layer, layers_figure, shade, volume_layers
from tests.reports.synthetic_result import hand_m, write_synthetic, write_synthetic_tradeoff

PIXELS = [
    f"--set={axis}.{end}={value}"
    for axis in "xy"
    for end, value in (("start_m", -0.01), ("stop_m", 0.01))
]


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    """A folder with a file of each kind, made by the commands where they make it."""
    from tests.small_benchmark import write_bench

    folder = tmp_path_factory.mktemp("show")
    scene = write_bench(folder / "bench").parent / "ball.toml"
    assert main(["simulate", str(scene), "-o", str(folder / "capture")]) == 0
    depths = ["--set=z.start_m=0.275", "--set=z.stop_m=0.285", "--set=z.step_m=0.002"]
    command = ["reconstruct", str(folder / "capture"), "--method", "narrowband", *PIXELS, *depths]
    assert (
        main([*command, "-o", str(folder / "depth.npz"), "--volume", str(folder / "volume.npz")])
        == 0
    )
    surface = read_surface(folder / "capture" / "truth.ply")
    replace(surface, sigma_m=np.full(len(surface.sigma_m), 1e-4)).save(folder / "mesh.ply")
    camera = {
        "name": "cam.jpg",
        "width": 30,
        "height": 20,
        "model": "PINHOLE",
        "params": [30, 30, 15, 10],
    }
    posed = camera | {"R": np.eye(3).tolist(), "t": [0, 0, 1]}
    (folder / "cameras.json").write_text(
        json.dumps({"cameras": [posed, posed | {"name": "b.jpg", "t": [0.5, 0, 1]}]})
    )
    (folder / "unposed.json").write_text(json.dumps({"cameras": [camera]}))
    write_synthetic(folder / "result", ("B",))
    write_synthetic_tradeoff(folder / "tradeoff")
    return folder


def pixels(file) -> np.ndarray:
    with Image.open(file) as picture:
        return np.asarray(picture.convert("L"))


@pytest.mark.parametrize(
    "name",
    [
        "capture", "capture/echoes.h5", "depth.npz", "volume.npz", "mesh.ply", "capture/truth_radar_from_photo.json",
        "cameras.json", "result", "tradeoff", "result/errors/B__2fsk__truth.npz", "result/depth/B__photogrammetry.npz",
    ],
)  # fmt: skip
def test_every_kind_becomes_a_picture_in_the_current_folder(
    made, name, tmp_path, monkeypatch, capsys
):
    monkeypatch.chdir(tmp_path)
    assert main(["show", str(made / name)]) == 0
    [file] = capsys.readouterr().out.split()
    picture = pixels(tmp_path / file)
    assert (
        min(picture.shape) > 300 and 0.01 < (picture < 128).mean() < 0.9
    )  # neither empty nor filled
    assert main(["show", str(made / name)]) == 2 and "--overwrite" in capsys.readouterr().err


@pytest.mark.parametrize("name", ["capture", "depth.npz", "mesh.ply"])
def test_a_surface_turns_on_a_page_that_needs_nothing_else(made, name, tmp_path, capsys):
    assert main(["show", str(made / name), "--3d", "-o", str(tmp_path / "page.html")]) == 0
    text = (tmp_path / "page.html").read_text("utf-8")
    scene = json.loads(text.split('id="scene-1">')[1].split("</script>")[0])
    assert scene["references"] == [] and scene["surfaces"][0]["pixels"] > 50
    assert "http" not in text.split("</head>")[1].split("<script>")[0]


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["bench/ball.toml"], "nothing that can be shown"),
        (["missing"], "nothing that can be shown"),
        (["unposed.json"], "no poses"),
        (["volume.npz", "--3d"], "no surface to turn"),
        (["depth.npz", "--3d", "-o", "a.png"], "expected a picture, or with --3d a page"),
    ],
)
def test_what_cannot_be_shown_is_told_in_one_line(
    made, arguments, said, monkeypatch, tmp_path, capsys
):
    monkeypatch.chdir(tmp_path)
    assert main(["show", str(made / arguments[0]), *arguments[1:]]) == 2
    assert said in capsys.readouterr().err.splitlines()[-1]
    assert not list(tmp_path.iterdir())


def test_arrays_that_do_not_fit_are_named(tmp_path, capsys):
    axis, z_m = np.arange(4) * 1e-3, np.ones((4, 5))
    np.savez(tmp_path / "odd.npz", x_m=axis, y_m=axis, z_m=z_m)
    assert main(["show", str(tmp_path / "odd.npz"), "-o", str(tmp_path / "o.png")]) == 2
    assert "z_m is missing, or does not fit" in capsys.readouterr().err


def test_x_grows_to_the_left_and_y_upwards_on_every_panel():
    axis_m = 1e-3 * np.arange(5)
    errors = ErrorMap(axis_m, axis_m, np.zeros((5, 5)), np.full((5, 5), 0.3))
    volume = np.zeros((5, 5, 5), complex)
    volume[4, 3, 1] = 1  # z, y, x
    layers = [error_layer(errors), *volume_layers(volume, axis_m, axis_m, axis_m)]
    for axis in layers_figure(layers, "four").axes[::1]:
        if axis.get_xlabel():
            assert axis.xaxis_inverted() and not axis.yaxis_inverted()
    places = [np.argwhere(layer.values == 0)[0].tolist() for layer in layers[1:]]
    assert places == [[3, 1], [4, 1], [3, 4]]  # rows upwards, columns along x, x and z


def test_light_falls_from_the_upper_left_of_the_eye():
    axis_m = 1e-3 * np.arange(9)
    x, y = np.meshgrid(axis_m, axis_m)
    towards = shade(
        SurfaceMap(axis_m, axis_m, 0.3 + 0.5 * -x)
    )  # x to the left: it faces the left edge
    away, up = (
        shade(SurfaceMap(axis_m, axis_m, 0.3 + 0.5 * x)),
        shade(SurfaceMap(axis_m, axis_m, 0.3 + 0.5 * y)),
    )
    assert away.mean() > towards.mean() or up.mean() > towards.mean()
    assert abs(away.mean() - towards.mean()) > 0.1


def test_evaluate_draws_depth_and_error(made, tmp_path, capsys):
    command = [
        "evaluate",
        str(made / "depth.npz"),
        "--mesh",
        str(made / "mesh.ply"),
        "--plot",
        str(tmp_path / "a.png"),
    ]
    assert main(command) == 0
    json.loads(capsys.readouterr().out)  # stdout holds the metrics alone
    assert pixels(tmp_path / "a.png").shape[1] > 500
    assert main(command) == 2 and main([*command, "--overwrite"]) == 0


def test_evaluate_is_a_table_on_a_terminal_and_json_on_request(made, monkeypatch, capsys):
    command = ["evaluate", str(made / "depth.npz"), "--mesh", str(made / "mesh.ply")]
    assert main(command) == 0
    values = json.loads(capsys.readouterr().out)
    monkeypatch.setattr("sys.stdout.isatty", lambda: True)
    assert main(command) == 0
    table = capsys.readouterr().out
    assert f"{values['mae_mm']:.4g}" in table and "MAE" in table and "no intervals" in table
    assert main([*command, "--json"]) == 0
    assert json.loads(capsys.readouterr().out) == values


def test_doubts_come_first(made, tmp_path, capsys):
    x_m = np.linspace(-0.07, 0.07, 50)
    z_m = np.full((50, 50), 3.0)  # ten times as far as the ball
    DepthMap(x_m, x_m, z_m, np.zeros((50, 50), np.float32), "3fsk").save(tmp_path / "far.npz")
    assert main(["evaluate", str(tmp_path / "far.npz"), "--mesh", str(made / "mesh.ply")]) == 0
    said = capsys.readouterr()
    assert next(iter(json.loads(said.out))) == "doubts"
    assert "100 % of the image is on target" in said.err and "outside 0 to 100 %" in said.err


@pytest.mark.parametrize(
    ("config", "z_m", "said"),
    [
        ({"z": {"start_m": 0.28, "stop_m": 0.29}}, 0.31, "longer than the depth box, 10 mm"),
        ({}, 0.34, "more than 10 % of the distance"),
        ({}, np.nan, "no pixel of the map"),
        ({}, 0.301, ""),
    ],
)
def test_figures_that_can_hardly_be_are_doubted(config, z_m, said):
    from handbench.bench.evaluation.depth_errors import error_map
    from handbench.bench.evaluation.metrics import pool
    from handbench.bench.validation.checks import figure_warnings

    axis_m = np.linspace(-0.05, 0.05, 40)
    truth = np.where(np.isfinite(hand_m(axis_m, axis_m)), 0.29, np.nan)
    depth = DepthMap(
        axis_m, axis_m, np.full((40, 40), z_m), np.zeros((40, 40), np.float32), "broadband", config
    )
    [*found] = figure_warnings(depth, pool([error_map(axis_m, axis_m, depth.z_m, truth)]))
    assert len(found) == bool(said) and all(said in doubt for doubt in found)


def test_reconstruct_says_how_many_pixels_are_flagged(made, tmp_path, capsys):
    out = tmp_path / "depth.npz"
    assert (
        main(["reconstruct", str(made / "capture"), "--method", "2fsk", "-o", str(out), *PIXELS])
        == 0
    )
    with np.load(out) as found:
        on = np.isfinite(found["z_m"])
        share = 100 * (found["p_gross"][on] > 0.5).mean()
    assert (
        f"{on.sum()} pixels on target, {share:.1f} % of them flagged (p_gross > 0.5)"
        in capsys.readouterr().err
    )
