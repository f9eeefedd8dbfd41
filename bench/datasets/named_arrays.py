"""Arrays in other programs' files (HDF5, MATLAB, NumPy, tables of text), read by name."""

import fnmatch
import re
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from itertools import islice
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from handbench.support.cost import require_free
from handbench.support.errors import HandbenchError
from handbench.support.files import inside, read_array, read_npz, read_text, require_file
from handbench.support.hdf5 import local_item, open_hdf5, read
from handbench.support.limits import MOST_CELLS, TABLE_BYTES
from handbench.support.matlab import read_matlab

if TYPE_CHECKING:
    import h5py

TABLES = (".csv", ".tsv", ".txt", ".dat")
ARRAYS = (".npy", *TABLES)  # of files that are one array
KINDS = {".npy": "NumPy", **dict.fromkeys(TABLES, "CSV")}
MOST_FILES = 10_000  # that a name with * stands for
MOST_HEADER = 1000  # lines before a table's numbers
INDEX = re.compile(r"\[([\d:, -]+)\]$")
IMAGINARY = re.compile(r"(?<=[\d.])i\b")  # of a complex number as MATLAB writes it
COMMENTS = ("#", "%", "!")

Read = Callable[[str], np.ndarray]  # from a name to the array as it is stored


@dataclass(frozen=True)
class NamedArray:
    """Where an array is: FILE, the NAME of the data set in it ("" where the file is one array),
    and the part of it to take. `*` in FILE or NAME stands for all that match."""

    file: str
    name: str
    part: tuple[int | slice, ...]


def named_array(text: str, file: str | None) -> NamedArray:
    """Parse "NAME", "FILE:NAME" or, of a file that is one array, "FILE", each perhaps followed by
    an index as Python writes it ("[:, 0]", "[::4]"). file: the one that is meant without FILE."""
    found = INDEX.search(text)
    name = text[: found.start()] if found else text
    part = tuple(_slice(word, text) for word in found[1].split(",")) if found else ()
    other, colon, inner = name.partition(":")
    if colon:
        return NamedArray(other, inner, part)
    if Path(name).suffix.lower() in ARRAYS:
        return NamedArray(name, "", part)
    if file is None:
        raise HandbenchError(
            f'\'{text[:200]}\' names no file; expected "FILE:NAME", or file = "FILE" at the top'
        )
    return NamedArray(file, name, part)


def read_arrays(folder: Path, names: Iterable[str], file: str | None, where: str) -> Read:
    """Read arrays of the files in a folder and return the function from a name (`named_array`) to
    its array. where: the file that gives the names, for messages. Raises HandbenchError, one for
    all that a file lacks."""
    wanted = {text: named_array(text, file) for text in sorted(names)}
    by_file: dict[Path, list[tuple[str, NamedArray]]] = {}
    paths = {of: _matching_files(folder, of, where) for of in {a.file for a in wanted.values()}}
    for text, array in wanted.items():
        for path in paths[array.file]:
            by_file.setdefault(path, []).append((text, array))
    found: dict[str, list[np.ndarray]] = {}
    for path in sorted(by_file, key=_natural):
        with _open(path) as (matching, array_of):
            if lacking := [a.name for _, a in by_file[path] if not matching(a.name)]:
                lacks = ", ".join(f"'{name[:200]}'" for name in dict.fromkeys(lacking))
                shown = ", ".join(name[:200] for name in matching("*")[:12]) or "no data sets"
                raise HandbenchError(f"{path}: has no {lacks}; the file has {shown}")
            for text, array in by_file[path]:
                found.setdefault(text, []).extend(
                    _part(array_of(name), array.part, text)
                    for name in sorted(matching(array.name), key=_natural)
                )
    several = {text: "*" in array.file + array.name for text, array in wanted.items()}
    return {
        text: _stacked(arrays, text) if several[text] else arrays[0]
        for text, arrays in found.items()
    }.__getitem__


def _slice(word: str, text: str) -> int | slice:
    """Parse one axis of an index: a whole number, or start:stop:step."""
    try:
        numbers = [int(part) if part.strip() else None for part in word.split(":")]
        [first] = numbers if len(numbers) == 1 else [None]
        return slice(*numbers) if first is None else first
    except (ValueError, TypeError):
        raise HandbenchError(
            f"'{text[:200]}' has the index [{word.strip()}]; expected a number or start:stop:step"
        ) from None


def _part(values: np.ndarray, part: tuple[int | slice, ...], text: str) -> np.ndarray:
    try:
        return values[part]
    except (IndexError, ValueError):
        raise HandbenchError(
            f"'{text[:200]}' asks for a part of shape {values.shape}; expected an index within it"
        ) from None


def _stacked(arrays: list[np.ndarray], text: str) -> np.ndarray:
    """Stack what several files or data sets hold, along a new first axis."""
    shapes = {array.shape: number for number, array in enumerate(arrays, 1)}
    if len(shapes) > 1:
        (first, _), (other, number), *_ = shapes.items()
        raise HandbenchError(
            f"'{text}': number {number} of {len(arrays)} has shape {other}; expected {first}, "
            "as the others have"
        )
    require_free(2.0 * sum(array.nbytes for array in arrays), f"'{text}'", "end other programs")
    return np.stack(arrays)


def _matching_files(folder: Path, pattern: str, where: str) -> list[Path]:
    """Find the file of a name, or all files that a name with * stands for."""
    at, what = inside(folder, pattern, where), f"the HDF5, MATLAB, NumPy or CSV file that {where}"
    if "*" not in pattern or "**" in pattern:
        return [require_file(at, f"{what} names")]
    found = sorted(islice(folder.resolve().glob(pattern), MOST_FILES + 1))
    if not 0 < len(found) <= MOST_FILES:
        raise HandbenchError(
            f"{folder / pattern}: stands for {len(found)} files; expected 1 to {MOST_FILES}"
        )
    return [inside(folder, str(path.relative_to(folder.resolve())), where) for path in found]


def _natural(name: object) -> list[tuple[int, str]]:
    """Sort key that puts 2 before 10 in names of files and data sets."""
    return [
        (int(word), "") if word.isdecimal() else (-1, word)
        for word in re.split(r"(\d{1,18})", str(name))
        if word
    ]


@contextmanager
def _open(path: Path) -> Iterator[tuple[Callable[[str], list[str]], Read]]:
    """Open a file and yield two functions: one that lists the names of data sets that match a name
    (with * perhaps), and one that reads the data set of a name."""
    import h5py

    kind = path.suffix.lower()
    try:
        if kind == ".npz":
            yield lambda name: [name], lambda name: read_npz(path, (name,))[name]
        elif kind not in ARRAYS and h5py.is_hdf5(path):
            with open_hdf5(path) as file:
                yield (
                    partial(_matching_hdf5, file),
                    lambda name: read(file, _stored_name(file, name) or name, path),
                )
        else:
            if kind == ".npy":
                with path.open("rb") as stream:
                    arrays = {"": read_array(stream, path.stat().st_size)}
            else:
                arrays = _read_table(path) if kind in TABLES else read_matlab(path)
            yield partial(_matching, list(arrays)), arrays.__getitem__
    except HandbenchError:
        raise
    except (OSError, KeyError, ValueError, TypeError, RuntimeError) as error:
        reason = " ".join(str(error).split())
        raise HandbenchError(
            f"{path}: is not a readable {KINDS.get(kind, 'HDF5 or MATLAB')} file ({reason}); "
            "copy it again"
        ) from error


def _matching(names: list[str], name: str) -> list[str]:
    return fnmatch.filter(names, name) if "*" in name else [name] * (name in names)


def _matching_hdf5(file: "h5py.File", name: str) -> list[str]:
    """List the data sets of an HDF5 file that match a name; a cell array of MATLAB counts as a
    group of its cells, "1", "2", …"""
    import h5py

    if "*" not in name:
        return [name] if _stored_name(file, name) else []
    names: list[str] = []

    def list_name(found: str) -> bool | None:
        names.append(found)
        return len(names) > MOST_FILES or None  # True ends the visit

    file.visit(list_name)
    plain = [found for found in names if isinstance(file[found], h5py.Dataset)]
    cells = name.removesuffix("/*")
    if cells != name and (count := len(_cells(file, cells))):
        return [f"{cells}/{number}" for number in range(1, count + 1)]
    return fnmatch.filter(plain, name)


def _stored_name(file: "h5py.File", name: str) -> str | None:
    """Return the name under which the file has a data set, of a cell that of its content; None if
    there is none."""
    if local_item(file, name) is not None:
        return name
    cells, _, number = name.rpartition("/")
    found = _cells(file, cells) if number.isdecimal() else []
    return found[int(number) - 1] if found and 0 < int(number) <= len(found) else None


def _cells(file: "h5py.File", name: str) -> list[str]:
    """Return the names of the data sets to which a cell array, or a structure array's field, of
    MATLAB 7.3 refers; empty if `name` is none."""
    import h5py

    found = local_item(file, name)
    if (
        not isinstance(found, h5py.Dataset)
        or h5py.check_ref_dtype(found.dtype) is not h5py.Reference
        or found.chunks is not None
        or not 0 < found.size <= MOST_FILES
    ):
        return []
    return [str(file[reference].name) for reference in found[()].ravel() if reference]


def _read_table(path: Path) -> dict[str, np.ndarray]:
    """Read numbers in lines and columns: {"": all [line, column], and each column by its name}.
    Columns are divided by commas, semicolons, tabs or blanks; complex numbers are 1+2i or 1+2j.
    Lines before the numbers are left out; the last of them names the columns if it has as many
    words."""
    text = read_text(path, "a table of numbers", TABLE_BYTES)
    if text.count(",") + text.count(";") + text.count("\n") > MOST_CELLS:
        raise ValueError(f"it has more than {MOST_CELLS} cells")
    lines = [line for line in text.split("\n") if line.strip()]
    marks = [next((mark for mark in ",;\t" if mark in line), None) for line in lines[:MOST_HEADER]]
    first = next((n for n, mark in enumerate(marks) if _numbers(lines[n], mark)), None)
    if first is None:
        raise ValueError("no line of it holds only numbers")
    split = marks[first]
    numbers = [IMAGINARY.sub("j", line) for line in lines[first:]]
    table = np.loadtxt(
        numbers,
        np.complex128 if any("j" in line for line in numbers) else np.float64,
        comments=COMMENTS,
        delimiter=split,
        ndmin=2,
    )
    names = [word.strip(' "#%!') for word in lines[first - 1].split(split)] if first else []
    names = [name for name in names if name]
    columns = dict(zip(names, table.T, strict=True)) if len(names) == table.shape[1] else {}
    return {**columns, "": table}


def _numbers(line: str, split: str | None) -> bool:
    """Tell if all cells of a line are numbers."""
    try:
        cells = IMAGINARY.sub("j", line).split(split)
        return bool([complex(cell.strip()) for cell in cells])
    except ValueError:
        return False
