"""Raw captures of TI's radars: files written here number by number as SWRA581B lists them, and a
board's own."""

import shutil
from pathlib import Path

import numpy as np
import pytest

import handbench as hb
from handbench.bench.datasets.ti import import_ti_raw
from handbench.bench.validation.inspection import inspect
from handbench.cli.main import main
from tests.refusals import refuse

C = 299_792_458.0
CHAIR = Path(__file__).parents[3].parent / "shared" / "data" / "chair60" / "raw"
TX_M = [(0.0, 0.01 * k, 0.0) for k in range(3)]
RX_M = [(0.002 * k, 0.0, 0.0) for k in range(4)]
CFG = """% of a test
sensorStop
dfeDataOutputMode 1
channelCfg 15 5 0
adcCfg 2 1
adcbufCfg -1 0 0 1 1
profileCfg 0 60 7 6 65 0 0 29.982 1 8 2047 0 0 30
chirpCfg 0 0 0 0 0 0 0 1
chirpCfg 1 1 0 0 0 0 0 4
frameCfg 0 1 3 0 100 1 0
lvdsStreamCfg -1 0 1 0
"""


def stream(samples, lanes=2, order="IQ"):
    """What a DCA1000 writes of samples [frame, loop, chirp, receiver, sample]."""
    i, q = samples.real.astype("<i2"), samples.imag.astype("<i2")
    parts = np.stack([i, q] if order == "IQ" else [q, i])
    if lanes == 4:  # I of all receivers, then Q
        return np.moveaxis(parts, [0, -1], [-2, -3]).tobytes()
    return np.moveaxis(parts.reshape(*parts.shape[:-1], -1, 2), 0, -2).tobytes()


def counted():
    """Two frames that tell where they belong, and their conjugates' means over the three loops."""
    frame, loop, chirp, rx, n = np.indices((2, 3, 2, 4, 8))
    i = 4000 * frame + 1000 * loop + 300 * chirp + 40 * rx + n
    samples = i + 1j * (-i - 7)
    return samples, samples.mean(axis=1).conj().transpose(0, 3, 1, 2)


def write(folder, cfg=CFG, numbers=b"", places=True):
    (folder / "profile.cfg").write_text(cfg)
    (folder / "adc_data.bin").write_bytes(numbers)
    for name, table in (("tx_m.csv", TX_M), ("rx_m.csv", RX_M)) if places else ():
        rows = "".join(f"{x},{y},{z}\n" for x, y, z in table)
        (folder / name).write_text("x_m,y_m,z_m\n" + rows)
    return folder


@pytest.mark.parametrize(("lanes", "order"), [(2, "IQ"), (2, "QI"), (4, "IQ")])
def test_every_number_is_in_its_place(tmp_path, lanes, order):
    cfg = CFG.replace("-1 0 0 1 1", f"-1 0 {int(order == 'QI')} {int(lanes == 2)} 1")
    samples, expected = counted()
    source, out = write(tmp_path, cfg, stream(samples, lanes, order)), tmp_path / "out"
    assert main(["import", "ti-raw", str(source), "-o", str(out)]) == 0
    echoes = hb.load(out).echoes
    np.testing.assert_array_equal(echoes.samples, expected)
    np.testing.assert_array_equal(echoes.aperture.tx_m, [TX_M[0], TX_M[2]])
    np.testing.assert_array_equal(echoes.aperture.rx_m, RX_M)
    times_s = 6e-6 + np.arange(8) / 2.047e6
    np.testing.assert_allclose(echoes.frequencies_hz, 60e9 + 29.982e12 * times_s, rtol=1e-12)


def test_loops_as_frames_of_two_receivers_in_two_files(tmp_path, capsys):
    samples = counted()[0][..., ::2, :]
    cfg = CFG.replace("channelCfg 15", "channelCfg 5").replace("3 0 100", "3 4 100")
    write(tmp_path, cfg, stream(samples)[:99]).joinpath("adc_data.bin").rename(tmp_path / "a_2.bin")
    (tmp_path / "a_10.bin").write_bytes(stream(samples)[99:])
    import_ti_raw(tmp_path, tmp_path / "out", sweeps="frames")
    expected = samples.reshape(6, 2, 2, 8).conj().transpose(0, 3, 1, 2)
    np.testing.assert_array_equal(hb.load(tmp_path / "out").echoes.samples, expected)
    assert "2 frames" in capsys.readouterr().err  # of 4


@pytest.mark.parametrize(
    ("board", "real"),
    [("IWR6843ISK", False), ("IWR6843ISK", True), ("IWR6843AOP", False), ("AWR1843BOOST", False)],
)
def test_a_point_has_the_phase_of_its_path(tmp_path, board, real):
    """A point far to the left and a little up: the antennas' places follow from its phases."""
    cfg = CFG.replace("29.982 1 8 2047", "60 1 128 4000").replace("3 0 100", "1 0 100")
    cfg = cfg.replace("adcCfg 2 1", f"adcCfg 2 {int(not real)}")
    f = 60e9 + 60e12 * (6e-6 + np.arange(128) / 4e6)
    unit_m = C / f[[0, -1]].sum() if board == "AWR1843BOOST" else 2.5e-3
    if board == "IWR6843AOP":  # seen from the radar: to the left, up
        tx, rx, signs = [(0, 0), (2, -2), (0, -2)], [(1, -1), (1, 0), (0, -1), (0, 0)], [-1, 1] * 2
    else:
        tx, rx, signs = [(0, -1), (2, 0), (4, -1)], [(k, 0) for k in range(4)], [1] * 4
    middle = (np.mean(tx, axis=0) + np.mean(rx, axis=0)) / 2
    tx_m, rx_m = (unit_m * np.pad(np.array(at) - middle, ((0, 0), (0, 1))) for at in (tx, rx))
    away_m = [np.linalg.norm(at - [0.4, 0.2, 0.8], axis=1) for at in (tx_m[[0, 2]], rx_m)]
    beat = np.exp(2j * np.pi * f * np.add.outer(*away_m)[..., None] / C)
    numbers = np.rint(9000 * np.array(signs)[:, None] * beat)[None, None]
    content = numbers.real.astype("<i2").tobytes() if real else stream(numbers)
    import_ti_raw(write(tmp_path, cfg, content, places=False), tmp_path / "out", board=board)
    echoes = hb.load(tmp_path / "out").echoes
    ratio = echoes.samples[0].transpose(1, 2, 0) * beat / 9000
    inner = slice(24, -24) if real else slice(None)  # a Hilbert transform ends badly
    assert np.abs(ratio[..., inner] - 1).max() < (0.1 if real else 1e-3)
    np.testing.assert_allclose(echoes.aperture.tx_m, tx_m[[0, 2]], atol=1e-9)
    np.testing.assert_allclose(echoes.aperture.rx_m, rx_m, atol=1e-9)


@pytest.mark.skipif(not CHAIR.is_dir(), reason=f"the chair's captures are not at {CHAIR}")
def test_a_boards_own_files(tmp_path):
    cfg = CFG.replace("1 8 2047", "1 256 2047").replace("frameCfg 0 1 3", "frameCfg 0 1 32")
    write(tmp_path, cfg, places=False).joinpath("adc_data.bin").unlink()
    for k in range(1, 9):
        shutil.copy(CHAIR / "adc" / f"{k}.bin", tmp_path)
    import_ti_raw(tmp_path, tmp_path / "out", board="IWR6843ISK", sweeps="frames")
    samples = hb.load(tmp_path / "out").echoes.samples  # 32 loops of each of 8 files
    # the set has chirps 0 and 32; the transmitters alternate, so both are of the first
    truth = np.load(CHAIR / "sar_raw.npy", mmap_mode="r")[0, :8].conj()
    for chirp, four in ((0, slice(4)), (16, slice(4, 8))):
        assert np.array_equal(samples[chirp::32, :, 0].transpose(0, 2, 1), truth[:, four])


@pytest.mark.parametrize(
    ("old", "new", "place"),
    [
        ("profileCfg", "% profileCfg", "profile.cfg"),
        ("0 0 30", "0 0 6,5", "'6,5'"),
        ("1 8 2047 0 0 30", "1", "expected 11"),
        ("OutputMode 1", "OutputMode 3", "dfeDataOutputMode"),
        ("0 0 0 0 0 4", "0 0 0 0 0 5", "one transmitter"),
        ("chirpCfg 1 1 0", "chirpCfg 1 1 1", "profileCfg"),
        ("frameCfg 0 1", "frameCfg -1e300 1e300", "profile.cfg"),
        ("frameCfg 0 1 3", "frameCfg 0 1 inf", "profile.cfg"),
        ("frameCfg 0 1 3", "chirpCfg 2 2 0 0 0 0 0 4\nframeCfg 0 2 3", "(1, 3, 3)"),
        ("frameCfg 0 1 3", "frameCfg 0 1 4", "1536 bytes"),  # frames of another size
        ("", "", "tx_m.csv"),  # no antennas
    ],
)
def test_profiles_that_do_not_fit_are_refused(tmp_path, old, new, place):
    write(tmp_path, CFG.replace(old, new, 1), stream(counted()[0]), places=bool(old))
    refuse(lambda: import_ti_raw(tmp_path, tmp_path / "out"), str(tmp_path), place)


def test_a_recording_that_is_there_twice_is_refused(tmp_path):
    write(tmp_path).joinpath("adc_data_Raw_0.bin").touch()
    files = "adc_data.bin", "adc_data_Raw_0.bin"
    refuse(lambda: import_ti_raw(tmp_path, tmp_path / "out"), *files)
    assert files[1] in str(*inspect(str(tmp_path)).lines)
    (tmp_path / "profile.cfg").unlink()
    assert "no .cfg file" in str(*inspect(str(tmp_path)).lines)
