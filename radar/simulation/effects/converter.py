"""Quantisation by the analogue-to-digital converter."""

from __future__ import annotations

import numpy as np

from radar.simulation.causes import Converter
from radar.simulation.effects.base import Effect, Estimate
from radar.simulation.pilot import change_db, change_mm, pilot
from radar.simulation.scene import EchoScene
from radar.simulation.state import EchoState


class Quantisation(Effect):
    """Both quadratures are rounded to the converter's steps and clipped at its full scale."""

    id = "converter"
    does = "quantisation and clipping by the converter"
    source = "the pilot's two tones, quantised; white noise of step²/12 per quadrature (Widrow & Kollár 2008)"

    def missing(self, scene: EchoScene) -> str:
        return "" if scene.causes.converter.bits else "[sensor.converter] with bits"

    def estimate(self, scene: EchoScene) -> Estimate:
        converter, samples = scene.causes.converter, pilot(scene).samples
        rounded = quantised(samples, converter, full_scale(samples, converter))
        why = f"two tones' images from {converter.bits} bits"
        return Estimate(change_mm(scene, rounded), change_db(scene, rounded), why)

    def apply(self, state: EchoState) -> None:
        converter = state.scene.causes.converter
        scale = state.level(self.id, lambda: full_scale(state.samples, converter))
        state.samples = np.stack([quantised(frame, converter, scale) for frame in state.samples])


def full_scale(samples: np.ndarray, converter: Converter) -> float:
    """Full scale of a quadrature: the largest one, with the headroom."""
    largest = max(np.abs(samples.real).max(), np.abs(samples.imag).max())
    return float(largest * 10 ** (converter.headroom_db / 20))


def quantised(samples: np.ndarray, converter: Converter, scale: float) -> np.ndarray:
    """Samples rounded to the middles of 2^bits steps over ±scale (mid-rise): complex64."""
    if scale == 0 or converter.bits is None:
        return samples
    step = 2 * scale / 2**converter.bits
    parts = np.ascontiguousarray(samples).view(np.float32).astype(np.float64)
    middle = (np.floor(parts / step) + 0.5) * step
    return np.clip(middle, -scale + step / 2, scale - step / 2).astype(np.float32).view(np.complex64)
