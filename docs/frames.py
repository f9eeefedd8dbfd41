"""Draw the figure of docs/conventions.md, the coordinate frames: python docs/frames.py OUT.png
(from the repository's root).

The antennas, the hand, the board of the stand and a camera of the rig are drawn where handbench's
own scenes have them.
"""

from __future__ import annotations

import io
import sys
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import PolyCollection
from matplotlib.figure import Figure
from PIL import Image

from handbench.bench.scenes.hand import hand_mesh
from handbench.bench.scenes.hand_pose import POSES
from handbench.bench.scenes.scene_file import Mount
from handbench.bench.scenes.stand import PLATE_M, rig, stand_board
from handbench.groundtruth.cameras.cameras import Camera
from handbench.radar.data.arrays import qar50

PALM_M = np.array([0.025, -0.030, 0.300])
EDGE_M = 0.0025
AXES = (("x", "#d62728"), ("y", "#2a9d3a"), ("z", "#1f5fbf"))
SKIN, TX, RX, MAROON, DIM = np.array([0.93, 0.76, 0.65]), "#d55e00", "#0072b2", "#8e44ad", "0.45"
LAMP = np.array([-0.45, 0.60, -0.66])  # towards it
CAMERA = 1  # of the rig's eight: above the array, to the left
FROM_END_TO_END = {"shrinkA": 0, "shrinkB": 0}
HALO = {"facecolor": "white", "edgecolor": "none", "alpha": 0.8, "pad": 0.6}


@dataclass(frozen=True)
class Eye:
    """A pinhole camera for drawing the scene: it is at place_m [3], looks at aim_m [3], and has y
    upwards."""

    place_m: np.ndarray
    aim_m: np.ndarray

    def seen(self, points_m: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Project points [..., 3], metres in the radar frame. Returns picture coordinates [..., 2],
        and depths along the direction of view [...], metres."""
        ahead = (self.aim_m - self.place_m) / np.linalg.norm(self.aim_m - self.place_m)
        right = np.cross(ahead, [0.0, 1.0, 0.0])
        right /= np.linalg.norm(right)
        offset = np.asarray(points_m, np.float64) - self.place_m
        depth = offset @ ahead
        return np.stack([offset @ right, offset @ np.cross(right, ahead)], axis=-1) / depth[
            ..., None
        ], depth


EYE = Eye(np.array([-0.98, 0.54, -0.62]), np.array([0.0, 0.0, 0.17]))


def rig_camera() -> Camera:
    """Return one of the eight cameras around the array, with its pose in the photo frame."""
    return rig(8, 2400, 1600, PALM_M, Mount().radar_from_photo(), 70)[CAMERA]


def line(axes: Axes, points_m: object, **style: object) -> None:
    """Draw a line through points [n, 3], metres in the radar frame."""
    places, _ = EYE.seen(np.asarray(points_m))
    axes.plot(*places.T, **style)


def word(axes: Axes, point_m: object, text: str, colour: str = "0.15", **style: object) -> None:
    """Write a text at a point [3], metres in the radar frame."""
    place, _ = EYE.seen(np.asarray(point_m))
    axes.text(
        *place,
        text,
        color=colour,
        **{"ha": "center", "va": "center", "bbox": HALO, "zorder": 30, **style},
    )


def arrow(
    axes: Axes, start_m: np.ndarray, stop_m: np.ndarray, colour: str, **style: object
) -> None:
    """Draw an arrow from one point [3] to another, metres in the radar frame."""
    (start, stop), _ = EYE.seen(np.stack([start_m, stop_m]))
    look = {
        "arrowstyle": "-|>,head_width=0.28,head_length=0.55",
        "color": colour,
        "lw": 2.2,
    } | FROM_END_TO_END
    axes.annotate("", stop, start, arrowprops=look | style, zorder=25, annotation_clip=False)


def frame(axes: Axes, origin_m: np.ndarray, rotation: np.ndarray, length_m: float) -> None:
    """Draw a coordinate frame: an origin [3], metres, and three named axes, which are the columns
    of rotation [3, 3]."""
    for (name, colour), direction in zip(AXES, np.asarray(rotation).T, strict=True):
        arrow(axes, origin_m, origin_m + length_m * direction, colour)
        word(
            axes,
            origin_m + (length_m + 0.014) * direction,
            name,
            colour,
            fontsize=12,
            fontweight="bold",
            bbox=None,
        )
    place, _ = EYE.seen(origin_m)
    axes.plot(*place, "o", color="black", ms=4, zorder=26)


def solid(axes: Axes, vertices_m: np.ndarray, faces: np.ndarray, colour: np.ndarray) -> None:
    """Draw a closed mesh with shading: the triangles that face the eye, from the furthest to the
    nearest.
    vertices_m [n, 3]: metres in the radar frame; faces [m, 3]: indices; colour [3]: RGB."""
    corners = vertices_m[faces]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    places, depth = EYE.seen(corners)
    facing = np.einsum("ij,ij->i", normals, EYE.place_m - corners[:, 0]) > 0
    order = np.flatnonzero(facing)[np.argsort(-depth[facing].mean(axis=1))]
    light = 0.45 + 0.62 * np.maximum(normals[order] @ (LAMP / np.linalg.norm(LAMP)), 0)
    shades = np.minimum(light[:, None] * colour, 1)
    axes.add_collection(
        PolyCollection(places[order], facecolors=shades, edgecolors=shades, lw=0.3, zorder=12)
    )


def panel(axes: Axes, corners_m: np.ndarray, **style: object) -> None:
    """Draw a filled flat polygon with corners [n, 3], metres in the radar frame."""
    places, _ = EYE.seen(corners_m)
    axes.fill(*places.T, **style)


def rectangle(width_m: float, height_m: float) -> np.ndarray:
    """Return the corners [4, 3], metres, of a rectangle in the plane z = 0, centred at the
    origin."""
    x, y = width_m / 2, height_m / 2
    return np.array([(-x, -y, 0), (x, -y, 0), (x, y, 0), (-x, y, 0)])


def draw_array(axes: Axes) -> None:
    """Draw the antennas with their plane, the radar frame, and the direction of the x axis in
    MAROON's data."""
    array = qar50()
    panel(
        axes,
        rectangle(0.165, 0.165),
        facecolor="0.93",
        edgecolor="0.6",
        lw=0.8,
        alpha=0.9,
        zorder=14,
    )
    for positions_m, colour in ((array.tx_m, TX), (array.rx_m, RX)):
        places, _ = EYE.seen(positions_m)
        axes.plot(*places.T, ".", color=colour, ms=3.6, zorder=15)
    origin = np.zeros(3)
    arrow(axes, origin, np.array([-0.115, 0, 0]), MAROON, ls=(0, (4, 2)), lw=1.6, zorder=24)
    word(axes, (-0.150, 0.006, 0), "MAROON's x", MAROON, fontsize=9)
    line(axes, [origin, PALM_M * [0, 0, 1]], color=DIM, lw=0.9, ls=(0, (2, 3)), zorder=11)
    frame(axes, origin, np.eye(3), 0.115)
    word(
        axes,
        (0.0, -0.122, 0),
        "radar frame: origin at the\ncentre of the aperture",
        fontsize=9.5,
        va="top",
    )
    word(axes, (0.088, -0.03, 0), "Tx\ncolumns", TX, fontsize=9, ha="right")
    word(axes, (-0.045, 0.100, 0), "Rx rows", RX, fontsize=9)


def draw_stand(axes: Axes) -> None:
    """Draw the board behind the hand, with its markers and the photo frame."""
    radar_from_photo = Mount().radar_from_photo()
    width, height, _ = PLATE_M
    plate_m = radar_from_photo.points(rectangle(width, height))
    panel(axes, plate_m, facecolor="0.965", edgecolor="0.55", lw=0.8, zorder=1)
    for marker in stand_board().marker:
        panel(
            axes,
            radar_from_photo.points(np.array(marker.corners_m)),
            facecolor="0.72",
            edgecolor="none",
            zorder=2,
        )
    frame(axes, radar_from_photo.points(np.zeros(3)), radar_from_photo.rotation, 0.046)
    text = "photo frame: the board's centre,\nz out of the print"
    word(axes, radar_from_photo.points(np.array([0.02, 0.195, 0])), text, fontsize=9.5)


def draw_hand(axes: Axes) -> None:
    """Draw a hand in front of the board, with the target frame, whose origin is the middle of the
    palm."""
    surface = hand_mesh(POSES["F"], EDGE_M).translate(PALM_M)
    solid(axes, np.asarray(surface.vertices), np.asarray(surface.triangles), SKIN)
    frame(axes, PALM_M, np.eye(3), 0.040)
    word(
        axes,
        PALM_M + (0, -0.118, 0),
        "target frame: axes as the radar's,\n0.3 m away here",
        fontsize=9.5,
        va="top",
    )


def draw_camera(axes: Axes) -> None:
    """Draw a camera's frame and its pyramid of view."""
    camera, photo = rig_camera(), Mount().radar_from_photo()
    rotation, shift_m = np.array(camera.R), np.array(camera.t)
    centre_m, turned = photo.points(-rotation.T @ shift_m), photo.rotation @ rotation.T
    half = np.array([camera.width, camera.height]) / 2 / camera.params[0] * 0.055
    signs = ((-1, -1), (1, -1), (1, 1), (-1, 1))
    corners = centre_m + np.array([(x * half[0], y * half[1], 0.055) for x, y in signs]) @ turned.T
    for corner in corners:
        line(axes, [centre_m, corner], color="0.35", lw=1.0, zorder=20)
    panel(axes, corners, facecolor="0.8", edgecolor="0.35", lw=1.0, alpha=0.55, zorder=20)
    frame(axes, centre_m, turned, 0.085)
    text = "camera frame: x right, y down\nin the picture, z forwards"
    word(axes, centre_m - 0.03 * turned[:, 1], text, fontsize=9.5, va="bottom")


def draw_map(axes: Axes) -> None:
    """Draw how depth maps are stored and shown: rows upwards, x growing to the left."""
    ny, nx = 4, 5
    for i in range(nx + 1):
        axes.plot([i, i], [0, ny], color="0.75", lw=0.8)
    for j in range(ny + 1):
        axes.plot([0, nx], [j, j], color="0.75", lw=0.8)
    for (j, i), name in {(0, 0): "z[0, 0]", (0, 1): "z[0, 1]", (1, 0): "z[1, 0]"}.items():
        axes.text(nx - i - 0.5, j + 0.5, name, ha="center", va="center", fontsize=8)
    look = {"arrowstyle": "-|>", "lw": 1.8} | FROM_END_TO_END
    axes.annotate("", (1.2, -0.45), (nx, -0.45), arrowprops=look | {"color": AXES[0][1]})
    axes.annotate(
        "", (nx + 0.35, ny - 0.6), (nx + 0.35, 0), arrowprops=look | {"color": AXES[1][1]}
    )
    axes.text(
        0.9, -0.45, "x", color=AXES[0][1], ha="center", va="center", fontsize=11, fontweight="bold"
    )
    axes.text(
        nx + 0.35,
        ny - 0.3,
        "y",
        color=AXES[1][1],
        ha="center",
        va="center",
        fontsize=11,
        fontweight="bold",
    )
    axes.set_title("a depth map z[iy, ix], as seen\nfrom the array", fontsize=9.5)
    axes.set(xlim=(-0.4, nx + 0.8), ylim=(-0.9, ny + 0.2), aspect="equal")
    axes.axis("off")


def draw_pixels(axes: Axes) -> None:
    """Draw COLMAP's pixel coordinates: (0, 0) is the corner of the picture, and (0.5, 0.5) the
    centre of the first pixel."""
    columns, rows = 5, 3.4
    for i in range(columns + 1):
        axes.plot([i, i], [0, rows], color="0.75", lw=0.8)
    for j in range(4):
        axes.plot([0, columns], [j, j], color="0.75", lw=0.8)
    look = {"arrowstyle": "-|>", "lw": 1.8} | FROM_END_TO_END
    axes.annotate("", (columns - 0.6, 0), (0, 0), arrowprops=look | {"color": AXES[0][1]})
    axes.annotate("", (0, rows - 0.4), (0, 0), arrowprops=look | {"color": AXES[1][1]})
    axes.text(
        columns - 0.3,
        -0.3,
        "x",
        color=AXES[0][1],
        ha="center",
        va="center",
        fontsize=11,
        fontweight="bold",
    )
    axes.text(
        -0.35,
        rows - 0.4,
        "y",
        color=AXES[1][1],
        ha="center",
        va="center",
        fontsize=11,
        fontweight="bold",
    )
    axes.plot(0.5, 0.5, "o", color="black", ms=4)
    axes.text(0.68, 0.5, "(0.5, 0.5)", fontsize=8.5, va="center", bbox=HALO)
    axes.text(-0.05, -0.3, "(0, 0)", fontsize=8.5, va="center", ha="center")
    axes.set_title("pixels of a photograph", fontsize=9.5)
    axes.set(xlim=(-0.7, columns + 0.3), ylim=(rows + 0.2, -0.6), aspect="equal")
    axes.axis("off")


def draw() -> Figure:
    """Draw the whole figure and return it."""
    figure = Figure(figsize=(12.5, 6.0), facecolor="white")
    scene = figure.add_axes((0.0, 0.0, 0.78, 1.0))
    for part in (draw_stand, draw_hand, draw_array, draw_camera):
        part(scene)
    scene.set_aspect("equal")
    scene.set(xlim=(-0.3175, 0.235), ylim=(-0.155, 0.185))  # of the axes' own shape
    scene.axis("off")
    draw_map(figure.add_axes((0.785, 0.52, 0.205, 0.38)))
    draw_pixels(figure.add_axes((0.785, 0.08, 0.205, 0.34)))
    return figure


def main(out: Path) -> None:
    """Draw the figure and write it as a PNG file with few colours."""
    stream = io.BytesIO()
    draw().savefig(stream, dpi=130)
    Image.open(stream).convert("RGB").quantize(200, dither=Image.Dither.NONE).save(
        out, optimize=True
    )


if __name__ == "__main__":
    main(Path(sys.argv[1]))
