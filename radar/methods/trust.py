"""Trust: the probability, per pixel, that a depth is off by more than 5 mm from the nearest true surface.

A logistic function of features that any method's map and its own tones tell: the images at the depth that was found
(do the tones agree there, and on which depth?), depth steps and echoes beside the pixel, the method's own σ and flags,
and the same over the whole scene, since few scenes hold most wrong depths. The weights of trust.toml are fitted by
tests/bench/studies/trust/measure_trust.py to scenes of known surfaces; features are clipped, so that no scene lies far
beyond those.
"""

from __future__ import annotations

import tomllib
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np

from handbench.radar.data.arrays import SPEED_OF_LIGHT_M_S
from handbench.radar.data.capture import RadarCapture, evenly, near_one
from handbench.radar.data.depthmap import DepthMap
from handbench.radar.data.grid import PixelGrid, bounding_box
from handbench.radar.methods.advice import asked_hz
from handbench.support.config import Config

GROSS_M = 5e-3
BESIDE_M = 5e-3  # half a window of neighbours, two resolution cells wide
TONES = 8  # of a method with more of them: evenly chosen
TOLERANCE = 1e-3  # of the images, whose phases are looked at to a hundredth of a radian
FLAGGED = 0.5  # p_gross above which a pixel counts as flagged
LOST = 0.5  # share of a map's pixels in doubt from which on its depths are scattered too widely to be worth an image
FARTHEST_DB = 30.0  # below the peak
WEIGHTS = Path(__file__).with_name("trust.toml")
FEATURES = (
    "sigma",  # log10 of the method's own σ over 5 mm; of what the tones' amplitudes tell where it has none
    "close",  # log10 of the step from the found depth that the two closest tones ask for, over 5 mm
    "far",  # the same of the two tones furthest apart
    "incoherence",  # log10(1 − |Σ O|² / (N Σ |O|²)) of the tones at the found depth
    "range",  # log10 of the range of depths beside the pixel, over 5 mm
    "behind",  # log10 of the distance behind the nearest of these over 5 mm, never below 0
    "before",  # the same before the furthest
    "below",  # amplitude below the strongest neighbour's, in tens of dB
    "island",  # amplitude of the strongest pixel that steps below 5 mm lead to, below the map's peak, in tens of dB
    "flag",  # 1 where the method itself is in doubt
    "scene_incoherence",  # mean of `incoherence` over the scene
    "scene_range",  # mean of `range` over the scene
)


def with_trust(depth: DepthMap, capture: RadarCapture, config: Config, frame: int = 0) -> DepthMap:
    """The map with p_gross [ny, nx], NaN off target, by what it was made of; another sensor's map stays as it is."""
    if depth.method in capture.sensors:
        return depth
    index, found = features(depth, capture, config, frame)
    p_gross = np.where(np.isfinite(depth.z_m), 1.0, np.nan)
    p_gross.ravel()[index] = probability(found, weights_of(depth.method))
    return replace(depth, p_gross=p_gross.astype(np.float32))


def probability(found: np.ndarray, weights: np.ndarray) -> np.ndarray:
    """The logistic function [n] of features [n, k] with weights [1 + k], the constant first."""
    return 1 / (1 + np.exp(-np.clip(weights[0] + found @ weights[1:], -30, 30)))


@cache
def known_weights() -> dict[str, np.ndarray]:
    """Weights [1 + k] by method, as they were when first asked for; "any": those of all methods together."""
    found = tomllib.loads(WEIGHTS.read_text("utf-8"))
    return {id: np.array([values[name] for name in ("constant", *FEATURES)]) for id, values in found.items()}


def weights_of(method: str) -> np.ndarray:
    """Weights [1 + k] of a method: its own, those of the method that it is a variant of, or those of any."""
    return next(known_weights()[id] for id in (method, method.rpartition("-")[0], "any") if id in known_weights())


def features(depth: DepthMap, capture: RadarCapture, config: Config, frame: int = 0) -> tuple[np.ndarray, np.ndarray]:
    """Flat indices [n] of the pixels that have a depth before the array, and their features [n, k]."""
    on = np.nan_to_num(depth.z_m) > 0
    index = np.flatnonzero(on)
    if not len(index):
        return index, np.zeros((0, len(FEATURES)))
    flag = np.zeros(len(index)) if depth.wrapped is None else depth.wrapped[on].astype(np.float64)
    told = _of_neighbours(depth, on) | {"flag": flag}
    if flag.mean() > LOST:
        told |= dict.fromkeys(("noise", "close", "far", "incoherence"), np.full(len(index), 2.0))
    else:
        told |= _of_tones(depth, capture, config, frame, index)
    told["sigma"] = told["noise"] if depth.sigma_m is None else _log(depth.sigma_m[on] / GROSS_M)
    told |= {f"scene_{name}": told[name].mean() for name in ("incoherence", "range")}
    return index, np.stack([np.broadcast_to(told[name], len(index)) for name in FEATURES], axis=1)


def _log(ratio: np.ndarray) -> np.ndarray:
    """log10 within ±2; of what is no number 2."""
    return np.log10(np.clip(np.nan_to_num(ratio, nan=1e2, posinf=1e2), 1e-2, 1e2))


def _of_tones(
    depth: DepthMap, capture: RadarCapture, config: Config, frame: int, index: np.ndarray
) -> dict[str, np.ndarray]:
    """Features [n] that the method's own tones, or the capture's where its configuration names none, tell at the depths
    that it found."""
    from handbench.radar.imaging.api import image_points

    tones_hz = capture.frequencies_hz if (asked := asked_hz(config)) is None else asked
    some = evenly(len(tones_hz), TONES)
    samples, f = capture.tones(tones_hz[some], frame)
    points_m = PixelGrid(depth.x_m, depth.y_m).points_at_m(index, depth.z_m.ravel()[index])
    tolerance = TOLERANCE if getattr(config, "tolerance", TOLERANCE) else None
    images = image_points(near_one(samples), f, capture.aperture, points_m, tolerance, apart=True)
    magnitude, apart_hz = np.abs(images).astype(np.float64), np.abs(f - f[0])
    power = np.maximum((magnitude**2).mean(axis=0), np.finfo(float).tiny)
    close, far = np.argsort(apart_hz)[[min(1, len(f) - 1), -1]]
    turned_rad = {
        name: (np.angle(images[0] * np.conj(images[i])), apart_hz[i]) for name, i in (("close", close), ("far", far))
    }
    turned_rad["noise"] = (magnitude.std(axis=0, ddof=min(1, len(f) - 1)) / np.sqrt(power), np.ptp(f))
    steps_m = {
        name: SPEED_OF_LIGHT_M_S * np.abs(rad) / (4 * np.pi * (hz + 1e-9)) for name, (rad, hz) in turned_rad.items()
    }
    coherence = np.abs(images.mean(axis=0)) ** 2 / power
    return {name: _log(step_m / GROSS_M) for name, step_m in steps_m.items()} | {"incoherence": _log(1 - coherence)}


def _of_neighbours(depth: DepthMap, on: np.ndarray) -> dict[str, np.ndarray]:
    """Features [n] that the map tells about each pixel's surroundings."""
    from scipy.ndimage import label, maximum_filter, minimum_filter

    box = bounding_box(on)
    on, z_m, db = on[box], depth.z_m[box], depth.amplitude_db[box]
    window = [1 + 2 * round(BESIDE_M / np.ptp(axis[:2])) if len(axis) > 1 else 1 for axis in (depth.y_m, depth.x_m)]
    nearest_m = minimum_filter(np.where(on, z_m, np.inf), window)[on]
    furthest_m = maximum_filter(np.where(on, z_m, -np.inf), window)[on]
    strongest_db = maximum_filter(np.where(on, db, -np.inf), window)[on]
    joined = np.zeros([2 * n - 1 for n in on.shape], bool)  # pixels, and between them whether a surface goes on
    joined[::2, ::2] = on
    with np.errstate(invalid="ignore"):
        joined[1::2, ::2], joined[::2, 1::2] = (np.abs(np.diff(z_m, axis=axis)) < GROSS_M for axis in (0, 1))
    island = label(joined)[0][::2, ::2][on]
    peak_db = np.full(island.max() + 1, -FARTHEST_DB)
    np.maximum.at(peak_db, island, db[on])
    return {
        "range": _log((furthest_m - nearest_m) / GROSS_M),
        "behind": np.maximum(_log((z_m[on] - nearest_m) / GROSS_M), 0),
        "before": np.maximum(_log((furthest_m - z_m[on]) / GROSS_M), 0),
        "below": np.minimum(strongest_db - db[on], FARTHEST_DB) / 10,
        "island": -peak_db[island] / 10,
    }
