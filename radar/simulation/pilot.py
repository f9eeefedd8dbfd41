"""A pilot: the target alone at two tones, quickly, on which the estimates try what effects would change.

The depth of a point is its phase between two tones (FSK), so that the mean |Δz| over some thousand points of the
surface predicts that of the depth map.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from radar.data.arrays import AntennaArray
from radar.data.capture import RadarCapture
from radar.data.grid import Axis
from radar.imaging.api import image_points
from radar.methods.fsk import two_tone
from radar.methods.fsk_config import SETTLING, TwoToneConfig
from radar.methods.smoothing import masked_mean
from radar.simulation.forward import Scatterers, simulate
from radar.simulation.physics.coarse import visible_from
from radar.simulation.physics.facets import Facets
from radar.simulation.physics.reflection import body_reflection
from radar.simulation.physics.spheres import ball_echoes
from radar.simulation.scene import Body, EchoScene
from radar.simulation.state import facing, require_facets

POINTS = 8000  # pixels of the box around the target, some 2000 of them on a hand
COARSE = 0.08  # of the depth step, as 200 MHz of 2.5 GHz: the step that finds where the fine one looks
SMOOTH_PX = 3  # 3-FSK's averaging filter before the fine step, at the pilot's pixels
MARGIN_M = 5e-3  # of the pixels around the target
TOLERANCE = 1e-3  # of the pilot's samples and images: an estimate is coarser by far
LONGEST = 0.5  # edge of the pilot's facets in wavelengths: coarse, but the same with and without an effect
STAND_IN = 1  # seed of the numbers that stand in for drawn ones
CENTRE_M = np.zeros(3)  # of the aperture, in the radar frame


@dataclass(frozen=True, eq=False)
class Pilot:
    """Echoes complex64 [2, t, r] of the target at two tones, a depth step apart, as the aperture's centre sees it:
    obliquity, that shadow and the material's mean reflection are in, nothing else. points_m [n, 3]: the pixels on
    target of a coarse 2-FSK map at its depths; images [2, n] there."""

    tones_hz: np.ndarray
    samples: np.ndarray
    points_m: np.ndarray
    images: np.ndarray


def pilot(scene: EchoScene) -> Pilot:
    """The scene's pilot: its highest tone and the measured one nearest to a depth step below it. Made once."""
    return scene.kept("pilot", lambda: _pilot(scene))


def _pilot(scene: EchoScene) -> Pilot:
    high_hz, low_hz = scene.pair_hz
    tones_hz = np.array([high_hz, low_hz, high_hz - COARSE * scene.depth_step_hz])
    samples = echoes_of(scene, tones_hz, scene.array)
    points_m = _pixels(scene, samples[[0, 2]], tones_hz[[0, 2]])
    images = image_points(samples[:2], tones_hz[:2], scene.array, points_m, TOLERANCE, apart=True)
    return Pilot(tones_hz[:2], samples[:2], points_m, images)


def _pixels(scene: EchoScene, samples: np.ndarray, tones_hz: np.ndarray) -> np.ndarray:
    """The pixels [n, 3] of a 2-FSK map, about POINTS, that are on target, at the smoothed depths that it finds: where
    3-FSK looks."""
    low_m, high_m = _box(scene)
    step_m = np.sqrt(np.prod((high_m - low_m)[:2]) / POINTS)
    counts = np.ceil((high_m - low_m) / step_m)
    x, y = (Axis(start_m=low_m[i], stop_m=low_m[i] + step_m * counts[i], step_m=step_m) for i in (0, 1))
    (f1_hz, f2_hz), first_m = tones_hz, (low_m + high_m)[2] / 2
    config = TwoToneConfig(
        x=x, y=y, f1_hz=f1_hz, f2_hz=f2_hz, first_depth_m=first_m, corrections=SETTLING, tolerance=TOLERANCE
    )
    depth = two_tone(RadarCapture(samples[None], tones_hz, scene.array), config)
    z_m = masked_mean(depth.z_m, SMOOTH_PX)
    on_target = np.isfinite(z_m)
    return np.stack([*(c[on_target] for c in np.meshgrid(depth.x_m, depth.y_m)), z_m[on_target]], axis=1)


def _box(scene: EchoScene) -> tuple[np.ndarray, np.ndarray]:
    """Corners [3] of a box around the target and its balls."""
    points = [] if scene.target is None else [visible_surface(scene).position_m]
    points += [ball.centre_m + side * ball.radius_m for ball in scene.balls for side in (-1, 1)]
    points_m = np.vstack(points)
    return points_m.min(axis=0) - MARGIN_M, points_m.max(axis=0) + MARGIN_M


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


def echoes_of(
    scene: EchoScene, tones_hz: np.ndarray, array: AntennaArray, pattern: float = 0.0, oblique: bool = True
) -> np.ndarray:
    """The target's echoes [2, t, r] as antennas elsewhere, or with a pattern, would have them; or of facets that
    scatter evenly."""
    samples = ball_echoes(scene, tones_hz, array, pattern=pattern)
    if scene.target is None:
        return samples
    facets = visible_surface(scene)
    optics = Scatterers(facets.position_m, facets.area_m2, facets.normal if oblique else None)
    return samples + body_echoes(scene.target, optics, tones_hz, array, TOLERANCE, pattern)


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


def change_mm(scene: EchoScene, samples: np.ndarray) -> float:
    """Mean |change| of the points' depths, mm, when the pilot's samples are these [2, t, r] instead."""
    known = pilot(scene)
    images = image_points(samples, known.tones_hz, scene.array, known.points_m, TOLERANCE, apart=True)
    turned = (images[0] * images[1].conj()) * (known.images[0] * known.images[1].conj()).conj()
    turned_rad = np.where(turned == 0, np.pi / 2, np.abs(np.angle(turned)))  # a lost image's phase is any
    return 1e3 * scene.depth_m_per_rad * float(turned_rad.mean())


def change_db(scene: EchoScene, samples: np.ndarray) -> float:
    """Power of what is added to or taken from the pilot's echoes, against theirs."""
    known = pilot(scene).samples
    return 20 * np.log10(max(float(np.linalg.norm(samples - known) / np.linalg.norm(known)), 1e-12))


def rms(samples: np.ndarray) -> float:
    """Root mean square magnitude."""
    return float(np.linalg.norm(samples) / np.sqrt(samples.size))


def stand_in(count: int, part: int = 0) -> np.ndarray:
    """Normal numbers [count] of the estimates' own, always the same: the scene's are left alone. (Numbers spread more
    evenly than random ones would cancel over the antennas, and the estimate with them.)"""
    return np.random.Generator(np.random.PCG64([STAND_IN, part])).standard_normal(count)
