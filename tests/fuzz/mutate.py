"""Broken versions of a file: the form of its content is known, so that what comes out is often
nearly right."""

from __future__ import annotations

import json
import random
import re
import tomllib
import warnings
from collections.abc import Callable
from contextlib import suppress
from typing import Any

import tomlkit

from tests.fuzz import hostile
from tests.fuzz.forms import hdf5, jpeg, npy, npz, png

Mutation = Callable[[bytes, random.Random], bytes]

NUMBER = re.compile(rb"-?\d+(?:\.\d*)?(?:[eE][-+]?\d+)?")
NUMBERS = (
    *b"nan inf -inf 1e308 -1e308 1e-320 1e999 -1 0 -0.0 1 2 3.5 1000000000 4294967296 "
    b"99999999999999999999".split(),
    b"9" * 400,
    b"9" * 5000,
    *b'1_0 0x10 true null "" [] {} \''.split(),
)
TEXTS = (
    "",
    "../../etc/passwd",
    "/etc/passwd",
    "a\0b",
    "x" * 5000,
    "\u202e\x1b[31m",
    "..",
    ".",
    "a__b",
    "nan",
    "%s%n",
    "{0}",
    "$(id)",
    "\ud7ff\uffff",
    "CON",
    "-",
    "//",
    "\n",
    "file:///etc/passwd",
    "0",
    "1e308",
)
VALUES = (
    None,
    True,
    False,
    0,
    -1,
    1,
    2,
    3,
    10**9,
    -(10**9),
    2**31,
    2**63,
    2**64,
    10**400,
    -0.0,
    0.5,
    1e-320,
    1e-30,
    1e30,
    1e154,
    1e308,
    -1e308,
    float("nan"),
    float("inf"),
    [],
    {},
    [[]],
    [0],
    [1, 2],
    [{}],
    {"a": 1},
    [None],
    [[0.0] * 4] * 4,
    [[1.0, 0.0], [0.0]],
    ["a"],
    [1e308] * 3,
    {"version": 1},
    [[[[[[[[[[]]]]]]]]]],
)
STRANGE = (
    b"\xff\xfe",
    b"\x80",
    b"\xc3\x28",
    b"\0",
    b"\r",
    b"\xef\xbb\xbf",
    b"\xed\xa0\x80",
    b"\x1a",
    b"\x0b\x0c\x85",
)
WORDS = (
    0,
    1,
    2,
    3,
    7,
    8,
    64,
    127,
    128,
    255,
    256,
    32767,
    32768,
    65535,
    2**31 - 1,
    2**31,
    2**32 - 1,
    2**63 - 1,
    2**64 - 1,
)
EDGE = 512  # bytes at a file's head and tail, where what matters usually lies
NESTED = 3000


def place(content: bytes, rng: random.Random) -> int:
    """The place to break a file at: as often in its head and in its tail as in all of it."""
    if not content:
        return 0
    match rng.randrange(3):
        case 0:
            return rng.randrange(min(EDGE, len(content)))
        case 1:
            return len(content) - 1 - rng.randrange(min(EDGE, len(content)))
    return rng.randrange(len(content))


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


def cut(content: bytes, rng: random.Random) -> bytes:
    """Only the beginning is left."""
    return content[: place(content, rng)]


def spliced(content: bytes, rng: random.Random) -> bytes:
    """A run of bytes is removed, doubled, moved, zeroed, or made noise."""
    size = rng.choice((1, 2, 4, 8, 16, 64, 512, 4096))
    at, source = place(content, rng), place(content, rng)
    run = content[at : at + size]
    new = rng.choice(
        (b"", run + run, content[source : source + size], bytes(len(run)), rng.randbytes(len(run)))
    )
    return content[:at] + new + content[at + size :]


def numbered(content: bytes, rng: random.Random) -> bytes:
    """A number of a text becomes an extreme one."""
    found = list(NUMBER.finditer(content))
    if not found:
        return flip(content, rng)
    chosen = rng.choice(found[:40] if rng.randrange(2) else found)
    return content[: chosen.start()] + rng.choice(NUMBERS) + content[chosen.end() :]


def lined(content: bytes, rng: random.Random) -> bytes:
    """A line of a text is removed, doubled, moved, cut or made very long."""
    lines = content.split(b"\n")
    at, to = rng.randrange(len(lines)), rng.randrange(len(lines))
    match rng.randrange(5):
        case 0:
            del lines[at]
        case 1:
            lines.insert(to, lines[at])
        case 2:
            lines[at], lines[to] = lines[to], lines[at]
        case 3:
            lines[at] = lines[at][: rng.randint(0, len(lines[at]))]
        case 4:
            lines[at] = lines[at] * rng.choice((2, 50, 1000))
    return b"\n".join(lines)[: 2**20]


def strange(content: bytes, rng: random.Random) -> bytes:
    """Bytes that are no UTF-8, or no character of a text."""
    at = place(content, rng)
    return content[:at] + rng.choice(STRANGE) + content[at:]


def nested(content: bytes, rng: random.Random) -> bytes:
    """Brackets without end."""
    at, (first, last) = (
        place(content, rng),
        rng.choice(((b"[", b"]"), (b'{"a":', b"}"), (b"{a=", b"}"), (b"a.", b""))),
    )
    deep = rng.choice((50, NESTED, 50_000))
    return content[:at] + first * deep + last * rng.choice((0, deep)) + content[at:]


def xml(content: bytes, rng: random.Random) -> bytes:
    """Entities and document types in front, or an element within itself."""
    bomb = (
        b"<!ENTITY a '"
        + b"x" * 1000
        + b"'>"
        + b"".join(
            b"<!ENTITY %c '%s'>" % (c, b"&%c;" % (c - 1) * 20) for c in range(ord("b"), ord("k"))
        )
    )
    head = rng.choice(
        (
            b"<!DOCTYPE d [" + bomb + b"]>",
            b"<!DOCTYPE d SYSTEM 'file:///etc/passwd'>",
            b"<a>" * NESTED,
        )
    )
    end = content.find(b"?>") + 2
    return content[:end] + head + content[end:].replace(b">unknown<", b">&j;<")


def tree(value: Any, rng: random.Random) -> Any:
    """A tree of plain values, broken at one place."""
    if not isinstance(value, dict | list) or not value or rng.randrange(8) == 0:
        return (
            rng.choice(TEXTS) if isinstance(value, str) and rng.randrange(2) else rng.choice(VALUES)
        )
    keys = list(value) if isinstance(value, dict) else list(range(len(value)))
    key, other = rng.choice(keys), rng.choice(keys)
    changed = dict(value) if isinstance(value, dict) else list(value)
    match rng.randrange(10):
        case 0:
            del changed[key]
        case 1 if isinstance(changed, dict):
            changed[f"{key}x" if rng.randrange(2) else rng.choice(TEXTS)] = changed.pop(key)
        case 1:
            changed += [changed[key]] * rng.choice((1, 5, 200))
        case 2:
            changed[key] = value[other]
        case 3:
            changed[key] = rng.choice(([value[key]], {"a": value[key]}, [value[key], value[other]]))
        case _:
            changed[key] = tree(value[key], rng)
    return changed


def json_tree(content: bytes, rng: random.Random) -> bytes:
    """JSON, broken as a tree."""
    return json.dumps(tree(json.loads(content), rng)).encode("utf-8", "surrogatepass")


def toml_tree(content: bytes, rng: random.Random) -> bytes:
    """TOML, broken as a tree; what TOML cannot say is said in another way."""
    try:
        return tomlkit.dumps(tree(tomllib.loads(content.decode()), rng)).encode(
            "utf-8", "surrogatepass"
        )
    except (ValueError, TypeError, AttributeError, RecursionError):
        return numbered(content, rng)


BYTES: tuple[Mutation, ...] = (flip, word, cut, spliced)
TEXT: tuple[Mutation, ...] = (*BYTES, numbered, numbered, lined, strange, nested)
FORMS: dict[str, tuple[Mutation, ...]] = {  # these know the form, and break a file that is whole
    ".toml": (toml_tree,),
    ".json": (json_tree,),
    ".xml": (xml,),
    ".npz": (npz,),
    ".npy": (npy,),
    ".h5": (hdf5,),
    ".mat": (hdf5,),
    ".png": (png,),
    ".jpg": (jpeg,),
}
TEXTS_OF = {".toml", ".json", ".csv", ".obj", ".txt", ".xml", ".ply", ".stl"}
KNOWN = 0.6  # how often a file is broken by those who know its form
HOSTILE = 0.03  # ... and made to cost far more than it weighs


def mutated(name: str, content: bytes, rng: random.Random) -> bytes:
    """A broken version of the file `name`; the same for the same content and state of rng."""
    suffix = "." + name.rpartition(".")[2].lower()
    if suffix in hostile.KNOWN and rng.random() < HOSTILE:
        with suppress(ValueError, TypeError), warnings.catch_warnings(action="ignore"):
            return hostile.KNOWN[suffix](content, rng)
    known = suffix in FORMS and rng.random() < KNOWN
    if known:
        with (
            suppress(ValueError, TypeError),
            warnings.catch_warnings(action="ignore"),
        ):  # of what is hard to write
            content = rng.choice(FORMS[suffix])(content, rng)
    for _ in range(rng.choice((0, 0, 0, 1) if known else (1, 1, 1, 2, 3))):
        content = rng.choice(TEXT if suffix in TEXTS_OF else BYTES)(content, rng)
    return content
