"""The paper's four methods."""

from __future__ import annotations

from bench.registry import Reconstruction, register
from radar.capture import RadarCapture
from radar.fsk import ThreeToneConfig, TwoToneConfig, three_tone, two_tone
from radar.surface import BroadbandConfig, NarrowbandConfig, maximum_projection, volume


@register("2fsk", TwoToneConfig, "depth from the phase between images at two tones")
def _two_tone(capture: RadarCapture, config: TwoToneConfig, frame: int) -> Reconstruction:
    return Reconstruction(two_tone(capture, config, frame))


@register("3fsk", ThreeToneConfig, "2-FSK, then a third tone far away corrects every pixel")
def _three_tone(capture: RadarCapture, config: ThreeToneConfig, frame: int) -> Reconstruction:
    return Reconstruction(three_tone(capture, config, frame))


@register("broadband", BroadbandConfig, "backprojected volume of 128 tones, maximum intensity projection")
def _broadband(capture: RadarCapture, config: BroadbandConfig, frame: int) -> Reconstruction:
    return _project(capture, config, frame, "broadband")


@register("narrowband", NarrowbandConfig, "backprojected volume of the three 3-FSK tones, maximum intensity projection")
def _narrowband(capture: RadarCapture, config: NarrowbandConfig, frame: int) -> Reconstruction:
    return _project(capture, config, frame, "narrowband")


def _project(
    capture: RadarCapture, config: BroadbandConfig | NarrowbandConfig, frame: int, method: str
) -> Reconstruction:
    image = volume(capture, config, frame)
    return Reconstruction(maximum_projection(image, config, method), image, config.grid().z_m)
