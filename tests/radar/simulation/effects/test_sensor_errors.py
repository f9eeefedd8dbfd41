"""Imperfect sensors: each error has the statistics that the scene file gives, and touches what it
says."""

from itertools import pairwise

import numpy as np
import pytest
from scipy.integrate import quad

from handbench.radar.imaging.api import image_points
from handbench.radar.simulation.causes import Noise, Oscillator
from handbench.radar.simulation.effects.sensor import converter, phase_rad
from handbench.radar.simulation.scene_echoes import bare_echoes
from handbench.support.errors import HandbenchError
from tests.radar.simulation.effects.small_scenes import TONES_HZ, bead_scene, simulated


def rms(samples):
    return float(np.sqrt(np.mean(np.abs(samples) ** 2)))


def test_thermal_noise_has_the_phase_noise_of_the_scene():
    clean = simulated(bead_scene()).capture.samples[0]
    scene = bead_scene({"noise": {"phase_noise_rad": 0.05}})
    noise = simulated(scene, "noise", frames=60).capture.samples - clean
    assert np.mean(noise**2) == pytest.approx(
        0, abs=5 * noise.std() ** 2 / np.sqrt(noise.size)
    )  # circular
    # At the strongest pixel it turns two tones against each other by 0.05 rad; 60 frames: 9 % (1σ).
    surface_m = scene.target.vertices_m
    strongest = surface_m[
        np.abs(image_points(clean[2:], TONES_HZ[2:], scene.array, surface_m, None)).argmax()
    ][None]
    pixel = [
        image_points(samples, TONES_HZ, scene.array, strongest, None, per_tone=True)[:, 0]
        for samples in (clean, *(clean + noise))
    ]
    between = np.angle([p[2] * p[0].conj() / (pixel[0][2] * pixel[0][0].conj()) for p in pixel[1:]])
    assert between.std() == pytest.approx(0.05, rel=0.3)


def test_snr_is_another_way_to_say_it():
    assert Noise(snr_db=20.0).between_tones_rad == Noise(phase_noise_rad=0.1).between_tones_rad


@pytest.mark.parametrize("bandwidth_hz", [1e5, 1e6, 3e8, 3e9])
def test_range_correlation_has_the_integral_of_the_spectrum(bandwidth_hz):
    delay_s = 2e-9
    density = lambda f: (  # noqa: E731
        2 * 1e-9 * (1e6 / f) ** 2 * 4 * np.sin(np.pi * f * delay_s) ** 2
    )
    edges = np.linspace(0, bandwidth_hz, 200)
    edges[0] = 1.0
    power = sum(quad(density, a, b)[0] for a, b in pairwise(edges))
    sigma = phase_rad(Oscillator(level_dbc_hz=-90.0, bandwidth_hz=bandwidth_hz), delay_s)
    assert sigma == pytest.approx(np.sqrt(power), rel=1e-4)


def test_oscillator_turns_all_receivers_together():
    clean = simulated(bead_scene()).capture.samples[0]
    causes = {"oscillator": {"level_dbc_hz": -60.0}}
    turned = simulated(bead_scene(causes), "oscillator").capture.samples[0] / clean
    phase = np.angle(turned)
    assert np.abs(phase - phase[:, :, :1]).max() < 1e-5
    expected = phase_rad(Oscillator(level_dbc_hz=-60.0), 2 * 0.3 / 3e8)
    assert phase[:, :, 0].std() == pytest.approx(expected, rel=0.15)  # 282 draws: 4 % (1σ)


def test_positions_move_the_antennas_and_not_the_capture():
    scene = bead_scene({"positions": {"sigma_m": 5e-5}})
    found = simulated(scene, "positions").capture
    assert np.array_equal(found.aperture.tx_m, scene.array.tx_m)
    turned = np.angle(found.samples[0, 2] * simulated(scene).capture.samples[0, 2].conj())
    # Each leg's path varies by 50 µm along the line of sight: √2 · 50 µm · 2π/λ = 0.12 rad.
    assert turned.std() == pytest.approx(np.sqrt(2) * 5e-5 * 2 * np.pi * 82e9 / 3e8, rel=0.25)


def test_channel_errors_belong_to_antennas():
    scene = bead_scene({"channels": {"gain_db": 0.5, "phase_rad": 0.1, "delay_m": 1e-4}})
    factor = simulated(scene, "channels").capture.samples[0] / simulated(scene).capture.samples[0]
    assert np.linalg.svd(factor[1], compute_uv=False)[1] < 1e-4 * np.linalg.norm(
        factor[1]
    )  # rank 1: t times r
    gain_db = 20 * np.log10(np.abs(factor))
    assert gain_db.std() == pytest.approx(
        0.5 * np.sqrt(2), rel=0.2
    )  # 188 antennas: 5 % (1σ), twice four
    slope = np.angle(factor[2] * factor[0].conj()) * 3e8 / (2 * np.pi * 2.5e9)
    assert slope.std() == pytest.approx(1e-4 * np.sqrt(2), rel=0.2)


def test_dead_antennas_are_silent():
    scene = bead_scene({"dead": {"tx": (3,), "rx": (0, 93)}})
    samples = simulated(scene, "dead").capture.samples[0]
    silent = samples == 0
    assert silent[:, 3].all() and silent[:, :, [0, 93]].all()
    assert silent.sum() == 3 * (94 * 94 - 93 * 92)
    with pytest.raises(
        HandbenchError,
        match=r"sensor\.dead\.rx: has the antenna number 94; expected numbers from 0 to 93",
    ):
        simulated(bead_scene({"dead": {"rx": (94,)}}), "dead")


def test_coupling_has_its_level_and_the_direct_path():
    scene = bead_scene({"coupling": {"level_db": -6.0}})
    clean = simulated(scene).capture.samples[0]
    leak = simulated(scene, "coupling").capture.samples[0] - clean
    assert 20 * np.log10(rms(leak) / rms(clean)) == pytest.approx(-6.0, abs=0.01)
    distance_m = np.linalg.norm(scene.array.tx_m[5] - scene.array.rx_m[7])
    turned = np.angle(leak[2, 5, 7] * leak[0, 5, 7].conj())
    expected = -2 * np.pi * np.ptp(TONES_HZ) * distance_m / 299_792_458.0
    assert np.exp(1j * turned) == pytest.approx(np.exp(1j * expected), abs=1e-3)


def test_quantisation_is_white_noise_of_a_twelfth_of_a_step_squared():
    parts = np.random.default_rng(1).standard_normal((2, 1, 2, 100, 100))
    samples = (parts[0] + 1j * parts[1]).astype(np.complex64)
    largest = np.abs(samples.view(np.float32)).max()
    for headroom_db, full_scale in ((20.0, 10 * largest), (-20.0, 0.1 * largest)):
        scene = bead_scene({"converter": {"bits": 8, "headroom_db": headroom_db}})
        rounded = converter(bare_echoes(scene), samples)
        error, step = rounded - samples, 2 * full_scale / 256
        whole = np.abs(samples) < full_scale
        assert np.abs(error.real[whole]).max() <= step / 2 * 1.001
        assert np.mean(np.abs(error[whole]) ** 2) == pytest.approx(2 * step**2 / 12, rel=0.05)
        assert np.abs(rounded.view(np.float32)).max() < full_scale


def test_the_empty_room_has_the_same_sensor_and_other_noise():
    causes = {
        "noise": {"phase_noise_rad": 0.05},
        "coupling": {"level_db": 0.0},
        "channels": {"phase_rad": 0.5},
    }
    found = simulated(bead_scene(causes), "noise", "coupling", "channels", empty=True)
    quiet = simulated(bead_scene(causes), "coupling", "channels", empty=True)
    assert np.array_equal(
        quiet.subtracted().capture.samples, quiet.capture.samples - quiet.empty.samples
    )
    bare = simulated(bead_scene(causes), "channels").capture.samples
    # What is left after subtracting is the bead behind the sensor's channels.
    assert np.linalg.norm(quiet.subtracted().capture.samples - bare) < 1e-5 * np.linalg.norm(bare)
    noise = [
        a.samples - b.samples
        for a, b in ((found.capture, quiet.capture), (found.empty, quiet.empty))
    ]
    assert abs(np.vdot(*noise)) < 0.05 * np.linalg.norm(noise[0]) * np.linalg.norm(noise[1])
