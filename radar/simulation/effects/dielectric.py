"""The effect "dielectric": weak reflection by foam and plastic, transmission, and delay of echoes
from inside foam.

Foam (n − 1 ≪ 1): rays are straight, and a path of length ℓ inside is longer by (n − 1)ℓ. Facets
that face the array reflect with Γ = (1 − n)/(1 + n), facets that face away with −Γ, from inside;
foam casts no shadow. Plastic: only its front surface is simulated, since refraction is strong
inside; `unsimulated_echo` warns of a strong echo from its far wall.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from handbench.radar.data.arrays import SPEED_OF_LIGHT_M_S
from handbench.radar.simulation.physics.facets import Facets, face_vectors, join_facets, volume_m3
from handbench.radar.simulation.physics.reflection import dielectric_permittivity, echo_reflection
from handbench.radar.simulation.physics.spheres import foam_delays_m, foam_echoes, has_foam
from handbench.radar.simulation.scene import CENTRE_M, Body, EchoScene
from handbench.radar.simulation.scene_echoes import Echoes, ScatteringSurface, front_facets
from handbench.support.rays import Rays

MOST_CROSSINGS = 16  # surfaces that a ray may cross on its way to a facet
# largest echo of the far wall relative to the front's that may be left out: 3-FSK changes by 0.2 mm
FAINT_DB = -20.0
BEYOND_M = 1e-5  # a ray continues this far behind a surface that it has crossed


def has_dielectric(scene: EchoScene) -> bool:
    """Return True if the target is of foam or plastic, or its balls are in foam."""
    return _of_dielectric(scene) or any(map(has_foam, scene.balls))


def dielectric(echoes: Echoes) -> Echoes:
    """Give the target the partial reflection of foam or plastic. Foam also reflects at its far
    side, with a delayed echo. For balls in foam, their echoes are delayed and those of the foam are
    added."""
    scene = echoes.scene
    if echoes.with_target and any(map(has_foam, scene.balls)):
        array, exponent = echoes.array, echoes.pattern
        echoes = replace(echoes, ball_delay_m=foam_delays_m(scene.balls))
        echoes = echoes.add(
            "dielectric", lambda: foam_echoes(scene.balls, scene.frequencies_hz, array, exponent)
        )
    surface = echoes.surface
    if surface is None or not _of_dielectric(scene):
        return echoes
    front = echo_reflection(scene.body.material, scene.frequencies_hz)
    if scene.body.material.kind == "plastic":
        layer = np.zeros(len(surface.facets), int)
        return replace(echoes, surface=replace(surface, reflection=front[None], layer=layer))
    return replace(echoes, surface=_transparent(scene, surface, front))


def far_wall_db(body: Body, frequency_hz: float) -> float:
    """Return the echo of a plastic body's far wall relative to that of its front, in dB.

    The amplitude ratio is (1 − Γ²) e^{−2αl}, for flat walls at normal incidence that are as far
    apart as the body's mean chord l = 4V/A (Cauchy).
    """
    area_m2 = np.linalg.norm(face_vectors(body.vertices_m, body.faces), axis=1).sum()
    chord_m = 4 * volume_m3(body) / area_m2
    wave = (
        2
        * np.pi
        * frequency_hz
        / SPEED_OF_LIGHT_M_S
        * np.sqrt(dielectric_permittivity(body.material))
    )
    entered = 1 - np.abs(echo_reflection(body.material, np.array([frequency_hz]))[0]) ** 2
    return float(20 * np.log10(entered) - 40 / np.log(10) * abs(wave.imag) * chord_m)


def unsimulated_echo(scene: EchoScene) -> str:
    """Return a warning if the target is of plastic so clear that the echo of its far wall, which is
    not simulated, would matter: at FAINT_DB relative to its front's echo or more. Return ""
    otherwise."""
    if scene.target is None or scene.target.material.kind != "plastic":
        return ""
    level_db = far_wall_db(scene.target, float(scene.frequencies_hz.mean()))
    if level_db < FAINT_DB:
        return ""
    return (
        "plastic is transparent, and the simulation leaves out the echo of its far wall, which is "
        f"about {level_db:.0f} dB relative to that of the front; use kind = 'metal' or a "
        "loss_tangent of 0.1 if there should be none"
    )


def _of_dielectric(scene: EchoScene) -> bool:
    return scene.target is not None and scene.target.material.kind in ("foam", "plastic")


def _transparent(
    scene: EchoScene, surface: ScatteringSurface, front: np.ndarray
) -> ScatteringSurface:
    """Return the surface of a foam body in two layers: facets that face the array, with the
    reflection `front` [f], and facets that face away and reflect from inside, delayed by the path
    in the foam."""
    body = surface.body
    parts = front_facets(scene, body), back_facets(scene, body)
    index = np.sqrt(body.material.real_permittivity)
    facets = join_facets(parts)
    return ScatteringSurface(
        body,
        facets,
        surface.oblique,
        reflection=np.stack([front, -front * (1 - front**2)]),
        layer=np.repeat([0, 1], [len(part) for part in parts]),
        delay_m=(index - 1)
        * inside_m(Rays(body.vertices_m, body.faces), facets.position_m, CENTRE_M),
    )


def back_facets(scene: EchoScene, body: Body) -> Facets:
    """Return the facets of a body whose inner side faces the array (those of its far side), with
    normals that point inwards."""
    inside_out = scene.cached(
        ("inside out", id(body)), lambda: Body(body.vertices_m, body.faces[:, ::-1], body.material)
    )
    return front_facets(scene, inside_out)


def inside_m(rays: Rays, points_m: np.ndarray, origin_m: np.ndarray) -> np.ndarray:
    """Return the lengths [n], in metres, that straight rays from an origin [3] outside a closed
    body to points [n, 3] run inside the body. rays: the body's ray caster."""
    towards = points_m - origin_m
    distance_m = np.linalg.norm(towards, axis=1)
    towards = towards / distance_m[:, None]
    inside_m, reached_m = np.zeros(len(points_m)), np.zeros(len(points_m))
    for crossing in range(MOST_CROSSINGS):
        left = np.flatnonzero(reached_m < distance_m)
        if len(left) == 0:
            break
        hit_m, _ = rays.first_hits(origin_m + reached_m[left, None] * towards[left], towards[left])
        next_m = np.minimum(reached_m[left] + hit_m, distance_m[left])
        inside_m[left] += (crossing % 2) * (next_m - reached_m[left])
        reached_m[left] = next_m + BEYOND_M
    return inside_m
