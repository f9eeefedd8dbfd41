"""The samples in the files of TI's DCA1000 board (adc_data.bin) and of its cascade of four radars
(master_0000_data.bin, slave1_0000_data.bin, …).

Sources: TI SWRA581B, "Mmwave radar device ADC raw data capture" (lanes, order of I and Q);
read_ADC_bin_TDA2_separateFiles.m in TI's mmWave Studio (cascade).
"""

import re
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from handbench.bench.datasets.ti_profile import WHAT, ChirpProfile, read_profile
from handbench.support.cost import require_free
from handbench.support.errors import HandbenchError
from handbench.support.files import read_bytes, require_file
from handbench.support.limits import KEPT_BYTES

RADARS = ("master", "slave1", "slave2", "slave3")  # of a cascade, with four receivers each


def read_raw(source: Path, settings: Mapping[str, Any]) -> tuple[ChirpProfile, np.ndarray]:
    """Read the chirp profile and the samples [frame, loop, chirp of the loop, receiver, sample] of
    a raw capture's folder. settings: fields of the profile that replace the file's. Raises
    HandbenchError if the files do not agree with the profile."""
    profile = read_profile(source, settings)
    return profile, decode(read_numbers(source, profile), profile, str(source))


def decode(numbers: np.ndarray, profile: ChirpProfile, where: str) -> np.ndarray:
    """Arrange the numbers that were recorded, int16 [n], as samples [frame, loop, chirp of the
    loop, receiver, sample].

    The result is complex64, or float32 if the profile's samples are real. Raises HandbenchError
    unless the numbers fill whole frames; where: beginning of its message.
    """
    n, stored, parts = profile.samples, _stored(profile), 1 if profile.real else 2
    frame = profile.loops * len(profile.transmitters) * stored * n * parts
    if not len(numbers) or len(numbers) % frame or stored * n % 2:
        raise HandbenchError(
            f"{where}: has {2 * len(numbers)} bytes, which is not a whole number of frames of "
            f"{2 * frame} bytes ({frame // (stored * n * parts)} chirps × {stored} receivers × {n} "
            f"samples × {2 * parts} bytes, with an even number of samples); check that the profile "
            "belongs to this recording"
        )
    values = _unpack(numbers, profile)
    shape = (-1, profile.loops, len(profile.transmitters))
    if profile.lanes == 2:
        return values.reshape(*shape, stored, n)
    return values.reshape(*shape, n, profile.lanes).swapaxes(-1, -2)[
        ..., np.array(profile.receivers) - 1, :
    ]


def _stored(profile: ChirpProfile) -> int:
    """Count the receivers whose samples are stored; an unused one of four lanes has zeros."""
    return profile.lanes if profile.lanes > 2 else len(profile.receivers)


def _unpack(numbers: np.ndarray, profile: ChirpProfile) -> np.ndarray:
    """Undo the lanes of the numbers, int16 [n]: samples in the order of time, complex64 or float32
    of a real profile, [sample, receiver] of four lanes and of a cascade, [sample, 1] of two lanes,
    which hold one receiver's chirp after the other's."""
    # 4 lanes: I of all receivers at one time, then their Q; 2 lanes: I of two times, then their Q;
    # cascade: I and Q of one receiver after the other
    parts, lanes = 1 if profile.real else 2, profile.lanes
    sets = numbers.reshape(-1, lanes, parts) if lanes == 16 else numbers.reshape(-1, parts, lanes)
    by_part = np.moveaxis(sets, 2 if lanes == 16 else 1, 0).astype(np.float32)
    values = by_part[0]
    if not profile.real:
        values = np.empty(values.shape, np.complex64)
        values.real, values.imag = by_part[:: 1 if profile.order == "IQ" else -1]
    return values.reshape(-1, 1 if lanes == 2 else lanes)


def read_numbers(source: Path, profile: ChirpProfile) -> np.ndarray:
    """Read the .bin files in a folder, int16 [n]: one after the other, or those of a cascade's four
    radars side by side, so that each time has the numbers of all sixteen receivers."""
    paths = _in_order(source.glob("*.bin"))
    if not (size := sum(require_file(path, WHAT).stat().st_size for path in paths)):
        raise HandbenchError(f"{source}: has no .bin file with samples; expected {WHAT}")
    require_free(20.0 * size, f"{source}: {size} bytes of samples", "import fewer files")
    if profile.lanes != 16:
        return _read(paths)
    radars = [_read(_in_order(source.glob(f"{radar}_*_data.bin"))) for radar in RADARS]
    sizes = [len(numbers) for numbers in radars]
    if len(set(sizes)) > 1 or sizes[0] % 8:
        raise HandbenchError(
            f"{source}: {', '.join(RADARS)} have {', '.join(map(str, sizes))} numbers; expected as "
            "many in the NAME_0000_data.bin of each, 8 at a time: copy them again"
        )
    return np.stack([numbers.reshape(-1, 8) for numbers in radars], axis=1).reshape(-1)


def _read(paths: Sequence[Path]) -> np.ndarray:
    """Read files, one after the other: int16 [n]."""
    content = b"".join(read_bytes(path, "samples of a radar", KEPT_BYTES) for path in paths)
    return np.frombuffer(content[: len(content) // 2 * 2], "<i2")


def _in_order(paths: Iterable[Path]) -> list[Path]:
    """Sort files by the numbers in their names."""
    parts = {path: re.findall(r"(\D*)(\d*)", path.name) for path in paths}
    return sorted(parts, key=lambda path: [(int(n or 0), text) for text, n in parts[path]])
