"""The built-in methods, registered by id: the paper's four and improved variants of them.

Most are one of a few functions with different default parameters. The code of a method is imported
when it runs, so that listing the methods is fast.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Annotated, Any

from pydantic import Field, create_model

from handbench.radar.data.capture import RadarCapture
from handbench.radar.methods.fsk_config import (
    AnyConfig,
    JointConfig,
    LadderConfig,
    ThreeToneConfig,
    TwoToneConfig,
)
from handbench.radar.methods.projection_config import (
    AlignedConfig,
    BroadbandConfig,
    NarrowbandConfig,
    ProjectionConfig,
)
from handbench.radar.methods.registry import PAPER, Reconstruction, register
from handbench.support.config import Config

OURS = f"handbench (docs/methods.md), after {PAPER}"
# All improvements. The second refinement corrects the errors of the first one, which is out of
# focus.
PLUS: dict[str, Any] = {
    "off_axis": True,
    "weighted": True,
    "fine_refinements": 2,
    "drop_wrapped": True,
}


def _fsk(capture: RadarCapture, config: AnyConfig, frame: int, id: str) -> Reconstruction:
    from handbench.radar.methods.depth_uncertainty import fsk_with_uncertainty

    return Reconstruction(replace(fsk_with_uncertainty(capture, config, frame), method=id))


def _mip(capture: RadarCapture, config: ProjectionConfig, frame: int, id: str) -> Reconstruction:
    from handbench.radar.methods.projection import project, volume

    depth = project(capture, config, id, frame)
    return Reconstruction(depth, lambda: volume(capture, config, frame), config.grid().z_m)


def _preset(
    make: Callable[[RadarCapture, Any, int, str], Reconstruction],
    id: str,
    title: str,
    config: type[Config],
    summary: str,
    source: str = OURS,
    **defaults: bool | float | str,
) -> None:
    """Register the method `id`, which runs make(capture, config, frame, id).

    config: class of its configuration; defaults: values that replace this class's own. If the id
    ends in -word, the part before it is the id of the method that this is a variant of.
    """
    if defaults:
        known = config.model_fields  # whose limits hold on
        fields: dict[str, Any] = {
            k: (
                Annotated[
                    known[k].annotation, *known[k].metadata, Field(description=known[k].description)
                ],
                v,
            )
            for k, v in defaults.items()
        }
        config = create_model(config.__name__, __base__=config, **fields)

    @register(id, config, summary, source, base=id.rpartition("-")[0] or None, title=title)
    def run(capture: RadarCapture, config: Config, frame: int) -> Reconstruction:
        return make(capture, config, frame, id)


_preset(_fsk, "2fsk", "2-FSK", TwoToneConfig, "phase between the images of two tones", PAPER)
_preset(
    _fsk, "3fsk", "3-FSK", ThreeToneConfig, "2-FSK, corrected at every pixel by a third tone", PAPER
)
_preset(
    _mip,
    "broadband",
    "broadband",
    BroadbandConfig,
    "strongest voxels of a volume of 128 tones",
    PAPER,
)
_preset(
    _mip,
    "narrowband",
    "narrowband",
    NarrowbandConfig,
    "the same with the three tones of 3-FSK",
    PAPER,
)

_preset(
    _fsk,
    "3fsk-offaxis",
    "3-FSK off-axis",
    ThreeToneConfig,
    "3-FSK with the path's true derivative",
    off_axis=True,
)
_preset(
    _fsk,
    "3fsk-weighted",
    "3-FSK weighted",
    ThreeToneConfig,
    "3-FSK with filters weighted by power",
    weighted=True,
)
_preset(
    _fsk,
    "3fsk-plus",
    "3-FSK plus",
    ThreeToneConfig,
    "both, refined twice, without wrapped pixels",
    **PLUS,
)
_preset(_fsk, "nfsk", "ladder", LadderConfig, "ladder: each further tone corrects every pixel")
for _id, _config, _of in (
    ("2fsk", TwoToneConfig, "2-FSK"),
    ("3fsk", ThreeToneConfig, "3-FSK"),
    ("nfsk", LadderConfig, "ladder"),
):
    _preset(
        _fsk,
        f"{_id}-doppler",
        f"{_of} Doppler",
        _config,
        f"{_of} of a moving target, with its velocity",
        doppler=True,
    )

_preset(
    _fsk, "nfsk-plus", "ladder plus", LadderConfig, "the ladder with all that 3fsk-plus has", **PLUS
)
_preset(
    _mip,
    "broadband-subvoxel",
    "broadband sub-voxel",
    BroadbandConfig,
    "broadband with depths between voxels",
    subvoxel=True,
    tolerance=1e-4,
)
_preset(
    _mip,
    "broadband-aligned",
    "broadband aligned",
    AlignedConfig,
    "broadband, depths where the tones' phases agree",
)


@register("joint", JointConfig, "the depth at which any number of tones agree", OURS)
def _joint(capture: RadarCapture, config: JointConfig, frame: int) -> Reconstruction:
    from handbench.radar.methods.alignment import joint

    return Reconstruction(joint(capture, config, frame))
