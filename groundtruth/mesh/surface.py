"""Triangulated surfaces with the uncertainty of each vertex, and the files of triangle meshes. Only
this module reads mesh files of other programs.

Libraries for these formats are no replacement: open3d skips an OBJ file's quadrangles and returns
an empty mesh for a broken file; trimesh 5.2 makes a wrong mesh of an OBJ file with relative indices
between its vertices or with an index 0, and cannot read a comment behind a face.
"""

import codecs
import re
from collections import defaultdict
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from handbench.calibration.transforms import LARGEST_M, Transform
from handbench.groundtruth.mesh.ply import NO_SCALE, by_axis, read_ply, write_ply
from handbench.support.errors import HandbenchError
from handbench.support.files import MESH_BYTES, read_bytes, require_file
from handbench.support.rays import TriangleMesh, load_open3d

VELOCITY = ("vx", "vy", "vz")  # properties of a PLY file's vertices, metres per second
HEAD_BYTES = 200  # of a PLY file, with its first comment
SMALLEST_M, LONGEST_M = 5e-3, 50.0  # plausible sizes of a target
MOST_CORNERS = 1000  # of a face
SLIVER = 1e-6  # square of a share of a face's area that may be folded, as rounding folds it


@dataclass(frozen=True)
class Surface:
    """A triangle mesh with the uncertainty of each vertex.

    vertices_m [n, 3]. faces [m, 3]: triangles of vertex indices, counter-clockwise seen from
    outside. sigma_m [n]: standard deviation of the surface along its normal (NaN: unknown).
    observed [n]: False where the surface is only interpolated or extrapolated from the photographed
    points; depths there must not be scored. velocity_m_s [n, 3]: velocity of each vertex, metres
    per second (None: unknown). scaled: False if lengths have no unit, as in what `groundtruth
    --unscaled` makes.
    """

    vertices_m: np.ndarray
    faces: np.ndarray
    sigma_m: np.ndarray
    observed: np.ndarray
    velocity_m_s: np.ndarray | None = None
    scaled: bool = True

    def __repr__(self) -> str:
        counts = f"{len(self.vertices_m)} vertices, {len(self.faces)} triangles"
        counts += "" if self.scaled else ", no scale"
        return f"<handbench.Surface: {counts}>"

    @property
    def mesh(self) -> TriangleMesh:
        """The triangles as an Open3D mesh."""
        return mesh(self.vertices_m, self.faces)

    def moved(self, transform: Transform) -> "Surface":
        """Return the surface in the transform's target frame. sigma_m is multiplied by the
        transform's scale; the transform's own uncertainty is not added."""
        sigma_m = self.sigma_m * abs(transform.scale)
        v_m_s = self.velocity_m_s
        return replace(
            self,
            vertices_m=transform.points(self.vertices_m),
            sigma_m=sigma_m,
            velocity_m_s=None if v_m_s is None else v_m_s @ transform.matrix[:3, :3].T,
        )

    def save(self, file: str | Path) -> None:
        """Write the surface as a binary PLY file, atomically. Each vertex has the further
        properties sigma_m and observed, and vx, vy and vz if the velocity is known."""
        columns = by_axis(self.vertices_m) | {
            "sigma_m": self.sigma_m.astype(np.float32),
            "observed": self.observed.astype(np.uint8),
        }
        if self.velocity_m_s is not None:
            columns |= by_axis(self.velocity_m_s, "v")
        write_ply(file, columns, self.faces, self.scaled)


def read_surface(file: str | Path, unscaled: bool = False) -> Surface:
    """Read a surface in metres from a PLY, OBJ or STL file. unscaled: also one without scale.

    The uncertainty comes from the vertex properties sigma_m and observed of a PLY file. If they are
    missing, sigma_m is NaN (unknown) and every vertex counts as observed. The velocity comes from
    vx, vy and vz, metres per second. Raises HandbenchError for a broken file, negative
    sigma_m, and for a surface without scale unless it is wanted.
    """
    vertices_m, faces, columns = read_triangles(file)
    sigma_m = np.asarray(columns.get("sigma_m", np.full(len(vertices_m), np.nan)), np.float64)
    if (sigma_m < 0).any():
        raise HandbenchError(f"{file}: sigma_m is negative; expected metres, or NaN if unknown")
    observed = np.asarray(columns.get("observed", np.ones(len(vertices_m)))) > 0
    velocity_m_s = None
    if columns.keys() >= set(VELOCITY):
        velocity_m_s = np.stack([columns[name] for name in VELOCITY], axis=1).astype(np.float64)
        if not np.isfinite(velocity_m_s).all():
            raise HandbenchError(
                f"{file}: {', '.join(VELOCITY)} are NaN or infinite; expected metres per second"
            )
    with Path(file).open("rb") as opened:
        scaled = NO_SCALE.encode() not in opened.read(HEAD_BYTES)
    if not (scaled or unscaled):
        raise HandbenchError(
            f"{file}: has no scale, since `handbench groundtruth --unscaled` made it; expected a "
            "mesh in metres; make it again with --board or --cameras"
        )
    return Surface(vertices_m, faces, sigma_m, observed, velocity_m_s, scaled)


def mesh(vertices_m: np.ndarray, faces: np.ndarray) -> TriangleMesh:
    """Make an Open3D mesh from vertices [n, 3] in metres and triangles [m, 3] of vertex indices,
    whose corners run counter-clockwise seen from outside."""
    o3d = load_open3d()
    return o3d.geometry.TriangleMesh(
        o3d.utility.Vector3dVector(np.ascontiguousarray(vertices_m, np.float64)),
        o3d.utility.Vector3iVector(np.ascontiguousarray(faces, np.int32)),
    )


def read_mesh(path: str | Path) -> TriangleMesh:
    """Read a triangle mesh in metres from a PLY, OBJ or STL file, as an Open3D mesh. Raises
    HandbenchError for a broken file, and for a mesh without scale."""
    return read_surface(path).mesh


def write_mesh(path: str | Path, surface: TriangleMesh) -> None:
    """Write an Open3D mesh as a binary PLY file, atomically."""
    write_ply(path, by_axis(np.asarray(surface.vertices)), np.asarray(surface.triangles))


def metric_mesh(path: str | Path, unit_m: float) -> TriangleMesh:
    """Read a mesh from a PLY, OBJ or STL file with coordinates in units of `unit_m` metres, and
    convert it to metres.

    Removed are duplicate vertices and triangles, triangles without area, edges of more than two
    triangles, and unused vertices; if possible, the triangles are oriented consistently. Raises
    HandbenchError for a mesh without triangles, with invalid numbers, or with an implausible size.
    """
    surface = read_mesh(path)
    surface.scale(unit_m, center=np.zeros(3))
    surface.remove_duplicated_vertices()
    surface.remove_degenerate_triangles()
    surface.remove_duplicated_triangles()
    surface.remove_non_manifold_edges()
    surface.remove_unreferenced_vertices()
    vertices_m = np.asarray(surface.vertices)
    longest_m = float(np.ptp(vertices_m, axis=0).max()) if len(vertices_m) else 0.0
    if not SMALLEST_M < longest_m < LONGEST_M:
        raise HandbenchError(
            f"{path}: is {longest_m:.3g} m long; expected {SMALLEST_M:g} to {LONGEST_M:g} m; "
            "check --unit"
        )
    if surface.is_orientable():
        surface.orient_triangles()
    return surface


def read_triangles(path: str | Path) -> tuple[np.ndarray, np.ndarray, dict[str, np.ndarray]]:
    """Read a triangle mesh in metres from a PLY, OBJ or STL file.

    Returns the vertices [n, 3] float64, the triangles [m, 3] int64 of vertex indices (polygons are
    cut into triangles), and the vertices' further properties in a PLY file, such as colours, as
    arrays [n] by name. Raises HandbenchError for a file that is incomplete, contradicts its header
    or has no triangles, for vertices that are NaN, infinite or implausibly far, and for faces with
    unknown vertices.
    """
    path = require_file(path, "a triangle mesh (PLY, OBJ or STL)")
    readers = {".ply": read_ply, ".obj": _read_obj, ".stl": _read_stl}
    if path.suffix.lower() not in readers:
        raise HandbenchError(f"{path}: is not a mesh file; expected one of {', '.join(readers)}")
    content = read_bytes(path, "a triangle mesh", MESH_BYTES).removeprefix(codecs.BOM_UTF8)
    try:
        columns, polygons = readers[path.suffix.lower()](content)
        vertices_m = np.stack([columns.pop(axis) for axis in "xyz"], axis=1).astype(np.float64)
        _check(vertices_m, polygons)
        faces = np.concatenate([_triangles(vertices_m, equal) for equal in polygons])
    except (ValueError, LookupError, OverflowError) as error:
        reason = f"it has no {error}" if isinstance(error, KeyError) else error
        raise HandbenchError(
            f"{path}: is not a usable mesh ({reason}); correct it, or export it again"
        ) from error
    return vertices_m, faces.astype(np.int64), columns


def _check(vertices_m: np.ndarray, polygons: list[np.ndarray]) -> None:
    """Raise ValueError if vertices [n, 3] are NaN, infinite or implausibly far, or if a polygon
    uses a vertex that does not exist."""
    if not any(map(len, polygons)):
        raise ValueError("it has no triangles")
    far_m = np.abs(vertices_m).max()
    if not far_m <= LARGEST_M:
        raise ValueError(f"a vertex is at {far_m:.3g}; expected metres, not NaN")
    for corners in polygons:
        wrong = ~((corners >= 0) & (corners < len(vertices_m)) & (corners == np.floor(corners)))
        if wrong.any():
            raise ValueError(
                f"a face uses vertex {corners[wrong][0]}, counted from 0, of {len(vertices_m)}"
            )


def _triangles(vertices_m: np.ndarray, polygons: np.ndarray) -> np.ndarray:
    """Cut polygons [count, corners] of vertex indices into triangles [m, 3], all of a polygon from
    one of its corners. Raises ValueError for a polygon of which no corner sees all others."""
    count = polygons.shape[1]
    if not 3 <= count <= MOST_CORNERS:
        raise ValueError(f"a face has {count} corners; expected 3 to {MOST_CORNERS}")
    polygons = polygons.astype(np.int64)
    if count == 3:
        return polygons
    fan = [[0, k, k + 1] for k in range(1, count - 1)]
    for _ in range(count):
        triangles = polygons[:, fan]
        edges_m = np.diff(vertices_m[triangles], axis=2)
        normals = np.cross(edges_m[:, :, 0], edges_m[:, :, 1])
        turns = (normals[:, 1:] * normals[:, :-1]).sum(axis=2).min(axis=1)
        folded = turns < -SLIVER * (normals**2).sum(axis=(1, 2))
        if not folded.any():
            return triangles.reshape(-1, 3)
        polygons[folded] = np.roll(polygons[folded], 1, axis=1)
    raise ValueError(f"a face of {count} corners is no simple polygon")


def _read_obj(content: bytes) -> tuple[dict[str, np.ndarray], list[np.ndarray]]:
    """Parse a Wavefront OBJ file. Returns the vertices' coordinates by axis, and the faces, an
    array [count, corners] of vertex indices for each number of corners."""
    text = b"\n".join(content.splitlines())
    vertices: list[tuple[float, float, float]] = []
    faces = defaultdict[int, list[list[int]]](list)
    # without comments, and with the lines joined that end with a backslash
    for line in re.sub(rb"#.*|\\[ \t]*\n", b" ", text).split(b"\n"):
        match line.split():
            case [b"v", x, y, z, *_]:
                vertices.append((float(x), float(y), float(z)))
            case [b"v", *_]:
                raise ValueError("a vertex has fewer than 3 coordinates")
            case [b"f", *corners]:
                # counted from 1, or from −1 for the last vertex so far
                indices = [int(corner.partition(b"/")[0]) for corner in corners]
                faces[len(corners)].append(
                    [i - 1 if i >= 0 else len(vertices) + i for i in indices]
                )
    return by_axis(np.array(vertices).reshape(-1, 3)), [
        np.array(equal, np.int64) for equal in faces.values()
    ]


FACET = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])
TEXT_FACET = re.compile(
    rb"facet\s+normal(?:\s+\S+){3}\s+outer\s+loop"
    + 3 * rb"\s+vertex\s+(\S+)\s+(\S+)\s+(\S+)"
    + rb"\s+endloop\s+endfacet"
)


def _read_stl(content: bytes) -> tuple[dict[str, np.ndarray], list[np.ndarray]]:
    """Parse an STL file, as binary if its length agrees with its number of triangles, else as text.
    Returns the vertices' coordinates by axis, equal ones merged, and the triangles."""
    count = int.from_bytes(content[80:84], "little")
    if len(content) == 84 + 50 * count:
        corners = np.frombuffer(content, FACET, count, 84)["corners"].reshape(-1, 3)
    else:
        lines = b"\n".join(content.lower().splitlines())
        text, ends = re.subn(rb"(?m)^[ \t]*(end)?solid\b.*", b"", lines)
        if ends % 2 or TEXT_FACET.sub(b"", text).strip():
            raise ValueError(
                f"it is neither a binary file of {count} triangles nor a complete text"
            )
        corners = np.array(TEXT_FACET.findall(text), np.float64).reshape(-1, 3)
    merged = mesh(corners, np.arange(len(corners)).reshape(-1, 3)).remove_duplicated_vertices()
    return by_axis(np.asarray(merged.vertices)), [np.asarray(merged.triangles)]
