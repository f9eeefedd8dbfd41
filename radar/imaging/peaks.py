"""The strongest voxels along z of a volume, from which projections compute their depths."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from handbench.support.compiled import FAST, njit


def _none() -> np.ndarray:
    return np.zeros(0)


@dataclass(frozen=True)
class Peaks:
    """The strongest voxel along z for each pixel of a volume.

    index [ny, nx]: index of this voxel along z. magnitude [3, ny, nx]: magnitudes of the voxel
    before it, of itself and of the voxel behind it (NaN beyond the volume). rival, second [ny, nx]:
    index and magnitude of the second strongest voxel (−1 if there is none). error: root mean square
    error of a voxel's magnitude that the tolerance of the image allows.
    """

    index: np.ndarray
    magnitude: np.ndarray
    rival: np.ndarray = field(default_factory=_none)
    second: np.ndarray = field(default_factory=_none)
    error: float = 0.0

    @classmethod
    def empty(cls, shape: tuple[int, ...], error: float = 0.0) -> Peaks:
        """Return peaks for pixels of `shape` [ny, nx] whose arrays are allocated but not yet
        filled."""
        magnitude, index = np.empty((3, *shape), np.float32), np.empty((2, *shape), np.int64)
        return cls(index[0], magnitude, index[1], np.empty(shape, np.float32), error)


def strongest_voxels(volume: np.ndarray) -> Peaks:
    """Find the strongest voxel along z for each pixel of an exactly imaged, complex volume [nz, ny,
    nx]: `Peaks` with error 0."""
    peaks = Peaks.empty(volume.shape[1:])
    for row in range(volume.shape[1]):
        here = slice(row, row + 1)
        re, im = (
            np.ascontiguousarray(part, np.float32)
            for part in (volume[:, here].real, volume[:, here].imag)
        )
        strongest(
            re,
            im,
            peaks.index[here],
            peaks.magnitude[:, here],
            peaks.rival[here],
            peaks.second[here],
        )
    return peaks


def root_mean_square(image: np.ndarray) -> float:
    """Compute the root mean square of the magnitudes of an image of any shape."""
    return float(np.sqrt(np.mean(np.abs(image) ** 2, dtype=np.float64)))


@njit(**FAST)
def strongest(re, im, index, magnitude, rival, second):  # type: ignore[no-untyped-def]
    """Find the strongest and the second strongest voxel along z for each pixel of a volume with
    real and imaginary parts re, im [nz, ny, nx], float32.

    The results are written to the other arguments: index, rival [ny, nx] (indices along z),
    magnitude [3, ny, nx] (of the voxel before, at and behind the strongest) and second [ny, nx]
    (magnitude of the second strongest).
    """
    nz, ny, nx = re.shape
    best, next_best = np.empty(nx, np.float32), np.empty(nx, np.float32)
    where, beside = np.empty(nx, np.int32), np.empty(nx, np.int32)
    for j in range(ny):
        best[:], next_best[:] = -1, -1
        where[:], beside[:] = 0, -1
        for k in range(nz):
            for i in range(nx):
                power = re[k, j, i] * re[k, j, i] + im[k, j, i] * im[k, j, i]
                first, larger = power > best[i], power > next_best[i]
                beside[i] = where[i] if first else (np.int32(k) if larger else beside[i])
                next_best[i] = best[i] if first else (power if larger else next_best[i])
                where[i] = np.int32(k) if first else where[i]
                best[i] = power if first else best[i]
        for i in range(nx):
            index[j, i], rival[j, i] = where[i], beside[i]
            magnitude[1, j, i] = np.sqrt(best[i])
            second[j, i] = np.sqrt(next_best[i]) if next_best[i] >= 0 else np.float32(-1)
            for side in (0, 2):
                k = where[i] + side - 1
                if 0 <= k < nz:
                    magnitude[side, j, i] = np.sqrt(
                        re[k, j, i] * re[k, j, i] + im[k, j, i] * im[k, j, i]
                    )
                else:
                    magnitude[side, j, i] = np.nan
