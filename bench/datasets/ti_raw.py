"""Import of raw captures of TI's millimetre-wave radars as capture folders. The samples were
recorded by a DCA1000 board (adc_data.bin); the chirp profile is in the radar's .cfg or in a .json.

Sources: TI SWRA581B, "Mmwave radar device ADC raw data capture" (lanes, order of I and Q); mmWave
SDK 3.6 user's guide and mmw_cli.c (.cfg); its antenna_geometry.c (boards).
"""

import re
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import Field
from scipy.signal import hilbert

from handbench.bench.datasets.native import ECHOES, CaptureFile, save_capture_file
from handbench.radar.data.arrays import SPEED_OF_LIGHT_M_S, load_positions
from handbench.radar.data.echoes_file import save_capture
from handbench.radar.data.recording import Recording
from handbench.support.caller import option
from handbench.support.config import Config, Tone, parse
from handbench.support.cost import require_free
from handbench.support.errors import HandbenchError
from handbench.support.files import atomic_folder, read_bytes, read_json, read_text, require_folder
from handbench.support.limits import CSV_BYTES, KEPT_BYTES

WHAT = "adc_data.bin and a .cfg or .json, the chirp profile"
# The antennas of boards in units of (to the left, down), transmitters and then receivers, and the
# unit in metres: gAntDef_* and gAntennaSpacing of antenna_geometry.c in TI's SDK and radar toolbox.
# TI's x points right and z up, and its angles take the beat's phase, which grows with the path, to
# rise with the index towards +x and +z: so indices count to the left and down (TX2 of the standard
# boards is the upper one). AWR1843BOOST has no unit there: TI takes half a wavelength of the chirp.
STANDARD = ((0, 1), (2, 0), (4, 1)), ((0, 0), (1, 0), (2, 0), (3, 0))
AOP = ((0, 0), (2, 2), (0, 2)), ((1, 1), (1, 0), (0, 1), (0, 0))
BOARDS: dict[str, Any] = {
    "IWR6843ISK": (*STANDARD, 2.5e-3),
    "IWR6843AOP": (*AOP, 2.5e-3),
    "AWR1843BOOST": (*STANDARD, None),
}
# receivers fed from the other side: antPhaseRot of TI's people tracking, with this geometry
SIGNS = {"IWR6843AOP": (-1, 1, -1, 1)}
NEEDED = {"channelCfg": 1, "adcCfg": 2, "profileCfg": 11, "chirpCfg": 8, "frameCfg": 3}
COMMANDS = NEEDED | {"adcbufCfg": 4, "lvdsStreamCfg": 4, "dfeDataOutputMode": 1}
CHIRPS = 512  # that a frame may have
Antenna = Annotated[int, Field(ge=1, le=16)]


class ChirpProfile(Config):
    """How a radar chirped, and how its samples are stored.

    receivers: numbers, from 1, of the receivers that were on. transmitters: number of the
    transmitter of each chirp in a loop. loops: number of loops in a frame. real: True if samples
    are real, not complex. lanes: of the data link, 2 (xWR16xx, 18xx, 68xx: the receivers one after
    another) or 4 (xWR12xx, 14xx: a lane for each receiver). order: which part of complex samples is
    first. sweeps: average repeated chirps ("mean"), or make each a frame. board: gives the
    antennas' positions, unless there are tx_m.csv and rx_m.csv.
    """

    start_hz: Tone
    slope_hz_s: float = Field(gt=0, le=1e15)
    adc_start_s: float = Field(ge=0, le=1e-2)
    rate_hz: float = Field(ge=1e3, le=1e9)
    samples: int = Field(ge=2, le=65536)
    receivers: tuple[Antenna, ...] = Field(min_length=1, max_length=4)
    transmitters: tuple[Antenna, ...] = Field(min_length=1, max_length=CHIRPS)
    loops: int = Field(ge=1, le=65536)
    real: bool = False
    lanes: Literal[2, 4] = 2
    order: Literal["IQ", "QI"] = "IQ"
    sweeps: Literal["mean", "frames"] = "mean"
    board: Literal["IWR6843ISK", "IWR6843AOP", "AWR1843BOOST"] | None = None

    def tones_hz(self) -> np.ndarray:
        """Compute the chirp's frequency [samples] at the time of each sample, Hz."""
        time_s = self.adc_start_s + np.arange(self.samples) / self.rate_hz
        return self.start_hz + self.slope_hz_s * time_s


def import_ti_raw(
    source: str | Path, folder: str | Path, settings: Mapping[str, Any] | None = None
) -> None:
    """Convert the .bin files in a folder, in the order of the numbers in their names, to a capture
    folder.

    settings: fields of `ChirpProfile` that replace those in the folder's .cfg or .json. Raises
    HandbenchError if the files do not agree with the profile.
    """
    source = require_folder(source, WHAT)
    found = sorted([*source.glob("*.cfg"), *source.glob("*.json")])
    if len(found) != 1:
        names = ", ".join(path.name for path in found) or "none"
        raise HandbenchError(
            f"{source}: has {names}; expected exactly one .cfg or .json file, the chirp profile"
        )
    given = _read_cfg(found[0]) if found[0].suffix == ".cfg" else read_json(found[0], WHAT)
    if not isinstance(given, dict):
        raise HandbenchError(f"{found[0]}: is not a table; expected the keys of a chirp profile")
    profile = parse(ChirpProfile, given | dict(settings or {}), str(found[0]))
    beat = decode(_read_numbers(source), profile, str(source))
    if profile.real:
        beat = hilbert(beat, axis=-1)  # of a real mixer's two signs, that of complex sampling
    transmitters, chirps = np.unique(profile.transmitters, return_counts=True)
    if len(set(chirps)) > 1:
        raise HandbenchError(
            f"{found[0]}: the transmitters {transmitters.tolist()} have {chirps.tolist()} chirps "
            "in a loop; expected the same number for each"
        )
    # The phase of I + jQ grows with the path, by 2πfτ at the chirp's frequency f (SPYY005, "The
    # fundamentals of millimeter wave radar sensors": 4πd/λ; echoes of boards have positive beat
    # frequencies): conjugated, it is exp(−j2πf·path/c) but for πSτ², 0.01 rad at 1 m.
    order = np.argsort(profile.transmitters, kind="stable").reshape(len(transmitters), -1)
    samples = beat[:, :, order].conj().transpose(0, 1, 3, 5, 2, 4)
    samples = samples.reshape(len(samples), -1, *samples.shape[3:])  # [frame, sweep, f, tx, rx]
    places_m, gains = _antennas(source, profile, transmitters)
    about = {"source": " ".join(filter(None, ("TI raw capture", profile.board)))}
    recording = Recording(samples, profile.tones_hz(), places_m, None, gains, profile.sweeps, about)
    facts = {"name": Path(folder).resolve().name, "kind": "other", "contains": (ECHOES,), **about}
    description = parse(CaptureFile, facts, str(folder))
    with atomic_folder(folder) as temporary:
        save_capture(temporary / ECHOES, recording.capture())
        save_capture_file(temporary, description)


def decode(numbers: np.ndarray, profile: ChirpProfile, where: str) -> np.ndarray:
    """Arrange the numbers that a DCA1000 recorded, int16 [n], as samples [frame, loop, chirp of the
    loop, receiver, sample].

    The result is complex64, or float32 if the profile's samples are real. Raises HandbenchError
    unless the numbers fill whole frames; where: beginning of its message.
    """
    parts, lanes, n = 1 if profile.real else 2, profile.lanes, profile.samples
    stored = 4 if lanes == 4 else len(profile.receivers)  # an unused lane has zeros
    chirps = profile.loops * len(profile.transmitters)
    frame = chirps * stored * n * parts
    if not len(numbers) or len(numbers) % frame or stored * n % 2:
        raise HandbenchError(
            f"{where}: has {2 * len(numbers)} bytes, which is not a whole number of frames of "
            f"{2 * frame} bytes ({chirps} chirps × {stored} receivers × {n} samples × {2 * parts} "
            "bytes, with an even number of samples); check that the profile belongs to this "
            "recording"
        )
    # 4 lanes: I of all receivers at one time, then their Q; 2 lanes: I of two times, then their Q
    sets = numbers.reshape(-1, parts, lanes).astype(np.float32)
    values = sets[:, 0]
    if not profile.real:
        values = np.empty(values.shape, np.complex64)
        values.real, values.imag = np.moveaxis(sets, 1, 0)[:: 1 if profile.order == "IQ" else -1]
    shape = (-1, profile.loops, len(profile.transmitters))
    if lanes == 2:
        return values.reshape(*shape, stored, n)
    return values.reshape(*shape, n, 4).swapaxes(-1, -2)[..., np.array(profile.receivers) - 1, :]


def _read_numbers(source: Path) -> np.ndarray:
    """Read all .bin files in a folder and join them, in the order of the numbers in their names, to
    one array int16 [n]."""
    parts = {path: re.findall(r"(\D*)(\d*)", path.name) for path in source.glob("*.bin")}
    paths = sorted(parts, key=lambda path: [(int(n or 0), text) for text, n in parts[path]])
    if not (size := sum(path.stat().st_size for path in paths)):
        raise HandbenchError(f"{source}: has no .bin file with samples; expected {WHAT}")
    require_free(20.0 * size, f"{source}: {size} bytes of samples", "import fewer files")
    content = b"".join(read_bytes(path, "samples of a DCA1000", KEPT_BYTES) for path in paths)
    return np.frombuffer(content[: len(content) // 2 * 2], "<i2")


def _antennas(
    source: Path, profile: ChirpProfile, transmitters: np.ndarray
) -> tuple[dict[str, np.ndarray], np.ndarray | None]:
    """Return the positions [n, 3] in metres of the antennas that were on, under the keys "tx_m" and
    "rx_m", and their gains [tx, rx] (None: all 1).

    transmitters: numbers of the transmitters that were on. Positions are from tx_m.csv and
    rx_m.csv, which list all antennas by number, or else from the profile's board. Raises
    HandbenchError if neither gives them.
    """
    used = {"tx_m": transmitters - 1, "rx_m": np.array(profile.receivers) - 1}
    signs: tuple[int, ...] | None = None
    if any((source / f"{name}.csv").exists() for name in used):
        tables = {name: load_positions(source / f"{name}.csv") for name in used}
    elif profile.board is not None:
        *both, unit_m = BOARDS[profile.board]
        unit_m = unit_m or SPEED_OF_LIGHT_M_S / profile.tones_hz()[[0, -1]].sum()
        tables = {
            name: unit_m * np.array([(left, -down, 0) for left, down in places])
            for name, places in zip(used, both, strict=True)
        }
        middle_m = sum(table.mean(axis=0) for table in tables.values()) / 2
        tables = {name: table - middle_m for name, table in tables.items()}
        signs = SIGNS.get(profile.board)
    else:
        raise HandbenchError(
            f"{source}: nothing gives the positions of the antennas; add tx_m.csv and rx_m.csv "
            f"(x_m,y_m,z_m), or {option('--set board=…', 'board')} with one of {', '.join(BOARDS)}"
        )
    for name, index in used.items():
        if index.max() >= (there := len(tables[name])):
            asked = f"the profile uses antenna {index.max() + 1}"
            raise HandbenchError(
                f"{source}: {asked}, but {name} has only {there} positions; add the others"
            )
    gains = np.tile(signs, (len(transmitters), 1))[:, used["rx_m"]] if signs else None
    return {name: tables[name][index] for name, index in used.items()}, gains


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
