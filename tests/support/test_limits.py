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


def deep(levels, first="[", last="]"):
    return first * levels + "0" + last * levels


@pytest.mark.parametrize("levels", [limits.DEEPEST - 1, limits.DEEPEST + 1, 500, 100_000])
def test_values_are_nested_so_deep_and_no_deeper(tmp_path, levels):
    (tmp_path / "a.json").write_text(deep(levels))
    (tmp_path / "a.toml").write_text(f"a = {deep(levels)}")
    if levels < limits.DEEPEST:
        read_json(tmp_path / "a.json", "lists"), read_toml(tmp_path / "a.toml", "lists")
        return
    for read in (read_json, read_toml):
        with pytest.raises(HandbenchError, match="readable as"):
            read(tmp_path / ("a.json" if read is read_json else "a.toml"), "lists")


@pytest.mark.parametrize("unit", ["{},", "0,", "[],"])
def test_many_values_are_refused(tmp_path, unit):
    (tmp_path / "a.json").write_text(f"[{unit * limits.MOST_VALUES}{unit[:-1]}]")
    with pytest.raises(HandbenchError, match="more than 200000 values"):
        read_json(tmp_path / "a.json", "lists")
    (tmp_path / "a.json").write_text(f"[{unit * 1000}{unit[:-1]}]")
    assert len(read_json(tmp_path / "a.json", "lists")) == 1001


def test_the_most_values_are_read(tmp_path):
    values = [0] * limits.MOST_VALUES  # an opening bracket, and a comma before each but the first
    (tmp_path / "a.json").write_text(json.dumps(values))
    assert read_json(tmp_path / "a.json", "lists") == values
    (tmp_path / "a.json").write_text(json.dumps([*values, 0]))
    with pytest.raises(HandbenchError, match="more than 200000 values"):
        read_json(tmp_path / "a.json", "lists")


def test_a_table_of_the_most_bytes_is_read(tmp_path):
    text = "a" * (limits.TOML_BYTES - len('text = ""\n'))
    (tmp_path / "a.toml").write_text(f'text = "{text}"\n')
    assert (tmp_path / "a.toml").stat().st_size == limits.TOML_BYTES
    assert read_toml(tmp_path / "a.toml", "keys") == {"text": text}


def test_long_keys_and_large_files_are_refused(tmp_path):
    key = ".".join(["a"] * (limits.DEEPEST + 1))
    (tmp_path / "a.toml").write_text(f"{key} = 1\n")
    with pytest.raises(HandbenchError, match="too many parts"):
        read_toml(tmp_path / "a.toml", "keys")
    (tmp_path / "a.toml").write_text("#" * (limits.TOML_BYTES + 1))
    with pytest.raises(HandbenchError, match=r"has 262145 bytes; expected keys, 262144 at most"):
        read_toml(tmp_path / "a.toml", "keys")
    (tmp_path / "a.csv").write_text("x_m,y_m,z_m\n" + "0" * limits.CSV_BYTES)
    with pytest.raises(HandbenchError, match="at most"):
        load_positions(tmp_path / "a.csv")


def test_thousands_of_problems_are_one_line():
    class Empty(Config):
        pass

    with pytest.raises(HandbenchError, match=r"x\.toml: 5000 of its values are wrong"):
        parse(Empty, {f"k{n}": n for n in range(5000)}, "x.toml")


def test_a_file_without_end_and_a_pipe_are_not_waited_for(tmp_path):
    assert read_bytes("/proc/self/maps", "text", 2**20) == b""  # its size says so
    os.mkfifo(tmp_path / "a.png")
    with (
        pytest.raises(HandbenchError, match="expected a photograph"),
        open_picture(tmp_path / "a.png"),
    ):
        pass


def test_a_circle_of_links_is_one_line(tmp_path):
    (tmp_path / "a").symlink_to("b")
    (tmp_path / "b").symlink_to("a")
    with pytest.raises(HandbenchError, match="expected a file, found nothing"):
        require_file(inside(tmp_path, "a", "mapping.toml"), "a file")


@pytest.mark.parametrize("more", [0, 1])
def test_archives_of_the_most_members_are_read_and_of_more_refused(tmp_path, more):
    write_npz(tmp_path / "a.npz", x=np.arange(3))
    with zipfile.ZipFile(tmp_path / "a.npz", "a") as archive:
        for k in range(limits.MOST_MEMBERS - 1 + more):
            archive.writestr(f"m{k}", b"")
        assert len(archive.namelist()) == limits.MOST_MEMBERS + more
    if not more:
        assert read_npz(tmp_path / "a.npz", ("x",))["x"].tolist() == [0, 1, 2]
        return
    with pytest.raises(HandbenchError, match="more than 1000 members"):
        read_npz(tmp_path / "a.npz", ("x",))


# --- HDF5
# -----------------------------------------------------------------------------------------------------------


@pytest.fixture
def echoes(tmp_path):
    capture = RadarCapture(
        np.ones((1, 2, 2, 2), np.complex64),
        np.array([1e9, 2e9]),
        AntennaArray(np.eye(3)[:2], np.eye(3)[:2]),
    )
    save_capture(tmp_path / "echoes.h5", capture)
    (tmp_path / "elsewhere").mkdir()
    save_capture(tmp_path / "elsewhere" / "other.h5", capture)
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
    said = "a heap of texts in it is broken" if broken else "signature not found"
    with pytest.raises((ValueError, OSError), match=said), open_hdf5(tmp_path / "a.h5"):
        pass


@pytest.mark.parametrize("name", ["samples", "frequencies_hz", "tx_m"])
@pytest.mark.parametrize(
    "chain", ["external", "soft to external", "soft", "through a group", "another's position_m"]
)
def test_what_links_lead_to_is_not_read(echoes, name, chain):
    """The other file is whole: a reader that followed the link would accept it."""
    with h5py.File(echoes, "a") as file:
        if chain == "another's position_m":
            file["position_m"] = h5py.ExternalLink("elsewhere/other.h5", "tx_m")
        else:
            file["kept"] = file[name]
            del file[name]
            file["away"] = h5py.ExternalLink("elsewhere/other.h5", name)
            file["whole"] = h5py.ExternalLink("elsewhere/other.h5", "/")
            file[name] = {
                "external": h5py.ExternalLink("elsewhere/other.h5", name),
                "soft to external": h5py.SoftLink("/away"),
                "soft": h5py.SoftLink("/kept"),
                "through a group": h5py.SoftLink(f"/whole/{name}"),
            }[chain]
    with pytest.raises(HandbenchError, match="of its own"):
        load_capture(echoes)


@pytest.mark.parametrize("size, fits", [(64, True), (2**26, False), (2**29, False)])
def test_pieces_that_unpack_to_more_than_they_are_are_refused(echoes, size, fits):
    packer = zlib.compressobj(9)
    packed = (
        b"".join(packer.compress(bytes(min(size, 2**24))) for _ in range(max(size // 2**24, 1)))
        + packer.flush()
    )
    with h5py.File(echoes, "a") as file:
        del file["samples"]
        made = file.create_dataset(
            "samples", (1, 2, 2, 2), np.complex64, chunks=(1, 2, 2, 2), compression="gzip"
        )
        made.id.write_direct_chunk((0, 0, 0, 0), packed)
    if fits:
        assert not load_capture(echoes).samples.any()
        return
    with pytest.raises(HandbenchError, match="a piece of 'samples'"):
        load_capture(echoes)


# --- pictures
# -------------------------------------------------------------------------------------------------------


def test_pictures_of_many_scans_pixels_or_other_forms_are_refused(tmp_path):
    Image.new("L", (64, 64)).save(tmp_path / "a.jpg", progressive=True)
    whole = (tmp_path / "a.jpg").read_bytes()
    with open_picture(tmp_path / "a.jpg") as image:
        assert image.size == (64, 64)
    at = whole.rfind(b"\xff\xda")
    (tmp_path / "a.jpg").write_bytes(whole[:at] + whole[at:-2] * 40 + whole[-2:])
    with pytest.raises(HandbenchError, match="scans"), open_picture(tmp_path / "a.jpg"):
        pass
    Image.new("L", (8, 8)).save(tmp_path / "a.gif")
    with (
        pytest.raises(HandbenchError, match="not a readable photograph"),
        open_picture(tmp_path / "a.gif"),
    ):
        pass
    Image.new("L", (8, 8)).save(tmp_path / "a.png")
    content = bytearray((tmp_path / "a.png").read_bytes())
    content[16:24] = struct.pack(">II", 9000, 9000)
    content[29:33] = struct.pack(">I", zlib.crc32(content[12:29]))
    (tmp_path / "a.png").write_bytes(content + bytes(10_000))
    with (
        pytest.raises(HandbenchError, match="9000 × 9000 pixels"),
        open_picture(tmp_path / "a.png"),
    ):
        pass


@pytest.mark.parametrize(("mode", "depth_bits", "pixels_a_byte"), [("L", 8, 1100), ("1", 1, 8800)])
def test_a_large_picture_holds_so_many_pixels_a_byte(tmp_path, mode, depth_bits, pixels_a_byte):
    """What deflate can pack at most: 1100 of a byte each, eight times as many of one bit."""
    Image.new(mode, (8, 8)).save(tmp_path / "a.png")
    content = bytearray((tmp_path / "a.png").read_bytes())
    assert content[24] == depth_bits
    content[16:24] = struct.pack(">II", 9000, 9000)
    content[29:33] = struct.pack(">I", zlib.crc32(content[12:29]))
    least = -(-(9000 * 9000) // pixels_a_byte)
    (tmp_path / "a.png").write_bytes(content + bytes(least - len(content)))
    with open_picture(tmp_path / "a.png") as image:
        assert image.size == (9000, 9000)
    (tmp_path / "a.png").write_bytes(content + bytes(least - 1 - len(content)))
    with (
        pytest.raises(HandbenchError, match="9000 × 9000 pixels"),
        open_picture(tmp_path / "a.png"),
    ):
        pass


@pytest.mark.parametrize("name", ["a" * 256, "a/" * 600, "é" * 128])
def test_names_too_long_for_a_file_are_one_line(tmp_path, name):
    with pytest.raises(HandbenchError, match=r"capture.toml: '.*' is too long"):
        inside(tmp_path, name, "capture.toml")
    assert inside(tmp_path, name[:120], "capture.toml").is_relative_to(tmp_path)
