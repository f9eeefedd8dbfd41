"""Reading and writing of files, such that a crash, a full disk or a malicious file does no harm."""

import codecs
import csv
import errno
import hashlib
import io
import json
import math
import os
import re
import shutil
import stat
import tempfile
import unicodedata
import zipfile
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import IO, Any

import numpy as np

from handbench.support import limits
from handbench.support.errors import HandbenchError

UNCHANGED = "nothing was changed; free space on the disk, or choose another place"
NPY_HEADERS = {
    (1, 0): np.lib.format.read_array_header_1_0,
    (2, 0): np.lib.format.read_array_header_2_0,
}


@contextmanager
def atomic_path(path: str | Path) -> Iterator[Path]:
    """Context manager that writes a file completely or not at all.
    It yields a temporary path in the same folder and with the same suffix. When the block succeeds,
    this file replaces `path`; when it fails, the file is removed. An OSError (a full disk, a
    read-only folder) becomes a HandbenchError."""
    path = Path(path)
    with writable(path, UNCHANGED), ExitStack() as ending:
        handle, name = tempfile.mkstemp(
            prefix=f".{path.stem}-", suffix=path.suffix, dir=path.parent
        )
        temporary = Path(name)
        ending.callback(temporary.unlink, missing_ok=True)
        os.close(handle)
        _permit(temporary, 0o666)  # mkstemp is private; a result is as open as any other file
        yield temporary
        os.replace(temporary, path)


@contextmanager
def atomic_folder(path: str | Path) -> Iterator[Path]:
    """Context manager that writes a folder completely or not at all.
    It yields a temporary folder next to `path`. When the block succeeds, this folder replaces
    `path`; when it fails, the folder is removed. Raises HandbenchError if `path` is a file or a
    link, and instead of any other OSError."""
    path = Path(path)
    with writable(path, UNCHANGED), ExitStack() as ending:
        temporary = Path(tempfile.mkdtemp(prefix=f".{path.name}-", dir=path.parent))
        ending.callback(shutil.rmtree, temporary, ignore_errors=True)
        _permit(temporary, 0o777)
        yield temporary
        _replace_folder(temporary, path)


def _permit(path: Path, mode: int) -> None:
    """Give a new file or folder the usual permissions, if the file system supports permissions."""
    try:
        path.chmod(mode & ~_umask())
    except OSError as error:
        if error.errno not in (errno.EPERM, errno.ENOTSUP):
            raise


@contextmanager
def writable(path: Path, advice: str) -> Iterator[None]:
    """Context manager for writing `path`. It creates the parent folder, and turns every OSError,
    also one in the block, into a HandbenchError that ends with `advice`."""
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        yield
    except OSError as error:
        raise HandbenchError(
            f"{path}: cannot be written ({error.strerror or error}); {advice}"
        ) from error


def _replace_folder(new: Path, path: Path) -> None:
    """Rename the folder `new` to `path`.
    An existing folder at `path` is first moved aside; it is then deleted, or moved back if renaming
    fails. Raises NotADirectoryError if `path` is a file or a link."""
    if path.is_symlink():
        raise NotADirectoryError(errno.ENOTDIR, "a link has the folder's name")
    if not path.exists():
        os.replace(new, path)
        return
    if not path.is_dir():
        raise NotADirectoryError(errno.ENOTDIR, "a file has the folder's name")
    aside = new.with_name(f"{new.name}-old")
    # refuses the current folder and mount points, where deleting first would empty them
    os.replace(path, aside)
    try:
        os.replace(new, path)
    except OSError:
        os.replace(aside, path)
        raise
    shutil.rmtree(aside, ignore_errors=True)


def _umask() -> int:
    mask = os.umask(0)
    os.umask(mask)
    return mask


def require_file(path: str | Path, what: str) -> Path:
    """Return `path` as a Path if it is a file. Raises HandbenchError otherwise.
    what: the expected file for the message, such as "a photograph"."""
    path = Path(path)
    # which, unlike Path's, is False for names too long and links in a circle
    if not os.path.isfile(path):
        found = "a folder" if os.path.isdir(path) else "nothing"
        raise HandbenchError(f"{path}: expected {what}, found {found}; check the path")
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
    content = read_bytes(path, what, most)
    if is_utf_16(content):
        raise ValueError("the text is in UTF-16; save the file as UTF-8")
    try:
        text = content.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        line = content.count(b"\n", 0, error.start) + 1
        raise ValueError(f"line {line} is not UTF-8; save the file as UTF-8") from None
    return text.replace("\r\n", "\n").replace("\r", "\n")


def read_csv(path: str | Path, columns: Sequence[str]) -> list[tuple[int, list[str]]]:
    """Return the lines of a CSV file that are not empty, each as its number, from 1, and the list
    of its cells.
    columns: the expected columns, for the message; they are not checked. Raises HandbenchError for
    a file that is not text or not CSV."""
    expected = f"the columns {','.join(columns)}"
    try:
        text = read_text(path, f"a CSV file with {expected}", limits.CSV_BYTES)
        reader = csv.reader(io.StringIO(text, newline=""), skipinitialspace=True)
        return [(reader.line_num, row) for row in reader if row]
    except (ValueError, csv.Error) as error:
        raise HandbenchError(f"{path}: is not a CSV file ({error}); expected {expected}") from None


def is_utf_16(content: bytes) -> bool:
    """Tell whether the first bytes of a text file are UTF-16, with or without a byte order mark."""
    marked = content[:2] in (codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)
    return marked or (content[:2].count(0) == 1 and content[2:4].count(0) == 1)


def at_fault(error: Exception, text: str) -> str:
    """Return a parser's error message, followed by the text at the line and column that it names.
    If that text has a decimal comma, a hint is added."""
    places = re.findall(r"line (\d{1,9}),? column (\d{1,9})", str(error))
    line, column = map(int, places[-1]) if places else (0, 0)  # a key may have the form of another
    shown = "".join(["", *text.split("\n")][line : line + 1])[max(0, column - 40) :][:60].strip()
    hint = "; write decimals with a point" if re.search(r"[=:]\s*[-+]?\d+,\d", shown) else ""
    return f"{error}: {shown!r}{hint}" if shown else str(error)


def one_form(name: str) -> str:
    """Return a file name in the form in which names are compared.
    An accent and its letter become one character (NFC; macOS may store two), and a byte that is not
    UTF-8 becomes, for example, %E4."""
    known = os.fsencode(name).decode("utf-8", "surrogateescape")
    shown = "".join(f"%{ord(c) - 0xDC00:02X}" if "\udc80" <= c <= "\udcff" else c for c in known)
    return unicodedata.normalize("NFC", shown)


def require_folder(path: str | Path, what: str) -> Path:
    """Return `path` as a Path if it is a folder. Raises HandbenchError otherwise.
    what: the expected content of the folder, for the message."""
    path = Path(path)
    if not os.path.isdir(path):
        found = "a file" if os.path.isfile(path) else "nothing"
        raise HandbenchError(
            f"{path}: expected a folder with {what}, found {found}; check the path"
        )
    return path


def inside(folder: Path, name: str, where: str) -> Path:
    """Return the real path of `folder / name`, which must be inside the folder.
    where: file or key that has the name, with which the message begins. A file is also found if its
    name differs only in its Unicode form. Raises HandbenchError for a name that is too long or
    leads out of the folder, because names in TOML files and reports are untrusted."""
    if (
        max(map(len, name.encode("utf-8", "replace").split(b"/"))) > limits.LONGEST_NAME
        or len(name) > 1000
    ):
        raise HandbenchError(
            f"{where}: '{name[:80]}…' is too long for the name of a file; use a shorter name"
        )
    # which links in a circle do not stop
    target = Path(os.path.realpath(_stored(folder, name.replace("\0", ""))))
    if "\0" in name or not target.is_relative_to(folder.resolve()):
        raise HandbenchError(
            f"{where}: '{name}' is outside the folder {folder}; use a path inside this folder"
        )
    return target


def _stored(folder: Path, name: str) -> Path:
    """Return `folder / name`, with each part of the name spelled as in the file system if the two
    differ only in their Unicode form."""
    path = folder
    for part in Path(name).parts:
        there = path / part
        if not part.isascii() and not os.path.lexists(there) and os.path.isdir(path):
            same = (entry for entry in os.listdir(path) if one_form(entry) == one_form(part))
            there = path / next(same, part)
        path = there
    return path


def write_text(path: str | Path, text: str) -> None:
    """Write a text file (UTF-8), completely or not at all; an existing file is replaced."""
    with atomic_path(path) as temporary:
        temporary.write_text(text, encoding="utf-8")


def write_json(path: str | Path, content: Any) -> None:
    """Write `content` as indented JSON, completely or not at all. NaN and infinity, which JSON does
    not have, are written as null; arrays become lists."""
    write_text(path, json.dumps(_finite(content), indent=2, allow_nan=False) + "\n")


def read_json(
    path: str | Path, what: str, most: int = limits.MOST_VALUES, most_bytes: int = limits.JSON_BYTES
) -> Any:
    """Return the content of a JSON file.
    what: the expected file, for the message. Raises HandbenchError for a missing or broken file,
    and for more than `most` values or `most_bytes` bytes."""
    text = ""
    try:
        text = read_text(path, what, most_bytes)
        return plain_json(text, most)
    except (ValueError, RecursionError) as error:
        raise HandbenchError(
            f"{path}: is not readable as JSON ({at_fault(error, text)}); expected {what}"
        ) from error


def plain_json(text: str, most: int = limits.MOST_VALUES) -> Any:
    """Return the values in a JSON text. Raises ValueError for text that is invalid, too deeply
    nested or has more than `most` values (for some deep nesting RecursionError)."""
    # before they are made: a value takes a byte here, 60 in memory
    if sum(map(text.count, "[{,")) > most:
        raise ValueError(f"it has more than {most} values")
    return limits.require_shallow(json.loads(text))


def write_npz(path: str | Path, **arrays: Any) -> None:
    """Write arrays (name → array) as a compressed .npz file, completely or not at all.
    Raises ValueError for arrays of Python objects, which would need pickles. The lowest compression
    level is used: for measured data, a higher one saves 8 % of the size and takes 1.5 times as
    long."""
    with (
        atomic_path(path) as temporary,
        zipfile.ZipFile(temporary, "w", zipfile.ZIP_DEFLATED, compresslevel=1) as file,
    ):
        for name, array in arrays.items():
            with file.open(f"{name}.npy", "w", force_zip64=True) as member:
                np.lib.format.write_array(member, np.asanyarray(array), allow_pickle=False)


def read_npz(
    path: str | Path,
    names: tuple[str, ...],
    optional: tuple[str, ...] = (),
    most: int = limits.ARRAY_BYTES,
) -> dict[str, np.ndarray]:
    """Return arrays of an .npz file: name → array, for all of `names`, and for those of `optional`
    that the file has.
    Raises HandbenchError for a missing or broken file or array, for arrays of more than `most`
    bytes, and for pickled content, which is never run."""
    try:
        content = read_bytes(path, "an .npz file", most)
        # zipfile reads its list of them before it can be asked
        if content.count(b"PK\1\2") > limits.MOST_MEMBERS:
            raise ValueError(f"it has more than {limits.MOST_MEMBERS} arrays")
        with zipfile.ZipFile(io.BytesIO(content)) as archive:
            there = {info.filename.removesuffix(".npy"): info for info in archive.infolist()}
            missing = [name for name in names if name not in there]
            if missing:
                raise HandbenchError(
                    f"{path}: has no {', '.join(missing)}; expected arrays named "
                    f"{', '.join(names)}; make the file again"
                )
            wanted = [name for name in (*names, *optional) if name in there]
            if {there[name].compress_type for name in wanted} - {
                zipfile.ZIP_STORED,
                zipfile.ZIP_DEFLATED,
            }:
                # others unpack without a limit
                raise ValueError(
                    "it is compressed by a method other than deflate; numpy.savez_compressed uses "
                    "deflate"
                )
            size = sum(there[name].file_size for name in wanted)
            if size > most:
                raise ValueError(f"its arrays take {size} bytes, more than the limit of {most}")
            return {name: _member(archive, there[name]) for name in wanted}
    except HandbenchError:
        raise
    except Exception as error:  # zip, zlib, header and pickle errors have no common base
        raise HandbenchError(
            f"{path}: is not a readable .npz file ({error}); make the file again"
        ) from error


def _member(archive: zipfile.ZipFile, info: zipfile.ZipInfo) -> np.ndarray:
    with archive.open(info) as stream:
        return read_array(stream, info.file_size)


def read_array(stream: IO[bytes], room_bytes: int) -> np.ndarray:
    """Read the array in numpy's .npy format that begins at the current position of a stream.
    room_bytes: number of bytes from there to the end. Raises ValueError for pickled content, and,
    before memory is allocated, for an array that claims more bytes than there are."""
    start = stream.tell()
    version = np.lib.format.read_magic(stream)
    if version not in NPY_HEADERS:
        raise ValueError(
            f"its arrays are in version {version} of numpy's file format, which is unknown"
        )
    shape, _, dtype = NPY_HEADERS[version](stream)
    if (
        dtype.hasobject
        or min(shape, default=1) < 0
        or math.prod(shape) * dtype.itemsize > room_bytes
    ):
        raise ValueError(
            f"an array is {dtype} of shape {shape} by its header, but the file has only "
            f"{room_bytes} bytes for it"
        )
    stream.seek(start)
    return np.lib.format.read_array(stream, allow_pickle=False)


def content_hash(*parts: Any) -> str:
    """Return a SHA-256 in hexadecimal that identifies values: strings, numbers, lists and mappings
    of them, arrays, files (their content), and folders (name and content of each file).

    Raises TypeError for other values, because their text may be equal for different values. A link
    in a folder counts with the content of its file, if that is in the folder too. Raises
    HandbenchError for other links, pipes and devices.
    """
    digest = hashlib.sha256()
    for part in parts:
        if isinstance(part, Path) and part.is_dir():
            for file in sorted(_files_below(part)):
                digest.update(str(file.relative_to(part)).encode())
                digest.update(content_hash(file).encode())
        elif isinstance(part, Path):
            with open(
                part, "rb", opener=lambda name, flags: os.open(name, flags | os.O_NONBLOCK)
            ) as stream:
                if not stat.S_ISREG(os.fstat(stream.fileno()).st_mode):
                    raise HandbenchError(
                        f"{part}: is not a regular file (it may be a device or pipe); replace it "
                        "by a file"
                    )
                digest.update(hashlib.file_digest(stream, "sha256").digest())
        elif isinstance(part, np.ndarray):
            digest.update(
                str((part.shape, part.dtype)).encode() + np.ascontiguousarray(part).tobytes()
            )
        else:
            digest.update(json.dumps(part, sort_keys=True, default=_json_like).encode())
        digest.update(b"|")
    return digest.hexdigest()


def _files_below(folder: Path) -> Iterator[Path]:
    for at, folders, names in os.walk(folder):
        for path in (Path(at, name) for name in (*folders, *names)):
            kind = path.lstat().st_mode
            if stat.S_ISLNK(kind) and not (
                path.is_file() and path.resolve().is_relative_to(folder.resolve())
            ):
                raise HandbenchError(
                    f"{path}: is a link to something outside {folder} or to nothing; replace the "
                    "link by the file itself"
                )
            if not stat.S_ISDIR(kind):
                yield path


def _json_like(value: Any) -> Any:
    if isinstance(value, (np.ndarray, Path)):
        return content_hash(value) if isinstance(value, np.ndarray) else str(value)
    if isinstance(value, np.generic):
        return value.item()
    raise TypeError(
        f"content_hash: cannot hash a value of type {type(value).__name__}; give numbers, texts, "
        "lists, tables or arrays"
    )


def _finite(value: Any) -> Any:
    if isinstance(value, dict):
        return {str(key): _finite(item) for key, item in value.items()}
    if isinstance(value, (list, tuple)):
        return [_finite(item) for item in value]
    if isinstance(value, (np.ndarray, np.generic)):
        return _finite(value.tolist())
    if isinstance(value, float) and not np.isfinite(value):
        return None
    return value
