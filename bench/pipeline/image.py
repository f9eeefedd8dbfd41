"""The step from echoes to a depth map: the checks, the image, its uncertainty."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from handbench.bench.datasets.dataset import open_capture
from handbench.bench.datasets.native import FAR_M, CaptureFile
from handbench.radar.data.capture import RadarCapture, thin_antennas
from handbench.radar.data.depthmap import DepthMap
from handbench.radar.methods.advice import require_tones
from handbench.radar.methods.registry import Method, Reconstruction, method
from handbench.support.config import Config
from handbench.support.cost import setting
from handbench.support.errors import HandbenchError


@dataclass(frozen=True)
class ImagingTask:
    """A method, its settings and the echoes of the frames to image, checked by `prepare`."""

    method: Method
    settings: Config
    echoes: RadarCapture

    def image(self, frame: int = 0) -> Reconstruction:
        """Image one frame; the depth map has no uncertainty yet."""
        return self.method.run(self.echoes, self.settings, frame)

    def with_uncertainty(self, depth: DepthMap, frame: int = 0) -> DepthMap:
        """Add to a depth map of this task its standard deviations, flags and p_gross."""
        from handbench.radar.methods.depth_uncertainty import with_p_gross  # it reads a calibration

        return with_p_gross(depth, self.echoes, self.settings, frame)


def prepare(
    echoes: RadarCapture,
    chosen: Method,
    settings: Config,
    frame: int = 0,
    every_nth_antenna: int = 1,
) -> ImagingTask:
    """Check that a method can image a capture's frames 0 to `frame`.

    Args:
        echoes: of these frames at least.
        chosen: the method.
        settings: its configuration, see `configuration`.
        frame: the last frame that is needed.
        every_nth_antenna: of transmitters and receivers, in the order of the file; the others are
            left out.

    Raises:
        HandbenchError: the capture lacks the frame or a tone, or has antennas in millimetres.
    """
    require_near(echoes)
    if not 0 <= frame < len(echoes.samples):
        raise HandbenchError(
            f"frame {frame}: is not there; the capture has frames 0 to {len(echoes.samples) - 1}"
        )
    echoes = thin_antennas(echoes, every_nth_antenna)
    require_tones(echoes, settings)
    return ImagingTask(chosen, settings, echoes)


def image(echoes: RadarCapture, chosen: Method, settings: Config, frame: int = 0) -> DepthMap:
    """Image one frame of a capture, see `prepare`; the depth map has its uncertainty."""
    from handbench.radar.warmup import compile_kernels

    task = prepare(echoes, chosen, settings, frame)
    compile_kernels()
    return task.with_uncertainty(task.image(frame).depth, frame)


def require_near(echoes: RadarCapture) -> RadarCapture:
    """Return the capture; HandbenchError if an antenna is further away than
    HANDBENCH_FARTHEST_M."""
    farthest_m = setting("HANDBENCH_FARTHEST_M", FAR_M, "metres")
    far_m = max(float(np.abs(leg.position_m).max()) for leg in echoes.aperture.legs)
    if far_m > farthest_m:
        raise HandbenchError(
            f"echoes: an antenna is {far_m:g} m from the origin; expected {farthest_m:g} m at "
            "most: are its "
            "positions millimetres? multiply them by 1e-3; if they are not, raise "
            "HANDBENCH_FARTHEST_M"
        )
    return echoes


def configuration(capture: Path, method_id: str, config: dict[str, Any]) -> Config:
    """The method's configuration for the capture in a folder, see `configured`."""
    return configured(open_capture(capture).about, method_id, config)


def configured(about: CaptureFile, method_id: str, config: dict[str, Any]) -> Config:
    """The method's configuration for a capture: its defaults, overridden by the settings of the
    capture's description (for this method, or for the method that it is a variant of), then by the
    user's."""
    of_sensor = about.methods
    for known in of_sensor:
        method(known)  # a typing error in capture.toml is not passed over
    chosen = method(method_id)
    asked = {**of_sensor.get(chosen.base, {}), **of_sensor.get(method_id, {})}
    return chosen.configure({**asked, **config}, f"method '{method_id}'")
