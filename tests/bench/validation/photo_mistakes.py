"""Photographs of a board, drawn by a homography, whose cameras or board are told wrongly."""

import json
from pathlib import Path

import cv2
import numpy as np

PHOTO_MISTAKES = {  # → what `handbench inspect` has to say; nothing of right ones
    "right photographs": "",
    "width and height of cameras swapped": "exchange width and height",
    "board ten times too large": "ten times too large",
}
DICTIONARY = "DICT_4X4_50"


def photographs(folder: Path, seed: int, mistake: str) -> Path:
    """Three photographs of a random board from random places, with cameras.json and board.toml."""
    draw = np.random.default_rng(seed)
    side_m, columns, rows = draw.uniform(0.015, 0.06), *draw.integers(2, 5, 2)
    step_m = side_m * draw.uniform(1.25, 1.8)
    corners_m = [
        np.array([(0, 0, 0), (side_m, 0, 0), (side_m, -side_m, 0), (0, -side_m, 0)])
        + (step_m * c, -step_m * r, 0)
        for r in range(rows)
        for c in range(columns)
    ]
    width, height = int(draw.integers(900, 1400)), int(draw.integers(600, 880))
    if draw.random() < 0.3:
        width, height = height, width
    focal_px = float(draw.uniform(0.8, 1.8) * max(width, height))
    middle_m, extent_m = (
        np.mean(np.concatenate(corners_m), axis=0),
        np.ptp(np.concatenate(corners_m), axis=0).max(),
    )
    cameras = []
    for number in range(3):
        distance_m = max(draw.uniform(0.3, 1.0), 1.3 * extent_m * focal_px / min(width, height))
        R, _ = cv2.Rodrigues(draw.uniform(-0.5, 0.5, 3) * [1, 1, 0.3] + [np.pi, 0, 0])
        t = np.array([0, 0, distance_m]) - R @ middle_m
        picture = np.full((height, width), 200, np.uint8)
        K = np.array([[focal_px, 0, width / 2], [0, focal_px, height / 2], [0, 0, 1]])
        for id, quad_m in enumerate(corners_m):
            _draw(picture, id, quad_m @ R.T + t, K)
        noisy = cv2.GaussianBlur(picture, (0, 0), 0.8) + draw.normal(0, 3, picture.shape)
        name = f"cam{number:02d}.png"
        cv2.imwrite(str(folder / name), noisy.clip(0, 255).astype(np.uint8))
        size = (height, width) if mistake.startswith("width") else (width, height)
        params = [focal_px, focal_px, width / 2, height / 2, 0, 0, 0, 0]
        cameras.append(
            {"name": name, "width": size[0], "height": size[1], "model": "OPENCV", "params": params}
        )
    (folder / "cameras.json").write_text(json.dumps({"cameras": cameras}))
    scale = 10 if mistake.startswith("board") else 1
    lines = [f'dictionary = "{DICTIONARY}"']
    for id, quad_m in enumerate(corners_m):
        lines += ["[[marker]]", f"id = {id}", f"corners_m = {(scale * quad_m).tolist()}"]
    (folder / "board.toml").write_text("\n".join(lines) + "\n")
    return folder


def _draw(picture: np.ndarray, id: int, quad_m: np.ndarray, K: np.ndarray) -> None:
    """A marker with its white rim, seen from the origin along z."""
    marker = cv2.aruco.generateImageMarker(
        cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, DICTIONARY)), id, 240
    )
    print_ = cv2.copyMakeBorder(marker, 30, 30, 30, 30, cv2.BORDER_CONSTANT, value=255)
    pixels = quad_m @ K.T
    pixels = (pixels[:, :2] / pixels[:, 2:]).astype(np.float32) - 0.5
    corners = np.array([(30, 30), (270, 30), (270, 270), (30, 270)], np.float32) - 0.5
    onto = cv2.getPerspectiveTransform(corners, pixels)
    size = picture.shape[::-1]
    there = cv2.warpPerspective(np.full_like(print_, 255), onto, size)
    drawn = cv2.warpPerspective(print_, onto, size, flags=cv2.INTER_AREA)
    picture[there > 127] = drawn[there > 127]
