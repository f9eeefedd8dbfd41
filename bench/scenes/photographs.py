"""Photographs of a scene by ray casting: baked diffuse light and solid textures, seen through lens and sensor.

What real photographs add can be switched on: highlights, speckle, defocus, motion blur, spread of the exposures.
"""

from __future__ import annotations

import numpy as np

from bench.scenes.bodies import Body, bodies, texture_seed
from bench.scenes.file import Photos
from bench.scenes.highlights import mirrored
from bench.scenes.lamps import LAMPS, Light, bake, sunflower
from bench.scenes.lens import ThinLens, blur_along, blur_by_discs, near_edges
from bench.scenes.projector import Projector
from bench.scenes.scene import Scene
from bench.scenes.sensor import MOTION, develop, generator
from calibration.meshes import load_open3d
from groundtruth.cameras import Camera

ROOM = 0.03  # radiance of the dark room behind the stand
EDGE_STEP_M = 1.5e-3  # neighbouring pixels whose distance differs by more see an edge between them
EDGE_SAMPLES = 3  # sub-pixels per direction at an edge
LENS_SAMPLES = 64  # points of the aperture at an edge out of focus


class Studio:
    """A lit scene, ready to be photographed."""

    def __init__(self, scene: Scene) -> None:
        self.photos: Photos = scene.file.photos
        self.seed = scene.file.seed
        self.bodies = bodies(scene)
        photo_from_radar = scene.radar_from_photo.inverse()
        self.aim_m = photo_from_radar.points(scene.radar_from_target.translation_m[None])[0]
        self.projector = _projector(scene, photo_from_radar.points(np.array([self.photos.speckle_from_m]))[0], self.aim_m)
        o3d = load_open3d()
        self.rays = o3d.t.geometry.RaycastingScene()
        for body in self.bodies:
            self.rays.add_triangles(body.vertices_m.astype(np.float32), body.faces.astype(np.uint32))
        self.light = [bake(self.rays, body) for body in self.bodies]

    def photograph(self, camera: Camera, number: int) -> np.ndarray:
        """One photograph [height, width, 3] as 8-bit BGR (OpenCV's order); `number` seeds what is random about it."""
        import cv2

        photos = self.photos
        radiance = self.expose(camera)
        if photos.blur_px > 0:
            radiance = cv2.GaussianBlur(radiance, (0, 0), photos.blur_px)
        if photos.motion_px > 0:
            angle_rad = generator(self.seed, MOTION, number).uniform(0, np.pi)
            radiance = blur_along(radiance, photos.motion_px, angle_rad)
        return develop(radiance, photos, self.seed, number)[..., ::-1]

    def expose(self, camera: Camera) -> np.ndarray:
        """The light [height, width, 3] that falls onto a camera's pixels, before the sensor's own blur and noise."""
        directions = camera.ray_directions()
        radiance, distance_m, label = self.shoot(camera.centre_m, directions)
        edge = _edges(distance_m, label)
        radiance[edge] = self._supersample(camera.centre_m, directions, edge)
        if self.photos.f_number is None:
            return radiance
        lens = self.lens(camera)
        circle_px = lens.circle_px(distance_m * (directions @ camera.rotation[2]))
        near = near_edges(edge, circle_px / 2)
        radiance = blur_by_discs(radiance, circle_px)
        radiance[near] = self._through_lens(camera, lens, directions, near)
        return radiance

    def lens(self, camera: Camera) -> ThinLens:
        """The camera's lens when the photographs have a depth of field; it focuses on the target's origin unless told."""
        focus_m = self.photos.focus_m or float((self.aim_m - camera.centre_m) @ camera.rotation[2])
        return ThinLens.of(camera, self.photos.f_number, 1e-3 * self.photos.sensor_width_mm, focus_m)

    def shoot(self, origin_m: np.ndarray, directions: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Radiance [..., 3], distance [...] and the body's number [...] (-1: none) seen from the point `origin_m` [3]
        along `directions` [..., 3]."""
        hits = _cast(self.rays, np.broadcast_to(origin_m, directions.shape), directions)
        distance_m, label = hits["t_hit"], hits["geometry_ids"].astype(np.int64)
        label[~np.isfinite(distance_m)] = -1
        radiance = np.full(directions.shape, ROOM, dtype=np.float32)
        for number, (body, light) in enumerate(zip(self.bodies, self.light, strict=True)):
            seen = label == number
            points_m = origin_m + distance_m[seen, None].astype(np.float64) * directions[seen]
            uv = hits["primitive_uvs"][seen]
            weights = np.concatenate([1 - uv.sum(axis=1, keepdims=True), uv], axis=1)
            corners = body.faces[hits["primitive_ids"][seen]]
            radiance[seen] = self._shade(body, light, points_m, -directions[seen], corners, weights)
        return radiance, distance_m, label

    def _shade(
        self, body: Body, light: Light, points_m: np.ndarray, eyes: np.ndarray, corners: np.ndarray, weights: np.ndarray
    ) -> np.ndarray:
        """Radiance [n, 3] of a body's points [n, 3] towards `eyes` [n, 3]; `corners` and `weights` [n, 3] interpolate
        between the body's vertices."""
        shines, projector = body.skin and self.photos.highlights > 0, self.projector
        irradiance = np.einsum("ij,ij->i", light.irradiance[corners], weights)
        mirror = np.zeros((len(points_m), 1), dtype=np.float32)
        if shines or projector:
            normals = np.einsum("ijk,ij->ik", body.normals[corners], weights)
            normals /= np.linalg.norm(normals, axis=1, keepdims=True)
        if shines:
            for number, lamp in enumerate(LAMPS):
                unshadowed = np.einsum("ij,ij->i", light.open[:, number][corners], weights)
                shine = mirrored(points_m, normals, eyes, lamp.samples_m(), lamp.reach_m, self.photos.roughness)
                mirror[:, 0] += lamp.irradiance * unshadowed * shine
        if projector:
            even = body.board and not self.photos.speckle_on_board
            arriving, cosine = projector.light(self.rays, points_m, normals, even)
            irradiance = (1 - projector.contrast) * irradiance + arriving * cosine
            mirror *= 1 - projector.contrast
            if shines:
                at_m = projector.position_m[None]
                mirror[:, 0] += arriving * mirrored(points_m, normals, eyes, at_m, ..., self.photos.roughness)
        return body.albedo(points_m) * irradiance[:, None].astype(np.float32) + self.photos.highlights * mirror
