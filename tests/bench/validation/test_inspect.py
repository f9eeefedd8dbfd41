"""Mistakes that every reader takes, and the cure that `handbench inspect` names.

The echoes are sums of exponentials over points of an L-shaped plate, written here, and the mistakes
are put into the files: nothing is shared with the check."""

from __future__ import annotations

import json
import re
import tomllib
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import tomlkit

from handbench.bench.datasets.simulated import write_photos
from handbench.bench.scenes.build import build
from handbench.bench.scenes.scene_file import SceneFile
from handbench.bench.validation import checks
from handbench.bench.validation.mistakes import conjugation_warnings
from handbench.calibration.transforms import Transform
from handbench.cli.main import main
from handbench.groundtruth.mesh.mesh_files import mesh, write_mesh
from handbench.groundtruth.mesh.surface import read_surface
from handbench.radar.data.arrays import SPEED_OF_LIGHT_M_S, AntennaArray, PlanarScan, qar50
from handbench.radar.data.capture import RadarCapture
from handbench.radar.data.depthmap import DepthMap
from handbench.radar.data.echoes_file import save_capture
from handbench.support.config import parse

TONES_HZ = np.r_[np.linspace(72e9, 82e9, 24), 81.8e9, 79.5e9]
CORNERS_M = np.array([(-30, -40), (20, -40), (20, -20), (-10, -20), (-10, 40), (-30, 40)]) * 1e-3
SIDES_M = {"start": -0.05, "stop": 0.05}  # of an image of it
Z_M = 0.29
ONE = np.eye(3)
X, Y, Z = (np.diag(1 - 2 * row) for row in ONE)


def depth_m(x_m: np.ndarray, y_m: np.ndarray) -> np.ndarray:
    return Z_M + 0.1 * x_m + 0.15 * y_m


def points_before(
    array: AntennaArray, tones_hz: np.ndarray, points_m: np.ndarray, share: float = 1.0
) -> RadarCapture:
    """The echoes of points. share: of the way there and back that the phases count."""
    wave = -2j * np.pi / SPEED_OF_LIGHT_M_S * share * tones_hz[:, None, None]
    legs = (
        np.exp(wave * np.linalg.norm(points_m[:, None] - places_m, axis=2))
        for places_m in (array.tx_m, array.rx_m)
    )
    samples = np.einsum("fpt,fpr->ftr", *legs, optimize=True)
    return RadarCapture(samples[None].astype(np.complex64), tones_hz, array)


def plate_echoes(share: float = 1.0) -> RadarCapture:
    """Of 150 points, evenly spread over an L that leans, before every second antenna."""
    x, y = np.random.default_rng(1).uniform(-0.04, 0.04, (2, 3000))
    inside = (x > -0.03) & (x < 0.02) & ((y < -0.02) | (x < -0.01))
    x, y = x[inside][:150], y[inside][:150]
    array = AntennaArray(qar50().tx_m[::2], qar50().rx_m[::2])
    return points_before(array, TONES_HZ, np.stack([x, y, depth_m(x, y)], axis=1), share)


@pytest.fixture(scope="module")
def right() -> RadarCapture:
    return plate_echoes()


def written(folder: Path, capture: RadarCapture, change: np.ndarray = ONE) -> Path:
    """A capture's folder, with the plate's surface scaled and mirrored."""
    folder.mkdir(parents=True)
    save_capture(folder / "echoes.h5", capture)
    (folder / "capture.toml").write_text('version = 1\nname = "plate"\nkind = "other"\n')
    vertices_m = np.column_stack([CORNERS_M, depth_m(*CORNERS_M.T)]) @ change
    faces = [(0, 2, 1), (0, 3, 2), (0, 4, 3), (0, 5, 4)]
    write_mesh(folder / "truth.ply", mesh(vertices_m, np.array(faces)))
    return folder


def placed(capture: RadarCapture, change: np.ndarray) -> RadarCapture:
    """The capture with its antennas elsewhere."""
    legs_m = capture.aperture.tx_m, capture.aperture.rx_m
    return replace(capture, aperture=AntennaArray(*(leg_m @ change for leg_m in legs_m)))


def swapped(capture: RadarCapture) -> RadarCapture:
    array = capture.aperture
    return replace(capture, aperture=AntennaArray(array.rx_m, array.tx_m))


def conjugate(capture: RadarCapture) -> RadarCapture:
    return replace(capture, samples=capture.samples.conj())


def tones(capture: RadarCapture, tones_hz: np.ndarray) -> RadarCapture:
    return replace(capture, frequencies_hz=tones_hz)


ECHOES = {
    "conjugated": (conjugate, "m, conjugate the samples"),
    "tones": (lambda c: tones(c, TONES_HZ[::-1]), "reverse frequencies_hz"),
    "swapped": (swapped, "exchange tx_m and rx_m"),
    "x negated": (
        lambda c: placed(c, X),
        "mirrored in x; after correcting this, the median error falls from",
    ),
    "millimetres": (lambda c: placed(c, 1e3 * ONE), "multiply them by 1e-3"),
    "centimetres": (lambda c: placed(c, 1e2 * ONE), "multiply them by 1e-2"),
    "kilometres": (lambda c: placed(c, 1e-3 * ONE), "in km, multiply them by 1e3"),
    "y and z": (lambda c: placed(c, ONE[[0, 2, 1]]), "faces y"),
    "gigahertz": (lambda c: tones(c, TONES_HZ / 1e9), "multiply them by 1e9"),
    "megahertz": (lambda c: tones(c, TONES_HZ / 1e6), "multiply them by 1e6"),
    "kilohertz": (lambda c: tones(c, TONES_HZ / 1e3), "in kHz, multiply them by 1e3"),
    "one way": (lambda _: plate_echoes(0.5), "one way only the median error falls"),
    "nothing": (lambda c: c, "no problem found"),
}
SURFACES = {
    "upside down": (X @ Y, "upside down"),
    "mirrored in y": (Y, "mirrored in y"),
    "behind": (Z, "mirrored in z"),
    "inches": (ONE / 0.0254, "in inches"),
    "millimetres": (1e3 * ONE, "in millimetres"),
    "ten times": (10 * ONE, "ten times too large"),
}


def inspected(capsys, *words: object) -> str:
    main(["inspect", *map(str, words)])
    return capsys.readouterr().out


@pytest.mark.parametrize(("change", "cure"), ECHOES.values(), ids=ECHOES)
def test_echoes_with_a_mistake_are_doubted_with_its_cure(right, tmp_path, capsys, change, cure):
    assert cure in inspected(capsys, written(tmp_path / "plate", change(right)))


@pytest.mark.parametrize(("change", "cure"), SURFACES.values(), ids=SURFACES)
def test_a_surface_in_another_frame_or_unit_is_doubted(right, tmp_path, capsys, change, cure):
    assert cure in inspected(capsys, written(tmp_path / "plate", right, change))


CROSS = AntennaArray(*(np.linspace(-0.07, 0.07, 20)[:, None] * np.eye(3)[axis] for axis in (0, 1)))
BANDS_HZ = {
    "wide": np.linspace(72e9, 82e9, 32),
    "26 GHz": np.linspace(22e9, 26e9, 41),
    "narrow": np.linspace(24e9, 24.12e9, 16),
    "few": np.array([82e9, 81.8e9, 79.5e9]),
}


@pytest.mark.parametrize(
    "tones_hz",
    [
        pytest.param(tones_hz, id=name, marks=[pytest.mark.slow] if name == "wide" else [])
        for name, tones_hz in BANDS_HZ.items()
    ],
)
def test_right_echoes_are_not_accused_whatever_the_band_and_the_place(tones_hz):
    draw = np.random.default_rng(2)
    for number in range(4):
        distance_m = 10 ** draw.uniform(np.log10(0.15), np.log10(0.9))
        points_m = draw.uniform(-0.3, 0.3, (draw.integers(1, 6), 3)) * distance_m
        capture = points_before(CROSS, tones_hz, points_m + [0, 0, distance_m])
        noise = np.random.default_rng(1).standard_normal((*capture.samples.shape, 2)) @ [1, 1j]
        noise *= 0.1 * (number % 2) * np.abs(capture.samples).max()
        noisy = replace(capture, samples=(capture.samples + noise).astype(np.complex64))
        assert conjugation_warnings(noisy) == []


def test_missing_columns_scans_and_single_tones_have_a_sign(right):
    """The scan is of a transceiver that is moved over a square before a point."""
    point_m, tones_hz = np.array([[-0.03, 0.0, 0.3]]), BANDS_HZ["26 GHz"]
    array = replace(CROSS, measured=np.arange(20)[:, None] % 2 * np.ones(20, int) > 0)
    columns = points_before(array, BANDS_HZ["wide"], point_m)
    columns.samples[:, :, ::2] = 0
    one = replace(right, samples=right.samples[:, :1], frequencies_hz=TONES_HZ[:1])
    places_m = np.mgrid[-0.05:0.05:30j, -0.05:0.05:30j, 0:1].reshape(3, -1).T
    path_m = 2 * np.linalg.norm(places_m - point_m, axis=1)
    samples = np.exp(-2j * np.pi / SPEED_OF_LIGHT_M_S * tones_hz[:, None] * path_m)
    scan = RadarCapture(samples[None].astype(np.complex64), tones_hz, PlanarScan(places_m))
    for capture in (columns, scan, one):
        [text] = conjugation_warnings(conjugate(capture))
        assert conjugation_warnings(capture) == [] and "conjugate" in text


def test_a_depth_map_that_fills_the_image_or_contradicts_itself_is_doubted():
    axis_m, z_m = np.arange(-5, 6) * 1e-2, np.full((11, 11), 0.3)
    full = DepthMap(axis_m, axis_m, z_m, 0 * z_m, "m", p_gross=3 * z_m)
    assert [text[:5] for text in checks.map_warnings(full)] == ["100 %"] * 2
    part = replace(full, z_m=np.where(np.arange(11) < 3, z_m, np.nan), p_gross=z_m / 3)
    cropped = replace(full, x_m=axis_m / 10, y_m=axis_m / 10, p_gross=z_m / 3)
    assert [*checks.map_warnings(part), *checks.map_warnings(cropped)] == []


@pytest.mark.slow
def test_imaging_and_scoring_say_what_they_doubt_and_inspect_does(right, tmp_path, capsys):
    depth = tmp_path / "depth.npz"
    for name, capture in (("conjugated", conjugate(right)), ("right", right)):
        folder = written(tmp_path / name, capture)
        near = (f"--set={axis}.{to}_m={m}" for axis in "xy" for to, m in SIDES_M.items())
        image = "--method", "3fsk", *near, "-o", str(depth), "--overwrite"
        assert main(["reconstruct", str(folder), *image]) == 0
        assert ("conjugate the samples" in capsys.readouterr().err) == (name == "conjugated")
    mesh, behind = (str(at / "truth.ply") for at in (folder, written(tmp_path / "z", right, Z)))
    assert main(["evaluate", str(depth), "--mesh", behind]) == 0
    found = capsys.readouterr()
    assert "mirrored in z" in json.loads(found.out)["doubts"][0] and "mirrored in z" in found.err
    assert main(["evaluate", str(depth), "--mesh", mesh]) == 0
    assert "doubts" not in json.loads(capsys.readouterr().out)
    assert "no problem found" in inspected(capsys, depth, "--mesh", mesh)
    assert "mirrored in z" in inspected(capsys, depth, "--mesh", behind)
    transform = tmp_path / "t.json"
    transform.write_text('{"from": "photo"}')
    words = depth, "--mesh", mesh, "--transform", transform
    assert f"{transform}: " in inspected(capsys, *words)
    assert main(["inspect", str(folder), "--mesh", mesh]) == 2
    assert "capture folder has its own mesh" in capsys.readouterr().err


def test_photographs_are_held_against_their_cameras_and_their_board(tmp_path, capsys):
    photos = {"cameras": 3, "width": 900, "height": 600}
    scene = {"version": 1, "name": "ball", "target": {"kind": "sphere"}, "photos": photos}
    write_photos(build(parse(SceneFile, scene, "the ball")), tmp_path)
    folder = tmp_path / "photos"
    (folder / "truth_cameras.json").unlink()
    assert inspected(capsys, folder).strip() == f"{folder}: no problem found"
    file, board = folder / "cameras.json", folder / "board.toml"
    right = file.read_text()
    turned = {"width": "height", "height": "width"}
    file.write_text(re.sub("width|height", lambda name: turned[name[0]], right))
    assert "exchange width and height" in inspected(capsys, folder)
    file.write_text(right)
    content = tomllib.loads(board.read_text())
    for marker in content["marker"]:
        marker["corners_m"] = (10 * np.array(marker["corners_m"])).tolist()
    board.write_text(tomlkit.dumps(content))
    assert "ten times too far" in inspected(capsys, folder)


@pytest.mark.parametrize(
    ("kept", "words"),
    [
        (np.s_[:], "no problem found"),
        (np.s_[:, ::-1], "inside out"),
        (np.s_[:2], "belong to only one triangle"),
    ],
)
def test_a_mesh_inside_out_or_full_of_holes_is_doubted(tmp_path, capsys, kept, words):
    corners_m = 0.1 * np.array([(0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1)])
    outside = np.array([(0, 2, 1), (0, 1, 3), (0, 3, 2), (1, 2, 3)])
    write_mesh(tmp_path / "a.ply", mesh(corners_m, outside[kept]))
    assert words in inspected(capsys, tmp_path / "a.ply")


def test_a_run_records_what_it_doubts_and_the_result_shows_it(right, tmp_path, capsys):
    """So do the folder of captures and the echoes alone."""
    plate = written(tmp_path / "all" / "plate", conjugate(right))
    bench, out = tmp_path / "all" / "bench.toml", tmp_path / "out"
    capture = '[[capture]]\npath = "plate"\nmeasures = ["accuracy"]\n'
    bench.write_text(f'version = 1\nname = "b"\n{capture}[[method]]\nid = "2fsk"\n')
    for seen in (True, False):  # a resumed run does not look again
        assert main(["run", str(bench), "-o", str(out)]) == 0
        assert ("conjugate the samples" in capsys.readouterr().err) == seen
        doubts = json.loads((out / "result.json").read_text())["facts"]["doubts"]["plate"]
        assert len(doubts) == 1 and "conjugate the samples" in doubts[0]
    assert "plate: the image of the conjugated echoes" in inspected(capsys, out)
    assert "conjugate the samples" in inspected(capsys, bench)
    (plate / "truth.ply").unlink()
    bench.unlink()
    written(tmp_path / "all" / "right", right)
    assert "conjugate the samples" in inspected(capsys, plate)
    lines = inspected(capsys, tmp_path / "all")
    assert "plate: warning: the image of the conjugated echoes" in lines and "right: " not in lines


def test_every_check_s_advice_takes_the_facts_of_its_thing(right, tmp_path, monkeypatch):
    """With checks that always find something, each says its advice once."""
    always = tuple(check._replace(found=lambda facts: True) for check in checks.CHECKS)
    monkeypatch.setattr(checks, "CHECKS", always)
    surface = read_surface(written(tmp_path / "plate", right) / "truth.ply")
    depth = DepthMap(np.arange(3.0), np.arange(2.0), np.full((2, 3), 0.3), np.zeros((2, 3)), "3fsk")
    found = [
        *checks.array_warnings(right),
        *checks.pair_warnings(right),
        *checks.surface_warnings(surface),
        *checks.mesh_warnings(surface),
        *checks.transform_warnings(Transform("photo", "radar", np.eye(4)), surface),
        *checks.map_warnings(depth),
        *checks.figure_warnings(depth, {"mae_mm": 1.0, "relative_accuracy_percent": 99.0}),
    ]
    kinds = {"array", "pairs", "surface", "mesh", "transform", "depth map", "figures"}
    assert len(found) == sum(check.of in kinds for check in always) and "{" not in "".join(found)
