"""No confident depth comes from echoes that hold none."""

from dataclasses import replace

import numpy as np
import pytest

from handbench.bench.stages.image import image, prepare
from handbench.bench.validation.checks import CHANNELS, warnings_of
from handbench.radar.data.arrays import AntennaArray, AntennaPairs, qar50
from handbench.radar.data.capture import RadarCapture
from handbench.radar.methods.evidence import tone_problems
from handbench.radar.methods.registry import method
from tests.radar.simulated_points import TONES_HZ, around, exact_capture
from tests.refusals import refuse

POINT_M = np.array([0.01, -0.02, 0.35])
OBLIQUE_M = np.linspace(-0.05, 0.05, 16)[:, None] * np.array([1.0, -0.7, 0.0])
SOME = AntennaArray(qar50().tx_m[::6], qar50().rx_m[::6])


def changed(capture, change):
    samples = capture.samples.copy()
    change(samples)
    return replace(capture, samples=samples)


def dead_tone(samples):
    samples[:, 1] = 0


def equal_tones(samples):
    samples[:, 2] = samples[:, 0]


def scaled_tone(samples):
    samples[:, 2] = 0.3 * samples[:, 0]


def one_live_channel(samples):
    samples[:, :, 1:] = 0
    samples[:, :, :, 1:] = 0


def rod(extent_m):
    """Antennas on both edges of a rod along x, which is extent_m wide along y."""
    x = np.linspace(-0.07, 0.07, 16)
    places_m = np.stack([x, extent_m * (np.arange(16) % 2 - 0.5), 0 * x], axis=1)
    return AntennaArray(places_m, places_m)


TONES = {"tones_hz": tuple(TONES_HZ.tolist())}


@pytest.mark.parametrize(("name", "tones"), [("3fsk", {}), ("nfsk", TONES), ("joint", TONES)])
@pytest.mark.parametrize(
    ("array", "change", "place"),
    [
        (SOME, dead_tone, "81.8 GHz"),
        (SOME, equal_tones, "equal samples"),
        (SOME, scaled_tone, "equal samples"),
        (SOME, one_live_channel, "the same x"),
        (AntennaArray(np.zeros((3, 3)), np.zeros((2, 3))), None, "the same x"),
        (rod(0.0), None, "the same y"),
        (AntennaArray(OBLIQUE_M, OBLIQUE_M), None, "line"),
    ],
    ids=["dead tone", "equal tones", "a gain", "one channel", "one place", "a line", "oblique"],
)
def test_echoes_without_depth_are_refused(name, tones, array, change, place):
    settings = method(name).configure(around(POINT_M) | tones, "test")
    capture = exact_capture(POINT_M, array=array)
    if change is not None:
        capture = changed(capture, change)
    refuse(lambda: prepare(capture, method(name), settings), place)


def test_tones_of_equal_means_are_no_copies():
    samples = exact_capture(POINT_M, array=SOME).samples[0]
    samples[2] = samples[0, [1, 0, *range(2, len(SOME.tx_m))]]
    assert not list(tone_problems(samples, TONES_HZ[: len(samples)]))


def test_what_the_antennas_cannot_resolve_is_uncertain():
    """1 mm of extent at a wavelength of 3.7 mm and 0.35 m: a cell of δ = 640 mm, whose sagitta
    δ²/8z is 147 mm."""
    settings = method("3fsk").configure(around(POINT_M), "test")
    depth = image(exact_capture(POINT_M, array=rod(1e-3)), method("3fsk"), settings)
    seen = np.isfinite(depth.z_m)
    cell_m = 299792458 / 82e9 * depth.z_m[seen] / (2 * 1e-3)
    assert seen.any()
    assert (depth.sigma_m[seen] >= 0.999 * cell_m**2 / (8 * depth.z_m[seen])).all()
    assert (depth.p_gross[seen] >= 0.5).all()


def test_a_repeated_tone_is_not_used_by_methods_that_need_each_once():
    once = exact_capture(POINT_M, array=SOME)
    again = replace(
        once,
        frequencies_hz=np.append(once.frequencies_hz, once.frequencies_hz[0]),
        samples=np.concatenate([once.samples, 2j * once.samples[:, :1]], axis=1),
    )
    settings = method("3fsk").configure(around(POINT_M), "test")
    for field in ("z_m", "sigma_m", "p_gross"):
        both = [getattr(image(c, method("3fsk"), settings), field) for c in (once, again)]
        np.testing.assert_array_equal(*both)
    assert not list(warnings_of(again, CHANNELS))


def test_dead_tones_and_antennas_are_named():
    capture = exact_capture(POINT_M, array=SOME)

    def kill(samples):
        samples[0, 1] = 0
        samples[:, :, 3] = 0

    of_tone, of_antenna = warnings_of(changed(capture, kill), CHANNELS)
    assert "81.8 GHz" in of_tone
    assert "1 of 16 transmitters" in of_antenna and "numbers 3" in of_antenna
    scan = AntennaPairs(SOME.tx_m, SOME.tx_m)
    dead = RadarCapture(np.zeros((1, 3, 16), np.complex64), capture.frequencies_hz, scan)
    [of_frame] = warnings_of(dead, CHANNELS)  # the dead channels of such a frame are not listed
    assert "1 of 1 frames" in of_frame
