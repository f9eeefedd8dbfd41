"""The effect "clutter": echoes of the bodies of the room around the target."""

from __future__ import annotations

import numpy as np

from handbench.radar.simulation.forward import simulate
from handbench.radar.simulation.physics.shadows import shadowed
from handbench.radar.simulation.scene import CENTRE_M, Body
from handbench.radar.simulation.scene_echoes import Echoes, front_facets
from handbench.support.rays import Rays

LONGEST = 0.5  # edge of a facet, wavelengths
NODES_M = 0.03  # between the antennas of a line for which the target's shadow is computed


def clutter(echoes: Echoes, samples: np.ndarray) -> np.ndarray:
    """Add the echoes of the room's bodies, which do not move with the target, by physical optics.
    Waves that meet both target and room are not simulated."""
    rooms = [room_echoes(echoes, echoes.scene.target)] * echoes.frames
    if echoes.empty:
        rooms.append(room_echoes(echoes, None))
    return samples + np.stack(rooms)


def room_echoes(echoes: Echoes, target: Body | None) -> np.ndarray:
    """Simulate the echoes of the room's bodies behind a target, or of the room without it:
    complex64 [f, t, r].

    Facets that are hidden from the aperture's centre are left out. With the effect "shadow", each
    antenna has its own blurred shadow of the target instead.
    """
    scene, array = echoes.scene, echoes.array
    rays = _rays([*scene.room, *([] if target is None else [target])])
    samples = np.zeros((len(scene.frequencies_hz), *array.channels), np.complex64)
    for body in scene.room:
        facets = front_facets(scene, body, LONGEST)
        if target is None or echoes.facets is None or echoes.facets.sight is None:
            facets = facets.where(rays.in_sight(facets.position_m, CENTRE_M))
        else:
            facets, reached = shadowed(scene, target, body, facets, rays, array, NODES_M)
            facets = facets.where(reached)
        echo = simulate(
            facets, scene.frequencies_hz, array, tolerance=echoes.tolerance, pattern=echoes.pattern
        )
        samples += echo * np.float32(10 ** (body.reflectivity_db / 20))
    return samples


def _rays(bodies: list[Body]) -> Rays:
    """Return one ray caster for all bodies together."""
    counts = np.cumsum([0, *(len(body.vertices_m) for body in bodies[:-1])])
    vertices_m = np.concatenate([body.vertices_m for body in bodies])
    return Rays(
        vertices_m, np.concatenate([body.faces + n for body, n in zip(bodies, counts, strict=True)])
    )
