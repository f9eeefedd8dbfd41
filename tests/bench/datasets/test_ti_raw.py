"""Raw captures of TI's radars: files written here number by number, and a board's own."""

import json
import math
import shutil
import struct
from pathlib import Path

import numpy as np
import pytest

import handbench as hb
from handbench.bench.datasets.ti_profile import ChirpProfile
from handbench.bench.datasets.ti_raw import import_ti_raw
from handbench.bench.datasets.ti_samples import decode
from handbench.bench.validation.inspection import problems_of
from handbench.cli.main import main
from handbench.support.errors import HandbenchError
from tests.bench.datasets.ti_captures import stream as written

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


def write(folder, cfg=CFG, numbers=b"", places=True):
    (folder / "profile.cfg").write_text(cfg)
    (folder / "adc_data.bin").write_bytes(numbers)
    for name, table in (("tx_m.csv", TX_M), ("rx_m.csv", RX_M)) if places else ():
        rows = "".join(f"{x},{y},{z}\n" for x, y, z in table)
        (folder / name).write_text("x_m,y_m,z_m\n" + rows)
    return folder


def value(frame, loop, chirp, rx, n):
    """The I of a sample; its Q is 7 more, negative."""
    return 4000 * frame + 1000 * loop + 300 * chirp + 40 * rx + n


def stream(frames, loops, chirps, receivers, samples, lanes=2, order="IQ", real=False):
    """What a DCA1000 writes of `value`."""
    i = np.fromfunction(value, (frames, loops, chirps, 4, samples), dtype=int)
    return written(i + 1j * (-i - 7), receivers, lanes, order, real)


@pytest.mark.parametrize("lanes", [2, 4])
@pytest.mark.parametrize("order", ["IQ", "QI"])
@pytest.mark.parametrize(("mask", "receivers"), [(15, [0, 1, 2, 3]), (5, [0, 2])])
def test_every_number_is_in_its_place(tmp_path, capsys, lanes, order, mask, receivers):
    cfg = CFG.replace("channelCfg 15", f"channelCfg {mask}").replace(
        "adcbufCfg -1 0 0 1 1", f"adcbufCfg -1 0 {int(order == 'QI')} {int(lanes == 2)} 1"
    )
    source = write(tmp_path, cfg, stream(2, 3, 2, receivers, 8, lanes, order))
    out = tmp_path / "out"
    assert main(["import", "ti-raw", str(source), "-o", str(out)]) == 0, capsys.readouterr().err
    echoes = hb.load(out).echoes
    assert echoes.samples.shape == (2, 8, 2, len(receivers))
    for frame, n, tx, rx in np.ndindex(echoes.samples.shape):
        i = value(frame, 1, tx, receivers[rx], n)  # loops 0, 1, 2 averaged
        assert echoes.samples[frame, n, tx, rx] == complex(i, i + 7)  # conjugated
    assert echoes.aperture.tx_m.tolist() == [list(TX_M[0]), list(TX_M[2])]
    assert echoes.aperture.rx_m.tolist() == [list(RX_M[rx]) for rx in receivers]
    times = [6e-6 + n / 2.047e6 for n in range(8)]
    assert echoes.frequencies_hz == pytest.approx([60e9 + 29.982e12 * t for t in times], rel=1e-12)


def test_json_frames_of_loops_and_several_files_in_the_order_of_their_numbers(tmp_path):
    numbers = stream(3, 2, 1, [0], 4, real=True)
    profile = {"start_hz": 77e9, "slope_hz_s": 30e12, "adc_start_s": 0, "rate_hz": 1e6}
    profile |= {"samples": 4, "receivers": [1], "transmitters": [2], "loops": 2, "real": True}
    shape = ChirpProfile.model_validate(profile)
    decoded = decode(np.frombuffer(numbers, "<i2"), shape, "here")
    assert decoded.shape == (3, 2, 1, 1, 4)
    assert decoded[2, 1, 0, 0].tolist() == [value(2, 1, 0, 0, n) for n in range(4)]
    write(tmp_path)
    (tmp_path / "profile.cfg").unlink()
    (tmp_path / "adc_data.bin").unlink()
    (tmp_path / "p.json").write_text(json.dumps(profile))
    for name, part in (("a_2.bin", numbers[:9]), ("a_10.bin", numbers[9:])):
        (tmp_path / name).write_bytes(part)
    import_ti_raw(tmp_path, tmp_path / "out", {"sweeps": "frames"})
    echoes = hb.load(tmp_path / "out").echoes
    assert echoes.samples.shape == (6, 4, 1, 1)
    # the real part of what is real is as it was
    assert echoes.samples[5, :, 0, 0].real == pytest.approx(
        [value(2, 1, 0, 0, n) for n in range(4)]
    )


@pytest.mark.parametrize("real", [False, True])
@pytest.mark.parametrize("board", ["IWR6843ISK", "IWR6843AOP", "AWR1843BOOST"])
def test_a_point_has_the_phase_of_its_path(tmp_path, board, real):
    """A point far to the left and a little up: the antennas' places follow from its phases."""
    n, slope, rate = 128, 60e12, 4e6
    cfg = CFG.replace("29.982 1 8 2047", "60 1 128 4000").replace("3 0 100", "1 0 100")
    cfg = cfg.replace("adcCfg 2 1", f"adcCfg 2 {int(not real)}")
    point = np.array([0.4, 0.2, 0.8])
    half = {"AWR1843BOOST": C / (120e9 + slope * (12e-6 + 127 / rate))}.get(board, 2.5e-3)
    if board == "IWR6843AOP":  # seen from the radar: to the left, up
        tx, rx = [(0, 0), (0, -2)], [(1, -1), (1, 0), (0, -1), (0, 0)]
        signs = [-1, 1, -1, 1]
    else:
        tx, rx = [(0, -1), (4, -1)], [(0, 0), (1, 0), (2, 0), (3, 0)]
        signs = [1, 1, 1, 1]
    every = [(0, 0), (2, -2), (0, -2)] if board == "IWR6843AOP" else [(0, -1), (2, 0), (4, -1)]
    middle = (np.mean(every, axis=0) + np.mean(rx, axis=0)) / 2
    tx, rx = (half * np.pad(np.array(at) - middle, ((0, 0), (0, 1))) for at in (tx, rx))
    path = np.linalg.norm(tx - point, axis=1)[:, None] + np.linalg.norm(rx - point, axis=1)
    numbers = []
    for t in range(2):
        for r in range(4):
            turns = [
                (60e9 + slope * (6e-6 + k / rate)) * path[t, r] / C % 1 * 2 * math.pi
                for k in range(n)
            ]
            i = [signs[r] * 9000 * math.cos(turn) for turn in turns]
            q = [signs[r] * 9000 * math.sin(turn) for turn in turns]
            for k in range(0, n, 2):
                numbers += [*i[k : k + 2], *(() if real else q[k : k + 2])]
    data = b"".join(struct.pack("<h", round(number)) for number in numbers)
    source = write(tmp_path, cfg, data, places=False)
    import_ti_raw(source, tmp_path / "out", {"board": board})
    echoes = hb.load(tmp_path / "out").echoes
    f = echoes.frequencies_hz
    expected = np.exp(-2j * np.pi * f[:, None, None] * path / C)
    ratio = echoes.samples[0] * expected.conj() / 9000
    inner = slice(24, -24) if real else slice(None)  # a Hilbert transform ends badly
    assert np.abs(ratio[inner] - 1).max() < (0.1 if real else 1e-3)
    np.testing.assert_allclose(echoes.aperture.tx_m, tx, atol=1e-9)
    np.testing.assert_allclose(echoes.aperture.rx_m, rx, atol=1e-9)


@pytest.mark.skipif(not CHAIR.is_dir(), reason=f"the chair's captures are not at {CHAIR}")
def test_a_boards_own_files(tmp_path):
    cfg = CFG.replace("1 8 2047", "1 256 2047").replace("frameCfg 0 1 3", "frameCfg 0 1 32")
    write(tmp_path, cfg, places=False)
    (tmp_path / "adc_data.bin").unlink()
    for k in range(1, 9):
        shutil.copy(CHAIR / "adc" / f"{k}.bin", tmp_path)
    import_ti_raw(tmp_path, tmp_path / "out", {"board": "IWR6843ISK", "sweeps": "frames"})
    echoes = hb.load(tmp_path / "out").echoes
    samples = echoes.samples  # 32 loops of each of 8 files
    assert samples.shape == (256, 256, 2, 4)
    # The set has chirps 0 and 32, and takes them for those of two transmitters. But they are
    # nearly equal and their neighbours are not: the transmitters alternate, both are of the first.
    truth = np.load(CHAIR / "sar_raw.npy", mmap_mode="r")[0, :8].conj()
    for chirp, four in ((0, slice(4)), (16, slice(4, 8))):
        assert np.array_equal(samples[chirp::32, :, 0].transpose(0, 2, 1), truth[:, four])
    # The photograph has the chair in the middle and an open drawer of metal 1.2 m away on the left,
    # at sin θ = 0.48 by the stereo camera, whose direction to the radar's is not known.
    weighted = samples.mean(axis=0) * np.hanning(256)[:, None, None]
    sines = np.linspace(-0.8, 0.8, 81)
    for range_m, sine in ((1.38, 0.48), (1.78, 0.0)):
        points = range_m * np.stack([sines, 0 * sines, np.sqrt(1 - sines**2)], axis=1)
        to, back = (
            np.linalg.norm(points[:, None] - at, axis=2)
            for at in (echoes.aperture.tx_m, echoes.aperture.rx_m)
        )
        path = (to[:, :, None] + back[:, None])[:, None]
        waves = np.exp(2j * np.pi * echoes.frequencies_hz[:, None, None] * path / C)
        image = np.abs((waves * weighted).sum(axis=(1, 2, 3)))
        assert sines[image.argmax()] == pytest.approx(sine, abs=0.1)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("profileCfg", "% profileCfg", "profile.cfg: has no profileCfg"),
        ("0 0 30", "0 0 x", "line 7: profileCfg is '0 60 7 6 65 0 0 29.982 1 8 2047 0 0 x'"),
        ("channelCfg 15 5 0", "channelCfg", "line 4: channelCfg is ''; expected 1 numbers"),
        ("OutputMode 1", "OutputMode 3", "line 3: dfeDataOutputMode is '3'; expected 1: frames"),
        (
            "0 0 0 0 0 4",
            "0 0 0 0 0 5",
            "line 9: chirpCfg is '1 1 0 0 0 0 0 5'; expected chirp numbers",
        ),
        (
            "0 0 0 0 0 4",
            "0 0 0 9 0 4",
            "line 9: chirpCfg is '1 1 0 0 0 9 0 4'; expected chirp numbers",
        ),
        ("chirpCfg 1 1", "chirpCfg 1 1e9", "line 9: chirpCfg"),
        ("chirpCfg 1 1 0", "chirpCfg 1 1 1", "the same profileCfg for all"),
        ("frameCfg 0 1", "frameCfg 0 2", "frameCfg sends the chirps 0 to 2; expected a chirpCfg"),
        ("frameCfg 0 1", "frameCfg -1e300 1e300", "expected a chirpCfg for each"),
        ("lvdsStreamCfg -1 0", "lvdsStreamCfg -1 1", "line 11: lvdsStreamCfg"),
        ("1 8 2047", "1 1e30 2047", "'samples' is 1000000000000000019884624838656"),
        ("60 7 6", "60e9 7 6", "'start_hz' is 6e+19"),
        ("channelCfg 15", "channelCfg 0", "'receivers' is ()"),
        ("frameCfg 0 1 3", "chirpCfg 2 2 0 0 0 0 0 4\nframeCfg 0 2 3", "[1, 3] have [1, 2] chirps"),
        ("1 8 2047", "1 7 2047", "not a whole number of frames of"),
        (
            "frameCfg 0 1 3",
            "frameCfg 0 1 4",
            "has 1536 bytes, which is not a whole number of frames of 1024",
        ),
        ("", "", "nothing gives the positions of the antennas; add tx_m.csv"),
    ],
)
def test_profiles_that_are_refused(tmp_path, old, new, message):
    cfg = CFG.replace(old, new, 1)
    write(tmp_path, cfg, stream(2, 3, 2, [0, 1, 2, 3], 8), places=bool(old))
    with pytest.raises(HandbenchError) as caught:
        import_ti_raw(tmp_path, tmp_path / "out")
    assert message in str(caught.value)
    if "whole number of frames" in message:
        assert message in str(next(problems_of(str(tmp_path))))
    assert str(tmp_path) in str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("spoil", "message"),
    [
        (lambda f: (f / "profile.cfg").unlink(), "has none; expected exactly one .cfg or .json"),
        (
            lambda f: (f / "p.json").write_text("{}"),
            "has p.json, profile.cfg; expected exactly one",
        ),
        (lambda f: (f / "adc_data.bin").write_bytes(b""), "has no .bin file with samples"),
        (lambda f: (f / "rx_m.csv").unlink(), "rx_m.csv: expected a CSV file"),
        (
            lambda f: (f / "tx_m.csv").write_text("x_m,y_m,z_m\n0,0,0\n"),
            "tx_m has only 1 positions",
        ),
        (lambda f: (f / "profile.cfg").write_bytes(b"\xff"), "profile.cfg: is not text"),
    ],
)
def test_folders_that_are_refused(tmp_path, spoil, message):
    write(tmp_path, CFG, stream(1, 3, 2, [0, 1, 2, 3], 8))
    spoil(tmp_path)
    with pytest.raises(HandbenchError) as caught:
        import_ti_raw(tmp_path, tmp_path / "out")
    assert message in str(caught.value)
