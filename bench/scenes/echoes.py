"""Echoes of a scene: its conversion to the input of the radar simulation, the selection of effects,
and the simulation."""

from collections.abc import Callable, Iterator

import numpy as np

from handbench.bench.scenes.bones import palmar
from handbench.bench.scenes.build import Scene
from handbench.bench.scenes.hand import SkinnedHand
from handbench.bench.scenes.scene_file import CalibrationTarget, HandTarget
from handbench.bench.scenes.stand import PLATE_BOX_M, cuboid
from handbench.radar.simulation.ablation import explain
from handbench.radar.simulation.catalogue import choose
from handbench.radar.simulation.effects.motion import frame_starts, surface_m, velocity_m_s
from handbench.radar.simulation.scene import Ball, Body, Choice, EchoScene, Roughness
from handbench.radar.simulation.simulate import SimulatedCapture, simulate_scene

ROOM_STEP_M = 5e-3


def echoes(scene: Scene, frames: int, radar_scene: EchoScene) -> SimulatedCapture:
    """Simulate the echoes of a scene with the effects that its file asks for.

    frames: number of repeated measurements, which differ only in what is random over time, such as
    noise. radar_scene: the result of `echo_scene` for this scene.
    """
    stand, chosen = scene.file.stand, choose(radar_scene, scene.file.effects)
    simulated = simulate_scene(radar_scene, chosen, frames, empty=stand.empty or stand.subtract)
    return simulated.subtracted() if stand.subtract else simulated


def explained(scene: Scene) -> tuple[Choice, ...]:
    """Return one row for each effect of the scene: whether it is simulated, and why, with what
    leaving it out of a coarse simulation changes."""
    radar_scene = echo_scene(scene)
    return explain(radar_scene, choose(radar_scene, scene.file.effects))


def echo_scene(scene: Scene) -> EchoScene:
    """Convert a scene to the input of the radar simulation: array, target, balls, room, the causes
    of effects, and the tones with the time at which each is measured. The tones are in ascending
    order; if some are repeated, in the order in which they are measured."""
    sensor, target = scene.file.sensor, scene.file.target
    different_hz, order = np.unique(sensor.frequencies_hz, return_index=True)
    if len(different_hz) < len(sensor.frequencies_hz):
        order = np.arange(len(sensor.frequencies_hz))
    return EchoScene(
        array=scene.array,
        frequencies_hz=sensor.frequencies_hz[order],
        time_s=order * sensor.step_time_s,
        target=_target(scene),
        balls=_balls(scene),
        room=_room(scene),
        sensor=sensor,
        noise=scene.file.noise,
        motion=target.motion,
        roughness=Roughness() if isinstance(target, CalibrationTarget) else target.roughness,
        seed=scene.file.seed,
        polarisation_deg=sensor.polarisation_deg,
        frame_period_s=sensor.frame_period_s,
        origin_m=scene.radar_from_target.matrix[:3, 3],
        bent=_bent(scene),
    )


def surfaces(
    scene: Scene, radar_scene: EchoScene, frames: int
) -> Iterator[tuple[np.ndarray, np.ndarray]]:
    """Yield the target's true surface at the start of each frame: vertices [n, 3] in the radar
    frame, metres, and their velocities [n, 3], m/s. Its faces are those of scene.target_mesh."""
    vertices_m = np.asarray(scene.target_mesh.vertices)
    for start in frame_starts(radar_scene, frames):
        now = (radar_scene, vertices_m, *start)
        yield surface_m(*now), velocity_m_s(*now)


def _bent(scene: Scene) -> Callable[[float], np.ndarray] | None:
    """Return a hand's vertices [n, 3] in the radar frame as a function of time, with the motion of
    its fingers alone; None if they do not move."""
    target = scene.file.target
    if not isinstance(target, HandTarget) or target.motion.pose is None:
        return None
    in_hand_m = scene.radar_from_target.inverse().points(np.asarray(scene.target_mesh.vertices))
    skin = SkinnedHand(in_hand_m, target.angles, target.build)
    return lambda time_s: scene.radar_from_target.points(skin.posed(target.angles_at(time_s)))


def _target(scene: Scene) -> Body | None:
    """Return the target as a body of the radar simulation, with its material, in the radar frame.
    None for a calibration target, whose spheres are simulated with its balls."""
    target = scene.file.target
    if isinstance(target, CalibrationTarget):
        return None
    vertices_m, faces = (
        np.asarray(scene.target_mesh.vertices),
        np.asarray(scene.target_mesh.triangles),
    )
    palm = None
    if isinstance(target, HandTarget):
        in_hand_m = scene.radar_from_target.inverse().points(vertices_m[faces].mean(axis=1))
        palm = palmar(target.angles, in_hand_m, target.build)
    return Body(vertices_m, faces, target.material, palm)


def _balls(scene: Scene) -> tuple[Ball, ...]:
    if scene.target is None:
        return ()
    elements, foam = scene.target.element, scene.target.foam_permittivity
    placed = zip(scene.balls_m, elements, strict=True)
    return tuple(Ball(centre_m, e.ball_radius_m, e.sphere_radius_m, foam) for centre_m, e in placed)


def _room(scene: Scene) -> tuple[Body, ...]:
    """Return the back plate and, if there is one, the block under the forearm as bodies in the
    radar frame; empty if absorber covers them (the scene file has no stand.reflectivity_db)."""
    reflectivity_db = scene.file.stand.reflectivity_db
    if reflectivity_db is None:
        return ()
    boxes = [PLATE_BOX_M] if scene.block_m is None else [PLATE_BOX_M, scene.block_m]
    grids = (cuboid(box_m, ROOM_STEP_M) for box_m in boxes)
    return tuple(
        Body(scene.radar_from_photo.points(v), faces, reflectivity_db=reflectivity_db)
        for v, faces in grids
    )
