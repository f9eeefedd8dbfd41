"""Files that cost more than they weigh are refused in words, and those at the limits are read."""

import json
import os
import signal
import struct
import zipfile
import zlib

import h5py
import numpy as np
import pytest
from PIL import Image

from handbench.radar.data.arrays import AntennaArray, load_positions
from handbench.radar.data.capture import RadarCapture
from handbench.radar.data.echoes_file import load_capture, save_capture
from handbench.support import limits
from handbench.support.config import Config, parse, read_toml
from handbench.support.errors import HandbenchError
from handbench.support.files import inside, read_bytes, read_json, read_npz, require_file, write_npz
from handbench.support.hdf5 import open_hdf5
from handbench.support.pictures import open_picture

HANG_S = 60  # of the processor: what is read in a second here takes no minute anywhere


@pytest.fixture(autouse=True)
def hangs_end():
    """What does not end is a failure, and no hang of the tests."""

    def end(*_):
        raise TimeoutError(f"{HANG_S} s of the processor, and no end")

    before = signal.signal(signal.SIGPROF, end)
    signal.setitimer(signal.ITIMER_PROF, HANG_S)
    yield
    signal.setitimer(signal.ITIMER_PROF, 0)
    signal.signal(signal.SIGPROF, before)


@pytest.mark.parametrize("levels", [limits.DEEPEST - 1, limits.DEEPEST + 1])
@pytest.mark.parametrize(("read", "start"), [(read_json, ""), (read_toml, "a = ")])
def test_values_are_nested_so_deep_and_no_deeper(tmp_path, levels, read, start):
    (tmp_path / "a").write_text(start + "[" * levels + "0" + "]" * levels)
    if levels < limits.DEEPEST:
        read(tmp_path / "a", "lists")
        return
    with pytest.raises(HandbenchError, match="readable as"):
        read(tmp_path / "a", "lists")


def test_the_most_values_are_read(tmp_path):
    values = [0] * limits.MOST_VALUES  # an opening bracket, and a comma before each but the first
    (tmp_path / "a.json").write_text(json.dumps(values))
    assert read_json(tmp_path / "a.json", "lists") == values
    for more in ([*values, 0], [{}, *values]):
        (tmp_path / "a.json").write_text(json.dumps(more))
        with pytest.raises(HandbenchError, match="more than 200000 values"):
            read_json(tmp_path / "a.json", "lists")


@pytest.mark.parametrize(
    ("read", "text", "message"),
    [
        (lambda path: read_toml(path, "keys"), ".".join(["a"] * 33) + " = 1\n", "too many parts"),
        (
            lambda path: read_toml(path, "keys"),
            "#" * (limits.TOML_BYTES + 1),
            "has 262145 bytes, too many for keys",
        ),
        (load_positions, "x_m,y_m,z_m\n" + "0" * limits.CSV_BYTES, "at most"),
        (load_positions, "x_m,y_m,z_m\n" + "0,0,0\n" * 2001, "2001 antennas, more than"),
    ],
)
def test_long_keys_and_large_files_are_refused(tmp_path, read, text, message):
    (tmp_path / "a").write_text(text)
    with pytest.raises(HandbenchError, match=message):
        read(tmp_path / "a")


def test_thousands_of_problems_are_one_line():
    class Empty(Config):
        pass

    with pytest.raises(HandbenchError, match=r"x\.toml: 5000 of its values are wrong"):
        parse(Empty, {f"k{n}": n for n in range(5000)}, "x.toml")


def test_archives_of_the_most_members_are_read_and_of_more_refused(tmp_path):
    write_npz(tmp_path / "a.npz", x=np.arange(3))
    with zipfile.ZipFile(tmp_path / "a.npz", "a") as archive:
        for k in range(limits.MOST_MEMBERS - 1):
            archive.writestr(f"m{k}", b"")
    assert read_npz(tmp_path / "a.npz", ("x",))["x"].tolist() == [0, 1, 2]
    with zipfile.ZipFile(tmp_path / "a.npz", "a") as archive:
        archive.writestr("one more", b"")
    with pytest.raises(HandbenchError, match="more than 1000 arrays"):
        read_npz(tmp_path / "a.npz", ("x",))


@pytest.fixture
def echoes(tmp_path):
    array = AntennaArray(np.eye(3)[:2], np.eye(3)[:2])
    samples = np.ones((1, 2, 2, 2), np.complex64)
    save_capture(tmp_path / "echoes.h5", RadarCapture(samples, np.array([1e9, 2e9]), array))
    return tmp_path / "echoes.h5"


@pytest.mark.parametrize(
    ("sizes", "broken"), [((8, 20, 16), False), ((8, 20, 0), True), ((0,), True)]
)
def test_a_heap_in_which_the_library_would_run_in_circles_is_refused(tmp_path, sizes, broken):
    """Objects with a number and a size, in steps of 8 bytes; the last has no number, and the rest
    for its size."""
    content = b"".join(
        struct.pack("<HHIQ", number, 0, 0, size)
        + bytes((size + 7) // 8 * 8 if number else max(size - 16, 0))
        for number, size in zip((*range(1, len(sizes)), 0), sizes, strict=True)
    )
    heap = b"GCOL\x01\0\0\0" + struct.pack("<Q", 16 + len(content)) + content
    (tmp_path / "a.h5").write_bytes(b"x" * 40 + heap + bytes(40))  # what follows is no part of it
    reason = "storage of texts" if broken else "signature not found"
    with pytest.raises((ValueError, OSError), match=reason), open_hdf5(tmp_path / "a.h5"):
        pass


@pytest.mark.parametrize("size, fits", [(64, True), (2**26, False)])
def test_pieces_that_unpack_to_more_than_they_are_are_refused(echoes, size, fits):
    with h5py.File(echoes, "a") as file:
        del file["samples"]
        piece = (1, 2, 2, 2)
        made = file.create_dataset("samples", piece, "c8", chunks=piece, compression="gzip")
        made.id.write_direct_chunk((0, 0, 0, 0), zlib.compress(bytes(size), 9))
    if fits:
        assert not load_capture(echoes).samples.any()
        return
    with pytest.raises(HandbenchError, match="a chunk of 'samples'"):
        load_capture(echoes)


@pytest.mark.parametrize(("mode", "pixels_a_byte"), [("L", 1100), ("1", 8800)])
def test_a_large_picture_holds_so_many_pixels_a_byte(tmp_path, mode, pixels_a_byte):
    """What deflate can pack at most: 1100 of a byte each, eight times as many of one bit."""
    Image.new(mode, (8, 8)).save(tmp_path / "a.png")
    content = bytearray((tmp_path / "a.png").read_bytes())
    content[16:24] = struct.pack(">II", 9000, 9000)
    content[29:33] = struct.pack(">I", zlib.crc32(content[12:29]))
    least = -(-(9000 * 9000) // pixels_a_byte)
    (tmp_path / "a.png").write_bytes(content + bytes(least - len(content)))
    with open_picture(tmp_path / "a.png") as image:
        assert image.size == (9000, 9000)
    (tmp_path / "a.png").write_bytes(content + bytes(least - 1 - len(content)))
    refused_picture(tmp_path / "a.png", "9000 × 9000 pixels")


@pytest.mark.parametrize("name", ["a/" * 600, "é" * 128])
def test_names_too_long_for_a_file_are_one_line(tmp_path, name):
    with pytest.raises(HandbenchError, match=r"capture.toml: '.*' is too long"):
        inside(tmp_path, name, "capture.toml")
    assert inside(tmp_path, name[:120], "capture.toml").is_relative_to(tmp_path)


def test_what_has_no_end_is_not_waited_for(tmp_path):
    """A file without end, a pipe, and a circle of links."""
    assert read_bytes("/proc/self/maps", "text", 2**20) == b""  # its size says so
    os.mkfifo(tmp_path / "a.png")
    refused_picture(tmp_path / "a.png", "expected a photograph")
    (tmp_path / "a").symlink_to("b")
    (tmp_path / "b").symlink_to("a")
    with pytest.raises(HandbenchError, match="expected a file, found nothing"):
        require_file(inside(tmp_path, "a", "mapping.toml"), "a file")


def refused_picture(path, message):
    with pytest.raises(HandbenchError, match=message), open_picture(path):
        pass


def test_pictures_of_many_scans_are_refused(tmp_path):
    Image.new("L", (64, 64)).save(tmp_path / "a.jpg", progressive=True)
    whole = (tmp_path / "a.jpg").read_bytes()
    with open_picture(tmp_path / "a.jpg") as image:
        assert image.size == (64, 64)
    at = whole.rfind(b"\xff\xda")
    (tmp_path / "a.jpg").write_bytes(whole[:at] + whole[at:-2] * 40 + whole[-2:])
    refused_picture(tmp_path / "a.jpg", "scans")
