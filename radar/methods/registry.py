"""The methods that turn echoes into depth maps: one table of named settings of four functions.

A variant is one more line here, or an entry of a benchmark with a `name` and a `config`.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

from handbench.radar.data.capture import RadarCapture
from handbench.radar.data.depthmap import DepthMap
from handbench.radar.methods.alignment import Aligned, Joint, broadband_aligned, joint
from handbench.radar.methods.backprojection import Backprojection, backprojection
from handbench.radar.methods.depth_uncertainty import fsk_with_uncertainty
from handbench.radar.methods.fsk import Fsk
from handbench.radar.methods.settings import MethodSettings
from handbench.support.config import parse, suggest
from handbench.support.errors import HandbenchError
from handbench.support.parallel import one_blas_thread

PAPER = (
    "Bräunig et al., An Efficient yet High-Performance Method for Precise Radar-Based "
    "Imaging of Human Hand Poses"
)
OURS = f"handbench (docs/methods.md), after {PAPER}"
PAIR_HZ = (82.0e9, 81.8e9)
THREE_HZ = (*PAIR_HZ, 79.5e9)
LADDER_HZ = (*PAIR_HZ, 81.3e9, 79.5e9, 72.0e9)


@dataclass(frozen=True)
class Method:
    """A method: its id, its name in tables, a line that describes it, its settings with their
    defaults, and its function (capture, settings, frame) → `DepthMap`.

    source: publication or page that describes it.
    """

    id: str
    title: str
    summary: str
    function: Callable[[RadarCapture, Any, int], DepthMap]
    defaults: MethodSettings
    source: str = OURS

    def configure(self, values: dict[str, Any], where: str) -> MethodSettings:
        """Return the method's settings with these plain values, by name; the others have their
        defaults. where: origin of the values, named in error messages. Raises HandbenchError for
        unknown names and invalid values."""
        return parse(type(self.defaults), {**self.defaults.model_dump(), **values}, where)

    def run(self, capture: RadarCapture, settings: MethodSettings, frame: int = 0) -> DepthMap:
        """Image a frame of a capture: its depth map."""
        with one_blas_thread():  # or the last digits would depend on the number of cores
            return replace(self.function(capture, settings, frame), method=self.id)


def _plus(tones_hz: tuple[float, ...]) -> Fsk:
    """All improvements. The second refinement corrects the errors of the first one, which is out of
    focus."""
    return Fsk(tones_hz=tones_hz, off_axis=True, weighted=True, refinements=2, drop_doubtful=True)


_fsk = fsk_with_uncertainty
METHODS = {
    method.id: method
    for method in (
        Method(
            "2fsk",
            "2-FSK",
            "phase between the images of two tones",
            _fsk,
            Fsk(tones_hz=PAIR_HZ, filter_px=1),
            PAPER,
        ),
        Method(
            "3fsk", "3-FSK", "2-FSK, corrected at every pixel by a third tone", _fsk, Fsk(), PAPER
        ),
        Method(
            "broadband",
            "broadband",
            "strongest voxels of a volume of 128 tones",
            backprojection,
            Backprojection(),
            PAPER,
        ),
        Method(
            "narrowband",
            "narrowband",
            "the same with the three tones of 3-FSK",
            backprojection,
            Backprojection(tones_hz=THREE_HZ, tolerance=1e-5),
            PAPER,
        ),
        Method(
            "3fsk-offaxis",
            "3-FSK off-axis",
            "3-FSK with the path's true derivative",
            _fsk,
            Fsk(off_axis=True),
        ),
        Method(
            "3fsk-weighted",
            "3-FSK weighted",
            "3-FSK with filters weighted by power",
            _fsk,
            Fsk(weighted=True),
        ),
        Method(
            "3fsk-plus",
            "3-FSK plus",
            "both, refined twice, without wrapped pixels",
            _fsk,
            _plus(THREE_HZ),
        ),
        Method(
            "nfsk",
            "ladder",
            "ladder: each further tone corrects every pixel",
            _fsk,
            Fsk(tones_hz=LADDER_HZ),
        ),
        Method(
            "nfsk-plus",
            "ladder plus",
            "the ladder with all that 3fsk-plus has",
            _fsk,
            _plus(LADDER_HZ),
        ),
        Method(
            "2fsk-doppler",
            "2-FSK Doppler",
            "2-FSK of a moving target, with its velocity",
            _fsk,
            Fsk(tones_hz=PAIR_HZ, filter_px=1, doppler=True),
        ),
        Method(
            "3fsk-doppler",
            "3-FSK Doppler",
            "3-FSK of a moving target, with its velocity",
            _fsk,
            Fsk(doppler=True),
        ),
        Method(
            "nfsk-doppler",
            "ladder Doppler",
            "ladder of a moving target, with its velocity",
            _fsk,
            Fsk(tones_hz=LADDER_HZ, doppler=True),
        ),
        Method(
            "broadband-subvoxel",
            "broadband sub-voxel",
            "broadband with depths between voxels",
            backprojection,
            Backprojection(subvoxel=True),
        ),
        Method(
            "broadband-aligned",
            "broadband aligned",
            "broadband, depths where the tones' phases agree",
            broadband_aligned,
            Aligned(),
        ),
        Method("joint", "joint", "the depth at which any number of tones agree", joint, Joint()),
    )
}


def method(id: str) -> Method:
    """Return the method with this id. Raises HandbenchError for an unknown one."""
    if id not in METHODS:
        raise HandbenchError(f"method: unknown id '{id}'; {suggest(id, list(METHODS))}")
    return METHODS[id]


def titles() -> dict[str, str]:
    """Return the names of all methods in tables: id → title."""
    return {method.id: method.title for method in METHODS.values()}
