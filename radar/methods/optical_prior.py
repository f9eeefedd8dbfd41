"""Depth from two tones far apart, near a first depth of each pixel from another sensor.

Two tones Δf apart measure a depth with an error of cσ/(4πΔf), σ that of the phase, but only within
±c/(4Δf) of a first depth. Multimodal 2-FSK takes the first depth from an optical sensor (arXiv
2511.01405), so that it needs no images at close tones. Here a third tone close to the first checks
the first depth. Its phase is unambiguous within ±c/(4 · 200 MHz), too rough for a depth of one
pixel; but its mean over a few resolution cells reveals a first depth that is off by a period, and
its median over all pixels a first map that is wrong as a whole.
"""

from __future__ import annotations

import functools
from dataclasses import replace

import numpy as np

from handbench.radar.data.arrays import SPEED_OF_LIGHT_M_S
from handbench.radar.data.capture import RadarCapture
from handbench.radar.data.depthmap import DepthMap, amplitude_db, load_depthmap
from handbench.radar.data.grid import PixelGrid, bounding_box
from handbench.radar.methods.alignment import filter_by_agreement
from handbench.radar.methods.depth_uncertainty import quadrature_m, spread_m, wrap_probability
from handbench.radar.methods.first_depth import with_first_depth
from handbench.radar.methods.fsk import FskStep, Tones, first_step, masked_mean
from handbench.radar.methods.fsk_config import PixelsConfig, PriorConfig
from handbench.support.errors import HandbenchError

# largest median error of a prior, in half periods; the rest is for its pixels' own errors
MOST_OFF = 2 / 3
WITNESS_PX = 15  # window of the close pair's mean: about ten resolution cells


def prior_two_tone(capture: RadarCapture, config: PriorConfig, frame: int = 0) -> DepthMap:
    """Compute the depth map of a frame from two tones far apart, near first depths from a depth
    map, another sensor or the echoes' close tones (`config.prior`), with predicted 1σ and with
    flags where the depth may be off by a period.

    Raises HandbenchError for a map of first depths on other pixels or without depths, and for one
    whose median error exceeds MOST_OFF of half a period.
    """
    tones, whole = Tones.of(capture, config, frame), config.grid()
    grid, first_m = _first_depths(tones, config, capture, frame)
    step = tones.surface(grid, first_m)
    seen = step.at(amplitude_db(step.amplitude)) >= config.threshold_db
    step = step.where(seen)
    placed = functools.partial(whole.placed, grid)
    db, half_period_m = amplitude_db(placed(step.amplitude, 0.0)), tones.period_m / 2
    sigma_m = spread_m(quadrature_m(step), step.amplitude, config.spread_px)
    depth = DepthMap(
        *(whole.x_m, whole.y_m, placed(step.z_m), db, "prior-2fsk", config.model_dump(mode="json")),
        sigma_m=placed(sigma_m),
        wrapped=placed(_another_period(step, half_period_m, config), False) > 0,
    )
    return filter_by_agreement(
        depth, np.ones(whole.shape), SPEED_OF_LIGHT_M_S / (4 * half_period_m), config
    )


def other_sensor(
    capture: RadarCapture, config: PixelsConfig, name: str, frame: int = 0
) -> DepthMap:
    """Return the depth map of another sensor that recorded the scene, on the configured pixels.
    amplitude_db is 0 where it has a depth and −inf elsewhere.

    name: name of the sensor in `capture.sensors`. Raises HandbenchError if the capture has no such
    sensor, or if the sensor has no depth at these pixels.
    """
    if name not in capture.sensors:
        known = ", ".join(capture.sensors) or "only the radar's own"
        raise HandbenchError(
            f"{name}: the capture has no depths of this sensor; the sensors that it has are: "
            f"{known}; choose one of these, or leave the method out"
        )
    grid = config.grid()
    z_m = capture.sensors[name](grid, frame)
    if not np.isfinite(z_m).any():
        raise HandbenchError(
            f"{name}: this sensor has no depth at the radar's pixels; check the transform from "
            "its frame to the radar frame"
        )
    db = np.where(np.isfinite(z_m), 0.0, -np.inf).astype(np.float32)
    return DepthMap(grid.x_m, grid.y_m, z_m, db, name, config.model_dump(mode="json"))


def _first_depths(
    tones: Tones, config: PriorConfig, capture: RadarCapture, frame: int
) -> tuple[PixelGrid, np.ndarray]:
    """Return the first depths, which config.prior takes from a depth map's file, another sensor or
    the echoes' close tones: (the smallest rectangular part of the pixel grid that contains them
    all, z_m [ny, nx] on it, metres, NaN where there is none)."""
    whole = config.grid()
    if not config.prior:
        begun = replace(tones, config=with_first_depth(capture, config, frame))
        step = first_step(begun).cropped()
        return step.grid, masked_mean(step.z_m, config.coarse_filter_px, step.amplitude**2)
    file = config.prior.endswith(".npz")
    prior = (
        load_depthmap(config.prior) if file else other_sensor(capture, config, config.prior, frame)
    )
    same = (
        prior.z_m.shape == whole.shape
        and np.allclose(prior.x_m, whole.x_m)
        and np.allclose(prior.y_m, whole.y_m)
    )
    if not same or not np.isfinite(prior.z_m).any():
        raise HandbenchError(
            f"{config.prior}: is a map of {prior.z_m.shape[1]} × {prior.z_m.shape[0]} pixels, "
            f"{np.isfinite(prior.z_m).sum()} of them with a depth; expected a map with depths on "
            f"the method's grid of {whole.shape[1]} × {whole.shape[0]} pixels; make it again with "
            "the same x and y"
        )
    box = bounding_box(np.isfinite(prior.z_m))
    return whole.part(box), prior.z_m[box].astype(np.float64)


def _another_period(step: FskStep, half_period_m: float, config: PriorConfig) -> np.ndarray:
    """Flag pixels whose depth may be off by a period, because the pair of close tones or the
    neighbouring pixels indicate another depth: boolean [ny, nx].

    Raises HandbenchError if the first depths of a configured source are wrong as a whole.
    """
    close, power = step.below(), step.amplitude**2
    apart_m = step.on_map(close.correction_m - step.correction_m)
    whole_m = np.median(close.correction_m)
    if config.prior and abs(whole_m) > MOST_OFF * half_period_m:
        raise HandbenchError(
            f"{config.prior}: its depths are {1e3 * abs(whole_m):.0f} mm "
            f"{'before' if whole_m > 0 else 'behind'} the depths from the phases of close tones "
            f"(median); expected at most {1e3 * MOST_OFF * half_period_m:.0f} mm; check that it "
            "is in the radar frame"
        )
    mean_m, q_m = (
        masked_mean(values_m, WITNESS_PX, power) for values_m in (apart_m, quadrature_m(close))
    )
    with np.errstate(invalid="ignore"):
        wrapped = wrap_probability(
            mean_m, spread_m(q_m, step.amplitude, config.spread_px), half_period_m
        )
    alone = (
        np.abs(step.z_m - masked_mean(step.z_m, config.coarse_filter_px, power)) > half_period_m / 2
    )
    return (wrapped > config.wrap_probability) | alone
