"""Dielectrics: they reflect little, let the wave in, and delay what comes from inside.

Foam (n − 1 ≪ 1): rays pass straight, and a path of length ℓ inside is longer by (n − 1)ℓ. Facets that face the array
reflect with Γ = (1 − n)/(1 + n) and those that turn away with −Γ, seen from inside; foam casts no shadow. Plastic: only
its surface, since what enters is bent far away from the straight path; how strong that would be is in the estimate.
"""

from __future__ import annotations

import math

import numpy as np

from radar.data.arrays import SPEED_OF_LIGHT_M_S
from radar.simulation.effects.base import Effect, Estimate
from radar.simulation.forward import Scatterers, simulate
from radar.simulation.physics.facets import Facets, face_vectors, joined
from radar.simulation.physics.reflection import dielectric_permittivity, echo_reflection
from radar.simulation.physics.spheres import foam_delays_m, foam_echoes, has_foam
from radar.simulation.pilot import CENTRE_M, TOLERANCE, change_db, change_mm, pilot
from radar.simulation.scene import Body, EchoScene
from radar.simulation.state import EchoState, Surface, facing
from radar.support.rays import Rays

MOST_CROSSINGS = 16  # surfaces that a ray may cross on its way to a facet
BEYOND_M = 1e-5  # a ray goes on this far behind the surface that it has crossed


class Dielectric(Effect):
    """Partial reflection, penetration and delay."""

    id = "dielectric"
    does = "foam delays what is inside it and echoes from front and back; plastic reflects in part"
    source = "Fresnel at normal incidence, straight rays with (n − 1)·path, geometrical optics for balls' foam"
    takes_time = False

    def missing(self, scene: EchoScene) -> str:
        found = _of_dielectric(scene) or any(map(has_foam, scene.balls))
        return "" if found else "a target of foam or plastic, or balls in foam"

    def estimate(self, scene: EchoScene) -> Estimate:
        tones_hz = pilot(scene).tones_hz
        added = foam_echoes(scene.balls, tones_hz, scene.array)
        delay_mm, reasons = 0.0, []
        if scene.balls:
            delay_mm = 1e3 * float(foam_delays_m(scene.balls).mean())
            reasons.append(f"the balls' foam delays by {delay_mm:.2f} mm on average and echoes itself")
        if _of_dielectric(scene):
            reasons.append(_inside(scene.body, tones_hz))
            if scene.body.material.kind == "foam":
                added += _back_echoes(scene, tones_hz)
        samples = pilot(scene).samples + added
        return Estimate(delay_mm + change_mm(scene, samples), _level_db(scene, samples), "; ".join(reasons), cost_s=1.0)

    def apply(self, state: EchoState) -> None:
        if state.with_target and any(map(has_foam, state.scene.balls)):
            state.ball_delay_m = foam_delays_m(state.scene.balls)
            balls, tones_hz = state.scene.balls, state.scene.frequencies_hz
            state.extra.append(lambda: foam_echoes(balls, tones_hz, state.array, state.pattern))
        if state.surface is None or not _of_dielectric(state.scene):
            return
        front = echo_reflection(state.scene.body.material, state.scene.frequencies_hz)
        if state.scene.body.material.kind == "plastic":
            state.surface.reflection, state.surface.layer = front[None], np.zeros(len(state.surface.facets), int)
        else:
            _make_transparent(state, state.surface, front)


def _of_dielectric(scene: EchoScene) -> bool:
    return scene.target is not None and scene.target.material.kind in ("foam", "plastic")


def _make_transparent(state: EchoState, surface: Surface, front: np.ndarray) -> None:
    """All of the body's facets, in two layers: facing the array, with `front` [f], and turned away."""
    body = surface.body
    parts = facing(state.scene, body), turned_away(state.scene, body)
    index = np.sqrt(body.material.real_permittivity)
    surface.facets = facets = joined(parts)
    surface.seen = None
    surface.layer = np.repeat([0, 1], [len(part) for part in parts])
    surface.reflection = np.stack([front, -front * (1 - front**2)])
    surface.delay_m = (index - 1) * inside_m(Rays(body.vertices_m, body.faces), facets.position_m, CENTRE_M)


def turned_away(scene: EchoScene, body: Body) -> Facets:
    """The facets that the array would see from inside the body, their normals turned inwards."""
    inside_out = scene.kept(("inside out", id(body)), lambda: Body(body.vertices_m, body.faces[:, ::-1], body.material))
    return facing(scene, inside_out)


def inside_m(rays: Rays, points_m: np.ndarray, origin_m: np.ndarray) -> np.ndarray:
    """Length [n] inside a closed body of the straight rays from an origin [3] outside it to points [n, 3]."""
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


def _back_echoes(scene: EchoScene, tones_hz: np.ndarray) -> np.ndarray:
    """Samples [f, t, r] of a foam target's back surface with the mean delay everywhere."""
    material = scene.body.material
    facets = turned_away(scene, scene.body)
    delay_m = (np.sqrt(material.real_permittivity) - 1) * mean_thickness_m(scene.body)
    back = Scatterers(facets.position_m, facets.area_m2, facets.normal, np.full(len(facets), delay_m))
    reflection = echo_reflection(material, tones_hz)
    echoes = simulate(back, tones_hz, scene.array, tolerance=TOLERANCE)
    return echoes * (-reflection * (1 - reflection**2))[:, None, None]


def _inside(body: Body, tones_hz: np.ndarray) -> str:
    """Strength of the back's echo against the front's, in words."""
    material, thickness_m = body.material, mean_thickness_m(body)
    reflection = echo_reflection(material, tones_hz)
    n = np.sqrt(dielectric_permittivity(material))
    wavenumber = 2 * np.pi * tones_hz[0] / SPEED_OF_LIGHT_M_S
    back_db = 20 * np.log10(abs(1 - reflection[0] ** 2)) + 40 * math.log10(math.e) * wavenumber * n.imag * thickness_m
    words = f"surface {20 * np.log10(abs(reflection[0])):.1f} dB, back {back_db:.1f} dB of it"
    return words if material.kind == "foam" else f"{words} through {1e3 * thickness_m:.0f} mm, which is left out"


def mean_thickness_m(body: Body) -> float:
    """Mean thickness of a closed body along z: its volume over its area projected on x and y (overlaps count twice)."""
    vectors = face_vectors(body.vertices_m, body.faces)
    volume_m3 = (vectors * body.vertices_m[body.faces].mean(axis=1)).sum() / 3
    return float(volume_m3 / (np.abs(vectors[:, 2]).sum() / 2))


def _level_db(scene: EchoScene, samples: np.ndarray) -> float:
    """Level of the added echoes against the target's; of a dielectric body, of the part taken from metal's."""
    if not _of_dielectric(scene):
        return change_db(scene, samples)
    return float(20 * np.log10(abs(1 - echo_reflection(scene.body.material, pilot(scene).tones_hz)[0])))
