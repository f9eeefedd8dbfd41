"""Triangulated surfaces with the uncertainty of each vertex."""

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from handbench.calibration.transforms import Transform
from handbench.groundtruth.mesh.mesh_files import mesh, read_triangles
from handbench.groundtruth.mesh.ply import by_axis, write_ply
from handbench.support.errors import HandbenchError
from handbench.support.rays import TriangleMesh

VELOCITY = ("vx", "vy", "vz")  # properties of a PLY file's vertices, metres per second


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

    def __repr__(self) -> str:
        counts = f"{len(self.vertices_m)} vertices, {len(self.faces)} triangles"
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
        write_ply(file, columns, self.faces)


def read_surface(file: str | Path) -> Surface:
    """Read a surface in metres from a PLY, OBJ or STL file.

    The uncertainty comes from the vertex properties sigma_m and observed of a PLY file. If they are
    missing, sigma_m is NaN (unknown) and every vertex counts as observed. The velocity comes from
    vx, vy and vz, metres per second. Raises HandbenchError for a broken file.
    """
    vertices_m, faces, columns = read_triangles(file)
    sigma_m = np.asarray(columns.get("sigma_m", np.full(len(vertices_m), np.nan)), np.float64)
    observed = np.asarray(columns.get("observed", np.ones(len(vertices_m)))) > 0
    velocity_m_s = None
    if columns.keys() >= set(VELOCITY):
        velocity_m_s = np.stack([columns[name] for name in VELOCITY], axis=1).astype(np.float64)
        if not np.isfinite(velocity_m_s).all():
            raise HandbenchError(
                f"{file}: {', '.join(VELOCITY)} are NaN or infinite; expected metres per second"
            )
    return Surface(vertices_m, faces, sigma_m, observed, velocity_m_s)
