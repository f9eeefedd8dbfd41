"""Further echoes: those over two places of the target, as between fingers, and those of what stands
around it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from handbench.radar.data.arrays import AntennaArray
from handbench.radar.simulation.effects.coarse import (
    CENTRE_M,
    CLOSED,
    LONGEST,
    QuickEstimate,
    coarse_surface,
    count_mirroring,
    single_bounce,
    some_face_each_other,
    visible_surface,
)
from handbench.radar.simulation.forward import Scatterers, simulate
from handbench.radar.simulation.physics.bundles import Bundles, traced_nodes
from handbench.radar.simulation.physics.creeping import roundness_of
from handbench.radar.simulation.physics.diffracted import samples_of, sight_of
from handbench.radar.simulation.physics.facets import face_vectors
from handbench.radar.simulation.physics.line_of_sight import rays_of
from handbench.radar.simulation.physics.ray_tubes import mirrors_of, trace
from handbench.radar.simulation.physics.reflection import (
    body_reflection,
    echo_reflection,
    oblique_ratios,
)
from handbench.radar.simulation.scene import Body, EchoScene, Material
from handbench.radar.simulation.scene_echoes import Echoes, facing
from handbench.support.parallel import for_each
from handbench.support.rays import Rays

BOUNCES = 4  # at most: places that a wave meets
PATCH = 0.25  # longest edge of a mirror, wavelengths
SECONDS_PER_FACE, SECONDS_PER_TUBE, SECONDS_PER_FACET = 3e-6, 2e-6, 3e-6
NODES_M, SAMPLES_M = (
    0.03,
    8e-3,
)  # between antennas and points of the room for which the diffraction is computed


def multipath(echoes: Echoes) -> Echoes:
    """Two to four bounces on the target's own surface: the mean of all but the last as mirrors and
    the last by physical optics, and of the same from the receivers, so that transmitters and
    receivers can be exchanged.

    Left out: more bounces, edges."""
    surface, scene = echoes.surface, echoes.scene
    if surface is None:
        return echoes
    body, rays, layer = (
        surface.body,
        rays_of(scene, surface.body),
        np.zeros(len(surface.body.faces), int),
    )
    if surface.layer is not None:  # 0 where no facet of a face is in sight
        layer[surface.facets.face] = surface.layer
    longest_m = PATCH * scene.wavelength_m * scene.mirrors_coarser
    antennas_m = np.concatenate([leg.position_m for leg in echoes.array.legs])
    mirrors = mirrors_of(rays, body, antennas_m, longest_m, BOUNCES - 1)
    if not len(mirrors.face):
        return echoes
    wavenumber = 0.0 if surface.sight is None else roundness_of(scene, body).wavenumber
    arrays = {1: echoes.array, -1: _exchanged(echoes.array)}
    found: dict[int, Bundles] = {}

    def bounce(sense: int) -> None:
        at = traced_nodes(arrays[sense], scene.nodes_apart)
        few = AntennaArray(arrays[sense].tx_m[at[0]], arrays[sense].rx_m[at[1]])
        traced = trace(rays, mirrors, few, int(mirrors.bounces.max()), wavenumber)
        found[sense] = Bundles(traced, layer, at, scene.dipole)

    for_each(bounce, arrays)
    if not any(map(len, found.values())):
        return echoes

    def echo() -> np.ndarray:
        material = (
            Material() if surface.reflection is None else body.material
        )  # where it is off, that of metal
        ratios = oblique_ratios(material, float(scene.frequencies_hz.mean()))
        total = np.zeros((len(scene.frequencies_hz), *echoes.array.channels), np.complex64)
        for sense, array in arrays.items():
            one = found[sense].echo(
                scene.frequencies_hz, array, surface.reflection, echoes.pattern, ratios
            )
            total += (one if sense > 0 else one.swapaxes(1, 2)) / 2
        return total

    return echoes.add("multipath", echo)


def multipath_cost_s(scene: EchoScene) -> float:
    """Seconds that it takes."""
    antennas = sum(len(traced_nodes(array)[0]) for array in (scene.array, _exchanged(scene.array)))
    tubes = _mirroring(scene) * 4 * antennas  # the coarse surface's facets are twice as wide
    return SECONDS_PER_FACE * len(scene.body.faces) + SECONDS_PER_TUBE * tubes


def estimate_multipath(scene: EchoScene) -> QuickEstimate | None:
    """Nothing on a convex surface. On others waves also bounce between edges and weak pixels, whose
    share no quick estimate knows."""
    surface = coarse_surface(scene, scene.body)
    if scene.kept("facing", lambda: some_face_each_other(surface, scene.wavelength_m)):
        return None
    return QuickEstimate(0.0, "no two facets face each other")


def _exchanged(array: AntennaArray) -> AntennaArray:
    """Transmitters as receivers and the other way round."""
    return AntennaArray(array.rx_m, array.tx_m)


def _mirroring(scene: EchoScene) -> int:
    """Count of the target's coarse facets that mirror onto others. Made once."""
    return scene.kept("mirroring", lambda: count_mirroring(visible_surface(scene), CENTRE_M))


def target_power(scene: EchoScene) -> float:
    """`single_bounce` of the target, as if it were of metal."""
    return single_bounce(visible_surface(scene), scene.array, CENTRE_M)


def clutter(echoes: Echoes) -> Echoes:
    """Echoes of the bodies around the target, which stay when it moves or is taken away: by
    physical optics, in its shadow as the aperture's centre casts it, or diffracted as each antenna
    does; waves that go by way of both target and room are left out."""
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
    """Seconds that it takes."""
    area_m2 = (
        sum(np.linalg.norm(face_vectors(b.vertices_m, b.faces), axis=1).sum() for b in scene.room)
        / 2
    )
    return float(SECONDS_PER_FACET * 2 * area_m2 / (PATCH * scene.wavelength_m) ** 2)


def estimate_clutter(scene: EchoScene) -> QuickEstimate | None:
    """As if the nearest body of the room were a mirror before all of the array: 1/(2z) of what it
    returns."""
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
    """A body's facets as the aperture's centre sees them behind the target; where that diffracts,
    coarser ones as each antenna does."""
    scene, surface = echoes.scene, echoes.surface
    if surface is None or surface.sight is None:
        facets = facing(scene, body)
        return facets.where(rays.in_sight(facets.position_m, CENTRE_M)).optics
    facets = facing(scene, body, LONGEST)
    samples = samples_of(body, facets, SAMPLES_M)
    sight, some = sight_of(scene, surface.body, samples, rays, echoes.array, NODES_M)
    return replace(facets.optics, sight=sight).where(some)


def _rays(bodies: list[Body]) -> Rays:
    """All bodies as one."""
    counts = np.cumsum([0, *(len(body.vertices_m) for body in bodies[:-1])])
    vertices_m = np.concatenate([body.vertices_m for body in bodies])
    return Rays(
        vertices_m, np.concatenate([body.faces + n for body, n in zip(bodies, counts, strict=True)])
    )
