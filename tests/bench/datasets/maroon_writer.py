"""A patch of points before the radar, as one object at one distance of MAROON: the layout that
their loaders open."""

from pathlib import Path

import numpy as np

from handbench.bench.datasets.maroon import (
    ALIGNMENT,
    ANTENNAS,
    FRAMES,
    KEY,
    MESHES,
    METADATA,
    MIRROR_X,
    PHOTOGRAMMETRY,
    USED,
    VOLUMES,
)
from handbench.radar.data.arrays import qar50
from handbench.radar.data.capture import RadarCapture
from handbench.radar.simulation.forward import Scatterers, simulate
from handbench.support.files import write_json

TONES_HZ = np.array([72e9, 74.5e9, 77e9, 79.5e9, 81.8e9, 82e9])
PLACE_M = np.array([-0.030, 0.020, 0.290])  # off every axis of symmetry
AXES = {
    axis: {"start_m": float(middle) - 0.01, "stop_m": float(middle) + 0.01, "step_m": 0.002}
    for axis, middle in zip("xyz", PLACE_M, strict=True)
}
FRAME = f"radar_72.0_82.0_6/{FRAMES}/000000.npy"
BOX = f"radar_72.0_82.0_6/{VOLUMES}"


def plane_m(x_m: np.ndarray) -> np.ndarray:
    """Depth of the patch's plane."""
    return PLACE_M[2] + 0.2 * (x_m - PLACE_M[0])


def echoes(frames: int = 2, tones_hz: np.ndarray = TONES_HZ) -> RadarCapture:
    """Echoes of 25 points of the patch, with noise of its own in each frame."""
    along = np.linspace(-0.008, 0.008, 5)
    x_m, y_m = (axis.ravel() for axis in np.meshgrid(along + PLACE_M[0], along + PLACE_M[1]))
    points_m = np.stack([x_m, y_m, plane_m(x_m)], axis=1)
    samples = simulate(Scatterers(points_m, np.ones(25)), tones_hz, qar50())
    noise = np.random.default_rng(1).standard_normal((frames, *samples.shape, 2))
    noise = 0.1 * np.abs(samples).mean() * noise.view(complex)[..., 0]
    return RadarCapture((samples + noise).astype(np.complex64), tones_hz, qar50())


def write_maroon(root: Path, capture: RadarCapture, mirrored: bool = True) -> Path:
    """Write echoes as ROOT/patch/30, and return that folder. mirrored: x of the radar frame to the
    right, as their code draws it. The photo frame is our radar frame."""
    folder = root / "patch" / "30"
    for number, samples in enumerate(capture.samples):
        xr = np.zeros((ANTENNAS, ANTENNAS, len(capture.frequencies_hz)), np.complex64)
        xr[USED, USED] = samples.transpose(2, 1, 0)
        file = (folder / FRAME).with_name(f"{number:06d}.npy")
        save_frame(file, {"fvec": capture.frequencies_hz, "xr": xr})
    box_m = np.array([[AXES[axis][end] for axis in "xyz"] for end in ("start_m", "stop_m")])
    if mirrored:
        box_m[:, 0] = -box_m[::-1, 0]
    volume = dict(zip(("bb_min", "bb_max"), box_m.tolist(), strict=True)) | {"grid_size": [11] * 3}
    write_json(folder / BOX, {"000000": {"volume": volume}})
    write_json(folder / METADATA, {"distance_meters": 0.3, "mask_bb": {"zmin": 0.0, "zmax": 0.6}})
    matrix = MIRROR_X if mirrored else np.eye(4)
    write_json(folder / ALIGNMENT, {KEY: matrix.ravel().tolist()})
    corners_m = PLACE_M + 0.01 * np.array(
        [[-1, -1, -0.2], [1, -1, 0.2], [1, 1, 0.2], [-1, 1, -0.2]]
    )
    for name in MESHES:
        file = folder / PHOTOGRAMMETRY / name
        file.parent.mkdir(exist_ok=True)
        with file.open("w", encoding="ascii") as stream:
            np.savetxt(stream, corners_m, "v %.9f %.9f %.9f")  # to a nanometre
            stream.write("f 1 3 2\nf 1 4 3\n")
    return folder


def save_frame(file: Path, content: dict[str, object]) -> None:
    """Write a frame as theirs are: a pickled dictionary."""
    file.parent.mkdir(parents=True, exist_ok=True)
    np.save(file, np.array(content, dtype=object), allow_pickle=True)
