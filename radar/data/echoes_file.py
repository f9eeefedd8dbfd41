"""The file `echoes.h5`: version 1 holds an array or a planar scan in air, version 2 any capture, and says what its
numbers are (docs/files.md)."""

import os
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from radar.data.arrays import SPEED_OF_LIGHT_M_S, AntennaArray, Aperture, BistaticScan, PlanarScan
from radar.data.capture import RadarCapture, single
from radar.data.recording import SWEEPS, Recording
from radar.support.config import suggest
from radar.support.errors import HandbenchError
from radar.support.files import atomic_path, require_file
from radar.support.hdf5 import attribute, opened, read
from radar.support.limits import JSON_BYTES

if TYPE_CHECKING:
    import h5py

FORMAT = "handbench-echoes"
HEADERS_BYTES = 2**13  # of the file, at least
FRAMES = {"x left, y up, z away": 1, "x right, y up, z away": -1}  # seen from the array looking at the target: of our x
TIMES = ("+jwt", "-jwt")  # e^{±jωt}: an echo is exp(∓j2πf·path/v)
TOLD = {"units": ("m, Hz, m/s",), "frame": tuple(FRAMES), "time": TIMES}  # by every file of version 2
MAY_BE_TOLD = ("sweeps", "wave_speed_m_s", "source", "licence")
CALIBRATION = "array.json"  # a data set with the bytes of such a file
DATA = ("samples", "frequencies_hz", "tx_m", "rx_m", "position_m", "pairs", "gains", CALIBRATION)


def save_capture(path: str | Path, capture: RadarCapture) -> None:
    """Write `echoes.h5`, atomically: as version 1 where that can hold the capture."""
    import h5py

    data, about = _contents(capture)
    size = sum(values.nbytes for values in data.values())
    with atomic_path(path) as temporary:
        with temporary.open("wb") as stream:  # is there room? HDF5 finds out late, and then prints tracebacks
            os.posix_fallocate(stream.fileno(), 0, size + HEADERS_BYTES)
        try:
            with h5py.File(temporary, "w") as file:
                file.attrs.update({"format": FORMAT, "version": 2 if about else 1, **about})
                for name, values in data.items():
                    file[name] = values
        except RuntimeError as error:  # what the library calls a disk that is full by the time the file is closed
            raise OSError("the library could not close the file; is there space left on the disk?") from error


def _contents(capture: RadarCapture) -> tuple[dict[str, np.ndarray], dict[str, Any]]:
    """Data sets, and the attributes that version 2 has; none of these where version 1 can hold the capture."""
    aperture, samples = capture.aperture, single(capture.samples)
    data = {name: places_m for name, places_m in vars(aperture).items() if name.endswith("_m")}
    if isinstance(aperture, BistaticScan):
        data["pairs"] = np.repeat(np.arange(len(aperture.tx_m))[:, None], 2, axis=1)
    elif isinstance(aperture, AntennaArray) and aperture.measured is not None:
        data["pairs"], samples = np.argwhere(aperture.measured), samples[:, :, aperture.measured]
    if capture.calibration:
        data[CALIBRATION] = np.frombuffer(capture.calibration.encode(), np.uint8)
    data |= {"samples": samples, "frequencies_hz": capture.frequencies_hz}
    further = {name: getattr(capture, name) for name in ("source", "licence") if getattr(capture, name)}
    if not further and capture.wave_speed_m_s == SPEED_OF_LIGHT_M_S and not {"pairs", CALIBRATION} & data.keys():
        return data, {}
    ours = {name: values[0] for name, values in TOLD.items()}
    return data, ours | {"wave_speed_m_s": capture.wave_speed_m_s} | further


def load_capture(path: str | Path) -> RadarCapture:
    """Read `echoes.h5`; a broken, foreign or inconsistent file is a HandbenchError."""
    path = require_file(path, "an echoes.h5 file")
    try:
        with opened(path) as file:
            found = attribute(file, "format"), attribute(file, "version")
            version = next((v for v in (1, 2) if np.array_equal(found, (FORMAT, v))), None)
            if version is None:
                raise HandbenchError(f"{path}: has format {found}; expected ('{FORMAT}', 1 or 2)")
            recorded = (_version_1 if version == 1 else _version_2)(file, path)
    except HandbenchError:
        raise
    except (OSError, KeyError, ValueError, TypeError, AttributeError, RuntimeError) as error:
        raise HandbenchError(f"{path}: is not a readable echoes.h5 ({error}); record or copy it again") from error
    try:
        return recorded.capture() if isinstance(recorded, Recording) else RadarCapture(*recorded)
    except HandbenchError as error:
        raise HandbenchError(f"{path}: {error}") from None


def _version_1(file: "h5py.File", path: Path) -> tuple[np.ndarray, np.ndarray, Aperture]:
    samples, frequencies_hz = _numbers(file, "samples", path, "iufc"), _numbers(file, "frequencies_hz", path)
    if file.get("position_m", getlink=True) is not None:
        aperture: Aperture = PlanarScan(_numbers(file, "position_m", path))
    else:
        aperture = AntennaArray(_numbers(file, "tx_m", path), _numbers(file, "rx_m", path))
    return single(samples), frequencies_hz.astype(np.float64), aperture


def _version_2(file: "h5py.File", path: Path) -> Recording:
    there = sorted(file.keys())
    told = {name: _plain(attribute(file, name)) for name in (*TOLD, *MAY_BE_TOLD) if name in file.attrs}
    _check(path, there, told, sorted(file.attrs.keys()))
    values = {name: _numbers(file, name, path, "iufc" if name in ("samples", "gains") else "iuf") for name in there}
    places_m = {name: values[name] for name in ("tx_m", "rx_m", "position_m") if name in there}
    samples, gains = values["samples"], values.get("gains")
    if "sweeps" not in told:
        samples = samples[:, None] if samples.ndim else samples
    if told["time"] == "-jwt":
        samples, gains = samples.conj(), None if gains is None else gains.conj()
    side = np.array([FRAMES[told["frame"]], 1, 1])
    places_m = {name: p * side if p.shape[1:] == (3,) else p for name, p in places_m.items()}
    kinds = {"wave_speed_m_s": float, "source": str, "licence": str}
    about: dict[str, Any] = {name: kind(told[name]) for name, kind in kinds.items() if name in told}
    if CALIBRATION in values:
        if (content := values[CALIBRATION]).dtype != np.uint8 or content.size > JSON_BYTES:
            raise ValueError(f"'{CALIBRATION}' holds {content.dtype} of shape {content.shape}, not a file's bytes")
        about["calibration"] = content.tobytes().decode("utf-8")
    sweeps = told.get("sweeps", SWEEPS[0])
    return Recording(samples, values["frequencies_hz"], places_m, values.get("pairs"), gains, sweeps, about)


def _check(path: Path, there: list[str], told: dict[str, Any], attributes: list[str]) -> None:
    """HandbenchError that names all that is missing, and all that is not known: nothing is passed over."""
    places = ["position_m"] if "position_m" in there else ["tx_m", "rx_m"]
    missing = [f"data set '{name}'" for name in ("samples", "frequencies_hz", *places) if name not in there]
    missing += [f'attribute {name} = "{values[0]}"' for name, values in TOLD.items() if name not in told]
    if missing:
        raise HandbenchError(f"{path}: version 2 lacks {', '.join(missing)}; add them")
    names = [(name, DATA) for name in there] + [(name, (*TOLD, *MAY_BE_TOLD)) for name in attributes]
    unknown = [(name, known) for name, known in names if name not in (*known, "format", "version")]
    if unknown:
        more = f" (and {len(unknown) - 1} more)" if len(unknown) > 1 else ""
        raise HandbenchError(
            f"{path}: unknown '{unknown[0][0][:80]}'; {suggest(unknown[0][0][:80], [*unknown[0][1]])}{more}"
        )
    if places == ["position_m"] and {"tx_m", "rx_m", "pairs"} & set(there):
        raise HandbenchError(f"{path}: holds position_m of a moved transceiver, and tx_m, rx_m or pairs; expected one")
    for name, values in TOLD.items():
        if told[name] not in values:
            expected = " or ".join(f"'{value}'" for value in values)
            raise HandbenchError(f"{path}: {name} is '{str(told[name])[:80]}'; expected {expected}")


def _plain(told: Any) -> Any:
    """A text or number, as h5py or MATLAB writes it."""
    return told.decode("utf-8") if isinstance(told, bytes) else told.item() if isinstance(told, np.generic) else told


def _numbers(file: "h5py.File", name: str, path: Path, kinds: str = "iuf") -> np.ndarray:
    """A data set of numbers that lie in this very file; kinds: numpy's, of real numbers by default."""
    values = read(file, name, path)
    if values.dtype.kind not in kinds:
        raise ValueError(f"'{name}' holds {values.dtype}, no {'' if 'c' in kinds else 'real '}numbers")
    return values
