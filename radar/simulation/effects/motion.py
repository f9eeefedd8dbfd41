"""The effect "motion": hand tremor and other motion of the target while one tone after another is
measured.

In general every tone sees the surface at its own time (`moving_surface`). For a target that moves
as a whole, by little and in the same way in each frame, a quicker calculation is exact enough:

A target that moves by δ along e is a target at rest before an array that has moved by −δe. Echoes
are computed at few displacements. In between, the phase of each channel follows the path to the
target's middle, and the small remaining difference between the target's parts is interpolated
linearly. Extra echoes (multiple bounces, foam) are weak: they are computed once, and only their
phase changes.
"""

from __future__ import annotations

import numpy as np

from handbench.radar.data.arrays import SPEED_OF_LIGHT_M_S, AntennaArray
from handbench.radar.imaging.cpu.steering import phasor
from handbench.radar.simulation.causes import Motion
from handbench.radar.simulation.effects.moving_surface import echoes_at_each_tone
from handbench.radar.simulation.movement import displacement_m, frame_starts, reshapes
from handbench.radar.simulation.scene import EchoScene
from handbench.radar.simulation.scene_echoes import Echoes, bare_echoes

MOST_NODES = 40  # displacements, at most; each needs a simulation
# between two displacements: linear interpolation then errs by (0.06)²/8 = 5e-4 at the target's rim
RESIDUAL_RAD = 0.06


def motion(echoes: Echoes) -> Echoes:
    """Move the target between one tone and the next, by the scene's movement."""
    if not echoes.with_target:
        return echoes
    scene, causes = echoes.scene, echoes.scene.causes.motion
    if _why_not_as_a_whole(scene):
        return echoes.record(echoes_at_each_tone(echoes))
    starts = frame_starts(scene, echoes.frames)
    offset_m = np.stack([displacement_m(causes, scene.time_s, s.tremor_rad) for s in starts])
    reach = reach_m(causes, scene.time_s)
    return echoes.record(echoes_of_moving(echoes, causes.along, offset_m, reach))


def way_of_motion(scene: EchoScene) -> str:
    """Say in words how the target's motion is simulated, and why so."""
    if reason := _why_not_as_a_whole(scene):
        return f"{reason}: every tone sees the surface at its time"
    return f"moves as a whole by {_range_mm(scene)}: echoes of few displacements are interpolated"


def _why_not_as_a_whole(scene: EchoScene) -> str:
    """Return why the motion cannot be simulated by few displacements, in words; "" if it can."""
    if scene.bent is not None:
        return "fingers move"
    if reshapes(scene):
        return "the target turns"
    if scene.frame_period_s is not None:
        return "frames follow each other"
    low, high = reach_m(scene.causes.motion, scene.time_s)
    residual_rad = _residual_rad(bare_echoes(scene), scene.causes.motion.along, high - low)
    return (
        f"moves as a whole by {_range_mm(scene)}"
        if residual_rad > MOST_NODES * RESIDUAL_RAD
        else ""
    )


def _range_mm(scene: EchoScene) -> str:
    return f"{1e3 * float(np.ptp(reach_m(scene.causes.motion, scene.time_s))):.2g} mm"


def reach_m(motion: Motion, time_s: np.ndarray) -> tuple[float, float]:
    """Return the least and the largest displacement, in metres, that is possible within a frame for
    any phase of the tremor, so that all frames can be interpolated between the same
    displacements."""
    drift_m = motion.velocity_m_s * time_s
    return float(drift_m.min() - 2 * motion.amplitude_m), float(
        drift_m.max() + 2 * motion.amplitude_m
    )


def echoes_of_moving(
    echoes: Echoes, along: np.ndarray, offset_m: np.ndarray, reach: tuple[float, float]
) -> np.ndarray:
    """Compute the samples of the target displaced along the unit vector `along` by offset_m [frame,
    f]: complex64 [frame, f, t, r].

    reach: least and largest displacement; echoes are computed at a few displacements between these
    and interpolated.
    """
    frequencies_hz = echoes.scene.frequencies_hz
    low, high = reach
    residual_rad = _residual_rad(echoes, along, high - low)
    nodes_m = np.linspace(low, high, 2 + int(residual_rad / RESIDUAL_RAD))
    slope = _slope(echoes, along, echoes.points_m.mean(axis=0))
    # After a phase of −slope·δ, the echoes of all displacements are similar.
    extra = echoes.extra_echoes()
    turned = (phasor(-node * slope, frequencies_hz[:, None, None], -1) for node in nodes_m)
    arrays = (_moved(echoes.array, node * along) for node in nodes_m)
    still = [echoes.echo(array) * turn + extra for array, turn in zip(arrays, turned, strict=True)]
    place = np.clip(
        (offset_m - low) / max(high - low, 1e-12) * (len(nodes_m) - 1), 0, len(nodes_m) - 1
    )
    below = np.minimum(place.astype(int), len(nodes_m) - 2)
    samples = np.empty((*offset_m.shape, *echoes.array.channels), np.complex64)
    for frame, tone in np.ndindex(*offset_m.shape):
        n, part = below[frame, tone], np.float32(place[frame, tone] - below[frame, tone])
        mixed = still[n][tone] * (1 - part) + still[n + 1][tone] * part
        samples[frame, tone] = mixed * phasor(
            offset_m[frame, tone] * slope, frequencies_hz[tone], -1
        )
    return samples


def _residual_rad(echoes: Echoes, along: np.ndarray, range_m: float) -> float:
    """Return the phase by which, over a displacement of range_m along the unit vector `along`, some
    point of the target differs from the points' mean: 4πf/c · range_m · the largest difference
    between the direction cosines of both, seen from the origin."""
    points_m = echoes.points_m
    middle_m = points_m.mean(axis=0)
    cosine = points_m @ along / np.linalg.norm(points_m, axis=1)
    spread = float(np.abs(cosine - middle_m @ along / np.linalg.norm(middle_m)).max())
    return 4 * np.pi * echoes.scene.frequencies_hz.max() / SPEED_OF_LIGHT_M_S * spread * range_m


def _slope(echoes: Echoes, along: np.ndarray, middle_m: np.ndarray) -> np.ndarray:
    """Return by how much the path of each channel, from transmitter to the point middle_m [3] to
    receiver, grows per metre that the point moves along the unit vector `along`: [t, r]."""
    towards = [middle_m - leg.position_m for leg in echoes.array.legs]
    cosines = [leg @ along / np.linalg.norm(leg, axis=1) for leg in towards]
    return cosines[0][:, None] + cosines[1]


def _moved(array: AntennaArray, offset_m: np.ndarray) -> AntennaArray:
    """Return the array relative to a target that has moved by offset_m [3]: moved by −offset_m."""
    return AntennaArray(array.tx_m - offset_m, array.rx_m - offset_m)
