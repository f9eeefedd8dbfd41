"""Broken versions of binary forms, whose checksums and offsets are right: what is wrong is what
they say."""

from __future__ import annotations

import io
import random
import struct
import zipfile
import zlib
from functools import cache

import h5py
import numpy as np

EXTREMES = (np.nan, np.inf, -np.inf, 1e308, -1e308, 1e-320, 0.0, -1.0, 1e30)
DTYPES = ("f8", "f4", "f2", ">f8", "i8", "u1", "?", "c8", "c16", "S5", "U5", "M8[s]", "V3", "i4,f4")
HUGE = ((10**6, 10**6), (2**62, 4), (0,), (10**9,), (), (1,) * 32, (0, 2**62))
BOMB_BYTES = 3 * 2**30


def array(values: np.ndarray, rng: random.Random) -> np.ndarray:
    """Numbers, shape or kind of number changed."""
    values = np.array(values)
    match rng.randrange(6):
        case 0 if values.size and values.dtype.kind in "fc":
            values.reshape(-1)[rng.randrange(values.size)] = rng.choice(EXTREMES)
        case 1 if values.size and values.dtype.kind in "fc":
            values[...] = rng.choice(EXTREMES)
        case 2:
            values = values.T if rng.randrange(2) else values.reshape(-1)
        case 3:
            values = np.zeros(
                rng.choice(((), (0,), (1,), (2, 2), (0, 3), (1, 1, 1), (5, 1))), values.dtype
            )
        case 4:
            values = np.zeros(values.shape, rng.choice(DTYPES))
        case 5 if values.ndim:
            values = np.concatenate([values, values], axis=rng.randrange(values.ndim))
    return values


def saved(values: np.ndarray) -> bytes:
    """As .npy, objects pickled."""
    stream = io.BytesIO()
    np.save(stream, values, allow_pickle=True)
    return stream.getvalue()


def npy(content: bytes, rng: random.Random) -> bytes:
    """One of the arrays in a .npy file (or several after each other) says another shape, or is
    another."""
    headers = [at for at in range(len(content)) if content.startswith(b"\x93NUMPY", at)]
    at = rng.choice(headers)
    end = at + 10 + int.from_bytes(content[at + 8 : at + 10], "little")
    after = min((h for h in headers if h > at), default=len(content))
    if rng.randrange(2):
        said = {
            "descr": rng.choice((*DTYPES, "<f8", "|O")),
            "fortran_order": bool(rng.randrange(2)),
            "shape": rng.choice(HUGE),
        }
        head = repr(said).encode().ljust(end - at - 11) + b"\n"
        return content[: at + 8] + struct.pack("<H", len(head)) + head + content[end:]
    if b"'|O'" in content[at:end]:  # MAROON's pickles: few bytes of them are no samples
        return content[:end] + flipped(content[end : end + 300], rng) + content[end + 300 :]
    values = np.load(io.BytesIO(content[at:after]), allow_pickle=False)
    return content[:at] + saved(array(values, rng)) + content[after:]


def npz(content: bytes, rng: random.Random) -> bytes:
    """One of the arrays is broken, its file's checksum right; or a bomb, a pickle, a member twice
    or elsewhere."""
    with zipfile.ZipFile(io.BytesIO(content)) as archive:
        members = {name: archive.read(name) for name in archive.namelist()}
    chosen, extra = rng.choice(list(members)), None
    match rng.randrange(12):
        case 0:
            members[chosen] = saved(np.array([{"a": 1}], object))
        case 1:
            return _with_bomb(members, chosen)
        case 2:
            extra = rng.choice((chosen, "../" + chosen, "/tmp/" + chosen, "", chosen + "x"))
        case 3:
            del members[chosen]
        case 4:
            members[chosen] = members[chosen][: rng.randrange(len(members[chosen]))]
        case 5:
            at = rng.randrange(min(128, len(members[chosen])))
            members[chosen] = members[chosen][:at] + rng.randbytes(1) + members[chosen][at + 1 :]
        case _:
            members[chosen] = npy(members[chosen], rng)
    stream = io.BytesIO()
    with zipfile.ZipFile(
        stream, "w", rng.choice((zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED))
    ) as archive:
        for name, part in members.items():
            archive.writestr(name, part)
        if extra is not None:
            archive.writestr(zipfile.ZipInfo(extra), members[chosen])
    return stream.getvalue()


@cache
def _bomb() -> tuple[bytes, int]:
    """3 GiB of numbers, deflated, with their checksum; by repeating one block that stands for
    itself."""
    head = repr({"descr": "<f8", "fortran_order": False, "shape": (BOMB_BYTES // 8,)}).encode()
    head = b"\x93NUMPY\x01\x00" + struct.pack("<H", len(head) + 1) + head + b"\n"
    block, packer = bytes(2**24), zlib.compressobj(9, zlib.DEFLATED, -15)
    first = packer.compress(head) + packer.flush(zlib.Z_FULL_FLUSH)
    again = packer.compress(block) + packer.flush(zlib.Z_FULL_FLUSH)
    crc = zlib.crc32(head)
    for _ in range(BOMB_BYTES // len(block)):
        crc = zlib.crc32(block, crc)
    return first + again * (BOMB_BYTES // len(block)) + packer.flush(zlib.Z_FINISH), crc


def _with_bomb(members: dict[str, bytes], chosen: str) -> bytes:
    """The archive, with 3 GiB of zeros in place of one array."""
    packed, crc = _bomb()
    stream = io.BytesIO()
    with zipfile.ZipFile(stream, "w") as archive:
        for name, part in members.items():
            if name != chosen:
                archive.writestr(name, part)
        info = zipfile.ZipInfo(chosen)
        archive.writestr(info, packed)
        info.compress_type, info.CRC, info.file_size = zipfile.ZIP_DEFLATED, crc, BOMB_BYTES + 128
    return stream.getvalue()


def hdf5(content: bytes, rng: random.Random) -> bytes:
    """One of the data sets or attributes is another: of another kind, shape or layout, or no data
    set at all."""
    stream = io.BytesIO(content)
    with h5py.File(stream, "r+") as file:
        names: list[str] = []
        file.visititems(
            lambda name, item: names.append(name) if isinstance(item, h5py.Dataset) else None
        )
        if file.attrs and rng.randrange(6) == 0:
            values = (0, "x", b"\xff", [1, 2], 2**63, 1.5, np.zeros((3, 3)))
            file.attrs[rng.choice(list(file.attrs))] = rng.choice(values)
        elif names:
            name = rng.choice(names)
            _replace(file, name, file[name][()], rng)
    return stream.getvalue()


def _replace(file: h5py.File, name: str, values: np.ndarray, rng: random.Random) -> None:
    del file[name]
    shape = values.shape
    match rng.randrange(16):
        case 0:
            file.create_group(name)
        case 1:
            file[name] = rng.choice(
                (h5py.SoftLink("/" + name), h5py.SoftLink("/nowhere"), h5py.SoftLink("/"))
            )
        case 2:
            file[name] = h5py.ExternalLink("/etc/passwd", "x")
        case 3:
            file[name] = h5py.Empty("f4")
        case 4:
            file.create_dataset(name, data=rng.choice((["a", "b"], "text", np.void(b"abc"))))
        case 5:
            large = (*shape[:-1], rng.choice((10**6, 2 * 10**8, 10**13))) if shape else (10**9,)
            file.create_dataset(
                name, large, values.dtype, chunks=(*(1 for _ in large[:-1]), 1024), fillvalue=1
            )
        case 6:
            file.create_dataset(name, (2**28,), "u1")  # declared, and never written
        case 7:
            file.create_dataset(
                name, (2 ** rng.choice((20, 27)),), "f8", chunks=(2**20,), compression="gzip"
            )[: 2**20] = 0
        case 8:
            file.create_dataset(name, shape, "f4", external=[("/etc/passwd", 0, 4 * values.size)])
        case 9:
            layout = h5py.VirtualLayout((3,), "f4")
            layout[...] = h5py.VirtualSource("/etc/passwd", "x", (3,))
            file.create_virtual_dataset(name, layout)
        case 10:
            file[name] = h5py.SoftLink("/" + "/".join([name] * 50))
        case 11 if values.ndim:
            packed = {
                "chunks": True,
                "compression": rng.choice(("gzip", "lzf")),
                "shuffle": bool(rng.randrange(2)),
            }
            file.create_dataset(name, data=values, fletcher32=bool(rng.randrange(2)), **packed)
        case 12:
            file.create_dataset(name, shape, h5py.special_dtype(vlen=np.float32))
        case 13:
            file.create_dataset(name, (2,), h5py.ref_dtype)
        case _:
            changed = array(values, rng)
            file[name] = changed.astype("S") if changed.dtype.kind in "UM" else changed


def png(content: bytes, rng: random.Random) -> bytes:
    """A chunk is changed, doubled, removed or added, with the right checksum."""
    chunks, at = [], 8
    while at + 12 <= len(content):
        (size,) = struct.unpack_from(">I", content, at)
        chunks.append((content[at + 4 : at + 8], content[at + 8 : at + 8 + size]))
        at += 12 + size
    k = rng.randrange(len(chunks))
    kind, body = chunks[k]
    match rng.randrange(6):
        case 0:
            width, height = (
                rng.choice((0, 1, 7, 4000, 20_000, 46_000, 2**31 - 1, 2**32 - 1)) for _ in range(2)
            )
            bits, colours, interlaced = (
                rng.choice((1, 2, 4, 8, 16, 3)),
                rng.randrange(8),
                rng.randrange(3),
            )
            form = rng.choice((body[8:13], bytes([bits, colours, 0, 0, interlaced])))
            chunks[0] = (b"IHDR", struct.pack(">II", width, height) + form)
        case 1:
            chunks.insert(k, (kind, body))
        case 2:
            del chunks[k]
        case 3:
            packed = zlib.compress(bytes(2**26), 9)
            chunks.insert(
                1,
                rng.choice(
                    (
                        (b"zTXt", b"a\0\0" + packed),
                        (b"iCCP", b"a\0\0" + packed),
                        (b"eXIf", rng.randbytes(60)),
                        (b"tRNS", bytes(300)),
                        (b"PLTE", bytes(5)),
                        (b"acTL", bytes(8)),
                        (b"eXIf", b"Exif\0\0II*\0" + rng.randbytes(40)),
                    )
                ),
            )
        case 4 if body:
            chunks[k] = (kind, flipped(body, rng))
        case _:
            chunks[k] = (rng.choice((b"IDAT", b"IEND", b"tEXt", b"ABCD")), body)
    parts = (
        struct.pack(">I", len(b)) + t + b + struct.pack(">I", zlib.crc32(t + b)) for t, b in chunks
    )
    return content[:8] + b"".join(parts)


def jpeg(content: bytes, rng: random.Random) -> bytes:
    """A segment is changed, doubled or removed, the picture's size or its EXIF data among them."""
    segments, at = [], 2
    while at + 4 <= len(content) and content[at] == 0xFF and content[at + 1] != 0xDA:
        size = int.from_bytes(content[at + 2 : at + 4], "big")
        segments.append(content[at : at + 2 + size])
        at += 2 + size
    k = rng.randrange(len(segments))
    sizes = [n for n, segment in enumerate(segments) if segment[1] in (0xC0, 0xC1, 0xC2)]
    exif = [n for n, segment in enumerate(segments) if segment[1] == 0xE1]
    match rng.randrange(6):
        case 0 if sizes:
            size = struct.pack(
                ">HH", *(rng.choice((0, 1, 9, 4000, 9000, 20_000, 65535)) for _ in range(2))
            )
            segments[sizes[0]] = segments[sizes[0]][:5] + size + segments[sizes[0]][9:]
        case 1 | 2 if exif:
            segments[exif[0]] = segments[exif[0]][:10] + flipped(segments[exif[0]][10:], rng)
        case 3:
            segments.insert(k, segments[k])
        case 4:
            del segments[k]
        case _:
            segments[k] = segments[k][:4] + flipped(segments[k][4:], rng)
    return content[:2] + b"".join(segments) + content[at:]


def flipped(content: bytes, rng: random.Random) -> bytes:
    """Some bytes become others."""
    broken = bytearray(content)
    for _ in range(rng.randint(1, 4) if broken else 0):
        broken[rng.randrange(len(broken))] = rng.choice(
            (0, 1, 2, 4, 5, 8, 12, 127, 128, 255, rng.randrange(256))
        )
    return bytes(broken)
