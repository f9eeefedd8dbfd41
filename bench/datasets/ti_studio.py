"""Chirp profiles of TI's mmWave Studio: its .mmwave.json, of one radar or of the four of a cascade.

Sources: the types of the mmWaveLink (rlProfileCfg_t, rlChirpCfg_t, rlFrameCfg_t, rlChanCfg_t,
rlAdcOutCfg_t, rlDevDataFmtCfg_t, rlDevLaneEnable_t, rlDevDataPathCfg_t) after which the file's keys
are named; rawDataReader.m and parseJSON of TI's examples.
"""

from pathlib import Path
from typing import Any

from handbench.support.errors import HandbenchError

DEVICE = (3, 4)  # transmitters and receivers of a radar


def read_studio(path: Path, content: dict[str, Any], most: int) -> dict[str, Any]:
    """Convert the content of a .mmwave.json to the fields of a `ChirpProfile`. most: chirps that a
    loop may have. Raises HandbenchError for another content and for modes that are not read."""
    try:
        fields, wrong = _fields(content["mmWaveDevices"], most)
    except KeyError as error:
        raise HandbenchError(
            f"{path}: lacks {error}; expected mmWave Studio's export: configure the radar, and "
            "export again"
        ) from None
    except (IndexError, TypeError, ValueError, AttributeError, OverflowError) as error:
        raise HandbenchError(
            f"{path}: is not as mmWave Studio exports it ({error}); export it again"
        ) from None
    if wrong:
        raise HandbenchError(f"{path}: {'; '.join(wrong)}")
    return fields


def _fields(devices: list[dict[str, Any]], most: int) -> tuple[dict[str, Any], list[str]]:
    """Convert the radars' settings: (fields, what is not read)."""
    rf, raw = devices[0]["rfConfig"], devices[0]["rawDataCaptureConfig"]
    frame, layout = rf["rlFrameCfg_t"], raw["rlDevDataFmtCfg_t"]
    (profile,) = (entry["rlProfileCfg_t"] for entry in rf["rlProfiles"][:1])
    first, final = int(frame["chirpStartIdx"]), int(frame["chirpEndIdx"])
    sent: dict[int, list[int]] = {
        number: [] for number in range(first, min(final, first + most) + 1)
    }
    receivers, changed = [], False
    for device in devices:
        number, own = int(device["mmWaveDeviceId"]), device["rfConfig"]
        receivers += _numbers(own["rlChanCfg_t"]["rxChannelEn"], number * DEVICE[1])
        for chirp in (entry["rlChirpCfg_t"] for entry in own["rlChirps"]):
            inside = [n for n in sent if chirp["chirpStartIdx"] <= n <= chirp["chirpEndIdx"]]
            changed |= bool(inside) and chirp["profileId"] != profile["profileId"]
            changed |= any(value for key, value in chirp.items() if "Var_" in key)
            for n in inside:
                sent[n] += _numbers(chirp["txEnable"], number * DEVICE[0])
    cascade = len(devices) == 4
    lanes = 16 if cascade else len(_numbers(raw["rlDevLaneEnable_t"]["laneEn"]))
    output = rf["rlAdcOutCfg_t"]["fmt"]
    waveform = rf.get("waveformType", "legacyFrameChirp")
    apart = int(layout["chInterleave"])
    wrong = {
        f"has {len(devices)} radars; expected 1, or the 4 of a cascade": len(devices) not in (1, 4),
        f"has the waveform {waveform!r}; expected legacyFrameChirp": waveform != "legacyFrameChirp",
        "has samples of other than 16 bits; expected b2AdcBits 2": output["b2AdcBits"] != 2,
        "stores more than samples; expected transferFmtPkt0 0x1": (
            int(raw["rlDevDataPathCfg_t"]["transferFmtPkt0"], 16) != 1
        ),
        f"has {lanes} lanes and chInterleave {apart}; expected 2 and 1, or 4 and 0": (
            not cascade and (lanes, apart) not in ((2, 1), (4, 0))
        ),
        "changes the profile between chirps; expected one profile for all": changed,
        "has chirps of no or several transmitters; expected one at a time": (
            not sent or any(len(numbers) != 1 for numbers in sent.values())
        ),
    }
    fields = {
        "start_hz": profile["startFreqConst_GHz"] * 1e9,
        "adc_start_s": profile["adcStartTimeConst_usec"] * 1e-6,
        "slope_hz_s": profile["freqSlopeConst_MHz_usec"] * 1e12,
        "samples": profile["numAdcSamples"],
        "rate_hz": profile["digOutSampleRate"] * 1e3,
        "receivers": tuple(receivers),
        "transmitters": tuple(number for numbers in sent.values() for number in numbers),
        "loops": frame["numLoops"],
        "real": output["b2AdcOutFmt"] in (0, 3),
        "order": "QI" if layout["iqSwapSel"] else "IQ",
        "lanes": lanes,
    }
    if cascade:
        fields["board"] = "MMWCAS-RF-EVM"
    return fields, [text for text, found in wrong.items() if found]


def _numbers(mask: str, before: int = 0) -> list[int]:
    """Return the numbers, from 1 after those before, of the bits in a mask as "0xF"."""
    return [before + bit + 1 for bit in range(16) if int(mask, 16) >> bit & 1]
