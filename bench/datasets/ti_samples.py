"""The samples in the files of TI's DCA1000 board (adc_data.bin).

Source: TI SWRA581B, "Mmwave radar device ADC raw data capture" (lanes, order of I and Q).
"""

import re
from pathlib import Path

import numpy as np

from handbench.bench.datasets.ti_profile import WHAT, ChirpProfile
from handbench.support.cost import require_free
from handbench.support.errors import HandbenchError
from handbench.support.files import read_bytes
from handbench.support.limits import KEPT_BYTES


def decode(numbers: np.ndarray, profile: ChirpProfile, where: str) -> np.ndarray:
    """Arrange a DCA1000's numbers, int16 [n], as the radar's samples [frame, loop, chirp of the
    loop, receiver, sample], complex64, or float32 of a real profile. where: begins the message of
    the HandbenchError for numbers that are no whole frames."""
    n, frame = profile.samples, frame_numbers(profile)
    stored, parts = _stored(profile), 1 if profile.real else 2
    if not len(numbers) or len(numbers) % frame or stored * n % 2:
        raise HandbenchError(
            f"{where}: has {2 * len(numbers)} bytes; expected whole frames of {2 * frame}: "
            f"{frame // (stored * n * parts)} chirps × {stored} receivers × {n} samples, in all "
            f"even, × {2 * parts} bytes; is it the right profile?"
        )
    values = unpack(numbers, profile)
    shape = (-1, profile.loops, len(profile.transmitters))
    if profile.lanes == 2:
        return values.reshape(*shape, stored, n)
    return values.reshape(*shape, n, 4).swapaxes(-1, -2)[..., np.array(profile.receivers) - 1, :]


def frame_numbers(profile: ChirpProfile) -> int:
    """Count the numbers of a frame."""
    chirps = profile.loops * len(profile.transmitters)
    return chirps * _stored(profile) * profile.samples * (1 if profile.real else 2)


def _stored(profile: ChirpProfile) -> int:
    """Count the receivers whose samples are stored; an unused one of four lanes has zeros."""
    return 4 if profile.lanes == 4 else len(profile.receivers)


def unpack(numbers: np.ndarray, profile: ChirpProfile) -> np.ndarray:
    """Undo the lanes of a DCA1000's numbers, int16 [n]: samples in the order of time, complex64 or
    float32 of a real profile, [sample, 4 receivers] of four lanes, [sample, 1] of two, which hold
    one receiver's chirp after the other's."""
    # 4 lanes: I of all receivers at one time, then their Q; 2 lanes: I of two times, then their Q
    sets = numbers.reshape(-1, 1 if profile.real else 2, profile.lanes).astype(np.float32)
    values = sets[:, 0]
    if not profile.real:
        values = np.empty(values.shape, np.complex64)
        values.real, values.imag = np.moveaxis(sets, 1, 0)[:: 1 if profile.order == "IQ" else -1]
    return values.reshape(-1, 1 if profile.lanes == 2 else 4)


def read_numbers(source: Path) -> np.ndarray:
    """Read all .bin files in a folder, one after the other: int16 [n]."""
    parts = {path: re.findall(r"(\D*)(\d*)", path.name) for path in source.glob("*.bin")}
    paths = sorted(parts, key=lambda path: [(int(n or 0), text) for text, n in parts[path]])
    if not (size := sum(path.stat().st_size for path in paths)):
        raise HandbenchError(f"{source}: has no samples in .bin files; expected {WHAT}")
    require_free(20.0 * size, f"{source}: {size} bytes of samples", "import fewer files")
    content = b"".join(read_bytes(path, "samples of a DCA1000", KEPT_BYTES) for path in paths)
    return np.frombuffer(content[: len(content) // 2 * 2], "<i2")
