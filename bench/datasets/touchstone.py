"""Import of a network analyser's Touchstone files (.s1p, .s2p) as a capture folder. There is one
file for each position of the antennas.

Network analysers use e^{+jωt}, so S21 of a path is exp(−j2πf·path/c), which is handbench's own
sign.
"""

from collections.abc import Mapping
from io import StringIO
from pathlib import Path
from typing import Any, Literal

import numpy as np

from handbench.bench.datasets.native import save_echoes_folder
from handbench.radar.data.recording import Recording
from handbench.radar.methods.advice import default_config
from handbench.support.config import Config, parse
from handbench.support.errors import HandbenchError
from handbench.support.files import inside, read_text, require_file, require_folder, require_size
from handbench.support.limits import CSV_BYTES, TOUCHSTONE_BYTES

POSITIONS = "positions.csv"
TX, RX = (tuple(f"{end}_{axis}_m" for axis in "xyz") for end in ("tx", "rx"))


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
    chosen = parse(TouchstoneSettings, dict(settings or {}), "--set")
    names, tx_m, rx_m = _read_positions(source / POSITIONS)
    measured = [
        read_touchstone(inside(source, name, POSITIONS), chosen.parameter) for name in names
    ]
    frequencies_hz = measured[0][0]
    for name, (tones_hz, _) in zip(names, measured, strict=True):
        if not np.array_equal(tones_hz, frequencies_hz):
            raise HandbenchError(
                f"{source / name}: has other frequencies than {names[0]}; measure all positions "
                "with the same frequencies"
            )
    samples = np.stack([values for _, values in measured], axis=1)[None, None]
    if np.array_equal(tx_m, rx_m):
        kind, places_m, pairs = "scan", {"position_m": tx_m}, None
    else:
        tx_m, t = np.unique(tx_m, axis=0, return_inverse=True)
        rx_m, r = np.unique(rx_m, axis=0, return_inverse=True)
        kind, places_m, pairs = "other", {"tx_m": tx_m, "rx_m": rx_m}, np.stack([t, r], axis=1)
    capture = Recording(samples, frequencies_hz, places_m, pairs).capture()
    facts = {"kind": kind, "source": "Touchstone files", "methods": default_config(frequencies_hz)}
    save_echoes_folder(folder, capture, facts)


def read_touchstone(path: Path, parameter: str | None = None) -> tuple[np.ndarray, np.ndarray]:
    """Read one S parameter from a Touchstone file. Returns its frequencies [f] in Hz, and complex
    values [f].

    parameter: "S11" to "S22"; default: S21 of files with two ports, S11 of files with one. Raises
    HandbenchError for a file of another format.
    """
    from skrf.io.touchstone import Touchstone  # takes half a second

    require_size(require_file(path, "a Touchstone file"), "a Touchstone file", TOUCHSTONE_BYTES)
    try:
        file = Touchstone(path)
        usual = "S11" if file.rank == 1 else "S21"
        to, by = (int(port) - 1 for port in (parameter or usual)[1:])
        values = file.s[:, to, by]
        if not len(values) or not np.isfinite(values).all():
            raise ValueError("its values are missing or infinite")
        return file.f, values
    except Exception as error:  # the parser's errors have no common base
        raise HandbenchError(
            f"{path}: is not a Touchstone file with {parameter or 'S11 or S21'} "
            f"({' '.join(str(error).split())[:200]}); export it again as .s1p or .s2p"
        ) from error


def _read_positions(path: Path) -> tuple[list[str], np.ndarray, np.ndarray]:
    """Read `positions.csv`. Returns the names of the n Touchstone files, and the positions [n, 3]
    of transmitter and receiver for each, metres."""
    import pandas as pd  # half a second

    columns = ("file", *TX, *RX)
    try:
        text = read_text(path, f"a table with the columns {','.join(columns)}", CSV_BYTES)
        table = pd.read_csv(StringIO(text), usecols=columns, dtype={"file": str})
        places_m = table[[*TX, *RX]].to_numpy(float)
        if not len(places_m) or not np.isfinite(places_m).all():
            raise ValueError("a position is missing or infinite")
        return table["file"].tolist(), places_m[:, :3], places_m[:, 3:]
    except ValueError as error:
        raise HandbenchError(
            f"{path}: is not a table of files ({error}); expected the columns {','.join(columns)} "
            "and a line for each measurement"
        ) from error
