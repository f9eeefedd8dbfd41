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
METHODS = {
    "2fsk": PIXELS,
    "3fsk": PIXELS,
    "broadband": {**AXES, "start_hz": 72e9, "stop_hz": 82e9, "count": 5},
    "narrowband": AXES,
}


def patch_m() -> np.ndarray:
    """Points [25, 3] of a patch that leans."""
    along = np.linspace(-0.008, 0.008, 5)
    x, y = np.meshgrid(along, along)
    return PLACE_M + np.stack([x.ravel(), y.ravel(), 0.2 * x.ravel()], axis=1)


def echoes(frames: int = 2) -> RadarCapture:
    """Its echoes, with noise of its own in each frame."""
    samples = simulate(Scatterers(patch_m(), np.ones(25)), TONES_HZ, qar50())
    rng = np.random.default_rng(1)
    noise = rng.standard_normal((2, frames, *samples.shape)) * 0.1 * np.abs(samples).mean()
    return RadarCapture(
        (samples + noise[0] + 1j * noise[1]).astype(np.complex64), TONES_HZ, qar50()
    )


def write_native(folder: Path, capture: RadarCapture) -> Path:
    """The capture as a capture folder, with the settings that its few tones ask for."""
    folder.mkdir(parents=True)
    save_capture(folder / ECHOES, capture)
    corners_m = PLACE_M + 0.01 * np.array(
        [[-1, -1, -0.2], [1, -1, 0.2], [1, 1, 0.2], [-1, 1, -0.2]]
    )
    write_mesh(folder / TRUTH, mesh(corners_m, np.array([[0, 2, 1], [0, 3, 2]])))
    box = {"broadband": AXES}
    save_capture_file(folder, CaptureFile(name="patch", kind="other", distance_m=0.3, methods=box))
    return folder
