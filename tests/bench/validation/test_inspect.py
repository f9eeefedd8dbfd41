"""Mistakes that every reader takes, and the cure that `handbench inspect` names.

The echoes are sums of exponentials over points of an L-shaped plate, written here, and the mistakes
are put into the files: nothing is shared with the check."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

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
from tests.bench.validation.photo_mistakes import PHOTO_MISTAKES, photographs

TONES_HZ = np.r_[np.linspace(72e9, 82e9, 24), 81.8e9, 79.5e9]
CORNERS_M = np.array([(-30, -40), (20, -40), (20, -20), (-10, -20), (-10, 40), (-30, 40)]) * 1e-3
Z_M = 0.29


def on_the_plate(count: int) -> np.ndarray:
    """Points [n, 3], evenly spread over an L that leans."""
    x, y = np.random.default_rng(1).uniform(-0.04, 0.04, (2, 20 * count))
    inside = (x > -0.03) & (x < 0.02) & ((y < -0.02) | (x < -0.01))
    x, y = x[inside][:count], y[inside][:count]
    return np.stack([x, y, depth_m(x, y)], axis=1)


def depth_m(x_m: np.ndarray, y_m: np.ndarray) -> np.ndarray:
    return Z_M + 0.1 * x_m + 0.15 * y_m


@pytest.fixture(scope="module")
def right() -> RadarCapture:
    """The echoes of 150 points of the plate before every second antenna."""
    array = AntennaArray(qar50().tx_m[::2], qar50().rx_m[::2])
    return RadarCapture(echoes_of(array)[None], TONES_HZ, array)


def echoes_of(array: AntennaArray, share: float = 1.0) -> np.ndarray:
    """Samples [f, t, r] of 150 points of the plate. share: of the way there and back that the
    phases count."""
    samples = np.zeros((len(TONES_HZ), len(array.tx_m), len(array.rx_m)), complex)
    for point_m in on_the_plate(150):
        path_m = np.linalg.norm(point_m - array.tx_m, axis=1)[:, None] + np.linalg.norm(
            point_m - array.rx_m, axis=1
        )
        samples += np.exp(
            -2j * np.pi * TONES_HZ[:, None, None] * share * path_m / SPEED_OF_LIGHT_M_S
        )
    return samples.astype(np.complex64)


def written(
    folder: Path,
    capture: RadarCapture,
    scale: float = 1.0,
    turned: tuple[int, int, int] = (1, 1, 1),
) -> Path:
    """A capture's folder, with the plate's surface scaled and mirrored."""
    folder.mkdir(parents=True)
    save_capture(folder / "echoes.h5", capture)
    (folder / "capture.toml").write_text('version = 1\nname = "plate"\nkind = "other"\n')
    vertices_m = np.column_stack([CORNERS_M, depth_m(*CORNERS_M.T)]) * turned * scale
    write_mesh(
        folder / "truth.ply",
        mesh(vertices_m, np.array([(0, 2, 1), (0, 3, 2), (0, 4, 3), (0, 5, 4)])),
    )
    return folder


def placed(capture: RadarCapture, change: np.ndarray) -> RadarCapture:
    """The capture with its antennas elsewhere."""
    array = capture.aperture
    return replace(capture, aperture=AntennaArray(array.tx_m @ change.T, array.rx_m @ change.T))


MISTAKES = {
    "conjugated": (lambda c: replace(c, samples=c.samples.conj()), "m, conjugate the samples"),
    "tones": (
        lambda c: replace(c, frequencies_hz=c.frequencies_hz[::-1]),
        "reverse frequencies_hz",
    ),
    "swapped": (
        lambda c: replace(c, aperture=AntennaArray(c.aperture.rx_m, c.aperture.tx_m)),
        "exchange tx_m and rx_m",
    ),
    "x negated": (
        lambda c: placed(c, np.diag([-1.0, 1, 1])),
        "mirrored in x: undone, the median error falls from",
    ),
    "millimetres": (lambda c: placed(c, 1e3 * np.eye(3)), "multiply them by 1e-3"),
    "centimetres": (lambda c: placed(c, 1e2 * np.eye(3)), "multiply them by 1e-2"),
    "y and z": (lambda c: placed(c, np.eye(3)[[0, 2, 1]]), "looks along y"),
    "gigahertz": (
        lambda c: replace(c, frequencies_hz=c.frequencies_hz / 1e9),
        "multiply them by 1e9",
    ),
    "megahertz": (
        lambda c: replace(c, frequencies_hz=c.frequencies_hz / 1e6),
        "multiply them by 1e6",
    ),
    "kilohertz": (
        lambda c: replace(c, frequencies_hz=c.frequencies_hz / 1e3),
        "kilohertz? multiply them by 1e3",
    ),
    "kilometres": (lambda c: placed(c, 1e-3 * np.eye(3)), "kilometres? multiply them by 1e3"),
    "one way": (
        lambda c: replace(c, samples=echoes_of(c.aperture, 0.5)[None]),
        "one way only the median error falls",
    ),
    "twice": (
        lambda c: replace(c, frequencies_hz=np.r_[c.frequencies_hz[1], c.frequencies_hz[1:]]),
        "there twice",
    ),
}
SURFACES = {
    "upside down": ({"turned": (-1, -1, 1)}, "upside down"),
    "mirrored in y": ({"turned": (1, -1, 1)}, "mirrored in y"),
    "behind": ({"turned": (1, 1, -1)}, "mirrored in z"),
    "inches": ({"scale": 1 / 0.0254}, "in inches"),
    "millimetres": ({"scale": 1e3}, "in millimetres"),
    "ten times": ({"scale": 10.0}, "ten times too large"),
}


def said(capsys, *words: str) -> str:
    main(["inspect", *words])
    return capsys.readouterr().out


def test_what_is_right_is_not_doubted(right, tmp_path, capsys):
    assert main(["inspect", str(written(tmp_path / "plate", right))]) == 0
    assert "nothing looks wrong" in capsys.readouterr().out


@pytest.mark.parametrize("name", MISTAKES)
def test_echoes_with_a_mistake_are_doubted_with_its_cure(right, tmp_path, capsys, name):
    change, cure = MISTAKES[name]
    assert cure in said(capsys, str(written(tmp_path / "plate", change(right))))


@pytest.mark.parametrize("name", SURFACES)
def test_a_surface_in_another_frame_or_unit_is_doubted(right, tmp_path, capsys, name):
    change, cure = SURFACES[name]
    assert cure in said(capsys, str(written(tmp_path / "plate", right, **change)))


CROSS = AntennaArray(*(np.linspace(-0.07, 0.07, 20)[:, None] * np.eye(3)[axis] for axis in (0, 1)))
BANDS_HZ = {
    "wide": np.linspace(72e9, 82e9, 32),
    "16 of 4 GHz": np.linspace(60e9, 64e9, 16),
    "26 GHz": np.linspace(22e9, 26e9, 41),
    "1 GHz": np.linspace(76e9, 77e9, 32),
    "narrow": np.linspace(24e9, 24.12e9, 16),
    "few": np.array([82e9, 81.8e9, 79.5e9]),
}


def points_before(
    array: AntennaArray, tones_hz: np.ndarray, points_m: np.ndarray, noise: float = 0.0
) -> RadarCapture:
    """The echoes of points, in noise over the strongest sample."""
    path_m = [
        np.linalg.norm(points_m[:, None] - places_m, axis=2)
        for places_m in (array.tx_m, array.rx_m)
    ]
    waves = [
        np.exp(-2j * np.pi / SPEED_OF_LIGHT_M_S * tones_hz[:, None, None] * length_m)
        for length_m in path_m
    ]
    samples = np.einsum("fpt,fpr->ftr", *waves)
    draws = np.random.default_rng(1).standard_normal((2, *samples.shape))
    samples += noise * np.abs(samples).max() * (draws[0] + 1j * draws[1])
    return RadarCapture(samples[None].astype(np.complex64), tones_hz, array)


@pytest.mark.parametrize("band", BANDS_HZ)
def test_right_echoes_are_not_accused_whatever_the_band_and_the_place(band):
    draw = np.random.default_rng(2)
    for number in range(8):
        distance_m = 10 ** draw.uniform(np.log10(0.15), np.log10(0.9))
        points_m = draw.uniform(-0.3, 0.3, (draw.integers(1, 6), 3)) * distance_m + [
            0,
            0,
            distance_m,
        ]
        capture = points_before(CROSS, BANDS_HZ[band], points_m, noise=0.1 * (number % 2))
        assert conjugation_warnings(capture) == []


def test_arrays_with_missing_columns_and_scans_are_looked_at():
    point_m = np.array([[-0.03, 0.0, 0.3]])
    array = replace(CROSS, measured=np.arange(20)[:, None] % 2 * np.ones(20, int) > 0)
    right = points_before(array, BANDS_HZ["wide"], point_m)
    right.samples[:, :, ::2] = 0
    [text] = conjugation_warnings(replace(right, samples=right.samples.conj()))
    assert conjugation_warnings(right) == [] and "conjugate" in text
    places_m = np.stack(np.meshgrid(*[np.linspace(-0.05, 0.05, 30)] * 2, [0.0]), axis=-1).reshape(
        -1, 3
    )
    path_m = 2 * np.linalg.norm(places_m - point_m, axis=1)
    samples = np.exp(-2j * np.pi / SPEED_OF_LIGHT_M_S * BANDS_HZ["26 GHz"][:, None] * path_m)[None]
    scan = RadarCapture(samples.astype(np.complex64), BANDS_HZ["26 GHz"], PlanarScan(places_m))
    [text] = conjugation_warnings(replace(scan, samples=scan.samples.conj()))
    assert conjugation_warnings(scan) == [] and "conjugate" in text


def test_echoes_alone_and_folders_of_captures_are_inspected(right, tmp_path, capsys):
    alone = written(tmp_path / "all" / "alone", replace(right, samples=right.samples.conj()))
    (alone / "truth.ply").unlink()
    written(tmp_path / "all" / "plate", right)
    assert main(["inspect", str(alone)]) == 0
    assert "conjugate the samples" in capsys.readouterr().out
    assert main(["inspect", str(tmp_path / "all")]) == 0
    lines = capsys.readouterr().out
    assert "alone: warning: the echoes focus better" in lines and "plate: " not in lines


def test_a_single_tone_tells_its_sign(right):
    one = replace(right, samples=right.samples[:, :1], frequencies_hz=TONES_HZ[:1])
    assert conjugation_warnings(one) == []
    [text] = conjugation_warnings(replace(one, samples=one.samples.conj()))
    assert "conjugate" in text


def test_a_depth_map_that_fills_the_image_or_contradicts_itself_is_doubted():
    axis = np.arange(-5, 6) * 1e-2
    z_m = np.full((11, 11), 0.3)
    full = DepthMap(axis, axis, z_m, np.zeros_like(z_m), "m", p_gross=np.full_like(z_m, 0.9))
    assert [text.split()[0:2] for text in checks.map_warnings(full)] == [["100", "%"], ["100", "%"]]
    z_m[:, 3:] = np.nan
    assert list(checks.map_warnings(replace(full, z_m=z_m, p_gross=np.full_like(z_m, 0.1)))) == []
    cropped = replace(
        full,
        x_m=axis / 10,
        y_m=axis / 10,
        z_m=np.full_like(z_m, 0.3),
        p_gross=np.full_like(z_m, 0.1),
    )
    assert list(checks.map_warnings(cropped)) == []


def test_a_depth_map_is_held_against_a_mesh(right, tmp_path, capsys):
    folder = written(tmp_path / "plate", right)
    assert (
        main(["reconstruct", str(folder), "--method", "3fsk", "-o", str(tmp_path / "depth.npz")])
        == 0
    )
    assert "nothing looks wrong" in said(
        capsys, str(tmp_path / "depth.npz"), "--mesh", str(folder / "truth.ply")
    )
    wrong = written(tmp_path / "wrong", right, turned=(-1, 1, 1))
    assert "mirrored in x" in said(
        capsys, str(tmp_path / "depth.npz"), "--mesh", str(wrong / "truth.ply")
    )
    (tmp_path / "t.json").write_text('{"from": "photo"}')
    command = ["inspect", str(tmp_path / "depth.npz"), "--mesh", str(folder / "truth.ply")]
    assert main([*command, "--transform", str(tmp_path / "t.json")]) == 2
    assert f"{tmp_path / 't.json'}: " in capsys.readouterr().out
    assert main(["inspect", str(folder), "--mesh", str(folder / "truth.ply")]) == 2
    assert "capture has its own surface" in capsys.readouterr().err


def test_imaging_and_scoring_say_what_they_doubt(right, tmp_path, capsys):
    mistaken = written(tmp_path / "plate", replace(right, samples=right.samples.conj()))
    depth = tmp_path / "depth.npz"
    assert main(["reconstruct", str(mistaken), "--method", "3fsk", "-o", str(depth)]) == 0
    assert "conjugate the samples" in capsys.readouterr().err
    again = [
        str(written(tmp_path / "right", right)),
        "--method",
        "3fsk",
        "-o",
        str(depth),
        "--overwrite",
    ]
    assert main(["reconstruct", *again]) == 0
    assert "sharper" not in capsys.readouterr().err
    behind = written(tmp_path / "behind", right, turned=(1, 1, -1))
    assert main(["evaluate", str(depth), "--mesh", str(behind / "truth.ply")]) == 0
    found = capsys.readouterr()
    assert "mirrored in z" in json.loads(found.out)["doubts"][0] and "mirrored in z" in found.err
    assert main(["evaluate", str(depth), "--mesh", str(tmp_path / "right" / "truth.ply")]) == 0
    assert "doubts" not in json.loads(capsys.readouterr().out)


@pytest.mark.parametrize("name", PHOTO_MISTAKES)
def test_photographs_are_held_against_their_cameras_and_their_board(tmp_path, capsys, name):
    text = said(capsys, str(photographs(tmp_path, 3, name)))
    assert (
        PHOTO_MISTAKES[name] in text
        if PHOTO_MISTAKES[name]
        else text.strip() == f"{tmp_path}: nothing looks wrong"
    )


def test_a_mesh_inside_out_or_full_of_holes_is_doubted(tmp_path, capsys):
    corners_m = np.array([(0, 0, 0), (0.1, 0, 0), (0, 0.1, 0), (0, 0, 0.1)])
    outside = np.array([(0, 2, 1), (0, 1, 3), (0, 3, 2), (1, 2, 3)])
    for name, faces, words in (
        ("right", outside, "nothing looks wrong"),
        ("turned", outside[:, ::-1], "inside out"),
        ("open", outside[:2], "belong to only one triangle"),
    ):
        write_mesh(tmp_path / f"{name}.ply", mesh(corners_m, faces))
        assert words in said(capsys, str(tmp_path / f"{name}.ply"))


def test_a_run_records_what_it_doubts_and_the_result_shows_it(right, tmp_path, capsys):
    written(tmp_path / "plate", replace(right, samples=right.samples.conj()))
    table = (
        'version = 1\nname = "b"\n[[capture]]\npath = "plate"\nmeasures = '
        '["accuracy"]\n[[method]]\nid = "2fsk"\n'
    )
    (tmp_path / "bench.toml").write_text(table)
    for seen in (True, False):  # a resumed run does not look again
        assert main(["run", str(tmp_path / "bench.toml"), "-o", str(tmp_path / "out")]) == 0
        assert ("conjugate the samples" in capsys.readouterr().err) == seen
        [told] = json.loads((tmp_path / "out" / "result.json").read_text())["facts"]["doubts"][
            "plate"
        ]
        assert "conjugate the samples" in told
    assert "plate: the echoes focus better" in said(capsys, str(tmp_path / "out"))
    assert "conjugate the samples" in said(capsys, str(tmp_path / "bench.toml"))


def test_every_check_s_advice_takes_the_facts_of_its_thing(right, tmp_path, monkeypatch):
    """With checks that always find something, each says its advice once."""
    always = tuple(check._replace(found=lambda facts: True) for check in checks.CHECKS)
    monkeypatch.setattr(checks, "CHECKS", always)
    surface = read_surface(written(tmp_path / "plate", right) / "truth.ply")
    depth = DepthMap(np.arange(3.0), np.arange(2.0), np.full((2, 3), 0.3), np.zeros((2, 3)), "3fsk")
    figures = {"mae_mm": 1.0, "relative_accuracy_percent": 99.0}
    said = [
        *checks.array_warnings(right),
        *checks.pair_warnings(right),
        *checks.surface_warnings(surface),
        *checks.mesh_warnings(surface),
        *checks.transform_warnings(Transform("photo", "radar", np.eye(4)), surface),
        *checks.map_warnings(depth),
        *checks.figure_warnings(depth, figures),
    ]
    numbers = {"array", "pairs", "surface", "mesh", "transform", "depth map", "figures"}
    assert len(said) == sum(check.of in numbers for check in always) and "{" not in "".join(said)
    assert len({(check.of, check.name) for check in always}) == len(always)
