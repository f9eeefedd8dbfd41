"""The real scan of a foam panel: it focuses, and where it should."""

from pathlib import Path

import numpy as np
import pytest

from handbench.bench.datasets.foam_panel import import_planar_scan
from handbench.bench.datasets.native import NativeCapture
from handbench.radar.methods.registry import method
from handbench.support.errors import HandbenchError
from tests.radar.exact import backproject

SCAN = Path(__file__).parents[3].parent / "shared" / "data" / "planar-scan-24ghz"
needs_scan = pytest.mark.skipif(not SCAN.is_dir(), reason=f"the recorded scan is not at {SCAN}")


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    out = tmp_path_factory.mktemp("scan") / "capture"
    import_planar_scan(SCAN, out)
    return out


@needs_scan
def test_the_scan_focuses_with_our_sign_and_its_phase_correction(folder):
    # Where the panel is strong, the sharpest image over all depths beats that of the conjugated
    # echoes by far.
    capture = NativeCapture(folder).echoes()
    assert capture.samples.shape == (1, 11, 187 * 144)
    assert capture.frequencies_hz[[0, -1]].tolist() == [22.2e9, 26.2e9]
    span_m = np.ptp(capture.aperture.position_m, axis=0)
    assert span_m == pytest.approx([186 * 0.003, 143 * 0.003, 0])
    depths = np.arange(0.05, 0.2, 0.002)
    points = np.stack([np.full_like(depths, -0.2), np.full_like(depths, 0.15), depths], axis=1)
    images = [
        np.abs(backproject(samples, capture.frequencies_hz, capture.aperture, points))
        for samples in (capture.samples[0], capture.samples[0].conj())
    ]
    assert images[0].max() > 2 * images[1].max()
    assert 0.09 <= depths[images[0].argmax()] <= 0.12


@needs_scan
@pytest.mark.slow
@pytest.mark.parametrize("name", ["3fsk", "broadband"])
def test_every_method_finds_the_panel(folder, name):
    # Every eighth pixel: this shows that the echoes focus on the panel, docs/planar_scan.md how
    # well.
    coarse = {axis: {"start_m": -0.15, "stop_m": 0.15, "step_m": 0.025} for axis in "xy"}
    config = NativeCapture(folder).about.methods[name] | coarse
    chosen = method(name)
    depth = chosen.run(NativeCapture(folder).echoes(), chosen.configure(config, name), 0).depth
    assert 0.09 <= np.nanmedian(depth.z_m) <= 0.11
    assert np.isfinite(depth.z_m).mean() > 0.6


def test_a_file_that_is_not_a_scan_is_refused(tmp_path):
    (tmp_path / "scan.npy").write_bytes(b"\x80\x04}.")  # a pickle
    (tmp_path / "phase.txt").write_text("1 2\n3 4\n")
    with pytest.raises(HandbenchError, match="six plain numpy arrays"):
        import_planar_scan(tmp_path, tmp_path / "out")
    assert not (tmp_path / "out").exists()
