"""Reader and writer of the file `echoes.h5`, which contains a capture.

Version 1 of the format can store an array or a planar scan in air; version 2 stores any capture,
and names its units, frame and time convention (docs/files.md).
"""

import json
import os
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from handbench.radar.data.arrays import SPEED_OF_LIGHT_M_S, AntennaArray, BistaticScan
from handbench.radar.data.capture import RadarCapture, as_complex64
from handbench.radar.data.recording import Recording
from handbench.support.config import suggest
from handbench.support.errors import HandbenchError
from handbench.support.files import atomic_path, plain_json, require_file
from handbench.support.hdf5 import attribute, local_item, read
from handbench.support.limits import JSON_BYTES

if TYPE_CHECKING:
    import h5py

FORMAT = "handbench-echoes"
HEADERS_BYTES = 2**13  # size of the file's headers, at least
# sign of x in handbench's frame; as seen from the array looking at the target
FRAMES = {"x left, y up, z away": 1, "x right, y up, z away": -1}
# Conventions that version 2 names, with the allowed values, handbench's first. time: e^{±jωt}, for
# which an echo is exp(∓j2πf·path/v).
CONVENTIONS = {"units": ("m, Hz, m/s",), "frame": tuple(FRAMES), "time": ("+jwt", "-jwt")}
OURS = {name: values[0] for name, values in CONVENTIONS.items()}
ABOUT = {"wave_speed_m_s": float, "source": str, "licence": str}
CALIBRATION = "array.json"  # name of the data set that holds the bytes of such a file
TIMES = ("times_s", "frame_times_s")
SCAN = ("samples", "frequencies_hz", "position_m", *TIMES, "gains")
ARRAY = ("samples", "frequencies_hz", "tx_m", "rx_m", *TIMES, "gains", "pairs", CALIBRATION)
NEEDED = {  # data sets without which a file cannot be read, with their shapes
    "samples": "[frame, frequency, tx, rx]",
    "frequencies_hz": "[frequency], hertz",
    "tx_m": "[tx, 3], metres",
    "rx_m": "[rx, 3], metres",
    "position_m": "[position, 3], metres",
}


def save_capture(path: str | Path, capture: RadarCapture) -> None:
    """Write a capture to the file `echoes.h5`, atomically. The file has version 1 of the format if
    that can store the capture, else version 2. Raises OSError if the disk is full."""
    import h5py

    data, about = _contents(capture)
    size = sum(values.nbytes for values in data.values())
    with atomic_path(path) as temporary:
        # check for space here: HDF5 notices a full disk late, and then prints tracebacks
        with temporary.open("wb") as stream:
            os.posix_fallocate(stream.fileno(), 0, size + HEADERS_BYTES)
        try:
            with h5py.File(temporary, "w") as file:
                file.attrs.update({"format": FORMAT, "version": 2 if about else 1, **about})
                for name, values in data.items():
                    file[name] = values
        except (
            RuntimeError
        ) as error:  # HDF5's error for a disk that is full when the file is closed
            raise OSError(
                "the HDF5 library could not close the file; check that the disk has free space"
            ) from error


def _contents(capture: RadarCapture) -> tuple[dict[str, np.ndarray], dict[str, Any]]:
    """Return what the file of a capture contains: (data sets by name, attributes by name). The
    attributes are those of version 2, or {} if version 1 can store the capture."""
    aperture, samples = capture.aperture, as_complex64(capture.samples)
    data = {name: places_m for name, places_m in vars(aperture).items() if name.endswith("_m")}
    if isinstance(aperture, BistaticScan):
        data["pairs"] = np.repeat(np.arange(len(aperture.tx_m))[:, None], 2, axis=1)
    elif isinstance(aperture, AntennaArray) and aperture.measured is not None:
        data["pairs"], samples = np.argwhere(aperture.measured), samples[:, :, aperture.measured]
    if capture.calibration is not None:
        data[CALIBRATION] = np.frombuffer(json.dumps(capture.calibration).encode(), np.uint8)
    data |= {"samples": samples, "frequencies_hz": capture.frequencies_hz}
    data |= {name: times_s for name in TIMES if (times_s := getattr(capture, name)) is not None}
    further = {
        name: getattr(capture, name)
        for name in ABOUT
        if getattr(capture, name) not in ("", SPEED_OF_LIGHT_M_S)
    }
    beyond_version_1 = further or {"pairs", CALIBRATION, *TIMES} & data.keys()
    return data, OURS | further if beyond_version_1 else {}


def load_capture(path: str | Path) -> RadarCapture:
    """Read the `RadarCapture` in a file `echoes.h5`. Raises HandbenchError for a file that is
    damaged, has another format, or has contents that do not fit together."""
    import h5py

    path = require_file(path, "an echoes.h5 file")
    try:
        with h5py.File(path, "r") as file:
            found = attribute(file, "format"), attribute(file, "version")
            version = next((v for v in (1, 2) if found == (FORMAT, v)), None)
            if version is None:
                raise HandbenchError(
                    f"has format {found}; expected ('{FORMAT}', 1 or 2), so set the file's "
                    "attributes 'format' and 'version'"
                )
            recording = _recording(file, path, version)
        return recording.capture()
    except HandbenchError as error:
        raise HandbenchError(f"{path}: {str(error).removeprefix(f'{path}: ')}") from None
    except (OSError, KeyError, ValueError, TypeError, AttributeError, RuntimeError) as error:
        raise HandbenchError(
            f"{path}: is not a readable echoes.h5 ({error}); record or copy the file again"
        ) from error


def _recording(file: "h5py.File", path: Path, version: int) -> Recording:
    there = set(file.keys())
    known = SCAN if "position_m" in there else ARRAY
    attributes: dict[str, Any] = dict(OURS)
    lacks = [f"data set '{n}' {NEEDED[n]}" for n in known if n in NEEDED and n not in there]
    if version == 1:
        _require_complete(file, lacks)
        there -= {"gains", "pairs", CALIBRATION}
    else:
        attributes = {name: attribute(file, name) for name in file.attrs}
        lacks += [
            f"attribute {name} = '{value}'"
            for name, value in OURS.items()
            if name not in attributes
        ]
        _require_complete(file, lacks)
        _check(sorted(there), known, attributes)
    values = {name: _numbers(file, name, path) for name in known if name in there}
    if attributes["time"] == "-jwt":
        values |= {name: values[name].conj() for name in ("samples", "gains") if name in values}
    side = [FRAMES[attributes["frame"]], 1, 1]
    places_m = {
        name: p * side if p.shape[1:] == (3,) else p
        for name, p in values.items()
        if name.endswith("_m")
    }
    about = {name: kind(attributes[name]) for name, kind in ABOUT.items() if name in attributes}
    about |= {name: values[name] for name in TIMES if name in values}
    if (content := values.get(CALIBRATION)) is not None:
        if content.dtype != np.uint8 or content.size > JSON_BYTES:
            raise ValueError(
                f"'{CALIBRATION}' has {content.dtype} values of shape {content.shape}; expected "
                "the bytes of an array calibration"
            )
        about["calibration"] = plain_json(content.tobytes().decode("utf-8"))
    samples, further = (
        values["samples"],
        (values.get("pairs"), values.get("gains"), attributes.get("sweeps", "mean"), about),
    )
    samples = samples[:, None] if "sweeps" not in attributes and samples.ndim else samples
    return Recording(samples, values["frequencies_hz"], places_m, *further)


def _require_complete(file: "h5py.File", lacks: list[str]) -> None:
    """Raise HandbenchError if `lacks`, the data sets and attributes that a file does not have, is
    not empty. The message names them all, and the shape of the file's samples."""
    if lacks:
        samples = local_item(file, "samples")
        shape = f" (samples have shape {samples.shape})" if hasattr(samples, "shape") else ""
        raise HandbenchError(f"has no {', '.join(lacks)}{shape}; add what is missing")


def _check(there: list[str], known: tuple[str, ...], attributes: dict[str, Any]) -> None:
    """Raise HandbenchError if a file of version 2 has unknown data sets or attributes, or
    attributes with values that are not allowed.

    there: names of the file's data sets; known: names that a file with its kind of aperture may
    have.
    """
    for names, those in (
        (there, known),
        (attributes, ("format", "version", *CONVENTIONS, *ABOUT, "sweeps")),
    ):
        for name in names:
            if name not in those:
                raise HandbenchError(
                    f"has an unknown item '{name[:80]}'; {suggest(name[:80], [*those])}"
                )
    for name, values in CONVENTIONS.items():
        if (found := attributes[name]) not in values:
            raise HandbenchError(
                f"{name} is '{str(found)[:80]}'; expected {' or '.join(map(repr, values))}"
            )
    for name, kind in ABOUT.items():
        if name in attributes and not isinstance(
            attributes[name], str if kind is str else float | int | np.number
        ):
            expected = "one text" if kind is str else "one number"
            raise HandbenchError(f"{name} is {attributes[name]!r:.80}; expected {expected}")


def _numbers(file: "h5py.File", name: str, path: Path) -> np.ndarray:
    """Read a data set of numbers from an open file; only samples and gains may be complex. Raises
    ValueError for other types, and for data that are stored outside this file."""
    values, kinds = read(file, name, path), "iufc" if name in ("samples", "gains") else "iuf"
    if values.dtype.kind not in kinds:
        raise ValueError(
            f"'{name}' has values of type {values.dtype}; expected "
            f"{'' if 'c' in kinds else 'real '}numbers"
        )
    return values
