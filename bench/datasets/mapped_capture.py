"""Captures whose echoes are in another program's files; a `mapping.toml` next to them names the
data sets."""

import math
from dataclasses import dataclass
from functools import cached_property
from itertools import groupby
from pathlib import Path

import numpy as np

from handbench.bench.datasets.mapping import (
    ORDER,
    RE_IM,
    UNITS,
    ArrayMapping,
    Column,
    ComplexMapping,
    Mapping,
    PositionsMapping,
    SamplesMapping,
    Steps,
    TableMapping,
)
from handbench.bench.datasets.named_arrays import Read, read_arrays
from handbench.bench.datasets.native import MAPPING, CaptureFile, NativeCapture
from handbench.radar.data.capture import RadarCapture
from handbench.radar.data.recording import Recording, join_arrays
from handbench.support.config import load
from handbench.support.errors import HandbenchError

PARTS = (("real", "imag"), ("r", "i"))  # names of a complex number's parts: MATLAB's, h5py's


@dataclass(frozen=True)
class MappedCapture(NativeCapture):
    """A folder with a `mapping.toml`; mesh, photographs and transform are as in a capture
    folder."""

    @staticmethod
    def fits(folder: Path) -> bool:
        """True if this adapter reads the capture in `folder`."""
        return (folder / MAPPING).is_file()

    @cached_property
    def mapping(self) -> Mapping:
        """The content of its mapping.toml."""
        return load(Mapping, self.folder / MAPPING, "a mapping of other programs' files")

    @property
    def about(self) -> CaptureFile:
        """The description of the capture."""
        return self.mapping.capture

    def echoes(self, frames: int | None = None, calibrated: bool = True) -> RadarCapture:
        """Read the echoes of the first `frames` frames (None: all).

        Gains in the mapping are always applied. calibrated: apply the capture's corrections
        (`corrections.json`), too, and print a line about them. Raises HandbenchError if the files
        do not agree with the mapping.
        """
        mapping, arrays = self.mapping, (self.mapping, *self.mapping.array)
        names = {name for array in arrays for name in array.datasets}
        of_all = (mapping.frequencies.dataset, mapping.times_s, mapping.frame_times_s)
        names |= {name for name in of_all if isinstance(name, str)}
        try:
            read = read_arrays(self.folder, names, mapping.file, MAPPING)
            capture = join_arrays([_recording(read, mapping, array).capture() for array in arrays])
            capture = capture.first_frames(frames)
            return self._corrected(capture) if calibrated else capture
        except HandbenchError as error:
            message = str(error)
            known = message.startswith(f"{self.folder}/")  # about one of the files
            where = "" if known else f"{self.folder / MAPPING}: "
            raise HandbenchError(where + message) from None


def _recording(read: Read, mapping: Mapping, array: ArrayMapping) -> Recording:
    """Read one array of the mapping."""
    frequencies_hz = _frequencies_hz(read, mapping)
    antennas_m = {
        name: entry.scale_m * _table(read, entry, 3, name)
        for name in ("tx", "rx")
        if (entry := getattr(array, name)) is not None
    }
    pairs, places_m, grid = None, None, dict[str, int]()
    if array.pairs is not None:
        pairs = _table(read, array.pairs, 2, "pairs") - array.pairs.first
    if array.position is not None:
        places_m, grid = _places_m(read, array.position, array.samples)
    counts = {"frequency": len(frequencies_hz), RE_IM: 2, **grid}
    counts |= {"pair": len(pairs)} if pairs is not None else {}
    for name, table in antennas_m.items() if pairs is None else ():
        counts[name] = len(table)
        if len(table) > 1 and name not in array.samples.counted:
            raise HandbenchError(
                f"{name} has {len(table)} antennas; expected one, or '{name}' in samples.axes"
            )
    samples, gains = _samples_and_gains(read, array, counts)
    times_s = {
        name: _column(read, column)
        for name in ("times_s", "frame_times_s")
        if (column := getattr(mapping, name)) is not None
    }
    tables_m, pairs = _channels(antennas_m, pairs, places_m)
    channels = [len(table) for table in tables_m.values()] if pairs is None else [len(pairs)]
    return Recording(
        samples.reshape(*samples.shape[:3], *channels),
        frequencies_hz,
        tables_m,
        pairs,
        None if gains is None else gains.reshape(*gains.shape[:-6], *channels),
        array.samples.sweeps or "mean",
        {
            "wave_speed_m_s": mapping.wave_speed_m_s,
            "source": mapping.capture.source or "",
            "licence": mapping.licence,
            **times_s,
        },
    )


def _frequencies_hz(read: Read, mapping: Mapping) -> np.ndarray:
    """Read the tones [f], hertz."""
    entry = mapping.frequencies
    if entry.steps is not None:
        found = entry.steps.values()
    else:
        found = _real(read, entry.dataset or "")
        if found.size == 0 or found.size != max(found.shape, default=0):
            # MATLAB's have an axis of one more
            raise _wrong(entry.dataset or "", found, "[frequency]")
    with np.errstate(over="ignore"):  # what is infinite then is refused with the capture
        return found.reshape(-1) * UNITS[entry.unit]


def _table(
    read: Read, entry: TableMapping, columns: int, what: str, turned: bool = False
) -> np.ndarray:
    """Read a table of real numbers [n, columns]; columns that are left out are 0. what: the table's
    name; turned: as of `_column`."""
    if entry.columns is not None:
        found = [_column(read, column, turned) for column in entry.columns]
        lengths = {len(column) for column in found} - {1} or {1}
        if len(lengths) > 1 or len(found) > columns:
            raise HandbenchError(
                f"{what}.columns have {', '.join(str(len(column)) for column in found)} values; "
                f"expected {columns} columns at most, each with one value or all with as many"
            )
        found += [np.zeros(1)] * (columns - len(found))
        return np.stack([np.broadcast_to(column, max(lengths)) for column in found], axis=1)
    name = entry.dataset or ""
    stored = _real(read, name)
    if stored.ndim != 2 or stored.shape[0 if entry.reversed else 1] != columns:
        expected = (
            f"[{columns}, n] as stored, for it is reversed" if entry.reversed else f"[n, {columns}]"
        )
        raise _wrong(name, stored, f"{expected} of {what}")
    return stored.T if entry.reversed else stored


def _column(read: Read, column: Column, turned: bool = False) -> np.ndarray:
    """Read the numbers of a column [n]; a data set with several axes in the order in which it is
    stored. turned: in the order of the reversed axes."""
    if isinstance(column, Steps):
        return column.values()
    if not isinstance(column, str):
        return np.array(column, np.float64).reshape(-1)
    values = _real(read, column)
    return (values.T if turned else values).reshape(-1)


def _places_m(
    read: Read, entry: PositionsMapping, samples: SamplesMapping
) -> tuple[np.ndarray, dict[str, int]]:
    """Read the places [n, 3], metres, to which antennas are moved, and how many places each axis
    counts. Of a grid, the columns of x and y have the coordinates along these axes."""
    if "position" in samples.counted:
        turned = bool(entry.reversed) != samples.reversed
        places = _table(read, entry, 3, "position", turned)
        return entry.scale_m * places, {"position": len(places)}
    columns = [_column(read, column) for column in (*(entry.columns or ()), 0.0, 0.0)[:3]]
    counts = {"y": len(columns[1]), "x": len(columns[0])}
    for axis, count in {**counts, "z": len(columns[2])}.items():
        if count > 1 and axis not in samples.counted:
            raise HandbenchError(
                f"position.columns have {count} values of {axis}; expected one, or '{axis}' in "
                "samples.axes"
            )
    y, x = np.meshgrid(columns[1], columns[0], indexing="ij")
    places = np.stack([x.ravel(), y.ravel(), np.broadcast_to(columns[2], x.size)], axis=1)
    return entry.scale_m * places, counts


def _channels(
    antennas_m: dict[str, np.ndarray], pairs: np.ndarray | None, places_m: np.ndarray | None
) -> tuple[dict[str, np.ndarray], np.ndarray | None]:
    """Positions by name and list of pairs of a `Recording`. Antennas that are moved to places_m [n,
    3] become as many, all pairs of the first place before those of the next."""
    tables_m = {f"{name}_m": at_m for name, at_m in antennas_m.items()}
    if places_m is None:
        return tables_m, pairs
    if not tables_m:
        return {"position_m": places_m}, None
    counts = np.array([len(at_m) for at_m in tables_m.values()])
    of_place = np.argwhere(np.ones(counts)) if pairs is None else pairs
    moved_m = {k: (places_m[:, None] + at_m).reshape(-1, 3) for k, at_m in tables_m.items()}
    first = np.arange(len(places_m))[:, None, None] * counts
    return moved_m, (first + of_place).reshape(-1, 2)


def _samples_and_gains(
    read: Read, array: ArrayMapping, counts: dict[str, int]
) -> tuple[np.ndarray, np.ndarray | None]:
    """Read samples, without the background, and what they are divided by; both have all axes of
    ORDER, the gains from "frequency" on, or from the places on if they are the same at each."""
    samples, gains = _complex(read, array.samples, counts), None
    if array.background is not None:
        samples = samples - _complex(read, array.background, counts)
    if array.gains is not None:
        [[gains]] = _complex(read, array.gains, counts)
        with np.errstate(invalid="ignore", over="ignore"):  # 0, of a dead channel, becomes NaN
            gains = gains / np.abs(gains) if array.gains.phase_only else gains
            gains = gains**array.gains.passes
        gains = np.broadcast_to(gains, (len(gains), *samples.shape[3:]))
        gains = gains[0] if len(gains) == 1 else gains
    if array.samples.sign == "+":
        samples, gains = samples.conj(), None if gains is None else gains.conj()
    return samples, gains


def _complex(read: Read, entry: ComplexMapping, counts: dict[str, int]) -> np.ndarray:
    """Read complex numbers, with all axes of ORDER; one that the file lacks has length one.
    counts: axis → its expected length, if known."""
    groups: list[tuple[str, ...]] = [
        (axis,) if isinstance(axis, str) else axis for axis in entry.axes
    ]
    if entry.reversed:
        groups = [group[::-1] for group in groups[::-1]]
    parts = {}
    for name in entry.datasets:
        stored = read(name)
        if (shape := _flat_shape(stored.shape, groups, counts, entry.reversed)) is None:
            known = ", ".join(
                "·".join(f"{axis} {counts[axis]}" if axis in counts else axis for axis in group)
                for group in groups
            )
            raise _wrong(name, stored, f"[{known}] as stored")
        parts[name] = stored.reshape(shape)
    axes = tuple(entry.counted[::-1] if entry.reversed else entry.counted)
    # what is infinite is refused with the capture
    with np.errstate(invalid="ignore", over="ignore"):
        values = _joined(parts, axes)
    axes = tuple(axis for axis in axes if axis != RE_IM)
    values = values.transpose([axes.index(axis) for axis in ORDER if axis in axes])
    return np.expand_dims(values, [k for k, axis in enumerate(ORDER) if axis not in axes])


def _flat_shape(
    shape: tuple[int, ...], groups: list[tuple[str, ...]], counts: dict[str, int], reversed: bool
) -> list[int] | None:
    """Compute the shape that an array has with one axis for each thing that it counts; None if it
    does not fit.
    shape: as stored; groups: what each stored axis counts. reversed: the file is MATLAB's, which
    leaves out last axes of length one. Axes of length one that count nothing are left out."""
    if reversed:
        shape = (1,) * (len(groups) - len(shape)) + shape
    ones = [k for k, size in enumerate(shape) if size == 1][: max(len(shape) - len(groups), 0)]
    sizes = [size for k, size in enumerate(shape) if k not in ones]
    if len(sizes) != len(groups) or 0 in sizes:
        return None
    flat: list[int] = []
    for group, stored in groupby(zip(groups, sizes, strict=True), key=lambda pair: pair[0]):
        size = math.prod(size for _, size in stored)  # of several axes only for `position`
        unknown = [axis for axis in group if axis not in counts]
        known = math.prod(counts.get(axis, 1) for axis in group)
        if len(unknown) > 1 or size % known or (not unknown and size != known):
            return None
        flat += [counts.get(axis, size // known) for axis in group]
    return flat


def _joined(parts: dict[str, np.ndarray], axes: tuple[str, ...]) -> np.ndarray:
    """Join real and imaginary parts to complex numbers. parts: name → data set, one or two; axes:
    of these arrays, in order."""
    if len(parts) == 2 or RE_IM in axes:
        given = [_require_real(name, values) for name, values in parts.items()]
        real, imag = given if len(given) == 2 else np.moveaxis(given[0], axes.index(RE_IM), 0)
        return real + 1j * imag
    [(name, values)] = parts.items()
    for real, imag in PARTS:
        if values.dtype.names and set(values.dtype.names) == {real, imag}:
            return values[real] + 1j * values[imag]
    if values.dtype.kind != "c":
        raise HandbenchError(
            f"'{name}' has values of type {values.dtype}; expected complex numbers; name the data "
            'sets of both parts (real, imag), or the axis "re_im"'
        )
    return values


def _real(read: Read, name: str) -> np.ndarray:
    return _require_real(name, read(name)).astype(np.float64)


def _require_real(name: str, values: np.ndarray) -> np.ndarray:
    if values.dtype.kind not in "iuf":
        raise HandbenchError(f"'{name}' has values of type {values.dtype}; expected real numbers")
    return values


def _wrong(name: str, values: np.ndarray, expected: str) -> HandbenchError:
    return HandbenchError(
        f"'{name}' has shape {values.shape}; expected {expected}; correct mapping.toml"
    )
