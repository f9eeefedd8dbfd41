"""A pilot of the matching of photographs: small windows about some points of the target, photographed by the cameras
that see them, and the depth at which each fits the other cameras' best. Nothing of photogrammetry is run.

`choose`: the effects that photographs show, how far each moves the mesh, and the selection of those that a scene calls
for.
"""

import time
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from scipy.ndimage import map_coordinates

from handbench.bench.scenes.lens import blur_by_discs
from handbench.bench.scenes.photographs import Studio
from handbench.bench.scenes.scene_file import Photos
from handbench.groundtruth.cameras.cameras import Camera
from handbench.groundtruth.dense.dense import USUAL
from handbench.groundtruth.dense.fusion import AGREEMENT_PX
from handbench.groundtruth.dense.patchmatch import RADIUS, SIGMA_GRAY, SIGMA_PX
from handbench.groundtruth.options import EFFORT
from handbench.radar.simulation.known_effects import Choice
from handbench.support.errors import HandbenchError
from handbench.support.rays import load_open3d

POINTS, TRIED, WINDOWS = 60, 600, 250  # points of the target, at most; candidates; pairs of point and camera, at most
FEWEST_CAMERAS, SOURCES, CONFIRMED = 3, 2, 2  # that see a point; that a window is looked for in; that must agree
SEES_M = 2e-4  # a ray that ends so near a point sees it
SHRINK = EFFORT["normal"].shrink  # photographs' pixels per pixel of a depth map
STEPS_PX = np.arange(-2, 2.01, 0.25)  # of disparity, in a depth map's pixels
HALF, SIZE = 10, 21  # of a patch, in these pixels: a sheared window, the search, and 3 for blur
GRAY = np.array([0.114, 0.587, 0.299], dtype=np.float32) / 255  # of blue, green, red (ITU-R BT.601)


class Change(NamedTuple):
    """Movement of the mesh in mm, mean over points; shares of the points that matching loses and gains."""

    depth_mm: float
    lost: float
    gained: float


class Pilot:
    """The windows of a studio's target, one a *sight*: a point (number `point` [n]) that a camera (`camera` [n]) sees
    at a cosine of incidence (`incidence` [n]). Points and rays are the same for all effects."""

    def __init__(self, studio: Studio) -> None:
        self.studio, self.light = studio, dict[tuple[float, float], list[tuple[np.ndarray, np.ndarray]]]()
        self.meshes_mm: dict[Photos, np.ndarray] = {}
        cameras = studio.scene.cameras
        points_m, normals, rays, distances_m, seen = _points(studio)
        self.shape = seen.shape  # points, cameras
        camera, point = self.camera, self.point = np.nonzero(seen.T)
        point_m, normal = points_m[point], normals[point]
        ray, distance_m = rays[point, camera], distances_m[point, camera]
        self.pixel_m = SHRINK * distance_m / np.array([one.params[0] for one in cameras])[camera]
        self.incidence = -(ray * normal).sum(axis=1)
        cosine = np.where((point[:, None] == point) & (camera[:, None] != camera), ray @ ray.T, -1)
        self.sources = np.argsort(-cosine, axis=1, kind="stable")[:, :SOURCES]
        # A step along the ray moves a point across the farther source's ray by a pixel.
        self.step_m = self.pixel_m / np.sqrt(1 - np.take_along_axis(cosine, self.sources, 1)[:, -1] ** 2)
        origin_px = SHRINK * (np.floor(_each(cameras, camera, point_m, Camera.project) / SHRINK) - HALF)[:, None]
        fine, window = np.arange(SHRINK * SIZE) + 0.5, SHRINK * (np.arange(HALF - RADIUS, HALF + RADIUS + 1) + 0.5)
        rays = _each(cameras, camera, origin_px + _square(fine), Camera.directions)
        self.strips = [rays[camera == i].reshape(-1, SHRINK * SIZE, 3) for i in range(len(cameras))]
        along = _each(cameras, camera, origin_px + _square(window), Camera.directions)
        slant = -self.incidence[:, None] / np.einsum("nwi,ni->nw", along, normal)  # to the tangent plane, which moves
        reach_m = (distance_m[:, None] + self.step_m[:, None] * STEPS_PX)[..., None] * slant[:, None]
        where_m = (point_m - distance_m[:, None] * ray)[:, None, None] + reach_m[..., None] * along[:, None]
        self.places = []  # numbers of patches, rows and columns [3, n, steps, window] in each of the sources
        for sight in self.sources.T:
            at_px = _each(cameras, camera[sight], where_m, Camera.project) - origin_px[sight, None]
            column, row = np.moveaxis(at_px / SHRINK - 0.5, -1, 0).clip(0, SIZE - 1)
            self.places.append(np.stack(np.broadcast_arrays(sight[:, None, None], row, column)))

    def change(self, before: Photos, after: Photos) -> Change:
        """The change of the mesh from photographs of the one kind to those of the other."""
        for photos in {before, after} - self.meshes_mm.keys():
            self.meshes_mm[photos] = self.mesh_mm(photos)
        first_mm, second_mm = self.meshes_mm[before], self.meshes_mm[after]
        first, second = np.isfinite(first_mm), np.isfinite(second_mm)
        moved_mm = np.abs(second_mm - first_mm)[first & second].sum() / max(np.sum(first & second), 1)
        return Change(float(moved_mm), float(np.mean(first & ~second)), float(np.mean(second & ~first)))

    def mesh_mm(self, photos: Photos) -> np.ndarray:
        """Height [points] over the true surface, mean over the cameras that agree; NaN where not enough of them do."""
        shift_m, matched = self.match(self.photograph(photos))
        at = self.point[matched], self.camera[matched]
        shift_px, height_mm, median_px = np.full(self.shape, np.nan), np.zeros(self.shape), np.zeros(self.shape[0])
        shift_px[at] = (shift_m / self.pixel_m)[matched]
        height_mm[at] = -1e3 * (shift_m * self.incidence)[matched]
        median_px[at[0]] = np.nanmedian(shift_px[at[0]], axis=1)
        agreed = np.abs(shift_px - median_px[:, None]) < AGREEMENT_PX
        enough = agreed.sum(axis=1) >= CONFIRMED
        return np.where(enough, (height_mm * agreed).sum(axis=1) / np.maximum(agreed.sum(axis=1), 1), np.nan)

    def photograph(self, photos: Photos) -> np.ndarray:
        """Grey patches [n, SIZE, SIZE] at the depth maps' resolution. All of a camera's, one below the other, are
        photographed as one picture; edges between surfaces are not sampled as finely as a photograph's."""
        studio, patches = self.studio.taking(photos), list[np.ndarray]()
        key = photos.highlights, photos.speckle  # the effects on the light that leaves a surface
        shown = list(zip(studio.scene.cameras, self.strips, strict=True))
        if key not in self.light:
            self.light[key] = [studio.shoot(camera.centre_m, strip)[:2] for camera, strip in shown]
        for number, ((camera, strip), (radiance, distance_m)) in enumerate(zip(shown, self.light[key], strict=True)):
            if len(strip):
                if (lens := studio.lens(camera)) is not None:
                    radiance = blur_by_discs(radiance, lens.circle_px(distance_m * (strip @ camera.rotation[2])))
                gray = studio.record(radiance, number).astype(np.float32) @ GRAY
                patches.append(gray.reshape(-1, SIZE, SHRINK, SIZE, SHRINK).mean(axis=(2, 4)))
        return np.concatenate(patches)

    def match(self, gray: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Shift [n] in metres along each camera's ray at which its window fits its sources best, by a parabola, and
        where it fits well enough: below the depth maps' highest cost, and not at an end of the search."""
        middle = slice(HALF - RADIUS, HALF + RADIUS + 1)
        window = gray[:, middle, middle].reshape(len(gray), -1)
        nearness = np.exp(-(_square(np.arange(-RADIUS, RADIUS + 1)) ** 2).sum(axis=1) / (2 * SIGMA_PX**2))
        weights = nearness * np.exp(-np.abs(window - gray[:, HALF, HALF, None]) / SIGMA_GRAY)
        weights /= weights.sum(axis=1, keepdims=True)
        sampled = (map_coordinates(gray, place, order=1) for place in self.places)
        cost = 1 - np.mean([_correlation(window[:, None], values, weights[:, None]) for values in sampled], axis=0)
        best = cost.argmin(axis=1)
        inside = best.clip(1, len(STEPS_PX) - 2)
        before, least, after = np.take_along_axis(cost, inside[:, None] + np.array([-1, 0, 1]), axis=1).T
        offset = (before - after) / (2 * np.maximum(before + after - 2 * least, 1e-9))
        steps_px = STEPS_PX[inside] + offset.clip(-1, 1) * (STEPS_PX[1] - STEPS_PX[0])
        return steps_px * self.step_m, (best == inside) & (least < USUAL.cost)


def _points(studio: Studio) -> tuple[np.ndarray, ...]:
    """Points [n, 3] and normals [n, 3] of the target in the crop box, drawn by area; the cameras' rays [n, cameras, 3]
    and distances [n, cameras] to them, and which cameras, enough each, see them under an angle that depth maps keep."""
    body, cameras, (low_m, high_m) = studio.bodies[0], studio.scene.cameras, studio.scene.box_m
    corners_m = body.vertices_m[body.faces]
    cross = np.cross(corners_m[:, 1] - corners_m[:, 0], corners_m[:, 2] - corners_m[:, 0])
    centre_m, area = corners_m.mean(axis=1), np.linalg.norm(cross, axis=1)
    share = np.where(((centre_m > low_m) & (centre_m < high_m)).all(axis=1), area, 0)
    drawn = np.random.default_rng(studio.seed).choice(len(area), TRIED, p=share / share.sum())
    points_m, normals = centre_m[drawn], cross[drawn] / area[drawn, None]
    origins_m = np.array([camera.centre_m for camera in cameras])
    distance_m = np.linalg.norm(points_m[:, None] - origins_m, axis=2)
    rays = (points_m[:, None] - origins_m) / distance_m[..., None]
    query = np.concatenate([np.broadcast_to(origins_m, rays.shape), rays], axis=2, dtype=np.float32)
    seen = studio.rays.cast_rays(load_open3d().core.Tensor(query))["t_hit"].numpy() > distance_m - SEES_M
    seen &= -np.einsum("pci,pi->pc", rays, normals) > USUAL.cosine
    for camera, sees in zip(cameras, seen.T, strict=True):
        pixels = camera.project(points_m)
        sees &= ((pixels > 0) & (pixels < (camera.width, camera.height))).all(axis=1)
    kept = np.flatnonzero(seen.sum(axis=1) >= FEWEST_CAMERAS)[:POINTS]
    kept = kept[np.cumsum(seen[kept].sum(axis=1)) <= WINDOWS]
    if not len(kept):
        raise HandbenchError(f"photos.cameras: no {FEWEST_CAMERAS} of them see the same point of the target; take more")
    return points_m[kept], normals[kept], rays[kept], distance_m[kept], seen[kept]


def _square(along: np.ndarray) -> np.ndarray:
    """Columns and rows [n², 2] of a square from those along a side [n]."""
    return np.stack(np.meshgrid(along, along), axis=-1).reshape(-1, 2)


def _each(
    cameras: tuple[Camera, ...], camera: np.ndarray, values: np.ndarray, ask: Callable[[Camera, np.ndarray], np.ndarray]
) -> np.ndarray:
    """The answers [n, ..., k] of every sight's own camera [n] to values [n, ..., j]."""
    answers = [ask(cameras[i], values[camera == i].reshape(-1, values.shape[-1])) for i in np.unique(camera)]
    order = np.argsort(camera, kind="stable")
    return np.concatenate(answers).reshape(*values.shape[:-1], -1)[np.argsort(order)]


def _correlation(one: np.ndarray, other: np.ndarray, weights: np.ndarray) -> np.ndarray:
    """Weighted normalised cross-correlation [...] of values [..., n]; 0 where one of them is flat."""
    one, other = (values - (weights * values).sum(axis=-1, keepdims=True) for values in (one, other))
    power = (weights * one**2).sum(axis=-1) * (weights * other**2).sum(axis=-1)
    return np.where(power > 1e-14, (weights * one * other).sum(axis=-1) / np.sqrt(np.maximum(power, 1e-14)), 0)


PREFIX = "photos."  # before the name of an effect, in tables
BY_CHANCE = 0.03  # of the points, one of 40: matched or not by a hair
WITHOUT: dict[str, dict[str, Any]] = {
    "highlights": {"highlights": 0.0},
    "speckle": {"speckle": 0.0},
    "defocus": {"f_number": None},
    "blur": {"blur_px": 0.0},
    "motion": {"motion_px": 0.0},
    "exposure": {"exposure_spread": 0.0},
    "white_balance": {"white_balance_spread": 0.0},
    "noise": {"full_well_e": 1e12, "read_noise_e": 0.0},  # far below a step of 8 bits
}


def without(photos: Photos, *effects: str) -> Photos:
    """The photographs without some effects."""
    return photos.model_copy(update={key: value for name in effects for key, value in WITHOUT[name].items()})


def choose(studio: Studio, explain: bool = False) -> tuple[Photos, tuple[Choice, ...]]:
    """The photographs to take, and every effect's row. explain: give estimates where none is asked for, too."""
    photos, started_s = studio.photos, time.process_time()
    changes: dict[str, Change] = {}
    rows: list[Choice] = []
    if explain or photos.effects == "auto":
        try:
            pilot = Pilot(studio)
            there = (name for name in WITHOUT if without(photos, name) != photos)
            changes = {name: pilot.change(without(photos, name), photos) for name in there}
            why = f"estimates of {pilot.shape[0]} points, {len(pilot.point)} windows; seconds of the processor"
        except HandbenchError as error:
            why = f"no estimates; {error}"
        rows.append(Choice(effect="photos", on=True, why=why, seconds=time.process_time() - started_s))
    left_out = _negligible(changes, photos.tolerance_mm) if photos.effects == "auto" else {}
    rows += [_row(name, photos, changes.get(name), left_out.get(name, "")) for name in WITHOUT]
    return without(photos, *left_out), tuple(rows)


def _negligible(changes: dict[str, Change], tolerance_mm: float) -> dict[str, str]:
    """Effects that may be left out, and why: the smallest, while their sum stays below the tolerance; none that
    decides whether points are matched at all."""
    result, spent_mm = dict[str, str](), 0.0
    for name, change in sorted(changes.items(), key=lambda item: item[1].depth_mm):
        if change.lost + change.gained <= BY_CHANCE:
            spent_mm += change.depth_mm
            if spent_mm < tolerance_mm:
                result[name] = f"with all that is smaller {spent_mm:.4f} of {tolerance_mm:g} mm"
    return result


def _row(name: str, photos: Photos, change: Change | None, left_out: str) -> Choice:
    if without(photos, name) == photos:
        return Choice(effect=PREFIX + name, on=False, why=f"needs photos.{next(iter(WITHOUT[name]))}")
    why = left_out or ("called for" if photos.effects == "auto" else "all that are named are on")
    if change is None:
        return Choice(effect=PREFIX + name, on=True, why=why)
    why += f" (windows matched with and without: {100 * change.lost:.0f} % lost, {100 * change.gained:.0f} % gained)"
    percent = 100 * (change.lost + change.gained)
    return Choice(effect=PREFIX + name, on=not left_out, why=why, depth_mm=change.depth_mm, pixels_percent=percent)
