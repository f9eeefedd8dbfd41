"""Images and echoes by the formula as it stands, in float64 with numpy alone: what geometry's hard cases compare with.

Written apart from the product, of which only the formula is shared: O(p) = Σ S e^{+j2πf(|p−t|+|p−r|)/c}.
"""

from __future__ import annotations

import numpy as np

LIGHT_M_S = 299_792_458.0


def paths_m(tx_m: np.ndarray, rx_m: np.ndarray, points_m: np.ndarray) -> np.ndarray:
    """Length of the path over every point: [p, t, r]."""
    to, back = (np.sqrt(((points_m[:, None] - leg[None]) ** 2).sum(axis=2)) for leg in (tx_m, rx_m))
    return to[:, :, None] + back[:, None, :]


def images(
    samples: np.ndarray, tones_hz: np.ndarray, tx_m: np.ndarray, rx_m: np.ndarray, points_m: np.ndarray
) -> np.ndarray:
    """The coherent sum of samples [f, t, r] at points_m [p, 3]: complex128 [p]."""
    path_m = paths_m(tx_m, rx_m, points_m)
    image = np.zeros(len(points_m), np.complex128)
    for sample, tone_hz in zip(samples.astype(np.complex128), tones_hz, strict=True):
        image += (sample * np.exp(2j * np.pi * _turns(path_m, tone_hz))).sum(axis=(1, 2))
    return image


def echoes(
    weights: np.ndarray, tones_hz: np.ndarray, tx_m: np.ndarray, rx_m: np.ndarray, points_m: np.ndarray,
    spreading: bool = True,
) -> np.ndarray:
    """Samples of points that scatter evenly: complex128 [f, t, r]; with spreading each leg fades as 1/R."""
    path_m = paths_m(tx_m, rx_m, points_m)
    gain = weights[:, None, None] * np.ones(path_m.shape)
    if spreading:
        to, back = (np.sqrt(((points_m[:, None] - leg[None]) ** 2).sum(axis=2)) for leg in (tx_m, rx_m))
        gain = gain / (to[:, :, None] * back[:, None, :])
    return np.stack([(gain * np.exp(-2j * np.pi * _turns(path_m, tone_hz))).sum(axis=0) for tone_hz in tones_hz])


def _turns(path_m: np.ndarray, tone_hz: float) -> np.ndarray:
    """The phase in turns, without its whole turns."""
    turns = tone_hz * path_m / LIGHT_M_S
    return turns - np.round(turns)
