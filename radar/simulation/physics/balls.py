"""Echoes of the calibration target's steel balls and of the spheres of foam around them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from radar.data.arrays import SPEED_OF_LIGHT_M_S, AntennaArray
from radar.imaging.cpu.steering import phasor
from radar.simulation.mie import half_angle_cosine, sphere_echo
from radar.simulation.physics.reflection import fresnel
from radar.simulation.scene import Ball, EchoScene


def ball_echoes(
    scene: EchoScene, tones_hz: np.ndarray, array: AntennaArray, delay_m: np.ndarray | None = None, pattern: float = 0.0
) -> np.ndarray:
    """Samples complex64 [f, t, r] of the scene's bare steel balls by Mie's series. delay_m [n]: extra one-way path of
    each; pattern: exponent of the antennas' amplitude pattern cosᵠθ."""
    delays_m = np.zeros(len(scene.balls)) if delay_m is None else delay_m
    angle = np.radians(scene.polarisation_deg)
    field = np.array([np.cos(angle), np.sin(angle), 0.0])
    samples = np.zeros((len(tones_hz), *array.channels), np.complex64)
    for ball, extra_m in zip(scene.balls, delays_m, strict=True):
        echo = sphere_echo(ball.centre_m, ball.radius_m, extra_m, tones_hz, array, field)
        samples += echo * pattern_gain(ball.centre_m, array, pattern)
    return samples


def foam_delays_m(balls: Sequence[Ball]) -> np.ndarray:
    """Extra one-way path [n] of each ball's echo, (n − 1)·(R_foam − r_ball): the foam is centred on the ball, so that
    every ray to the ball's specular point runs along a radius and is not bent."""
    return np.array([(_index(ball) - 1) * max(ball.foam_radius_m - ball.radius_m, 0.0) for ball in balls])


def foam_echoes(
    balls: Sequence[Ball], frequencies_hz: np.ndarray, array: AntennaArray, pattern: float = 0.0
) -> np.ndarray:
    """Samples complex64 [f, t, r] of the foam's front and back surfaces, without the balls inside."""
    samples = np.zeros((len(frequencies_hz), *array.channels), np.complex64)
    for ball in balls:
        if has_foam(ball):
            samples += _foam_echo(ball, frequencies_hz, array) * pattern_gain(ball.centre_m, array, pattern)
    return samples


def has_foam(ball: Ball) -> bool:
    """True if there is foam around the ball."""
    return ball.foam_radius_m > ball.radius_m and ball.foam_permittivity > 1


def pattern_gain(point_m: np.ndarray, array: AntennaArray, pattern: float) -> np.ndarray | float:
    """cosᵠθ of both antennas of each channel towards a point [3]: float32 [t, r]."""
    if pattern == 0:
        return 1.0
    cosines = ((point_m - leg.position_m)[:, 2] / leg.lengths_m(point_m) for leg in array.legs)
    return np.multiply.outer(*(np.maximum(cosine, 0) ** pattern for cosine in cosines)).astype(np.float32)


def _index(ball: Ball) -> float:
    return float(np.sqrt(ball.foam_permittivity))


def _foam_echo(ball: Ball, frequencies_hz: np.ndarray, array: AntennaArray) -> np.ndarray:
    """Front and back of a sphere of foam by geometrical optics, (2π/jk)·ρ/B·exp(−jk·path) in the forward model's scale:
    ρ the reflection against metal's, B the ray matrix's element that says how the echo spreads (negative behind a
    focus). Paraxial about each channel's specular points, which lie on its bisector before and behind the centre.

    The steel ball hides the back from rays that pass through the foam's middle: channels whose chords to the back's
    specular point, a·sin β from the centre, run into the ball have no back echo. (Diffraction would blur this edge over
    √(λa) ≈ 1 cm; what is lost is below the foam's own −40 dB.)
    """
    radius_m, n = ball.foam_radius_m, _index(ball)
    cos_beta = half_angle_cosine(ball.centre_m, array)
    legs_m = [leg.lengths_m(ball.centre_m) for leg in array.legs]
    spread_front, spread_back = (_spreading_m(legs_m, radius_m, n, back) for back in (False, True))
    gamma = fresnel(np.array(ball.foam_permittivity)).real
    passes = radius_m * np.sqrt(1 - np.minimum(cos_beta, 1) ** 2) > ball.radius_m
    front = -gamma / spread_front
    back = gamma * (1 - gamma**2) / spread_back * passes
    near_m, far_m = (_over_m(legs_m, side * radius_m, cos_beta) for side in (1, -1))
    far_m = far_m + (n - 1) * 4 * radius_m * cos_beta  # two chords, 2a·cos β each
    samples = np.empty((len(frequencies_hz), *array.channels), np.complex64)
    for sample, f in zip(samples, frequencies_hz, strict=True):
        scale = SPEED_OF_LIGHT_M_S / (1j * f)  # 2π/jk
        sample[:] = scale * (front * phasor(near_m, f, -1) + back * phasor(far_m, f, -1))
    return samples


def _over_m(legs_m: list[np.ndarray], towards_m: float, cos_beta: np.ndarray) -> np.ndarray:
    """Straight path [t, r] over the point that lies `towards_m` from the centre along each channel's bisector."""
    to_m, from_m = legs_m[0][:, None], legs_m[1][None, :]
    return sum(np.sqrt(leg_m**2 + towards_m**2 - 2 * leg_m * towards_m * cos_beta) for leg_m in (to_m, from_m))


def _spreading_m(legs_m: list[np.ndarray], radius_m: float, n: float, back: bool) -> np.ndarray:
    """B [t, r] of the rays from transmitter to receiver over the sphere's front, or through it over its back; a ray is
    (h, θ), θ its true angle also inside (Siegman, Lasers, 1986, ch. 15)."""
    mirror = np.array([[1.0, 0.0], [2 / radius_m, 1.0]])  # the front is convex
    if back:
        enter = np.array([[1.0, 0.0], [-(n - 1) / (n * radius_m), 1 / n]])
        leave = np.array([[1.0, 0.0], [-(n - 1) / radius_m, n]])
        across = np.array([[1.0, 2 * radius_m], [0.0, 1.0]])
        mirror = leave @ across @ np.linalg.inv(mirror) @ across @ enter
    to_m, from_m = (leg_m - radius_m for leg_m in legs_m)
    return (mirror[0, 0] * to_m + mirror[0, 1])[:, None] + np.multiply.outer(mirror[1, 0] * to_m + mirror[1, 1], from_m)
