"""The movement of a scene's target: where its surface is at each time, and how fast it moves.

A hand's fingers move first, then the target turns about its pivot, then it is displaced.
"""

from dataclasses import replace

import numpy as np
from scipy.spatial.transform import Rotation

from handbench.radar.simulation.causes import Motion
from handbench.radar.simulation.scene import EchoScene, generator
from handbench.support.errors import HandbenchError

DIFFERENCE_S = 1e-4  # between the two times of a velocity's difference: 9 Hz err by 1e-6


def frame_starts(scene: EchoScene, frames: int) -> list[tuple[float, float]]:
    """Return when each frame starts: (seconds since the movement began, phase of the tremor when
    it began). If the scene has a frame period, one movement goes on through all frames; otherwise
    each frame has its own, with its own phase of the tremor."""
    phases = [0.0] * frames
    if scene.motion.amplitude_m:
        seeds = [scene.seeds("motion", 0, frame) for frame in range(frames)]
        phases = [generator(seed).uniform(0, 2 * np.pi) for seed in seeds]
    if scene.frame_period_s is None:
        return [(0.0, phase) for phase in phases]
    return [(frame * scene.frame_period_s, phases[0]) for frame in range(frames)]


def displacement_m(motion: Motion, time_s: np.ndarray, phase_rad: float) -> np.ndarray:
    """Return the target's displacement [f], in metres, at the times time_s [f], relative to its
    place at time 0. phase_rad: phase of the tremor at time 0."""
    sine = np.sin(2 * np.pi * motion.frequency_hz * time_s + phase_rad) - np.sin(phase_rad)
    return motion.amplitude_m * sine + motion.velocity_m_s * time_s


def moved_as_a_whole(
    scene: EchoScene, points_m: np.ndarray, time_s: float, tremor_rad: float
) -> np.ndarray:
    """Return where points [n, 3] of the target are after its rotation and displacement."""
    motion = scene.motion
    turn = Rotation.from_rotvec(np.radians(motion.rotation_deg_s) * time_s).as_matrix()
    from_pivot_m = points_m - (scene.origin_m + motion.pivot_m)
    offset_m = displacement_m(motion, np.array(time_s), tremor_rad) * motion.along
    return points_m + from_pivot_m @ (turn - np.eye(3)).T + offset_m


def surface_m(
    scene: EchoScene, vertices_m: np.ndarray, time_s: float, tremor_rad: float
) -> np.ndarray:
    """Return where the vertices [n, 3] of the target's surface are, which at time 0 are at
    vertices_m."""
    shaped_m = vertices_m if scene.bent is None else scene.bent(time_s)
    return moved_as_a_whole(scene, shaped_m, time_s, tremor_rad)


def velocity_m_s(
    scene: EchoScene, vertices_m: np.ndarray, time_s: float, tremor_rad: float
) -> np.ndarray:
    """Return the velocities [n, 3] of these vertices, by a central difference."""
    before_m, behind_m = (
        surface_m(scene, vertices_m, time_s + step_s, tremor_rad)
        for step_s in (-DIFFERENCE_S / 2, DIFFERENCE_S / 2)
    )
    return (behind_m - before_m) / DIFFERENCE_S


def scene_at(scene: EchoScene, time_s: float, tremor_rad: float) -> EchoScene:
    """Return the scene with its target where it is at a time. Raises HandbenchError if it then
    reaches behind the plane of the array."""
    balls = tuple(
        replace(ball, centre_m=moved_as_a_whole(scene, ball.centre_m[None], time_s, tremor_rad)[0])
        for ball in scene.balls
    )
    target = scene.target
    if target is not None:
        target = replace(target, vertices_m=surface_m(scene, target.vertices_m, time_s, tremor_rad))
    nearest_m = min(
        [ball.centre_m[2] - ball.radius_m for ball in balls]
        + ([] if target is None else [float(target.vertices_m[:, 2].min())])
    )
    if nearest_m <= 0:
        raise HandbenchError(
            f"target.motion: after {time_s:.3g} s the target extends {-1e3 * nearest_m:.0f} mm "
            "behind the plane of the array; let it move more slowly, simulate fewer frames, or "
            "enlarge target.distance_m"
        )
    return replace(scene, target=target, balls=balls)
