"""Chirp profiles of TI's millimetre-wave radars: the .cfg that the mmWave SDK sends, a .json of the
same numbers, or mmWave Studio's .mmwave.json.

Sources: mmWave SDK 3.6 user's guide and mmw_cli.c (.cfg).
"""

from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any, Literal, Self

import numpy as np
from pydantic import Field, model_validator

from handbench.bench.datasets.ti_studio import read_studio
from handbench.support.config import Config, Tone, parse
from handbench.support.errors import HandbenchError
from handbench.support.files import read_json, read_text
from handbench.support.limits import CSV_BYTES

WHAT = "adc_data.bin and a .cfg or .json, the chirp profile"
NEEDED = {"channelCfg": 1, "adcCfg": 2, "profileCfg": 11, "chirpCfg": 8, "frameCfg": 3}
COMMANDS = NEEDED | {"adcbufCfg": 4, "lvdsStreamCfg": 4, "dfeDataOutputMode": 1}
CHIRPS = 512  # that a frame may have
Antenna = Annotated[int, Field(ge=1, le=16)]


class ChirpProfile(Config):
    """How a radar chirped, and how its samples are stored.

    receivers: numbers, from 1, of the receivers that were on. transmitters: number of the
    transmitter of each chirp in a loop. loops: number of loops in a frame. real: True if samples
    are real, not complex. lanes: of the data link, 2 (xWR16xx, 18xx, 68xx: the receivers one after
    another), 4 (xWR12xx, 14xx: a lane for each receiver) or 16 (a cascade of four radars: a file
    each). order: which part of complex samples is first. sweeps: average repeated chirps ("mean"),
    or make each a frame. board: gives the antennas' positions, unless there are tx_m.csv and
    rx_m.csv.
    """

    start_hz: Tone
    slope_hz_s: float = Field(gt=0, le=1e15)
    adc_start_s: float = Field(ge=0, le=1e-2)
    rate_hz: float = Field(ge=1e3, le=1e9)
    samples: int = Field(ge=2, le=65536)
    receivers: tuple[Antenna, ...] = Field(min_length=1, max_length=16)
    transmitters: tuple[Antenna, ...] = Field(min_length=1, max_length=CHIRPS)
    loops: int = Field(ge=1, le=65536)
    real: bool = False
    lanes: Literal[2, 4, 16] = 2
    order: Literal["IQ", "QI"] = "IQ"
    sweeps: Literal["mean", "frames"] = "mean"
    board: Literal["IWR6843ISK", "IWR6843AOP", "AWR1843BOOST", "MMWCAS-RF-EVM"] | None = None

    @model_validator(mode="after")
    def _consistent(self) -> Self:
        most = max(self.lanes, 4)
        if max(self.receivers) > most or len(set(self.receivers)) < len(self.receivers):
            raise ValueError(f"receivers: {self.receivers}; expected different ones up to {most}")
        transmitters, chirps = np.unique(self.transmitters, return_counts=True)
        if len(set(chirps)) > 1:
            raise ValueError(
                f"the transmitters {transmitters.tolist()} have {chirps.tolist()} chirps in a "
                "loop; expected the same number for each"
            )
        return self

    def tones_hz(self) -> np.ndarray:
        """Compute the chirp's frequency [samples] at the time of each sample, Hz."""
        time_s = self.adc_start_s + np.arange(self.samples) / self.rate_hz
        return self.start_hz + self.slope_hz_s * time_s


def is_ti_raw(folder: Path) -> bool:
    """True for a folder with samples in .bin files and a chirp profile."""
    return any(folder.glob("*.bin")) and bool(_profiles(folder))


def _profiles(folder: Path) -> list[Path]:
    """Find the chirp profiles in a folder; mmWave Studio's .setup.json is none."""
    found = [*folder.glob("*.cfg"), *folder.glob("*.json")]
    return sorted(path for path in found if not path.name.endswith(".setup.json"))


def read_profile(source: Path, settings: Mapping[str, Any]) -> ChirpProfile:
    """Read the profile in a folder. settings: fields in place of the
    file's. Raises HandbenchError if there is not exactly one .cfg or .json, or an invalid one."""
    found = _profiles(source)
    if len(found) != 1:
        names = ", ".join(path.name for path in found) or "none"
        raise HandbenchError(
            f"{source}: has {names}; expected exactly one .cfg or .json file, the chirp profile"
        )
    given = _read_cfg(found[0]) if found[0].suffix == ".cfg" else read_json(found[0], WHAT)
    if not isinstance(given, dict):
        raise HandbenchError(f"{found[0]}: is not a table; expected the keys of a chirp profile")
    if "mmWaveDevices" in given:
        given = read_studio(found[0], given, CHIRPS)
    return parse(ChirpProfile, given | dict(settings), str(found[0]))


def _read_cfg(path: Path) -> dict[str, Any]:
    """Convert a .cfg file, with commands of TI's mmWave SDK, to the fields of a `ChirpProfile`.
    Raises HandbenchError with the line for a mode of the radar that handbench cannot read."""
    last: dict[str, list[float]] = {}
    profiles: dict[float, list[float]] = {}
    chirps: dict[int, tuple[float, int]] = {}  # number → its profile and transmitter
    try:
        text = read_text(path, "a .cfg of the mmWave SDK", CSV_BYTES)
    except ValueError as error:
        raise HandbenchError(f"{path}: is not text ({error}); copy it again") from None
    for number, line in enumerate(text.split("\n"), 1):
        name, *words = line.split("%")[0].split() or [""]
        if name not in COMMANDS:
            continue
        try:
            last[name] = values = [float(word) for word in words]
        except ValueError:
            values = []
        expected = None
        if len(values) < COMMANDS[name] or not np.isfinite(values).all():
            expected = f"{COMMANDS[name]} numbers"
        elif name == "dfeDataOutputMode" and values[0] != 1:
            expected = "1: frames"
        elif name == "lvdsStreamCfg" and (values[1] or values[2] not in (0, 1) or values[3]):
            expected = "-1 0 1 0: samples without headers"
        elif name == "profileCfg":
            profiles[values[0]] = values
        elif name == "chirpCfg":
            start, stop, sent = int(values[0]), int(values[1]), _antennas_of(values[7])
            if not 0 <= start <= stop < CHIRPS or any(values[3:7]) or len(sent) != 1:
                expected = (
                    f"chirp numbers below {CHIRPS}, no changes of the profile, one transmitter"
                )
            else:
                chirps |= dict.fromkeys(range(start, stop + 1), (values[2], sent[0]))
        if expected:
            shown = " ".join(words)[:60]
            raise HandbenchError(f"{path}: line {number}: {name} is '{shown}'; expected {expected}")
    if missing := [name for name in NEEDED if name not in last]:
        raise HandbenchError(
            f"{path}: has no {', '.join(missing)}; add these commands as they were sent to the "
            "radar"
        )
    first, final, loops = (int(value) for value in last["frameCfg"][:3])
    numbers = range(first, final + 1)[: CHIRPS + 1]
    known = {chirps[number][0] for number in numbers if number in chirps}
    if not set(numbers) <= chirps.keys() or len(known) != 1 or known - set(profiles):
        raise HandbenchError(
            f"{path}: frameCfg sends the chirps {first} to {final}; expected a chirpCfg for each "
            "of them, and the same profileCfg for all"
        )
    profile = profiles[known.pop()]
    # SDK 3 has the number of a subframe first, SDK 2 does not; 1: Q is first, 1: not interleaved
    swap, apart = last.get("adcbufCfg", [0.0, 1.0, 1.0])[-3:-1]
    return {
        "start_hz": profile[1] * 1e9,
        "adc_start_s": profile[3] * 1e-6,
        "slope_hz_s": profile[7] * 1e12,
        "samples": int(profile[9]),
        "rate_hz": profile[10] * 1e3,
        "receivers": _antennas_of(last["channelCfg"][0]),
        "transmitters": tuple(chirps[number][1] for number in numbers),
        "loops": loops,
        "real": last["adcCfg"][1] == 0,
        "order": "QI" if swap else "IQ",
        "lanes": 2 if apart else 4,
    }


def _antennas_of(mask: float) -> tuple[int, ...]:
    """Return the numbers, from 1, of the antennas whose bits are set in a bit mask."""
    return tuple(bit + 1 for bit in range(16) if int(mask) >> bit & 1)
