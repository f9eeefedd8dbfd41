"""A small capture that the tests of the adapters write in every form: a patch of points before the
radar."""

from pathlib import Path

import numpy as np

from handbench.bench.datasets.native import ECHOES, TRUTH, CaptureFile, save_capture_file
from handbench.groundtruth.mesh.mesh_files import mesh, write_mesh
from handbench.radar.data.arrays import qar50
from handbench.radar.data.capture import RadarCapture
from handbench.radar.data.echoes_file import save_capture
from handbench.radar.simulation.forward import Scatterers, simulate

TONES_HZ = np.array([72e9, 74.5e9, 77e9, 79.5e9, 81.8e9, 82e9])
PLACE_M = np.array([-0.030, 0.020, 0.290])  # off every axis of symmetry
AXES = {
    axis: {"start_m": float(middle) - 0.01, "stop_m": float(middle) + 0.01, "step_m": 0.002}
    for axis, middle in zip("xyz", PLACE_M, strict=True)
}
PIXELS = {axis: AXES[axis] for axis in "xy"}


def plane_m(x_m: np.ndarray) -> np.ndarray:
    """Depth of the patch's plane."""
    return PLACE_M[2] + 0.2 * (x_m - PLACE_M[0])


def patch_m() -> np.ndarray:
    """Points [25, 3] of a patch that leans."""
    along = np.linspace(-0.008, 0.008, 5)
    x, y = (axis.ravel() for axis in np.meshgrid(along + PLACE_M[0], along + PLACE_M[1]))
    return np.stack([x, y, plane_m(x)], axis=1)


def echoes(frames: int = 2, tones_hz: np.ndarray = TONES_HZ) -> RadarCapture:
    """Its echoes, with noise of its own in each frame."""
    samples = simulate(Scatterers(patch_m(), np.ones(25)), tones_hz, qar50())
    noise = np.random.default_rng(1).standard_normal((frames, *samples.shape, 2))
    noise = 0.1 * np.abs(samples).mean() * noise.view(complex)[..., 0]
    return RadarCapture((samples + noise).astype(np.complex64), tones_hz, qar50())


def write_native(folder: Path, capture: RadarCapture) -> Path:
    """The capture as a capture folder, with the settings that its few tones ask for."""
    folder.mkdir(parents=True)
    save_capture(folder / ECHOES, capture)
    corners = np.array([[-1, -1, -0.2], [1, -1, 0.2], [1, 1, 0.2], [-1, 1, -0.2]])
    write_mesh(folder / TRUTH, mesh(PLACE_M + 0.01 * corners, [(0, 2, 1), (0, 3, 2)]))
    box = {"broadband": AXES}
    save_capture_file(folder, CaptureFile(name="patch", kind="other", distance_m=0.3, methods=box))
    return folder
