"""Warnings about the data of a capture or an image that can be read without error: sentences with
the likely mistake and its remedy.

No mistake is certain. All checks take little time compared with the hours that wrong data cost.
"""

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np

from handbench.bench.datasets.dataset import open_capture
from handbench.bench.datasets.native import FAR_M, INSPECTION, NativeCapture
from handbench.bench.pipeline.image import configuration
from handbench.bench.validation import mistakes
from handbench.bench.validation.checks import array_warnings, map_warnings
from handbench.groundtruth.mesh.surface import Surface, read_surface
from handbench.radar.data.arrays import AntennaArray
from handbench.radar.data.capture import RadarCapture
from handbench.radar.data.depthmap import DepthMap
from handbench.radar.imaging.plan import fresh_plans
from handbench.radar.methods.advice import motion_notes
from handbench.radar.methods.depth_uncertainty import with_p_gross
from handbench.radar.methods.registry import method
from handbench.radar.warmup import compile_kernels
from handbench.support.config import Config
from handbench.support.errors import HandbenchError
from handbench.support.files import write_json
from handbench.support.progress import say
from handbench.support.store import stage

# share of pixels on the surface with which a mistake explains an image; and of the best other share
EXPLAINED = 0.9
FIRST = "first_depth_m"  # first depth of methods that have one
# begun from there, the tones of PROBES reach what they do not from their own first depth
FURTHER_M = 1.2
# the first whose tones were measured is held against a surface
PROBES = ("3fsk", "2fsk", "broadband", "narrowband")


@stage(
    "inspect",
    "bench/validation",
    "bench/datasets",
    "bench/pipeline/image.py",
    "calibration",
    "groundtruth/mesh",
    "radar",
)
def inspect_capture(folder: Path, capture: str) -> None:
    """Inspect a capture for likely mistakes, as a stage of a run: print each warning, and write all
    to the file INSPECTION.

    A capture that cannot be read gets no warning, because the stages that need it report the error.
    """
    with fresh_plans():  # those of the imaging stages are timed
        try:
            warnings = list(warnings_of_capture(open_capture(capture)))
        except HandbenchError:
            warnings = []
    for warning in warnings:
        say(f"{capture}: {warning}")
    write_json(folder / INSPECTION, {"doubts": warnings})


def warnings_of_capture(recorded: NativeCapture) -> Iterator[str]:
    """Yield warnings about a capture: about its array and tones, whether its echoes focus when they
    are imaged and, if it has a surface, whether image and surface agree."""
    capture = recorded.echoes(1)
    plain = list(array_warnings(capture))
    yield from plain
    if plain:
        return  # all that follows would be about these
    compile_kernels()
    yield from recorded.warnings()
    surface, imaged = surface_of(recorded), _depth_map(recorded, capture)
    if imaged is not None:
        moves = list(motion_notes(imaged[0], capture, imaged[1]))
        yield from moves
        if moves:
            return  # the motion explains why the image is not on its surface
    as_is = mistakes.fit(imaged[0], surface) if surface is not None and imaged is not None else None
    if as_is is not None and not as_is.improvable:
        return  # the image is on its surface: no further check
    wrong = mistakes.conjugation_warnings(capture)
    yield from wrong
    if wrong or imaged is None:
        return
    depth, config = imaged
    yield from map_warnings(with_p_gross(depth, capture, config))
    if surface is None or as_is is None:
        return
    start_m = float(np.median(surface.vertices_m[:, 2]))
    near, _ = _depth_map(recorded, capture, start_m) or imaged
    found = mistakes.fit(near, surface)
    if found.covers and found.explains(as_is):
        begun = (
            f"{depth.method} images depths from {getattr(config, FIRST):g} m, but a surface is "
            f"{start_m:.2g} m away"
        )
        yield f"{begun}: {FIRST}={start_m:.2g} finds it"
        return
    # since the surface's distance may be the mistake
    further, _ = _depth_map(recorded, capture, FURTHER_M) or imaged
    yield from _likely_mistake(recorded, capture, surface, (depth, near, further), start_m)


def _likely_mistake(
    recorded: NativeCapture,
    capture: RadarCapture,
    surface: Surface,
    depths: tuple[DepthMap, ...],
    start_m: float,
) -> list[str]:
    """Find the mistake that best explains why the images of a capture are not on its surface: a
    list of one sentence, or an empty list.

    capture: echoes of the first frame; depths: its depth maps, with different first depths;
    start_m: distance of the surface. A mistake in the order of the data, such as exchanged
    antennas, is named in one sentence with a wrong frame that explains the images as well. Mistakes
    in tones and path lengths are tried only if no wrong frame or unit explains the images.
    """
    as_is = max((mistakes.fit(depth, surface) for depth in depths), key=lambda fit: fit.share)
    share, moved = max(
        (mistakes.best(depth, surface, as_is) for depth in depths), key=lambda best: best[0]
    )
    found: dict[str, float] = {}
    for name, cure, undone, scale in _corrections(capture, every=share < EXPLAINED):
        image = _depth_map(recorded, undone, scale * start_m)
        fitted = (
            mistakes.fit(image[0], mistakes.moved(surface, scale * np.eye(3))) if image else as_is
        )
        if fitted.explains(as_is):
            text = (
                f"with {name} the median error falls from {as_is.median_mm:.2f} to "
                f"{fitted.median_mm / scale:.2f} mm"
            )
            found[f"{text}: {cure}"] = fitted.share
    text = max(found, key=lambda text: found[text], default="")
    if not text or found[text] < EXPLAINED * share:
        return moved
    return [f"{text}; or {moved[0]}"] if EXPLAINED * found[text] < share else [text]


def _corrections(
    capture: RadarCapture, every: bool
) -> Iterator[tuple[str, str, RadarCapture, float]]:
    """Yield corrections of possible mistakes in the order and the phases of a capture's data: (name
    of the mistake, remedy, corrected capture, scale).

    scale: factor by which the scene is larger after the correction, since phases do not distinguish
    half the path from half the scene. every: also try mistakes in tones and path lengths.
    """
    array = capture.aperture
    if isinstance(array, AntennaArray) and len(array.tx_m) == len(array.rx_m):
        exchanged = replace(capture, aperture=AntennaArray(array.rx_m, array.tx_m))
        yield (
            "tx and rx exchanged",
            "exchange tx_m and rx_m, or these axes of the samples",
            exchanged,
            1.0,
        )
    if not every:
        return
    in_order = replace(capture, samples=capture.samples[:, ::-1])
    yield (
        "the tones in reverse order",
        "reverse frequencies_hz, or the frequency axis of the samples",
        in_order,
        1.0,
    )
    for scale, once, change in (
        (0.5, "one way only", "halve"),
        (2.0, "there and back twice", "double"),
    ):
        places = {
            name: scale * values for name, values in vars(array).items() if name.endswith("_m")
        }
        scaled = replace(capture, aperture=replace(array, **places))
        yield (
            f"a path counted {once}",
            f"each path must be counted there and back, once; check the samples, or {change} "
            "frequencies_hz",
            scaled,
            scale,
        )


def warnings_of_image(depth: DepthMap, capture: RadarCapture) -> Iterator[str]:
    """Yield warnings about a depth map. If there are any, also test whether the echoes it was
    imaged from are conjugated, and yield a warning if they are."""
    about = list(map_warnings(depth))
    yield from about
    try:
        yield from mistakes.conjugation_warnings(capture) if about else ()
    except HandbenchError:  # a failed check takes no result away
        return


def surface_of(recorded: NativeCapture) -> Surface | None:
    """Return a capture's surface in the radar frame: the true one, else the measured one if the
    capture has the transform of its frame; None if it has neither."""
    if recorded.truth is not None:
        return read_surface(recorded.truth)
    mesh, transform = recorded.mesh(), recorded.transform()
    if mesh is None or transform is None:
        return None
    return read_surface(mesh).moved(transform)


def _depth_map(
    recorded: NativeCapture, capture: RadarCapture, first_depth_m: float | None = None
) -> tuple[DepthMap, Config] | None:
    """Image a capture by the first method of PROBES that can use its tones: (depth map,
    configuration); None if no method can.

    first_depth_m: first depth for methods that have this setting (None: their default).
    """
    for name in PROBES:
        begun = first_depth_m is not None and 0 < first_depth_m < FAR_M
        begun = begun and FIRST in method(name).config.model_fields
        config = configuration(recorded.folder, name, {FIRST: first_depth_m} if begun else {})
        try:
            return method(name).run(capture, config, 0).depth, config
        except HandbenchError:
            continue
    return None
