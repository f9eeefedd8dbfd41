"""The effect "clutter": echoes of the bodies of the room around the target."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from handbench.radar.simulation.forward import Scatterers, simulate
from handbench.radar.simulation.physics.reflection import echo_reflections
from handbench.radar.simulation.physics.shadows import sight_of
from handbench.radar.simulation.scene import CENTRE_M, Body
from handbench.radar.simulation.scene_echoes import Echoes, front_facets
from handbench.support.rays import Rays

LONGEST = 0.5  # edge of facets behind the target, wavelengths
NODES_M = 0.03  # between the antennas of a line for which the target's shadow is computed


def clutter(echoes: Echoes, samples: np.ndarray) -> np.ndarray:
    """Add the echoes of the room's bodies, which do not move with the target, by physical optics.

    Facets that are hidden from the aperture's centre are left out; with the effect "shadow", each
    antenna has its own blurred shadow of the target instead. Waves that meet both target and
    room are not simulated.
    """
    rooms = np.concatenate([room_echoes(echoes, echoes.scene.target)[None]] * echoes.frames)
    if echoes.empty:
        rooms = np.concatenate([rooms, room_echoes(echoes, None)[None]])
    return samples + rooms


def room_echoes(echoes: Echoes, target: Body | None) -> np.ndarray:
    """Simulate the echoes of the room's bodies behind a target, or of the room without it:
    complex64 [f, t, r]."""
    tones_hz, room = echoes.scene.frequencies_hz, echoes.scene.room
    rays = _rays([*room, *([] if target is None else [target])])
    samples = np.zeros((len(tones_hz), *echoes.array.channels), np.complex64)
    for body in room:
        optics = _seen_behind(echoes, target, rays, body)
        echo = simulate(
            optics, tones_hz, echoes.array, tolerance=echoes.tolerance, pattern=echoes.pattern
        )
        if body.reflectivity_db is None:
            reflection = echo_reflections(body.material, tones_hz)[0]
        else:
            reflection = np.full(len(tones_hz), 10 ** (body.reflectivity_db / 20))
        samples += echo * reflection.astype(np.complex64)[:, None, None]
    return samples


def _seen_behind(echoes: Echoes, target: Body | None, rays: Rays, body: Body) -> Scatterers:
    """Return as scatterers the facets of a body of the room that the target does not hide from the
    aperture's centre.

    With the effect "shadow", the facets are coarser, and each has the complex factors by which the
    target changes the fields of the antennas there.
    """
    scene, surface = echoes.scene, echoes.surface
    if target is None or surface is None or surface.sight is None:
        facets = front_facets(scene, body)
        return facets.where(rays.in_sight(facets.position_m, CENTRE_M)).optics
    facets = front_facets(scene, body, LONGEST)
    sight, reached = sight_of(scene, target, body, facets, rays, echoes.array, NODES_M)
    return replace(facets.optics, sight=sight).where(reached)


def _rays(bodies: list[Body]) -> Rays:
    """Return one ray caster for all bodies together."""
    counts = np.cumsum([0, *(len(body.vertices_m) for body in bodies[:-1])])
    vertices_m = np.concatenate([body.vertices_m for body in bodies])
    return Rays(
        vertices_m, np.concatenate([body.faces + n for body, n in zip(bodies, counts, strict=True)])
    )
