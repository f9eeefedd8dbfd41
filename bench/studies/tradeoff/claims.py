"""The paper's claim that 3-FSK needs about a thousandth of broadband's operations: counted, and measured.

Counted are complex multiplications, each with its addition, of the sums as the formulas have them. An image at a point
sums samples times phases over tones and channels (C = transmitters × receivers):

    broadband, narrowband   tones × voxels × C
    2-FSK                   2 × pixels × C for each pass of z_e; the paper makes 2
    3-FSK                   2-FSK, then 3 × points × C for each refinement; points: the pixels above the threshold
    ladder of n tones       2-FSK, then Σ k × points × C over its rungs, k = 3 … n

What follows the images (phases, filters, projection) is no sum over channels, thousands of times less, and not counted.
What a frame has really summed, passes and points as the echoes brought them, `radar.imaging.api.watch` counts; the
engine reaches the same images with fewer operations, of which it keeps no count. Measured is against two baselines: the
exact sum, of both methods alike and as a few planes of the volume, scaled; and this engine.
"""

from collections.abc import Callable, Sequence

import numpy as np

from handbench.bench.datasets.dataset import open_capture
from handbench.bench.pipeline.image import configuration
from handbench.bench.results import Claim, Setting
from handbench.bench.run.outcome import Capture
from handbench.bench.run.sweep import ImagingSetting
from handbench.bench.studies.tradeoff.measuring import in_turns
from handbench.radar.data.capture import RadarCapture
from handbench.radar.data.grid import VoxelGrid
from handbench.radar.imaging.api import image_volume
from handbench.radar.methods.fsk_config import ThreeToneConfig
from handbench.radar.methods.projection_config import BroadbandConfig, NarrowbandConfig
from handbench.radar.methods.registry import method
from handbench.support.config import Config

PAPER = 1000.0
PASSES = 2  # of z_e in the paper
FSK, VOLUME = "3fsk", "broadband"
TEXT = "3-FSK takes about a thousandth of broadband backprojection"


def claims(
    settings: Sequence[ImagingSetting], lines: Sequence[Setting], capture: Capture, planes: int, repeats: int
) -> tuple[Claim, ...]:
    """The claim by exact sums of both, by the engine, and by 3-FSK of the engine against the exact volume; none where
    the sweep lacks one of the two methods. Exact sums of one capture, in turns."""
    accurate = {id: _most_accurate(settings, id) for id in (FSK, VOLUME)}
    chosen = {id: setting for id, setting in accurate.items() if setting is not None}
    if len(chosen) < len(accurate):
        return ()
    configs = {id: configuration(capture.folder, id, s.config) for id, s in chosen.items()}
    seconds = {line.name: line.seconds for line in lines}
    fast_s = {id: seconds[s.name] for id, s in chosen.items()}
    counted = counted_factor(configs[VOLUME], configs[FSK])
    exact_s, depth = exact_seconds(configs, open_capture(capture.folder).echoes(1), planes, repeats)
    scaled = (
        f"exact broadband: {exact_s[VOLUME]:.0f} s, from {min(planes, depth)} of {depth} planes of '{capture.name}', "
        f"scaled; exact 3-FSK: {exact_s[FSK]:.3g} s, measured whole"
    )
    engine = "the engine's times: " + "; ".join(f"{chosen[id].title}, {fast_s[id]:.3g} s" for id in (VOLUME, FSK))
    count = "counted: tones × voxels over images × pixels, every pixel on target; fewer are, so more is measured"
    ways = (
        ("both by exact sums", exact_s[VOLUME] / exact_s[FSK], scaled),
        ("both by the fast engine", fast_s[VOLUME] / fast_s[FSK], engine),
        ("3-FSK by the engine against the exact volume", exact_s[VOLUME] / fast_s[FSK], f"{scaled}; {engine}"),
    )
    return tuple(
        Claim(text=f"{TEXT}, {way}", paper=PAPER, counted=counted, measured=factor, note=f"{count}; {note}")
        for way, factor, note in ways
    )


def exact_seconds(
    configs: dict[str, Config], echoes: RadarCapture, planes: int, repeats: int
) -> tuple[dict[str, float], int]:
    """Median seconds of exact 3-FSK and of the exact volume, from its middle `planes`; and how many planes it has."""
    fsk = configs[FSK].model_copy(update={"tolerance": None})
    grid, chosen = configs[VOLUME].grid(), method(FSK)
    samples, frequencies_hz = echoes.tones(configs[VOLUME].tones_hz(), 0)
    depth = len(grid.z_m)
    count = min(planes, depth)
    start = (depth - count) // 2
    part = VoxelGrid(grid.x_m, grid.y_m, grid.z_m[start : start + count])
    work: dict[str, Callable[[], object]] = {
        FSK: lambda: chosen.run(echoes, fsk, 0),
        VOLUME: lambda: image_volume(samples, frequencies_hz, echoes.aperture, part, None),
    }
    times, _ = in_turns(work, repeats, "exact sums")
    medians = {name: float(np.median(found)) for name, found in times.items()}
    return {**medians, VOLUME: medians[VOLUME] * depth / count}, depth


def _most_accurate(settings: Sequence[ImagingSetting], id: str) -> ImagingSetting | None:
    """The method's setting with all antennas that changes least: the finest tolerance of those with fewest knobs."""
    own = [s for s in settings if s.method == id and s.every_nth_antenna == 1]
    return min(own, key=lambda s: (len(s.varied), s.config.get("tolerance", 0)), default=None)


def volume_images(config: BroadbandConfig | NarrowbandConfig) -> int:
    """Tones × voxels: points that a volume's plain sum visits, tone by tone."""
    depth, height, width = config.grid().shape
    return len(config.tones_hz()) * depth * height * width


def three_tone_images(config: ThreeToneConfig) -> int:
    """Images × pixels of the paper's 3-FSK, every pixel above the threshold: 2 tones a pass, then 3."""
    height, width = config.grid().shape
    return (2 * PASSES + 3 * config.fine_refinements) * height * width


def counted_factor(volume: BroadbandConfig | NarrowbandConfig, fsk: ThreeToneConfig) -> float:
    """The terms of the volume over those of 3-FSK, at equal channels."""
    return volume_images(volume) / three_tone_images(fsk)
