"""The trade-off's section on imaging: error and time of every setting; and the paper's claim that
3-FSK needs about a thousandth of broadband's operations, counted and measured.

Counted are complex multiplications, each with its addition, of the sums in the formulas. An image
at a point sums samples times phases over tones and channels (C = transmitters × receivers):

    broadband, narrowband   tones × voxels × C
    2-FSK                   2 × pixels × C for each pass of z_e; the paper makes 2
    3-FSK                   2-FSK, then 3 × points × C for each refinement; points: the pixels
                            above the threshold

The steps after the images (phases, filters, projection) do not sum over channels, take thousands of
times fewer operations, and are not counted. Fast imaging computes the same images with fewer
operations, which are not counted either. Ratios of times are measured in three
ways: exact sums for both methods (for the volume, a few planes, scaled), fast imaging for both, and
the exact volume against fast 3-FSK.
"""

import ctypes
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from functools import cache
from math import prod
from statistics import median
from typing import Any

import numpy as np
import pandas as pd

from handbench.bench.datasets.dataset import open_capture
from handbench.bench.evaluation.metrics import (
    HEADLINE,
    METRICS,
    Values,
    figure_interval,
    mean_figures,
    pool,
)
from handbench.bench.evaluation.scoring_protocols import protocol
from handbench.bench.pipeline.image import configuration, prepare
from handbench.bench.pipeline.score import pixel_errors, reference_of_file
from handbench.bench.results import Claim, Section, Setting
from handbench.bench.run.benchmark_file import MethodEntry
from handbench.bench.run.outcome import Outcome, RunCapture, common_subset, recorded_failure
from handbench.bench.run.sweep import ImagingSetting, imaging_settings, known_configs
from handbench.bench.tradeoff.settings import (
    MeasuredSection,
    TradeoffInputs,
    added_memory,
    in_rounds,
    line,
    section,
    timed,
)
from handbench.groundtruth.mesh.depth import Reference
from handbench.radar.data.depthmap import DepthMap
from handbench.radar.data.grid import PixelGrid, VoxelGrid
from handbench.radar.imaging.api import image_volume
from handbench.radar.imaging.plan import fresh_plans
from handbench.radar.methods.advice import requested_tones_hz
from handbench.radar.methods.fsk_config import AnyConfig, JointConfig, ThreeToneConfig
from handbench.radar.methods.projection_config import BroadbandConfig, ProjectionConfig
from handbench.radar.methods.registry import method
from handbench.radar.warmup import compile_kernels
from handbench.support.config import Config

PAPER = 1000.0
FSK, VOLUME = "3fsk", "broadband"
TEXT = "3-FSK takes about a thousandth of broadband backprojection"


def measure_imaging(inputs: TradeoffInputs) -> MeasuredSection:
    """Measure the error and the time of every imaging setting, on the captures that all of them can
    image.

    Settings and captures that fail are left out by the same rules as in the table of a run. Raises
    HandbenchError if nothing remains.
    """
    sweep, scored = inputs.sweep, protocol(inputs.bench.protocol)
    settings = {s.name: s for s in imaging_settings(sweep, known_configs(inputs.bench.method))}
    failures = list(inputs.found.failures)
    figures: dict[tuple[str, str], Values] = {}

    @cache
    def reference(capture: str, x_m: tuple[float, ...], y_m: tuple[float, ...]) -> Reference:
        """Return the reference's depths on the pixels x_m × y_m of a capture, computed once for
        each grid."""
        mesh, transform = inputs.found.references[capture][inputs.reference]
        grid = PixelGrid(np.array(x_m), np.array(y_m))
        return reference_of_file(mesh, transform, grid, exact=inputs.reference == "truth")

    def frames_of(setting: ImagingSetting) -> Iterator[dict[str, Any]]:
        """Yield the figures and times of the setting, as one dictionary for each capture that it
        can image. A capture that has failed is not tried again."""
        with fresh_plans():
            for capture in inputs.captures:
                key = capture.name, setting.name
                if key in {(failure.capture, failure.method) for failure in failures}:
                    continue
                with recorded_failure(failures, capture.name, "reconstruct", setting.name):
                    depth, times = _frame(capture, setting)
                    if key not in figures:  # it has them in the first round
                        on_grid = reference(capture.name, tuple(depth.x_m), tuple(depth.y_m))
                        figures[key] = pool(
                            [pixel_errors(depth, on_grid, scored, open_capture(capture.folder))]
                        )
                    yield {"capture": capture.name, **times, **figures[key]}

    compile_kernels()
    frames = in_rounds(
        settings, sweep.repeats, frames_of, "imaging", inputs.predicted_s.get("imaging", 0.0)
    )
    bench = inputs.bench.model_copy(
        update={"method": tuple(MethodEntry(id=name) for name in settings)}
    )
    on = common_subset(Outcome(bench, inputs.captures, [], failures))
    standing, names = (
        [settings[entry.id] for entry in on.methods],
        {capture.name for capture in on.captures},
    )
    first = next((s for s in standing if s.name == sweep.reference), standing[0])
    surface = "the true surface" if inputs.reference == "truth" else inputs.reference
    words = {"metric": METRICS[HEADLINE].definition, "surface": surface}
    about = section("imaging", first.name, words)
    lines = [_line(about, s, pd.DataFrame(frames[s.name]), names, sweep.step_s) for s in standing]
    facts: dict[str, Any] = {"basis": on.text}
    facts |= {"left_out": [failure.line for failure in failures]} if failures else {}
    return MeasuredSection(
        about, lines, facts, _claims(standing, lines, on.captures[0], inputs), tuple(standing)
    )


def _frame(capture: RunCapture, setting: ImagingSetting) -> tuple[DepthMap, dict[str, float]]:
    """Image a capture's first frame twice by a setting: (depth map, times and other numbers by
    name). The first image includes the preparation (plan) of fast imaging.

    seconds: time of the second image; plan_s: extra time of the first image; memory_mb: by how much
    the first image raised the resident memory; terms, tones: numbers of products and of tones in
    the sums.
    """
    config = configuration(capture.folder, setting.method, setting.config)
    echoes = open_capture(capture.folder).echoes(1)
    task = prepare(
        echoes, method(setting.method), config, every_nth_antenna=setting.every_nth_antenna
    )
    # only glibc returns memory that a frame could reuse without growing
    with suppress(OSError, AttributeError):
        ctypes.CDLL(None).malloc_trim(0)
    with added_memory() as cost:
        _, first_s = timed(task.image)
    result, seconds = timed(task.image)
    channels, tones = prod(task.echoes.aperture.channels), requested_tones_hz(config)
    return result.depth, {
        "seconds": seconds,
        "plan_s": max(first_s - seconds, 0.0),
        "memory_mb": cost.peak_memory_mb,
        "terms": images(config, np.isfinite(result.depth.z_m)) * channels,
        "tones": 0 if tones is None else len(tones),
    }


def _line(
    about: Section, setting: ImagingSetting, frames: pd.DataFrame, names: set[str], step_s: float
) -> Setting:
    """Make the row of a setting in the section's table from the results of its frames.

    names: the captures that count. A time is the median over the captures in each round, then over
    the rounds. For the plan, the longest time of a round is used instead, since captures may share
    a plan. step_s: time that the radar takes to record one tone.
    """
    used = frames[frames.capture.isin(names)]
    rounds = used.groupby("round")
    part = rounds[["seconds", "terms", "tones"]].median()
    captures, tones = used.drop_duplicates("capture"), int(part.tones.max())
    figures = mean_figures(captures[list(pool([]))].astype(float))
    knobs = {
        "method": setting.method,
        **setting.varied,
        "every_nth_antenna": setting.every_nth_antenna,
        "tones": tones,
    }
    return line(
        about,
        setting.name,
        setting.title,
        knobs,
        figures[HEADLINE],
        figure_interval(HEADLINE, captures[HEADLINE].to_numpy(float)),
        part.seconds.to_list(),
        seconds_low=float(part.seconds.min()),
        seconds_high=float(part.seconds.max()),
        acquisition_s=tones * step_s if tones else None,
        plan_s=float(rounds.plan_s.max().median()),
        operations=float(part.terms.median()) or None,
        peak_memory_mb=float(frames.memory_mb.max()),
        seen_percent=figures["observed_percent"],
    )


def _claims(
    settings: Sequence[ImagingSetting],
    lines: Sequence[Setting],
    capture: RunCapture,
    inputs: TradeoffInputs,
) -> tuple[Claim, ...]:
    """Measure how many times as long broadband backprojection takes as 3-FSK, which the paper
    claims to be about a thousand.

    The factor is measured with exact sums for both, with fast imaging for both, and with fast
    imaging for 3-FSK only: a claim for each, or none if the sweep lacks one of the methods. Exact
    sums are timed in turns on one capture; for the volume, only its middle planes are summed, and
    the time is scaled to all.
    """
    chosen = {id: s for id in (FSK, VOLUME) if (s := _most_accurate(settings, id)) is not None}
    if len(chosen) < 2:
        return ()
    fast_s = {
        id: next(line.seconds for line in lines if line.name == s.name) for id, s in chosen.items()
    }
    fsk, volume = (configuration(capture.folder, id, chosen[id].config) for id in (FSK, VOLUME))
    echoes, grid = open_capture(capture.folder).echoes(1), volume.grid()
    samples, frequencies_hz = echoes.tones(volume.tones_hz(), 0)
    depth = len(grid.z_m)
    planes = min(inputs.sweep.exact_planes, depth)
    start = (depth - planes) // 2
    part = VoxelGrid(grid.x_m, grid.y_m, grid.z_m[start : start + planes])
    work: dict[str, Callable[[], object]] = {
        FSK: lambda: method(FSK).run(echoes, fsk.model_copy(update={"tolerance": None}), 0),
        VOLUME: lambda: image_volume(samples, frequencies_hz, echoes.aperture, part, None),
    }
    sums = in_rounds(
        work, inputs.sweep.repeats, lambda one: [{"seconds": timed(one)[1]}], "exact sums"
    )
    exact_s = {id: median(line["seconds"] for line in lines) for id, lines in sums.items()}
    exact_s[VOLUME] *= depth / planes
    scaled = (
        f"exact broadband: {exact_s[VOLUME]:.0f} s, from {planes} of {depth} planes of "
        f"'{capture.name}', scaled; "
        f"exact 3-FSK: {exact_s[FSK]:.3g} s, measured whole"
    )
    engine = "the engine's times: " + "; ".join(
        f"{chosen[id].title}, {fast_s[id]:.3g} s" for id in (VOLUME, FSK)
    )
    count = (
        "counted: tones × voxels over images × pixels, every pixel on target; fewer are, so "
        "more is measured"
    )
    counted = counted_factor(volume, fsk)
    ways = (
        ("both by exact sums", exact_s[VOLUME] / exact_s[FSK], scaled),
        ("both by the fast engine", fast_s[VOLUME] / fast_s[FSK], engine),
        (
            "3-FSK by the engine against the exact volume",
            exact_s[VOLUME] / fast_s[FSK],
            f"{scaled}; {engine}",
        ),
    )
    return tuple(
        Claim(
            text=f"{TEXT}, {way}",
            paper=PAPER,
            counted=counted,
            measured=factor,
            note=f"{count}; {note}",
        )
        for way, factor, note in ways
    )


def _most_accurate(settings: Sequence[ImagingSetting], id: str) -> ImagingSetting | None:
    """Return the setting of a method with all antennas that has the fewest varied parameters and,
    among those, the finest tolerance; None if there is none."""
    own = [s for s in settings if s.method == id and s.every_nth_antenna == 1]
    return min(own, key=lambda s: (len(s.varied), s.config.get("tolerance", 0)), default=None)


def counted_factor(volume: BroadbandConfig, fsk: ThreeToneConfig) -> float:
    """Return how many times as many operations the exact sum of a volume needs as the paper's
    3-FSK, for which every pixel is above the threshold."""
    every = np.ones(fsk.grid().shape, bool)
    return images(volume, every) / images(fsk, every)


def images(config: Config, on_target: np.ndarray) -> int:
    """Return how many images at one point and tone the formulas of a method need, with all the
    passes that its configuration allows; 0 if it has none.

    on_target: mask [ny, nx] of the pixels above the threshold, at which further tones refine
    depths.
    """
    if isinstance(config, ProjectionConfig):
        return len(config.tones_hz()) * prod(config.grid().shape)
    if not isinstance(config, AnyConfig):
        return 0
    tones, refinements = len(config.ladder_hz), getattr(config, "fine_refinements", 0)
    each = tones if isinstance(config, JointConfig) else sum(range(3, tones + 1))
    return 2 * (1 + config.corrections) * on_target.size + refinements * each * int(on_target.sum())
