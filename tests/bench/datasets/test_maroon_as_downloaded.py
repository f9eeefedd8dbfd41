"""A folder as MAROON's README describes it, written without handbench's reader: from the folder to
the table in one command, and what `inspect` prints about a spoiled alignment.json."""

import csv
import json
import shutil

import numpy as np
import pytest

from handbench.cli.main import main
from handbench.radar.data.arrays import qar50

pytestmark = pytest.mark.slow
SPEED_M_S, FVEC_HZ, SIDE = 299792458.0, np.linspace(72e9, 82e9, 128), 36
FLIP_X = np.diag([-1.0, 1.0, 1.0])


def card_m(distance_m):
    """A bent card with a bump, in their radar frame (x right, y up, z away): vertices, faces."""
    x, y = (axis.ravel() for axis in np.meshgrid(*2 * [np.linspace(-0.05, 0.05, SIDE)]))
    bump_m = 0.010 * np.exp(-((x - 0.02) ** 2 + (y - 0.015) ** 2) / 5e-4)
    vertices_m = np.stack([x, y, distance_m + 0.4 * x**2 + 0.9 * y**2 + 0.05 * x - bump_m], 1)
    index = np.arange(SIDE**2).reshape(SIDE, SIDE)
    a, b, c, d = index[:-1, :-1], index[:-1, 1:], index[1:, 1:], index[1:, :-1]
    faces = np.concatenate([np.stack([a, b, c], -1), np.stack([a, c, d], -1)]).reshape(-1, 3)
    cut = (vertices_m[faces, 0].mean(1) < -0.02) & (vertices_m[faces, 1].mean(1) > 0.02)
    return vertices_m, faces[~cut]


def echoes(vertices_m, faces):
    """xr [rx, tx, f] of 96 × 96 antennas: each facet echoes e^{−j2πfτ} in proportion to its area;
    the antennas' file has the opposite x."""
    corners = (vertices_m @ FLIP_X)[faces]
    area = np.linalg.norm(np.cross(*(corners[:, k] - corners[:, 0] for k in (1, 2))), axis=1)
    tx, rx = (
        np.linalg.norm(places_m[:, None] - corners.mean(1), axis=2)
        for places_m in (qar50().tx_m, qar50().rx_m)
    )
    xr = np.zeros((96, 96, len(FVEC_HZ)), np.complex64)
    for k, f_hz in enumerate(FVEC_HZ):
        wave = -2j * np.pi * f_hz / SPEED_M_S
        xr[1:95, 1:95, k] = (area * np.exp(wave * rx)) @ np.exp(wave * tx).T
    return 3e3 * xr / np.abs(xr).max()


def write_object(folder, distance_m, frames=2):
    """OBJECT/DISTANCE with radar and photogrammetry; its photographs' frame is turned and
    shifted."""
    vertices_m, faces = card_m(distance_m)
    radar, photos = folder / "radar_72.0_82.0_128", folder / "photogrammetry"
    (radar / "calibrated_data").mkdir(parents=True)
    photos.mkdir()
    xr, random = echoes(vertices_m, faces), np.random.default_rng(1)
    room = 100 * np.exp(-2j * np.pi * FVEC_HZ * 1.9 / SPEED_M_S)  # the same in every channel
    for number in range(frames):
        noise = 20 * random.standard_normal((*xr.shape, 2)).view(complex)[..., 0]
        for name, samples in (("", xr + noise + room), ("_emptyfiltered", xr + noise)):
            content = {"fvec": FVEC_HZ, "xr": samples.astype(np.complex64)}
            content |= {"number_of_measurements": frames, "timestamp_us": np.array([number])}
            np.save(radar / "calibrated_data" / f"{number:06d}{name}.npy", content)
    box = {"bb_min": [-0.06, -0.06, distance_m - 0.02], "bb_max": [0.06, 0.06, distance_m + 0.02]}
    frame = {"volume": box | {"grid_size": [61, 61, 41]}, "depth": {}}
    (radar / "calibration.json").write_text(json.dumps({"000000": frame, "000001": frame}))
    turn, _ = np.linalg.qr(np.random.default_rng(3).standard_normal((3, 3)))
    turn *= -np.linalg.det(turn)  # a reflection: the radar frame is left-handed
    shift_m = np.array([0.1, -0.2, 0.15])
    matrix = np.r_[np.c_[turn, shift_m], [[0, 0, 0, 1]]]
    (folder / "alignment.json").write_text(json.dumps({"photogrammetry2radar": matrix.tolist()}))
    facts = {"calibration": "01_registration_coarse", "distance_meters": distance_m}
    facts |= {"mask_erosion": 20, "labels": ["card"], "mask_bb": {"zmin": 0.2, "zmax": 0.6}}
    (folder / "metadata.json").write_text(json.dumps(facts))
    lines = ["mtllib mesh_masked.mtl"]
    lines += [f"v {x:.9f} {y:.9f} {z:.9f}" for x, y, z in (vertices_m - shift_m) @ turn]
    lines += ["vt 0 0", "usemtl Solid"]
    lines += ["f " + " ".join(f"{vertex}/1" for vertex in face) for face in faces + 1]
    (photos / "mesh_masked.obj").write_text("\n".join(lines) + "\n")


@pytest.fixture(scope="module")
def downloaded(tmp_path_factory):
    """The mini version's folder: one object at 30 and 40 cm."""
    root = tmp_path_factory.mktemp("downloaded") / "maroon"
    for centimetres in (30, 40):
        write_object(root / "48_card" / str(centimetres), centimetres / 100)
    return root


def mae_mm(folder):
    """MAE against photogrammetry by method, of a result folder's table.csv."""
    with (folder / "table.csv").open(encoding="utf-8") as stream:
        return {
            row["method"]: float(row["value"])
            for row in csv.DictReader(stream)
            if row["metric"] == "mae_mm"
        }


def test_from_the_folder_to_the_table_in_one_command(downloaded, tmp_path):
    assert main(["run", str(downloaded), "-o", str(tmp_path)]) == 0
    found = mae_mm(tmp_path)
    assert found["3fsk"] < 0.5 and found["broadband"] < 1.5 and found["2fsk"] < 5
    named = json.dumps(json.loads((tmp_path / "result.json").read_text("utf-8")))
    assert "48_card-30" in named and "48_card-40" in named


def test_a_data_set_is_no_capture_but_its_captures_are_named(downloaded, tmp_path, capsys):
    assert main(["import", "maroon", str(downloaded), "-o", str(tmp_path / "capture")]) == 2
    assert f"name one of them, such as {downloaded / '48_card' / '30'}" in capsys.readouterr().err


def flipped(*signs):
    return np.diag([*signs, 1.0])


def other_shift(matrix):
    return np.c_[matrix[:, :3], matrix[:, 3:] * [[-1], [1], [1], [1]]]


SPOILED = {
    "as it is": (lambda m: m, "no problem found"),
    "sign of x": (lambda m: flipped(-1, 1, 1) @ m, "photogrammetry2radar has no reflection"),
    "reflected points": (lambda m: m @ flipped(-1, 1, 1), "with the other sign of its column of x"),
    "x of the shift": (other_shift, "with the other sign of x in its shift"),
    "x of the rotation": (
        lambda m: flipped(-1, 1, 1) @ other_shift(m),
        "with the other sign of x in its shift",
    ),
    "the inverse": (np.linalg.inv, "inverted, the matrix puts it"),
    "elsewhere": (lambda m: m + 0.06 * np.eye(4, k=1)[[3, 3, 2, 3]], "mm from its surface, and"),
}


@pytest.mark.parametrize("name", SPOILED)
def test_inspect_names_a_wrong_sign_or_reflection(downloaded, tmp_path, capsys, name):
    change, words = SPOILED[name]
    folder = tmp_path / "30"
    shutil.copytree(downloaded / "48_card" / "30", folder)
    file = folder / "alignment.json"
    matrix = np.array(json.loads(file.read_text())["photogrammetry2radar"])
    file.write_text(json.dumps({"photogrammetry2radar": change(matrix).tolist()}))
    assert main(["inspect", str(folder)]) == 0
    printed = capsys.readouterr().out
    assert words in printed and ("check the signs in the matrix" in printed) == (name != "as it is")
