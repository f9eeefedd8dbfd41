"""Mesh files of 10⁷ faces: declared, too large, and what reading them takes."""

from __future__ import annotations

import tempfile
import tracemalloc
from pathlib import Path

import psutil

from bench.studies.stability.cases import Seen, Works, case, refusal
from bench.studies.stability.meshes_shapes import sheet, surface
from groundtruth.mesh.mesh_files import read_triangles


@refusal("meshes", "10⁷ faces that are not there", "promises 10000000 of 'face'")
def _declared() -> Works:
    """Memory is taken for what the file holds, not for what its header says."""
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "a.ply"
        xyz = "".join(f"property float {axis}\n" for axis in "xyz")
        head = f"ply\nformat binary_little_endian 1.0\nelement vertex 3\n{xyz}element face 10000000\n"
        file.write_bytes(f"{head}property list uchar int vertex_indices\nend_header\n".encode() + bytes(36))
        yield file.name, lambda: read_triangles(file)


@refusal("meshes", "a mesh beyond the memory", "memory are free", "simplify the mesh")
def _beyond_memory() -> Works:
    """Reading takes several times the file's size: what is not free is not begun."""
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "a.ply"
        with file.open("wb") as stream:
            stream.truncate(psutil.virtual_memory().total)  # a hole that takes no disk
        yield file.name, lambda: read_triangles(file)


@case("meshes", "memory for 10⁷ faces", "GB", 2.2)
def _memory() -> Seen:
    """Memory that reading takes, for each face of 10⁷. Against: the peak at 5·10⁴ faces, in proportion. Because: 8
    times the file's 27 bytes a face, what is asked for before reading: 2.2 GB."""
    vertices, faces = sheet(158)
    with tempfile.TemporaryDirectory() as folder:
        surface(vertices, faces).save(Path(folder) / "a.ply")
        tracemalloc.start()
        read_triangles(Path(folder) / "a.ply")
        peak = tracemalloc.get_traced_memory()[1]
        tracemalloc.stop()
    return 1e7 * peak / len(faces) / 1e9
