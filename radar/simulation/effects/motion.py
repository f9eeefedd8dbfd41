"""The effect "motion": hand tremor and other motion of the target while one tone after another is
measured.

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
from handbench.radar.simulation.effects.quick_estimate import CLOSED, QuickEstimate
from handbench.radar.simulation.scene import EchoScene
from handbench.radar.simulation.scene_echoes import Echoes, generator
from handbench.support.errors import HandbenchError

MOST_NODES = 30  # displacements, at most; each needs a simulation
# between two displacements: linear interpolation then errs by (0.06)²/8 = 5e-4 at the target's rim
RESIDUAL_RAD = 0.06


def motion(echoes: Echoes) -> Echoes:
    """Move the target between one tone and the next, by the scene's `motion`. The tremor's phase is
    random in each frame."""
    if not echoes.with_target:
        return echoes
    causes, time_s = echoes.scene.causes.motion, echoes.scene.time_s
    along = np.array(causes.direction) / np.linalg.norm(causes.direction)
    phases = [generator(seed).uniform(0, 2 * np.pi) for seed in echoes.frame_seeds("motion")]
    offset_m = np.stack([displacement_m(causes, time_s, phase) for phase in phases])
    return echoes.record(echoes_of_moving(echoes, along, offset_m, reach_m(causes, time_s)))


def estimate_motion(scene: EchoScene) -> QuickEstimate:
    """Estimate how much motion changes depths: (f/Δf)·Δδ, where Δδ is the mean motion between the
    highest tone f and another one Δf below it, for the tone with the largest such value."""
    top = int(scene.frequencies_hz.argmax())
    below_hz = scene.frequencies_hz[top] - scene.frequencies_hz
    below_hz[top] = np.inf
    moved_m = mean_change_m(scene.causes.motion, np.abs(scene.time_s - scene.time_s[top]))
    worst_m = float((scene.frequencies_hz[top] / below_hz * moved_m).max())
    return QuickEstimate(1e3 * worst_m, "(f/Δf)·Δδ of the motion between two tones", CLOSED)


def mean_change_m(motion: Motion, apart_s: np.ndarray) -> np.ndarray:
    """Return the mean |δ(t + T) − δ(t)| of the target's displacement δ, metres, for each interval T
    of apart_s.

    For the sine of amplitude a and frequency f, averaged over its phase, it is 2a|sin πfT| · 2/π;
    the drift |v|T is added.
    """
    sine_m = motion.amplitude_m * 4 / np.pi * np.abs(np.sin(np.pi * motion.frequency_hz * apart_s))
    return sine_m + abs(motion.velocity_m_s) * apart_s


def displacement_m(motion: Motion, time_s: np.ndarray, phase_rad: float) -> np.ndarray:
    """Return the target's displacement [f], in metres, at the time time_s [f] of each tone,
    relative to its place at the start of the frame. phase_rad: phase of the tremor at the start of
    the frame."""
    sine = np.sin(2 * np.pi * motion.frequency_hz * time_s + phase_rad) - np.sin(phase_rad)
    return motion.amplitude_m * sine + motion.velocity_m_s * time_s


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
    and interpolated. Raises HandbenchError for a motion so large that it would need too many.
    """
    frequencies_hz = echoes.scene.frequencies_hz
    middle_m, spread = _middle(echoes, along)
    low, high = reach
    residual_rad = 4 * np.pi * frequencies_hz.max() / SPEED_OF_LIGHT_M_S * spread * (high - low)
    if residual_rad > MOST_NODES * RESIDUAL_RAD:
        raise HandbenchError(
            f"target.motion: the target moves by {1e3 * (high - low):.0f} mm within a frame, but "
            "the simulation allows only millimetres; lower velocity_m_s, use fewer tones, or "
            "lower sensor.step_time_s"
        )
    nodes_m = np.linspace(low, high, 2 + int(residual_rad / RESIDUAL_RAD))
    slope = _slope(echoes, along, middle_m)
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


def _middle(echoes: Echoes, along: np.ndarray) -> tuple[np.ndarray, float]:
    """Return the mean position [3] of the target's points, and the largest difference between the
    direction cosines to `along` of a point and of this mean, both seen from the origin."""
    points_m = echoes.points_m
    middle_m = points_m.mean(axis=0)
    cosine = points_m @ along / np.linalg.norm(points_m, axis=1)
    return middle_m, float(np.abs(cosine - middle_m @ along / np.linalg.norm(middle_m)).max())


def _slope(echoes: Echoes, along: np.ndarray, middle_m: np.ndarray) -> np.ndarray:
    """Return by how much the path of each channel, from transmitter to the point middle_m [3] to
    receiver, grows per metre that the point moves along the unit vector `along`: [t, r]."""
    towards = [middle_m - leg.position_m for leg in echoes.array.legs]
    cosines = [leg @ along / np.linalg.norm(leg, axis=1) for leg in towards]
    return cosines[0][:, None] + cosines[1]


def _moved(array: AntennaArray, offset_m: np.ndarray) -> AntennaArray:
    """Return the array relative to a target that has moved by offset_m [3]: moved by −offset_m."""
    return AntennaArray(array.tx_m - offset_m, array.rx_m - offset_m)
