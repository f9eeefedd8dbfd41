"""Antennas that give nothing."""

from __future__ import annotations

import numpy as np

from radar.simulation.causes import Dead
from radar.simulation.effects.base import Effect, Estimate
from radar.simulation.pilot import change_db, change_mm, pilot
from radar.simulation.scene import EchoScene
from radar.simulation.state import EchoState
from radar.support.errors import HandbenchError


class DeadElements(Effect):
    """The channels of dead antennas are zero."""

    id = "dead"
    does = "antennas that give nothing"
    source = "the pilot's two tones without those channels"

    def missing(self, scene: EchoScene) -> str:
        return "" if scene.causes.dead.tx or scene.causes.dead.rx else "[sensor.dead] with tx or rx"

    def estimate(self, scene: EchoScene) -> Estimate:
        samples = silenced(pilot(scene).samples, scene.causes.dead)
        count = len(scene.causes.dead.tx) + len(scene.causes.dead.rx)
        why = f"two tones' images without {count} antennas"
        return Estimate(change_mm(scene, samples), change_db(scene, samples), why)

    def apply(self, state: EchoState) -> None:
        state.samples = silenced(state.samples, state.scene.causes.dead)


def silenced(samples: np.ndarray, dead: Dead) -> np.ndarray:
    """Samples [..., t, r] with the dead antennas' channels zero."""
    alive = np.ones(samples.shape[-2:], np.float32)
    for name, numbers, axis in (("tx", dead.tx, 0), ("rx", dead.rx, 1)):
        wrong = [n for n in numbers if not 0 <= n < alive.shape[axis]]
        if wrong:
            last = alive.shape[axis] - 1
            raise HandbenchError(f"sensor.dead.{name}: is {wrong[0]}; expected numbers from 0 to {last}")
        alive[(slice(None),) * axis + (list(numbers),)] = 0
    return samples * alive
