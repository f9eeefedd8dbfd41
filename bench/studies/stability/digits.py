"""Significant digits of the table's figures, by stochastic arithmetic: the chain from echoes to a figure runs again and
again, what it keeps in single precision gets random rounding errors, and the figure's spread tells its digits.

Each value errs by one unit in its last place at most, in both parts of a complex number. Depths are kept in double
precision, but for those of further frames; what single precision would cost them is told apart. The error that the
engine's tolerance allows is another perturbation of the images, as large as it may be. Draws are seeded by method,
perturbation and number.
"""

from collections.abc import Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from contextvars import ContextVar
from dataclasses import dataclass, replace
from functools import cache, partial
from typing import Any, NamedTuple
from unittest.mock import patch

import numpy as np
from scipy.stats import chi2, norm

from bench.evaluation.depth_errors import error_map
from bench.evaluation.metrics import HEADLINE, METRICS, pool, precision, strongest_scatterer_z_m
from bench.results.stability import Table
from bench.studies.stability.random_scenes import fingers
from bench.studies.stability.scenes import ALL_HZ, POINT_M, imaged
from radar.data.arrays import qar50
from radar.data.capture import RadarCapture
from radar.data.grid import Axis
from radar.imaging.cpu.executor import strongest_voxels
from radar.methods import fsk, joint, projection
from radar.methods.fsk_config import JointConfig
from radar.simulation.effects.receiver import strongest_amplitude, thermal_noise
from radar.simulation.forward import Scatterers, simulate
from radar.support.progress import track

STAGES = ("samples", "images", "power")  # complex64, complex64 sums, and float32 magnitudes and decibels
DEPTH = "depth"
FSK = ("2fsk", "3fsk", "nfsk-plus", "joint")
METHODS = (*FSK, "broadband", "broadband-aligned", "narrowband")
FIGURES = (HEADLINE, "max_mm", "precision_mm")
DRAWS, REPEATS = 16, 4
TOLERANCES = (1e-5, 1e-3)
CONFIDENCE = PROBABILITY = 0.95
MOST = np.finfo(np.float64).precision  # digits of a figure that nothing changes
NOISE_RAD = 0.0340  # of the benchmark's table
AXIS = Axis(start_m=-0.024, stop_m=0.024, step_m=0.001)
POINTS, HALF_M = 4000, 0.03


@dataclass(frozen=True)
class Shake:
    """Perturbation of some stages; tolerance: relative L2 error that each image gets besides."""

    generator: np.random.Generator
    stages: frozenset[str]
    tolerance: float = 0.0


_now: ContextVar[Shake | None] = ContextVar("shake", default=None)


def rounded(values: np.ndarray, generator: np.random.Generator) -> np.ndarray:
    """Values in single precision, each part off by a unit in its last place at most, up, down or not at all."""
    kept = np.ascontiguousarray(values, np.complex64 if np.iscomplexobj(values) else np.float32)
    parts = kept.view(np.float32)
    off = np.spacing(parts) * generator.uniform(-1, 1, parts.shape)
    return (parts + off).astype(np.float32).view(kept.dtype)


def shaken(stage: str, values: np.ndarray) -> np.ndarray:
    """A stage's values, perturbed if the present run perturbs it."""
    now = _now.get()
    return values if now is None or stage not in now.stages else rounded(values, now.generator)


def _allowed(images: np.ndarray) -> np.ndarray:
    """Images with the error that the tolerance allows, evenly over all of them."""
    now = _now.get()
    if now is None or not now.tolerance:
        return images
    size = now.tolerance * np.sqrt(np.mean(np.abs(images) ** 2, dtype=np.float64) / 2)
    noise = now.generator.normal(scale=size, size=(2, *images.shape))
    return (images + noise[0] + 1j * noise[1]).astype(images.dtype)


@contextmanager
def shaking() -> Iterator[None]:
    """In the block the methods' images and powers are those of `shaken`; volumes are held whole."""

    def passed(stage: str, function: Any, *given: Any, **named: Any) -> np.ndarray:
        values = function(*given, **named)
        return shaken(stage, _allowed(values) if stage == "images" else values)

    def projected(*given: Any) -> tuple[np.ndarray, np.ndarray]:
        index, magnitude = strongest_voxels(projection.image_volume(*given))
        return index, shaken("power", magnitude)

    places = [(module, name, "images") for module in (fsk, projection) for name in ("image_points", "image_volume")]
    places += [(module, "amplitude_db", "power") for module in (fsk, projection, joint)]
    with ExitStack() as stack:
        for module, name, stage in places:
            stack.enter_context(patch.object(module, name, partial(passed, stage, getattr(module, name))))
        stack.enter_context(patch.object(projection, "project_volume", projected))
        yield


def digits(values: Sequence[float], reference: float) -> float:
    """Decimal digits that at least a share PROBABILITY of results has, with CONFIDENCE, from `values` [n] drawn about
    the unperturbed `reference`, were they normal (Sohier et al., ACM TOMS 47 (2021) 10: CNH); at most MOST."""
    relative = np.asarray(values) / reference - 1
    spread, freedom = float(np.std(relative, ddof=1)) or float(np.abs(relative).max()), len(relative) - 1
    if spread == 0:
        return float(MOST)
    wide = 0.5 * np.log10(freedom / chi2.ppf((1 - CONFIDENCE) / 2, freedom)) + np.log10(norm.ppf((PROBABILITY + 1) / 2))
    return float(np.clip(-np.log10(spread) - wide, 0.0, MOST))


class Scene(NamedTuple):
    """A capture with several frames, and the surface's depth [ny, nx] on the grid."""

    capture: RadarCapture
    truth_m: np.ndarray


@cache
def scene() -> Scene:
    """Fingers over a palm at 0.28 m before the paper's array, a cloud of scatterers with the table's noise."""
    generator = np.random.default_rng(0)
    surface, xy = fingers(generator), generator.uniform(-HALF_M, HALF_M, (POINTS, 2))
    points_m = np.column_stack([xy, POINT_M[2] + surface(*xy.T)])
    tones_hz = np.union1d(ALL_HZ, JointConfig().tones_hz)
    clean = simulate(Scatterers(points_m, generator.standard_normal(POINTS)), tones_hz, qar50(), spreading=False)
    strongest = strongest_amplitude(clean[0], tones_hz[0], qar50(), points_m)
    frames = [thermal_noise(clean, tones_hz, NOISE_RAD, strongest, (n,)) for n in range(REPEATS)]
    axis_m = AXIS.values_m()
    truth_m = POINT_M[2] + surface(*np.meshgrid(axis_m, axis_m))
    return Scene(RadarCapture(np.array(frames, np.complex64), tones_hz, qar50()), truth_m)


def figures(id: str, seen: Scene) -> dict[str, float]:
    """A method's figures: of the first frame's errors, and of FSK's repeats."""
    taken = replace(seen.capture, samples=shaken("samples", seen.capture.samples))
    maps = [imaged(id, taken, frame=n, x=AXIS, y=AXIS) for n in range(REPEATS if id in FSK else 1)]
    z_m = np.array([shaken(DEPTH, depth.z_m) for depth in maps])
    found = pool([error_map(maps[0].x_m, maps[0].y_m, z_m[0], seen.truth_m)])
    if id in FSK:
        amplitude = 10 ** (np.array([depth.amplitude_db for depth in maps], np.float64) / 20)
        found |= precision([strongest_scatterer_z_m(z_m, amplitude)])
    return {key: float(found[key] or np.nan) for key in FIGURES if key in found}


def _shakes(seed: int, of: int) -> Mapping[str, list[Shake | None]]:
    """The runs of method number `of`: unperturbed, each stage alone, the chain, and tolerances."""
    kinds = {stage: (frozenset([stage]), 0.0) for stage in (*STAGES, DEPTH)} | {"chain": (frozenset(STAGES), 0.0)}
    kinds |= {f"{tolerance:g}": (frozenset[str](), tolerance) for tolerance in TOLERANCES}
    runs: dict[str, list[Shake | None]] = {"value": [None]}
    for k, (kind, how) in enumerate(kinds.items()):
        runs[kind] = [Shake(np.random.default_rng([seed, of, k, n]), *how) for n in range(DRAWS)]
    return runs


def table(seed: int = 0, methods: Sequence[str] = METHODS) -> Table:
    """Digits of every method's figures."""
    rows: list[tuple[str | float | None, ...]] = []
    with shaking():
        for id in track(methods, "digits", len(methods)):
            runs = _shakes(seed, METHODS.index(id)).items()
            found = {kind: [_run(id, shake) for shake in shakes] for kind, shakes in runs}
            for key, value in found.pop("value")[0].items():
                told = {kind: digits([run[key] for run in runs], value) for kind, runs in found.items()}
                weakest = min(STAGES, key=lambda stage: told[stage])
                chain = told["images"], told["chain"], weakest if told[weakest] < MOST else None, told[DEPTH]
                rows.append((METRICS[key].title, id, value, *chain, *(told[f"{t:g}"] for t in TOLERANCES)))
    ends = [f"tolerance {tolerance:g}" for tolerance in TOLERANCES]
    return Table(
        title="Digits",
        text="significant decimal digits of one capture's figures (mm) when what is kept in single precision rounds at "
        "random: images alone, the whole chain, and the stage that leaves fewest; were depths kept in float32; and "
        f"with images as wrong as a tolerance allows. {PROBABILITY:.0%} of results have as many, with {CONFIDENCE:.0%} "
        f"confidence, of {DRAWS} draws; {MOST}: no draw changed anything",
        columns=("figure", "method", "value", "images", "chain", "fewest by", "float32 depths", *ends),
        rows=tuple(rows),
    )


def _run(id: str, shake: Shake | None) -> dict[str, float]:
    token = _now.set(shake)
    try:
        return figures(id, scene())
    finally:
        _now.reset(token)
