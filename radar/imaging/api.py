"""Imaging by backprojection: echo samples → complex images at points, on planes of pixels and in
volumes, exact or within a tolerance.

With a tolerance, the points are grouped into boxes, and each box is imaged from the few tones and
antennas that represent all others there (`radar.imaging.tree`); a voxel grid is interpolated from a
coarser grid. The relative L2 error of the image stays below the tolerance for samples that are no
worse than white noise. With tolerance None, every tone and antenna is summed. What depends on the
geometry only, the plan (`radar.imaging.plan`), is the same on all devices; compiled code applies it
on the processor (`radar.imaging.cpu`), array code elsewhere (`radar.imaging.gpu`).
"""

from collections.abc import Callable
from typing import Any, NamedTuple, TypeVar

import numpy as np

from handbench.radar.data.arrays import Aperture, positions
from handbench.radar.data.grid import VoxelGrid
from handbench.radar.imaging.cpu import executor as cpu
from handbench.radar.imaging.cpu.exact import check_samples
from handbench.radar.imaging.device import Array, current_device, to_host
from handbench.radar.imaging.gpu import executor as gpu
from handbench.radar.imaging.peaks import Peaks, strongest_voxels
from handbench.radar.imaging.plan import (
    COARSER,
    GridPlan,
    TreePlan,
    exact_terms,
    get_or_compute,
    lattice_box,
    node_cost,
)
from handbench.radar.imaging.tree import Family, clusters, needs_direct_sum
from handbench.support.cost import require_memory
from handbench.support.errors import HandbenchError
from handbench.support.progress import track

TOLERANCES = (1e-6, 0.1)  # below, float32 is too coarse; above, the bounds no longer hold
SIZES = (1e-20, 1e20)  # of the largest sample, whose products and sums float32 surely holds
CHUNK = 1 << 18  # voxels that the exact path images at once

Made = TypeVar("Made")


def image_points(
    samples: np.ndarray,
    frequencies_hz: np.ndarray,
    aperture: Aperture,
    points_m: np.ndarray,
    tolerance: float | None,
    apart: bool = False,
) -> np.ndarray:
    """Image points by backprojection: complex64 [...], the coherent sum of all tones, or with
    `apart` one image per tone, [f, ...].

    samples: complex [f, t, r] of an AntennaArray, [f, n] of a PlanarScan or a BistaticScan.
    points_m: [..., 3], in metres. tolerance: largest relative L2 error, 1e-6 to 0.1; None for the
    exact sum over every tone and antenna, which is also used where it costs less than the fast
    algorithm with its plan. Raises HandbenchError for invalid arguments.
    """
    check(tolerance)
    _check_size(samples, frequencies_hz, aperture)
    points_m = np.asarray(points_m)
    if points_m.shape[-1:] != (3,):
        raise HandbenchError(f"points_m: have shape {points_m.shape}; expected [..., 3], in metres")
    points = points_m.reshape(-1, 3)
    shape = (len(samples), *points_m.shape[:-1]) if apart else points_m.shape[:-1]
    if len(points) == 0:
        return np.zeros(shape, np.complex64)
    points = positions("points_m", points)
    terms = exact_terms(len(samples) * len(points), aperture)
    parts = (
        [] if tolerance is None or needs_direct_sum(aperture) else clusters(points, frequencies_hz)
    )
    if 2 * len(parts) * node_cost(aperture) > terms:  # a cell and a leaf each
        parts = []
    family = Family(tolerance or 0.0, apart)
    plans = [
        points_executor(frequencies_hz, aperture, points[near], family, _device().executor)
        for near in parts
    ]
    if any(executor.plan.too_many_leaves for executor in plans):
        plans, parts = [], []
    places = [executor.plan.sort(points[near]) for executor, near in zip(plans, parts, strict=True)]
    if (
        not parts
        or sum(executor.plan.cost(where) for executor, where in zip(plans, places, strict=True))
        > terms
    ):
        images = to_host(_device().exact_images(samples, frequencies_hz, aperture, points, apart))
    else:
        images = np.empty((len(samples) if apart else 1, len(points)), np.complex64)
        for executor, near, where in zip(plans, parts, places, strict=True):
            images[:, near] = to_host(executor.image(samples, where))
    return images.reshape(shape)


def image_volume(
    samples: np.ndarray,
    frequencies_hz: np.ndarray,
    aperture: Aperture,
    grid: VoxelGrid,
    tolerance: float | None,
    apart: bool = False,
    carrier: bool = True,
) -> np.ndarray:
    """Image all voxels of a grid by backprojection: complex64 [nz, ny, nx], or with `apart` one
    volume per tone, [f, nz, ny, nx]. A grid with one depth gives a plane, nz = 1.

    samples: complex [f, t, r] of an AntennaArray, [f, n] of a PlanarScan or a BistaticScan.
    tolerance: largest relative L2 error, 1e-6 to 0.1; None for the exact sum. carrier: with a
    tolerance, False omits a phase factor that depends on the voxel and is the same for all tones;
    this is faster, and enough for magnitudes and for phase differences between tones. Raises
    HandbenchError for invalid arguments and for a volume beyond the memory limit (see
    `support.cost`).
    """
    check(tolerance)
    _check_size(samples, frequencies_hz, aperture)
    count = len(samples) if apart else 1
    require_memory(
        8 * count * int(np.prod(grid.shape)),
        f"volume of {count} × {grid.shape} voxels [nz, ny, nx]",
        COARSER,
    )
    if tolerance is None:
        volumes = _exact_volume(samples, frequencies_hz, aperture, grid, apart)
    else:
        imager = _grid_imager(frequencies_hz, aperture, grid, Family(tolerance, apart))
        nodes, images = imager.nodes(samples, grid.z_m)
        volumes = imager.upsampler.volume(nodes, images, carrier)
    return volumes.reshape((count, *grid.shape) if apart else grid.shape)


def project_volume(
    samples: np.ndarray,
    frequencies_hz: np.ndarray,
    aperture: Aperture,
    grid: VoxelGrid,
    tolerance: float | None,
) -> Peaks:
    """Find the strongest voxel along z for each pixel of a volume imaged by backprojection, all
    tones summed coherently: its index and magnitudes, as `Peaks`.

    samples: complex [f, t, r] of an AntennaArray, [f, n] of a PlanarScan or a BistaticScan.
    tolerance: largest relative L2 error, 1e-6 to 0.1, with which the volume is never stored as a
    whole; None for the exact sum.
    """
    check(tolerance)
    _check_size(samples, frequencies_hz, aperture)
    if tolerance is None:
        return strongest_voxels(image_volume(samples, frequencies_hz, aperture, grid, None))
    imager = _grid_imager(frequencies_hz, aperture, grid, Family(tolerance, False))
    nodes, images = imager.nodes(samples, grid.z_m)
    return imager.upsampler.project(nodes, images)


def points_executor(
    frequencies_hz: np.ndarray,
    aperture: Aperture,
    points_m: np.ndarray,
    family: Family,
    executor: Callable[[TreePlan], Made],
) -> Made:
    """Return the object that images points_m [n, 3], and other points nearby, with a plan of the
    geometry: executor(plan). It is taken from the cache if an equal one was made before.

    executor: class or function that takes a `TreePlan`, such as `CpuExecutor`; its result applies
    the plan to samples. family: tolerance and other settings of the plan.
    """
    box = lattice_box(points_m.min(axis=0), points_m.max(axis=0))
    what = (current_device(), executor.__module__, *box)
    build = lambda: executor(TreePlan(frequencies_hz, aperture, box, family))  # noqa: E731
    return get_or_compute(what, frequencies_hz, aperture, family, build)


class GridImager:
    """Images a voxel grid on the current device in two stages: `nodes` images a coarse grid of
    nodes, and `upsampler` interpolates from the nodes to all voxels."""

    def __init__(
        self, plan: GridPlan, frequencies_hz: np.ndarray, aperture: Aperture, apart: bool
    ) -> None:
        device = _device()
        self.plan, self._how = plan, (frequencies_hz, aperture, apart)
        self._executor = None if plan.tree is None else device.executor(plan.tree)
        self.upsampler = device.upsampler(plan)

    def nodes(self, samples: np.ndarray, z_m: np.ndarray) -> tuple[VoxelGrid, Array]:
        """Image the coarse nodes from which all voxels are interpolated: (grid of the nodes,
        complex64 images [f or 1, nz, ny, nx] at them, in the device's memory).

        samples: complex [f, t, r] or [f, n]. z_m: depths of the voxel grid; if the imager is for
        single planes, [1], the depth of this plane.
        """
        nodes = self.plan.nodes_at(z_m)
        if self._executor is None:
            frequencies_hz, aperture, apart = self._how
            images = _device().exact_images(
                samples, frequencies_hz, aperture, nodes.points_m().reshape(-1, 3), apart
            )
        else:
            images = self._executor.image(samples, self.plan.sort(self._executor.plan, nodes))
        return nodes, images.reshape(-1, *nodes.shape)


def check(tolerance: float | None) -> None:
    """Raise HandbenchError for a tolerance outside 1e-6 to 0.1; None, the exact sum, is allowed."""
    if tolerance is not None and not TOLERANCES[0] <= tolerance <= TOLERANCES[1]:
        raise HandbenchError(
            f"tolerance: is {tolerance}; expected {TOLERANCES[0]:g} to {TOLERANCES[1]:g}, or "
            "None (--exact) for the exact sum"
        )


def _check_size(samples: np.ndarray, frequencies_hz: np.ndarray, aperture: Aperture) -> None:
    """Raise HandbenchError for invalid samples or tones, and for samples so large or so small that
    sums in float32 may overflow or lose them."""
    largest = check_samples(samples, frequencies_hz, aperture)
    if largest != 0 and not SIZES[0] <= largest <= SIZES[1]:
        raise HandbenchError(
            f"samples: the largest has the magnitude {largest:.3g}; expected {SIZES[0]:g} to "
            f"{SIZES[1]:g}; multiply all samples by a constant"
        )


class _Device(NamedTuple):
    """The implementation of imaging on one device. executor: makes from a plan the object that
    applies it to samples; upsampler: makes from a grid's plan the object that interpolates coarse
    nodes to voxels; exact_images: sums every tone and antenna."""

    executor: Callable[[TreePlan], Any]
    upsampler: Callable[[GridPlan], Any]
    exact_images: Callable[..., Array]


def _device() -> _Device:
    """Return the functions that make images on the current device."""
    if current_device() == "cpu":
        return _Device(cpu.CpuExecutor, cpu.CpuUpsampler, cpu.exact_images)
    return _Device(gpu.GpuExecutor, gpu.GpuUpsampler, gpu.exact_images)


def _grid_imager(
    frequencies_hz: np.ndarray, aperture: Aperture, grid: VoxelGrid, family: Family
) -> GridImager:
    """Return the imager of a voxel grid, from the cache if an equal one was made before. The imager
    of a plane (a grid with one depth) is also reused for planes at nearby depths."""
    planes, z_m = len(grid.z_m) == 1, grid.z_m
    if planes:
        box = lattice_box(*grid.ends_m)
        z_m = np.array([box.low_m[2], box.high_m[2]])

    def build() -> GridImager:
        plan = GridPlan(
            frequencies_hz, aperture, VoxelGrid(grid.x_m, grid.y_m, z_m), family, planes
        )
        return GridImager(plan, frequencies_hz, aperture, family.apart)

    return get_or_compute(
        (current_device(), "volume", planes, grid.x_m, grid.y_m, z_m),
        frequencies_hz,
        aperture,
        family,
        build,
    )


def _exact_volume(
    samples: np.ndarray,
    frequencies_hz: np.ndarray,
    aperture: Aperture,
    grid: VoxelGrid,
    apart: bool,
) -> np.ndarray:
    volume = np.empty((len(samples) if apart else 1, int(np.prod(grid.shape))), np.complex64)
    flat = np.arange(volume.shape[1])
    for start in track(range(0, len(flat), CHUNK), "exact volume"):
        chunk = slice(start, start + CHUNK)
        volume[:, chunk] = to_host(
            _device().exact_images(
                samples, frequencies_hz, aperture, grid.points_at_m(flat[chunk]), apart
            )
        )
    return volume
