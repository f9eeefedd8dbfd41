"""Warnings about a capture that need an image of it: sentences with the likely mistake and its
remedy. The stage `inspect` of a run records them.

No mistake is certain. All checks take little time compared with the hours that wrong data cost.
"""

from collections import defaultdict
from collections.abc import Iterable, Iterator
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from handbench.bench.datasets.dataset import open_capture
from handbench.bench.datasets.native import FAR_M, INSPECTION, NativeCapture
from handbench.bench.stages.image import configuration, require_near
from handbench.bench.validation.checks import ARRAY, MAP, doubt, missing_frames, warnings_of
from handbench.bench.validation.mistakes import (
    GOOD_MM,
    conjugation_warnings,
    error_mm,
    order_warnings,
    step_warnings,
)
from handbench.radar.data.capture import RadarCapture
from handbench.radar.data.depthmap import DepthMap, load_depthmap
from handbench.radar.imaging.plan import fresh_plans
from handbench.radar.methods.evidence import frame_problems
from handbench.radar.methods.fsk import Fsk
from handbench.radar.methods.gross_errors import with_p_gross
from handbench.radar.methods.registry import method
from handbench.radar.methods.settings import MethodSettings
from handbench.support.errors import HandbenchError
from handbench.support.files import write_json
from handbench.support.progress import say
from handbench.support.store import stage

FIRST = "first_depth_m"  # first depth of methods that have one
# the first whose tones were measured images the capture, without its motion if a tone is repeated
PROBES = ("3fsk-doppler", "2fsk-doppler", "3fsk", "2fsk", "broadband", "narrowband")


@stage(
    "inspect",
    "bench/validation",
    "bench/datasets",
    "bench/stages/image.py",
    "calibration",
    "groundtruth/mesh",
    "radar",
)
def inspect_capture(folder: Path, capture: str, frames: int) -> None:
    """Inspect the first frames of a capture for likely mistakes, as a stage of a run: print each
    warning, and write all to the file INSPECTION.

    A capture that cannot be read gets no warning, because the stages that need it report the error.
    """
    with fresh_plans():  # those of the imaging stages are timed
        try:
            warnings = list(capture_warnings(open_capture(capture), frames))
        except HandbenchError:
            warnings = []
    for warning in warnings:
        say(f"{capture}: {warning}")
    write_json(folder / INSPECTION, {"warnings": warnings})


def method_warnings(maps: Iterable[tuple[str, Path]]) -> dict[str, list[str]]:
    """Warn of methods most of whose depths are in doubt: print and return the warnings, method →
    texts. maps: each method with the file of one of its depth maps."""
    files = defaultdict[str, list[Path]](list)
    for name, file in maps:
        files[name].append(file)
    warnings = {name: [*doubt(map(load_depthmap, of))] for name, of in files.items()}
    for name, text in ((name, text) for name, texts in warnings.items() for text in texts):
        say(f"{name}: {text}")
    return {name: texts for name, texts in warnings.items() if texts}


def capture_warnings(recorded: NativeCapture, frames: int = 1) -> Iterator[str]:
    """Yield warnings about the first frames of a capture: about its array, tones and frames,
    whether its echoes focus when they are imaged and, if it has a surface, whether image and
    surface agree."""
    echoes = require_near(recorded.echoes(frames))
    yield from missing_frames(echoes, frames)
    yield from frame_problems(echoes.samples)
    plain = list(warnings_of(echoes, ARRAY))
    yield from plain
    if plain or not echoes.samples[0].any():
        return  # all that follows would be about these
    yield from recorded.warnings()
    yield from step_warnings(echoes)
    surface = recorded.surface()
    start_m = 0.0 if surface is None else float(np.median(surface.vertices_m[:, 2]))
    begun = {FIRST: start_m} if 0 < start_m < FAR_M else {}
    image = partial(_depth_map, recorded.folder, begun)
    imaged = image(echoes)
    as_is_mm = np.inf if imaged is None or surface is None else error_mm(imaged[0], surface)
    if as_is_mm <= GOOD_MM:
        return  # the image is on its surface: no further check
    conjugated = list(conjugation_warnings(echoes))
    yield from conjugated
    if conjugated or imaged is None:
        return
    yield from warnings_of(with_p_gross(imaged[0], echoes, imaged[1]), MAP)
    if surface is not None:
        yield from order_warnings(echoes, image, surface, as_is_mm)


def _depth_map(
    folder: Path, begun: dict[str, Any], capture: RadarCapture
) -> tuple[DepthMap, MethodSettings] | None:
    """Image a capture by the first method of PROBES that can use its tones: (depth map,
    configuration); None if no method can. begun: the first depth, for methods that have one."""
    for name in PROBES:
        begun_here = begun if isinstance(method(name).defaults, Fsk) else {}
        config = configuration(folder, name, begun_here)
        try:
            return method(name).run(capture, config, 0), config
        except HandbenchError:
            continue
    return None
