"""Further echoes: those over two places of the target, as between fingers, and those of what stands around it."""

from __future__ import annotations

import dataclasses

import numpy as np

from handbench.radar.data.arrays import SPEED_OF_LIGHT_M_S, AntennaArray
from handbench.radar.simulation.effects.base import CLOSED, Effect, Glance
from handbench.radar.simulation.forward import Scatterers
from handbench.radar.simulation.physics.bundles import Bundles, traced_nodes
from handbench.radar.simulation.physics.coarse import double_bounce, single_bounce
from handbench.radar.simulation.physics.creeping import roundness_of
from handbench.radar.simulation.physics.diffracted import by_rays, samples_of, sight_of
from handbench.radar.simulation.physics.facets import face_vectors
from handbench.radar.simulation.physics.line_of_sight import rays_of
from handbench.radar.simulation.physics.ray_tubes import mirrors_of, trace
from handbench.radar.simulation.physics.reflection import body_reflection, echo_reflection, oblique_ratios
from handbench.radar.simulation.pilot import CENTRE_M, LONGEST, body_echoes, visible_surface
from handbench.radar.simulation.scene import Body, EchoScene, Material
from handbench.radar.simulation.state import EchoState, facing
from handbench.support.parallel import for_each
from handbench.support.rays import Rays

BOUNCES = 4  # at most: places that a wave meets
PATCH = 0.25  # longest edge of a mirror, wavelengths
SECONDS_PER_FACE, SECONDS_PER_TUBE, SECONDS_PER_FACET = 3e-6, 2e-6, 3e-6
NODES_M, SAMPLES_M = 0.03, 8e-3  # between antennas and points of the room for which the diffraction is computed


class Multipath(Effect):
    """Two to four bounces on the target's own surface: the mean of all but the last as mirrors and the last by physical
    optics, and of the same from the receivers, so that transmitters and receivers can be exchanged.

    Left out: more bounces, edges."""

    id = "multipath"

    def missing(self, scene: EchoScene) -> str:
        return scene.lacks_surface

    def cost_s(self, scene: EchoScene) -> float:
        count = _twice(scene)[1]
        antennas = sum(len(traced_nodes(array)[0]) for array in (scene.array, _exchanged(scene.array)))
        tubes = count * 4 * antennas  # the coarse surface's facets are twice as wide
        return SECONDS_PER_FACE * len(scene.body.faces) + SECONDS_PER_TUBE * tubes

    def glance(self, scene: EchoScene) -> Glance:
        caught, count = _twice(scene)
        if count == 0:
            return Glance(0.0, "no facet mirrors onto another")
        material, once = scene.body.material, target_power(scene)
        reflection = float(np.abs(echo_reflection(material, scene.frequencies_hz)).max())
        ratio = reflection * np.sqrt(caught / once) if once > 0 else np.inf
        return Glance.of_level(scene, ratio, f"geometrical optics of {count} facets that mirror onto others")

    def apply(self, state: EchoState) -> None:
        surface = state.surface
        if surface is None:
            return
        body, rays, layer = surface.body, rays_of(state.scene, surface.body), np.zeros(len(surface.body.faces), int)
        if surface.layer is not None:  # 0 where no facet of a face is in sight
            layer[surface.facets.face] = surface.layer
        longest_m = PATCH * state.scene.wavelength_m * state.scene.mirrors_coarser
        antennas_m = np.concatenate([leg.position_m for leg in state.array.legs])
        mirrors = mirrors_of(rays, body, antennas_m, longest_m, BOUNCES - 1)
        if not len(mirrors.face):
            return
        wavenumber = 0.0 if surface.sight is None else roundness_of(state.scene, body).wavenumber
        arrays = {1: state.array, -1: _exchanged(state.array)}
        found: dict[int, Bundles] = {}

        def bounce(sense: int) -> None:
            at = traced_nodes(arrays[sense], state.scene.nodes_apart)
            few = AntennaArray(arrays[sense].tx_m[at[0]], arrays[sense].rx_m[at[1]])
            traced = trace(rays, mirrors, few, int(mirrors.bounces.max()), wavenumber)
            found[sense] = Bundles(traced, layer, at, state.scene.dipole)

        for_each(bounce, arrays)
        if not any(map(len, found.values())):
            return

        def echo() -> np.ndarray:
            material = Material() if surface.reflection is None else body.material  # where it is off, that of metal
            ratios = oblique_ratios(material, float(state.scene.frequencies_hz.mean()))
            echoes = np.zeros((len(state.scene.frequencies_hz), *state.array.channels), np.complex64)
            for sense, array in arrays.items():
                one = found[sense].echo(state.scene.frequencies_hz, array, surface.reflection, state.pattern, ratios)
                echoes += (one if sense > 0 else one.swapaxes(1, 2)) / 2
            return echoes

        state.extra.append(echo)


def _exchanged(array: AntennaArray) -> AntennaArray:
    """Transmitters as receivers and the other way round."""
    return AntennaArray(array.rx_m, array.tx_m)


def _twice(scene: EchoScene) -> tuple[float, int]:
    """`double_bounce` of the target. Made once."""
    return scene.kept("twice", lambda: double_bounce(visible_surface(scene), scene.array, CENTRE_M))


def target_power(scene: EchoScene) -> float:
    """`single_bounce` of the target, as if it were of metal."""
    return single_bounce(visible_surface(scene), scene.array, CENTRE_M)


class Clutter(Effect):
    """Echoes of the bodies around the target, which stay when it moves or is taken away: by physical optics, in its
    shadow as the aperture's centre casts it, or diffracted as each antenna does; waves that go by way of both target
    and room are left out."""

    id = "clutter"

    def missing(self, scene: EchoScene) -> str:
        return "" if scene.room else "[stand] with reflectivity_db"

    def cost_s(self, scene: EchoScene) -> float:
        area_m2 = sum(np.linalg.norm(face_vectors(b.vertices_m, b.faces), axis=1).sum() for b in scene.room) / 2
        return SECONDS_PER_FACET * 2 * area_m2 / (PATCH * scene.wavelength_m) ** 2

    def glance(self, scene: EchoScene) -> Glance | None:
        """As if the nearest body of the room were a mirror before all of the array: 1/(2z) of what it returns."""
        if scene.lacks_surface:
            return None
        target = np.abs(echo_reflection(scene.body.material, scene.frequencies_hz)).min() * np.sqrt(target_power(scene))
        nearest_m = min(float(body.vertices_m[:, 2].min()) for body in scene.room)
        level = max(float(np.abs(body_reflection(body, scene.frequencies_hz)).max()) for body in scene.room)
        ratio = level / (2 * nearest_m * target) if target > 0 and nearest_m > 0 else np.inf
        return Glance.of_level(scene, ratio, "the room's echo, were it a mirror, over the target's", CLOSED)

    def apply(self, state: EchoState) -> None:
        scene = state.scene
        rays = _rays([*scene.room, *([scene.body] if state.with_target and not scene.lacks_surface else [])])
        clutter = np.zeros(state.samples.shape[1:], np.complex64)
        for body in scene.room:
            optics = _seen_behind(state, rays, body)
            clutter += body_echoes(body, optics, scene.frequencies_hz, state.array, state.tolerance, state.pattern)
        state.samples = state.samples + clutter


def _seen_behind(state: EchoState, rays: Rays, body: Body) -> Scatterers:
    """A body's facets as the aperture's centre sees them behind the target; where that diffracts, coarser ones as each
    antenna does."""
    scene, surface = state.scene, state.surface
    if surface is None or surface.sight is None:
        facets = facing(scene, body)
        return facets.where(rays.in_sight(facets.position_m, CENTRE_M)).optics
    facets = facing(scene, body, LONGEST)
    samples, turns_per_m = samples_of(body, facets, SAMPLES_M), scene.frequencies_hz / SPEED_OF_LIGHT_M_S
    look = by_rays(rays, samples.points_m)
    sight, some = sight_of(scene, surface.body, samples, look, turns_per_m, state.array, NODES_M)
    return dataclasses.replace(facets.optics, sight=sight).where(some)


def _rays(bodies: list[Body]) -> Rays:
    """All bodies as one."""
    counts = np.cumsum([0, *(len(body.vertices_m) for body in bodies[:-1])])
    vertices_m = np.concatenate([body.vertices_m for body in bodies])
    return Rays(vertices_m, np.concatenate([body.faces + n for body, n in zip(bodies, counts, strict=True)]))
