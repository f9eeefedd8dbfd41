"""Import of raw captures of TI's millimetre-wave radars, recorded by a DCA1000 board: samples in
adc_data.bin, and the chirp profile in the .cfg that the mmWave SDK sends.

Sources: TI SWRA581B, "Mmwave radar device ADC raw data capture" (lanes, order of I and Q); mmWave
SDK 3.6 user's guide and mmw_cli.c (.cfg); gAntDef_* and gAntennaSpacing of antenna_geometry.c in
TI's SDK and radar toolbox (ti_boards.csv); antPhaseRot of TI's people tracking (its signs).
"""

from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, Any, Literal, Self

import numpy as np
from pydantic import Field, model_validator

from handbench.bench.datasets.native import save_echoes_folder
from handbench.radar.data.arrays import SPEED_OF_LIGHT_M_S, load_positions
from handbench.radar.data.capture import to_capture
from handbench.support.config import Config, Tone, parse
from handbench.support.cost import require_memory
from handbench.support.errors import HandbenchError
from handbench.support.files import CSV_BYTES, KEPT_BYTES, read_bytes, read_text, require_folder
from handbench.support.progress import warn

WHAT = "adc_data.bin and a .cfg, the chirp profile"
# Antennas of the boards by number, from the middle between the mean transmitter and the mean
# receiver, in handbench's frame. TI's x points right and z up, and its angles take the beat's
# phase, which grows with the path, to rise with the index towards +x and +z: so TI's indices count
# to the left and down. AWR1843BOOST has no unit: TI takes half a wavelength of the chirp. sign: -1
# for a receiver that is fed from the other side.
BOARDS = Path(__file__).with_name("ti_boards.csv")
# the numbers that a command of a .cfg has at least; six commands that are read once come first
COMMANDS = {
    "dfeDataOutputMode": 1,
    "lvdsStreamCfg": 4,
    "adcbufCfg": 4,
    "channelCfg": 1,
    "adcCfg": 2,
    "frameCfg": 4,
    "profileCfg": 11,
    "chirpCfg": 8,
}
# of commands that may be left out
USUAL = ("adcbufCfg -1 0 0 1 1", "lvdsStreamCfg -1 0 1 0", "dfeDataOutputMode 1")
CHIRPS = 512  # that a frame may have
Antenna = Annotated[int, Field(ge=1, le=4)]


class ChirpProfile(Config):
    """How a radar chirped, and how its samples are stored.

    receivers: numbers, from 1, of the receivers that were on. transmitters: number of the
    transmitter of each chirp in a loop. loops: number of loops in a frame. frames: how many were to
    be recorded; 0: any number. real: True if samples are real, not complex. lanes: of the data
    link, 2 (xWR16xx, 18xx, 68xx: the receivers one after another) or 4 (xWR12xx, 14xx: a lane for
    each receiver). order: which part of complex samples is first. sweeps: average repeated chirps
    ("mean"), or make each a frame. board: gives the antennas' positions, unless there are tx_m.csv
    and rx_m.csv.
    """

    start_hz: Tone
    slope_hz_s: float = Field(gt=0, le=1e15)
    adc_start_s: float = Field(ge=0, le=1e-2)
    rate_hz: float = Field(ge=1e3, le=1e9)
    samples: int = Field(ge=2, le=65536)
    receivers: tuple[Antenna, ...] = Field(min_length=1, max_length=4)
    transmitters: tuple[Antenna, ...] = Field(min_length=1, max_length=CHIRPS)
    loops: int = Field(ge=1, le=65536)
    frames: int = Field(default=0, ge=0)
    real: bool = False
    lanes: Literal[2, 4] = 2
    order: Literal["IQ", "QI"] = "IQ"
    sweeps: Literal["mean", "frames"] = "mean"
    board: Literal["IWR6843ISK", "IWR6843AOP", "AWR1843BOOST"] | None = None

    @model_validator(mode="after")
    def _even_turns(self) -> Self:
        if len(set(map(self.transmitters.count, self.transmitters))) > 1:
            raise ValueError(
                f"the transmitters of a loop's chirps are {self.transmitters}; expected the same "
                "number of chirps for each"
            )
        return self

    def tones_hz(self) -> np.ndarray:
        """Compute the chirp's frequency [samples] at the time of each sample, Hz."""
        time_s = self.adc_start_s + np.arange(self.samples) / self.rate_hz
        return self.start_hz + self.slope_hz_s * time_s


def import_ti_raw(source: Path, folder: Path, /, **settings: Any) -> None:
    """Convert the raw files of a TI radar to a capture folder.

    They are the folder's .bin files, in the order of the numbers in their names. settings: fields
    of `ChirpProfile` that replace those in the folder's .cfg. Raises HandbenchError if the files do
    not agree with the profile.
    """
    from handbench.radar.methods.ability import measured_settings

    source = require_folder(source, WHAT)
    profile, beat = read_raw(source, settings)
    warn(source, raw_warnings(profile, beat))
    if profile.real:
        from scipy.signal import hilbert  # half a second

        beat = hilbert(beat, axis=-1)  # of a real mixer's two signs, that of complex sampling
    transmitters = np.unique(profile.transmitters)
    # The phase of I + jQ grows with the path, by 2πfτ at the chirp's frequency f (SPYY005, "The
    # fundamentals of millimeter wave radar sensors": 4πd/λ; echoes of boards have positive beat
    # frequencies): conjugated, it is exp(−j2πf·path/c) but for πSτ², 0.01 rad at 1 m.
    order = np.argsort(profile.transmitters, kind="stable").reshape(len(transmitters), -1)
    samples = beat[:, :, order].conj().transpose(0, 1, 3, 5, 2, 4)
    samples = samples.reshape(len(samples), -1, *samples.shape[3:])  # [frame, sweep, f, tx, rx]
    places_m, gains = antennas(source, profile, transmitters)
    tones_hz = profile.tones_hz()
    capture = to_capture(samples, tones_hz, places_m, None, gains, profile.sweeps)
    facts = {"kind": "other", "source": "TI raw capture", "methods": measured_settings(tones_hz)}
    save_echoes_folder(folder, capture, facts | {"unknown": ("range_offset",)})


def is_ti_raw(folder: Path) -> bool:
    """True for a folder with samples in .bin files and a chirp profile, or with the file of samples
    that a DCA1000 makes."""
    profiled = any(folder.glob("*.bin")) and any(folder.glob("*.cfg"))
    return profiled or any(folder.glob("adc_data*.bin"))


def read_raw(source: Path, settings: dict[str, Any]) -> tuple[ChirpProfile, np.ndarray]:
    """Read the chirp profile and the samples [frame, loop, chirp of the loop, receiver, sample] of
    a raw capture's folder.

    settings: fields of the profile that replace the file's. Raises HandbenchError if the files do
    not agree with the profile.
    """
    profiles = sorted(source.glob("*.cfg"))
    if len(profiles) != 1:
        names = ", ".join(path.name for path in profiles) or "no .cfg file"
        raise HandbenchError(
            f"{source}: has {names}; expected one, the chirp profile that was sent to the radar"
        )
    profile = parse(ChirpProfile, _read_cfg(profiles[0]) | settings, str(profiles[0]))
    samples = _decode(_read_content(source), profile, source)
    return profile, samples


def raw_warnings(profile: ChirpProfile, samples: np.ndarray) -> Iterator[str]:
    """Yield a warning if the samples [frame, …] are not those of as many frames as the profile asks
    for."""
    if profile.frames not in (0, len(samples)):
        yield (
            f"has {len(samples)} frames, but its .cfg asks for {profile.frames}; check that the "
            "recording is complete"
        )


def _read_content(source: Path) -> bytes:
    """Read the .bin files in a folder, in the order of the numbers in their names. Raises
    HandbenchError if the DCA1000's own files are beside the one that is made of them."""
    paths = sorted(source.glob("*.bin"), key=lambda path: (len(path.name), path.name))
    raw = [path.name for path in paths if "_Raw_" in path.name]
    if 0 < len(raw) < len(paths):
        other = next(path.name for path in paths if path.name not in raw)
        raise HandbenchError(
            f"{source}: {other} and {raw[0]} are most likely the same recording; keep one of them"
        )
    size = sum(path.stat().st_size for path in paths)
    require_memory(20.0 * size, f"{source}: {size} bytes of samples", "import fewer files")
    return b"".join(read_bytes(path, "samples of a radar", KEPT_BYTES) for path in paths)


def _decode(content: bytes, profile: ChirpProfile, source: Path) -> np.ndarray:
    """Arrange what was recorded, numbers of two bytes, as samples [frame, loop, chirp of the loop,
    receiver, sample].

    The result is complex64, or float32 if the profile's samples are real. Raises HandbenchError
    unless the numbers fill whole frames; source: their folder, for its message.
    """
    n, parts, lanes = profile.samples, 1 if profile.real else 2, profile.lanes
    stored = 4 if lanes == 4 else len(profile.receivers)  # an unused one of four lanes has zeros
    chirps = profile.loops * len(profile.transmitters)
    frame = 2 * chirps * stored * n * parts
    if not content or len(content) % frame or stored * n % 2:
        raise HandbenchError(
            f"{source}: has {len(content)} bytes, which is not a whole number of frames of {frame} "
            f"bytes ({chirps} chirps × {stored} receivers × {n} samples × {2 * parts} bytes, with "
            "an even number of samples); check that the profile belongs to this recording"
        )
    # 4 lanes: I of all receivers at one time, then their Q; 2 lanes: I of two times, then their Q
    numbers = np.frombuffer(content, "<i2").reshape(-1, parts, lanes)
    by_part = numbers.swapaxes(0, 1).astype(np.float32)
    values = by_part[0]
    if not profile.real:
        values = np.empty(values.shape, np.complex64)
        values.real, values.imag = by_part if profile.order == "IQ" else by_part[::-1]
    shape = (-1, profile.loops, len(profile.transmitters))
    if lanes == 2:
        return values.reshape(*shape, stored, n)
    receivers = np.array(profile.receivers) - 1
    return values.reshape(*shape, n, 4).swapaxes(-1, -2)[..., receivers, :]


def antennas(
    source: Path, profile: ChirpProfile, transmitters: np.ndarray
) -> tuple[dict[str, np.ndarray], np.ndarray | None]:
    """Return the positions [n, 3] in metres of the antennas that were on, under the keys "tx_m" and
    "rx_m", and their gains [tx, rx] (None: all 1).

    transmitters: numbers of the transmitters that were on. Positions are from tx_m.csv and
    rx_m.csv, which list all antennas by number, or else from the profile's board. Raises
    HandbenchError if neither gives them.
    """
    used = {"tx_m": transmitters - 1, "rx_m": np.array(profile.receivers) - 1}
    gains = None
    if any((source / f"{name}.csv").exists() for name in used):
        tables = {name: load_positions(source / f"{name}.csv") for name in used}
    elif profile.board is not None:
        import pandas as pd  # half a second

        board = pd.read_csv(BOARDS).query("board == @profile.board")
        half_wave_m = SPEED_OF_LIGHT_M_S / profile.tones_hz()[[0, -1]].sum()
        places_m = board[["x", "y", "z"]].mul(board["unit_m"].fillna(half_wave_m), axis=0)
        sides = {name: board["antenna"] == name[:2] for name in used}
        tables = {name: places_m[side].to_numpy() for name, side in sides.items()}
        signs = board["sign"][sides["rx_m"]].to_numpy()[used["rx_m"]]
        gains = np.tile(signs, (len(transmitters), 1))
    else:
        raise HandbenchError(
            f"{source}: nothing gives the positions of the antennas; add tx_m.csv and rx_m.csv "
            "(x_m,y_m,z_m), or --set board=IWR6843ISK"
        )
    for name, index in used.items():
        if index.max() >= len(tables[name]):
            raise HandbenchError(
                f"{source}: the profile uses antenna {index.max() + 1}, but {name} has only "
                f"{len(tables[name])} positions; add the others"
            )
    return {name: tables[name][index] for name, index in used.items()}, gains


def _read_cfg(path: Path) -> dict[str, Any]:
    """Convert a .cfg file, with commands of TI's mmWave SDK, to the fields of a `ChirpProfile`.
    Raises HandbenchError for a mode of the radar that handbench cannot read."""
    lines: dict[str, list[list[float]]] = {}
    try:
        for line in (*USUAL, *read_text(path, WHAT, CSV_BYTES).split("\n")):
            name, *words = line.split("%")[0].split() or [""]
            if len(words) < (least := COMMANDS.get(name, 0)):
                raise ValueError(f"'{line}' has {len(words)} numbers; expected {least}")
            if name in COMMANDS:
                lines.setdefault(name, []).append([*map(float, words)])
        return _fields(lines)
    except (ValueError, OverflowError) as error:
        raise HandbenchError(
            f"{path}: is not a chirp profile that handbench reads ({error}); expected the commands "
            "as they were sent to the radar"
        ) from None


def _fields(lines: dict[str, list[list[float]]]) -> dict[str, Any]:
    """Return the fields of a `ChirpProfile`. lines: command → the numbers of each of its lines.
    Raises ValueError for a mode that handbench cannot read."""
    if missing := [name for name in COMMANDS if name not in lines]:
        raise ValueError(f"it has no {missing[0]}")
    mode, stream, buffer, receivers, adc, frame = (lines[name][-1] for name in [*COMMANDS][:6])
    first, final = map(int, frame[:2])
    chirps = [
        chirp
        for number in range(first, final + 1)[:CHIRPS]
        for chirp in lines["chirpCfg"]
        if chirp[0] <= number <= chirp[1]
    ]
    senders = [_antennas_of(chirp[7]) for chirp in chirps]
    used = {chirp[2] for chirp in chirps}
    profiles = [profile for profile in lines["profileCfg"] if {profile[0]} == used]
    if mode[0] != 1 or stream[1:4] not in ([0, 0, 0], [0, 1, 0]):
        raise ValueError("it needs dfeDataOutputMode 1 and lvdsStreamCfg -1 0 1 0, without headers")
    if len(chirps) != final - first + 1 or {len(antennas) for antennas in senders} != {1}:
        raise ValueError(
            f"each chirp of frameCfg, at most {CHIRPS}, needs one chirpCfg with one transmitter"
        )
    if not profiles or any(any(chirp[3:7]) for chirp in chirps):
        raise ValueError("all chirps of frameCfg need the same profileCfg, and no changes of it")
    profile = profiles[-1]
    # SDK 3 has the number of a subframe first, SDK 2 does not; 1: Q is first, 1: not interleaved
    swap, apart = buffer[-3:-1]
    return {
        "start_hz": profile[1] * 1e9,
        "adc_start_s": profile[3] * 1e-6,
        "slope_hz_s": profile[7] * 1e12,
        "samples": profile[9],
        "rate_hz": profile[10] * 1e3,
        "receivers": _antennas_of(receivers[0]),
        "transmitters": tuple(antenna for [antenna] in senders),
        "loops": frame[2],
        "frames": frame[3],
        "real": adc[1] == 0,
        "order": "QI" if swap else "IQ",
        "lanes": 2 if apart else 4,
    }


def _antennas_of(mask: float) -> tuple[int, ...]:
    """Return the numbers, from 1, of the antennas whose bits are set in a bit mask."""
    return tuple(bit + 1 for bit in range(16) if int(mask) >> bit & 1)
