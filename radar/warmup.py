"""Compilation of the kernels of imaging and of simple echoes before anything is timed.

It takes up to a minute, once per machine; later runs load the compiled code from numba's cache.
"""

import numpy as np

from handbench.radar.imaging.cpu.adjoint import radiate
from handbench.radar.imaging.cpu.forward import gather
from handbench.support.compiled import announce_compilation


def announce() -> None:
    """Say once per command that the kernels of imaging are compiled now, if numba has not cached
    them."""
    announce_compilation(gather, radiate)


def compile_kernels() -> None:
    """Run these kernels on tiny inputs, so that later measured times contain neither their
    compilation nor their loading from the cache."""
    from handbench.radar.data.arrays import AntennaArray
    from handbench.radar.data.grid import VoxelGrid
    from handbench.radar.imaging.api import image_points, image_volume, project_volume
    from handbench.radar.methods.pixels import path_gradient_z
    from handbench.radar.simulation.forward import Scatterers, simulate

    announce()
    places_m = np.array([[-0.05, 0.0, 0.0], [0.0, 0.03, 0.0], [0.05, 0.0, 0.0]])
    array, points_m = AntennaArray(places_m, places_m), places_m + [0.0, 0.0, 1.0]
    axis_m = 1e-3 * np.arange(40)
    grid = VoxelGrid(axis_m, axis_m, 0.3 + 1e-4 * np.arange(3))
    tones_hz = np.linspace(72e9, 82e9, 4)
    echoes = np.ones((4, 3, 3), np.complex64)
    image_volume(echoes, tones_hz, array, grid, 1e-2)
    image_points(echoes, tones_hz, array, points_m, None)
    project_volume(echoes, tones_hz, array, grid, 1e-2)
    path_gradient_z(points_m, array)
    simulate(Scatterers(points_m, np.ones(3), np.tile([0.0, 0.0, -1.0], (3, 1))), tones_hz, array)


if __name__ == "__main__":
    compile_kernels()
