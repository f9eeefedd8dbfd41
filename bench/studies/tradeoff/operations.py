"""Operations by count: complex multiplications, each with its addition, of the sums as the formulas have them.

An image at a point sums samples times phases over tones and channels (C = transmitters × receivers):

    broadband, narrowband   tones × voxels × C
    2-FSK                   2 × pixels × C for each pass of z_e; the paper makes 2
    3-FSK                   2-FSK, then 3 × points × C for each refinement; points: the pixels above the threshold
    ladder of n tones       2-FSK, then Σ k × points × C over its rungs, k = 3 … n

What follows the images (phases, filters, projection) is no sum over channels, thousands of times less, and not counted.
What a frame has really summed, passes and points as the echoes brought them, `radar.imaging.api.watch` counts; the
engine reaches the same images with fewer operations, of which it keeps no count.
"""

from __future__ import annotations

from radar.methods.fsk_config import ThreeToneConfig
from radar.methods.projection import BroadbandConfig, NarrowbandConfig

PASSES = 2  # of z_e in the paper


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
