"""Reader and writer of the file `echoes.h5`, which contains a capture (docs/files.md).

Version 1 of the format stores an array or a planar scan in air; version 2, which is written, stores
any capture and names its units, frame and time convention.
"""

import json
from io import BytesIO
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import Field

from handbench.radar.data.arrays import SPEED_OF_LIGHT_M_S, AntennaPairs, positions
from handbench.radar.data.capture import RadarCapture, as_complex64, to_capture
from handbench.radar.data.hdf5 import attribute, read
from handbench.support.config import Config, parse
from handbench.support.errors import HandbenchError
from handbench.support.files import JSON_BYTES, atomic_path, plain_json, require_file

CONVENTIONS = {"units": "m, Hz, m/s", "frame": "x left, y up, z away", "time": "+jwt"}
ABOUT = ("wave_speed_m_s", "source", "licence")
TIMES = ("times_s", "frame_times_s")
CALIBRATION = "array.json"  # name of the data set that holds the bytes of such a file
VERSION_1 = ("format", "version", "samples", "frequencies_hz", "tx_m", "rx_m", "position_m", *TIMES)


class EchoesFile(Config):
    """The content of `echoes.h5`: its attributes, then its data sets.

    frame: x seen from the array looking at the target. time: e^{±jωt}, for which an echo is
    exp(∓j2πf·path/v). The data sets are those of `to_capture`; array_json: bytes of a file of that
    name.
    """

    format: Literal["handbench-echoes"]
    version: int = Field(ge=1, le=2)
    units: Literal["m, Hz, m/s"]
    frame: Literal["x left, y up, z away", "x right, y up, z away"]
    time: Literal["+jwt", "-jwt"]
    sweeps: Literal["mean", "frames"] | None = None
    wave_speed_m_s: float = SPEED_OF_LIGHT_M_S
    source: str = ""
    licence: str = ""
    samples: Any
    frequencies_hz: Any
    tx_m: Any = None
    rx_m: Any = None
    position_m: Any = None
    pairs: Any = None
    gains: Any = None
    times_s: Any = None
    frame_times_s: Any = None
    array_json: Annotated[Any, Field(alias=CALIBRATION)] = None


def save_capture(path: str | Path, capture: RadarCapture) -> None:
    """Write a capture to the file `echoes.h5`, atomically. Raises HandbenchError if the disk is
    full."""
    import h5py

    about = {name: getattr(capture, name) for name in ABOUT if getattr(capture, name)}
    about |= {"format": "handbench-echoes", "version": 2, **CONVENTIONS}
    content = BytesIO()  # on a full disk HDF5 would print tracebacks
    # of this version on, HDF5 has checksums of its own structures
    with h5py.File(content, "w", libver="v110") as file:
        for name, value in about.items():
            # texts of any length would stand in a heap that has no checksum
            file.attrs[name] = np.bytes_(value.encode()) if isinstance(value, str) else value
        for name, values in _data_sets(capture).items():
            file.create_dataset(name, data=values, fletcher32=True)  # another checksum
    with atomic_path(path) as temporary:
        temporary.write_bytes(content.getbuffer())


def _data_sets(capture: RadarCapture) -> dict[str, np.ndarray]:
    """Return the data sets, by name, that the file of a capture contains."""
    aperture, samples = capture.aperture, as_complex64(capture.samples)
    data = {"tx_m": aperture.tx_m, "rx_m": aperture.rx_m}
    if isinstance(aperture, AntennaPairs):
        data["pairs"] = np.repeat(np.arange(len(aperture.tx_m))[:, None], 2, axis=1)
        data = {"position_m": aperture.tx_m} if aperture.monostatic else data
    elif aperture.measured is not None:
        data["pairs"], samples = np.argwhere(aperture.measured), samples[:, :, aperture.measured]
    if capture.calibration is not None:
        data[CALIBRATION] = np.frombuffer(json.dumps(capture.calibration).encode(), np.uint8)
    times_s = {name: values for name in TIMES if (values := getattr(capture, name)) is not None}
    return data | times_s | {"samples": samples, "frequencies_hz": capture.frequencies_hz}


def load_capture(path: str | Path) -> RadarCapture:
    """Read the `RadarCapture` in a file `echoes.h5`. Raises HandbenchError for a file that is
    damaged, has another format, or has contents that do not fit together."""
    import h5py

    path = require_file(path, "an echoes.h5 file")
    data_sets = {*EchoesFile.model_fields, CALIBRATION}
    try:
        with h5py.File(path, "r") as file:
            values = {name: attribute(file, name) for name in file.attrs}
            # those that are unknown are not read, but named
            values |= {name: read(file, name, path) if name in data_sets else None for name in file}
        if values.get("version") == 1:
            values = CONVENTIONS | {name: values[name] for name in VERSION_1 if name in values}
        return _capture(parse(EchoesFile, values, str(path)))
    except HandbenchError as error:
        raise HandbenchError(f"{path}: {str(error).removeprefix(f'{path}: ')}") from None
    except (OSError, KeyError, ValueError, TypeError, AttributeError, RuntimeError) as error:
        raise HandbenchError(
            f"{path}: is not a readable echoes.h5 ({error}); record or copy the file again"
        ) from error


def _capture(content: EchoesFile) -> RadarCapture:
    """Convert the content of a file to our frame and time convention."""
    samples, gains = content.samples, content.gains
    if content.time == "-jwt":
        samples, gains = samples.conj(), None if gains is None else gains.conj()
    scan, array = {"position_m"}, {"tx_m", "rx_m"}
    given = {name for name in scan | array | {"pairs"} if getattr(content, name) is not None}
    if given not in (scan, array, array | {"pairs"}):
        raise HandbenchError(
            f"has {', '.join(sorted(given)) or 'no positions'}; expected the data sets tx_m "
            "[tx, 3] and rx_m [rx, 3], perhaps with pairs, or position_m [position, 3] of a scan"
        )
    side = 1 if content.frame == CONVENTIONS["frame"] else -1
    places_m: dict[str, np.ndarray] = {
        name: positions(name, getattr(content, name)) * [side, 1, 1]
        for name in ("tx_m", "rx_m", "position_m")
        if name in given
    }
    calibration = content.array_json
    if calibration is not None:
        if calibration.nbytes > JSON_BYTES:
            raise ValueError(f"'{CALIBRATION}' has more than {JSON_BYTES} bytes")
        calibration = plain_json(calibration.tobytes().decode("utf-8"))
    fields = {name: getattr(content, name) for name in (*ABOUT, *TIMES)}
    return to_capture(
        samples,
        content.frequencies_hz,
        places_m,
        content.pairs,
        gains,
        content.sweeps,
        calibration=calibration,
        **fields,
    )
