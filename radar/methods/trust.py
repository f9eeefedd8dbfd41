"""Trust: the probability, per pixel, that a depth is off by more than 5 mm from the nearest true surface.

A logistic function of features that any method's map and its own tones tell: the images at the depth that was found
(do the tones agree there, and on which depth?), the 7 × 7 neighbours, the amplitude, the method's own σ and flags, and
the same over the whole scene, since few scenes hold most wrong depths. The weights of trust.toml are fitted by
`handbench study trust --fit` on random scenes; features are clipped, so that no scene lies far beyond those.
"""

from __future__ import annotations

import tomllib
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from radar.data.arrays import SPEED_OF_LIGHT_M_S
from radar.data.capture import RadarCapture, near_one
from radar.data.depthmap import DepthMap
from radar.data.grid import PixelGrid
from radar.imaging.api import image_points
from radar.methods.smoothing import bounding_box
from radar.support.config import Config

GROSS_M = 5e-3
TONES = 8  # of a method with more of them: evenly chosen
TOLERANCE = 1e-3  # of the images, whose phases are looked at to a hundredth of a radian
WINDOW_PX = 7
FLAGGED = 0.5  # p_gross above which a pixel counts as flagged
WEIGHTS = Path(__file__).with_name("trust.toml")
LOST = 0.5  # share of a map's pixels in doubt from which on its depths are scattered too widely to be worth an image
FEATURES = (
    "sigma",  # log10 of the method's own σ over 5 mm; its tones' where it has none
    "noise",  # log10 of the σ that the tones' amplitudes tell, over 5 mm
    "close_step",  # log10 of the step from the found depth that the two closest tones ask for, over 5 mm
    "pulled",  # by how much the closest tones' step exceeds 5 mm and three of its own σ; log10, never below 0
    "far_step",  # the same of the two tones furthest apart
    "incoherence",  # log10(1 − |Σ O|² / (N Σ |O|²)) of the tones at the found depth
    "apart",  # log10 of |z − median of the 7 × 7 neighbours| over 5 mm
    "jump",  # `apart` where it is positive
    "spread",  # log10 of the range that the middle half of the neighbours takes, over 5 mm
    "empty",  # share of the neighbours that are off target
    "weak",  # amplitude below the map's peak, in tens of dB
    "below",  # amplitude below the strongest neighbour's, in tens of dB
    "flag",  # 1 where the method itself is in doubt
    "flags",  # log10 of the share of the scene's pixels where it is
    "scene_noise",  # median of `noise` over the scene
    "scene_step",  # median of `close_step` over the scene
    "scene_incoherence",  # median of `incoherence` over the scene
    "scene_apart",  # log10 of the share of the scene's pixels more than 5 mm from their neighbours' median
)


def with_trust(depth: DepthMap, capture: RadarCapture, config: Config, frame: int = 0) -> DepthMap:
    """The map with p_gross [ny, nx], NaN off target; capture, config and frame: what the map was made of."""
    index, found = features(depth, capture, config, frame)
    weights = weights_of(depth.method)
    p_gross = PixelGrid(depth.x_m, depth.y_m).on_map(np.flatnonzero(np.isfinite(depth.z_m)), 1.0)
    p_gross.ravel()[index] = probability(found, weights)
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
    known = known_weights()
    return next(known[id] for id in (method, method.rpartition("-")[0], "any") if id in known)


def features(depth: DepthMap, capture: RadarCapture, config: Config, frame: int = 0) -> tuple[np.ndarray, np.ndarray]:
    """Flat indices [n] of the pixels that have a depth before the array, and their features [n, k]."""
    with np.errstate(invalid="ignore"):
        index = np.flatnonzero(depth.z_m > 0)
    if not len(index):
        return index, np.zeros((0, len(FEATURES)))
    flag = np.zeros(len(index)) if depth.wrapped is None else depth.wrapped.ravel()[index].astype(np.float64)
    if flag.mean() > LOST:
        tones = dict.fromkeys(("noise", "close_step", "pulled", "far_step", "incoherence"), np.full(len(index), np.inf))
    else:
        tones = _tones(depth, capture, config, frame, index)
    own_m = tones["noise"] if depth.sigma_m is None else depth.sigma_m.ravel()[index]
    beside = _neighbours(depth, index)
    lengths_m = {"sigma": own_m, "apart": beside["apart"], "spread": beside["spread"]}
    lengths_m |= {name: tones[name] for name in ("noise", "close_step", "far_step")}
    logs = {name: _log(value_m / GROSS_M) for name, value_m in lengths_m.items()}
    logs |= {"incoherence": _log(tones["incoherence"]), "pulled": np.maximum(_log(tones["pulled"]), 0)}
    logs["jump"] = np.maximum(logs["apart"], 0)
    whole = {
        "flags": _log(np.asarray(flag.mean())),
        "scene_noise": np.median(logs["noise"]),
        "scene_step": np.median(logs["close_step"]),
        "scene_incoherence": np.median(logs["incoherence"]),
        "scene_apart": _log(np.asarray(np.mean(beside["apart"] > GROSS_M))),
    }
    weak = np.minimum(-depth.amplitude_db.ravel()[index] / 10, 3)
    values = logs | whole | {"empty": beside["empty"], "weak": weak, "below": beside["below"], "flag": flag}
    return index, np.stack([np.broadcast_to(values[name], len(index)) for name in FEATURES], axis=1)


def _log(ratio: np.ndarray) -> np.ndarray:
    """log10 within ±2; of what is no number 2."""
    return np.log10(np.clip(np.nan_to_num(ratio, nan=1e2, posinf=1e2), 1e-2, 1e2))


def _tones(
    depth: DepthMap, capture: RadarCapture, config: Config, frame: int, index: np.ndarray
) -> dict[str, np.ndarray]:
    """Features that the method's tones tell at the depths that it found, each [n]: noise, close_step and far_step in
    metres, pulled and incoherence as ratios."""
    samples, f = capture.tones(_tones_hz(capture, config), frame)
    points_m = PixelGrid(depth.x_m, depth.y_m).points_at_m(index, depth.z_m.ravel()[index])
    exact = getattr(config, "tolerance", TOLERANCE) is None
    images = image_points(near_one(samples), f, capture.aperture, points_m, None if exact else TOLERANCE, apart=True)
    magnitude = np.abs(images).astype(np.float64)
    power = np.maximum((magnitude**2).mean(axis=0), np.finfo(float).tiny)
    order = np.argsort(np.abs(f - f[0]))
    ripple = magnitude.std(axis=0, ddof=1) / np.sqrt(power) if len(f) > 1 else np.ones(len(index))
    others = order[min(1, len(f) - 1)], order[-1]
    close_m, far_m = (_depth_m(np.angle(images[0] * np.conj(images[i])), f[0] - f[i]) for i in others)
    return {
        "noise": _depth_m(ripple, np.ptp(f)),
        "close_step": close_m,
        "pulled": close_m / np.maximum(GROSS_M, 3 * _depth_m(ripple, f[0] - f[others[0]])),
        "far_step": far_m,
        "incoherence": 1 - np.abs(images.mean(axis=0)) ** 2 / power,
    }


def _depth_m(phase_rad: np.ndarray, difference_hz: float) -> np.ndarray:
    """The depth, without its sign, that a phase between tones stands for."""
    return np.asarray(SPEED_OF_LIGHT_M_S * np.abs(phase_rad) / (4 * np.pi * (abs(difference_hz) + 1e-9)))


def _tones_hz(capture: RadarCapture, config: Config) -> np.ndarray:
    """The method's tones, or the capture's where the configuration names none; TONES of them at most."""
    named = getattr(config, "ladder_hz", getattr(config, "tones_hz", capture.frequencies_hz))
    tones_hz = np.asarray(named() if callable(named) else named)
    return tones_hz[np.unique(np.linspace(0, len(tones_hz) - 1, TONES).round().astype(int))]


def _neighbours(depth: DepthMap, index: np.ndarray) -> dict[str, np.ndarray]:
    """The 7 × 7 neighbourhood of each pixel, each [n]: apart and spread in metres, empty, below in tens of dB."""
    on = np.isfinite(depth.z_m)
    box = bounding_box(on)
    y, x = np.unravel_index(index, on.shape)
    y, x, half = y - box[0].start, x - box[1].start, WINDOW_PX // 2

    def windows(values: np.ndarray) -> np.ndarray:
        padded = np.pad(values, half, constant_values=np.nan)
        return sliding_window_view(padded, (WINDOW_PX, WINDOW_PX))[y, x].reshape(len(y), -1)

    z_m = np.sort(windows(depth.z_m[box].astype(np.float32)), axis=1)
    count = np.isfinite(z_m).sum(axis=1)
    low, middle, high = (z_m[np.arange(len(y)), (share * (count - 1)).astype(int)] for share in (0.25, 0.5, 0.75))
    db = np.where(on, depth.amplitude_db, np.nan)[box].astype(np.float32)
    strongest_db = np.nanmax(windows(db), axis=1)
    return {
        "apart": np.abs(depth.z_m.ravel()[index] - middle).astype(np.float64),
        "spread": (high - low).astype(np.float64),
        "empty": 1 - count / WINDOW_PX**2,
        "below": np.minimum((strongest_db - depth.amplitude_db.ravel()[index]) / 10, 3),
    }
