"""A pilot of the matching of photographs: small windows about some points of the target, photographed by the cameras
that see them, and the depth at which each fits the other cameras' best. Nothing of photogrammetry is run."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from bench.scenes.lens import blur_by_discs
from bench.scenes.photo_sights import SHRINK, SOURCES, STEPS_PX, Sights
from bench.scenes.photographs import Studio
from bench.scenes.scene_file import Photos
from groundtruth.dense.dense import USUAL
from groundtruth.dense.fusion import AGREEMENT_PX
from groundtruth.dense.patchmatch import RADIUS, SIGMA_GRAY, SIGMA_PX

CONFIRMED = 2  # cameras that must agree on a point
SEARCH_PX, MOST_BLUR_PX = 7.0, 8.0  # of depth maps: a sheared window's reach and the search; blur that is allowed for
GRAY = np.array([0.114, 0.587, 0.299], dtype=np.float32) / 255  # of blue, green, red (ITU-R BT.601)


class Change(NamedTuple):
    """Movement of the mesh in mm, mean over points; shares of the points that matching loses and gains."""

    depth_mm: float
    lost: float
    gained: float


class Pilot:
    """The windows of a studio's target. Points and rays are the same for all effects."""

    def __init__(self, studio: Studio) -> None:
        self.studio = studio
        self.sights = Sights.of(studio, lambda points_m: SEARCH_PX + min(self._blur_px(points_m), MOST_BLUR_PX))
        self.size = int(np.sqrt(self.sights.rays.shape[1])) // SHRINK
        side, count = SHRINK * self.size, len(studio.scene.cameras)
        self.strips = [self.sights.rays[self.sights.camera == i].reshape(-1, side, 3) for i in range(count)]
        self.light: dict[tuple[float, float], list[tuple[np.ndarray, np.ndarray]]] = {}

    def change(self, before: Photos, after: Photos) -> Change:
        """The change of the mesh from photographs of the one kind to those of the other."""
        (first_mm, second_mm) = self.mesh_mm(before), self.mesh_mm(after)
        first, second = np.isfinite(first_mm), np.isfinite(second_mm)
        moved_mm = np.abs(second_mm - first_mm)[first & second]
        shares = (float(np.sum(some) / max(len(first), 1)) for some in (first & ~second, second & ~first))
        return Change(float(moved_mm.mean()) if len(moved_mm) else 0.0, *shares)

    def mesh_mm(self, photos: Photos) -> np.ndarray:
        """Height [points] over the true surface, mean over the cameras that agree; NaN where not enough of them do."""
        sights = self.sights
        shift_m, matched = self.match(self.photograph(photos))
        height_mm = np.full(sights.points, np.nan)
        for number in range(sights.points):
            mine = np.flatnonzero((sights.point == number) & matched)
            if len(mine):
                off_m = np.abs(shift_m[mine] - np.median(shift_m[mine]))
                mine = mine[off_m < AGREEMENT_PX * sights.pixel_m[mine]]
            if len(mine) >= CONFIRMED:
                height_mm[number] = -1e3 * np.mean(shift_m[mine] * sights.incidence[mine])
        return height_mm

    def photograph(self, photos: Photos) -> np.ndarray:
        """Grey patches [sights, size, size] at the depth maps' resolution. All of a camera's, one below the other, are
        photographed as one picture; edges between surfaces are not sampled as finely as a photograph's."""
        studio, parts = self.studio.taking(photos), [np.empty((0, self.size, self.size), dtype=np.float32)]
        key = photos.highlights, photos.speckle  # the effects on the light that leaves a surface
        shown = list(zip(studio.scene.cameras, self.strips, strict=True))
        if key not in self.light:
            self.light[key] = [studio.shoot(camera.centre_m, strip)[:2] for camera, strip in shown]
        for i, ((camera, strip), (radiance, distance_m)) in enumerate(zip(shown, self.light[key], strict=True)):
            if not len(strip):
                continue
            if (lens := studio.lens(camera)) is not None:
                radiance = blur_by_discs(radiance, lens.circle_px(distance_m * (strip @ camera.rotation[2])))
            gray = studio.record(radiance, i).astype(np.float32) @ GRAY
            parts.append(gray.reshape(-1, self.size, SHRINK, self.size, SHRINK).mean(axis=(2, 4)))
        return np.concatenate(parts)

    def match(self, gray: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Shift [sights] in metres along each camera's ray at which its window fits its sources best, by a parabola,
        and where it fits well enough: below the depth maps' highest cost, and not at an end of the search."""
        half = self.size // 2
        window = gray[:, half - RADIUS : half + RADIUS + 1, half - RADIUS : half + RADIUS + 1].reshape(len(gray), -1)
        off = np.arange(-RADIUS, RADIUS + 1) ** 2
        nearness = np.exp(-(off[:, None] + off).ravel() / (2 * SIGMA_PX**2))
        weights = nearness * np.exp(-np.abs(window - gray[:, half, half, None]) / SIGMA_GRAY)
        weights /= weights.sum(axis=1, keepdims=True)
        fits = [_correlation(window[:, None], self._sampled(gray, k), weights[:, None]) for k in range(SOURCES)]
        cost = 1 - np.mean(fits, axis=0)
        best = cost.argmin(axis=1)
        inside = best.clip(1, len(STEPS_PX) - 2)
        before, least, after = np.take_along_axis(cost, inside[:, None] + np.array([-1, 0, 1]), axis=1).T
        bend = np.maximum(before + after - 2 * least, 1e-9)
        steps_px = STEPS_PX[inside] + np.clip((before - after) / (2 * bend), -1, 1) * (STEPS_PX[1] - STEPS_PX[0])
        return steps_px * self.sights.step_m, (best == inside) & (least < USUAL.cost)

    def _sampled(self, gray: np.ndarray, k: int) -> np.ndarray:
        """What the k-th source of every sight shows at a window's places [sights, steps, window], bilinear."""
        column, row = np.moveaxis(self.sights.places[:, k].clip(0, self.size - 1.01), -1, 0)
        j, i = column.astype(np.int32), row.astype(np.int32)
        fu, fv, first = column - j, row - i, (self.sights.sources[:, k, None, None] * self.size + i) * self.size + j
        values, below = gray.ravel(), first + self.size
        top = values[first] + fu * (values[first + 1] - values[first])
        return top + fv * (values[below] + fu * (values[below + 1] - values[below]) - top)

    def _blur_px(self, points_m: np.ndarray) -> float:
        """About the farthest, in depth maps' pixels, that light of points [n, 3] reaches beside its own pixel."""
        photos, radius_px = self.studio.photos, 0.0
        for camera in self.studio.scene.cameras:
            lens = self.studio.lens(camera)
            if lens is not None and len(points_m):
                circle_px = lens.circle_px((points_m - camera.centre_m) @ camera.rotation[2])
                radius_px = max(radius_px, float(circle_px.max()) / 2)
        return (2 * photos.blur_px + photos.motion_px / 2 + radius_px) / SHRINK


def _correlation(one: np.ndarray, other: np.ndarray, weights: np.ndarray) -> np.ndarray:
    """Weighted normalised cross-correlation [...] of values [..., n]; 0 where one of them is flat."""
    one = one - (weights * one).sum(axis=-1, keepdims=True)
    other = other - (weights * other).sum(axis=-1, keepdims=True)
    power = (weights * one**2).sum(axis=-1) * (weights * other**2).sum(axis=-1)
    return np.where(power > 1e-14, (weights * one * other).sum(axis=-1) / np.sqrt(np.maximum(power, 1e-14)), 0)
