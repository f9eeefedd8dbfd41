"""mmWave Studio's profiles and the files of a cascade, written here key by key and one number after
the other."""

import copy
import json
import struct

import numpy as np
import pytest

import handbench as hb
from handbench.bench.datasets.ti_raw import import_ti_raw
from handbench.support.errors import HandbenchError

C = 299_792_458.0


def radar(number=0, sent=(1, 4), receivers=0xF):
    """A radar's settings; sent: the mask of transmitters of each chirp."""
    chirps = [
        {
            "chirpStartIdx": k,
            "chirpEndIdx": k,
            "profileId": 0,
            "startFreqVar_MHz": 0.0,
            "freqSlopeVar_KHz_usec": 0.0,
            "idleTimeVar_usec": 0.0,
            "adcStartTimeVar_usec": 0.0,
            "txEnable": hex(mask),
        }
        for k, mask in enumerate(sent)
    ]
    profile = {
        "profileId": 0,
        "startFreqConst_GHz": 77.0,
        "idleTimeConst_usec": 100.0,
        "adcStartTimeConst_usec": 6.0,
        "rampEndTime_usec": 60.0,
        "freqSlopeConst_MHz_usec": 29.982,
        "numAdcSamples": 4,
        "digOutSampleRate": 10000.0,
    }
    frame = {"chirpStartIdx": 0, "chirpEndIdx": len(sent) - 1, "numLoops": 2, "numFrames": 1}
    return {
        "mmWaveDeviceId": number,
        "rfConfig": {
            "waveformType": "legacyFrameChirp",
            "rlChanCfg_t": {"rxChannelEn": hex(receivers), "txChannelEn": "0x7"},
            "rlAdcOutCfg_t": {"fmt": {"b2AdcBits": 2, "b2AdcOutFmt": 1}},
            "rlProfiles": [{"rlProfileCfg_t": profile}],
            "rlChirps": [{"rlChirpCfg_t": chirp} for chirp in chirps],
            "rlFrameCfg_t": frame,
        },
        "rawDataCaptureConfig": {
            "rlDevDataFmtCfg_t": {"iqSwapSel": 0, "chInterleave": 1},
            "rlDevDataPathCfg_t": {"intfSel": 1, "transferFmtPkt0": "0x1"},
            "rlDevLaneEnable_t": {"laneEn": "0x3"},
        },
    }


def write(folder, radars, content=b""):
    (folder / "a.mmwave.json").write_text(json.dumps({"mmWaveDevices": radars}))
    (folder / "a.setup.json").write_text('{"captureHardware": "DCA1000"}')
    (folder / "adc_data.bin").write_bytes(content)
    return folder


def value(frame, loop, chirp, rx, n):
    return 4000 * frame + 1500 * loop + 100 * chirp + 5 * rx + n


@pytest.mark.parametrize(("lanes", "apart", "swap"), [("0x3", 1, 0), ("0xf", 0, 0), ("0x3", 1, 1)])
def test_a_profile_of_mmwave_studio(tmp_path, lanes, apart, swap):
    one = radar(receivers=0b0101)
    one["rawDataCaptureConfig"]["rlDevLaneEnable_t"]["laneEn"] = lanes
    one["rawDataCaptureConfig"]["rlDevDataFmtCfg_t"] = {"iqSwapSel": swap, "chInterleave": apart}
    numbers = []
    for loop, chirp in np.ndindex(2, 2):
        for part in range(4):
            if apart:  # two receivers, one after the other, two times of each at once
                rx, n = (0, 2)[part // 2], part % 2 * 2
                i = [value(0, loop, chirp, rx, n), value(0, loop, chirp, rx, n + 1)]
            else:
                i = [value(0, loop, chirp, rx, part) if rx in (0, 2) else 0 for rx in range(4)]
            q = [-number for number in i]
            numbers += q + i if swap else i + q
    content = struct.pack(f"<{len(numbers)}h", *numbers)
    import_ti_raw(write(tmp_path, [one], content), tmp_path / "out", {"board": "AWR1843BOOST"})
    echoes = hb.load(tmp_path / "out").echoes
    assert echoes.samples.shape == (1, 4, 2, 2)
    for n, tx, rx in np.ndindex(4, 2, 2):
        i = (value(0, 0, tx, 2 * rx, n) + value(0, 1, tx, 2 * rx, n)) / 2
        assert echoes.samples[0, n, tx, rx] == complex(i, i)  # conjugated
    times = [6e-6 + n / 10e6 for n in range(4)]
    assert echoes.frequencies_hz == pytest.approx([77e9 + 29.982e12 * t for t in times], rel=1e-12)
    across = echoes.aperture.tx_m[:, 0]  # the first and the third
    assert across[1] - across[0] == pytest.approx(
        4 * C / 2 / echoes.frequencies_hz.mean(), rel=1e-3
    )


def test_a_cascade(tmp_path):
    """Chirps are sent by transmitter 12 first, 1 last; a radar's file has I and Q of its four
    receivers, sample by sample."""
    masks = np.zeros((4, 12), int)
    for chirp in range(12):
        masks[(11 - chirp) // 3, chirp] = 1 << (11 - chirp) % 3
    radars = [radar(number, mask) for number, mask in enumerate(masks.tolist())]
    write(tmp_path, radars)
    (tmp_path / "adc_data.bin").unlink()
    for number, name in enumerate(("master", "slave1", "slave2", "slave3")):
        numbers = []
        for frame, loop, chirp, n, rx in np.ndindex(2, 2, 12, 4, 4):
            i = value(frame, loop, chirp, 4 * number + rx, n)
            numbers += [i, -i]
        whole = struct.pack(f"<{len(numbers)}h", *numbers)
        (tmp_path / f"{name}_0000_data.bin").write_bytes(whole[: len(whole) // 2])
        (tmp_path / f"{name}_0001_data.bin").write_bytes(whole[len(whole) // 2 :])
        (tmp_path / f"{name}_0000_idx.bin").write_bytes(b"an index")
    import_ti_raw(tmp_path, tmp_path / "out")
    echoes = hb.load(tmp_path / "out").echoes
    assert echoes.samples.shape == (2, 4, 12, 16)
    for frame, n, tx, rx in np.ndindex(echoes.samples.shape):
        i = value(frame, 0, 11 - tx, rx, n) + 750
        assert echoes.samples[frame, n, tx, rx] == complex(i, i)
    half_m = C / 2 / 76.8e9
    tx_m, rx_m = echoes.aperture.tx_m, echoes.aperture.rx_m
    assert np.allclose(np.ptp(tx_m[3:, 0]), 32 * half_m) and np.ptp(tx_m[3:, 1]) == 0
    assert np.allclose((tx_m[:3, 1] - tx_m[3, 1]) / half_m, [6, 4, 1])
    # TI's user guide of the board: with nine transmitters a virtual array of 86 in a row
    across_m = tx_m[3:, None, 0] + rx_m[:, 0]
    row = np.unique(np.rint((across_m - across_m.min()) / half_m))
    assert row.tolist() == list(range(86))
    (tmp_path / "slave2_0001_data.bin").unlink()
    with pytest.raises(HandbenchError, match="have 1536, 1536, 768, 1536 numbers"):
        import_ti_raw(tmp_path, tmp_path / "again")


@pytest.mark.parametrize(
    ("place", "value", "message"),
    [
        (("rfConfig", "rlFrameCfg_t"), {}, "lacks 'chirpStartIdx'; expected"),
        (("rfConfig", "rlProfiles"), [], "is not as mmWave Studio exports it"),
        (("rfConfig", "waveformType"), "advancedFrameChirp", "expected legacyFrameChirp"),
        (("rfConfig", "rlAdcOutCfg_t", "fmt", "b2AdcBits"), 1, "16 bits; expected b2AdcBits 2"),
        (("rfConfig", "rlFrameCfg_t", "chirpEndIdx"), 2, "no or several transmitters"),
        (("rfConfig", "rlFrameCfg_t", "chirpEndIdx"), 1e300, "no or several transmitters"),
        (("rfConfig", "rlChirps", 0, "rlChirpCfg_t", "txEnable"), "0x3", "several transmitters"),
        (("rfConfig", "rlChirps", 1, "rlChirpCfg_t", "profileId"), 1, "changes the profile"),
        (("rfConfig", "rlChirps", 1, "rlChirpCfg_t", "startFreqVar_MHz"), 5, "changes the profile"),
        (("rawDataCaptureConfig", "rlDevLaneEnable_t", "laneEn"), "0xF", "has 4 lanes and"),
        (
            ("rawDataCaptureConfig", "rlDevDataPathCfg_t", "transferFmtPkt0"),
            "0x6",
            "expected transferFmtPkt0 0x1",
        ),
    ],
)
def test_what_is_refused(tmp_path, place, value, message):
    one = copy.deepcopy(radar())
    *way, last = place
    at = one
    for key in way:
        at = at[key]
    at[last] = value
    write(tmp_path, [one], bytes(256))
    with pytest.raises(HandbenchError) as caught:
        import_ti_raw(tmp_path, tmp_path / "out")
    assert message in str(caught.value) and "a.mmwave.json" in str(caught.value)
    assert "\n" not in str(caught.value)
