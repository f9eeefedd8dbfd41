"""The forward and the adjoint model of echoes as a linear operator of SciPy."""

from __future__ import annotations

from functools import partial

import numpy as np
from numpy.typing import ArrayLike
from scipy.sparse.linalg import LinearOperator

from handbench.radar.data.arrays import AntennaArray, positions, tones
from handbench.radar.data.grid import VoxelGrid
from handbench.radar.imaging.api import check, image_points, image_volume
from handbench.radar.simulation.forward import Scatterers, simulate
from handbench.support.errors import HandbenchError


def operator(
    array: AntennaArray,
    frequencies_hz: ArrayLike,
    grid: VoxelGrid | ArrayLike,
    tolerance: float | None = 1e-3,
) -> LinearOperator:
    """Return the operator A [f·t·r, n], complex64, from reflectivities x of a grid's n points p to
    noise-free samples, and its adjoint, which is backprojection:

        (A x)(f, t, r) = Σ_p x(p) exp(−j2πf(|p − t| + |p − r|)/c)
        (Aᴴ y)(p) = Σ_{f,t,r} y(f, t, r) exp(+j2πf(|p − t| + |p − r|)/c)

    Rows are in the order f, t, r, and 0 for pairs that were not measured; columns are in the order
    z, y, x of a `VoxelGrid`, or as the points [n, 3] are. tolerance: largest relative L2 error of
    both products, 1e-6 to 0.1; None for exact sums. Raises HandbenchError for a scan and for
    invalid arguments.
    """
    check(tolerance)
    tones_hz = tones("frequencies_hz", frequencies_hz)
    if not isinstance(array, AntennaArray):
        raise HandbenchError(
            f"array: is an {type(array).__name__}; expected an AntennaArray, since echoes are "
            "simulated for every transmitter with every receiver"
        )
    if isinstance(grid, VoxelGrid):
        points_m = grid.points_m().reshape(-1, 3)
        image = partial(image_volume, grid=grid)
    else:
        points_m = positions("grid", grid)
        image = partial(image_points, points_m=points_m)
    shape = len(tones_hz), *array.channels
    measured = True if array.measured is None else array.measured

    def forward(x: np.ndarray) -> np.ndarray:
        samples = simulate(Scatterers(points_m, x.ravel()), tones_hz, array, False, tolerance)
        return (samples * measured).ravel()

    def adjoint(y: np.ndarray) -> np.ndarray:
        samples = y.reshape(shape) * measured
        return image(samples, tones_hz, array, tolerance=tolerance).ravel()

    size = int(np.prod(shape)), len(points_m)
    return LinearOperator(size, forward, adjoint, dtype=np.complex64)
