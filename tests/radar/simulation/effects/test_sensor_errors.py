"""Imperfect sensors: each error has the statistics that the scene file gives, and touches what it
says."""

from functools import cache
from itertools import pairwise

import numpy as np
import pytest
from scipy.integrate import quad

from handbench.radar.data.arrays import SPEED_OF_LIGHT_M_S
from handbench.radar.imaging.api import image_points
from handbench.radar.simulation.effects.sensor import converter, phase_rad
from handbench.radar.simulation.scene import Ball, Noise, Oscillator
from handbench.radar.simulation.scene_echoes import bare_echoes
from tests.radar.samples import noise, relative_error
from tests.radar.simulation.effects.small_scenes import TONES_HZ, bead_scene, simulated
from tests.refusals import refuse


@cache
def clean():
    """Samples [f, t, r] of the bead before a perfect sensor."""
    return simulated(bead_scene()).capture.samples[0]


def samples_with(**caused):
    """Samples [f, t, r] of the bead with these errors alone."""
    return simulated(bead_scene(caused), *caused).capture.samples[0]


def test_thermal_noise_has_the_phase_noise_of_the_scene():
    """At the strongest pixel it turns two tones against each other by 0.05 rad; 60 frames: 9 %
    (1σ)."""
    scene = bead_scene({"noise": {"phase_noise_rad": 0.05}})
    white = simulated(scene, "noise", frames=60).capture.samples - clean()
    circular = 5 * white.std() ** 2 / np.sqrt(white.size)
    assert np.mean(white**2) == pytest.approx(0, abs=circular)
    surface_m = scene.target.vertices_m
    image = image_points(clean()[2:], TONES_HZ[2:], scene.array, surface_m, None)
    strongest_m = surface_m[[np.abs(image).argmax()]]
    products = []
    for samples in (clean(), *(clean() + white)):
        low, _, high = image_points(
            samples, TONES_HZ, scene.array, strongest_m, None, per_tone=True
        )
        products.append(high[0] * low[0].conj())
    turned = np.angle(np.array(products[1:]) * products[0].conj())
    assert turned.std() == pytest.approx(0.05, rel=0.3)


def test_snr_is_another_way_to_say_it():
    assert Noise(snr_db=20.0).between_tones_rad == Noise(phase_noise_rad=0.1).between_tones_rad


@pytest.mark.parametrize("bandwidth_hz", [1e5, 1e6, 3e8, 3e9])
def test_range_correlation_has_the_integral_of_the_spectrum(bandwidth_hz):
    delay_s = 2e-9

    def density(f):
        return 2 * 1e-9 * (1e6 / f) ** 2 * 4 * np.sin(np.pi * f * delay_s) ** 2

    edges = np.r_[1.0, np.linspace(0, bandwidth_hz, 200)[1:]]
    power = sum(quad(density, a, b)[0] for a, b in pairwise(edges))
    sigma = phase_rad(Oscillator(level_dbc_hz=-90.0, bandwidth_hz=bandwidth_hz), delay_s)
    assert sigma == pytest.approx(np.sqrt(power), rel=1e-4)


def test_oscillator_turns_all_receivers_together():
    phase = np.angle(samples_with(oscillator={"level_dbc_hz": -60.0}) / clean())
    assert np.abs(phase - phase[:, :, :1]).max() < 1e-5
    expected = phase_rad(Oscillator(level_dbc_hz=-60.0), 2 * 0.3 / SPEED_OF_LIGHT_M_S)
    assert phase[:, :, 0].std() == pytest.approx(expected, rel=0.15)  # 282 draws: 4 % (1σ)


def test_positions_move_the_antennas_and_not_the_capture():
    """Each leg's path varies by 50 µm along the line of sight: √2 · 50 µm · 2π/λ = 0.12 rad."""
    scene = bead_scene({"positions": {"sigma_m": 5e-5}})
    capture = simulated(scene, "positions").capture
    np.testing.assert_array_equal(capture.aperture.tx_m, scene.array.tx_m)
    turned = np.angle(capture.samples[0, 2] * clean()[2].conj())
    expected = np.sqrt(2) * 5e-5 * 2 * np.pi * 82e9 / SPEED_OF_LIGHT_M_S
    assert turned.std() == pytest.approx(expected, rel=0.25)


def test_channel_errors_belong_to_antennas():
    """Transmitter times receiver: a matrix of rank 1. 188 antennas tell a deviation to 5 % (1σ)."""
    factor = samples_with(channels={"gain_db": 0.5, "phase_rad": 0.1, "delay_m": 1e-4}) / clean()
    values = np.linalg.svd(factor[1], compute_uv=False)
    assert values[1] < 1e-4 * values[0]
    gain_db = 20 * np.log10(np.abs(factor))
    assert gain_db.std() == pytest.approx(0.5 * np.sqrt(2), rel=0.2)
    turns_per_m = np.ptp(TONES_HZ) / SPEED_OF_LIGHT_M_S
    delay_m = np.angle(factor[2] * factor[0].conj()) / (2 * np.pi * turns_per_m)
    assert delay_m.std() == pytest.approx(1e-4 * np.sqrt(2), rel=0.2)


def test_dead_antennas_are_silent():
    silent = np.zeros(clean().shape, bool)
    silent[:, 3] = silent[:, :, [0, 93]] = True
    samples = samples_with(dead={"tx": (3,), "rx": (0, 93)})
    np.testing.assert_array_equal(samples == 0, silent)
    refuse(lambda: samples_with(dead={"rx": (94,)}), "sensor.dead.rx", "94", "0 to 93")


def test_coupling_has_its_level_and_the_direct_path():
    leak, array = samples_with(coupling={"level_db": -6.0}) - clean(), bead_scene().array
    level_db = 20 * np.log10(np.linalg.norm(leak) / np.linalg.norm(clean()))
    assert level_db == pytest.approx(-6.0, abs=0.01)
    turns = np.ptp(TONES_HZ) * np.linalg.norm(array.tx_m[5] - array.rx_m[7]) / SPEED_OF_LIGHT_M_S
    product = leak[2, 5, 7] * leak[0, 5, 7].conj()
    assert product / abs(product) == pytest.approx(np.exp(-2j * np.pi * turns), abs=1e-3)


@pytest.mark.parametrize("headroom_db", [20.0, -20.0])
def test_quantisation_is_white_noise_of_a_twelfth_of_a_step_squared(headroom_db):
    samples = noise((1, 2, 100, 100))
    full_scale = 10 ** (headroom_db / 20) * np.abs(samples.view(np.float32)).max()
    scene = bead_scene({"converter": {"bits": 8, "headroom_db": headroom_db}})
    rounded = converter(bare_echoes(scene), samples)
    error, step = (rounded - samples)[np.abs(samples) < full_scale], 2 * full_scale / 256
    assert np.abs(error.real).max() <= step / 2 * 1.001
    assert np.mean(np.abs(error) ** 2) == pytest.approx(2 * step**2 / 12, rel=0.05)
    assert np.abs(rounded.view(np.float32)).max() < full_scale


def test_the_empty_room_has_the_same_sensor_and_other_noise():
    """What is left after subtracting is the bead behind the sensor's channels."""
    quiet = {"coupling": {"level_db": 0.0}, "channels": {"phase_rad": 0.5}}
    scene = bead_scene(quiet | {"noise": {"phase_noise_rad": 0.05}})
    silent, noisy = (simulated(scene, *quiet, *more, empty=True) for more in ((), ("noise",)))
    left = silent.subtracted().capture.samples[0]
    np.testing.assert_array_equal(left, silent.capture.samples[0] - silent.empty.samples[0])
    assert relative_error(left, samples_with(channels={"phase_rad": 0.5})) < 1e-5
    there, empty = (
        getattr(noisy, name).samples - getattr(silent, name).samples
        for name in ("capture", "empty")
    )
    assert abs(np.vdot(there, empty)) < 0.05 * np.linalg.norm(there) * np.linalg.norm(empty)


BALL_M, BEAD_M = np.array([0.05, 0.0, 0.3]), np.array([0.01, -0.005, 0.3])


@pytest.mark.parametrize(
    ("at_m", "effects", "changes", "within"),
    [
        # The bead's specular points lie up to 4 mm before its middle: 2q·tan θ·Δθ, at most
        # 2·2.4·0.33·0.004 = 1 %.
        (BEAD_M, ("obliquity",), {}, 0.01),
        (BALL_M, (), {"target": None, "balls": (Ball(BALL_M, 5e-3),)}, 1e-5),
    ],
)
def test_echoes_are_weighed_by_the_pattern_of_both_antennas(at_m, effects, changes, within):
    """By cosᵠθ each, whose square is half at half the beamwidth."""
    scene = bead_scene({"pattern": {"beamwidth_deg": 60.0}}, **changes)
    weighed, plain = (
        simulated(scene, *effects, *more).capture.samples[0] for more in (("pattern",), ())
    )
    exponent = np.log(0.5) / (2 * np.log(np.cos(np.radians(30.0))))
    gains = [leg.directions(at_m)[:, 2] ** exponent for leg in scene.array.legs]
    assert relative_error(weighed, plain * np.outer(*gains)) < within
    assert relative_error(weighed, plain) > 0.1
