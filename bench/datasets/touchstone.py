"""Import of a network analyser's Touchstone files (.s1p, .s2p) as a capture folder. There is one
file for each position of the antennas.

Network analysers use e^{+jωt}, so S21 of a path is exp(−j2πf·path/c), which is handbench's own
sign.
"""

from io import StringIO
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from handbench.bench.datasets.native import save_echoes_folder
from handbench.radar.data.capture import to_capture
from handbench.support.config import Config, parse
from handbench.support.errors import HandbenchError
from handbench.support.files import (
    CSV_BYTES,
    TOUCHSTONE_BYTES,
    inside,
    read_parsed,
    require_file,
    require_folder,
    require_size,
)

if TYPE_CHECKING:
    import pandas as pd

POSITIONS = "positions.csv"
PLACES = [f"{end}_{axis}_m" for end in ("tx", "rx") for axis in "xyz"]
COLUMNS = ["file", *PLACES]


class TouchstoneSettings(Config):
    """Selection of the S parameter that becomes the echoes; default: S21 of files with two ports,
    S11 of files with one."""

    parameter: Literal["S11", "S21", "S12", "S22"] | None = None


def import_touchstone(source: Path, folder: Path, /, **settings: Any) -> None:
    """Convert Touchstone files to a capture folder.

    SOURCE/positions.csv lists the files, with the positions of transmitter and receiver for each.
    The capture is the scan of one transceiver if transmitter and receiver always have the same
    position, else a list of pairs of antennas. settings: fields of `TouchstoneSettings`. Raises
    HandbenchError for files of another format, or with different frequencies.
    """
    from handbench.radar.methods.ability import measured_settings

    source = require_folder(source, f"{POSITIONS} and .s1p or .s2p files")
    parameter = parse(TouchstoneSettings, settings, "--set").parameter
    what = f"the columns {','.join(COLUMNS)} and a line for each measurement"
    table = read_parsed(source / POSITIONS, what, "CSV", _table, CSV_BYTES)
    files = [inside(source, name, POSITIONS) for name in table["file"]]
    tones_hz, values = zip(*(read_touchstone(file, parameter) for file in files), strict=True)
    for file, others_hz in zip(files, tones_hz, strict=True):
        if not np.array_equal(others_hz, tones_hz[0]):
            raise HandbenchError(
                f"{file}: has other frequencies than {files[0].name}; measure all positions with "
                "the same frequencies"
            )
    samples = np.stack(values, axis=1)[None]
    tx_m, rx_m = np.split(table[PLACES].to_numpy(), 2, axis=1)
    if np.array_equal(tx_m, rx_m):
        kind, places_m, pairs = "scan", {"position_m": tx_m}, None
    else:
        tx_m, t = np.unique(tx_m, axis=0, return_inverse=True)
        rx_m, r = np.unique(rx_m, axis=0, return_inverse=True)
        kind, places_m, pairs = "other", {"tx_m": tx_m, "rx_m": rx_m}, np.stack([t, r], axis=1)
    capture = to_capture(samples, tones_hz[0], places_m, pairs)
    facts = {"kind": kind, "source": "Touchstone files", "methods": measured_settings(tones_hz[0])}
    save_echoes_folder(folder, capture, facts)


def read_touchstone(path: Path, parameter: str | None) -> tuple[np.ndarray, np.ndarray]:
    """Read one S parameter from a Touchstone file. Returns its frequencies [f] in Hz, and complex
    values [f].

    parameter: "S11" to "S22"; None: S21 of files with two ports, S11 of files with one. Raises
    HandbenchError for a file of another format.
    """
    from skrf.io.touchstone import Touchstone  # takes half a second

    require_size(require_file(path, "a Touchstone file"), "a Touchstone file", TOUCHSTONE_BYTES)
    try:
        file = Touchstone(path)
        to, by = (int(port) - 1 for port in (parameter or ("S11" if file.rank == 1 else "S21"))[1:])
        values = file.s[:, to, by]
        if not len(values) or not np.isfinite(values).all():
            raise ValueError("its values are missing or infinite")
        return file.f, values
    except Exception as error:  # the parser's errors have no common base
        raise HandbenchError(
            f"{path}: is not a Touchstone file with {parameter or 'S11 or S21'} "
            f"({' '.join(str(error).split())[:200]}); export it again as .s1p or .s2p"
        ) from error


def _table(text: str) -> "pd.DataFrame":
    """Read the names of files and the positions, metres, in a table with COLUMNS."""
    import pandas as pd  # half a second

    table = pd.read_csv(StringIO(text), dtype=dict.fromkeys(PLACES, float))
    if absent := [column for column in COLUMNS if column not in table]:
        raise ValueError(f"it has no column {', '.join(absent)}")
    if table.empty:
        raise ValueError("it lists no file")
    if len(twice := table["file"][table["file"].duplicated()]):
        raise ValueError(f"it names {twice.iloc[0]} twice, but a file is of one position")
    table = table[COLUMNS]
    if (missing := table.isna().to_numpy()).any():
        row, column = np.argwhere(missing)[0]
        raise ValueError(f"line {row + 2} has no {table.columns[column]}")
    return table.astype({"file": str})
