"""The figures of the paper's table under each setting, against the true surface.

Every capture is scored as `handbench run` scores it: figures per capture, then averaged, and the
precision of the hands that measure it. Only what a setting changes is made again: echoes are kept
(`placement`), and images of the same samples by the same configuration as in the benchmark itself
are taken from there. The receiver comes last (`received`): what noise, the oscillator, the antennas
and the calibration add to echoes without noise.
"""

from __future__ import annotations

import json
import zlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path

import numpy as np
import pandas as pd

from handbench.bench.evaluation.depth_errors import ErrorMap, error_map
from handbench.bench.evaluation.metrics import deviation, mean_deviation, mean_figures, of_captures
from handbench.bench.run.benchmark_file import BenchFile
from handbench.bench.run.repeat_stage import strongest_z_m
from handbench.bench.scenes.scene_file import SceneFile, Sensor
from handbench.groundtruth.mesh.depth import depth_on_grid
from handbench.radar.data.capture import RadarCapture, thin_antennas
from handbench.radar.data.depthmap import DepthMap
from handbench.radar.methods.fsk import masked_mean
from handbench.radar.methods.fsk_config import ThreeToneConfig
from handbench.radar.methods.registry import Method, method
from handbench.radar.simulation.effects.sensor import thermal_noise
from handbench.support.config import Config, load
from handbench.support.errors import HandbenchError
from handbench.support.files import content_hash, inside
from handbench.support.parallel import for_each
from handbench.support.progress import say
from tests.bench.studies.columns import Record
from tests.bench.studies.sensitivity.configured import configured, grid_of, paper_methods, tones_of
from tests.bench.studies.sensitivity.nearness import BROADBAND, FSK, KEYS, PAPER, agreeing, distance
from tests.bench.studies.sensitivity.placement import Clean, Hand, smooth_field
from tests.bench.studies.sensitivity.sensitivity_cases import BASE, Case, Value
from tests.bench.studies.sensitivity.sensitivity_factors import FactorsFile


@dataclass
class Found:
    """One hand's part: error maps by method and draw; depths of the strongest scatterer [repeats]
    by method."""

    maps: dict[tuple[str, int], ErrorMap] = field(default_factory=dict)
    strongest_m: dict[str, np.ndarray] = field(default_factory=dict)


class Measurement:
    """A benchmark whose paths start from `base`, what is varied, and the folder `work` in which
    echoes are kept."""

    def __init__(self, bench: BenchFile, base: Path, factors_file: FactorsFile, work: Path) -> None:
        self.bench, self.work, self.factors_file = bench, work, factors_file
        self.entries = paper_methods(bench)
        self.hands = {economies: self._hands(base, economies) for economies in (True, False)}
        self._images: dict[str, DepthMap] = {}

    def __call__(self, case: Case) -> Record:
        """The record of a setting: its figures (of several draws the mean, with standard deviation
        and range), their distance to the paper's and how many agree with them."""
        found = self.found(case)
        figures: dict[str, float | None] = {}
        spread: dict[str, float | None] = {}
        for family, entry in self.entries.items():
            maps = [[of.maps[family, draw] for of in found if of.maps] for draw in case.draws]
            draws = pd.DataFrame([mean_figures(of_captures(of_draw)) for of_draw in maps])
            for key in KEYS[:2]:
                name, values = f"{family}_{key}", draws[key].to_numpy(float)
                figures[name] = float(values.mean()) if np.isfinite(values).all() else None
                if len(values) > 1:
                    spread |= {
                        f"{name}_sd": deviation(values),
                        f"{name}_low": values.min(),
                        f"{name}_high": values.max(),
                    }
            if f"{family}_precision_mm" in PAPER and entry.precision:
                value = mean_deviation(
                    [of.strongest_m[family] for of in found if family in of.strongest_m]
                )
                figures[f"{family}_precision_mm"] = value and value[0]
                spread[f"{family}_precision_mm_sd"] = value and float(
                    value[0] / np.sqrt(2 * value[1])
                )
        broadband, fsk = figures.get(BROADBAND), figures.get(FSK)
        turned = None if broadband is None or fsk is None else broadband < fsk
        agree = agreeing(figures, self.factors_file.within_percent)
        near = {"distance": distance(figures), "agree": agree, "turned": turned}
        told = {"number": case.number, "name": case.name, "placement": case.placement}
        told["values"] = json.dumps(dict(case.values))
        factor = next(iter(case.values), "") if case.placement < 0 else ""
        return {**told, "factor": factor, **case.values, **figures, **spread, **near}

    def found(self, case: Case) -> list[Found]:
        """Every hand's part of a setting: each draw by each method is a job of its own, so that no
        core waits."""
        parts = [(Found(), hand, *self.prepared(hand, case)) for hand in self.hands[case.economies]]
        jobs = [
            partial(self._score, case, *part, family, draw)
            for family in sorted(
                self.entries, key=lambda family: "fsk" in family
            )  # what takes longest comes first
            for part in parts
            for draw in (case.draws if part[1].accuracy else ())
        ]
        jobs += [
            partial(self._repeat, case, *part[:3], family)
            for part in parts
            for family, entry in self.entries.items()
            if part[1].precision and entry.precision
        ]
        for_each(lambda job: job(), jobs)
        return [part[0] for part in parts]

    def prepared(self, hand: Hand, case: Case) -> tuple[Clean, dict[str, np.ndarray]]:
        """A hand's echoes without noise, and its true depth [ny, nx] on each method's grid."""
        clean = hand.clean(case.values, self.work)
        if not hand.accuracy:
            return clean, {}
        truths: dict[str, np.ndarray] = {}
        cast: dict[
            tuple[bytes, bytes], np.ndarray
        ] = {}  # methods that share a grid share its depth
        for family, entry in self.entries.items():
            x_m, y_m = grid_of(configured(entry, case, self.factors_file))
            grid = x_m.tobytes(), y_m.tobytes()
            if grid not in cast:
                cast[grid] = depth_on_grid(clean.surface, x_m, y_m)
            truths[family] = cast[grid]
        return clean, truths

    def _score(
        self,
        case: Case,
        found: Found,
        hand: Hand,
        clean: Clean,
        truths: dict[str, np.ndarray],
        family: str,
        draw: int,
    ) -> None:
        """One draw's errors of one hand by one method."""
        depth = self._depth(family, case, self._capture(hand, clean, case, [draw], draw), 0)
        reference_m = self._erring(truths[family], depth, case, (hand.file.seed, draw))
        found.maps[family, draw] = error_map(depth.x_m, depth.y_m, depth.z_m, reference_m)

    def _repeat(self, case: Case, found: Found, hand: Hand, clean: Clean, family: str) -> None:
        """The strongest scatterer's depths over a hand's repeats by one method."""
        first, count = case.draws[0] * self.bench.repeats, self.bench.repeats
        capture = self._capture(hand, clean, case, range(first, first + count), case.draws[0])
        depths = [self._depth(family, case, capture, frame) for frame in range(count)]
        found.strongest_m[family] = strongest_z_m(depths)

    def _capture(
        self, hand: Hand, clean: Clean, case: Case, frames: Sequence[int], draw: int
    ) -> RadarCapture:
        noise_rad = self.bench.phase_noise_rad
        noise_rad = hand.file.noise.between_tones_rad if noise_rad is None else noise_rad
        entry = self.entries.get("3fsk")
        config = (
            configured(entry, case, self.factors_file) if entry is not None else ThreeToneConfig()
        )
        assert isinstance(config, ThreeToneConfig)
        late_hz, seed = (config.f2_hz, config.f3_hz), hand.file.seed
        samples = [
            received(clean, case.values, noise_rad, late_hz, seed, frame, draw) for frame in frames
        ]
        return RadarCapture(np.stack(samples), clean.frequencies_hz, clean.array)

    def _depth(self, family: str, case: Case, capture: RadarCapture, frame: int) -> DepthMap:
        """A frame's depth map, smoothed where the setting says so."""
        entry, config = (
            self.entries[family],
            configured(self.entries[family], case, self.factors_file),
        )
        chosen, (samples, tones_hz) = method(entry.id), capture.tones(tones_of(config), frame)
        alone = thin_antennas(
            RadarCapture(samples[None], tones_hz, capture.aperture), entry.every_nth_antenna
        )
        depth = self._imaged(chosen, config, alone, case)
        size_px = int(case.values.get(f"{family}_filter_px", 1))
        return (
            depth
            if size_px == 1
            else DepthMap(**{**vars(depth), "z_m": masked_mean(depth.z_m, size_px)})
        )

    def _imaged(
        self, chosen: Method, config: Config, capture: RadarCapture, case: Case
    ) -> DepthMap:
        """The image of a capture's one frame, from the benchmark's own ones if it is among them."""
        if case.placement >= 0:
            return chosen.run(capture, config, 0).depth
        key = content_hash(
            chosen.id, config.model_dump(mode="json"), capture.samples, capture.frequencies_hz
        )
        depth = self._images.get(key)
        if depth is None:
            depth = chosen.run(capture, config, 0).depth
            if case.name == BASE:
                self._images[key] = depth
        return depth

    def _erring(
        self, truth_m: np.ndarray, depth: DepthMap, case: Case, seed: tuple[int, ...]
    ) -> np.ndarray:
        """The true depth [ny, nx] with the error of a reference that is not the truth."""
        sigma_m, bias_m = (
            float(case.values.get(name, 0.0)) for name in ("reference_error_m", "reference_bias_m")
        )
        if sigma_m:
            x_m, y_m = np.meshgrid(depth.x_m, depth.y_m)
            seen = np.isfinite(truth_m)
            error_m = np.zeros(truth_m.shape)
            points_m = np.stack([x_m[seen], y_m[seen]], axis=1)
            error_m[seen] = sigma_m * smooth_field(
                points_m, self.factors_file.reference_correlation_m, *seed
            )
            truth_m = truth_m + error_m
        return truth_m + bias_m

    def _hands(self, base: Path, economies: bool) -> list[Hand]:
        """The benchmark's scenes with the tones that its methods use. Raises HandbenchError where
        none measures the accuracy."""
        hands = []
        case = Case(0, BASE, economies=economies)
        for source in self.bench.capture:
            if source.scene is None:
                say(
                    f"sensitivity: {source.path} left out: it is recorded, and its factors are "
                    "as they are"
                )
                continue
            path = inside(base, source.scene, "capture.scene")
            file = load(SceneFile, path, "a scene description")
            accuracy, precise = ("accuracy" in source.measures), ("precision" in source.measures)
            used = [entry for entry in self.entries.values() if accuracy or entry.precision]
            configs = [configured(entry, case, self.factors_file) for entry in used]
            tones_hz = np.unique(np.concatenate([tones_of(config) for config in configs]))
            known = file.sensor.model_dump() | {"sweep": (), "tones_hz": tuple(tones_hz.tolist())}
            file = file.model_copy(update={"sensor": Sensor.model_validate(known)})
            hands.append(
                Hand(file, path, accuracy, precise, self.factors_file.roughness_correlation_m)
            )
            hands[-1].own({})
        if not any(hand.accuracy for hand in hands):
            raise HandbenchError(
                "sensitivity: the benchmark simulates no scene that measures the accuracy; add one"
            )
        return hands


def received(
    clean: Clean,
    values: Mapping[str, Value],
    noise_rad: float,
    late_hz: tuple[float, float],
    seed: int,
    frame: int,
    draw: int,
) -> np.ndarray:
    """Samples complex64 [f, t, r] of one frame of a scene with this seed. noise_rad: the
    benchmark's own; late_hz: f2 and f3, where phases are left; draw: which errors the antennas
    have, the same in all frames of a capture.

    Thermal noise is that of `handbench simulate`, draw for draw, and keeps its level where antennas
    err.
    """
    f, samples = clean.frequencies_hz, clean.samples
    phase_rad, gain_db = (
        float(values.get(name, 0.0)) for name in ("antenna_phase_rad", "antenna_gain_db")
    )
    if phase_rad or gain_db:
        tx, rx = (
            10 ** (gain_db * gain / 20) * np.exp(1j * phase_rad * phase)
            for gain, phase in (
                _normal(seed, f"antennas {leg}", draw, (2, n))
                for leg, n in enumerate(samples.shape[1:])
            )
        )
        samples = samples * (tx[:, None] * rx)
    turn_rad = (
        float(values.get("common_phase_rad", 0.0))
        / np.sqrt(2)
        * _normal(seed, "tones", frame, f.shape)
    )
    for name, tone_hz in zip(("f2_phase_rad", "f3_phase_rad"), late_hz, strict=True):
        turn_rad[f == tone_hz] += float(values.get(name, 0.0))
    if turn_rad.any():
        samples = samples * np.exp(1j * turn_rad)[:, None, None]
    sigma_rad = float(values.get("phase_noise_rad", noise_rad))
    samples = samples.astype(np.complex64, copy=False)
    if sigma_rad == 0:
        return samples
    return thermal_noise(
        samples, f, sigma_rad, clean.strongest, (seed, zlib.crc32(b"noise"), 0, frame)
    )


def _normal(seed: int, what: str, number: int, shape: tuple[int, ...]) -> np.ndarray:
    """Normal numbers that depend on nothing but these."""
    sequence = np.random.SeedSequence((seed, zlib.crc32(what.encode()), number))
    return np.random.default_rng(sequence).standard_normal(shape)
