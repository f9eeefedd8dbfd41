"""Warnings about a capture that need an image of it: sentences with the likely mistake and its
remedy. The stage `inspect` of a run records them.

No mistake is certain. All checks take little time compared with the hours that wrong data cost.

Conjugation is tested without a reference. A coarse image is made of the echoes as they are, and one
of their conjugates; the sharper one is taken as right, by Σ|I|⁴ / (Σ|I|²)² (Muller & Buffington, J.
Opt. Soc. Am. 64 (1974) 1200). If none is, the middle of the aperture is imaged, with voxels as
small as its focus, and what is nearer than the aperture is wide among them. The order of antennas
and tones is tested with a surface: a corrected capture must bring the strongest pixels of the depth
map much nearer to it.
"""

from collections import defaultdict
from collections.abc import Callable, Iterable, Iterator
from contextlib import suppress
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from handbench.bench.datasets.dataset import open_capture
from handbench.bench.datasets.native import FAR_M, INSPECTION, CaptureFile, NativeCapture
from handbench.bench.stages.image import configured, places_m, require_near
from handbench.bench.validation.checks import ARRAY, MAP, doubt, missing_frames, warnings_of
from handbench.calibration.corrections import from_echoes
from handbench.groundtruth.mesh.depth import reference_on_grid
from handbench.groundtruth.mesh.surface import Surface
from handbench.radar.data.arrays import SPEED_OF_LIGHT_M_S, AntennaArray
from handbench.radar.data.capture import RadarCapture, even_subset, scaled_to_one, thin_antennas
from handbench.radar.data.depthmap import DepthMap, load_depthmap
from handbench.radar.data.grid import VoxelGrid
from handbench.radar.imaging.plan import fresh_plans
from handbench.radar.methods.evidence import frame_problems, shortest_m
from handbench.radar.methods.fsk import Fsk
from handbench.radar.methods.gross_errors import with_p_gross
from handbench.radar.methods.registry import method
from handbench.support.errors import HandbenchError
from handbench.support.files import write_json
from handbench.support.progress import warn
from handbench.support.store import stage

FIRST = "first_depth_m"  # first depth of methods that have one
# the first whose tones were measured images the capture, without its motion if a tone is repeated
PROBES = ("3fsk-doppler", "2fsk-doppler", "3fsk", "2fsk", "broadband", "narrowband")
# of conjugated echoes; of 29 scenes and hands, right ones were sharper by 1 to 22 dB, never blunter
SHARPER_DB = 3.0
# at most, of a kind and of a scan: more do not change which is sharpest
ANTENNAS = 32
POSITIONS = 200
TONES = 16
# an array deeper than this share of its width may surround its target; no conjugation is checked
SHALLOW = 0.3
MIDDLE = 7.0  # wavelengths from the middle of an aperture to the edge of the part imaged
# the box imaged, in apertures: to either side, and along z from and to
WIDE = 0.85
NEAR = 1.0
FAR = 8.0
PIXELS = 40
DEPTHS = 50
STRONGEST = 1500  # pixels that are compared: those with the largest amplitudes
WRONG_STEP = 0.05  # of a scan: what a point's range bends by otherwise, if it is known to 1e-3
GOOD_MM = 1.0  # median error of an image that needs no correction
NEAR_MM = 3.0  # of a corrected one, at most
FALLEN = 3.0  # how many times smaller it must then be
LOST_MM = 30.0  # median error of an image that does not show the surface at all


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
    warnings: list[str] = []
    with fresh_plans(), suppress(HandbenchError):  # the plans of the imaging stages are timed
        recorded = open_capture(capture)
        warnings = list(capture_warnings(recorded, frames))
        warn(recorded.about.name, warnings)
    write_json(folder / INSPECTION, {"warnings": warnings})


def method_warnings(maps: Iterable[tuple[str, Path]]) -> dict[str, list[str]]:
    """Warn of methods most of whose depths are in doubt, or some of which are none: print and
    return the warnings, method → texts.
    maps: each method with the file of one of its depth maps."""
    files = defaultdict[str, list[Path]](list)
    for name, file in maps:
        files[name].append(file)
    warnings = {name: [*doubt(map(load_depthmap, of))] for name, of in files.items()}
    for name, texts in warnings.items():
        warn(name, texts)
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
    start_m = float(np.median(surface.vertices_m[:, 2])) if surface else 0.0
    begun = {FIRST: start_m} if 0 < start_m < FAR_M else {}
    image = partial(_depth_map, recorded.about, begun)
    imaged = image(echoes)
    as_is_mm = error_mm(imaged, surface) if imaged and surface else np.inf
    if as_is_mm <= GOOD_MM:
        return  # the image is on its surface: no further check
    conjugated = list(conjugation_warnings(echoes))
    yield from conjugated
    if conjugated or imaged is None:
        return
    yield from warnings_of(imaged, MAP)
    if surface:
        yield from order_warnings(echoes, image, surface, as_is_mm)


def _depth_map(about: CaptureFile, begun: dict[str, Any], capture: RadarCapture) -> DepthMap | None:
    """Image a capture by the first method of PROBES that can use its tones; None if no method can.
    about: its description; begun: the first depth, for methods that have one."""
    for name in PROBES:
        begun_here = begun if isinstance(method(name).defaults, Fsk) else {}
        config = configured(about, name, begun_here)
        try:
            return with_p_gross(method(name).run(capture, config, 0), capture, config)
        except HandbenchError:
            continue
    return None


def conjugation_warnings(capture: RadarCapture) -> Iterator[str]:
    """Yield a warning if the echoes of the first frame focus better when they are conjugated.
    Arrays that may surround the target are not checked."""
    *across_m, deep_m = np.ptp(places_m(capture), axis=0)
    if not capture.samples[0].any() or deep_m > SHALLOW * max(across_m):
        return
    for part in _parts(capture):
        sharper_db = sharpness_db(replace(part, samples=part.samples.conj())) - sharpness_db(part)
        if sharper_db >= SHARPER_DB:
            farthest_m = FAR * np.ptp(places_m(part), axis=0).max()
            yield (
                f"the image of the conjugated echoes is {sharper_db:.0f} dB sharper; if the target "
                f"is within {farthest_m:.2g} m, conjugate the samples (the other sign "
                "in a mapping.toml, the other time in echoes.h5)"
            )
        if abs(sharper_db) >= SHARPER_DB:
            return


def _parts(capture: RadarCapture) -> Iterator[RadarCapture]:
    """Yield a capture, and the channels whose stops, or transmitters and receivers, are at most
    MIDDLE wavelengths beside the one that is next to the middle."""
    yield capture
    array, samples = capture.aperture, capture.samples
    if isinstance(array, AntennaArray):
        tx, rx = (_near_middle(capture, ends_m) for ends_m in (array.tx_m, array.rx_m))
        samples = samples[:, :, tx][..., rx]
    else:
        tx = rx = _near_middle(capture, (array.tx_m + array.rx_m) / 2)
        samples = samples[..., tx]
    if samples.size < capture.samples.size and samples[0].any():
        yield replace(
            capture, samples=samples, aperture=type(array)(array.tx_m[tx], array.rx_m[rx])
        )


def _near_middle(capture: RadarCapture, ends_m: np.ndarray) -> np.ndarray:
    """Return which of the ends [n, 3] of a capture's channels are next to its middle: bool [n]."""
    off_m = np.linalg.norm(ends_m - places_m(capture).mean(axis=0), axis=1)
    return (np.abs(ends_m - ends_m[off_m.argmin()]) <= MIDDLE * shortest_m(capture)).all(axis=1)


def step_warnings(capture: RadarCapture) -> Iterator[str]:
    """Yield a warning if the range of the first frame's strongest point bends over a scan as that
    of a scan with another step does."""
    try:
        step = from_echoes(capture, ["scan_step"]).scan_step
    except HandbenchError:  # no scan, or no single point
        return
    if abs(step - 1) > WRONG_STEP:
        yield (
            f"the range of its point bends over the scan as if the step were {step:.3g} times as "
            "large; correct it, or, if an offset of the range causes this, write unknown = "
            '["range_offset"] in capture.toml, and run `handbench calibrate --from-echoes`'
        )


def order_warnings(
    capture: RadarCapture,
    image: Callable[[RadarCapture], DepthMap | None],
    surface: Surface,
    as_is_mm: float,
) -> Iterator[str]:
    """Yield a warning if the image of a capture is much nearer to its surface with transmitters and
    receivers or x and y exchanged, or with the tones in reverse order, and if it is far away
    without. image: makes a depth map of a capture; as_is_mm: `error_mm` without correction."""
    array = capture.aperture
    if isinstance(array, AntennaArray) and len(array.tx_m) == len(array.rx_m):
        turned, ends_m = "tx and rx", (array.rx_m, array.tx_m)
        cure = "exchange tx_m and rx_m, or these axes of the samples"
    else:
        turned, ends_m = "x and y", (array.tx_m[:, [1, 0, 2]], array.rx_m[:, [1, 0, 2]])
        cure = "exchange these columns of the positions"
    exchanged = replace(array, tx_m=ends_m[0], rx_m=ends_m[1])
    corrections = (
        (
            "the tones in reverse order",
            "reverse frequencies_hz, or the frequency axis of the samples",
            replace(capture, samples=capture.samples[:, ::-1]),
        ),
        (f"{turned} exchanged", cure, replace(capture, aperture=exchanged)),
    )
    maps = ((mistake, cure, image(corrected)) for mistake, cure, corrected in corrections)
    nearer = [*nearer_warnings(maps, surface, as_is_mm)]
    yield from nearer
    if not nearer and as_is_mm > LOST_MM:
        yield (
            f"most of the strongest pixels are beside the surface, or more than {LOST_MM:g} mm off "
            "it; check the surface, its transform, and the order of antennas and tones"
        )


def mirror_warnings(depth: DepthMap, surface: Surface) -> Iterator[str]:
    """Yield a warning if a depth map is much nearer to a surface when it is mirrored."""
    columns = replace(depth, x_m=depth.x_m[::-1])  # as if the columns were reversed
    turned = {
        "rows": replace(depth, y_m=depth.y_m[::-1]),
        "columns": columns,
        "rows and columns": replace(columns, y_m=depth.y_m[::-1]),
    }
    maps = (
        (f"its {what} in reverse order", f"reverse the {what} of z_m and amplitude_db", map_)
        for what, map_ in turned.items()
    )
    return nearer_warnings(maps, surface, error_mm(depth, surface))


def nearer_warnings(
    corrected: Iterable[tuple[str, str, DepthMap | None]], surface: Surface, as_is_mm: float
) -> Iterator[str]:
    """Yield a warning about the first correction whose depth map is much nearer to a surface than
    without correction. corrected: a mistake, its cure, and the depth map without it, if any."""
    for mistake, cure, depth in corrected:
        mended_mm = np.inf if depth is None else error_mm(depth, surface)
        if mended_mm < NEAR_MM and FALLEN * mended_mm < as_is_mm:
            yield (
                f"with {mistake} the median distance of the depths to the surface would be only "
                f"{mended_mm:.2f} mm: {cure}"
            )
            return


def error_mm(depth: DepthMap, surface: Surface) -> float:
    """Compute the median |Δz| of the strongest pixels of a depth map, all if they are equally
    strong, to a surface in the radar frame. A pixel whose ray misses the observed surface counts as
    infinitely far."""
    seen = np.flatnonzero(np.isfinite(depth.z_m))
    db = depth.amplitude_db.ravel()[seen]
    strongest = seen[db >= np.sort(db)[-STRONGEST:][:1]]
    try:
        z_m = reference_on_grid(surface, depth.x_m, depth.y_m).z_m.ravel()[strongest]
    except HandbenchError:  # larger than anything before a radar
        return np.inf
    off_m = np.nan_to_num(np.abs(depth.z_m.ravel()[strongest] - z_m), nan=np.inf, posinf=np.inf)
    return 1e3 * float(np.median(off_m)) if off_m.size else np.inf


def sharpness_db(capture: RadarCapture) -> float:
    """Compute the sharpness of a coarse image I of a capture's first frame, of a few tones and
    antennas, in dB: Σ|I|⁴ / (Σ|I|²)²; NaN if these are all dead."""
    from handbench.radar.imaging.api import image_volume  # compiled

    channels = capture.aperture.channels
    # an odd step through a scan's positions does not stay in one column of a raster
    every = -(-min(channels) // ANTENNAS) if len(channels) > 1 else channels[0] // POSITIONS | 1
    few = thin_antennas(capture.first_frames(1), every)
    tones = even_subset(len(few.frequencies_hz), TONES)
    samples = scaled_to_one(few.samples[0][tones])
    volume = image_volume(samples, few.vacuum_hz[tones], few.aperture, _box(few), None)
    power = np.abs(volume).astype(np.float64) ** 2
    return float(10 * np.log10((power**2).sum() / (power.sum() ** 2 or np.nan)))


def _box(capture: RadarCapture) -> VoxelGrid:
    """Return coarse voxels in front of the aperture, in a volume large enough for the image of any
    near target."""
    places = places_m(capture)
    x_m, y_m, z_m = (places.min(axis=0) + places.max(axis=0)) / 2
    length_m = SPEED_OF_LIGHT_M_S / float(capture.vacuum_hz.mean())
    size_m = max(float(np.ptp(places, axis=0).max()), length_m)
    across_m = size_m * np.linspace(-WIDE, WIDE, PIXELS)
    depths_m = size_m * np.linspace(NEAR, FAR, DEPTHS)
    return VoxelGrid(x_m + across_m, y_m + across_m, z_m + depths_m)
