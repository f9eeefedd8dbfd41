"""The step from echoes to a depth map: checks of the capture, imaging by a method, and the
uncertainty of the depths."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from handbench.bench.datasets.native import FAR_M, CaptureFile
from handbench.radar.data.arrays import SPEED_OF_LIGHT_M_S, AntennaArray, qar50
from handbench.radar.data.capture import RadarCapture, thin_antennas
from handbench.radar.data.depthmap import DepthMap
from handbench.radar.methods.evidence import frames_with_echoes, require_evidence
from handbench.radar.methods.registry import Method, method
from handbench.radar.methods.settings import MethodSettings
from handbench.support.errors import HandbenchError
from handbench.support.parallel import setting

OUTLYING = 8.0  # times the median distance from the middle: farther, an antenna is no part of it
LEAST_M = 0.5  # from the middle, which antennas may be whatever the others are


@dataclass(frozen=True)
class ImagingTask:
    """A method, its configuration, and the echoes of the frames that it images; `prepare` has
    checked that they fit."""

    method: Method
    settings: MethodSettings
    echoes: RadarCapture

    def image(self, frame: int = 0) -> DepthMap:
        """Image one frame by the method: its depth map, still without p_gross."""
        return self.method.run(self.echoes, self.settings, frame)

    def with_uncertainty(self, depth: DepthMap, frame: int = 0) -> DepthMap:
        """Return a depth map of this task with p_gross, the probability of a gross error, added;
        its standard deviations are raised to what the antennas can resolve. Raises HandbenchError
        for an invalid map."""
        from handbench.radar.methods.gross_errors import with_p_gross  # imports numba

        checked = depth.checked(f"method '{self.method.id}'")
        return with_p_gross(checked, self.echoes, self.settings, frame)


def prepare(
    echoes: RadarCapture,
    chosen: Method,
    settings: MethodSettings,
    frames: Sequence[int] = (0,),
    every_nth_antenna: int = 1,
) -> ImagingTask:
    """Check that a method can image some frames of a capture, and return the task that images them.

    Args:
        echoes: the capture, with these frames at least.
        chosen: the method.
        settings: its configuration, from `configured`.
        frames: numbers of the frames that are needed.
        every_nth_antenna: keep every n-th transmitter and receiver, in the order of the file.

    Raises:
        HandbenchError: the capture lacks a frame or a tone, its echoes show no depth, or an
            antenna is implausibly far away (positions in millimetres).
    """
    require_near(echoes)
    echoes = thin_antennas(echoes, every_nth_antenna)
    count = len(echoes.samples)
    for frame in frames:
        if frame not in range(count):
            raise HandbenchError(
                f"frame {frame}: does not exist; the capture has frames 0 to {count - 1} (a "
                "benchmark's precision needs as many as its `repeats`)"
            )
        require_evidence(echoes, settings, frame)
    return ImagingTask(chosen, settings, echoes)


def required_frames(echoes: RadarCapture, count: int) -> list[int]:
    """Return the numbers of the first `count` frames, without those after the first that a capture
    has recorded without any echo."""
    silent = {*range(1, len(echoes.samples))} - {*frames_with_echoes(echoes.samples)}
    return [number for number in range(count) if number not in silent]


def image(
    echoes: RadarCapture, chosen: Method, settings: MethodSettings, frame: int = 0
) -> DepthMap:
    """Image one frame of a capture by a method: the depth map with its standard deviations, flags
    and p_gross, the probability of a gross error. Raises HandbenchError if the method cannot image
    the frame."""
    task = prepare(echoes, chosen, settings, [frame])
    return task.with_uncertainty(task.image(frame), frame)


def require_near(echoes: RadarCapture) -> RadarCapture:
    """Return the capture unchanged. Raises HandbenchError if an antenna is further from the origin
    than the environment variable HANDBENCH_FARTHEST_M allows, which suggests positions in
    millimetres, or if one is far from all others, whose place is then most likely damaged."""
    farthest_m = setting("HANDBENCH_FARTHEST_M", FAR_M, "number of metres")
    all_m = places_m(echoes)
    far_m = float(np.abs(all_m).max())
    if far_m > farthest_m:
        raise HandbenchError(
            f"echoes: an antenna is {far_m:g} m from the origin; expected at most {farthest_m:g} "
            "m; if the positions are in millimetres, multiply them by 1e-3; if they are right, "
            "raise HANDBENCH_FARTHEST_M"
        )
    away_m = np.linalg.norm(all_m - np.median(all_m, axis=0), axis=1)
    if away_m.max() > (most_m := max(OUTLYING * np.median(away_m), LEAST_M)):
        raise HandbenchError(
            f"echoes: the antenna at {np.round(all_m[away_m.argmax()], 4).tolist()} m is "
            f"{away_m.max():.2g} m from the middle of all; expected at most {most_m:.2g} m; "
            "correct its position, or copy the file again"
        )
    return echoes


def places_m(capture: RadarCapture) -> np.ndarray:
    """Return the positions [n, 3] of all antennas of a capture, metres."""
    return np.concatenate([leg.position_m for leg in capture.aperture.legs])


def configured(about: CaptureFile, method_id: str, config: dict[str, Any]) -> MethodSettings:
    """Return a method's complete configuration for a capture with the description `about`.

    The method's defaults are overridden by the settings in the description (for this method, or for
    the method that it is a variant of), and these by `config`. Raises HandbenchError for an unknown
    method or setting.
    """
    of_sensor = about.methods
    for known in of_sensor:
        method(known)  # a typing error in capture.toml is not passed over
    chosen = method(method_id)
    base = method_id.partition("-")[0]
    asked = {**of_sensor.get(base, {}), **of_sensor.get(method_id, {})}
    return chosen.configure({**asked, **config}, f"method '{method_id}'")


def image_point(method_id: str, config: dict[str, Any]) -> None:
    """Image a point 0.3 m in front of the built-in array by a method. The plan of the image, which
    depends on the geometry alone, is kept for later ones, and the kernels are compiled."""
    chosen = method(method_id)
    settings = chosen.configure(config, f"method '{method_id}'")
    chosen.run(point_echoes(qar50(), settings.frequencies_hz, 0.3), settings, 0)


def point_echoes(
    array: AntennaArray, frequencies_hz: np.ndarray, z_m: float, times_s: np.ndarray | None = None
) -> RadarCapture:
    """Return the echoes of a point z_m metres straight in front of an array. times_s [f]: when each
    tone is measured."""
    legs_m = [np.linalg.norm(leg.position_m - (0.0, 0.0, z_m), axis=1) for leg in array.legs]
    turns = np.multiply.outer(frequencies_hz / SPEED_OF_LIGHT_M_S, np.add.outer(*legs_m))
    samples = np.exp(-2j * np.pi * turns).astype(np.complex64)
    return RadarCapture(samples[None], frequencies_hz, array, times_s=times_s)
