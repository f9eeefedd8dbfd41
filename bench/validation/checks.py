"""Checks of data that can be read without error, but are likely to be wrong: each yields sentences
with the likely mistake and its remedy. A `Report` collects them, and what cannot be read.

The checks of one kind of thing are a tuple of functions. None needs an image; capture_warnings.py
has those that do.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np

from handbench.bench.datasets.native import FAR_M, CaptureFile
from handbench.bench.stages.image import places_m
from handbench.radar.data.arrays import AntennaArray
from handbench.radar.data.capture import scaled_to_one
from handbench.radar.data.depthmap import FLAGGED
from handbench.radar.methods.evidence import (
    channel_problems,
    leakage_problems,
    lost_problems,
    pair_problems,
    shortest_m,
)
from handbench.support.errors import HandbenchError, printable

if TYPE_CHECKING:
    from handbench.bench.results.result_folder import Result
    from handbench.calibration.transforms import Transform
    from handbench.groundtruth.mesh.surface import Surface
    from handbench.radar.data.capture import RadarCapture
    from handbench.radar.data.depthmap import DepthMap

LOWEST_HZ = 3e8  # of radars whose arrays have a size in metres
# of an array's extent; beyond, it is most likely in another unit
MOST_WAVELENGTHS = 1000.0
LEAST_WAVELENGTHS = 0.25
FEWEST_PLACES = 4  # antennas that may span less than LEAST_WAVELENGTHS
FLAT = 0.05  # of an array's largest extent: thinner, it is a plane
FEWEST_IN_ORDER = 8  # antennas, fewer of which may be similar by chance
SIMILAR = 0.7  # coherence that two antennas' echoes of a large target have only side by side
SMALL_M = 5e-3  # a surface that small is likelier in another unit
OPEN_PERCENT = 10  # of a surface's edges at its rim
# of an image that nothing near a hand fills, if it is that wide and high
CROWDED_PERCENT = 50
WIDE_M = 0.1
LOUDEST_DB = 0.01  # of a depth map, where rounding may add to 0
FAR_PERCENT = 10  # of the distance: a mean error that large is none of a surface in sight
FARTHEST_MM = 50.0  # mean error of what may still be an image
CURE = (
    "check that map and surface are in metres and in the radar's frame; a surface in the "
    "photographs' frame needs its transform (--transform)"
)

Thing = TypeVar("Thing")


def warnings_of(thing: Thing, checks: Sequence[Callable[[Thing], Iterator[str]]]) -> Iterator[str]:
    """Yield the sentences of all checks of a thing."""
    return (text for check in checks for text in check(thing))


def units_of_array(capture: RadarCapture) -> Iterator[str]:
    """Check that the tones are in hertz and the positions in metres; positions in millimetres are
    refused (`require_near`)."""
    places = places_m(capture)
    extent_m = float(np.ptp(places, axis=0).max())
    highest_hz = float(capture.frequencies_hz.max())
    waves = extent_m * highest_hz / capture.wave_speed_m_s
    if highest_hz < LOWEST_HZ:
        yield (
            f"its highest frequency is only {highest_hz:g} Hz; if the frequencies are in "
            "gigahertz, megahertz or kilohertz, multiply them by 1e9, 1e6 or 1e3"
        )
    elif (
        np.abs(places).max() <= FAR_M
        and len(places) > FEWEST_PLACES
        and not (LEAST_WAVELENGTHS < waves < MOST_WAVELENGTHS)
    ):
        yield (
            f"its antennas span {extent_m:g} m, {waves:.2g} wavelengths at {highest_hz:g} Hz; "
            "check that the positions are in metres and the frequencies in hertz"
        )


def facing(capture: RadarCapture) -> Iterator[str]:
    """Check that the array faces z."""
    extent_m = np.ptp(places_m(capture), axis=0)
    flat = int(extent_m.argmin())
    if flat != 2 and extent_m[flat] < FLAT * extent_m.max() < extent_m[2]:
        yield (
            f"the array is in the plane of {'xy'[1 - flat]} and z, so it faces {'xy'[flat]}, but "
            "z must point away from the array; exchange the axes"
        )


def order_of_antennas(capture: RadarCapture) -> Iterator[str]:
    """Check that neighbours in a dense array have more similar echoes than any two antennas, if the
    target is so large that only antennas close to each other can have similar ones."""
    array, samples = capture.aperture, scaled_to_one(capture.samples[0])
    if not isinstance(array, AntennaArray):
        return
    for axis, name in enumerate(("tx_m", "rx_m"), 1):
        places_m = getattr(array, name)
        if len(places_m) < FEWEST_IN_ORDER:
            continue
        apart_m = np.linalg.norm(places_m[:, None] - places_m, axis=2)
        nearest = np.argsort(apart_m)[:, 1:2]
        with np.errstate(invalid="ignore"):  # of dead antennas
            rows = np.moveaxis(samples, axis, 0).reshape(len(places_m), -1)
            similar = np.nan_to_num(np.abs(np.corrcoef(rows))) - np.eye(len(rows))
        best = np.median(similar.max(axis=1))
        neighbours = np.median(np.take_along_axis(similar, nearest, 1))
        dense = np.median(np.take_along_axis(apart_m, nearest, 1)) <= shortest_m(capture)
        if dense and best > SIMILAR and max(neighbours, similar.mean()) < best / 2:
            yield (
                f"{name}: the echoes of neighbours are no more similar than those of any two "
                f"antennas (coherence {neighbours:.2f}), but others' are ({best:.2f}); check that "
                "positions and samples have the same order"
            )


def missing_frames(capture: RadarCapture, asked: int | None) -> Iterator[str]:
    """Yield a sentence if fewer frames were recorded than are asked for."""
    if asked and (count := len(capture.samples)) < asked:
        yield (
            f"has {count} of {asked} frames; record the others, or, without precision, write "
            'measures = ["accuracy"] in its [[capture]]'
        )


ARRAY = (units_of_array, facing, order_of_antennas, lost_problems, leakage_problems)
CHANNELS = (*ARRAY, channel_problems, pair_problems)


def lengths(about: CaptureFile) -> Iterator[str]:
    """Check that a capture's description is in metres."""
    far_m = max(map(abs, (about.distance_m or 0.0, *(about.box_m or ()))))
    if far_m > FAR_M:
        yield f"distance_m or box_m reaches {far_m:g} m; check that it is in metres"


def size(surface: Surface) -> Iterator[str]:
    """Check that a surface is in metres."""
    longest_m = float(np.ptp(surface.vertices_m[np.unique(surface.faces)], axis=0).max())
    if not SMALL_M <= longest_m <= FAR_M:
        yield (
            f"is {longest_m:.3g} m long; if it is not in metres, convert it with `handbench "
            "groundtruth --unit`"
        )


def closed(surface: Surface) -> Iterator[str]:
    """Check that a surface has no holes and, if it is closed, is not inside out."""
    edges = np.sort(surface.faces[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1)
    rim_percent = 100 * float((np.unique(edges, axis=0, return_counts=True)[1] == 1).mean())
    a, b, c = np.moveaxis(surface.vertices_m[surface.faces], 1, 0)
    if rim_percent > OPEN_PERCENT:
        yield (
            f"{rim_percent:.0f} % of its edges belong to only one triangle; fill its holes, or "
            "merge equal vertices"
        )
    elif rim_percent == 0 and np.einsum("ij,ij->", a, np.cross(b, c)) < 0:
        yield "its triangles are inside out; reverse the order of the vertices of each triangle"


MESH = (size, closed)


def transform_warnings(transform: Transform, mesh: Surface | None) -> Iterator[str]:
    """Check the translation and the scale of a transform to the radar frame, and that it does not
    move the mesh behind the radar."""
    offset_m = float(np.abs(transform.matrix[:3, 3]).max())
    if offset_m > FAR_M:
        yield f"it moves points by {offset_m:g} m; check that its translation is in metres"
    if not 0.5 < abs(transform.scale) < 2:
        yield f"its scale is {transform.scale:g}; check that both frames are in metres"
    if mesh is not None and (transform.points(mesh.vertices_m)[:, 2] <= 0).all():
        yield (
            "it moves all of mesh.ply behind the radar; check that it is not the inverse transform"
        )


def focus(depth: DepthMap) -> Iterator[str]:
    """Check that only a part of a depth map's pixels has a depth, and that the others are NaN."""
    if (depth.z_m <= 0).any():
        return  # of which `flags` warns
    percent = 100 * float(np.isfinite(depth.z_m).mean())
    if percent > CROWDED_PERCENT and min(np.ptp(depth.x_m), np.ptp(depth.y_m)) >= WIDE_M:
        yield (
            f"{percent:.0f} % of the pixels of the image have a depth, so it may be out of focus; "
            "check the tones, the positions of the antennas and the sign of the samples"
        )


def depths(depth: DepthMap) -> Iterator[str]:
    """Check that depths and axes are in metres."""
    if np.nanmax(np.abs(np.r_[depth.x_m, depth.y_m, depth.z_m.flat])) > FAR_M:
        yield (
            f"it has lengths of more than {FAR_M:g} m; if they are in millimetres, multiply them "
            "by 1e-3"
        )


def decibels(depth: DepthMap) -> Iterator[str]:
    """Check that amplitudes are in dB below the largest."""
    if (most := np.nanmax(depth.amplitude_db, initial=-np.inf)) > LOUDEST_DB:
        yield (
            f"amplitude_db is up to {most:.3g}, but is 0 at the strongest pixel; if it has linear "
            "amplitudes a, write 20·log10(a / max a)"
        )


def flags(depth: DepthMap) -> Iterator[str]:
    """Check that all depths are in front of the radar, and most not in doubt."""
    return doubt([depth])


MAP = (focus, depths, decibels, flags)


def figure_warnings(values: Mapping[str, float | int | None]) -> Iterator[str]:
    """Check that the scores of a depth map against a surface are plausible. values: metric →
    value."""
    mean_mm, accuracy = values["mae_mm"], values["relative_accuracy_percent"]
    if accuracy is None:
        yield f"no pixel of the depth map is in front of or behind the surface; {CURE}"
    elif accuracy < 100 - FAR_PERCENT:
        yield (
            f"the mean error, {mean_mm:.3g} mm, is larger than {FAR_PERCENT} % of the distance; "
            f"{CURE}"
        )


def result_warnings(result: Result) -> Iterator[str]:
    """Yield the warnings that a run recorded, its failures, and the figures that no image has."""
    for capture, texts in result.about.facts.get("warnings", {}).items():
        yield from (f"{capture}: {text}" for text in texts)
    yield from (failure.line for failure in result.about.failures)
    far = result.table[(result.table.metric == "mae_mm") & (result.table.value > FARTHEST_MM)]
    for row in far.itertuples():
        yield f"{row.method}: the mean error is {row.value:.4g} mm; check units and transforms"


def doubt(depths: Iterable[DepthMap]) -> Iterator[str]:
    """Yield a sentence if depths of a method's maps are 0 or less, and one if most are in doubt."""
    seen, doubtful, zeros = _counts(depths)
    if not seen:
        yield "no pixel has a depth; check the threshold, the first depth and the grid"
    if zeros:
        yield f"{zeros} depths are 0 or less, where no target is; no depth is written as NaN"
    if (percent := 100 * doubtful / max(seen, 1)) > CROWDED_PERCENT:
        yield (
            f"{percent:.0f} % of the pixels with a depth are in doubt: likelier wrong than right "
            f"(p_gross > {FLAGGED:g}), or flagged as wrapped"
        )


def _counts(depths: Iterable[DepthMap]) -> list[int]:
    """Return how many pixels of depth maps have a depth, one in doubt, and one of 0 or less."""
    counts = np.zeros(3, int)
    for depth in depths:
        counts += [of.sum() for of in (np.isfinite(depth.z_m), depth.doubtful, depth.z_m <= 0)]
    return counts.tolist()


def on_target(depth: DepthMap) -> str:
    """Return a text with the number of pixels of a depth map that have a depth, their median, and
    the share of them that is in doubt."""
    seen, doubtful, _ = _counts([depth])
    if not seen:
        return "no pixel on target"
    median_m, percent = np.nanmedian(depth.z_m), 100 * doubtful / seen
    return f"{seen} pixels on target at {median_m:.3g} m, {percent:.1f} % of them in doubt"


class Report:
    """The problems and warnings of an input. lines: text → whether it is only a warning, in the
    order in which they were found. notes: what the input can show, which is no mistake."""

    def __init__(self) -> None:
        self.lines: dict[str, bool] = {}
        self.notes: list[str] = []

    def read(
        self, place: Path | str, reader: Callable[..., Thing], *arguments: Any
    ) -> Thing | None:
        """Call `reader` with the arguments and return its result. If it raises a HandbenchError,
        add all problems in it, and return None. place: the file or folder that is read."""
        try:
            return reader(*arguments)
        except HandbenchError as error:
            self.refuse(place, *error.problems)
            return None

    def refuse(self, place: Path | str, *problems: str) -> None:
        """Add problems of a file or folder, with which a run would fail."""
        for text in problems:
            named = text.startswith((f"{printable(str(place))}: ", f"{place}/"))
            self.lines[text if named else f"{place}: {text}"] = False

    def warn(self, place: Path, warnings: Iterable[str]) -> None:
        """Add warnings about a file or folder."""
        for text in warnings:
            self.lines[f"{place}: warning: {text}"] = True

    def check(
        self, place: Path, thing: Thing | None, checks: Sequence[Callable[[Thing], Iterator[str]]]
    ) -> None:
        """Add the warnings of checks of a thing that was read from a file or folder (None: it could
        not be read)."""
        if thing is not None:
            self.warn(place, warnings_of(thing, checks))
