"""Inputs made to cost far more than they weigh: each as large as its form may be, or just
beyond."""

from __future__ import annotations

import io
import os
import pickle
import random
import struct
import zipfile
import zlib
from collections.abc import Callable
from pathlib import Path

import h5py
import numpy as np
from PIL import Image

SIZES = (500, 500, 20_000, 20_000, 250_000, 1_000_000, 5_000_000)


def _filled(unit: Callable[[int], str], size: int, head: str = "", tail: str = "") -> bytes:
    """A head, units 0, 1, … until there are `size` characters, and a tail."""
    parts, length, number = [head], 0, 0
    while length < size:
        parts.append(unit(number))
        length, number = length + len(parts[-1]), number + 1
    return "".join([*parts, tail]).encode()


def toml(content: bytes, rng: random.Random) -> bytes:
    """Long keys, deep values, many tables, before or after what is right."""
    size, parts = rng.choice(SIZES[:5]), rng.choice((2, 15, 31, 40, 5000))
    key, deep = ".".join(["a"] * parts), rng.choice((5, 30, 40, 300, 5000))
    made = rng.choice(
        (
            lambda: _filled(lambda k: f"{key}.b{k}=1\n", size),
            lambda: _filled(lambda k: f"{key}.b{k}=1\n", size, f"[z.{key}]\n"),
            lambda: _filled(lambda k: f"[{key}.b{k}]\n", size),
            lambda: _filled(lambda k: f"[[y.{key}]]\n", size),
            lambda: _filled(lambda k: f"a{k}={'[' * deep}{']' * deep}\n", size),
            lambda: _filled(lambda k: f"a{k}={'{a=' * deep}1{'}' * deep}\n", size),
            lambda: _filled(lambda k: "{}," if deep == 5 else "[],", size, "a=[", "]\n"),
            lambda: _filled(lambda k: f"a{k}=1\n", size),
            lambda: _filled(lambda k: "9" * 4299 + ",", size, "a=[", "]\n"),
            lambda: _filled(lambda k: ' " . ' if k % 2 else " ' . ", size, "a #"),
            lambda: _filled(lambda k: "[[method]]\nid='2fsk'\n", size),
            lambda: _filled(lambda k: "[[capture]]\nscene='scene.toml'\n", size),
            lambda: _filled(
                lambda k: f"[[marker]]\nid={k}\ncorners_m=[[0,0,0],[1,0,0],[1,-1,0],[0,-1,0]]\n",
                size,
            ),
        )
    )()
    return rng.choice((made, content + b"\n" + made, made + content))


def json(content: bytes, rng: random.Random) -> bytes:
    """Deep and wide trees, alone or as one of the values."""
    size, deep = rng.choice(SIZES), rng.choice((5, 30, 40, 900, 100_000))
    made = rng.choice(
        (
            lambda: b"[" * deep + b"]" * deep,
            lambda: b'{"a":' * deep + b"1" + b"}" * deep,
            lambda: _filled(lambda k: "[],", size, "[", "0]"),
            lambda: _filled(lambda k: "{},", size, "[", "{}]"),
            lambda: _filled(lambda k: f'"{k}":0,', size, "{", '"a":0}'),
            lambda: _filled(lambda k: "1e308,", size, "[", "0]"),
            lambda: _filled(lambda k: "9" * 4299 + ",", size, "[", "0]"),
            lambda: _filled(lambda k: "[[[[[[[[[[0]]]]]]]]]],", size, "[", "0]"),
            lambda: _filled(lambda k: '"\\ud800\\u0000",', size, "[", "0]"),
        )
    )()
    colons = [at for at in range(len(content)) if content[at : at + 1] == b":"]
    if not colons or not rng.randrange(4):
        return made
    at = rng.choice(colons) + 1
    return content[:at] + made + b"," + content[at:].lstrip()


def xml(content: bytes, rng: random.Random) -> bytes:
    """Elements within elements, many of them, with many attributes; sensors of many parts for many
    cameras."""
    size, deep = rng.choice(SIZES), rng.choice((20, 40, 5000, 300_000))
    made = rng.choice(
        (
            lambda: b"<a>" * deep + b"</a>" * deep,
            lambda: b"<a>" * deep,
            lambda: _filled(lambda k: "<a/>", size),
            lambda: _filled(lambda k: f' a{k}="1"', size, "<a", "/>"),
            lambda: _filled(lambda k: f"<a{k}/>", size),
            lambda: _filled(lambda k: '<camera id="0" sensor_id="0" label="x"/>', size),
            lambda: _filled(
                lambda k: f"<k{k}>1</k{k}>", size // 9, "<calibration>", "</calibration>"
            ),
            lambda: _filled(lambda k: "&#65;", size),
            lambda: b"<!--" + b"-" * size + b"-->",
        )
    )()
    end = rng.choice([at for at in range(len(content)) if content[at : at + 1] == b">"]) + 1
    return content[:end] + made + content[end:]


def csv(content: bytes, rng: random.Random) -> bytes:
    """Many cells, long lines, quotes without end."""
    size, head = rng.choice(SIZES), content.split(b"\n", 1)[0] + b"\n"
    return (
        head
        + rng.choice(
            (
                lambda: b"," * size,
                lambda: b"\n" * size,
                lambda: b'"' + b"\n" * size,
                lambda: b'"",' * (size // 3),
                lambda: b"1e400," * (size // 6),
                lambda: (content.split(b"\n")[1] + b"\n") * (size // len(content) + 1),
                lambda: b"9" * size,
            )
        )()
    )


DOUBLED = (b"q\0h\0\x86", b"2\x86", b"q\0h\0h\0\x87", b"\x94h\0\x86")
TAGS = (256, 257, 258, 259, 277, 278, 322, 323, 324, 325)


def _program(rng: random.Random) -> bytes:
    """A random program for the unpickler: things that are put into each other twice as often as
    not."""
    steps: list[bytes] = [
        b"\x80\x04",
        rng.choice((b"", b"}", b"]", b"\x8f", b"cnumpy\ndtype\n", b"(")),
    ]
    common = (b"N", b"K\x01", b"X\x01\0\0\0a", b"]", b"}", b")", b"(", b"\x88", b"C\x01a", b"\x8f")
    joins = (
        b"\x86",
        b"\x85",
        b"\x87",
        b"t",
        b"l",
        b"d",
        b"a",
        b"s",
        b"e",
        b"u",
        b"\x90",
        b"\x91",
        b"R",
        b"b",
        b"\x81",
    )
    names = (
        b"cnumpy\nndarray\n",
        b"cnumpy\ndtype\n",
        b"cnumpy._core.multiarray\n_reconstruct\n",
        b"cos\nsystem\n",
    )
    names += (b"cnumpy.core.multiarray\nscalar\n", b"\x8c\x05numpy\x8c\x07ndarray\x93")
    huge = (
        b"I" + b"9" * 4000 + b"\n",
        b"\x8b\xff\xff\xff\x00",
        b"\x8e" + b"\xff" * 8,
        b"r\xff\xff\xff\xff",
        b"L99L\n",
    )
    for _ in range(rng.choice((3, 10, 40))):
        match rng.randrange(6):
            case 0:
                steps.append(
                    rng.choice((b"q\0h\0\x86", b"2\x86", b"q\0h\0h\0\x87", b"\x94h\0\x86"))
                    * rng.choice((3, 60))
                )
            case 1:
                steps.append(rng.choice(names))
            case 2:
                steps.append(rng.choice(huge))
            case 3:
                steps.append(rng.choice(joins))
            case _:
                steps.append(rng.choice(common))
    return b"".join([*steps, rng.choice((b"s", b"u", b"R", b"b", b"\x90", b"")), b"."])


def npy(content: bytes, rng: random.Random) -> bytes:
    """Another program behind the header of a pickled dictionary, or within the dictionary."""
    end = 10 + int.from_bytes(content[8:10], "little")
    if b"'|O'" not in content[:end]:
        said = repr(
            {"descr": "<f8", "fortran_order": False, "shape": (rng.choice((2**40, 2**62, 3)),) * 3}
        ).encode()
        return content[:8] + struct.pack("<H", len(said)) + said + bytes(rng.choice(SIZES))
    program = _program(rng)
    match rng.randrange(5):
        case 0:
            return (
                content[:end]
                + rng.choice((b"]", b"(", b"N", b"\x94", b"}", b"K\0")) * rng.choice(SIZES)
                + b"."
            )
        case 1:  # as a key of the dictionary that is first filled
            at = content.find(b"}", end) + 1
            return content[:at] + program[2:-1] + b"s" + content[at:]
        case 2:
            holder = np.empty((), object)
            holder[()] = {
                "xr": np.zeros(3),
                "n": [()] * 3,
                "t": tuple(range(rng.choice((3, 5000)))),
            }
            return content[:end] + pickle.dumps(holder, rng.choice((2, 3, 4, 5)))
    return content[:end] + program


def npz(content: bytes, rng: random.Random) -> bytes:
    """An archive of many members, of members that lie over each other, or whose end says something
    else."""
    with zipfile.ZipFile(io.BytesIO(content)) as archive:
        members = {name: archive.read(name) for name in archive.namelist()}
    match rng.randrange(4):
        case 0:
            stream = io.BytesIO()
            with zipfile.ZipFile(stream, "w") as archive:
                for name, part in members.items():
                    archive.writestr(name, part)
                for k in range(rng.choice((100, 3000))):
                    archive.writestr(f"m{k}", b"")
            return stream.getvalue()
        case 1:  # the list of members, thousands of times
            at = content.find(b"PK\1\2")
            end = content.rfind(b"PK\5\6")
            listed = content[at:end] * rng.choice((20, 5000))
            tail = bytearray(content[end:])
            tail[8:20] = struct.pack("<HHII", 65535, 65535, len(listed), at)
            return content[:at] + listed + bytes(tail)
        case 2:
            end = content.rfind(b"PK\5\6")
            locator = b"PK\6\7" + struct.pack("<IQI", 0, rng.choice((0, len(content), 2**63)), 1)
            return content[:end] + locator + content[end:]
    comment = rng.randbytes(60_000) + rng.choice((b"", b"PK\5\6" + bytes(18)))
    return content[:-2] + struct.pack("<H", len(comment)) + comment


def hdf5(content: bytes, rng: random.Random) -> bytes:
    """Links through links, groups within themselves, pieces that unpack to more than they are."""
    stream = io.BytesIO(content)
    with h5py.File(stream, "r+") as file:
        names: list[str] = []
        file.visititems(
            lambda name, item: names.append(name) if isinstance(item, h5py.Dataset) else None
        )
        name = rng.choice(names)
        shape, dtype = file[name].shape, file[name].dtype
        del file[name]
        match rng.randrange(8):
            case 0:  # a soft link to an external one
                file["away"] = h5py.ExternalLink(
                    "/etc/passwd" if rng.randrange(2) else "other.h5", name
                )
                file[name] = h5py.SoftLink("/away")
            case 1:
                file["away"] = h5py.ExternalLink(".", "/")
                file[name] = h5py.SoftLink(f"/away/away/away/{name}")
            case 2:
                group = file.create_group("round")
                group["round"] = group
                file[name] = h5py.SoftLink("/round" + "/round" * rng.choice((2, 2000)))
            case 3:
                for k in range(rng.choice((50, 3000))):
                    file.create_group(f"g{k}")
            case 4 if shape:  # a piece that unpacks to a GB
                made = file.create_dataset(name, shape, dtype, chunks=shape, compression="gzip")
                made.id.write_direct_chunk(
                    (0,) * len(shape), _packed_zeros(rng.choice((2**20, 2**30)))
                )
            case 5 if shape:
                made = file.create_dataset(
                    name, shape, dtype, chunks=shape, compression="gzip", shuffle=True
                )
                made.id.write_direct_chunk(
                    (0,) * len(shape), rng.randbytes(300), rng.choice((0, 1, 3))
                )
            case 6:
                large = (2 ** rng.choice((20, 23, 26)),)
                file.create_dataset(
                    name, large, "u1", chunks=(rng.choice((1, 64, 2**20)),), compression="gzip"
                )
            case _:
                kind = h5py.h5t.array_create(
                    h5py.h5t.NATIVE_DOUBLE, (rng.choice((2, 2**10)), 2**10)
                )
                h5py.h5d.create(
                    file.id, b"array", kind, h5py.h5s.create_simple((rng.choice((1, 2**16)),))
                )
                file[name] = file["array"]
    return stream.getvalue()


def _packed_zeros(size: int) -> bytes:
    packer, block = zlib.compressobj(9), bytes(2**20)
    first = packer.compress(block) + packer.flush(zlib.Z_FULL_FLUSH)
    again = packer.compress(block) + packer.flush(zlib.Z_FULL_FLUSH)
    return first + again * (size // 2**20 - 1) + packer.flush(zlib.Z_FINISH)


def png(content: bytes, rng: random.Random) -> bytes:
    """Many pixels in few bytes, of all kinds."""
    kind, bits = rng.choice(((0, 1), (0, 8), (2, 8), (6, 8), (0, 16), (2, 16), (6, 16)))
    side = rng.choice((1000, 3900, 5600, 9000, 20_000))
    row = 1 + (side * {0: 1, 2: 3, 6: 4}[kind] * bits + 7) // 8
    packed = (
        _packed_zeros((row * side // 2**20 + 1) * 2**20) if side < 9000 else _packed_zeros(2**22)
    )
    parts = [
        (b"IHDR", struct.pack(">IIBBBBB", side, side, bits, kind, 0, 0, rng.choice((0, 0, 1))))
    ]
    parts += [(b"tEXt", bytes(1000))] * rng.choice((0, 2000)) + [(b"IDAT", packed), (b"IEND", b"")]
    made = (
        struct.pack(">I", len(b)) + t + b + struct.pack(">I", zlib.crc32(t + b)) for t, b in parts
    )
    return content[:8] + b"".join(made)


def jpeg(content: bytes, rng: random.Random) -> bytes:
    """Many passes over many pixels."""
    stream = io.BytesIO()
    side = rng.choice((64, 1000, 5600))
    Image.new("L", (side, side)).save(stream, "JPEG", progressive=True, quality=30)
    made = stream.getvalue()
    at = made.rfind(b"\xff\xda")
    return made[:at] + made[at:-2] * rng.choice((1, 20, 40, 3000)) + made[-2:]


def tiff(content: bytes, rng: random.Random) -> bytes:
    """Tags with other values: sizes, tiles, strips, compression."""
    order = "<" if content[:2] == b"II" else ">"
    (at,) = struct.unpack_from(order + "I", content, 4)
    broken = bytearray(content)
    (count,) = struct.unpack_from(order + "H", content, at)
    for _ in range(rng.choice((1, 1, 2))):
        entry = at + 2 + 12 * rng.randrange(count)
        match rng.randrange(3):
            case 0:
                struct.pack_into(order + "H", broken, entry, rng.choice(TAGS))
            case 1:
                struct.pack_into(
                    order + "I", broken, entry + 4, rng.choice((0, 2, 1000, 2**31, 2**32 - 1))
                )
            case _:
                value = rng.choice(
                    (0, 1, 2, 5, 7, 8, 32773, 34712, 50000, 60000, 10**6, 2**31, 2**32 - 1)
                )
                struct.pack_into(order + "I", broken, entry + 8, value)
    return bytes(broken)


def ply(content: bytes, rng: random.Random) -> bytes:
    """Faces of changing or no length, numbers of them that are hard to believe."""
    rows = rng.choice((5, 20_000, 3_000_000))
    kind = rng.choice(("uchar", "int", "ushort"))
    head = f"ply\nformat binary_little_endian 1.0\nelement vertex {rng.choice((3, 10**6, 10**9))}\n"
    head += "".join(f"property {rng.choice(('uchar', 'float'))} {axis}\n" for axis in "xyz")
    head += (
        f"element face {rng.choice((rows, 2**31))}\nproperty list {kind} uchar "
        "vertex_index\nend_header\n"
    )
    lengths = rng.choice((b"\0", b"\0\1\0", b"\3\0\1\2\4\0\1\2\0", b"\xff\xff\xff\xff"))
    return head.encode() + bytes(36) + lengths * rows


def obj(content: bytes, rng: random.Random) -> bytes:
    """Many corners, and faces that name what there is not."""
    corners = rng.choice(
        (b" 1 2 3", b" -1 -2 -3", b" 1" * 900, b" 1/" + b"1" * 4000 + b" 2 3", b" 1" * 3000)
    )
    line = rng.choice((b"f" + corners, b"v 0 0 0", b"#" * 5000, b"f 1" * 999)) + b"\n"
    return content + line * (rng.choice(SIZES[:6]) // len(line))


KNOWN: dict[str, Callable[[bytes, random.Random], bytes]] = {
    ".toml": toml,
    ".json": json,
    ".xml": xml,
    ".csv": csv,
    ".npy": npy,
    ".npz": npz,
    ".h5": hdf5,
    ".mat": hdf5,
    ".png": png,
    ".jpg": jpeg,
    ".tif": tiff,
    ".ply": ply,
    ".obj": obj,
}
LINKS = (
    "loop",
    "outside",
    "folder",
    "itself",
    "pipe",
    "device",
    "endless",
    "missing",
    "long",
    "locked",
)


def put(path: Path, link: str) -> None:
    """Something else in a file's place."""
    path.unlink()
    match link:
        case "loop":
            path.with_name(path.name + ".other").symlink_to(path.name)
            path.symlink_to(path.name + ".other")
        case "outside":
            path.symlink_to("/etc/passwd")
        case "folder":
            path.mkdir()
        case "itself":
            path.symlink_to(".")
        case "pipe":
            os.mkfifo(path)
        case "device":
            path.symlink_to("/dev/zero")
        case "endless":
            path.symlink_to("/proc/self/maps")
        case "long":
            for k in range(45):
                path.with_name(f"{path.name}.{k}").symlink_to(f"{path.name}.{k + 1}")
            path.symlink_to(f"{path.name}.0")
        case "locked":
            path.write_bytes(b"")
            path.chmod(0)


def clear(path: Path) -> None:
    """Take away what `put` has put."""
    for other in path.parent.glob(f"{path.name}.*"):
        if other.is_symlink():
            other.unlink()
    if path.is_dir() and not path.is_symlink():
        path.rmdir()
    else:
        path.unlink(missing_ok=True)
