"""Raw captures of TI's radars, simulated and written number by number as SWRA581B lists them: the
echoes of points, with noise, gains of the channels and a right or a wrong chirp profile."""

from __future__ import annotations

import json
import math
import struct
from dataclasses import dataclass
from pathlib import Path

import numpy as np

C = 299_792_458.0
MISTAKES = ("lanes", "order", "samples", "receivers", "number", "blocks", "exchanged", "loops")


def stream(samples, receivers, lanes=2, order="IQ", real=False):
    """Return what a DCA1000 writes of samples [frame, loop, chirp, receiver 0 to 3, sample]: one
    16-bit number after the other."""
    out = []
    for chirp in samples.reshape(-1, *samples.shape[-2:]):
        i_of, q_of = chirp.real.astype(int).tolist(), chirp.imag.astype(int).tolist()
        if lanes == 4:
            for n in range(samples.shape[-1]):
                i = [i_of[rx][n] if rx in receivers else 0 for rx in range(4)]
                q = [q_of[rx][n] if rx in receivers else 0 for rx in range(4)]
                out += i if real else i + q if order == "IQ" else q + i
        else:
            for rx in receivers:
                for n in range(0, samples.shape[-1], 2):
                    i, q = i_of[rx][n : n + 2], q_of[rx][n : n + 2]
                    out += i if real else i + q if order == "IQ" else q + i
    return struct.pack(f"<{len(out)}h", *out)


@dataclass
class Capture:
    """A simulated capture: the profile that made it, its numbers, and the antennas' places."""

    profile: dict
    content: bytes
    tx_m: np.ndarray
    rx_m: np.ndarray

    def write(self, folder: Path, profile: dict, places: bool) -> None:
        folder.mkdir()
        (folder / "profile.json").write_text(json.dumps(profile))
        (folder / "adc_data.bin").write_bytes(self.content)
        for name, table in (("tx_m", self.tx_m), ("rx_m", self.rx_m)) if places else ():
            rows = "".join(f"{x},{y},{z}\n" for x, y, z in table)
            (folder / f"{name}.csv").write_text("x_m,y_m,z_m\n" + rows)


def draw_capture(rng: np.random.Generator, changes: bool, least: int = 1) -> Capture:
    """Draw a radar, its profile and a scene of one to six points with 10 to 40 dB over the noise of
    a sample. changes: the scene does, from frame to frame; every other one moves at up to 0.5 m/s
    during a frame, too. least: transmitters and receivers."""
    n = int(rng.choice([64, 100, 128, 200, 256]))
    receivers = sorted(rng.choice(4, rng.integers(least, 5), replace=False).tolist())
    sent = sorted(rng.choice(3, rng.integers(least, 4), replace=False).tolist())
    loops = int(rng.choice([6, 8, 12, 16]))
    frames = int(rng.choice([2, 3, 4])) if changes else int(rng.choice([1, 2, 4]))
    blocks = bool(rng.random() < 0.25)
    pattern = np.repeat(sent, loops).tolist() if blocks else sent
    rate = rng.uniform(2e6, 6e6)
    slope = rng.uniform(1e9, 4e9) * rate / n
    start = float(rng.choice([60e9, 77e9]))
    half_m = C / 2 / (start + slope * n / 2 / rate)
    tx_m = half_m * np.array([[0, -1, 0], [2, 0, 0], [4, -1, 0]], float)
    rx_m = half_m * np.array([[0, 0, 0], [1, 0, 0], [2, 0, 0], [3, 0, 0]], float)
    bins = rng.uniform(3, 0.4 * n, rng.integers(1, 7))
    range_m = bins * C * rate / (2 * slope * n)
    az, el = rng.uniform(-0.9, 0.9, len(bins)), rng.uniform(-0.5, 0.5, len(bins))
    way = np.stack([np.sin(az) * np.cos(el), np.sin(el), np.cos(az) * np.cos(el)], axis=1)
    level = rng.lognormal(0, 0.5, len(bins))
    gain = [
        rng.normal(1, 0.05, k) * np.exp(1j * rng.normal(0, 0.15, k)) for k in (len(tx_m), len(rx_m))
    ]
    f = start + slope * (6e-6 + np.arange(n) / rate)
    echoes = np.zeros((frames, loops * len(sent), 4, n), complex)
    order = sent * loops if not blocks else pattern
    speed_m_s = rng.uniform(-0.5, 0.5, way.shape) * (changes and rng.random() < 0.5)
    for frame in range(frames):
        start_m = range_m[:, None] * way
        if changes:
            start_m = start_m + rng.uniform(-3, 3, way.shape) * half_m
        for chirp, tx in enumerate(order):
            points_m = start_m + speed_m_s * 80e-6 * chirp
            there_m = np.linalg.norm(points_m - tx_m[tx], axis=1)
            path_m = there_m[:, None] + np.linalg.norm(points_m[:, None] - rx_m, axis=2)
            if chirp == 0 or speed_m_s.any() or tx not in order[:chirp]:
                beat = np.exp(2j * np.pi * f * path_m[..., None] / C)
                of_rx = np.tensordot(level, beat, axes=1)
                echoes[frame, chirp] = of_rx * (gain[0][tx] * gain[1])[:, None]
            else:
                echoes[frame, chirp] = echoes[frame, order.index(tx)]
    size = math.sqrt((np.abs(echoes) ** 2).mean())
    noise = size * 10 ** (-rng.uniform(10, 40) / 20) / math.sqrt(2)
    echoes += noise * (rng.standard_normal((*echoes.shape, 2)) @ [1, 1j])
    echoes = np.rint(echoes * 2000 / size).reshape(frames, -1, len(pattern), 4, n)
    lanes, iq = int(rng.choice([2, 4])), str(rng.choice(["IQ", "QI"]))
    profile = {
        "start_hz": start,
        "slope_hz_s": float(slope),
        "adc_start_s": 6e-6,
        "rate_hz": float(rate),
        "samples": n,
        "receivers": [k + 1 for k in receivers],
        "transmitters": [k + 1 for k in pattern],
        "loops": 1 if blocks else loops,
        "lanes": lanes,
        "order": iq,
    }
    return Capture(profile, stream(echoes, receivers, lanes, iq), tx_m, rx_m)


def draw_mistaken(rng: np.random.Generator, mistake: str) -> tuple[Capture, dict]:
    """Draw a capture, and a profile with a mistake of a kind of MISTAKES with which its size still
    is whole frames."""
    while True:
        changes = mistake == "loops" or bool(rng.random() < 0.4 and mistake != "exchanged")
        capture = draw_capture(rng, changes, 2 if mistake in ("blocks", "exchanged") else 1)
        right = capture.profile
        if mistake == "exchanged" and not _shows_order(right):
            continue
        wrong = right | _mistaken(rng, right, mistake)
        if wrong != right and len(capture.content) % frame_bytes(wrong) == 0:
            return capture, wrong


def frame_bytes(profile: dict) -> int:
    """Count the bytes of a frame of complex samples."""
    stored = 4 if profile["lanes"] == 4 else len(profile["receivers"])
    return 4 * profile["samples"] * stored * len(profile["transmitters"]) * profile["loops"]


def _shows_order(profile: dict) -> bool:
    """True if no elevation of a target explains exchanged transmitters: the second, which is above
    the others, is not one of two."""
    three = len(profile["receivers"]) >= 3
    return three and {1, 3} <= set(profile["transmitters"])


def _mistaken(rng, right, mistake):
    sent, loops = right["transmitters"], right["loops"]
    kinds = list(dict.fromkeys(sent))
    if mistake == "lanes":
        return {"lanes": 6 - right["lanes"]}
    if mistake == "order":
        return {"order": right["order"][::-1]}
    if mistake == "samples":
        return {"samples": 2 * int(right["samples"] * rng.choice([0.125, 0.25, 1, 2]))}
    if mistake == "receivers":
        some = sorted(rng.choice(4, rng.integers(1, 5), replace=False).tolist())
        same = right["lanes"] == 2 and len(some) == len(right["receivers"])
        return {} if same else {"receivers": [k + 1 for k in some]}
    if mistake == "number":
        number = int(rng.choice([k for k in (1, 2, 3) if k != len(kinds)]))
        if len(sent) > len(kinds) or loops * len(kinds) % number:
            return {}
        kept = bool(rng.random() < 0.5)
        loops = loops if kept else loops * len(kinds) // number
        return {"transmitters": list(range(1, number + 1)), "loops": loops}
    if mistake == "blocks":
        if len(sent) > len(kinds):
            return {"transmitters": kinds, "loops": len(sent) // len(kinds)}
        return {"transmitters": np.repeat(sent, loops).tolist(), "loops": 1}
    if mistake == "exchanged":
        other = rng.permutation(kinds).tolist()
        return {"transmitters": [other[kinds.index(k)] for k in sent]}
    assert mistake == "loops"
    if len(sent) > len(kinds):
        return {}
    other = int(rng.choice([2, 3, 4])) * loops // int(rng.choice([1, 2, 3]))
    return {} if loops % other == 0 else {"loops": other}


def undone(change: dict, wrong: dict, right: dict, mistake: str) -> bool:
    """True if a change of a wrong profile puts every number into its right place. The transmitters
    may have other names unless these are the mistake, and so the loops."""
    found = {name: _lists(value) for name, value in (wrong | change).items()}
    compared = {"exchanged": "transmitters", "loops": "loops"}.get(mistake, "lanes")
    return _place(found) == _place(right) and found[compared] == right[compared]


def _lists(value):
    return list(value) if isinstance(value, tuple) else value


def _place(profile: dict) -> tuple:
    """What decides about a number's place in the samples [loop, chirp, receiver, sample]."""
    kinds = list(dict.fromkeys(profile["transmitters"]))
    chirps = [kinds.index(number) for number in profile["transmitters"]]
    if len(chirps) > len(kinds):
        chirps.append(profile["loops"])
    receivers = profile["receivers"] if profile["lanes"] == 4 else len(profile["receivers"])
    return profile["lanes"], profile["order"], profile["samples"], receivers, chirps
