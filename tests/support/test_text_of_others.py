"""Files that other programs and editors save: what is right is read, the rest is named."""

import cv2
import numpy as np
import pytest

from handbench.groundtruth.cameras.metashape import read_metashape
from handbench.groundtruth.mesh.mesh_files import read_triangles
from handbench.groundtruth.photos.photos import find_photos
from handbench.radar.data.arrays import load_positions
from handbench.support.config import read_toml
from handbench.support.errors import HandbenchError
from handbench.support.files import read_json

CSV = "x_m,y_m,z_m\n0.5,0,0\n-0.5,0,0.25\n"
PLY = (
    "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\n"
    "property float z\nelement face 1\nproperty list uchar int vertex_indices\nend_header\n"
    "0 0 0.5\n1 0 0.5\n0 1 0.5\n3 0 1 2\n"
)
OBJ = "v 0 0 0.5\nv 1 0 0.5\nv 0 1 0.5\nf 1 2 3\n"


@pytest.mark.parametrize(
    "text", ["\ufeff" + CSV, CSV.replace(",", ", "), CSV + "\n\n", CSV.replace("\n", "\r")]
)
def test_positions_are_read_as_spreadsheets_save_them(tmp_path, text):
    (tmp_path / "tx_m.csv").write_bytes(text.encode())
    assert np.array_equal(load_positions(tmp_path / "tx_m.csv"), [[0.5, 0, 0], [-0.5, 0, 0.25]])


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (CSV.replace(",", ";").replace(".", ",").encode(), "separated by commas"),
        ((CSV + "1,2\n").encode(), "1,2 has 2 values"),
        (CSV.encode("utf-16"), "UTF-16; save the file as UTF-8"),
    ],
)
def test_positions_of_another_form_are_named(tmp_path, content, message):
    (tmp_path / "tx_m.csv").write_bytes(content)
    with pytest.raises(HandbenchError, match=message):
        load_positions(tmp_path / "tx_m.csv")


@pytest.mark.parametrize(("name", "text"), [("a.obj", OBJ), ("a.ply", PLY)])
def test_lines_of_a_mesh_may_end_with_a_carriage_return(tmp_path, name, text):
    (tmp_path / name).write_bytes(text.replace("\n", "\r").encode())
    vertices_m, faces, _ = read_triangles(tmp_path / name)
    assert np.array_equal(vertices_m, [[0, 0, 0.5], [1, 0, 0.5], [0, 1, 0.5]])
    assert np.array_equal(faces, [[0, 1, 2]])


@pytest.mark.parametrize(
    ("name", "content", "message"),
    [
        ("a.ply", PLY.replace("0.5", "0,5").encode(), "decimal commas"),
        ("a.ply", PLY.replace("t face", "t tristrips").encode(), "triangle strips"),
        ("a.obj", OBJ.encode("utf-16"), "UTF-16; save the file as UTF-8"),
        ("a.stl", b"; made by hand\nsolid a\nendsolid a\n" * 4, "does not begin with 'solid'"),
    ],
)
def test_a_mesh_of_another_form_is_named(tmp_path, name, content, message):
    (tmp_path / name).write_bytes(content)
    with pytest.raises(HandbenchError, match=message):
        read_triangles(tmp_path / name)


@pytest.mark.parametrize(
    ("read", "content", "message"),
    [
        (read_toml, b"a = 1\nb = 0,3\n", "'b = 0,3'; write decimals with a point"),
        (read_json, b'{"a": 1,\n"b": 0,3}', '"b": 0,3}\'; write decimals with a point'),
        (read_toml, b"['line 9, column 1']\n['line 9, column 1']\n", "(at line 2, column 20)"),
        (read_toml, "a = “b”".encode(), "'a = “b”'"),
        (read_toml, "a = 'ü'".encode("utf-16"), "UTF-16; save the file as UTF-8"),
        (read_json, b"{\0\n\0}\0", "UTF-16; save the file as UTF-8"),
        (read_toml, b"a = 1\nb = '\xfc'", "line 2 is not UTF-8"),
    ],
)
def test_the_place_of_a_fault_in_a_text_is_shown(tmp_path, read, content, message):
    (tmp_path / "a").write_bytes(content)
    with pytest.raises(HandbenchError) as caught:
        read(tmp_path / "a", "a table")
    assert message in str(caught.value)


CHUNK = "<chunk><cameras>%s</cameras></chunk>"


@pytest.mark.parametrize("empty", [CHUNK % "", "<chunk/>"])
def test_a_metashape_chunk_without_cameras_is_passed_over(tmp_path, empty):
    camera = CHUNK % "<camera label='a'/>"
    (tmp_path / "a.xml").write_text(f"<document>{empty}{camera}</document>")
    assert read_metashape(tmp_path / "a.xml", photos=["b.jpg"]) == ()
    (tmp_path / "a.xml").write_text(f"<document>{camera}{camera}</document>")
    with pytest.raises(HandbenchError, match="has 2 Metashape chunks with cameras"):
        read_metashape(tmp_path / "a.xml", photos=["b.jpg"])


def pictures(folder, suffixes):
    picture = np.zeros((20, 30), np.uint8)
    for k, suffix in enumerate(suffixes):
        (folder / f"{k}{suffix}").write_bytes(cv2.imencode(".jpg", picture)[1])
    return folder


def test_every_suffix_of_jpeg_is_read(tmp_path):
    photos = find_photos(pictures(tmp_path, [".jpg", ".JPE", ".jfif"]))
    assert [photo.name for photo in photos] == ["0.jpg", "1.JPE", "2.jfif"]


def test_photographs_of_which_none_can_be_read_are_named(tmp_path):
    with pytest.raises(
        HandbenchError, match=r"found only 0 photographs.*0\.dng and 1 more: left out"
    ):
        find_photos(pictures(tmp_path, [".dng", ".CR3"]))


def test_another_format_under_the_name_of_a_jpeg_is_named(tmp_path):
    folder = pictures(tmp_path, [".jpg"] * 3)
    (folder / "1.jpg").write_bytes(b"\0\0\0\x1cftypavif" + b"\0" * 16)
    with pytest.raises(HandbenchError, match=r"1\.jpg: .*no JPEG.* inside, but AVIF"):
        find_photos(folder)
