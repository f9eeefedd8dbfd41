"""Ray casting with open3d's Embree scenes. Only this module imports open3d."""

import ctypes
import sys
from concurrent.futures import ThreadPoolExecutor
from functools import cache
from importlib import import_module
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
    """Import open3d.visualization, which `load_open3d` leaves out, when it is first used; return
    it. Raises AttributeError for any other name."""
    if f"open3d.{name}" == WINDOWS:
        return import_module(WINDOWS)
    raise AttributeError(f"module 'open3d' has no attribute '{name}'")


@cache
def load_open3d() -> ModuleType:
    """Import open3d and return it.
    Outside notebooks, open3d.visualization is imported only when it is used, because it takes as
    long to import as all the rest. The library libusb, which open3d's wheel needs, is loaded
    first."""
    import libusb_package

    ctypes.CDLL(str(libusb_package.get_library_path()), mode=ctypes.RTLD_GLOBAL)
    asked = {WINDOWS, "ipykernel"} & sys.modules.keys()  # in a notebook open3d asks for them itself
    left_out = None if asked else sys.modules.setdefault(WINDOWS, ModuleType(WINDOWS))
    # in a thread, which signals to end do not interrupt: its half would end Python with exit code 1
    open3d = ThreadPoolExecutor(1).submit(import_module, "open3d").result()
    if left_out:
        del sys.modules[WINDOWS]
        vars(open3d)["__getattr__"] = _windows
    open3d.utility.set_verbosity_level(open3d.utility.VerbosityLevel.Error)
    return open3d


def embree(vertices_m: np.ndarray, faces: np.ndarray) -> RaycastingScene:
    """Return an Embree scene of triangles, for casting rays.
    vertices_m [n, 3]: metres, stored in single precision; faces [m, 3]: indices of vertices."""
    core = load_open3d()
    scene = core.t.geometry.RaycastingScene()
    scene.add_triangles(
        core.core.Tensor(np.ascontiguousarray(vertices_m, np.float32)),
        core.core.Tensor(np.ascontiguousarray(faces, np.uint32)),
    )
    return scene


class Rays:
    """Ray casting against the triangles of a mesh.
    vertices_m [n, 3]: metres; faces [m, 3]: indices of vertices. Raises
    HandbenchError for a vertex farther than 500 m (FARTHEST_M) from the origin, where single
    precision is too coarse."""

    def __init__(self, vertices_m: np.ndarray, faces: np.ndarray) -> None:
        far_m = np.abs(vertices_m).max(initial=0)
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
        """Find where each ray first hits a triangle.
        origins_m, directions [n, 3]. Returns the distance [n] in units of the length of the
        direction, infinite for a ray that hits nothing, and the index of the triangle [n]."""
        found = self._scene.cast_rays(self._tensor(origins_m, directions))
        return found["t_hit"].numpy(), found["primitive_ids"].numpy()

    def in_sight(self, points_m: np.ndarray, origins_m: np.ndarray) -> np.ndarray:
        """Return for each point on the surface whether it is visible from its origin, so that no
        triangle hides it: bool [n].
        points_m [n, 3]: metres; origins_m [n, 3], or [3] for all points: metres."""
        towards = origins_m - points_m
        start = points_m + towards * (
            OWN_SURFACE_M / np.sqrt(np.einsum("ni,ni->n", towards, towards))[:, None]
        )
        return ~self._scene.test_occlusions(
            self._tensor(start, origins_m - start), 0.0, 1.0
        ).numpy()

    def _tensor(self, origins_m: np.ndarray, directions: np.ndarray) -> Any:
        return load_open3d().core.Tensor(
            np.concatenate([origins_m, directions], axis=1, dtype=np.float32)
        )
