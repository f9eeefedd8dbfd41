"""Broken versions of a file: where the form of its content is known, what comes out is often nearly
right; a few are made to cost far more than they weigh, or are something else in the file's
place."""

from __future__ import annotations

import io
import json
import os
import random
import re
import struct
import tomllib
import warnings
import zipfile
import zlib
from collections.abc import Callable
from contextlib import suppress
from functools import cache
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import tomlkit

Mutation = Callable[[bytes, random.Random], bytes]

NUMBER = re.compile(rb"-?\d+(?:\.\d*)?(?:[eE][-+]?\d+)?")
NUMBERS = (
    *b"nan inf -inf 1e308 -1e308 1e-320 1e999 -1 0 -0.0 1 2 3.5 4294967296 1_0 0x10".split(),
    *b'true null "" [] {} \''.split(),
    b"9" * 400,
    b"9" * 5000,
)
TEXTS = ("", "../../etc/passwd", "/etc/passwd", "a\0b", "x" * 5000, "\u202e\x1b[31m", "..", "%s%n")
VALUES = (
    *(None, True, 0, -1, 2, 10**9, -(10**9), 2**31, 2**63, 10**400, 0.5, 1e-320, 1e308),
    *(float("nan"), float("inf"), [], {}, [[]], [0], [1, 2], [{}], {"a": 1}, ["a"]),
    *([[0.0] * 4] * 4, [[1.0, 0.0], [0.0]], [[[[[[[[[[]]]]]]]]]]),
)
STRANGE = (b"\xff\xfe", b"\x80", b"\xc3\x28", b"\0", b"\r", b"\xed\xa0\x80", b"\x1a")
WORDS = (0, 1, 2, 127, 128, 255, 32768, 65535, 2**31 - 1, 2**31, 2**32 - 1, 2**63, 2**64 - 1)
EDGE = 512  # bytes at a file's head and tail, where what matters usually lies
EXTREMES = (np.nan, -np.inf, 1e308, 0.0)
DTYPES = ("f8", ">f4", "i8", "u1", "c16", "U5", "V3", "i4,f4", "|O")
SHAPES = ((10**6, 10**6), (2**62, 4), (0,), (10**9,), (), (1,) * 32, (0, 2**62))


@cache
def zeros() -> bytes:
    """A quarter of a gigabyte in little."""
    return zlib.compress(bytes(2**28), 9)


def place(content: bytes, rng: random.Random) -> int:
    """The place to break a file at: as often in its head and in its tail as in all of it."""
    if not content:
        return 0
    near = rng.randrange(min(EDGE, len(content)))
    return rng.choice((near, len(content) - 1 - near, rng.randrange(len(content))))


def flip(content: bytes, rng: random.Random) -> bytes:
    """One to five bits."""
    broken = bytearray(content)
    for _ in range(rng.randint(1, 5) if content else 0):
        broken[place(content, rng)] ^= 1 << rng.randrange(8)
    return bytes(broken)


def word(content: bytes, rng: random.Random) -> bytes:
    """A whole number of 1, 2, 4 or 8 bytes, at an aligned place, becomes an extreme one."""
    size, order = rng.choice((1, 2, 4, 8)), rng.choice(("little", "big"))
    at = place(content, rng) // size * size
    value = rng.choice(WORDS) % 256**size
    return content[:at] + value.to_bytes(size, order) + content[at + size :]


def spliced(content: bytes, rng: random.Random) -> bytes:
    """A run of bytes is removed, doubled, moved, zeroed, made noise, or all that is left."""
    size, at, source = rng.choice((1, 4, 16, 512, 4096)), place(content, rng), place(content, rng)
    run, moved = content[at : at + size], content[source : source + size]
    new = rng.choice((b"", run + run, moved, bytes(len(run)), rng.randbytes(len(run))))
    return content[:at] + rng.choice((new + content[at + size :], new + content[at + size :], b""))


def numbered(content: bytes, rng: random.Random) -> bytes:
    """A number of a text becomes an extreme one."""
    found = list(NUMBER.finditer(content))
    if not found:
        return flip(content, rng)
    chosen = rng.choice(found[:40] if rng.randrange(2) else found)
    return content[: chosen.start()] + rng.choice(NUMBERS) + content[chosen.end() :]


def lined(content: bytes, rng: random.Random) -> bytes:
    """A line of a text is removed, doubled, moved, or made very long."""
    lines = content.split(b"\n")
    line = lines.pop(rng.randrange(len(lines)))
    to = rng.randrange(len(lines) + 1)
    lines[to:to] = rng.choice(([], [line, line], [line], [line * rng.choice((2, 50, 1000))]))
    return b"\n".join(lines)[: 2**20]


def strange(content: bytes, rng: random.Random) -> bytes:
    """Bytes that are no character of a text, or brackets without end."""
    at, deep = place(content, rng), rng.choice((50, 3000, 50_000))
    put = rng.choice((*STRANGE, rng.choice((b"[", b'{"a":', b"{a=", b"a.")) * deep))
    return content[:at] + put + content[at:]


def tree(value: Any, rng: random.Random) -> Any:
    """A tree of plain values, broken at one place."""
    if not isinstance(value, dict | list) or not value or rng.randrange(8) == 0:
        return rng.choice(TEXTS if isinstance(value, str) and rng.randrange(2) else VALUES)
    keys = list(value) if isinstance(value, dict) else list(range(len(value)))
    key, other = rng.choice(keys), rng.choice(keys)
    changed = value.copy()
    match rng.randrange(10):
        case 0:
            del changed[key]
        case 1 if isinstance(changed, dict):
            changed[rng.choice((f"{key}x", *TEXTS))] = changed.pop(key)
        case 1:
            changed += [changed[key]] * rng.choice((1, 5, 200))
        case 2:
            changed[key] = rng.choice((value[other], [value[key]], {"a": value[key]}))
        case _:
            changed[key] = tree(value[key], rng)
    return changed


def json_tree(content: bytes, rng: random.Random) -> bytes:
    """JSON, broken as a tree, or with a value that is deep or wide."""
    if rng.random() > HOSTILE:
        return json.dumps(tree(json.loads(content), rng)).encode("utf-8", "surrogatepass")
    unit, size = rng.choice((b"[],", b"1e308,", b"9" * 4299 + b",")), rng.choice((500, 5_000_000))
    deep = rng.choice((30, 900, 100_000))
    made = rng.choice((b"[" + unit * (size // len(unit)) + b"0]", b"[" * deep + b"]" * deep))
    return content.replace(b":", b":" + made + b",", 1)


def toml_tree(content: bytes, rng: random.Random) -> bytes:
    """TOML, broken as a tree, or with long keys and deep values."""
    if rng.random() < HOSTILE:
        key, deep = b".".join([b"a"] * rng.choice((2, 31, 5000))), rng.choice((30, 300, 5000))
        return content + rng.choice((b"\n[[z.%s]]" % key, b"\na=%s%s" % (b"[" * deep, b"]" * deep)))
    with suppress(ValueError, TypeError, AttributeError, RecursionError):
        text = tomlkit.dumps(tree(tomllib.loads(content.decode()), rng))
        return text.encode("utf-8", "surrogatepass")
    return numbered(content, rng)  # of what TOML cannot say


def xml(content: bytes, rng: random.Random) -> bytes:
    """Entities and document types in front, or many elements, also within each other."""
    names = range(ord("b"), ord("k"))
    bomb = b"".join(b"<!ENTITY %c '%s'>" % (c, b"&%c;" % (c - 1) * 20) for c in names)
    head = rng.choice(
        (
            b"<!DOCTYPE d [<!ENTITY a '" + b"x" * 1000 + b"'>" + bomb + b"]>",
            b"<!DOCTYPE d SYSTEM 'file:///etc/passwd'>",
            rng.choice((b"<a>", b"<a/>")) * rng.choice((40, 3000, 300_000)),
        )
    )
    end = content.find(b"?>") + 2
    return content[:end] + head + content[end:].replace(b">unknown<", b">&j;<")


def array(values: np.ndarray, rng: random.Random) -> np.ndarray:
    """Numbers, shape or kind of number changed."""
    values = np.array(values)
    match rng.randrange(4):
        case 0 if values.size and values.dtype.kind in "fc":
            values.reshape(-1)[rng.randrange(values.size) :] = rng.choice(EXTREMES)
        case 1:
            values = rng.choice((values.T, values.reshape(-1), np.atleast_1d(values)[:0]))
        case 2:
            shape = rng.choice(((), (0,), (1,), (2, 2), (0, 3), (1, 1, 1), values.shape))
            values = np.zeros(shape, rng.choice((values.dtype, *DTYPES[:-1])))
        case _ if values.ndim:
            values = np.concatenate([values, values], axis=rng.randrange(values.ndim))
    return values


def npy(content: bytes, rng: random.Random) -> bytes:
    """One of the arrays in a .npy file (or several after each other) says another shape, is
    another, or is followed by another program of a pickle."""
    headers = [at for at in range(len(content)) if content.startswith(b"\x93NUMPY", at)]
    at = rng.choice(headers)
    end = at + 10 + int.from_bytes(content[at + 8 : at + 10], "little")
    after = min((h for h in headers if h > at), default=len(content))
    if rng.randrange(2):
        about = {"descr": rng.choice(DTYPES), "fortran_order": False, "shape": rng.choice(SHAPES)}
        head = repr(about).encode().ljust(end - at - 11) + b"\n"
        return content[: at + 8] + struct.pack("<H", len(head)) + head + content[end:]
    if b"'|O'" in content[at:end]:
        pair = rng.choice((b"q\0h\0\x86", b"2\x86", b"q\0h\0h\0\x87", b"\x94h\0\x86"))
        names = (b"cnumpy\nndarray\n", b"cos\nsystem\n", b"\x8c\x05numpy\x8c\x07ndarray\x93")
        steps = (pair * rng.choice((3, 60)), rng.choice(names), b"I" + b"9" * 4000 + b"\n", b"}N]")
        program = b"\x80\x04]" + b"".join(rng.choices(steps, k=rng.choice((1, 3, 10)))) + b"\x86."
        return content[:end] + rng.choice((program, flip(content[end:], rng)))
    stream = io.BytesIO()
    np.save(stream, array(np.load(io.BytesIO(content[at:after])), rng), allow_pickle=True)
    return content[:at] + stream.getvalue() + content[after:]


def npz(content: bytes, rng: random.Random) -> bytes:
    """One of the arrays is broken, its file's checksum right; or a bomb, a member that is gone,
    twice or elsewhere; or many of them."""
    with zipfile.ZipFile(io.BytesIO(content)) as archive:
        members = [(name, archive.read(name)) for name in archive.namelist()]
    k = rng.randrange(len(members))
    name, whole = members[k]
    also = rng.choice((name, f"../{name}", f"/tmp/{name}", ""))
    bomb = whole + bytes(2**28 if rng.random() < HOSTILE else 2**10)
    many = [(f"m{n}", b"") for n in range(rng.choice((1, 10, 3000)))]
    changed = rng.choice(([(name, bomb)], [(name, whole), (also, whole)], [], [*members, *many]))
    members[k : k + 1] = changed if rng.random() < 0.4 else [(name, npy(whole, rng))]
    stream = io.BytesIO()
    with zipfile.ZipFile(stream, "w", rng.choice((0, zipfile.ZIP_DEFLATED))) as archive:
        for name, part in members:
            archive.writestr(zipfile.ZipInfo(name), part)
    return stream.getvalue()


def hdf5(content: bytes, rng: random.Random) -> bytes:
    """One of the data sets or attributes is another: of another kind, shape or layout, a link, or
    no data set at all."""
    stream = io.BytesIO(content)
    with h5py.File(stream, "r+") as file:
        sets: dict[str, np.ndarray] = {}
        file.visititems(
            lambda name, item: sets.update({name: item[()]} if hasattr(item, "shape") else {})
        )
        if file.attrs and rng.randrange(6) == 0:
            file.attrs[rng.choice(list(file.attrs))] = rng.choice((0, "x", b"\xff", [1, 2], 2**63))
        elif sets:
            name, values = rng.choice(list(sets.items()))
            del file[name]
            _replace(file, name, values, rng)
    return stream.getvalue()


def _replace(file: h5py.File, name: str, values: np.ndarray, rng: random.Random) -> None:
    shape, kind = values.shape, values.dtype
    packed = {"chunks": shape or None, "compression": "gzip" if shape else None}
    match rng.randrange(10):
        case 0:
            file.create_group(name)
        case 1:
            file["away"] = h5py.ExternalLink(rng.choice(("/etc/passwd", ".")), "/")
            file[name] = h5py.SoftLink(rng.choice(("/" + name, "/nowhere", f"/away/away/{name}")))
        case 2:
            file[name] = "text"
        case 3:
            large = (*shape[:-1], rng.choice((10**6, 2 * 10**8, 10**13)))
            file.create_dataset(name, large, kind, chunks=(*(1 for _ in large[1:]), 1024))
        case 4:
            file.create_dataset(name, (2**27,), "f8", chunks=(2**20,), compression="gzip")[0] = 0
        case 5:
            file.create_dataset(name, shape, "f4", external=[("/etc/passwd", 0, 4 * values.size)])
        case 6:
            layout = h5py.VirtualLayout((3,), "f4")
            layout[...] = h5py.VirtualSource("/etc/passwd", "x", (3,))
            file.create_virtual_dataset(name, layout)
        case 7:  # a piece that unpacks to far more, or to nothing
            made = file.create_dataset(name, shape, kind, **packed)
            piece = rng.choice((zeros(), rng.randbytes(300)))
            made.id.write_direct_chunk((0,) * len(shape), piece)
        case _:
            changed = array(values, rng)
            file[name] = changed.astype("S") if changed.dtype.kind in "UM" else changed


def png(content: bytes, rng: random.Random) -> bytes:
    """Sizes, a chunk or the pixels are others, or a chunk comes twice, with the right checksums."""
    chunks, at = [], 8
    while at + 12 <= len(content):
        (size,) = struct.unpack_from(">I", content, at)
        chunks.append((content[at + 4 : at + 8], content[at + 8 : at + 8 + size]))
        at += 12 + size
    k, (_, header) = rng.randrange(len(chunks)), chunks[0]
    sides = (rng.choice((0, 1, 4000, 20_000, 46_000, 2**31 - 1)) for _ in range(2))
    form = bytes([rng.choice((1, 8, 16, 3)), rng.randrange(8), 0, 0, rng.randrange(3)])
    sized = b"IHDR", struct.pack(">II", *sides) + rng.choice((header[8:13], form))
    changed: tuple[list[tuple[bytes, bytes]], ...] = (
        [sized, *chunks[1:]],
        [sized, *((kind, zeros() if kind == b"IDAT" else body) for kind, body in chunks[1:])],
        [*chunks[:k], (chunks[k][0], flip(chunks[k][1], rng)), *chunks[k + 1 :]],
        [chunks[0], rng.choice(((b"zTXt", b"a\0\0" + zeros()), chunks[k])), *chunks[1:]],
    )
    parts = (
        struct.pack(">I", len(body)) + kind + body + struct.pack(">I", zlib.crc32(kind + body))
        for kind, body in rng.choice(changed)
    )
    return content[:8] + b"".join(parts)


BYTES: tuple[Mutation, ...] = (flip, word, spliced)
TEXT: tuple[Mutation, ...] = (*BYTES, numbered, numbered, lined, strange)
FORMS: dict[str, Mutation] = {  # these know the form, and break a file that is whole
    ".toml": toml_tree,
    ".json": json_tree,
    ".xml": xml,
    ".npz": npz,
    ".npy": npy,
    ".h5": hdf5,
    ".mat": hdf5,
    ".png": png,
}
TEXTS_OF = {".toml", ".json", ".csv", ".obj", ".txt", ".xml", ".ply", ".stl"}
KNOWN = 0.6  # how often a file is broken by those who know its form
HOSTILE = 0.04  # of these: made to cost far more than they weigh


def mutated(name: str, content: bytes, rng: random.Random) -> bytes:
    """A broken version of the file `name`; the same for the same content and state of rng."""
    suffix = "." + name.rpartition(".")[2].lower()
    known = suffix in FORMS and rng.random() < KNOWN
    if known:
        # of what is hard to write
        with suppress(ValueError, TypeError), warnings.catch_warnings(action="ignore"):
            content = FORMS[suffix](content, rng)
    for _ in range(rng.choice((0, 0, 0, 1) if known else (1, 1, 1, 2, 3))):
        content = rng.choice(TEXT if suffix in TEXTS_OF else BYTES)(content, rng)
    return content


LINKS = ("loop", "outside", "folder", "pipe", "device", "missing")


def put(path: Path, link: str) -> None:
    """Something else in a file's place."""
    path.unlink()
    match link:
        case "loop":
            path.symlink_to(path.name)
        case "outside":
            path.symlink_to("/etc/passwd")
        case "folder":
            path.mkdir()
        case "pipe":
            os.mkfifo(path)
        case "device":
            path.symlink_to("/dev/zero")


def clear(path: Path) -> None:
    """Take away what `put` has put."""
    if path.is_dir() and not path.is_symlink():
        path.rmdir()
    else:
        path.unlink(missing_ok=True)
