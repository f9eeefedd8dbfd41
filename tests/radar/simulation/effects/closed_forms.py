"""The simulation against closed forms: each function returns both."""

from dataclasses import replace

import numpy as np

from handbench.radar.data.arrays import SPEED_OF_LIGHT_M_S, AntennaArray, qar50
from handbench.radar.simulation.forward import Scatterers, simulate
from handbench.radar.simulation.physics.facets import facets_of
from handbench.radar.simulation.physics.spheres import mie_amplitude, sphere_echo
from handbench.radar.simulation.scene import Body
from tests.radar.direct_sums import direct_echoes
from tests.radar.simulation.effects.plates import sheet, sphere_body

FAR_M = 1e4
TONE_HZ = 77e9
WAVELENGTH_M = SPEED_OF_LIGHT_M_S / TONE_HZ


def mie_backscatter(ka: np.ndarray) -> np.ndarray:
    """Backscattering amplitude of a metal sphere over that of geometrical optics: complex [n]; |F|²
    = σ/(πa²)."""
    return mie_amplitude(ka, np.ones(1))[:, 0]


def optics_of(body: Body, oblique: bool = True) -> Scatterers:
    """The body's facets for physical optics."""
    facets = facets_of(body, np.inf)
    return facets if oblique else replace(facets, normal=None)


def cross_section_m2(samples, frequencies_hz, range_m=FAR_M):
    """σ = 4π/λ² |S R²|² of samples [f, ...]."""
    wavelength_m = SPEED_OF_LIGHT_M_S / np.asarray(frequencies_hz).reshape(
        -1, *(1,) * (samples.ndim - 1)
    )
    return 4 * np.pi / wavelength_m**2 * np.abs(samples.astype(complex) * range_m**2) ** 2


def sphere_over_ka(ka):
    """σ/πa² [n] of a sphere at each ka: by physical optics over facets, its closed form, and Mie's
    series.

    ∫μ e^{jxμ} dμ over the lit half, x = 2ka: S R² = 2πa² (e^{jx}/jx + (e^{jx} − 1)/x²)."""
    radius_m = 0.01
    tones_hz = np.asarray(ka) * SPEED_OF_LIGHT_M_S / (2 * np.pi * radius_m)
    far = AntennaArray([[0.0, 0.0, -FAR_M]], [[0.0, 0.0, -FAR_M]])
    samples = simulate(optics_of(sphere_body(radius_m, splits=7)), tones_hz, far, tolerance=None)[
        :, 0, 0
    ]
    x = 2 * np.asarray(ka)
    closed = np.abs(1 + 1j * (1 - np.exp(-1j * x)) / x) ** 2
    return (
        cross_section_m2(samples, tones_hz) / (np.pi * radius_m**2),
        closed,
        np.abs(mie_backscatter(ka)) ** 2,
    )


def plate_over_angle(degrees, oblique=True):
    """σ [n] of a square plate of ten wavelengths at monostatic angles from its normal: over facets,
    and in closed form 4πA²/λ² (cos θ · sinc(kL sin θ))²."""
    side_m, theta = 10 * WAVELENGTH_M, np.radians(degrees)
    antennas = FAR_M * np.stack([np.sin(theta), 0 * theta, -np.cos(theta)], axis=1)
    plate = optics_of(sheet(side_m, WAVELENGTH_M / 8), oblique=oblique)
    tone_hz = np.array([TONE_HZ])
    echoes = [
        simulate(plate, tone_hz, AntennaArray([a], [a]), tolerance=None)[0, 0, 0] for a in antennas
    ]
    pattern = np.cos(theta) * np.sinc(2 * side_m / WAVELENGTH_M * np.sin(theta))
    return cross_section_m2(np.array(echoes)[None], tone_hz)[
        0
    ], 4 * np.pi * side_m**4 / WAVELENGTH_M**2 * pattern**2


def bumps_m(x, y):
    """A surface as curved as a hand's: bumps of 6 mm every 40 to 60 mm."""
    return 3e-3 * (np.sin(2 * np.pi * x / 0.05 + 0.3) + np.cos(2 * np.pi * (y + 0.4 * x) / 0.06))


def refined(per_wavelength=(2, 4, 8, 16), best=32):
    """Relative L2 error [n] of the samples of a curved sheet of 31 mm at 0.3 m with edges of λ/n
    against λ/best."""
    array = AntennaArray(qar50().tx_m[::12], qar50().rx_m[::12])
    tone_hz = np.array([TONE_HZ])

    def samples(n):
        bumpy = optics_of(sheet(8 * WAVELENGTH_M, WAVELENGTH_M / n, 0.3, bumps_m))
        return simulate(bumpy, tone_hz, array, tolerance=None).astype(complex)

    exact = samples(best)
    return np.array(
        [np.linalg.norm(samples(n) - exact) / np.linalg.norm(exact) for n in per_wavelength]
    )


def power_over_range(range_m):
    """|S|² [3, n] of one antenna over range: of a point, of facets on a ball of 5 mm and of its Mie
    series."""
    powers, tone_hz, one = [], np.array([TONE_HZ]), AntennaArray(np.zeros((1, 3)), np.zeros((1, 3)))
    for r in range_m:
        at = np.array([0.0, 0.0, r])
        point = simulate(Scatterers(at[None], np.ones(1)), tone_hz, one, tolerance=None)
        ball = simulate(optics_of(sphere_body(5e-3, at, 5)), tone_hz, one, tolerance=None)
        mie = sphere_echo(at, 5e-3, 0.0, tone_hz, one)
        powers.append([abs(echo.item()) ** 2 for echo in (point, ball, mie)])
    return np.array(powers).T


def phase_errors_rad(tolerance, spreading=True, count=40):
    """Largest phase error [n] of single points before the paper's array, against −2πf(|p − t| + |p
    − r|)/c."""
    points_m = np.random.default_rng(2).uniform([-0.1, -0.1, 0.2], [0.1, 0.1, 0.6], (count, 1, 3))
    tones_hz, one = np.array([72e9, TONE_HZ, 82e9]), np.ones(1)
    pairs = (
        (
            simulate(Scatterers(point_m, one), tones_hz, qar50(), spreading, tolerance),
            direct_echoes(point_m, one, tones_hz, qar50()),
        )
        for point_m in points_m
    )
    return np.array([np.abs(np.angle(echo * exact.conj())).max() for echo, exact in pairs])
