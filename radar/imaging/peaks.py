"""The strongest voxels along z of a volume, from which projections compute their depths."""

from typing import Any

import numpy as np

from handbench.radar.imaging.device import Array
from handbench.support.compiled import FAST, njit


def strongest_voxels(volume: Array, xp: Any = np) -> tuple[Array, Array]:
    """Find the strongest voxel along z for each pixel of a complex volume O [nz, ny, nx], argmax_z
    |O|, with the array module xp (numpy or cupy): (its index along z [ny, nx], magnitudes |O| of
    the voxel before it, of itself and of the voxel behind it [3, ny, nx], NaN beyond the volume).
    """
    power = volume.real**2 + volume.imag**2
    index, last = power.argmax(axis=0), len(power) - 1
    around = xp.stack([index - 1, index, index + 1])
    magnitude = xp.sqrt(xp.take_along_axis(power, xp.clip(around, 0, last), axis=0))
    magnitude[(around < 0) | (around > last)] = np.nan
    return index, magnitude


@njit(**FAST)
def strongest(re, im):  # type: ignore[no-untyped-def]
    """Do what `strongest_voxels` does, for a volume with real and imaginary parts re, im [nz, ny,
    nx], float32."""
    nz, ny, nx = re.shape
    index, magnitude = np.empty((ny, nx), np.int64), np.empty((3, ny, nx), np.float32)
    best, where = np.empty(nx, np.float32), np.empty(nx, np.int32)
    for j in range(ny):
        best[:] = -1
        where[:] = 0
        for k in range(nz):
            for i in range(nx):
                power = re[k, j, i] * re[k, j, i] + im[k, j, i] * im[k, j, i]
                first = power > best[i]
                where[i] = np.int32(k) if first else where[i]
                best[i] = power if first else best[i]
        for i in range(nx):
            index[j, i] = where[i]
            magnitude[1, j, i] = np.sqrt(best[i])
            for side in (0, 2):
                k = where[i] + side - 1
                if 0 <= k < nz:
                    magnitude[side, j, i] = np.sqrt(
                        re[k, j, i] * re[k, j, i] + im[k, j, i] * im[k, j, i]
                    )
                else:
                    magnitude[side, j, i] = np.nan
    return index, magnitude
