"""Doubts about data that every reader takes: sentences with what seems wrong and its cure. None is sure; all are cheap
beside the hours that wrong data cost."""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from bench.datasets.native import NativeCapture
from bench.run.reconstruct_stage import configuration
from bench.validation import focus, surface_fit
from bench.validation.capture_problems import array_doubts
from groundtruth.mesh.surface import Surface, read_surface
from radar.data.arrays import AntennaArray
from radar.data.capture import RadarCapture
from radar.data.depthmap import DepthMap
from radar.methods.registry import method
from radar.methods.trust import FLAGGED, with_trust
from radar.support.config import Config
from radar.support.errors import HandbenchError
from radar.warmup import compile_kernels

CROWDED, WIDE_M = 0.5, 0.1  # share of an image that nothing near a hand fills, if it is at least that wide and high
PROBES = ("3fsk", "2fsk", "broadband", "narrowband")  # the first whose tones were measured is held against a surface


def of_capture(recorded: NativeCapture) -> Iterator[str]:
    """Doubts about a capture: its arrays and tones, its echoes' focus, and where it has a surface, its frames."""
    capture = recorded.echoes(1)
    plain = list(array_doubts(capture))
    yield from plain
    if plain:
        return  # all that follows would be about these
    compile_kernels()
    wrong = focus.findings(capture)
    yield from wrong
    imaged = None if wrong else _imaged(recorded, capture)
    if imaged is None:
        return
    depth, config = imaged
    yield from of_map(with_trust(depth, capture, config))
    surface = surface_of(recorded)
    if surface is None or not (as_is := surface_fit.fit(depth, surface)).improvable:
        return
    for name, (cure, undone) in _undone(capture).items():
        other = surface_fit.fit((_imaged(recorded, undone) or imaged)[0], surface)
        if other.explains(as_is):
            yield f"with {name} the median error falls from {as_is.median_mm:.2f} to {other.median_mm:.2f} mm: {cure}"
            return
    yield from surface_fit.findings(depth, surface)


def _undone(capture: RadarCapture) -> dict[str, tuple[str, RadarCapture]]:
    """Mistakes in the order of a capture's data: the cure of each, and the capture without it."""
    array, reversed_ = capture.aperture, replace(capture, samples=capture.samples[:, ::-1])
    found = {"the tones in reverse order": ("reverse frequencies_hz, or the samples along it", reversed_)}
    if isinstance(array, AntennaArray) and len(array.tx_m) == len(array.rx_m):
        exchanged = replace(capture, aperture=AntennaArray(array.rx_m, array.tx_m, array.measured))
        found["tx and rx exchanged"] = "exchange tx_m and rx_m, or those axes of the samples", exchanged
    return found


def of_image(depth: DepthMap, capture: RadarCapture) -> Iterator[str]:
    """Doubts about a depth map and, where there are some, about the echoes that it was imaged from."""
    about = list(of_map(depth))
    yield from about
    try:
        yield from focus.findings(capture) if about else ()
    except HandbenchError:  # a doubt that cannot be looked into takes no result away
        return


def of_map(depth: DepthMap) -> Iterator[str]:
    """Doubts about a depth map by itself."""
    seen = np.isfinite(depth.z_m)
    share = float(seen.mean())
    if share > CROWDED and min(np.ptp(depth.x_m), np.ptp(depth.y_m)) >= WIDE_M:
        yield f"{100 * share:.0f} % of the image is on target: does nothing focus? `handbench inspect` the capture"
    if depth.p_gross is not None and seen.any():
        flagged = float((depth.p_gross[seen] > FLAGGED).mean())
        if flagged > CROWDED:
            yield f"{100 * flagged:.0f} % of the pixels on target are likelier wrong than right (p_gross > {FLAGGED:g})"


def surface_of(recorded: NativeCapture) -> Surface | None:
    """The capture's surface in the radar's frame: the true one, or the measured one where a transform carries it."""
    if recorded.truth is not None:
        return read_surface(recorded.truth)
    mesh, transform = recorded.mesh(), recorded.transform()
    if mesh is None or transform is None:
        return None
    return read_surface(mesh).moved(transform)


def _imaged(recorded: NativeCapture, capture: RadarCapture) -> tuple[DepthMap, Config] | None:
    """The depth map of the first of PROBES that the capture's tones serve, and its configuration."""
    for name in PROBES:
        config = configuration(recorded.folder, name, {})
        try:
            return method(name).run(capture, config, 0).depth, config
        except HandbenchError:
            continue
    return None
