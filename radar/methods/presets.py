"""The paper's four methods and what improves on them: presets of the same functions."""

from __future__ import annotations

from dataclasses import replace

from radar.data.capture import RadarCapture
from radar.methods.fsk import AnyConfig, n_tone
from radar.methods.fsk_config import FskConfig, LadderConfig, RefinedConfig, ThreeToneConfig, TwoToneConfig
from radar.methods.projection import BroadbandConfig, NarrowbandConfig, ProjectionConfig, project, volume
from radar.methods.registry import PAPER, Reconstruction, register
from radar.support.config import Config

OURS = f"docs/methods.md, after {PAPER}"


class OffAxisConfig(ThreeToneConfig):
    """3-FSK with the path's true derivative."""

    off_axis: bool = True


class WeightedConfig(ThreeToneConfig):
    """3-FSK whose filters trust strong pixels more."""

    weighted: bool = True


class _Plus(RefinedConfig):
    """Every improvement: the second refinement settles what the first one, out of focus, leaves."""

    off_axis: bool = True
    weighted: bool = True
    fine_refinements: int = 2
    drop_wrapped: bool = True


class ThreeTonePlusConfig(_Plus, ThreeToneConfig):
    """3-FSK with every improvement."""


class LadderPlusConfig(_Plus, LadderConfig):
    """The ladder with every improvement."""


class SubvoxelConfig(BroadbandConfig):
    """Broadband with depths between voxels."""

    subvoxel: bool = True


def _preset(id: str, config: type[Config], summary: str, source: str = OURS, base: str | None = None) -> None:
    @register(id, config, summary, source, base)
    def run(capture: RadarCapture, config: AnyConfig | ProjectionConfig, frame: int) -> Reconstruction:
        if isinstance(config, FskConfig):
            return Reconstruction(replace(n_tone(capture, config, frame), method=id))
        depth = project(capture, config, id, frame)
        return Reconstruction(depth, lambda: volume(capture, config, frame), config.grid().z_m)


_preset("2fsk", TwoToneConfig, "depth from the phase between images at two tones", PAPER)
_preset("3fsk", ThreeToneConfig, "2-FSK, then a third tone far away corrects every pixel", PAPER)
_preset("broadband", BroadbandConfig, "backprojected volume of 128 tones, maximum intensity projection", PAPER)
_preset("narrowband", NarrowbandConfig, "the same with the three 3-FSK tones", PAPER)

_preset("3fsk-offaxis", OffAxisConfig, "3-FSK with the path's true derivative instead of 2", base="3fsk")
_preset("3fsk-weighted", WeightedConfig, "3-FSK with filters that weigh pixels with their power", base="3fsk")
_preset("3fsk-plus", ThreeTonePlusConfig, "both, refined twice, without what may have wrapped", base="3fsk")
_preset("nfsk", LadderConfig, "a ladder of tones, each further away, corrects every pixel in turn")
_preset("nfsk-plus", LadderPlusConfig, "the ladder with all that 3fsk-plus has", base="nfsk")
_preset("broadband-subvoxel", SubvoxelConfig, "broadband with depths between voxels", base="broadband")
