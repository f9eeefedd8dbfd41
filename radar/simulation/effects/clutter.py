"""The effect "clutter": echoes of the bodies of the room around the target."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from handbench.radar.simulation.effects.quick_estimate import (
    CENTRE_M,
    CLOSED,
    LONGEST,
    QuickEstimate,
    single_bounce,
    visible_surface,
)
from handbench.radar.simulation.forward import Scatterers, simulate
from handbench.radar.simulation.physics.facets import face_vectors
from handbench.radar.simulation.physics.reflection import body_reflection, echo_reflection
from handbench.radar.simulation.physics.sight import samples_of, sight_of
from handbench.radar.simulation.scene import Body, EchoScene
from handbench.radar.simulation.scene_echoes import Echoes, front_facets
from handbench.support.rays import Rays

FACET = 0.25  # longest edge of a facet of the room, wavelengths
SECONDS_PER_FACET = 3e-6
NODES_M = 0.03  # between the antennas for which the diffraction is computed
SAMPLES_M = 8e-3  # between the points of the room for which it is


def target_power(scene: EchoScene) -> float:
    """Return the power, in 1/m², of the target's echo by geometrical optics, as if it were of
    metal: of the waves that return to the aperture after one reflection (`single_bounce`)."""
    return single_bounce(visible_surface(scene), scene.array, CENTRE_M)


def clutter(echoes: Echoes) -> Echoes:
    """Add the echoes of the room's bodies, which do not move with the target, by physical optics.

    Facets that the target hides from the aperture's centre are left out; if shadows are diffracted,
    each antenna has its own blurred shadow of the target instead. Waves that meet both target and
    room are not simulated.
    """
    scene, tones_hz = echoes.scene, echoes.scene.frequencies_hz
    rays = _rays([*scene.room, *([scene.body] if echoes.with_target and scene.opaque else [])])
    added = np.zeros(echoes.samples.shape[1:], np.complex64)
    for body in scene.room:
        optics = _seen_behind(echoes, rays, body)
        echo = simulate(
            optics, tones_hz, echoes.array, tolerance=echoes.tolerance, pattern=echoes.pattern
        )
        added += echo * body_reflection(body, tones_hz).astype(np.complex64)[:, None, None]
    return echoes.record(echoes.samples + added)


def clutter_cost_s(scene: EchoScene) -> float:
    """Estimate the CPU seconds that the room's echoes take, from its surface area."""
    area_m2 = (
        sum(np.linalg.norm(face_vectors(b.vertices_m, b.faces), axis=1).sum() for b in scene.room)
        / 2
    )
    return float(SECONDS_PER_FACET * 2 * area_m2 / (FACET * scene.wavelength_m) ** 2)


def estimate_clutter(scene: EchoScene) -> QuickEstimate | None:
    """Estimate how much the room's echo changes depths. None (unknown) without an opaque target.

    The amplitude of the echo is at most that of a large mirror at the distance z of the room's
    nearest body, 1/(2z).
    """
    if not scene.opaque:
        return None
    target = np.abs(echo_reflection(scene.body.material, scene.frequencies_hz)).min() * np.sqrt(
        target_power(scene)
    )
    nearest_m = min(float(body.vertices_m[:, 2].min()) for body in scene.room)
    level = max(
        float(np.abs(body_reflection(body, scene.frequencies_hz)).max()) for body in scene.room
    )
    ratio = level / (2 * nearest_m * target) if target > 0 and nearest_m > 0 else np.inf
    return QuickEstimate.of_level(
        scene, ratio, "the room's echo, were it a mirror, over the target's", CLOSED
    )


def _seen_behind(echoes: Echoes, rays: Rays, body: Body) -> Scatterers:
    """Return as scatterers the facets of a body of the room that the target does not hide from the
    aperture's centre.

    If shadows are diffracted, the facets are coarser, and each has the complex factors by which the
    target changes the fields of the antennas there.
    """
    scene, surface = echoes.scene, echoes.surface
    if surface is None or surface.sight is None:
        facets = front_facets(scene, body)
        return facets.where(rays.in_sight(facets.position_m, CENTRE_M)).optics
    facets = front_facets(scene, body, LONGEST)
    samples = samples_of(body, facets, SAMPLES_M)
    sight, some = sight_of(scene, surface.body, samples, rays, echoes.array, NODES_M)
    return replace(facets.optics, sight=sight).where(some)


def _rays(bodies: list[Body]) -> Rays:
    """Return one ray caster for all bodies together."""
    counts = np.cumsum([0, *(len(body.vertices_m) for body in bodies[:-1])])
    vertices_m = np.concatenate([body.vertices_m for body in bodies])
    return Rays(
        vertices_m, np.concatenate([body.faces + n for body, n in zip(bodies, counts, strict=True)])
    )
