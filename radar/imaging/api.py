"""Imaging: samples → complex images at points, on pixel planes and in volumes, exact or to a tolerance.

With a tolerance, images come from the tree of skeletons (`radar.imaging.tree`) and, on grids, from band-limited
upsampling (`radar.imaging.cpu.volume`); the relative L2 error stays below it on any samples, white noise included. With
None every tone and antenna is summed (`radar.imaging.cpu.exact`). Plans are kept per geometry and grid. On a device
other than the processor (`radar.imaging.device`) the same plans run as array code.
"""

from __future__ import annotations

import hashlib
from collections import OrderedDict
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from threading import Lock
from typing import Any

import numpy as np

from radar.data.arrays import Aperture, positions
from radar.data.grid import VoxelGrid
from radar.imaging.cpu.engine import Engine
from radar.imaging.cpu.exact import backproject, check_samples, tone_images
from radar.imaging.cpu.volume import VolumePlan, strongest_voxels
from radar.imaging.device import chosen
from radar.imaging.gpu import exact as gpu_exact
from radar.imaging.gpu.engine import DeviceEngine
from radar.imaging.gpu.volume import DeviceVolumePlan
from radar.imaging.stopwatch import imaging
from radar.imaging.tree import Box, Family, clusters, crowded
from radar.support.errors import HandbenchError
from radar.support.memory import require_memory
from radar.support.parallel import one_blas_thread
from radar.support.progress import track

TOLERANCES = (1e-6, 0.1)  # float32 ends before the one, the bounds' derivation before the other
PLANS = 24  # kept; the oldest goes first
CHUNK = 1 << 18  # voxels that the exact path images at once

_plans: OrderedDict[bytes, Any] = OrderedDict()
_lock = Lock()


@contextmanager
def fresh_plans() -> Iterator[None]:
    """Begin without a plan, as a new process does, and drop those made in the block when it ends."""
    global _plans
    before, _plans = _plans, OrderedDict()
    try:
        yield
    finally:
        _plans = before


@imaging
def image_points(
    samples: np.ndarray,
    frequencies_hz: np.ndarray,
    aperture: Aperture,
    points_m: np.ndarray,
    tolerance: float | None,
    apart: bool = False,
) -> np.ndarray:
    """Images at points_m [..., 3]: complex64 [...], or [f, ...] with the tones apart.

    samples: [f, t, r] of an AntennaArray, [f, n] of a PlanarScan; tolerance: largest relative L2 error, None for exact.
    """
    check(samples, frequencies_hz, aperture, tolerance)
    points = np.asarray(points_m, np.float64).reshape(-1, 3)
    shape = (len(samples), *points_m.shape[:-1]) if apart else points_m.shape[:-1]
    if len(points) == 0:
        return np.zeros(shape, np.complex64)
    points = positions("points_m", points)
    if tolerance is None or crowded(aperture):
        return _exact(apart)(samples, frequencies_hz, aperture, points).reshape(shape)
    kind = Engine if chosen() == "cpu" else DeviceEngine
    images = np.empty((len(samples) if apart else 1, len(points)), np.complex64)
    for near in clusters(points, frequencies_hz):
        engine = points_engine(frequencies_hz, aperture, points[near], Family(tolerance, apart), kind)
        images[:, near] = engine.image(samples, engine.sort(points[near]))
    return images.reshape(shape)


@imaging
def image_volume(
    samples: np.ndarray,
    frequencies_hz: np.ndarray,
    aperture: Aperture,
    grid: VoxelGrid,
    tolerance: float | None,
    apart: bool = False,
    carrier: bool = True,
) -> np.ndarray:
    """Images of all voxels: complex64 [nz, ny, nx], or [f, nz, ny, nx] with the tones apart; one plane where nz = 1.

    carrier=False allows a phase to be left out that all tones share: enough for magnitudes and for phases between
    tones, and faster. Refuses a volume that does not fit the memory limit (see `radar.support.memory`).
    """
    check(samples, frequencies_hz, aperture, tolerance)
    images = len(samples) if apart else 1
    require_memory(8 * images * int(np.prod(grid.shape)), f"volume of {images} × {grid.shape} voxels [nz, ny, nx]")
    shape = (images, *grid.shape) if apart else grid.shape
    if tolerance is None:
        return _exact_volume(samples, frequencies_hz, aperture, grid, apart).reshape(shape)
    plan = _volume_plan(frequencies_hz, aperture, grid, Family(tolerance, apart))
    return plan.volumes(samples, grid.z_m, carrier).reshape(shape)


@imaging
def project_volume(
    samples: np.ndarray, frequencies_hz: np.ndarray, aperture: Aperture, grid: VoxelGrid, tolerance: float | None
) -> tuple[np.ndarray, np.ndarray]:
    """`strongest_voxels` of the volume, which a finite tolerance never holds: index along z [ny, nx], and magnitude
    [3, ny, nx] of the voxel before it, itself and the one behind it (NaN beyond the volume)."""
    check(samples, frequencies_hz, aperture, tolerance)
    if tolerance is None:
        return strongest_voxels(image_volume(samples, frequencies_hz, aperture, grid, None))
    return _volume_plan(frequencies_hz, aperture, grid, Family(tolerance, False)).peaks(samples, grid.z_m)


def points_engine(
    frequencies_hz: np.ndarray, aperture: Aperture, points_m: np.ndarray, family: Family, kind: type = Engine
) -> Any:
    """The engine, or another `kind` that is made alike, that images or simulates points_m [n, 3] and others nearby."""
    box = _roomy(points_m.min(axis=0), points_m.max(axis=0))
    return _plan(
        (kind.__name__, *box), frequencies_hz, aperture, family, lambda: kind(frequencies_hz, aperture, box, family)
    )


def imaging_error(
    image: np.ndarray,
    samples: np.ndarray,
    frequencies_hz: np.ndarray,
    aperture: Aperture,
    grid: VoxelGrid,
    count: int = 500,
    seed: int = 0,
) -> float:
    """A-posteriori check: relative L2 error of a volume [nz, ny, nx] at `count` random voxels against the exact sum,
    relative to the whole volume's own size there."""
    picked = np.random.default_rng(seed).integers(0, image.size, count)
    z, y, x = np.unravel_index(picked, grid.shape)
    points = np.stack([grid.x_m[x], grid.y_m[y], grid.z_m[z]], axis=1)
    exact = backproject(samples, frequencies_hz, aperture, points)
    mean_square = np.mean(np.abs(image) ** 2, dtype=np.float64)
    return float(np.sqrt(np.mean(np.abs(image.ravel()[picked] - exact) ** 2) / mean_square))


def check(samples: np.ndarray, frequencies_hz: np.ndarray, aperture: Aperture, tolerance: float | None) -> None:
    """Refuse samples of the wrong shape and tolerances that cannot be met."""
    check_samples(samples, frequencies_hz, aperture)
    if tolerance is not None and not TOLERANCES[0] <= tolerance <= TOLERANCES[1]:
        raise HandbenchError(
            f"tolerance: is {tolerance}; expected {TOLERANCES[0]:g} to {TOLERANCES[1]:g}, or the exact sum (--exact)"
        )


def _volume_plan(frequencies_hz: np.ndarray, aperture: Aperture, grid: VoxelGrid, family: Family) -> Any:
    kind = VolumePlan if chosen() == "cpu" else DeviceVolumePlan
    low, high = (np.array([a[i] for a in (grid.x_m, grid.y_m, grid.z_m)]) for i in (0, -1))
    depth = grid.z_m
    if len(depth) == 1:  # planes come at any depth: one plan serves all that are near
        box = _roomy(low, high)
        depth = np.array([box.low_m[2], box.high_m[2]])
    key = ("volume", len(grid.z_m) == 1, grid.x_m, grid.y_m, depth)
    return _plan(
        key,
        frequencies_hz,
        aperture,
        family,
        lambda: kind(frequencies_hz, aperture, VoxelGrid(grid.x_m, grid.y_m, depth), family, len(grid.z_m) == 1),
    )


def _plan(what: tuple, frequencies_hz: np.ndarray, aperture: Aperture, family: Family, build: Callable[[], Any]) -> Any:
    """The plan of this geometry on the chosen device, built once."""
    digest = hashlib.blake2b(repr((chosen(), type(aperture).__name__, tuple(family))).encode())
    positions = [leg.position_m for leg in aperture.legs]
    for part in [*what, frequencies_hz, *positions]:
        digest.update(_bytes(part))
    key = digest.digest()
    with _lock:
        if key not in _plans:
            with one_blas_thread():  # rounding, and with it the plan, must not depend on the number of threads
                _plans[key] = build()
            if len(_plans) > PLANS:
                _plans.popitem(last=False)
        _plans.move_to_end(key)
        return _plans[key]


def _bytes(part: Any) -> bytes:
    return part.tobytes() + repr(part.shape).encode() if isinstance(part, np.ndarray) else repr(part).encode()


def _roomy(low_m: np.ndarray, high_m: np.ndarray) -> Box:
    """The box from low_m to high_m, widened to a lattice of about its size, so that the points of one frame and the
    next share a plan; what they do not touch is never planned."""
    extent = high_m - low_m
    cell = 2.0 ** np.ceil(np.log2(np.maximum(np.maximum(extent, extent.max() / 16), 1e-4) / 2))
    return Box(np.floor(low_m / cell) * cell, np.ceil(high_m / cell) * cell)


def _exact(apart: bool) -> Callable[..., np.ndarray]:
    """The exact sum on the chosen device."""
    if chosen() == "cpu":
        return tone_images if apart else backproject
    return gpu_exact.tone_images if apart else gpu_exact.backproject


def _exact_volume(
    samples: np.ndarray, frequencies_hz: np.ndarray, aperture: Aperture, grid: VoxelGrid, apart: bool
) -> np.ndarray:
    volume = np.empty((len(samples) if apart else 1, int(np.prod(grid.shape))), np.complex64)
    image = _exact(apart)
    flat = np.arange(volume.shape[1])
    for start in track(range(0, volume.shape[1], CHUNK), "exact volume"):
        z, y, x = np.unravel_index(flat[start : start + CHUNK], grid.shape)
        points = np.stack([grid.x_m[x], grid.y_m[y], grid.z_m[z]], axis=1)
        volume[:, start : start + CHUNK] = image(samples, frequencies_hz, aperture, points)
    return volume
