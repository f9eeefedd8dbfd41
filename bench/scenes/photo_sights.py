"""Points of a target and the cameras that see them: the rays of small patches about the points, and where a window in
one camera's patch lies in others' when the surface moves along the ray."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from bench.scenes.photographs import Studio
from groundtruth.cameras.cameras import Camera
from groundtruth.dense.dense import USUAL
from groundtruth.dense.patchmatch import RADIUS
from groundtruth.options import EFFORT
from radar.support.rays import load_open3d

POINTS, TRIED = 60, 600  # points of the target; candidates for them
FEWEST_CAMERAS, SOURCES = 3, 2  # that see a point; that a window is looked for in
SHRINK = EFFORT["normal"].shrink  # photographs' pixels per pixel of a depth map
STEPS_PX = np.arange(-2, 2.01, 0.25)  # of disparity, in a depth map's pixels
SEES_M, PROBE_M = 2e-4, 1e-4  # a ray that ends so near a point sees it; a small movement


@dataclass(frozen=True)
class Sights:
    """One line a pair of point and camera that sees it: numbers of both [n]; sources [n, SOURCES], the lines of other
    cameras in which its window is looked for; rays [n, side², 3] of its patch; places [n, SOURCES, steps, window, 2]:
    column and row in the sources' patches, in depth maps' pixels, where its window would lie; step_m [n]: along the
    ray, of a disparity of one pixel; pixel_m [n]: a pixel's size; incidence [n], cosine. points: their number."""

    points: int
    point: np.ndarray
    camera: np.ndarray
    sources: np.ndarray
    rays: np.ndarray
    places: np.ndarray
    step_m: np.ndarray
    pixel_m: np.ndarray
    incidence: np.ndarray

    @classmethod
    def of(cls, studio: Studio, reach_px: Callable[[np.ndarray], float]) -> Sights:
        """The sights of points drawn evenly over what enough cameras see; reach_px: of the patches beside their middle
        pixel, in depth maps' pixels, from the points [n, 3]."""
        cameras = studio.scene.cameras
        points_m, normals, seen = _points(studio)
        camera, point = np.nonzero(seen.T)
        half = int(np.ceil(reach_px(points_m)))
        point_m, normal = points_m[point], normals[point]
        to_m = point_m - np.array([c.centre_m for c in cameras])[camera]
        distance_m = np.linalg.norm(to_m, axis=1)
        ray = to_m / distance_m[:, None]
        likeness = np.where((point[:, None] == point) & (camera[:, None] != camera), ray @ ray.T, -2)
        sources = np.argsort(-likeness, axis=1, kind="stable")[:, :SOURCES]
        at_px = _each(cameras, camera, point_m, Camera.project)
        origin_px = SHRINK * (np.floor(at_px / SHRINK) - half)
        fine = _grid(np.arange(SHRINK * (2 * half + 1)) + 0.5)
        window = SHRINK * _grid(np.arange(half - RADIUS, half + RADIUS + 1) + 0.5)
        along = _each(cameras, camera, origin_px[:, None] + window, Camera.directions)
        probed = point_m + PROBE_M * ray
        moved_px = [_each(cameras, camera[s], probed, Camera.project) - at_px[s] for s in sources.T]
        step_m = PROBE_M * SHRINK / np.linalg.norm(moved_px, axis=-1).max(axis=0)
        ahead_m = distance_m[:, None] + step_m[:, None] * STEPS_PX  # to the tangent plane, moved
        slant = (ray * normal).sum(axis=1)[:, None] / np.einsum("nwi,ni->nw", along, normal)
        origin_m = (point_m - to_m)[:, None, None]
        where_m = origin_m + (ahead_m[..., None] * slant[:, None])[..., None] * along[:, None]
        places = [_each(cameras, camera[s], where_m, Camera.project) - origin_px[s][:, None, None] for s in sources.T]
        return cls(
            points=len(points_m),
            point=point,
            camera=camera,
            sources=sources,
            rays=_each(cameras, camera, origin_px[:, None] + fine, Camera.directions),
            places=(np.stack(places, axis=1) / SHRINK - 0.5).astype(np.float32),
            step_m=step_m,
            pixel_m=SHRINK * distance_m / np.array([c.params[0] for c in cameras])[camera],
            incidence=-(ray * normal).sum(axis=1),
        )


def _points(studio: Studio) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Points [n, 3] and normals [n, 3] of the target in the crop box, and the cameras that see them [n, cameras], each
    by enough of them, and under an angle at which depth maps keep them."""
    body, cameras, box_m = studio.bodies[0], studio.scene.cameras, studio.scene.box_m
    corners_m = body.vertices_m[body.faces]
    cross = np.cross(corners_m[:, 1] - corners_m[:, 0], corners_m[:, 2] - corners_m[:, 0])
    centre_m, area = corners_m.mean(axis=1), np.linalg.norm(cross, axis=1)
    share = np.where(((centre_m > box_m[0]) & (centre_m < box_m[1])).all(axis=1), area, 0)
    drawn = np.random.default_rng(studio.seed).choice(len(area), TRIED, p=share / share.sum())
    points_m, normals = centre_m[drawn], cross[drawn] / area[drawn, None]
    seen = np.empty((TRIED, len(cameras)), dtype=bool)
    for number, camera in enumerate(cameras):
        to_m = points_m - camera.centre_m
        distance_m = np.linalg.norm(to_m, axis=1)
        ray = to_m / distance_m[:, None]
        query = np.concatenate([np.broadcast_to(camera.centre_m, ray.shape), ray], axis=1).astype(np.float32)
        hit_m = studio.rays.cast_rays(load_open3d().core.Tensor(query))["t_hit"].numpy()
        pixels = camera.project(points_m)
        inside = ((pixels > 0) & (pixels < (camera.width, camera.height))).all(axis=1)
        seen[:, number] = inside & (hit_m > distance_m - SEES_M) & (-(ray * normals).sum(axis=1) > USUAL.cosine)
    kept = np.flatnonzero(seen.sum(axis=1) >= FEWEST_CAMERAS)[:POINTS]
    return points_m[kept], normals[kept], seen[kept]


def _grid(along: np.ndarray) -> np.ndarray:
    """Columns and rows [n², 2] of a square."""
    return np.stack(np.meshgrid(along, along), axis=-1).reshape(-1, 2)


def _each(
    cameras: tuple[Camera, ...], number: np.ndarray, values: np.ndarray, ask: Callable[[Camera, np.ndarray], np.ndarray]
) -> np.ndarray:
    """The answers [n, ..., k] of each line's own camera to values [n, ..., j]."""
    asked = [(number == i, camera) for i, camera in enumerate(cameras) if (number == i).any()]
    found = [(mine, ask(camera, values[mine].reshape(-1, values.shape[-1]))) for mine, camera in asked]
    result = np.empty((*values.shape[:-1], found[0][1].shape[-1] if found else values.shape[-1]))
    for mine, answers in found:
        result[mine] = answers.reshape(-1, *result.shape[1:])
    return result
