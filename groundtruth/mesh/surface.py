"""Triangulated surfaces with the uncertainty of each vertex."""

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from handbench.calibration.transforms import Transform
from handbench.groundtruth.mesh.mesh_files import mesh, read_triangles
from handbench.support.errors import HandbenchError
from handbench.support.files import atomic_path
from handbench.support.rays import TriangleMesh

VERTEX = np.dtype(
    [("x", "<f8"), ("y", "<f8"), ("z", "<f8"), ("sigma_m", "<f4"), ("observed", "u1")]
)
FACE = np.dtype([("count", "u1"), ("vertices", "<i4", (3,))])
VELOCITY = ("vx", "vy", "vz")  # properties of a PLY file's vertices, metres per second
PLY_NAMES = {"<f8": "double", "<f4": "float", "|u1": "uchar"}


@dataclass(frozen=True)
class Surface:
    """A triangle mesh with the uncertainty of each vertex.

    vertices_m [n, 3]. faces [m, 3]: triangles of vertex indices, counter-clockwise seen from
    outside. sigma_m [n]: standard deviation of the surface along its normal (NaN: unknown).
    observed [n]: False where the surface is only interpolated or extrapolated from the photographed
    points; depths there must not be scored. velocity_m_s [n, 3]: velocity of each vertex, metres
    per second (None: unknown).
    """

    vertices_m: np.ndarray
    faces: np.ndarray
    sigma_m: np.ndarray
    observed: np.ndarray
    velocity_m_s: np.ndarray | None = None

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
        properties sigma_m and observed."""
        vertices = np.empty(len(self.vertices_m), dtype=VERTEX)
        for name, column in zip("xyz", self.vertices_m.T, strict=True):
            vertices[name] = column
        vertices["sigma_m"], vertices["observed"] = self.sigma_m, self.observed
        faces = np.empty(len(self.faces), dtype=FACE)
        faces["count"], faces["vertices"] = 3, self.faces
        properties = "".join(
            f"property {PLY_NAMES[VERTEX[name].str]} {name}\n" for name in VERTEX.names
        )
        header = (
            "ply\nformat binary_little_endian 1.0\ncomment handbench, metres\nelement vertex "
            f"{len(vertices)}\n"
            f"{properties}element face {len(faces)}\nproperty list uchar int "
            "vertex_indices\nend_header\n"
        )
        with atomic_path(file) as temporary:
            temporary.write_bytes(header.encode() + vertices.tobytes() + faces.tobytes())


def read_surface(file: str | Path) -> "Surface":
    """Read a surface in metres from a PLY, OBJ or STL file.

    The uncertainty comes from the vertex properties sigma_m and observed of a PLY file. If they are
    missing, sigma_m is NaN (unknown) and every vertex counts as observed. The velocity comes from
    vx, vy and vz, metres per second. Raises HandbenchError for a broken file.
    """
    vertices_m, faces, columns = read_triangles(file)
    sigma_m = np.asarray(columns.get("sigma_m", np.full(len(vertices_m), np.nan)), np.float64)
    observed = np.asarray(columns.get("observed", np.ones(len(vertices_m)))) > 0
    return Surface(vertices_m, faces, sigma_m, observed, _velocity_m_s(file, columns))


def _velocity_m_s(file: str | Path, columns: dict[str, np.ndarray]) -> np.ndarray | None:
    """Return the velocities [n, 3] of the vertices from the further properties of a PLY file; None
    if it has none. Raises HandbenchError for velocities that are NaN or infinite."""
    if not columns.keys() >= set(VELOCITY):
        return None
    velocity_m_s = np.stack([columns[name] for name in VELOCITY], axis=1).astype(np.float64)
    if bad := int((~np.isfinite(velocity_m_s)).any(axis=1).sum()):
        raise HandbenchError(
            f"{file}: {', '.join(VELOCITY)} of {bad} vertices are NaN or infinite; expected metres "
            "per second; make the file again"
        )
    return velocity_m_s
