"""Reading and writing of files, such that a crash, a full disk or a malicious file does no harm.

An untrusted file is refused by the limits below before it costs seconds or gigabytes. Each is far
above the needs of handbench's own files and of those of other supported programs (docs/files.md).
"""

import errno
import fcntl
import hashlib
import io
import json
import math
import os
import re
import shutil
import unicodedata
import zipfile
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from fnmatch import fnmatchcase
from glob import escape
from operator import methodcaller
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import IO, Any, TypeVar

import numpy as np
from numpy.lib import format as npy

from handbench.support.errors import HandbenchError

T = TypeVar("T")
NAMED = 40  # characters of a name, with which that of its temporary folder begins
TEMPORARY = ".handbench"  # its end
MB = 2**20
TOML_BYTES = MB // 4
JSON_BYTES = XML_BYTES = CSV_BYTES = 4 * MB
TABLE_BYTES = 64 * MB  # of measured samples as text
TOUCHSTONE_BYTES = 8 * MB  # 50,000 tones of two ports
# of a benchmark's table or record: a thousand captures, nine methods, three references
RESULT_BYTES = 256 * MB
RAW_JSON_BYTES = 64 * MB  # of MAROON's, which hold more than is read
# a frame of MAROON has 19, of 96 × 96 × 128 numbers; each file of COLMAP's
PICKLE_BYTES = MODEL_BYTES = 256 * MB
ARRAY_BYTES = 256 * MB  # unpacked, of what is read from one archive
KEPT_BYTES = 4096 * MB  # of one that a run keeps for itself
MESH_BYTES = PICTURE_BYTES = 1024 * MB
DEEPEST = 32  # lists and tables within each other
MOST_VALUES = 200_000  # of a JSON file: checking them against a configuration takes a kB each
RESULT_VALUES = 800_000  # of a benchmark's record
RAW_VALUES = 2_000_000  # of a JSON file that is checked against nothing
MOST_TABLES = 1000  # captures, and methods, that a benchmark names: each is opened
# what the name of no file and no path has: too many bytes, or a zero
UNFIT = re.compile(rb"[^/]{256}|.{1001}|\0", re.DOTALL)
NAME_BYTES = 100  # of a capture's or a method's: names of files have both
MOST_CELLS = 16_000_000  # of a CSV file
MOST_STEPS = 10_000  # of a pickle's program: a frame of MAROON takes about a hundred
MOST_MEMBERS = 1000  # of an archive
# tomllib is quadratic
LONG_KEY = re.compile(r"""(?<![\w-])(?:(?:[\w-]+|"[^"\n]*"|'[^'\n]*')[ \t]*\.[ \t]*){32}""")
FREE: set[Path] = set()  # paths that `free` found free, until this process has written them


def free(overwrite: bool, *paths: Path | None) -> None:
    """Raise a HandbenchError if a file, a folder or a link exists and may not be overwritten, or
    cannot be written for want of a folder."""
    for path in filter(None, paths):
        if os.path.lexists(path) and not overwrite:
            raise HandbenchError(
                f"{path}: exists already; choose another place or, where that can be asked "
                "for, replace it (--overwrite, in Python overwrite=True)"
            )
        (FREE.discard if overwrite else FREE.add)(path)
        above = next(filter(os.path.lexists, path.absolute().parents), "")
        if not os.access(f"{above}/", os.W_OK):
            raise HandbenchError(f"{path}: {above} is no folder to write in; choose another place")


def free_folder(path: Path, overwrite: bool, written: Sequence[str]) -> None:
    """Check that a command may write into a folder: it is new, or may be overwritten and is empty
    or has only files that this command wrote before. Raises HandbenchError otherwise.
    written: patterns of the names of the files that the command writes; the first one is in every
    folder that it wrote."""
    free(overwrite, path)
    if (path.is_file() or any(path.glob("*"))) and not (path / written[0]).is_file():
        raise HandbenchError(
            f"{path}: has no {written[0]}, so this command did not make this folder and does not "
            "overwrite it; choose another folder"
        )
    for file in sorted(path.rglob("*")):
        name = file.relative_to(path).as_posix()
        folder = file.is_dir() and not file.is_symlink()
        if not folder and not any(fnmatchcase(name, pattern) for pattern in written):
            raise HandbenchError(
                f"{path}: has a file {name} that this command did not write; move the file away, "
                "or choose another folder"
            )


@contextmanager
def atomic_path(path: str | Path) -> Iterator[Path]:
    """Context manager that writes a file completely or not at all.
    It yields the path of a file to make, with the same name. When the block succeeds, this file
    replaces `path`; when it fails, the file is removed. An OSError (a full disk, a read-only
    folder) becomes a HandbenchError, and so does a device at `path`."""
    path = Path(path)
    with _beside(path) as temporary:
        if path.exists() and not path.is_file():
            raise OSError(errno.EEXIST, "it is a folder or a device")
        yield temporary


@contextmanager
def atomic_folder(path: str | Path) -> Iterator[Path]:
    """Context manager that writes a folder completely or not at all.
    It yields a folder with the same name. When the block succeeds, this folder replaces `path`;
    when it fails, the folder is removed. Raises HandbenchError if `path` is a file or a link, and
    instead of any other OSError."""
    with _beside(Path(path)) as temporary:
        temporary.mkdir()
        yield temporary


@contextmanager
def _beside(path: Path) -> Iterator[Path]:
    """Context manager that yields a path with the name of `path`, in a temporary folder beside it
    that is removed at the end. What the block makes there replaces `path`, unless `free` found this
    free and it has appeared since. Such folders that killed processes have left for this name are
    removed first; those of living ones are locked. Errors name `path` instead."""
    start = f".{path.name[:NAMED]}-"
    with writable(path):
        for left in path.parent.glob(f"{escape(start)}*{TEMPORARY}"):
            with suppress(OSError), _locked(left) as unused:
                if unused:
                    shutil.rmtree(left)
        with TemporaryDirectory(TEMPORARY, start, path.parent, True) as folder, _locked(folder):
            temporary, before = Path(folder, path.name), Path(folder, f"-{path.name[:NAMED]}")
            try:
                yield temporary
                free(path not in FREE, path)
            except HandbenchError as error:
                error.args = (str(error).replace(str(temporary), str(path)),)
                raise
            if path.is_dir() and not path.is_symlink():
                # refuses the current folder and mount points, where deleting first would empty them
                os.replace(path, before)
            try:
                os.replace(temporary, path)
            finally:
                if before.exists() and not path.exists():
                    os.replace(before, path)
            FREE.discard(path)


@contextmanager
def _locked(folder: str | Path) -> Iterator[bool]:
    """Context manager that locks a folder, until its block or this process ends. It yields whether
    it could be locked: another process may have done so, and some disks have no locks."""
    descriptor = os.open(folder, os.O_DIRECTORY | os.O_NOFOLLOW)
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        unused = True
    except OSError:
        unused = False
    try:
        yield unused
    finally:
        os.close(descriptor)


@contextmanager
def writable(path: Path) -> Iterator[None]:
    """Context manager for writing `path`. It creates the parent folder, and turns every OSError,
    also one in the block, into a HandbenchError."""
    try:
        if re.search(r"^~/|\0", str(path)):
            raise OSError(errno.EINVAL, "a name cannot be ~, nor have a zero byte")
        path.parent.mkdir(parents=True, exist_ok=True)
        yield
    except OSError as error:
        raise HandbenchError(
            f"{path}: cannot be written ({error.strerror or error}); free space on the disk, or "
            "choose another place"
        ) from error


def require_file(path: str | Path, what: str) -> Path:
    """Return `path` as a Path if it is a file. Raises HandbenchError otherwise.
    what: the expected file for the message, such as "a photograph"."""
    path = Path(path)
    # which, unlike Path's, is False for names too long and links in a circle
    if not os.path.isfile(path):
        raise HandbenchError(f"{path}: expected {what}, found no such file; check the path")
    return path


def require_size(path: Path, what: str, most: int) -> int:
    """Return the size of a file, bytes. Raises HandbenchError if it is above `most`.
    what: the expected file for the message, such as "a photograph"."""
    size = path.stat().st_size
    if size > most:
        raise HandbenchError(
            f"{path}: has {size} bytes, too many for {what} (at most {most}); check that it is "
            "the right file"
        )
    return size


def read_bytes(path: str | Path, what: str, most: int) -> bytes:
    """Return the content of a file.
    what: the expected file, for the message. Raises HandbenchError for a file that is missing,
    cannot be read, or has more than `most` bytes."""
    path = require_file(path, what)
    try:
        with path.open("rb") as stream:
            return stream.read(require_size(path, what, most))
    except OSError as error:
        raise HandbenchError(
            f"{path}: cannot be read ({error.strerror or error}); expected {what}"
        ) from error


def read_text(path: str | Path, what: str, most: int) -> str:
    r"""Return the content of a UTF-8 file as text, without byte order mark and with \n at the end
    of every line.
    what: the expected file, for the message. Raises ValueError for a file that is not UTF-8, and
    HandbenchError for one that is missing, cannot be read, or has more than `most` bytes."""
    content = io.BytesIO(read_bytes(path, what, most))
    try:
        return io.TextIOWrapper(content, "utf-8-sig").read()
    except UnicodeDecodeError:
        raise ValueError("it is not text in UTF-8; save it as UTF-8") from None


def read_parsed(path: str | Path, what: str, kind: str, parse: Callable[[str], T], most: int) -> T:
    """Return what `parse` makes of the text of a file.
    what: the expected file, and kind: its format, such as "JSON", for the message. Raises
    HandbenchError for a file that is missing, has more than `most` bytes, or cannot be parsed; the
    message quotes the line that the parser names."""
    text = ""
    try:
        text = read_text(path, what, most)
        return parse(text)
    except (ValueError, SyntaxError, RecursionError) as error:
        # the last number: a key may have the form of another
        *_, line = [0, *map(int, re.findall(r"line (\d{1,9})", str(error)))]
        shown = "".join(["", *text.split("\n")][line : line + 1]).strip()[:60]
        raise HandbenchError(
            f"{path}: is not readable as {kind} ({error}{shown and f': {shown!r}'}); expected "
            f"{what}"
        ) from error


def one_form(name: str) -> str:
    r"""Return a file name in the form in which names are compared.
    An accent and its letter become one character (NFC; macOS may store two), and a byte that is not
    UTF-8 becomes, for example, \xe4."""
    return unicodedata.normalize("NFC", os.fsencode(name).decode("utf-8", "backslashreplace"))


def require_folder(path: str | Path, what: str) -> Path:
    """Return `path` as a Path if it is a folder. Raises HandbenchError otherwise.
    what: the expected content of the folder, for the message."""
    path = Path(path)
    if not os.path.isdir(path):
        raise HandbenchError(f"{path}: expected a folder with {what}, found none; check the path")
    return path


def inside(folder: Path, name: str, where: str) -> Path:
    """Return the real path of `folder / name` like `real`. Raises HandbenchError also for a name
    that leads out of the folder, because names in captures and reports are untrusted."""
    target = real(folder, name, where)
    if not target.is_relative_to(folder.resolve()):
        raise HandbenchError(
            f"{where}: '{name}' is outside the folder {folder}; use a path inside this folder"
        )
    return target


def real(folder: Path, name: str, where: str) -> Path:
    """Return the real path of `folder / name`, wherever it leads; for names in the user's own
    files.
    where: file or key that has the name, with which the message begins. A file is also found if its
    name differs only in its Unicode form. Raises HandbenchError for a name that is too long."""
    if UNFIT.search(name.encode("utf-8", "replace")):
        raise HandbenchError(
            f"{where}: '{name[:80]}…' cannot be the name of a file; use a shorter name"
        )
    forms = (name, *(unicodedata.normalize(form, name) for form in ("NFC", "NFD")))
    stored = next((form for form in forms if os.path.lexists(folder / form)), name)
    return Path(os.path.realpath(folder / stored))  # which links in a circle do not stop


def write_text(path: str | Path, text: str) -> None:
    """Write a text file (UTF-8), completely or not at all; an existing file is replaced."""
    with atomic_path(path) as temporary:
        temporary.write_text(text, encoding="utf-8")


def write_json(path: str | Path, content: Any) -> None:
    """Write `content` as indented JSON, completely or not at all. NaN and infinity, which JSON does
    not have, are written as null; arrays become lists."""
    text = json.dumps(content, default=methodcaller("tolist"))
    finite = json.loads(text, parse_constant=lambda _: None)
    write_text(path, json.dumps(finite, indent=2) + "\n")


def read_json(
    path: str | Path, what: str, most: int = MOST_VALUES, most_bytes: int = JSON_BYTES
) -> Any:
    """Return the content of a JSON file.
    what: the expected file, for the message. Raises HandbenchError for a missing or broken file,
    and for more than `most` values or `most_bytes` bytes."""
    return read_parsed(path, what, "JSON", lambda text: plain_json(text, most), most_bytes)


def plain_json(text: str, most: int = MOST_VALUES) -> Any:
    """Return the values in a JSON text. Raises ValueError for text that is invalid, too deeply
    nested, has a key twice or more than `most` values (for some deep nesting RecursionError)."""
    # before they are made: a value takes a byte here, 60 in memory
    if sum(map(text.count, "[{,")) > most:
        raise ValueError(f"it has more than {most} values")
    return require_shallow(json.loads(text, object_pairs_hook=_once))


def require_shallow(values: Any, levels: int = DEEPEST) -> Any:
    """Return `values` (plain values in lists and mappings) unchanged. Raises ValueError if they are
    nested deeper than so many levels."""
    if levels < 0:
        raise ValueError(f"its values are nested deeper than {DEEPEST} levels")
    parts = values.values() if isinstance(values, dict) else values
    for part in parts if isinstance(values, dict | list) else ():
        require_shallow(part, levels - 1)
    return values


def _once(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    """Return the keys and values of a JSON object. Raises ValueError for a key that it has twice,
    of which JSON readers silently take the last."""
    content: dict[str, Any] = {}
    for key, value in pairs:
        if key in content:
            raise ValueError(f"it has the key {key[:80]!r} twice")
        content[key] = value
    return content


def write_npz(path: str | Path, **arrays: Any) -> None:
    """Write arrays (name → array) as a compressed .npz file, completely or not at all."""
    with atomic_path(path) as temporary, temporary.open("wb") as stream:
        np.savez_compressed(stream, **arrays)


def read_npz(
    path: str | Path,
    names: tuple[str, ...],
    optional: tuple[str, ...] = (),
    most: int = ARRAY_BYTES,
) -> dict[str, np.ndarray]:
    """Return arrays of an .npz file: name → array, for all of `names`, and for those of `optional`
    that the file has.
    Raises HandbenchError for a missing or broken file or array, for arrays of more than `most`
    bytes, and for pickled content, which is never run."""
    content = read_bytes(path, "an .npz file", most)
    try:
        # zipfile reads its list of them before it can be asked
        if content.count(b"PK\1\2") > MOST_MEMBERS:
            raise ValueError(f"it has more than {MOST_MEMBERS} arrays")
        with zipfile.ZipFile(io.BytesIO(content)) as archive:
            there = {info.filename.removesuffix(".npy"): info for info in archive.infolist()}
            if missing := [name for name in names if name not in there]:
                raise ValueError(f"it has no {', '.join(missing)}")
            wanted = {name: there[name] for name in (*names, *optional) if name in there}
            size = sum(info.file_size for info in wanted.values())
            # other methods than deflate unpack without a limit
            method = max(info.compress_type for info in wanted.values())
            if size > most or method > zipfile.ZIP_DEFLATED:
                raise ValueError(
                    f"its arrays take {size} bytes; at most {most} are read, by no other "
                    "compression than deflate"
                )
            return {
                name: read_array(archive.open(info), info.file_size)
                for name, info in wanted.items()
            }
    except Exception as error:  # zip, zlib, header and pickle errors have no common base
        raise HandbenchError(
            f"{path}: {error}; expected an .npz file with {', '.join(names)}; make the file again"
        ) from error


def read_array(stream: IO[bytes], room_bytes: int) -> np.ndarray:
    """Read the array in numpy's .npy format that fills a stream from its current position.
    room_bytes: number of bytes from there to the end. Raises ValueError for pickled content, and,
    before memory is allocated, for an array that claims more or fewer bytes than there are."""
    start = stream.tell()
    first = npy.read_magic(stream) == (1, 0)
    header = npy.read_array_header_1_0 if first else npy.read_array_header_2_0
    shape, _, dtype = header(stream)
    if dtype.hasobject:
        raise ValueError("an array has objects, which are not read; save it as numbers")
    room_bytes -= stream.tell() - start
    if math.prod(shape) * dtype.itemsize != room_bytes:
        raise ValueError(
            f"an array is {dtype} of shape {shape} by its header, but {room_bytes} bytes follow; "
            "save each array in a file of its own"
        )
    stream.seek(start)
    return npy.read_array(stream, allow_pickle=False)


def content_hash(*parts: Any) -> str:
    """Return a SHA-256 in hexadecimal that identifies values: strings, numbers, lists and mappings
    of them, arrays, files (their content), and folders (name and content of each file, but not what
    Python and numba compile).

    Raises TypeError for other values, because their text may be equal for different values. A link
    in a folder counts with the content of its file, if that is in the folder too. Raises
    HandbenchError for other links, pipes and devices.
    """
    digest = hashlib.sha256()
    for part in parts:
        if isinstance(part, Path) and part.is_dir():
            for file in sorted(part.rglob("*")):
                inner = file.is_file() and file.resolve().is_relative_to(part.resolve())
                if file.is_symlink() and not inner:
                    raise HandbenchError(
                        f"{file}: is a link to something outside {part} or to nothing; replace the "
                        "link by the file itself"
                    )
                name = file.relative_to(part)
                if not file.is_dir() and "__pycache__" not in name.parts:
                    digest.update(str(name).encode())
                    digest.update(content_hash(file).encode())
        elif isinstance(part, Path):
            with require_file(part, "a regular file").open("rb") as stream:
                digest.update(hashlib.file_digest(stream, "sha256").digest())
        else:
            digest.update(json.dumps(part, sort_keys=True, default=_json_like).encode())
        digest.update(b"|")
    return digest.hexdigest()


def _json_like(value: Any) -> Any:
    if isinstance(value, np.ndarray | np.generic):
        return [value.shape, str(value.dtype), hashlib.sha256(value.tobytes()).hexdigest()]
    if isinstance(value, Path):
        return str(value)
    raise TypeError(f"content_hash: cannot hash a value of type {type(value).__name__}")
