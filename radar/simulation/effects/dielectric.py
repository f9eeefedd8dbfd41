"""Dielectrics: they reflect little, let the wave in, and delay what comes from inside.

Foam (n − 1 ≪ 1): rays pass straight, and a path of length ℓ inside is longer by (n − 1)ℓ. Facets
that face the array reflect with Γ = (1 − n)/(1 + n) and those that turn away with −Γ, seen from
inside; foam casts no shadow. Plastic: only its surface, since what enters is bent far away from the
straight path; `unsimulated_echo` says where its far wall echoes, too.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from handbench.radar.data.arrays import SPEED_OF_LIGHT_M_S
from handbench.radar.simulation.effects.quick_estimate import CENTRE_M
from handbench.radar.simulation.physics.facets import Facets, face_vectors, join_facets, volume_m3
from handbench.radar.simulation.physics.reflection import dielectric_permittivity, echo_reflection
from handbench.radar.simulation.physics.spheres import foam_delays_m, foam_echoes, has_foam
from handbench.radar.simulation.scene import Body, EchoScene
from handbench.radar.simulation.scene_echoes import Echoes, ScatteringSurface, front_facets
from handbench.support.rays import Rays

MOST_CROSSINGS = 16  # surfaces that a ray may cross on its way to a facet
FAINT_DB = (
    -20.0
)  # echo of the far wall over the front's that may be left out: 3-FSK then moves by 0.2 mm
BEYOND_M = 1e-5  # a ray goes on this far behind the surface that it has crossed


def has_dielectric(scene: EchoScene) -> bool:
    """True where the target or what is around its balls is a dielectric."""
    return _of_dielectric(scene) or any(map(has_foam, scene.balls))


def dielectric(echoes: Echoes) -> Echoes:
    """Partial reflection, penetration and delay."""
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
    """The echo of a plastic body's far wall over that of its front, dB: both flat, met squarely and
    as far apart as its mean chord 4V/A (Cauchy), (1 − Γ²) e^{−2αl}."""
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
    """The part of the scene's echoes that is not simulated, as a sentence for people; "" if none
    that counts."""
    if scene.target is None or scene.target.material.kind != "plastic":
        return ""
    level_db = far_wall_db(scene.target, float(scene.frequencies_hz.mean()))
    if level_db < FAINT_DB:
        return ""
    return (
        f"plastic lets waves through: its far wall echoes about {level_db:.0f} dB against its "
        "front, and that is not "
        "simulated; painted with metal (kind = 'metal'), or with a loss_tangent of 0.1, it would "
        "not matter"
    )


def _of_dielectric(scene: EchoScene) -> bool:
    return scene.target is not None and scene.target.material.kind in ("foam", "plastic")


def _transparent(
    scene: EchoScene, surface: ScatteringSurface, front: np.ndarray
) -> ScatteringSurface:
    """All of the body's facets, in two layers: facing the array, with `front` [f], and turned
    away."""
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
    """The facets that the array would see from inside the body, their normals turned inwards."""
    inside_out = scene.cached(
        ("inside out", id(body)), lambda: Body(body.vertices_m, body.faces[:, ::-1], body.material)
    )
    return front_facets(scene, inside_out)


def inside_m(rays: Rays, points_m: np.ndarray, origin_m: np.ndarray) -> np.ndarray:
    """Length [n] inside a closed body of the straight rays from an origin [3] outside it to points
    [n, 3]."""
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
