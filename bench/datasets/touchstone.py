"""Import of a network analyser's Touchstone files (.s1p, .s2p) as a capture folder. There is one
file for each position of the antennas.

A file of version 1.1 of the format (Touchstone File Format Specification, IBIS Open Forum, 2002)
has comments after "!", one option line such as "# GHz S MA R 50", and for each tone a record: the
frequency and 1 or 4 pairs of numbers (for two ports S11, S21, S12, S22). Noise parameters may
follow. Network analysers use e^{+jωt}, so S21 of a path is exp(−j2πf·path/c), which is handbench's
own sign.
"""

import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Literal

import numpy as np

from handbench.bench.datasets.method_tables import method_tables
from handbench.bench.datasets.native import save_echoes_folder
from handbench.radar.data.arrays import positions
from handbench.radar.data.recording import Recording
from handbench.support.caller import option
from handbench.support.config import Config, parse
from handbench.support.cost import require_free
from handbench.support.errors import HandbenchError
from handbench.support.files import inside, read_bytes, read_csv, require_folder
from handbench.support.limits import TOUCHSTONE_BYTES

POSITIONS = "positions.csv"
COLUMNS = ["file", "tx_x_m", "tx_y_m", "tx_z_m", "rx_x_m", "rx_y_m", "rx_z_m"]
PARAMETERS = {".s1p": ("S11",), ".s2p": ("S11", "S21", "S12", "S22")}  # in a record's order
USUAL = {".s1p": "S11", ".s2p": "S21"}
UNITS = {"HZ": 1.0, "KHZ": 1e3, "MHZ": 1e6, "GHZ": 1e9}
FORMATS = ("RI", "MA", "DB")
OPTIONS = "expected '#', then any of: Hz, kHz, MHz or GHz; S; RI, MA or DB; R and ohms"
NOISE = 5  # numbers of a line of noise parameters


class TouchstoneSettings(Config):
    """Selection of the S parameter that becomes the echoes; default: S21 of files with two ports,
    S11 of files with one."""

    parameter: Literal["S11", "S21", "S12", "S22"] | None = None


def import_touchstone(
    source: str | Path, folder: str | Path, settings: Mapping[str, Any] | None = None
) -> None:
    """Convert the Touchstone files that SOURCE/positions.csv lists, with the positions of
    transmitter and receiver for each, to a capture folder.

    The capture is the scan of one transceiver if transmitter and receiver always have the same
    position, else a list of pairs of antennas. settings: fields of `TouchstoneSettings`. Raises
    HandbenchError for files of another format, or with different frequencies.
    """
    source = require_folder(source, f"{POSITIONS} and .s1p or .s2p files")
    wanted = parse(TouchstoneSettings, dict(settings or {}), option("--set", "settings")).parameter
    names, places_m = _read_positions(source / POSITIONS)
    frequencies_hz, samples = np.empty(0), np.empty((0, 0), np.complex64)
    for row, name in enumerate(names):
        path = inside(source, name, POSITIONS)
        tones_hz, values = read_touchstone(path, wanted)
        if row == 0:
            frequencies_hz = tones_hz
            shape = len(tones_hz), len(names)
            require_free(8.0 * math.prod(shape), f"{source}: {shape}", "import fewer files")
            samples = np.empty(shape, np.complex64)
        if tones_hz.shape != frequencies_hz.shape or not np.allclose(
            tones_hz, frequencies_hz, rtol=1e-9, atol=0
        ):
            raise HandbenchError(
                f"{path}: has {_range(tones_hz)}, but {names[0]} has {_range(frequencies_hz)}; "
                "measure all positions with the same frequencies"
            )
        samples[:, row] = values
    tx_m, rx_m = places_m[:, :3], places_m[:, 3:]
    moved = np.array_equal(tx_m, rx_m)
    tables, pairs = ({"position_m": tx_m}, None) if moved else _pairs(tx_m, rx_m)
    about = {"source": f"Touchstone files, {wanted or USUAL[Path(names[0]).suffix.lower()]}"}
    capture = Recording(samples[None, None], frequencies_hz, tables, pairs, about=about).capture()
    facts = {"kind": "scan" if moved else "other", "methods": method_tables(capture)}
    save_echoes_folder(folder, capture, facts | about)


def read_touchstone(path: Path, parameter: str | None = None) -> tuple[np.ndarray, np.ndarray]:
    """Read one S parameter from a Touchstone file. Returns its ascending frequencies [f] in Hz, and
    complex values [f].

    parameter: "S11" to "S22"; default: S21 of files with two ports, S11 of files with one. Raises
    HandbenchError, with the line, for a file of another format.
    """
    kind = path.suffix.lower()
    if kind not in PARAMETERS:
        raise HandbenchError(
            f"{path}: is not a Touchstone file; expected a name that ends in .s1p or .s2p"
        )
    if (parameter := parameter or USUAL[kind]) not in PARAMETERS[kind]:
        raise HandbenchError(
            f"{path}: has only S11, but {parameter} is requested; give a .s2p file"
        )
    content = read_bytes(path, "a Touchstone file", TOUCHSTONE_BYTES)
    (unit, form), records = _read_records(path, content, 1 + 2 * len(PARAMETERS[kind]))
    at = 1 + 2 * PARAMETERS[kind].index(parameter)
    first, second = records[:, at], records[:, at + 1]
    if form == "RI":
        values = first + 1j * second
    else:
        with np.errstate(over="ignore", invalid="ignore"):
            size = 10.0 ** (first / 20) if form == "DB" else first
            values = size * np.exp(1j * np.deg2rad(second))
    if not (np.abs(values) < 1e30).all():
        raise HandbenchError(
            f"{path}: {parameter} has a magnitude of {np.abs(values).max():.3g}; expected about 1 "
            f"or less; check that its numbers are {form}, as its option line says"
        )
    return records[:, 0] * UNITS[unit], values


def _read_records(path: Path, content: bytes, size: int) -> tuple[tuple[str, str], np.ndarray]:
    """Parse the content of a Touchstone file. Returns its unit of frequency and format of numbers,
    and the records [f, size], each with the frequency first.

    size: numbers in a record, which may continue over several lines. Noise parameters, which start
    again at a lower frequency, are skipped. Raises HandbenchError for content of another format.
    """
    options: tuple[str, str] | None = None
    records: list[list[float]] = []
    record: list[float] = []
    number = 0
    for number, line in enumerate(content.removeprefix(b"\xef\xbb\xbf").splitlines(), 1):
        text, where = line.split(b"!")[0].decode("latin-1").strip(), f"{path}: line {number}"
        if text.startswith("#"):
            options = options or _options(text[1:], where)  # the first one counts
            continue
        if text.startswith("["):
            raise HandbenchError(
                f"{where} is '{text[:40]}', which is Touchstone version 2; export the file as "
                "version 1"
            )
        if not text:
            continue
        if options is None:
            raise HandbenchError(f"{where} is before the option line; {OPTIONS}")
        try:
            numbers = [float(word) for word in text.split()]
        except ValueError:
            numbers = []
        last_hz = records[-1][0] if records else -math.inf
        if not record and size == 9 and len(numbers) == NOISE and numbers[0] <= last_hz:
            break
        record = record + numbers
        if not numbers or not all(map(math.isfinite, numbers)) or len(record) > size:
            raise HandbenchError(f"{where} is '{text[:40]}'; expected {size} numbers")
        if len(record) == size:
            if not record[0] > max(last_hz, 0):
                raise HandbenchError(
                    f"{where} has the frequency {record[0]:g}; expected one above the frequency "
                    f"before it, {max(last_hz, 0):g}"
                )
            records.append(record)
            record = []
    if options is None or record or not records:
        raise HandbenchError(
            f"{path}: ends at line {number} with {len(record)} numbers; expected {size} numbers "
            "for each frequency; check that the file is complete"
        )
    return options, np.array(records)


def _options(text: str, where: str) -> tuple[str, str]:
    """Parse the option line of a Touchstone file, whose words may have any order and case. Returns
    the unit of frequency and the format of numbers. Raises HandbenchError for an unknown word;
    where: beginning of its message."""
    words = text.upper().split()
    unit, form = "GHZ", "MA"
    while words:
        word = words.pop(0)
        if word in UNITS:
            unit = word
        elif word in FORMATS:
            form = word
        elif word == "R" and words and words[0].replace(".", "", 1).isdigit():
            words.pop(0)  # ohms: S parameters are echoes over what was sent, whatever they are
        elif word != "S":
            raise HandbenchError(f"{where} has the option '{word[:20]}'; {OPTIONS}")
    return unit, form


def _read_positions(path: Path) -> tuple[list[str], np.ndarray]:
    """Read `positions.csv`. Returns the names of the n Touchstone files, and the positions [n, 6]
    of transmitter (x, y, z) and receiver (x, y, z) for each, metres."""
    rows = read_csv(path, COLUMNS)
    if rows and rows[0] != (1, COLUMNS):
        number, row = rows[0]
        found = f"{path}: line {number} is '{str(row)[:80]}'"
        raise HandbenchError(f"{found}; expected {','.join(COLUMNS)} in line 1")
    names: list[str] = []
    places: list[list[float]] = []
    lines: dict[Any, int] = {}
    for number, row in rows[1:]:
        where = f"{path}: line {number}"
        if len(row) != len(COLUMNS):
            raise HandbenchError(f"{where} has {len(row)} columns; expected {len(COLUMNS)}")
        try:
            place = [float(cell) for cell in row[1:]]
        except ValueError as error:
            raise HandbenchError(f"{where}: {error}; expected a number of metres") from None
        for what in (row[0], tuple(place)):
            if (before := lines.setdefault(what, number)) != number:
                raise HandbenchError(
                    f"{where} repeats the file or the position of line {before}; give each "
                    "position a file of its own"
                )
        names.append(row[0])
        places.append(place)
    if not names:
        raise HandbenchError(f"{path}: lists no file; add one line for each measurement")
    positions(str(path), np.reshape(places, (-1, 3)))  # refuses what cannot be metres
    return names, np.array(places)


def _pairs(tx_m: np.ndarray, rx_m: np.ndarray) -> tuple[dict[str, np.ndarray], np.ndarray]:
    """Find the antennas in the positions of transmitter and receiver of each of n files, tx_m and
    rx_m [n, 3]. Returns the different positions under the keys "tx_m" and "rx_m", and for each file
    the indices [n, 2] of its transmitter and receiver in them."""
    found = {
        name: np.unique(places_m, axis=0, return_inverse=True)
        for name, places_m in (("tx_m", tx_m), ("rx_m", rx_m))
    }
    pairs = np.stack([index.reshape(-1) for _, index in found.values()], axis=1)
    return {name: places_m for name, (places_m, _) in found.items()}, pairs


def _range(tones_hz: np.ndarray) -> str:
    low, high = tones_hz[0] / 1e9, tones_hz[-1] / 1e9
    return f"{len(tones_hz)} tones in {low:.6g}–{high:.6g} GHz"
