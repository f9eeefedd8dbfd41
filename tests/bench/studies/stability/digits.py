"""Significant digits of the table's figures, by stochastic arithmetic: the chain from echoes to a
figure runs again and again, what it keeps in single precision gets random rounding errors, and the
figure's spread tells its digits.

Depths are kept in double precision, but for those of further frames; what single precision would
cost them is told apart. The error that the engine's tolerance allows is another perturbation of the
images, as large as it may be.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, replace
from functools import cache, partial
from typing import Any
from unittest.mock import patch

import numpy as np
from scipy.stats import chi2, norm

from handbench.bench.evaluation.depth_errors import error_map
from handbench.bench.evaluation.metrics import (
    HEADLINE,
    METRICS,
    pool,
    precision,
    strongest_scatterer_z_m,
)
from handbench.radar.data.arrays import qar50
from handbench.radar.data.capture import RadarCapture
from handbench.radar.data.grid import Axis
from handbench.radar.imaging.api import image_volume
from handbench.radar.imaging.peaks import Peaks, root_mean_square, strongest_voxels
from handbench.radar.methods import alignment, fsk, projection
from handbench.radar.methods.fsk_config import JointConfig
from handbench.radar.simulation.effects.sensor import strongest_amplitude, thermal_noise
from handbench.radar.simulation.forward import Scatterers, simulate
from handbench.support.progress import track
from tests.bench.studies.stability.random_scenes import fingers
from tests.hard_cases.scenes import ALL_HZ, POINT_M, imaged
from tests.hard_cases.table import Table

STAGES = (
    "samples",
    "images",
    "power",
)  # complex64, complex64 sums, and float32 magnitudes and decibels
FSK = ("2fsk", "3fsk", "nfsk-plus", "joint")
METHODS = (*FSK, "broadband", "broadband-aligned", "narrowband")
DRAWS, REPEATS = 16, 4
TOLERANCES = (1e-5, 1e-3)
CONFIDENCE = PROBABILITY = 0.95
MOST = np.finfo(np.float64).precision  # digits of a figure that nothing changes
NOISE_RAD = 0.0340  # of the benchmark's table
AXIS = Axis(start_m=-0.024, stop_m=0.024, step_m=0.001)
POINTS, HALF_M = 4000, 0.03


def rounded(values: np.ndarray, generator: np.random.Generator) -> np.ndarray:
    """Values in single precision, each part off by a unit in its last place at most, up, down or
    not at all."""
    kept = np.ascontiguousarray(values, np.complex64 if np.iscomplexobj(values) else np.float32)
    parts = kept.view(np.float32)
    off = np.spacing(parts) * generator.uniform(-1, 1, parts.shape)
    return (parts + off).astype(np.float32).view(kept.dtype)


@dataclass(frozen=True)
class Shake:
    """Perturbation of some stages; tolerance: relative L2 error that images to a tolerance get
    besides."""

    generator: np.random.Generator
    stages: tuple[str, ...] = ()
    tolerance: float = 0.0

    def of(self, stage: str, values: np.ndarray) -> np.ndarray:
        """A stage's values, perturbed if it is one of those."""
        return rounded(values, self.generator) if stage in self.stages else values

    def result(self, stage: str, function: Any, *given: Any, **named: Any) -> np.ndarray:
        """A function's values for a stage; the fifth argument of one that makes images is their
        tolerance."""
        values = function(*given, **named)
        if self.tolerance and stage == "images" and given[4] is not None:
            size = self.tolerance * np.sqrt(np.mean(np.abs(values) ** 2, dtype=np.float64) / 2)
            noise = self.generator.normal(scale=size, size=(2, *values.shape))
            values = (values + noise[0] + 1j * noise[1]).astype(values.dtype)
        return self.of(stage, values)

    @contextmanager
    def upon_methods(self) -> Iterator[None]:
        """In the block the methods' images and powers are perturbed; volumes are held whole."""

        def projected(*given: Any) -> Peaks:
            volume = self.result("images", image_volume, *given)
            peaks, tolerance = (
                strongest_voxels(volume),
                given[4] and max(given[4], self.tolerance or 0.0),
            )
            error = (tolerance or 0.0) * root_mean_square(volume)
            return replace(peaks, magnitude=self.of("power", peaks.magnitude), error=error)

        places = [
            (module, name, "images")
            for module in (fsk, projection)
            for name in ("image_points", "image_volume")
        ]
        places += [(module, "amplitude_db", "power") for module in (fsk, projection, alignment)]
        with ExitStack() as stack:
            for module, name, stage in places:
                shaken = partial(self.result, stage, getattr(module, name))
                stack.enter_context(patch.object(module, name, shaken))
            stack.enter_context(patch.object(projection, "project_volume", projected))
            yield


def digits(values: Sequence[float], reference: float) -> float:
    """Decimal digits that at least a share PROBABILITY of results has, with CONFIDENCE, from
    `values` [n] drawn about the unperturbed `reference`, were they normal (Sohier et al., ACM TOMS
    47 (2021) 10: CNH, with the root mean square about the reference for the spread, so that a shift
    counts); at most MOST."""
    relative = np.asarray(values) / reference - 1
    spread, freedom = float(np.sqrt(np.mean(relative**2))), len(relative)
    if spread == 0:
        return float(MOST)
    wide = 0.5 * np.log10(freedom / chi2.ppf((1 - CONFIDENCE) / 2, freedom)) + np.log10(
        norm.ppf((PROBABILITY + 1) / 2)
    )
    return float(np.clip(-np.log10(spread) - wide, 0.0, MOST))


@cache
def scene() -> tuple[RadarCapture, np.ndarray]:
    """Some frames of fingers over a palm at 0.28 m before the paper's array, a cloud of scatterers
    with the table's noise; and the surface's depth [ny, nx] on the grid."""
    generator = np.random.default_rng(0)
    surface, xy = fingers(generator), generator.uniform(-HALF_M, HALF_M, (POINTS, 2))
    points_m = np.column_stack([xy, POINT_M[2] + surface(*xy.T)])
    tones_hz = np.union1d(ALL_HZ, JointConfig().tones_hz)
    clean = simulate(
        Scatterers(points_m, generator.standard_normal(POINTS)), tones_hz, qar50(), spreading=False
    )
    strongest = strongest_amplitude(clean[0], tones_hz[0], qar50(), points_m)
    frames = [thermal_noise(clean, tones_hz, NOISE_RAD, strongest, (n,)) for n in range(REPEATS)]
    truth_m = POINT_M[2] + surface(*np.meshgrid(AXIS.values_m(), AXIS.values_m()))
    return RadarCapture(np.array(frames, np.complex64), tones_hz, qar50()), truth_m


def figures(id: str, shake: Shake) -> dict[str, float]:
    """A method's figures: of the first frame's errors, and of FSK's repeats."""
    capture, truth_m = scene()
    taken = replace(capture, samples=shake.of("samples", capture.samples))
    with shake.upon_methods():
        maps = [
            imaged(id, taken, frame=n, x=AXIS, y=AXIS) for n in range(REPEATS if id in FSK else 1)
        ]
    z_m = np.array([shake.of("depth", depth.z_m) for depth in maps])
    found = pool([error_map(maps[0].x_m, maps[0].y_m, z_m[0], truth_m)])
    if id in FSK:
        amplitude = 10 ** (np.array([depth.amplitude_db for depth in maps], np.float64) / 20)
        found |= precision([strongest_scatterer_z_m(z_m, amplitude)])
    return {
        key: float(found[key] or np.nan)
        for key in (HEADLINE, "max_mm", "precision_mm")
        if key in found
    }


def _spread(id: str, seed: int) -> Iterator[tuple[str | float | None, ...]]:
    """A method's lines of the table."""
    kinds: dict[str, tuple[Any, ...]] = {stage: ((stage,),) for stage in (*STAGES, "depth")} | {
        "chain": (STAGES,)
    }
    kinds |= {f"{tolerance:g}": ((), tolerance) for tolerance in TOLERANCES}
    runs: dict[str, list[dict[str, float]]] = {}
    for k, (kind, how) in enumerate(kinds.items()):
        draws = [np.random.default_rng([seed, METHODS.index(id), k, n]) for n in range(DRAWS)]
        runs[kind] = [figures(id, Shake(draw, *how)) for draw in draws]
    for key, value in figures(id, Shake(np.random.default_rng())).items():
        told = {kind: digits([run[key] for run in found], value) for kind, found in runs.items()}
        weakest = min(STAGES, key=lambda stage: told[stage])
        ends = (
            told[kind] for kind in ("images", "chain", "depth", *(f"{t:g}" for t in TOLERANCES))
        )
        yield METRICS[key].title, id, weakest if told[weakest] < MOST else None, value, *ends


def table(seed: int = 0, methods: Sequence[str] = METHODS) -> Table:
    """Digits of every method's figures."""
    ends = [f"tolerance {tolerance:g}" for tolerance in TOLERANCES]
    return Table(
        title="Digits",
        text="significant decimal digits of one capture's figures (mm) when what is kept in "
        "single precision rounds at "
        "random: images alone, the whole chain, and the stage that leaves fewest; were depths "
        "kept in float32; and "
        f"with images as wrong as a tolerance allows. {PROBABILITY:.0%} of results have as many, "
        f"with {CONFIDENCE:.0%} "
        f"confidence, of {DRAWS} draws, were they normal; {MOST}: no draw changed anything",
        columns=(
            "figure",
            "method",
            "fewest by",
            "value",
            "images",
            "chain",
            "float32 depths",
            *ends,
        ),
        rows=tuple(
            row for id in track(methods, "digits", len(methods)) for row in _spread(id, seed)
        ),
    )
