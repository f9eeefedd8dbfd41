"""Ray casting and nearest points with open3d's Embree and trees. Only this module imports
open3d."""

import ctypes
import os
import sys
from functools import cache
from types import ModuleType
from typing import Any, TypeAlias

import numpy as np

from handbench.support.errors import HandbenchError

# open3d's classes: they have no types, and their import takes a second
TriangleMesh: TypeAlias = Any
PointCloud: TypeAlias = Any
RaycastingScene: TypeAlias = Any
FARTHEST_M = 500.0  # single precision resolves 3e-5 m there, well below the next:
OWN_SURFACE_M = 2e-4  # a hit closer than this to a ray's end is the surface of the end itself
WINDOWS = "open3d.visualization"  # which imports a web server


def _windows(name: str) -> ModuleType:
    """Import and return the part of open3d that `load_open3d` leaves out, on its first use. Raises
    AttributeError for any other name."""
    if f"open3d.{name}" != WINDOWS:
        raise AttributeError(f"module 'open3d' has no attribute '{name}'")
    import open3d.visualization

    found: ModuleType = open3d.visualization
    return found


@cache
def load_open3d() -> ModuleType:
    """Import open3d and return it. Outside notebooks, its windows and web pages, which take as long
    to import as the rest, follow only on first use. The libusb that its wheel needs is provided,
    and its TBB, too old for numba, is hidden from numba."""
    import libusb_package

    ctypes.CDLL(str(libusb_package.get_library_path()), mode=ctypes.RTLD_GLOBAL)
    os.environ.setdefault("NUMBA_THREADING_LAYER_PRIORITY", "omp workqueue tbb")
    if numba := sys.modules.get("numba"):
        numba.config.reload_config()
    asked = {WINDOWS, "ipykernel"} & sys.modules.keys()  # in a notebook open3d asks for them itself
    left_out = None if asked else sys.modules.setdefault(WINDOWS, ModuleType(WINDOWS))
    import open3d

    if left_out:
        del sys.modules[WINDOWS]
        vars(open3d)["__getattr__"] = _windows
    open3d.utility.set_verbosity_level(open3d.utility.VerbosityLevel.Error)
    return open3d


def embree(vertices_m: np.ndarray, faces: np.ndarray) -> RaycastingScene:
    """Return a scene of triangles for Embree's ray casting. vertices_m [n, 3] in metres, stored in
    single precision; faces [m, 3], indices of vertices."""
    core = load_open3d()
    scene = core.t.geometry.RaycastingScene()
    vertices, triangles = (
        np.ascontiguousarray(vertices_m, np.float32),
        np.ascontiguousarray(faces, np.uint32),
    )
    scene.add_triangles(core.core.Tensor(vertices), core.core.Tensor(triangles))
    return scene


class Rays:
    """Ray casting against triangles: vertices_m [n, 3] in metres, faces [m, 3]. Raises a
    HandbenchError for a vertex farther than FARTHEST_M from the origin. `cast` counts all rays of
    the process."""

    cast = 0

    def __init__(self, vertices_m: np.ndarray, faces: np.ndarray) -> None:
        far_m = float(np.abs(vertices_m).max(initial=0))
        if not far_m <= FARTHEST_M:
            raise HandbenchError(
                f"mesh: a vertex is {far_m:.3g} m from the origin of the radar frame, but ray "
                f"casting in single precision is exact enough only up to {FARTHEST_M:g} m; check "
                "that the mesh is in metres and in the radar frame"
            )
        self._scene = embree(vertices_m, faces)

    def first_hits(
        self, origins_m: np.ndarray, directions: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Find where each ray first meets a triangle. origins_m, directions [n, 3]. Returns the
        distance [n] in units of the direction's length, infinite for a ray that meets none, and the
        triangle's index [n]."""
        found = self._scene.cast_rays(self._tensor(origins_m, directions))
        return found["t_hit"].numpy(), found["primitive_ids"].numpy()

    def in_sight(self, points_m: np.ndarray, origins_m: np.ndarray) -> np.ndarray:
        """Return for each point on the surface whether no triangle hides it from its origin, bool
        [n]. points_m [n, 3]; origins_m [n, 3], or [3] for all."""
        towards = origins_m - points_m
        start = points_m + towards * (
            OWN_SURFACE_M / np.sqrt(np.einsum("ni,ni->n", towards, towards))[:, None]
        )
        return ~self._scene.test_occlusions(
            self._tensor(start, origins_m - start), 0.0, 1.0
        ).numpy()

    def _tensor(self, origins_m: np.ndarray, directions: np.ndarray) -> Any:
        Rays.cast += len(origins_m)
        rays = np.empty((len(origins_m), 6), np.float32)
        rays[:, :3], rays[:, 3:] = origins_m, directions
        return load_open3d().core.Tensor(rays)
