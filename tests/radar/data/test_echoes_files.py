"""Arrays, captures and depth maps on disk."""

import h5py
import numpy as np
import pytest

from handbench.radar.data.arrays import AntennaArray, qar50
from handbench.radar.data.capture import RadarCapture
from handbench.radar.data.depthmap import DepthMap, load_depthmap
from handbench.radar.data.echoes_file import load_capture, save_capture
from handbench.support.errors import HandbenchError

SHAPE = (1, 5, 3, 4)  # of what `capture` makes


def capture(frames=2) -> RadarCapture:
    generator = np.random.default_rng(0)
    array = AntennaArray(generator.uniform(size=(3, 3)), generator.uniform(size=(4, 3)))
    samples = generator.standard_normal((frames, 5, 3, 4)) + 1j
    return RadarCapture(samples.astype(np.complex64), np.linspace(72e9, 82e9, 5), array)


def test_built_in_array_is_the_paper_s():
    array = qar50()
    assert array.channels == (94, 94)
    assert np.abs(np.concatenate([array.tx_m, array.rx_m])[:, :2]).max() <= 0.072
    assert np.allclose(np.diff(array.rx_m[:47, 0]), 0.003)


def test_tones_are_the_nearest_measured_ones_with_their_true_frequencies():
    samples, tones_hz = capture().tones([74.4e9, 82e9])
    assert tones_hz.tolist() == [74.5e9, 82e9]
    assert np.array_equal(samples, capture().samples[0, [1, 4]])
    for asked_hz, message in (([74.4e9, 74.6e9], "same nearest tone"), ([60e9], r"60\.0000 GHz")):
        with pytest.raises(HandbenchError, match=message):
            capture().tones(asked_hz)


def test_depth_map_round_trip_and_wrong_axes(tmp_path):
    z_m = np.array([[0.3, np.nan], [0.31, 0.32], [0.3, 0.3]])
    given = z_m, np.where(z_m > 0.31, 0.0, -6.0), "2fsk", {"f1_hz": 1.0}
    DepthMap(np.arange(2.0), np.arange(3.0), *given).save(tmp_path / "d.npz")
    again = load_depthmap(tmp_path / "d.npz")
    assert np.array_equal(again.z_m, z_m, equal_nan=True)
    assert (again.method, again.config) == ("2fsk", {"f1_hz": 1.0})
    DepthMap(np.arange(5.0), np.arange(3.0), *given).save(tmp_path / "bad.npz")
    expected = r"z_m is float64 \(3, 2\); expected real numbers of shape \(3, 5\)"
    with pytest.raises(HandbenchError, match=expected):
        load_depthmap(tmp_path / "bad.npz")


@pytest.mark.parametrize(
    ("name", "made", "message"),
    [
        ("samples", {"data": np.full(SHAPE, np.nan, "c8")}, "no channel was measured"),
        ("samples", {"data": np.ones((1, 5, 3, 5), "c8")}, r"expected \[frame, 5, 3, 4\]"),
        ("frequencies_hz", {"data": [1.0, 2.0, 3.0, 4.0, -5.0]}, "expected frequencies above 0"),
        ("tx_m", {"data": np.zeros((3, 2))}, r"shape \(3, 2\) of .* \[n, 3\]"),
        ("tx_m", None, r"has rx_m; expected the data sets tx_m"),
        (
            "samples",
            {"shape": (1, 5, 3, 10**13), "dtype": "c8", "chunks": SHAPE},
            "",
        ),  # 10^15 bytes
        ("samples", {"shape": SHAPE, "dtype": "f4", "external": [("secret", 0, 240)]}, ""),
        ("samples", h5py.SoftLink("/whole/samples"), "is missing"),
        ("tx_m", h5py.ExternalLink("other.h5", "tx_m"), "is missing"),
    ],
    ids=str,
)
def test_bad_echoes_are_named(tmp_path, name, made, message, monkeypatch):
    """Nor does a file reach into others: what lies beside it, or anywhere, is not its echoes."""
    monkeypatch.chdir(tmp_path)
    for file in ("other.h5", "echoes.h5"):
        save_capture(tmp_path / file, capture(1))
    (tmp_path / "secret").write_bytes(bytes(240))
    with h5py.File(tmp_path / "echoes.h5", "a") as file:
        del file[name]
        if isinstance(made, h5py.SoftLink):
            file["whole"] = h5py.ExternalLink("other.h5", "/")
        if isinstance(made, dict):
            file.create_dataset(name, **made)
        elif made is not None:
            file[name] = made
    with pytest.raises(HandbenchError, match=rf"echoes\.h5.*{message}") as caught:
        load_capture(tmp_path / "echoes.h5")
    assert "\n" not in str(caught.value)
