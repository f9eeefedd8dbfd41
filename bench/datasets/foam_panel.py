"""Import of a real raster scan of a foam panel, 22–26 GHz with one transceiver, as a capture
folder.

Its file has six arrays in sequence: data uint16 [Q or I, tone, x, y], first frequency, last
frequency, number of tones, step along x and y, and distance. The mean of each tone over the scan is
subtracted (leakage, which is the same at all positions), and the tone's phase correction is added.
The echo is E = I − jQ, which is focused by e^{+jkR}, as all echoes in handbench.
"""

import warnings
from pathlib import Path
from typing import Any

import numpy as np

from handbench.bench.datasets.native import save_echoes_folder
from handbench.radar.data.arrays import PlanarScan
from handbench.radar.data.capture import RadarCapture
from handbench.support.errors import HandbenchError
from handbench.support.files import read_array, read_text, require_file, require_folder
from handbench.support.limits import CSV_BYTES

MOST_TONES, LARGEST = 100_000, 1e13


def import_planar_scan(source: str | Path, folder: str | Path) -> None:
    """Convert the raster scan in SOURCE/scan.npy, with the phase correction in SOURCE/phase.txt, to
    a capture folder. Raises HandbenchError for files of another format."""
    source = require_folder(source, "scan.npy and phase.txt")
    data, *settings = _read_arrays(source / "scan.npy")
    frequencies_hz, step_m = _settings(source / "scan.npy", *settings[:4])
    if (
        data.ndim != 4
        or data.shape[:2] != (2, len(frequencies_hz))
        or data.dtype.kind not in "iuf"
        or not data.size
    ):
        raise HandbenchError(
            f"{source / 'scan.npy'}: data is {data.dtype} {data.shape}; expected numbers [2, "
            f"{len(frequencies_hz)}, x, "
            "y]"
        )
    echo = data[1].astype(np.float64) - 1j * data[0].astype(np.float64)
    echo -= echo.mean(axis=(1, 2), keepdims=True)
    echo *= np.exp(1j * _phase_rad(source / "phase.txt", frequencies_hz))[:, None, None]
    capture = RadarCapture(
        echo.reshape(1, len(frequencies_hz), -1).astype(np.complex64),
        frequencies_hz,
        PlanarScan(_positions(data.shape[2:], step_m)),
    )
    save_echoes_folder(folder, capture, _facts(frequencies_hz, data.shape[2:], step_m))


def _read_arrays(path: Path) -> list[np.ndarray]:
    with require_file(path, "the scan's six arrays").open("rb") as stream:
        size = path.stat().st_size
        try:
            return [read_array(stream, size - stream.tell()) for _ in range(6)]
        except Exception as error:  # what parses numpy's headers raises whatever it stumbles over
            raise HandbenchError(
                f"{path}: is not a file of six plain numpy arrays ({error}); copy it again"
            ) from error


def _settings(
    path: Path, first_hz: np.ndarray, last_hz: np.ndarray, count: np.ndarray, step_m: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return the scan's frequencies [f] in Hz, and its steps [2] along x and y in metres. path: the
    file, named in messages. Raises HandbenchError for implausible numbers."""
    numbers = first_hz, last_hz, count, step_m
    good = all(
        n.dtype.kind in "iuf" and n.size in (1, 2) and (n > 0).all() and (n < LARGEST).all()
        for n in numbers
    )
    if not good or max(first_hz.size, last_hz.size, count.size) > 1 or count.item() > MOST_TONES:
        shown = ", ".join(
            f"{n.dtype} {n.tolist()}" if n.size < 3 else f"{n.dtype} {n.shape}" for n in numbers
        )
        raise HandbenchError(
            f"{path}: the first and last frequency, the number of tones and the step are {shown}; "
            f"expected positive numbers and at most {MOST_TONES} tones"
        )
    frequencies_hz = np.linspace(first_hz.item(), last_hz.item(), int(count.item()))
    return frequencies_hz, np.broadcast_to(step_m.ravel(), 2)


def _phase_rad(path: Path, frequencies_hz: np.ndarray) -> np.ndarray:
    try:
        with warnings.catch_warnings(action="ignore"):  # of an empty file
            table = np.loadtxt(
                read_text(path, "frequencies and phases, two rows", CSV_BYTES).splitlines(), ndmin=2
            )
    except ValueError as error:
        raise HandbenchError(
            f"{path}: expected two rows of numbers, the frequencies and their phases ({error}); "
            "copy it again"
        ) from error
    if (
        len(table) != 2
        or table.size == 0
        or not np.isfinite(table).all()
        or (np.diff(table[0]) <= 0).any()
    ):
        raise HandbenchError(
            f"{path}: has shape {table.shape}, or frequencies that do not increase; expected two "
            "rows, the increasing frequencies and their phases"
        )
    return np.interp(frequencies_hz, *table)


def _positions(shape: tuple[int, ...], step_m: np.ndarray) -> np.ndarray:
    """Compute the scan's positions [x·y, 3], metres, centred at the origin and in the order of the
    data. shape: number of positions along x and y; step_m: distances between them."""
    axes = [(np.arange(n) - (n - 1) / 2) * step for n, step in zip(shape, step_m, strict=True)]
    x, y = np.meshgrid(*axes, indexing="ij")
    return np.stack([x.ravel(), y.ravel(), np.zeros(x.size)], axis=1)


def _facts(
    frequencies_hz: np.ndarray, shape: tuple[int, ...], step_m: np.ndarray
) -> dict[str, Any]:
    """Return the fields of the capture's description, with settings of each method that suit this
    sensor's tones and aperture. shape: number of positions along x and y; step_m: distances between
    them, metres."""
    lateral = {
        axis: {"start_m": -(n - 1) / 2 * step, "stop_m": (n - 1) / 2 * step, "step_m": 2 * step}
        for axis, n, step in zip("xy", shape, step_m.tolist(), strict=True)
    }
    low, middle, high = (float(frequencies_hz[i]) for i in (0, -2, -1))
    tones = {"f1_hz": high, "f2_hz": middle}
    depth = {"z": {"start_m": 0.08, "stop_m": 0.13, "step_m": 0.001}}
    # c / (2 · 4 GHz) is 37.5 mm
    unambiguous = {"z": {"start_m": 0.082, "stop_m": 0.118, "step_m": 0.001}}
    fsk = {**lateral, **tones, "first_depth_m": 0.10}
    sweep = {"start_hz": low, "stop_hz": high, "count": len(frequencies_hz)}
    return {
        "name": "foam-panel",
        "kind": "scan",
        "source": "22.2–26.2 GHz stepped-CW raster scan of a foam panel with one transceiver",
        "methods": {
            "2fsk": fsk,
            "3fsk": {**fsk, "f3_hz": low},
            "broadband": {**lateral, **depth, **sweep},
            "narrowband": {**lateral, **unambiguous, **tones, "f3_hz": low},
        },
    }
