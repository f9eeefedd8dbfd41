"""Quick looks at a scene, which glances and rehearsals share: the target's surface as coarse facets, and what of it the
aperture's centre sees."""

import numpy as np

from handbench.radar.data.arrays import AntennaArray
from handbench.radar.simulation.forward import Scatterers, simulate
from handbench.radar.simulation.physics.coarse import visible_from
from handbench.radar.simulation.physics.facets import Facets
from handbench.radar.simulation.physics.reflection import body_reflection
from handbench.radar.simulation.scene import Body, EchoScene
from handbench.radar.simulation.state import facing, require_facets

TOLERANCE = 1e-3  # of a rehearsal's samples and images: its surfaces are coarser by far
LONGEST = 0.5  # edge of coarse facets in wavelengths
CENTRE_M = np.zeros(3)  # of the aperture, in the radar frame


def coarse_surface(scene: EchoScene, body: Body) -> Facets:
    """The body's facets that face the array, coarse."""
    return facing(scene, body, LONGEST)


def visible_surface(scene: EchoScene) -> Facets:
    """The target's coarse facets that the aperture's centre sees; all, if the target lets waves through."""
    facets = require_facets(coarse_surface(scene, scene.body))
    return facets if scene.body.transparent else facets.where(seen_from_centre(scene))


def seen_from_centre(scene: EchoScene) -> np.ndarray:
    """Mask [p] of the target's coarse facets that the aperture's centre sees, by a depth buffer. Made once."""
    return scene.kept("seen", lambda: visible_from(coarse_surface(scene, scene.body), CENTRE_M))


def body_echoes(
    body: Body,
    optics: Scatterers,
    frequencies_hz: np.ndarray,
    array: AntennaArray,
    tolerance: float | None,
    pattern: float = 0.0,
) -> np.ndarray:
    """Samples complex64 [f, t, r] of some of a body's facets, times its mean reflection."""
    echoes = simulate(optics, frequencies_hz, array, tolerance=tolerance, pattern=pattern)
    return echoes * body_reflection(body, frequencies_hz).astype(np.complex64)[:, None, None]


def rms(samples: np.ndarray) -> float:
    """Root mean square magnitude."""
    return float(np.linalg.norm(samples) / np.sqrt(samples.size))
