"""Imaging by backprojection: echo samples → complex images at points, on planes of pixels and in
volumes, exact or within a tolerance.

With a tolerance, the points are grouped into boxes, and each box is imaged from the few tones and
antennas that represent all others there (`radar.imaging.tree`); a voxel grid is interpolated from a
coarser grid. The relative L2 error of the image stays below the tolerance for samples that are no
worse than white noise. With tolerance None, every tone and antenna is summed. What depends on the
geometry only, the plan (`radar.imaging.plan`), is the same on all devices; compiled code applies it
on the processor (`radar.imaging.cpu`), array code elsewhere (`radar.imaging.gpu`).
"""

from typing import Any

import numpy as np

from handbench.radar.data.arrays import Aperture, positions, tones
from handbench.radar.data.capture import largest_part
from handbench.radar.data.grid import VoxelGrid
from handbench.radar.imaging import cpu, gpu
from handbench.radar.imaging.device import Array, current_device, strongest_voxels, to_host
from handbench.radar.imaging.plan import (
    COARSER,
    REUSED,
    GridPlan,
    SortedPoints,
    TreePlan,
    cached_plan,
    exact_terms,
    lattice_box,
    node_cost,
    planning_terms,
)
from handbench.radar.imaging.tree import Family, clusters, needs_direct_sum
from handbench.support.cost import require_memory
from handbench.support.errors import HandbenchError
from handbench.support.progress import track

TOLERANCES = (1e-6, 0.1)  # below, float32 is too coarse; above, the bounds no longer hold
SIZES = (1e-20, 1e20)  # of the largest sample, whose products and sums float32 surely holds
CHUNK = 1 << 18  # voxels that the exact path images at once


def image_points(
    samples: np.ndarray,
    frequencies_hz: np.ndarray,
    aperture: Aperture,
    points_m: np.ndarray,
    tolerance: float | None,
    per_tone: bool = False,
) -> np.ndarray:
    """Image points p by backprojection, O(p) = Σ_f Σ_t Σ_r S_f[t, r] e^{j2πf(|p − t| + |p − r|)/c}:
    complex64 [...], or with `per_tone` one image per tone, the terms of the sum over f: [f, ...].

    samples: S, complex [f, t, r] of an AntennaArray, [f, n] of AntennaPairs.
    points_m: [..., 3], in metres. tolerance: largest relative L2 error, 1e-6 to 0.1; None for the
    exact sum over every tone and antenna, which is also used where it costs less than the fast
    algorithm with its plan. Raises HandbenchError for invalid arguments.
    """
    check(tolerance)
    _check_samples(samples, frequencies_hz, aperture)
    points_m = np.asarray(points_m)
    if points_m.shape[-1:] != (3,):
        raise HandbenchError(f"points_m: have shape {points_m.shape}; expected [..., 3], in metres")
    points = points_m.reshape(-1, 3)
    shape = (len(samples), *points_m.shape[:-1]) if per_tone else points_m.shape[:-1]
    if len(points) == 0:
        return np.zeros(shape, np.complex64)
    points = positions("points_m", points)
    family = Family(tolerance or 0.0, per_tone)
    plans = [] if tolerance is None else _plans(frequencies_hz, aperture, points, family)
    if not plans:
        images = _engine().exact_images(samples, frequencies_hz, aperture, points, per_tone)
        return to_host(images).reshape(shape)
    images = np.empty((len(samples) if per_tone else 1, len(points)), np.complex64)
    for plan, near, where in plans:
        images[:, near] = to_host(_engine().image(plan, samples, where))
    return images.reshape(shape)


def image_volume(
    samples: np.ndarray,
    frequencies_hz: np.ndarray,
    aperture: Aperture,
    grid: VoxelGrid,
    tolerance: float | None,
    per_tone: bool = False,
    carrier: bool = True,
) -> np.ndarray:
    """Image all voxels p of a grid by backprojection,
    O(p) = Σ_f Σ_t Σ_r S_f[t, r] e^{j2πf(|p − t| + |p − r|)/c}: complex64 [nz, ny, nx], or with
    `per_tone` one volume per tone, the terms of the sum over f: [f, nz, ny, nx]. A grid with one
    depth gives a plane, nz = 1.

    samples: S, complex [f, t, r] of an AntennaArray, [f, n] of AntennaPairs.
    tolerance: largest relative L2 error, 1e-6 to 0.1; None for the exact sum. carrier: with a
    tolerance, False omits a phase factor that depends on the voxel and is the same for all tones;
    this is faster, and enough for magnitudes and for phase differences between tones. Raises
    HandbenchError for invalid arguments and for a volume beyond the memory limit (see
    `support.cost`).
    """
    check(tolerance)
    _check_samples(samples, frequencies_hz, aperture)
    count = len(samples) if per_tone else 1
    require_memory(
        8 * count * int(np.prod(grid.shape)),
        f"volume of {count} × {grid.shape} voxels [nz, ny, nx]",
        COARSER,
    )
    if tolerance is None:
        volumes = _exact_volume(samples, frequencies_hz, aperture, grid, per_tone)
    else:
        plan = _grid_plan(frequencies_hz, aperture, grid, Family(tolerance, per_tone))
        nodes, images = _node_images(plan, samples, frequencies_hz, aperture, grid.z_m)
        volumes = _engine().volume(plan, nodes, images, carrier)
    return volumes.reshape((count, *grid.shape) if per_tone else grid.shape)


def project_volume(
    samples: np.ndarray,
    frequencies_hz: np.ndarray,
    aperture: Aperture,
    grid: VoxelGrid,
    tolerance: float | None,
) -> tuple[np.ndarray, np.ndarray]:
    """Find the strongest voxel along z for each pixel of a volume, argmax_z |O(x, y, z)| with the
    coherent sum O of `image_volume`: (its index along z [ny, nx], magnitudes |O| of the voxel
    before it, of itself and of the voxel behind it [3, ny, nx], NaN beyond the volume).

    samples: S, complex [f, t, r] of an AntennaArray, [f, n] of AntennaPairs.
    tolerance: largest relative L2 error, 1e-6 to 0.1, with which the volume is never stored as a
    whole; None for the exact sum.
    """
    check(tolerance)
    _check_samples(samples, frequencies_hz, aperture)
    if tolerance is None:
        volume = image_volume(samples, frequencies_hz, aperture, grid, None)
        exact: tuple[np.ndarray, np.ndarray] = strongest_voxels(volume.real, volume.imag)
        return exact
    plan = _grid_plan(frequencies_hz, aperture, grid, Family(tolerance, False))
    peaks: tuple[np.ndarray, np.ndarray] = _engine().project(
        plan, *_node_images(plan, samples, frequencies_hz, aperture, grid.z_m)
    )
    return peaks


def points_plan(
    frequencies_hz: np.ndarray, aperture: Aperture, points_m: np.ndarray, family: Family
) -> TreePlan:
    """Return a plan of the geometry for points_m [n, 3] and other points nearby. It is taken from
    the cache if an equal one was made before. family: tolerance and other settings of the plan."""
    box = lattice_box(points_m.min(axis=0), points_m.max(axis=0))
    return cached_plan(TreePlan, frequencies_hz, aperture, box, family)


def check(tolerance: float | None) -> None:
    """Raise HandbenchError for a tolerance outside 1e-6 to 0.1; None, the exact sum, is allowed."""
    if tolerance is not None and not TOLERANCES[0] <= tolerance <= TOLERANCES[1]:
        raise HandbenchError(
            f"tolerance: is {tolerance}; expected {TOLERANCES[0]:g} to {TOLERANCES[1]:g}, or "
            "None (--exact) for the exact sum"
        )


def _check_samples(samples: np.ndarray, frequencies_hz: np.ndarray, aperture: Aperture) -> None:
    """Raise HandbenchError for invalid tones, for samples that are not finite or do not fit the
    tones and the aperture, and for samples so large or so small that sums in float32 may overflow
    or lose them."""
    tones("frequencies_hz", frequencies_hz)
    expected = (len(frequencies_hz), *aperture.channels)
    if samples.shape != expected:
        raise HandbenchError(
            f"samples: have shape {samples.shape}; expected {expected} for {len(frequencies_hz)} "
            f"frequencies and the {aperture.channels} channels of the {type(aperture).__name__}"
        )
    if samples.dtype.kind not in "iufc" or not np.isfinite(largest := largest_part(samples)):
        raise HandbenchError(
            f"samples: have NaN or infinite values or the type {samples.dtype}; expected finite "
            "numbers, so repair them"
        )
    if largest != 0 and not SIZES[0] <= largest <= SIZES[1]:
        raise HandbenchError(
            f"samples: the largest has the magnitude {largest:.3g}; expected {SIZES[0]:g} to "
            f"{SIZES[1]:g}; multiply all samples by a constant"
        )


def _engine() -> Any:
    """Return the module that makes images on the current device: its functions `image`, `volume`
    and `project` apply plans to samples, and `exact_images` sums every tone and antenna."""
    return cpu if current_device() == "cpu" else gpu


def _plans(
    frequencies_hz: np.ndarray, aperture: Aperture, points_m: np.ndarray, family: Family
) -> list[tuple[TreePlan, np.ndarray, SortedPoints]]:
    """Divide points [n, 3] into compact clusters, and return the plan, the indices and the sorted
    points of each; an empty list if the plans cost more than the exact sum of REUSED images."""
    if needs_direct_sum(aperture):
        return []
    terms = REUSED * exact_terms(len(frequencies_hz) * len(points_m), aperture)
    parts = clusters(points_m, frequencies_hz)
    if 2 * len(parts) * node_cost(aperture) > terms:  # a cell and a leaf each
        return []
    plans = [points_plan(frequencies_hz, aperture, points_m[near], family) for near in parts]
    places = [plan.sort(points_m[near]) for plan, near in zip(plans, parts, strict=True)]
    planned = list(zip(plans, parts, places, strict=True))
    cost = sum(planning_terms(where, plan, aperture) for plan, _, where in planned)
    return planned if cost <= terms else []


def _grid_plan(
    frequencies_hz: np.ndarray, aperture: Aperture, grid: VoxelGrid, family: Family
) -> GridPlan:
    """Return the plan of a voxel grid, from the cache if an equal one was made before. The plan of
    a plane (a grid with one depth) is also reused for planes at nearby depths."""
    planes, z_m = len(grid.z_m) == 1, grid.z_m
    if planes:
        box = lattice_box(*grid.ends_m)
        z_m = np.array([box.low_m[2], box.high_m[2]])
    boxed = VoxelGrid(grid.x_m, grid.y_m, z_m)
    return cached_plan(GridPlan, frequencies_hz, aperture, boxed, family, planes)


def _node_images(
    plan: GridPlan, samples: np.ndarray, frequencies_hz: np.ndarray, aperture: Aperture, z_m: Array
) -> tuple[VoxelGrid, Array]:
    """Image the coarse nodes from which all voxels are interpolated: (grid of the nodes, complex64
    images [f or 1, nz, ny, nx] at them, in the device's memory). z_m: depths of the voxel grid."""
    nodes = plan.nodes_at(z_m)
    if plan.tree is None:
        points_m = nodes.points_m().reshape(-1, 3)
        images = _engine().exact_images(
            samples, frequencies_hz, aperture, points_m, plan.family.per_tone
        )
    else:
        images = _engine().image(plan.tree, samples, plan.sort(nodes))
    return nodes, images.reshape(-1, *nodes.shape)


def _exact_volume(
    samples: np.ndarray,
    frequencies_hz: np.ndarray,
    aperture: Aperture,
    grid: VoxelGrid,
    per_tone: bool,
) -> np.ndarray:
    volume = np.empty((len(samples) if per_tone else 1, int(np.prod(grid.shape))), np.complex64)
    flat = np.arange(volume.shape[1])
    for start in track(range(0, len(flat), CHUNK), "exact volume"):
        chunk = slice(start, start + CHUNK)
        volume[:, chunk] = to_host(
            _engine().exact_images(
                samples, frequencies_hz, aperture, grid.points_at_m(flat[chunk]), per_tone
            )
        )
    return volume
