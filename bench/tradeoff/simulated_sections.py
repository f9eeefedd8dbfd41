"""The trade-off's sections that simulate their own scenes, for simulation and for registration.

Simulation: how finely surfaces are sampled and which effects are on, compared with the finest
sampling and all effects. Registration: how many captures of the calibration target are combined,
and the error of the transform at points where hands are.
"""

import tempfile
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from handbench.bench.evaluation.intervals import Interval, mean_interval
from handbench.bench.results import Failure
from handbench.bench.run.outcome import recorded_failure
from handbench.bench.run.sweep import MOST_RIGS, ORDINARY, SimulationKnobs
from handbench.bench.scenes.echoes import echoes
from handbench.bench.scenes.finger_scenes import NAMED, SCENES, body
from handbench.bench.scenes.target_placements import Placement, optical_cloud, placements
from handbench.bench.tradeoff.settings import (
    MeasuredSection,
    TradeoffInputs,
    in_rounds,
    line,
    section,
    timed,
)
from handbench.calibration.registration import register
from handbench.calibration.registration.rigid_fit import Pairs
from handbench.calibration.transforms import Transform
from handbench.radar.data.arrays import qar50
from handbench.radar.data.capture import RadarCapture
from handbench.radar.methods.registry import method
from handbench.radar.simulation.known_effects import Choice
from handbench.radar.simulation.scene import Body, EchoScene
from handbench.radar.simulation.selection import CONTAINED, EFFECTS, choose
from handbench.radar.simulation.simulate import simulate_scene
from handbench.radar.warmup import compile_kernels
from handbench.support.progress import part, track

TONES_HZ = np.array([72e9, 79.5e9, 81.3e9, 81.8e9, 82e9])
METHOD = "3fsk"
NEAR_M = 0.03  # depths are compared as far along the cylinders, where their ends do not count


@dataclass(frozen=True)
class SimulationVariant:
    """One setting of the simulation: how finely surfaces and antennas are sampled, and which
    effects are on.

    All effects are on except those in `without`.
    """

    facets_per_wavelength: float = ORDINARY
    mirrors_per_wavelength: float = ORDINARY
    nodes_apart: float = 1.0
    without: tuple[str, ...] = ()

    @property
    def words(self) -> str:
        """The setting in words: the sampling, if it is not the default, and the effects."""
        words = {
            "facets_per_wavelength": "{:g} facets per wavelength",
            "mirrors_per_wavelength": "{:g} mirrors per wavelength",
            "nodes_apart": "nodes {:g} times as far apart",
        }
        sampling = [
            text.format(self.knobs[key]) for key, text in words.items() if key in self.knobs
        ]
        effects = f"without {', '.join(self.without)}" if self.without else "all effects"
        return ", ".join([*sampling, effects])

    @property
    def name(self) -> str:
        """The setting's name for files and tables, for example 2-facets-all-effects."""
        return self.words.replace(" per wavelength", "").replace(",", "").replace(" ", "-")

    @property
    def knobs(self) -> dict[str, Any]:
        """The parameters whose values are not the defaults: name → value."""
        return {
            key: value
            for key, value in asdict(self).items()
            if value != getattr(SimulationVariant, key)
        }

    def simulate(self, target: Body) -> RadarCapture:
        """Simulate the capture of one frame of a target in front of the array of the paper's
        radar."""
        scene = EchoScene(
            qar50(),
            TONES_HZ,
            np.zeros(len(TONES_HZ)),
            target,
            coarser=ORDINARY / self.facets_per_wavelength,
            mirrors_coarser=self.facets_per_wavelength / self.mirrors_per_wavelength,
            nodes_apart=self.nodes_apart,
        )
        return simulate_scene(scene, self.choices(scene)).capture

    def choices(self, scene: EchoScene) -> tuple[Choice, ...]:
        """Return one row for each effect: whether it is on in the scene, and why."""
        left = [
            effect.id
            for effect in EFFECTS
            if not effect.missing(scene) and effect.id not in self.without
        ]
        return choose(scene, tuple(id for id in left if CONTAINED.get(id) not in left))


def measure_simulation(inputs: TradeoffInputs) -> MeasuredSection:
    """Measure the time and the error of every setting of the simulation, on scenes of cylinders.

    The error is the difference of the depths from those with the finest sampling and all effects,
    which is simulated once. The settings are timed in turns.
    """
    knobs = inputs.sweep.simulation
    bodies = [
        body(SCENES[scene], material) for scene, material in map(NAMED.__getitem__, knobs.scenes)
    ]
    listed = {way.name: way for way in variants(knobs)}
    finest = SimulationVariant(
        max(knobs.facets_per_wavelength), max(knobs.mirrors_per_wavelength), min(knobs.nodes_apart)
    )
    compile_kernels()
    finest_m = [
        depths_m(finest.simulate(target)) for target in track(bodies, "simulation, the finest")
    ]

    def simulated(way: SimulationVariant) -> Iterator[dict[str, float]]:
        for target, reference_m in zip(bodies, finest_m, strict=True):
            capture, seconds = timed(lambda target=target: way.simulate(target))
            error_mm, both = map_difference(depths_m(capture), reference_m)
            yield {"seconds": seconds, "error": error_mm, "seen_percent": 100 * both}

    found = in_rounds(
        listed,
        inputs.sweep.repeats,
        simulated,
        "simulation",
        inputs.predicted_s.get("simulation", 0.0),
    )
    words = {"scenes": "; ".join(knobs.scenes), "finest": finest.words}
    about = section("simulation", next(iter(listed)), words)
    lines = []
    for name, way in listed.items():
        rounds = pd.DataFrame(found[name]).groupby("round").mean()  # over the scenes
        figures = {key: float(rounds[key].iloc[0]) for key in ("error", "seen_percent")}
        lines.append(
            line(about, name, way.words, way.knobs, seconds=rounds.seconds.to_list(), **figures)
        )
    return MeasuredSection(about, lines)


def variants(knobs: SimulationKnobs) -> list[SimulationVariant]:
    """List the settings of the simulation that the sweep asks for, without duplicates."""
    facets, mirrors, nodes = (
        knobs.facets_per_wavelength,
        knobs.mirrors_per_wavelength,
        knobs.nodes_apart,
    )
    first = facets[0], mirrors[0], nodes[0]
    listed = [
        SimulationVariant(n, min(n, mirrors[0]), nodes[0], names)
        for n, names in product(facets, knobs.without)
    ]
    usual = knobs.without[0] if knobs.without else ()
    listed += [SimulationVariant(first[0], n, first[2], usual) for n in mirrors] + [
        SimulationVariant(*first[:2], n, usual) for n in nodes
    ]
    return list(dict.fromkeys(listed))


def depths_m(capture: RadarCapture) -> np.ndarray:
    """Image a capture by 3-FSK: the depths, metres, in the middle part of the cylinders, away from
    their ends."""
    chosen = method(METHOD)
    depth = chosen.run(capture, chosen.configure({}, "simulation"), 0).depth
    return depth.z_m[np.abs(depth.y_m) < NEAR_M]


def map_difference(ours_m: np.ndarray, reference_m: np.ndarray) -> tuple[float, float]:
    """Compare two depth maps: (mean |Δz| in mm over the pixels that both have, number of these
    pixels over that of the pixels that at least one has)."""
    here, there = np.isfinite(ours_m), np.isfinite(reference_m)
    both, either = here & there, here | there
    off_mm = 1e3 * np.abs(ours_m - reference_m)[both]
    return float(off_mm.mean()) if len(off_mm) else np.inf, float(both.sum() / max(either.sum(), 1))


VOLUME_M = np.array(
    list(
        product(np.linspace(-0.06, 0.06, 5), np.linspace(-0.1, 0.1, 5), np.linspace(0.25, 0.35, 5))
    )
)


@dataclass(frozen=True)
class TargetMeasurement:
    """A measurement of the calibration target in one simulated capture.

    placed: where the target is; pairs: its ball centres as both sensors measure them; common_m2 [3,
    3]: covariance of the centres' common error, m²; seconds: time that the measurement took.
    """

    placed: Placement
    pairs: Pairs
    common_m2: np.ndarray
    seconds: float


def measure_registration(inputs: TradeoffInputs) -> MeasuredSection:
    """Measure the error and the time of the registration as a function of the number of captures
    that are combined.

    The calibration target is simulated in `max(captures)` captures with each of `trials` rigs. For
    each number of captures, a capture is part of at most one combination. The error is that of the
    transform at points where hands are.
    """
    knobs = inputs.sweep.registration
    trial_s = inputs.predicted_s.get("registration", 0.0) / knobs.trials
    compile_kernels()
    failures: list[Failure] = []
    rigs: dict[int, list[TargetMeasurement]] = {}
    with tempfile.TemporaryDirectory(dir=inputs.work, prefix=".registration-") as folder:
        for trial in range(knobs.trials):
            number = MOST_RIGS * (MOST_RIGS * inputs.bench.seed + trial)
            rigs[number] = []
            with part(f"registration, trial {trial + 1} of {knobs.trials}", trial_s):
                for placed in placements(number, max(knobs.captures), Path(folder)):
                    with recorded_failure(failures, f"placement {placed.number}", "registration"):
                        rigs[number].append(measure_placement(placed))
    sensor = placed.scene.file.sensor

    def combined(count: int) -> Iterator[dict[str, float]]:
        for number, measured in rigs.items():
            for i in range(0, len(measured) - count + 1, count):
                group = measured[i : i + count]
                square_m2, seconds = np.nan, sum(one.seconds for one in group)
                with recorded_failure(
                    failures, f"placement {group[0].placed.number}", "registration"
                ):
                    found, own_s = timed(lambda group=group: combine_captures(group))
                    square_m2 = float(
                        (errors_m(found, group[0].placed.scene.radar_from_photo) ** 2).mean()
                    )
                    seconds += own_s
                yield {"rig": number, "square_m2": square_m2, "seconds": seconds}

    tried = in_rounds(
        {_name(count): count for count in knobs.captures}, 1, combined, "registration"
    )
    volume = " × ".join(f"{1e3 * size:.0f}" for size in np.ptp(VOLUME_M, axis=0))
    about = section(
        "registration", _name(min(knobs.captures)), {"volume": volume, "trials": knobs.trials}
    )
    lines = []
    for count in dict.fromkeys(knobs.captures):
        name = _name(count)
        made = pd.DataFrame(tried[name], columns=["rig", "square_m2", "seconds"])
        of_rigs_m2 = made.groupby("rig").square_m2.mean().dropna().to_numpy()
        refused = int(made.square_m2.isna().sum())
        title = name.replace("-", " ") + (f" ({refused} of {len(made)} refused)" if refused else "")
        error_mm = 1e3 * float(np.sqrt(of_rigs_m2.mean())) if len(of_rigs_m2) else None
        taken_s = count * len(sensor.frequencies_hz) * sensor.step_time_s
        given = {"captures": count}, error_mm, rms_interval_mm(of_rigs_m2), made.seconds.to_list()
        lines.append(line(about, name, title, *given, acquisition_s=taken_s))
    return MeasuredSection(about, lines)


def measure_placement(placed: Placement) -> TargetMeasurement:
    """Simulate the echoes of a placed calibration target and its point cloud from photographs, and
    measure the target's balls in both."""
    cloud, capture = optical_cloud(placed), echoes(placed.scene).capture
    (pairs, common_m2), seconds = timed(lambda: register.measure(*cloud, capture, placed.described))
    return TargetMeasurement(placed, pairs, common_m2, seconds)


def combine_captures(group: Sequence[TargetMeasurement]) -> Transform:
    """Compute the transform from photo to radar frame from several measurements of the target with
    one rig."""
    common_m2 = np.mean([one.common_m2 for one in group], axis=0)
    sigma_m = group[0].placed.described.ball_offset_sigma_m
    return register.combine(
        [one.pairs for one in group], common_m2=common_m2, ball_offset_sigma_m=sigma_m
    )


def errors_m(found: Transform, true: Transform) -> np.ndarray:
    """Compute the distances [n], metres, between points where hands are (VOLUME_M) and the
    positions to which a wrong transform moves them."""
    return np.linalg.norm(found.points(true.inverse().points(VOLUME_M)) - VOLUME_M, axis=1)


def rms_interval_mm(square_m2: np.ndarray) -> Interval | None:
    """Compute the 95 % confidence interval, in mm, of a root mean square error from the mean square
    errors [n], m², of independent rigs; None for too few rigs."""
    found = mean_interval(1e6 * square_m2)
    return None if found is None else Interval(max(found.low, 0.0) ** 0.5, found.high**0.5)


def _name(count: int) -> str:
    return "1-capture" if count == 1 else f"{count}-captures"
