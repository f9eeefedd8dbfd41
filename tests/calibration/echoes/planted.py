"""Captures of points by an instrument with planted errors, by a forward model of their own."""

from dataclasses import dataclass

import numpy as np

from handbench.radar.data.arrays import SPEED_OF_LIGHT_M_S, AntennaArray, BistaticScan, PlanarScan
from handbench.radar.data.capture import RadarCapture

ASKED = {  # instrument → what may be unknown of it
    "pair": (["range_offset"], ["scan_step"], ["range_offset", "scan_step"]),
    "antenna": (["range_offset"], ["scan_step"], ["range_offset", "scan_step"]),
    "rails": (["range_offset", "gains"], ["range_offset", "scan_step", "gains"]),
    "array": (["range_offset"], ["gains"]),
}


@dataclass(frozen=True)
class Planted:
    """A capture with its unknowns' true values: range offset in metres, factors of the scan's steps
    [2], a gain of each channel [n], and the points [k, 3] with their echoes [k]."""

    capture: RadarCapture
    unknown: list[str]
    offset_m: float
    steps: np.ndarray
    gains: np.ndarray
    points_m: np.ndarray
    echoes: np.ndarray


def instrument(kind):
    """(frequencies [f], aperture, positions of transmitter and receiver [n, 3] of each channel, how
    far they are moved [n, 3], which transmitter and receiver each is [n], depths of targets)."""
    if kind == "rails":
        return rails()
    if kind == "array":
        along, zero = np.linspace(-0.07, 0.07, 8), np.zeros(8)
        ends = [
            np.concatenate([np.stack(axes, axis=1) for axes in sides])
            for sides in (
                ((zero - 0.07, along, zero), (zero + 0.07, along, zero)),
                ((along, zero - 0.07, zero), (along, zero + 0.07, zero)),
            )
        ]
        t, r = (index.ravel() for index in np.indices((16, 16)))
        still = np.zeros((256, 3))
        array = AntennaArray(*ends)
        return (
            np.linspace(72e9, 82e9, 32),
            array,
            ends[0][t],
            ends[1][r],
            still,
            (t, r),
            (0.25, 0.45),
        )
    count, pitch_m, half_m = (12, 0.018, 0.06) if kind == "pair" else (20, 0.006, 0.0)
    along = (np.arange(count) - (count - 1) / 2) * pitch_m
    moves = np.array([(x, y, 0.0) for y in along for x in along])
    tx_m, rx_m = moves - [half_m, 0, 0], moves + [half_m, 0, 0]
    one = np.zeros(len(moves), int)
    if kind == "pair":
        aperture, tones_hz = BistaticScan(tx_m, rx_m), np.linspace(5.7e9, 8.2e9, 26)
    else:
        aperture, tones_hz = PlanarScan(moves), np.linspace(22e9, 26e9, 16)
    return tones_hz, aperture, tx_m, rx_m, moves, (one, one), (0.15, 0.4)


def rails(stops=3, heights=32):
    """An array of 2 × 4 antennas at 60 GHz, moved up and to three stops, as `instrument`."""
    wave_m = SPEED_OF_LIGHT_M_S / 62e9
    moves = np.array(
        [(4 * wave_m * s, wave_m / 2 * h, 0) for s in range(stops) for h in range(heights)]
    )
    t, r = (np.tile(index.ravel(), len(moves)) for index in np.indices((2, 4)))
    middle_m = np.array([4 * wave_m * (stops - 1) / 2, wave_m / 4 * (heights - 1), 0])
    moves = np.repeat(moves - middle_m, 8, axis=0)
    across = np.array([wave_m, 0, 0])
    tx_m, rx_m = moves + 2 * t[:, None] * across, moves + r[:, None] / 2 * across
    return (
        np.linspace(60e9, 64e9, 64),
        BistaticScan(tx_m, rx_m),
        tx_m,
        rx_m,
        moves,
        (t, r),
        (0.3, 1.2),
    )


def planted(seed, kind=None, unknown=None, snr_db=None, points=None) -> Planted:
    """A capture, drawn by a seed: one to six points, an offset of -5 to 20 cm, steps up to 8 %
    wrong, gains of 1.7 dB and 0.3 rad, noise at -10 to 20 dB."""
    draw = np.random.default_rng(seed)
    kind = kind or draw.choice(list(ASKED))
    tones_hz, aperture, tx_m, rx_m, moves, parts, (near_m, far_m) = instrument(kind)
    unknown = unknown or list(ASKED[kind][draw.integers(len(ASKED[kind]))])
    count = points or int(draw.integers(1, 7))
    z_m = draw.uniform(near_m, far_m, count)
    points_m = np.column_stack([draw.uniform(-0.3, 0.3, (count, 2)) * z_m[:, None], z_m])
    echoes = draw.normal(size=count) + 1j * draw.normal(size=count)
    offset_m = draw.uniform(-0.05, 0.2) if "range_offset" in unknown else 0.0
    steps = 1 + draw.uniform(-0.08, 0.08, 2) * ("scan_step" in unknown)
    gains = np.ones(len(tx_m), complex)
    for part in parts if "gains" in unknown else ():
        size = part.max() + 1
        gains *= np.exp(draw.normal(size=size) * 0.2 + 0.3j * draw.normal(size=size))[part]
    samples = recorded(tones_hz, tx_m, rx_m, moves * np.append(steps - 1, 0), points_m, echoes)
    samples *= gains * np.exp(-4j * np.pi * offset_m * tones_hz / SPEED_OF_LIGHT_M_S)[:, None]
    level = 10 ** (-(draw.uniform(-10, 20) if snr_db is None else snr_db) / 20)
    noise = draw.normal(size=samples.shape) + 1j * draw.normal(size=samples.shape)
    samples += level * np.sqrt((np.abs(samples) ** 2).mean() / 2) * noise
    samples = samples.reshape(1, len(tones_hz), *aperture.channels).astype(np.complex64)
    capture = RadarCapture(samples, tones_hz, aperture)
    return Planted(capture, unknown, offset_m, steps, gains, points_m, echoes)


def recorded(tones_hz, tx_m, rx_m, shift_m, points_m, echoes) -> np.ndarray:
    """Echoes [f, n] of points: Σ a·exp(−j2πf·path/c)."""
    path_m = sum(
        np.linalg.norm(points_m[:, None] - end_m - shift_m, axis=2) for end_m in (tx_m, rx_m)
    )
    waves = np.asarray(tones_hz)[:, None, None] / SPEED_OF_LIGHT_M_S
    return np.einsum("k,fkn->fn", echoes, np.exp(-2j * np.pi * waves * path_m))
