"""Depth from any set of tones at once, by maximum likelihood.

A ladder uses a tone after the other, and each must hold what the next one's period leaves open. All pairs of all tones
together leave less open: the shift at which all have one phase (`radar.methods.alignment.align`) is searched wide about
what the first pair found, then the pixel is imaged from there and it is searched again. What remains possible is a
second maximum nearly as high; its odds are flagged.
"""

from __future__ import annotations

import functools
from dataclasses import replace

import numpy as np

from handbench.radar.data.capture import RadarCapture
from handbench.radar.data.depthmap import DepthMap, amplitude_db
from handbench.radar.methods.alignment import NONE, agreed, align
from handbench.radar.methods.depth_uncertainty import Uncertainty
from handbench.radar.methods.fsk import Tones, first_step, path_rise
from handbench.radar.methods.fsk_config import JointConfig
from handbench.radar.methods.smoothing import masked_mean

NEAR = 0.25  # of the reach: the search about a depth that all tones found before


def joint(capture: RadarCapture, config: JointConfig, frame: int = 0) -> DepthMap:
    """Depth map of a frame, with σ and flags; HandbenchError where the capture has not the tones."""
    tones, whole = Tones.of(capture, config, frame), config.grid()
    step, uncertainty = first_step(tones, config).cropped(), Uncertainty(config)
    z_m, amplitude = uncertainty.add(step), step.amplitude
    doubtful, reach_m = uncertainty.wrapped, config.reach_m
    for _ in range(config.fine_refinements):
        step = tones.surface(step.grid, masked_mean(z_m, config.coarse_filter_px, amplitude**2))
        points_m = step.grid.points_at_m(step.index, step.formed_m)
        rise = path_rise(points_m, tones.aperture) if config.off_axis else np.full(len(points_m), 2.0)
        found = align(step.images, tones.frequencies_hz, rise, reach_m)
        z_m, sigma_m = (step.on_map(told) for told in (points_m[:, 2] + found.shift_m, found.sigma_m))
        coherence, amplitude = step.on_map(found.coherence, 0.0), step.amplitude
        doubtful = doubtful | step.on_map(found.other > config.wrap_probability, False)
        if config.drop_doubtful and (coherence >= NONE).any():
            z_m[coherence < NONE] = np.nan
        reach_m = NEAR * config.reach_m
    placed = functools.partial(whole.placed, step.grid)
    db, coherence = amplitude_db(placed(amplitude, 0.0)), placed(coherence, 1.0)
    depth = DepthMap(whole.x_m, whole.y_m, placed(z_m), db, "joint", config.model_dump(), placed(sigma_m))
    depth = replace(depth, wrapped=placed(doubtful, False) > 0)
    depth = agreed(depth, coherence, float(np.ptp(tones.frequencies_hz)), config)
    seen = db >= config.threshold_db  # where it is, no longer in the first plane
    z_m, sigma_m = (np.where(seen, told, np.nan) for told in (depth.z_m, np.asarray(depth.sigma_m)))
    return replace(depth, z_m=z_m, sigma_m=sigma_m, wrapped=seen & np.asarray(depth.wrapped))
