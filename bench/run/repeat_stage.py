"""The stage that images repeated frames of a capture by one method, to measure the scatter of the
depths."""

from pathlib import Path
from typing import Any

import numpy as np

from handbench.bench.evaluation.depth_errors import ErrorMap, deviation_map
from handbench.bench.evaluation.repeats import strongest_scatterer_z_m
from handbench.bench.run.reconstruct_stage import TIMING, Imager
from handbench.radar.data.depthmap import DepthMap
from handbench.radar.imaging.device import use_device
from handbench.support.cost import others
from handbench.support.files import read_npz, write_json, write_npz

REPEATS = "repeats.npz"


def repeat(
    folder: Path,
    capture: str,
    method: str,
    config: dict[str, Any],
    device: str,
    every_nth_antenna: int,
    frames: int,
) -> None:
    """Image repeated frames of a capture by one method, and write the scatter of the depths into a
    stage's folder.
    It writes the depth of the strongest scatterer in each frame and the standard deviation of each
    pixel (repeats.npz), and the times of the frames (timing.json). capture: its folder; config:
    settings of the method; device: name of the device that images; every_nth_antenna: use only
    every n-th transmitter and every n-th receiver; frames: how many are imaged."""
    with use_device(device), others() as busy:
        found = Imager(Path(capture), method, config, frames, every_nth_antenna).images()
    depths = [result.depth for result in found.results]
    spread = deviation_map(depths[0].x_m, depths[0].y_m, np.stack([d.z_m for d in depths]))
    write_npz(
        folder / REPEATS,
        z_m=strongest_z_m(depths),
        x_m=spread.x_m,
        y_m=spread.y_m,
        deviation_m=spread.error_m,
    )
    write_json(
        folder / TIMING,
        {"seconds": found.seconds, "plan_seconds": found.plan_s, "others_cores": busy[0]},
    )


def strongest_z_m(depths: list[DepthMap]) -> np.ndarray:
    """Return the depth [n], metres, of the strongest scatterer in each of the n repeated frames.
    It is read at the same pixel in all frames. depths: one depth map for each frame."""
    amplitude = np.stack([10 ** (d.amplitude_db / 20) for d in depths])
    return strongest_scatterer_z_m(np.stack([d.z_m for d in depths]), amplitude)


def read_repeats(folder: Path) -> tuple[np.ndarray, ErrorMap]:
    """Read the scatter of a capture's repeated frames from the stage's folder.
    Returns the depths of the strongest scatterer [n], metres, and an ErrorMap that holds the
    standard deviation of each pixel in place of errors."""
    kept = read_npz(folder / REPEATS, ("z_m", "x_m", "y_m", "deviation_m"))
    return kept["z_m"], ErrorMap(kept["x_m"], kept["y_m"], kept["deviation_m"], kept["deviation_m"])
