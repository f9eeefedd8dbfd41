"""Reading and writing of triangle meshes. Only this module reads mesh files of other programs.

It parses them with numpy, because libraries for more formats trust a file's header (open3d crashes
on a wrong one) or skip errors silently (trimesh: text with missing numbers, relative indices in OBJ
files).
"""

import codecs
from collections import defaultdict
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path

import numpy as np

from handbench.calibration.transforms import LARGEST_M
from handbench.groundtruth.mesh.ply import MOST, read_ply, write_ply
from handbench.groundtruth.mesh.polygons import MOST_CORNERS, triangles
from handbench.support.cost import require_memory
from handbench.support.errors import HandbenchError
from handbench.support.files import atomic_path, require_file, require_size
from handbench.support.limits import MESH_BYTES
from handbench.support.rays import PointCloud, RaycastingScene, TriangleMesh, embree, load_open3d

SMALLEST_M, LONGEST_M = 5e-3, 50.0  # plausible sizes of a target


def mesh(vertices_m: np.ndarray, faces: np.ndarray) -> TriangleMesh:
    """Make an Open3D mesh from vertices [n, 3] in metres and triangles [m, 3] of vertex indices,
    whose corners run counter-clockwise seen from outside."""
    o3d = load_open3d()
    return o3d.geometry.TriangleMesh(
        o3d.utility.Vector3dVector(np.ascontiguousarray(vertices_m, dtype=np.float64)),
        o3d.utility.Vector3iVector(np.ascontiguousarray(faces, dtype=np.int32)),
    )


def point_cloud(points_m: np.ndarray, normals: np.ndarray) -> PointCloud:
    """Make an Open3D point cloud from points [n, 3] in metres and normals [n, 3]."""
    o3d = load_open3d()
    cloud = o3d.geometry.PointCloud(o3d.utility.Vector3dVector(points_m))
    cloud.normals = o3d.utility.Vector3dVector(normals)
    return cloud


def read_mesh(path: str | Path) -> TriangleMesh:
    """Read a triangle mesh in metres from a PLY, OBJ or STL file, as an Open3D mesh. Raises
    HandbenchError for a broken file."""
    vertices_m, faces, _ = read_triangles(path)
    return mesh(vertices_m, faces)


def metric_mesh(path: str | Path, unit_m: float) -> TriangleMesh:
    """Read a mesh from a PLY, OBJ or STL file with coordinates in units of `unit_m` metres, and
    convert it to metres.

    The mesh is repaired and, if possible, its triangles are oriented consistently. Raises
    HandbenchError for a mesh without triangles, with invalid numbers, or with an implausible size.
    """
    surface = read_mesh(path)
    surface.scale(unit_m, center=np.zeros(3))
    repair(surface)
    longest_m = float(np.ptp(np.asarray(surface.vertices), axis=0).max())
    if not SMALLEST_M < longest_m < LONGEST_M:
        raise HandbenchError(
            f"{path}: is {longest_m:.3g} m long; expected {SMALLEST_M:g} to {LONGEST_M:g} m; "
            "check --unit"
        )
    if surface.is_orientable():
        surface.orient_triangles()
    return surface


def repair(mesh: TriangleMesh) -> TriangleMesh:
    """Repair a mesh in place for ray casting and scoring, and return it. Removed are duplicate
    vertices and triangles, triangles without area, edges of more than two triangles, and unused
    vertices."""
    for kind in (
        "duplicated_vertices",
        "degenerate_triangles",
        "duplicated_triangles",
        "non_manifold_edges",
    ):
        getattr(mesh, f"remove_{kind}")()
    return mesh.remove_unreferenced_vertices()


def read_triangles(path: str | Path) -> tuple[np.ndarray, np.ndarray, dict[str, np.ndarray]]:
    """Read a triangle mesh in metres from a PLY, OBJ or STL file.

    Returns the vertices [n, 3] float64, the triangles [m, 3] int64 of vertex indices (polygons are
    cut into triangles), and the vertices' further properties in a PLY file, such as colours, as
    arrays [n] by name. Raises HandbenchError for a file that is incomplete, contradicts its header
    or has no triangles, for vertices that are NaN, infinite or implausibly far, and for faces with
    unknown vertices.
    """
    path = require_file(path, "a triangle mesh (PLY, OBJ or STL)")
    readers = {".ply": (read_ply, 8), ".obj": (_read_obj, 12), ".stl": (_read_stl, 6)}
    if path.suffix.lower() not in readers:
        raise HandbenchError(
            f"{path}: is not a {', '.join(readers)} file; convert the mesh to one of these formats"
        )
    # the memory that reading takes, over the file's size
    read, times = readers[path.suffix.lower()]
    require_memory(
        times * path.stat().st_size, str(path), ("close other programs, or simplify the mesh")
    )
    require_size(path, "a triangle mesh", MESH_BYTES)
    try:
        columns, polygons = read(path)
    except ValueError as error:
        raise HandbenchError(
            f"{path}: has no triangles that can be read: {error}; copy or export it again"
        ) from None
    except (OSError, MemoryError) as error:
        reason = getattr(error, "strerror", None) or (
            "the mesh is too large for the memory of this machine"
        )
        raise HandbenchError(f"{path}: cannot be read ({reason}); check the file") from None
    vertices_m = np.stack([columns.pop(axis) for axis in "xyz"], axis=1).astype(np.float64)
    _check(path, vertices_m, polygons)
    try:
        faces = triangles(vertices_m, polygons)
    except ValueError as error:
        raise HandbenchError(f"{path}: {error}") from None
    if len(faces) > MOST:
        raise HandbenchError(
            f"{path}: has {len(faces)} triangles, more than {MOST}; simplify the mesh"
        )
    return vertices_m, faces, columns


COARSEST = 1e-4  # step of single precision, of a mesh's extent: 0.02 mm of a hand


def _check(path: Path, vertices_m: np.ndarray, polygons: list[np.ndarray]) -> None:
    """Check vertices [n, 3] and polygons, groups [count, corners] of vertex indices, from the file
    `path`.

    Raises HandbenchError if there are no polygons, if a vertex is NaN, infinite or implausibly far,
    if coordinates are too coarsely rounded for the mesh's size, or if a polygon uses a vertex that
    does not exist.
    """
    if not any(map(len, polygons)):
        raise HandbenchError(
            f"{path}: has no triangles; expected a triangle mesh (PLY, OBJ or STL)"
        )
    if not np.isfinite(vertices_m).all():
        bad = int((~np.isfinite(vertices_m)).any(axis=1).sum())
        raise HandbenchError(f"{path}: {bad} vertices are NaN or infinite; remove them")
    if np.abs(vertices_m).max(initial=0) > LARGEST_M:
        raise HandbenchError(
            f"{path}: a vertex is {np.abs(vertices_m).max():.3g} m from the origin; check that "
            "the unit is metres"
        )
    step = float(np.spacing(np.float32(np.abs(vertices_m).max(initial=0))))
    extent = float(np.ptp(vertices_m, axis=0).max()) if len(vertices_m) else 0.0
    if step > COARSEST * extent > 0 and (vertices_m == vertices_m.astype(np.float32)).all():
        raise HandbenchError(
            f"{path}: its vertices are {np.abs(vertices_m).max():.3g} from the origin, where "
            f"single precision has steps of {step:.2g}, too coarse for a mesh of size "
            f"{extent:.3g}; export it in double precision, or move the origin to the mesh"
        )
    for corners in polygons:
        if corners.size and (corners.min() < 0 or corners.max() >= len(vertices_m)):
            named = corners.min() if corners.min() < 0 else corners.max()
            raise HandbenchError(
                f"{path}: a face uses vertex {named}, but there are only {len(vertices_m)} "
                "vertices; export the mesh again"
            )


# The first words of an OBJ file's other lines (Wavefront, Advanced Visualizer, appendix B)
OBJ_WORDS = frozenset(
    b"vt vn vp cstype deg bmat step p l curv curv2 surf parm trim hole scrv sp end con g s mg o "
    b"bevel c_interp d_interp lod maplib usemap usemtl mtllib shadow_obj trace_obj ctech "
    b"stech".split()
)


def _read_obj(path: Path) -> tuple[dict[str, np.ndarray], list[np.ndarray]]:
    """Read the vertices and faces of a Wavefront OBJ file.

    Returns the vertices' coordinates, arrays [n] by axis "x", "y" and "z", and the faces, one array
    [count, corners] of vertex indices for each number of corners. Raises ValueError for a line that
    is not OBJ.
    """
    vertices: list[tuple[float, ...]] = []
    faces = defaultdict[int, list[list[int]]](list)
    with path.open("rb") as stream:
        for number, line in _obj_lines(stream):
            try:
                match line.split():
                    case [b"v", x, y, z, *_]:
                        vertices.append((float(x), float(y), float(z)))
                    case [b"f" | b"fo", *words] if 3 <= len(words) <= MOST_CORNERS:
                        faces[len(words)].append([_corner(word, len(vertices)) for word in words])
                    case [first, *_] if first not in OBJ_WORDS:
                        raise ValueError
            except ValueError:
                shown = line.decode("latin-1").strip()[:60]
                wrong = (
                    "has decimal commas"
                    if b"," in line
                    else ("is not a vertex, a face or another OBJ keyword")
                )
                raise ValueError(f"line {number}, '{shown}', {wrong}") from None
    groups = [np.array(faces[count], np.int64) for count in sorted(faces)]
    return _by_axis(np.array(vertices, np.float64)), groups


def _obj_lines(stream: Iterable[bytes]) -> Iterator[tuple[int, bytes]]:
    """Yield the number and text of each line of an OBJ file, without comments and byte order mark.
    A line that ends with a backslash is joined with the next one."""
    begun = b""
    lines = (line for part in stream for line in part.splitlines())  # also those that end with \\r
    for number, line in enumerate(lines, 1):
        line = begun + line.removeprefix(codecs.BOM_UTF8).partition(b"#")[0].rstrip()
        begun = b""
        if line.endswith(b"\\"):
            begun = line[:-1] + b" "
        else:
            yield number, line
    if begun:
        yield number, begun


def _corner(word: bytes, vertices: int) -> int:
    """Return the index, from 0, of the vertex that one corner of a face in an OBJ file refers to.

    word: the corner as written, such as 7, 7/1/2, or -1 for the last vertex read so far. vertices:
    number of vertices read so far. Raises ValueError for 0 or an excessive number.
    """
    index = int(word.partition(b"/")[0])
    if index == 0 or abs(index) > MOST:
        raise ValueError
    return index - 1 if index > 0 else vertices + index


def _read_stl(path: Path) -> tuple[dict[str, np.ndarray], list[np.ndarray]]:
    """Read the triangles of an STL file, with equal corners merged to one vertex.

    The file is read as binary if its length agrees with its count of triangles, else as ASCII.
    Returns the vertices' coordinates, arrays [n] by axis "x", "y" and "z", and a list of one array
    [m, 3] of vertex indices. Raises ValueError if the file is neither.
    """
    content = path.read_bytes()
    count = int.from_bytes(content[80:84], "little")
    if len(content) >= 84 and len(content) == 84 + 50 * count:
        facet = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])
        corners = np.frombuffer(content, facet, count, 84)["corners"].reshape(-1, 3)
    elif (text := content.removeprefix(codecs.BOM_UTF8).lstrip())[:5].lower() == b"solid":
        corners = _text_corners(text)
    elif b"\0" not in content[:1000]:
        raise ValueError("it is text, but does not begin with 'solid'")
    else:
        takes = 84 + 50 * count
        raise ValueError(
            f"its {count} triangles need {takes} bytes, but the file has {len(content)}"
        )
    order = np.lexsort(corners.T[::-1])  # np.unique along an axis takes five times as long
    ordered = corners[order]
    is_first = np.append(True, (ordered[1:] != ordered[:-1]).any(axis=1))[: len(corners)]
    names = np.empty(len(corners), np.int64)
    names[order] = np.cumsum(is_first) - 1
    return _by_axis(ordered[is_first]), [names.reshape(-1, 3)]


STL_WORDS = frozenset(b"solid facet outer endloop endfacet endsolid".split())


def _text_corners(content: bytes) -> np.ndarray:
    """Read the corners of m triangles, [3 m, 3], from the content of an ASCII STL file, whose
    keywords may be in upper or lower case. Raises ValueError for lines that are not STL, and for an
    incomplete file."""
    corners, ends, last = [], 0, b""
    for number, line in enumerate(content.splitlines(), 1):
        match [word.lower() for word in line.split()]:
            case [b"vertex", x, y, z]:
                try:
                    corners.append((float(x), float(y), float(z)))
                except ValueError:
                    commas = " (it has decimal commas)" if b"," in line else ""
                    raise ValueError(f"line {number} is not a vertex{commas}") from None
            case [word, *_] if word in STL_WORDS:
                last = word
                ends += word == b"endfacet"
            case [_, *_]:
                shown = line.decode("latin-1").strip()[:60]
                raise ValueError(f"line {number}, '{shown}', does not begin with an STL keyword")
    if len(corners) != 3 * ends or last != b"endsolid":
        raise ValueError(
            f"it has {len(corners)} corners and {ends} complete triangles, or does not end with "
            "'endsolid'"
        )
    return np.array(corners, np.float64).reshape(-1, 3)


def _by_axis(points: np.ndarray) -> dict[str, np.ndarray]:
    return dict(zip("xyz", points.reshape(-1, 3).T, strict=True))


def write_mesh(path: str | Path, surface: TriangleMesh) -> None:
    """Write an Open3D mesh as a binary PLY file, atomically. Raises OSError if the disk is full."""
    _write(path, load_open3d().io.write_triangle_mesh, surface)


def write_moving_mesh(
    path: str | Path, vertices_m: np.ndarray, velocity_m_s: np.ndarray, faces: np.ndarray
) -> None:
    """Write vertices [n, 3] in metres with their velocities [n, 3] in m/s, as the properties vx, vy
    and vz, and triangles [m, 3] as a binary PLY file, atomically."""
    columns = {axis: vertices_m[:, i] for i, axis in enumerate("xyz")}
    columns |= {f"v{axis}": velocity_m_s[:, i] for i, axis in enumerate("xyz")}
    with atomic_path(path) as temporary:
        write_ply(temporary, columns, faces)


def write_cloud(path: str | Path, points_m: np.ndarray, normals: np.ndarray) -> None:
    """Write points [n, 3] in metres with their normals [n, 3] as a binary PLY file, atomically.
    Raises OSError if the disk is full."""
    _write(path, load_open3d().io.write_point_cloud, point_cloud(points_m, normals))


def _write(path: str | Path, write: Callable[..., bool], what: object) -> None:
    with atomic_path(path) as temporary:
        if not write(str(temporary), what, write_ascii=False):
            raise OSError(f"open3d could not write {path}")
        try:
            read_ply(temporary)
        except ValueError as error:  # open3d ignores a full disk
            raise OSError(
                "the file that was written is cut short; check that the disk has free space"
            ) from error


def raycasting_scene(surface: TriangleMesh) -> RaycastingScene:
    """Make an Embree scene of a mesh for ray casting. Its method `cast_rays` takes rays [..., 6]
    float32, each an origin and a direction (ox, oy, oz, dx, dy, dz) in metres."""
    return embree(np.asarray(surface.vertices), np.asarray(surface.triangles))
