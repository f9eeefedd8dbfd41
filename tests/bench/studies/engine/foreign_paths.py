"""The paths that are compared at equal error: ours, the textbook's, and packages of others where
they are installed.

A sum images points_m [n, 3] from samples [f, t, r] of an array at equally spaced tones: complex
[n].
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from importlib.util import find_spec
from itertools import product

import numpy as np

from handbench.radar.data.arrays import SPEED_OF_LIGHT_M_S, AntennaArray
from handbench.radar.imaging.api import image_volume
from handbench.radar.imaging.cpu.steering import phasor
from tests.bench.studies.engine.scope import Inputs
from tests.bench.studies.engine.textbook import numba_sum, range_compressed
from tests.bench.studies.engine.turns import Work
from tests.radar.exact import backproject

Sum = Callable[..., np.ndarray]
ENGINE, DIRECT, EXACT, COMPRESSED = (
    "engine",
    "direct sum, numba",
    "exact, matrix products",
    "range-compressed, linear",
)
BLOCK = (
    1 << 14
)  # points of a transform: fewer are lost in the overhead of 8836 calls, more leave the cache
PART, FEW = 14_884, 48  # points that are timed, four planes of 61 × 61; of the direct sum


@dataclass(frozen=True)
class Contender:
    """A path at one setting of its knob. values: at voxels [n], from samples; once: what is timed,
    on a fraction of the volume's voxels; fixed: the same for one of them, where much is done for
    the samples alone; checked: the voxels whose errors it has time for (None: any number)."""

    name: str
    setting: str
    values: Callable[[np.ndarray, np.ndarray], np.ndarray]
    once: Work
    fraction: float = 1.0
    fixed: Work | None = None
    checked: int | None = None


def engines(inputs: Inputs) -> list[Contender]:
    """The engine at its tolerances, on the whole grid."""

    def volume(tolerance: float, samples: np.ndarray) -> np.ndarray:
        return image_volume(samples, inputs.tones_hz, inputs.array, inputs.grid, tolerance)

    def values(tolerance: float, voxels: np.ndarray, samples: np.ndarray) -> np.ndarray:
        return volume(tolerance, samples).ravel()[voxels]

    hand = inputs.samples["hand"]
    return [
        Contender(ENGINE, f"tolerance {power(t)}", partial(values, t), partial(volume, t, hand))
        for t in (3e-2, 1e-2, 3e-3, 1e-3, 3e-4, 1e-4, 3e-5, 1e-5)
    ]


def contenders(inputs: Inputs) -> list[Contender]:
    """The engine, and all that image point by point."""
    hand, voxels = inputs.samples["hand"], np.prod(inputs.grid.shape)

    def contender(
        name: str, setting: str, image: Sum, part: int = PART, shared: bool = False
    ) -> Contender:
        def values(some: np.ndarray, samples: np.ndarray) -> np.ndarray:
            return image(samples, inputs.tones_hz, inputs.array, inputs.grid.points_at_m(some))

        fixed = partial(values, np.arange(1), hand) if shared else None
        checked = part if part == FEW else None
        return Contender(
            name,
            setting,
            values,
            partial(values, np.arange(part), hand),
            part / voxels,
            fixed,
            checked,
        )

    found = [contender(DIRECT, "", numba_sum, FEW), contender(EXACT, "", backproject)]
    for bins in (512, 1024, 2048, 4096, 8192):
        found.append(
            contender(COMPRESSED, f"{bins} bins", partial(range_compressed, bins=bins), shared=True)
        )
    for eps, factor in (
        product((1e-1, 1e-2, 1e-3, 1e-4), (1.25, 2.0)) if find_spec("finufft") else ()
    ):
        way = partial(finufft_sum, eps=eps, upsampfac=factor)
        found.append(contender("finufft", f"eps {power(eps)}, upsampling {factor:g}", way))
    for upsample in (4, 8, 16, 32, 64) if find_spec("fastsar") else ():
        found.append(
            contender(
                "fastsar",
                f"upsampling {upsample}",
                partial(fastsar_sum, upsample=upsample),
                shared=True,
            )
        )
    return [*engines(inputs), *found]


def power(number: float) -> str:
    """A number as 3e-2."""
    return f"{number:.0e}".replace("e-0", "e-")


def finufft_sum(
    samples: np.ndarray,
    frequencies_hz: np.ndarray,
    array: AntennaArray,
    points_m: np.ndarray,
    eps: float = 1e-3,
    upsampfac: float = 2.0,
) -> np.ndarray:
    """Every channel's range profile at its delays, by a one-dimensional type 2 NUFFT over the
    tones.

    O(p) = Σ_t e^{jk_m|p−t|} Σ_r e^{jk_m|p−r|} Σ_n S[n, t, r] e^{jnθ}, θ = 2πΔf(|p−t| + |p−r|)/c,
    k_m of the middle tone: exact up to eps. Channels share no delays, so that each has a transform
    of its own.
    """
    import finufft

    tones, step_hz = len(frequencies_hz), _step_hz(frequencies_hz)
    per_channel = np.ascontiguousarray(np.moveaxis(samples, 0, -1), np.complex64)
    plan = finufft.Plan(
        2,
        (tones,),
        eps=eps,
        isign=1,
        dtype="complex64",
        nthreads=1,
        upsampfac=upsampfac,
        spread_sort=0,
    )
    image = np.empty(len(points_m), np.complex64)
    for start in range(0, len(points_m), BLOCK):
        block = points_m[start : start + BLOCK]
        lengths_m = [
            np.linalg.norm(leg[:, None] - block, axis=2) for leg in (array.tx_m, array.rx_m)
        ]
        to, back = (
            (2 * np.pi * step_hz / SPEED_OF_LIGHT_M_S * length).astype(np.float32)
            for length in lengths_m
        )
        to_phase, back_phase = (
            phasor(length, frequencies_hz[tones // 2], 1).astype(np.complex64)
            for length in lengths_m
        )
        theta, value = np.empty(len(block), np.float32), np.empty(len(block), np.complex64)
        total = np.zeros(len(block), np.complex64)
        for t, profiles in enumerate(per_channel):
            heard = np.zeros(len(block), np.complex64)
            for r, profile in enumerate(profiles):
                plan.setpts(np.add(to[t], back[r], out=theta))
                plan.execute(profile, value)
                value *= back_phase[r]
                heard += value
            heard *= to_phase[t]
            total += heard
        image[start : start + BLOCK] = total
    return image


def fastsar_sum(
    samples: np.ndarray,
    frequencies_hz: np.ndarray,
    array: AntennaArray,
    points_m: np.ndarray,
    upsample: int = 8,
) -> np.ndarray:
    """fastsar's bistatic backprojection onto points, its "cpu" backend: every channel is a pulse,
    its profile is made by an FFT padded `upsample` times and interpolated linearly."""
    import fastsar

    transmitters, receivers = array.channels
    pulses = np.ascontiguousarray(samples.reshape(len(samples), -1).T, np.complex64)
    return fastsar.backproject(
        pulses,
        np.repeat(array.tx_m, receivers, axis=0),
        frequencies_hz[0],
        _step_hz(frequencies_hz),
        points_m,
        rcv=np.tile(array.rx_m, (transmitters, 1)),
        ref=np.zeros(len(pulses)),  # echoes as received: compensated to no range
        backend="cpu",
        upsample=upsample,
        window=False,
    )


def _step_hz(frequencies_hz: np.ndarray) -> float:
    return float(frequencies_hz[-1] - frequencies_hz[0]) / (len(frequencies_hz) - 1)
