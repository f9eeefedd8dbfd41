"""Draw the figure of docs/hand.md: python docs/letters.py OUT.png [LETTERS [EDGE_MM [PANEL_PX]]]

It shows the hand as it signs each letter for which handbench has a pose (or the named letters, such
as "AEG"), as the radar sees it, centred and on one scale.
"""

from __future__ import annotations

import sys
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from PIL import Image, ImageDraw, ImageFont

from handbench.bench.scenes.hand import hand_mesh
from handbench.bench.scenes.hand_pose import POSES, Pose
from handbench.groundtruth.mesh.mesh_files import load_open3d, raycasting_scene

if TYPE_CHECKING:
    import open3d as o3d

COLUMNS = 6
PALM_M = (0.0, -0.030, 0.310)  # as in the scenes
HEIGHT_M = 0.255  # of a panel at the palm's distance
WIDTH_TO_HEIGHT = 0.95
SKIN, GROUND = np.array([226.0, 178.0, 150.0]), np.array([30.0, 32.0, 36.0])
LIGHTS = (  # towards each lamp, and its strength
    ((0.35, 0.60, -0.60), 0.50),
    ((-0.55, 0.25, -0.40), 0.22),
    ((0.0, 0.0, -1.0), 0.22),
)
AMBIENT = 0.24
BIAS_M = 3e-4  # a facet does not shadow itself
SUPERSAMPLED = 2


def middle_m(surface: o3d.geometry.TriangleMesh) -> np.ndarray:
    """Return the middle (x, y), metres, of a mesh as seen from the centre of the array, projected
    onto the plane at the distance of the palm."""
    vertices = np.asarray(surface.vertices)
    on_plane = PALM_M[2] * vertices[:, :2] / vertices[:, 2:]
    return (on_plane.min(axis=0) + on_plane.max(axis=0)) / 2


def rays(centre_m: np.ndarray, width: int, height: int, height_m: float = HEIGHT_M) -> np.ndarray:
    """Return rays [height, width, 6] (origin, direction) from the centre of the array, one for each
    pixel of a panel.
    centre_m [2]: middle of the panel in the plane at the distance of the palm, metres; width,
    height: pixels; height_m: height of the panel in that plane. x grows to the left, as seen along
    +z."""
    x = centre_m[0] - height_m * ((np.arange(width) + 0.5) - width / 2) / height
    y = centre_m[1] - height_m * ((np.arange(height) + 0.5) / height - 0.5)
    directions = np.stack([*np.meshgrid(x, y), np.full((height, width), PALM_M[2])], axis=-1)
    directions /= np.linalg.norm(directions, axis=-1, keepdims=True)
    return np.concatenate([np.zeros_like(directions), directions], axis=-1).astype(np.float32)


def shade(
    surface: o3d.geometry.TriangleMesh, width: int, height: int, height_m: float = HEIGHT_M
) -> np.ndarray:
    """Draw a mesh in the radar frame, lit by lamps with shadows and by ambient light. Returns a
    picture [height, width, 3] with RGB values from 0 to about 255.
    width, height: of the picture, pixels; height_m: its height at the distance of the palm,
    metres."""
    tensor = load_open3d().core.Tensor
    scene, query = raycasting_scene(surface), rays(middle_m(surface), width, height, height_m)
    hits = {key: value.numpy() for key, value in scene.cast_rays(tensor(query)).items()}
    seen = np.isfinite(hits["t_hit"])
    corners = np.asarray(surface.vertex_normals)[
        np.asarray(surface.triangles)[hits["primitive_ids"][seen]]
    ]
    uv = hits["primitive_uvs"][seen]
    weights = np.concatenate([1 - uv.sum(axis=1, keepdims=True), uv], axis=1)
    normals = np.einsum("ij,ijk->ik", weights, corners)
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    points = hits["t_hit"][seen, None] * query[seen][:, 3:] + BIAS_M * normals
    light = AMBIENT * (1 + 0.6 * normals[:, 1]) * (0.35 - 0.65 * np.minimum(normals[:, 2], 0))
    for towards, strength in LIGHTS:
        unit = np.array(towards) / np.linalg.norm(towards)
        beams = np.hstack([points, np.broadcast_to(unit, points.shape)]).astype(np.float32)
        clear = ~scene.test_occlusions(tensor(beams)).numpy()
        light += strength * clear * np.maximum(normals @ unit, 0)
    picture = np.broadcast_to(GROUND, (height, width, 3)).copy()
    picture[seen] = SKIN * np.minimum(light, 1.1)[:, None]
    return picture


def panel(name: str, pose: Pose, edge_m: float, height: int) -> Image.Image:
    """Draw the hand of one letter, with the letter's name.
    edge_m: edges of the mesh, metres; height: of the picture, pixels."""
    surface = hand_mesh(pose, edge_m).translate(PALM_M)
    width = int(WIDTH_TO_HEIGHT * height)
    picture = np.clip(shade(surface, SUPERSAMPLED * width, SUPERSAMPLED * height), 0, 255).astype(
        np.uint8
    )
    image = Image.fromarray(picture).resize((width, height), Image.Resampling.BOX)
    ImageDraw.Draw(image).text(
        (8, 4), name, fill=(235, 215, 200), font=ImageFont.load_default(height // 8)
    )
    return image


def sheet(panels: list[Image.Image]) -> Image.Image:
    """Return all pictures arranged in one, row by row, with at most six in a row (COLUMNS)."""
    columns = min(COLUMNS, len(panels))
    width, height = panels[0].size
    size = columns * width, -(-len(panels) // columns) * height
    whole = Image.new("RGB", size, tuple(GROUND.astype(int)))
    for number, image in enumerate(panels):
        whole.paste(image, (number % columns * width, number // columns * height))
    return whole


def main(out: Path, letters: str = "", edge_mm: float = 1.0, height: int = 300) -> None:
    """Draw the hands of the named letters (none: all) in one picture and write it to `out`.
    edge_mm: edges of the meshes, mm; height: of each panel, pixels."""
    chosen = letters or "".join(sorted(POSES))
    panels = [panel(name, POSES[name], 1e-3 * edge_mm, height) for name in chosen]
    sheet(panels).quantize(128, dither=Image.Dither.NONE).save(out, optimize=True)


if __name__ == "__main__":
    out, letters, edge_mm, height = (*sys.argv[1:], *("", 1.0, 300)[len(sys.argv) - 2 :])
    main(Path(out), str(letters), float(edge_mm), int(height))
