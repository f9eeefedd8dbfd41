"""Smoothness of a meshed hand to the radar: angles between neighbouring facets, and what one
subdivision of the mesh onto the true surface changes in the echoes and in the depths that three
tones show.

    python -m tests.bench.scenes.hand_smoothness [LETTERS]

prints the table of docs/measurements/hand.md.
"""

import sys

import numpy as np

from handbench.bench.scenes.bones import RADII_MM, skeleton
from handbench.bench.scenes.hand import hand_mesh
from handbench.bench.scenes.hand_pose import POSES, Pose
from handbench.bench.scenes.implicit import project
from handbench.groundtruth.mesh.mesh_files import mesh, raycasting_scene
from handbench.radar.data.arrays import SPEED_OF_LIGHT_M_S, qar50
from handbench.radar.simulation.forward import Scatterers, simulate
from handbench.support.rays import TriangleMesh, load_open3d
from tests.bench.scenes.hand_field import hand_field
from tests.radar.exact import tone_images

TONES_HZ = np.array([79.5e9, 81.8e9, 82.0e9])  # of 3-FSK
DEPTH_M_PER_RAD = SPEED_OF_LIGHT_M_S / (4 * np.pi * (TONES_HZ[-1] - TONES_HZ[0]))  # 9.5 mm
HAND_M = (0.0, -0.030, 0.310)  # where a scene puts the palm's centre
SHADOW_BIAS_M = 2e-4  # a facet does not shadow itself
POINTS = 3000  # at which depths are compared
ON_TARGET = 10 ** (
    -13 / 20
)  # amplitude over the strongest one's below which the methods see no target


def crossing_faces(vertices_m: np.ndarray, faces: np.ndarray) -> int:
    """The number of triangles that cut another one (open3d's own test compares all with all)."""
    import pymeshlab

    meshes = pymeshlab.MeshSet(verbose=False)
    meshes.add_mesh(pymeshlab.Mesh(vertices_m, faces))
    meshes.compute_selection_by_self_intersections_per_face()
    return int(meshes.current_mesh().selected_face_number())


def row(letter: str, edge_m: float = 1e-3) -> str:
    """A line of the table: crossing facets, angles (°), the parts there, changes of echoes (%) and
    of depths (mm)."""
    pose = POSES[letter]
    surface = hand_mesh(pose, edge_m)
    vertices_m, faces = np.asarray(surface.vertices), np.asarray(surface.triangles)
    angles_deg, ends = facet_angles(vertices_m, faces)
    where = parts_at(pose, vertices_m[ends[angles_deg.argmax()]].mean(axis=0))
    echo_change, depth_change_m = radar_change(surface, subdivided(surface, pose))
    angles = f"{angles_deg.max():.0f} | {np.percentile(angles_deg, 99.9):.1f}"
    return (
        f"| {letter} | {crossing_faces(vertices_m, faces)} | {angles} "
        f"| {where} | {100 * echo_change:.2f} | {1e3 * depth_change_m:.3f} |"
    )


def facet_angles(vertices_m: np.ndarray, faces: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """For each edge of a closed mesh the angle [e] between the normals of its two facets, degrees,
    and its ends [e, 2]."""
    corners = vertices_m[faces]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    edges = np.sort(faces[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1)
    order = np.lexsort(edges.T)
    first, second = order[::2], order[1::2]  # in a closed mesh every edge has two facets
    # The arc sine of half the chord keeps small angles exact.
    chord = np.linalg.norm(normals[first // 3] - normals[second // 3], axis=1)
    return 2 * np.degrees(np.arcsin(np.minimum(chord / 2, 1))), edges[first]


def subdivided(surface: TriangleMesh, pose: Pose) -> TriangleMesh:
    """Every facet split into four, the new vertices moved onto the pose's true surface."""
    finer = surface.subdivide_midpoint(1)
    return mesh(project(hand_field(pose), np.asarray(finer.vertices)), np.asarray(finer.triangles))


def radar_change(one: TriangleMesh, other: TriangleMesh) -> tuple[float, float]:
    """Relative change of the echoes and root-mean-square change of the depths, metres, from one
    hand to the other."""
    array, surfaces = qar50(), [visible_facets(one), visible_facets(other)]
    samples = np.stack([simulate(facets, TONES_HZ, array) for facets in surfaces])
    echo_change = np.linalg.norm(samples[1] - samples[0]) / np.linalg.norm(samples[1])
    points_m = surfaces[1].position_m[:: max(1, len(surfaces[1].position_m) // POINTS)]
    images = np.stack([tone_images(s, TONES_HZ, array, points_m) for s in samples])
    on_target = np.abs(images[1, -1]) > ON_TARGET * np.abs(images[1, -1]).max()
    beat = images[:, -1, on_target] * images[:, 0, on_target].conj()
    depth_m = DEPTH_M_PER_RAD * np.angle(beat[1] * beat[0].conj())
    return float(echo_change), float(np.sqrt((depth_m**2).mean()))


def visible_facets(surface: TriangleMesh) -> Scatterers:
    """Facets that face the array's centre and are not in another's shadow, split to a quarter of
    the wavelength."""
    surface = load_open3d().geometry.TriangleMesh(surface).translate(HAND_M)
    surface.compute_vertex_normals()
    rays = raycasting_scene(surface)
    corners = np.asarray(surface.vertices)[np.asarray(surface.triangles)]
    longest_m = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2).max()
    quarter_m = SPEED_OF_LIGHT_M_S / TONES_HZ[-1] / 4
    surface = surface.subdivide_midpoint(max(0, int(np.ceil(np.log2(longest_m / quarter_m)))))
    vertices, faces = np.asarray(surface.vertices), np.asarray(surface.triangles)
    centre = vertices[faces].mean(axis=1)
    normal = np.asarray(surface.vertex_normals)[faces].mean(axis=1)
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    edges = vertices[faces[:, 1:]] - vertices[faces[:, :1]]
    area = np.linalg.norm(np.cross(edges[:, 0], edges[:, 1]), axis=1) / 2
    distance = np.linalg.norm(centre, axis=1)
    query = np.hstack([np.zeros_like(centre), centre / distance[:, None]]).astype(np.float32)
    hit = rays.cast_rays(load_open3d().core.Tensor(query))["t_hit"].numpy()
    seen = ((normal * centre).sum(axis=1) < 0) & (hit > distance - SHADOW_BIAS_M)
    return Scatterers(centre[seen], area[seen], normal[seen])


def parts_at(pose: Pose, point_m: np.ndarray) -> str:
    """The two parts of the hand whose flesh is nearest to a point, phalanges that share a joint
    counting as one: palm, or a digit and its phalanx from 1 outwards."""
    flesh_m: dict[tuple[str, int], float] = {}
    for name, digit in skeleton(pose).items():
        for number, bone in enumerate(digit):
            along = np.clip((point_m - bone.start_m) @ bone.axis, 0, bone.length_m)
            radius_m = 1e-3 * RADII_MM[name][max(number - 1, 0)]
            part = (name, number) if number else ("palm", 0)
            distance_m = float(np.linalg.norm(point_m - bone.at(along)) - radius_m)
            flesh_m[part] = min(distance_m, flesh_m.get(part, np.inf))
    first, *rest = sorted(flesh_m, key=flesh_m.__getitem__)
    second = next(part for part in rest if part[0] != first[0] or abs(part[1] - first[1]) > 1)
    return " / ".join(f"{name} {number}" if number else name for name, number in (first, second))


if __name__ == "__main__":
    for letter in "".join(sys.argv[1:]) or POSES:
        print(row(letter), flush=True)
