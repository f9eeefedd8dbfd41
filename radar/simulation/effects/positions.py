"""Antennas that are not quite where the capture says."""

from __future__ import annotations

import numpy as np

from radar.data.arrays import AntennaArray
from radar.simulation.effects.base import Effect, Estimate
from radar.simulation.pilot import change_db, change_mm, echoes_of, pilot, stand_in
from radar.simulation.scene import EchoScene
from radar.simulation.state import EchoState


class PositionErrors(Effect):
    """Each antenna is off by a normal error per axis; the capture keeps the nominal positions."""

    id = "positions"
    does = "true antenna positions about the nominal ones"
    source = "the pilot's two tones with one set of errors of the same spread"

    def missing(self, scene: EchoScene) -> str:
        return "" if scene.causes.positions.sigma_m else "[sensor.positions] with sigma_m"

    def estimate(self, scene: EchoScene) -> Estimate:
        sigma_m = scene.causes.positions.sigma_m
        errors = [stand_in(leg.position_m.size, i).reshape(-1, 3) for i, leg in enumerate(scene.array.legs)]
        samples = echoes_of(scene, pilot(scene).tones_hz, _off(scene.array, sigma_m, errors))
        why = f"two tones' images with antennas off by {1e3 * sigma_m:.2g} mm"
        return Estimate(change_mm(scene, samples), change_db(scene, samples), why)

    def apply(self, state: EchoState) -> None:
        shapes = [leg.position_m.shape for leg in state.array.legs]
        errors = [state.random(state.seed(self.id, i)).standard_normal(shape) for i, shape in enumerate(shapes)]
        state.array = _off(state.array, state.scene.causes.positions.sigma_m, errors)


def _off(array: AntennaArray, sigma_m: float, errors: list[np.ndarray]) -> AntennaArray:
    return AntennaArray(array.tx_m + sigma_m * errors[0], array.rx_m + sigma_m * errors[1])
