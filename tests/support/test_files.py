"""Arrays, captures and depth maps on disk."""

import subprocess
import sys
from pathlib import Path

import h5py
import numpy as np
import pytest

from handbench.radar.data.arrays import AntennaArray, PlanarScan, load_positions, qar50
from handbench.radar.data.capture import RadarCapture
from handbench.radar.data.depthmap import DepthMap, load_depthmap
from handbench.radar.data.echoes_file import load_capture, save_capture
from handbench.radar.data.grid import Axis
from handbench.support.errors import HandbenchError
from handbench.support.files import inside

SHARED = Path(__file__).parents[2].parent / "shared" / "data" / "qar50"


def capture(frames=2) -> RadarCapture:
    generator = np.random.default_rng(0)
    array = AntennaArray(generator.uniform(size=(3, 3)), generator.uniform(size=(4, 3)))
    samples = generator.standard_normal((frames, 5, 3, 4)) + 1j
    return RadarCapture(samples.astype(np.complex64), np.linspace(72e9, 82e9, 5), array)


@pytest.mark.skipif(
    not SHARED.is_dir(), reason=f"the recorded antenna positions are not at {SHARED}"
)
def test_built_in_array_equals_the_recorded_positions():
    assert np.allclose(qar50().tx_m, load_positions(SHARED / "tx_m.csv"), atol=1e-12)
    assert np.allclose(qar50().rx_m, load_positions(SHARED / "rx_m.csv"), atol=1e-12)


def test_built_in_array_is_the_paper_s():
    array = qar50()
    assert array.channels == (94, 94)
    assert np.abs(np.concatenate([array.tx_m, array.rx_m])[:, :2]).max() <= 0.072
    assert np.allclose(np.diff(array.rx_m[:47, 0]), 0.003)


def test_capture_round_trip(tmp_path):
    save_capture(tmp_path / "echoes.h5", capture())
    again = load_capture(tmp_path / "echoes.h5")
    assert np.array_equal(again.samples, capture().samples)
    assert np.array_equal(again.aperture.tx_m, capture().aperture.tx_m)


def test_planar_scan_round_trip(tmp_path):
    scan = RadarCapture(
        np.ones((1, 2, 7), np.complex64), np.array([1e9, 2e9]), PlanarScan(np.zeros((7, 3)))
    )
    save_capture(tmp_path / "echoes.h5", scan)
    assert load_capture(tmp_path / "echoes.h5").aperture.channels == (7,)


@pytest.mark.parametrize(
    ("name", "value", "message"),
    [
        ("samples", np.full((1, 5, 3, 4), np.nan, np.complex64), "no channel was measured"),
        (
            "samples",
            np.ones((1, 5, 3, 5), np.complex64),
            r"shape \(1, 5, 3, 5\); expected \[frame, 5, 3, 4\]",
        ),
        ("frequencies_hz", np.array([1.0, 2.0, 3.0, 4.0, -5.0]), "expected positive hertz"),
        ("frequencies_hz", np.float64(1.0), r"shape \(\); expected \[f\]"),
        ("tx_m", np.zeros((3, 2)), r"shape \(3, 2\); expected \[n, 3\]"),
        ("tx_m", None, "not a readable echoes.h5"),
    ],
)
def test_bad_echoes_are_named(tmp_path, name, value, message):
    path = tmp_path / "echoes.h5"
    save_capture(path, capture(1))
    with h5py.File(path, "a") as file:
        del file[name]
        if value is not None:
            file[name] = value
    with pytest.raises(HandbenchError, match=message):
        load_capture(path)


def test_truncated_and_foreign_files_are_refused(tmp_path):
    path = tmp_path / "echoes.h5"
    save_capture(path, capture())
    path.write_bytes(path.read_bytes()[:500])
    with pytest.raises(HandbenchError, match="not a readable"):
        load_capture(path)
    with h5py.File(path, "w") as file:
        file.attrs["format"] = "something else"
    with pytest.raises(HandbenchError, match="something else"):
        load_capture(path)
    with pytest.raises(HandbenchError, match="found nothing"):
        load_capture(tmp_path / "missing.h5")


def test_tones_are_the_nearest_measured_ones_with_their_true_frequencies():
    samples, tones_hz = capture().tones([74.4e9, 82e9])
    assert tones_hz.tolist() == [74.5e9, 82e9]
    assert np.array_equal(samples, capture().samples[0, [1, 4]])
    with pytest.raises(HandbenchError, match="same measured tone"):
        capture().tones([74.4e9, 74.6e9])
    with pytest.raises(HandbenchError, match=r"60\.0000 GHz"):
        capture().tones([60e9])


def test_depth_map_round_trip_and_wrong_axes(tmp_path):
    z_m = np.array([[0.3, np.nan], [0.31, 0.32], [0.3, 0.3]])
    depth = DepthMap(
        np.arange(2.0), np.arange(3.0), z_m, np.where(z_m > 0.31, 0.0, -6.0), "2fsk", {"f1_hz": 1.0}
    )
    depth.save(tmp_path / "d.npz")
    again = load_depthmap(tmp_path / "d.npz")
    assert np.array_equal(again.z_m, z_m, equal_nan=True)
    assert (again.method, again.config) == ("2fsk", {"f1_hz": 1.0})
    DepthMap(np.arange(5.0), np.arange(3.0), z_m, z_m, "x").save(tmp_path / "bad.npz")
    with pytest.raises(
        HandbenchError, match=r"z_m is float64 \(3, 2\); expected real numbers \(3, 5\)"
    ):
        load_depthmap(tmp_path / "bad.npz")


def test_axis_includes_both_ends_and_refuses_a_reversed_range():
    axis = Axis(start_m=-0.15, stop_m=0.15, step_m=0.001).values_m()
    assert len(axis) == 301
    assert axis[-1] == 0.15
    with pytest.raises(ValueError, match="swap"):
        Axis(start_m=1, stop_m=0, step_m=0.1)


def hostile(tmp_path, **replaced) -> Path:
    """A capture with some of its data sets made by replaced[name](file, name)."""
    path = tmp_path / "echoes.h5"
    save_capture(path, capture(1))
    with h5py.File(path, "a") as file:
        for name, make in replaced.items():
            del file[name]
            make(file, name)
    return path


def _virtual() -> h5py.VirtualLayout:
    layout = h5py.VirtualLayout((1, 5, 3, 4), "f4")
    layout[...] = h5py.VirtualSource("other.h5", "samples", (1, 5, 3, 4))
    return layout


HUGE = (1, 5, 3, 10**13)  # a few kB of file, 10^15 bytes of memory


@pytest.mark.parametrize(
    "make",
    [
        lambda file, name: file.create_dataset(name, HUGE, np.complex64, chunks=(1, 1, 1, 1024)),
        lambda file, name: file.create_group(name),
        lambda file, name: file.create_dataset(name, data="samples"),
        lambda file, name: file.create_dataset(name, data=h5py.Empty("f4")),
        lambda file, name: file.create_dataset(
            name, data=np.zeros(3, [("a", "f4"), ("b", "f4"), ("c", "f4")])
        ),
        lambda file, name: file.__setitem__(name, h5py.SoftLink("/nowhere")),
        lambda file, name: file.__setitem__(name, h5py.SoftLink(f"/{name}")),
        lambda file, name: file.__setitem__(name, h5py.ExternalLink("other.h5", "samples")),
        lambda file, name: file.create_dataset(
            name, (1, 5, 3, 4), "f4", external=[("secret", 0, 240)]
        ),
        lambda file, name: file.create_virtual_dataset(name, _virtual()),
    ],
    ids=[
        "huge",
        "group",
        "text",
        "empty",
        "records",
        "dangling",
        "circular",
        "elsewhere",
        "raw",
        "virtual",
    ],
)
def test_data_sets_that_are_none_are_refused(tmp_path, make, monkeypatch):
    """Nor does a file reach into others: what lies beside it, or anywhere, is not its echoes."""
    monkeypatch.chdir(tmp_path)
    save_capture(tmp_path / "other.h5", capture(1))
    (tmp_path / "secret").write_bytes(bytes(240))
    with pytest.raises(HandbenchError, match=r"echoes\.h5") as caught:
        load_capture(hostile(tmp_path, samples=make))
    assert "\n" not in str(caught.value)


def test_a_capture_cut_at_any_place_is_refused(tmp_path):
    path = tmp_path / "echoes.h5"
    save_capture(path, capture(1))
    content = path.read_bytes()
    for length in range(0, len(content), 97):
        path.write_bytes(content[:length])
        with pytest.raises(HandbenchError, match=r"echoes\.h5"):
            load_capture(path)


MUTATED = """
import sys
import numpy as np
from pathlib import Path
from handbench.radar.data.echoes_file import load_capture
from handbench.support.errors import HandbenchError

path = Path(sys.argv[1])
good, generator, refused = path.read_bytes(), np.random.default_rng(3), 0
for _ in range(300):
    content = bytearray(good)
    for at in generator.integers(len(good), size=generator.integers(1, 6)):
        content[at] ^= 1 << generator.integers(8)
    path.write_bytes(content)
    try:
        load_capture(path)
    except HandbenchError as error:
        assert "\\n" not in str(error)
        refused += 1
print(refused)
"""


def test_mutations_are_read_or_refused(tmp_path):
    """300 seeded ones in a process of their own: what HDF5's library does of itself (it can loop
    for ever on a crafted file) is not ours to catch."""
    save_capture(tmp_path / "echoes.h5", capture(1))
    command = [sys.executable, "-c", MUTATED, str(tmp_path / "echoes.h5")]
    done = subprocess.run(
        command, capture_output=True, text=True, timeout=120, cwd=Path(__file__).parents[2]
    )
    assert done.returncode == 0, done.stderr
    assert int(done.stdout) > 20  # a flipped bit of an echo is but another echo


def test_names_do_not_leave_their_folder_by_links_either(tmp_path):
    (tmp_path / "folder").mkdir()
    (tmp_path / "secret").write_text("")
    (tmp_path / "folder" / "link").symlink_to(tmp_path / "secret")
    (tmp_path / "folder" / "up").symlink_to(tmp_path)
    (tmp_path / "folder" / "round").symlink_to(tmp_path / "folder" / "round")
    (tmp_path / "folder" / "mine").write_text("")
    (tmp_path / "folder" / "inner").symlink_to(tmp_path / "folder" / "mine")
    for name in ("link", "up/secret", "../secret", str(tmp_path / "secret"), "folder/../../secret"):
        with pytest.raises(HandbenchError, match="leaves the folder"):
            inside(tmp_path / "folder", name, "capture.toml")
    assert inside(tmp_path / "folder", "inner", "capture.toml").name == "mine"
