"""Corners of black squares on white, where their edges meet.

A corner detector finds the corner of a blurred square inside it, and a photograph's tone curve (sRGB) shifts every
edge into the dark: together half a pixel. A straight line through the middle of an edge's slope has neither error,
once the tones are proportional to light.
"""

import cv2
import numpy as np

REACHES_PX = (4.0, 3.0)  # across the edge, first and second pass
REACH = 1 / 8  # at most, of the shortest side: a marker's border is 1/6 to 1/12 of it
INNER = 0.1  # of an edge, at either end: there the blur mixes in the other edge
STEP_PX = 0.5
FAINTEST = 0.5  # of the typical slope along the edge
CLEAR = 0.6  # of the edge's length that must lie on the line
STRAIGHT_PX = 0.25  # median distance from the line


def to_light(tones: np.ndarray) -> np.ndarray:
    """sRGB tones in 0 … 1 as amounts of light in 0 … 1 (IEC 61966-2-1), float32."""
    return np.where(tones < 0.04045, tones / 12.92, ((tones + 0.055) / 1.055) ** 2.4).astype(np.float32)


def refined(light: np.ndarray, quad: np.ndarray) -> np.ndarray:
    """The corners [4, 2] of a dark square on white as indices (column, row), clockwise, from a guess `quad` within two
    pixels or so; NaN beside an edge that is covered, faint or not straight. light [height, width] float32."""
    for reach_px in REACHES_PX:
        reach_px = min(reach_px, REACH * np.linalg.norm(quad - np.roll(quad, -1, axis=0), axis=1).min())
        edges = [_edge(light, a, b, reach_px) for a, b in zip(quad, np.roll(quad, -1, axis=0), strict=True)]
        quad = np.array([_crossing(edges[k - 1], edges[k]) for k in range(4)])
        if np.isnan(quad).any():
            break
    return quad


def _edge(light: np.ndarray, a: np.ndarray, b: np.ndarray, reach_px: float) -> tuple[np.ndarray, np.ndarray] | None:
    """A point [2] on the edge from about a to about b, and its direction [2]; light grows to its left."""
    length_px = np.linalg.norm(b - a)
    along = (b - a) / length_px
    across = np.array([along[1], -along[0]])
    t = np.linspace(INNER, 1 - INNER, max(8, int(length_px))) * length_px
    s = np.arange(-reach_px, reach_px + STEP_PX / 2, STEP_PX)
    at = (a + t[:, None, None] * along + s[:, None] * across).astype(np.float32)
    profile = cv2.remap(light, at[..., 0], at[..., 1], cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    slope = np.clip(np.diff(profile, axis=1), 0, None)
    height = slope.sum(axis=1)
    offset = slope @ ((s[1:] + s[:-1]) / 2) / np.maximum(height, 1e-6)
    clear = on_line = height > FAINTEST * np.median(height)
    for _ in range(3):
        if on_line.sum() < CLEAR * len(t):
            return None
        tilt, middle = np.polyfit(t[on_line], offset[on_line], 1)
        distance = np.abs(offset - tilt * t - middle)
        typical = np.median(distance[on_line])
        on_line = clear & (distance <= 4 * typical + 1e-3)
    return None if typical > STRAIGHT_PX else (a + middle * across, along + tilt * across)


def _crossing(first: tuple[np.ndarray, np.ndarray] | None, second: tuple[np.ndarray, np.ndarray] | None) -> np.ndarray:
    """Intersection [2] of two lines; NaN when one is missing."""
    if first is None or second is None:
        return np.full(2, np.nan)
    (p, u), (q, v) = first, second
    return p + np.linalg.solve(np.stack([u, -v], axis=1), q - p)[0] * u
