"""Mesh files of 10⁷ faces: declared, too large, and what reading them takes."""

from __future__ import annotations

import tempfile
import tracemalloc
from pathlib import Path

import psutil

from bench.studies.stability.cases import Refused, Worst, case, refused
from bench.studies.stability.meshes_shapes import refusal, sheet, surface
from groundtruth.mesh.mesh_files import read_triangles


@refusal("10⁷ faces that are not there", "memory is taken for what the file holds, not for what its header says")
def _declared() -> Refused | Worst:
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "a.ply"
        xyz = "".join(f"property float {axis}\n" for axis in "xyz")
        head = f"ply\nformat binary_little_endian 1.0\nelement vertex 3\n{xyz}element face 10000000\n"
        file.write_bytes(f"{head}property list uchar int vertex_indices\nend_header\n".encode() + bytes(36))
        return refused(lambda: read_triangles(file), "promises 10000000 of 'face'")


@refusal("a mesh beyond the memory", "reading takes several times the file's size: what is not free is not begun")
def _beyond_memory() -> Refused | Worst:
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "a.ply"
        with file.open("wb") as stream:
            stream.truncate(psutil.virtual_memory().total)  # a hole that takes no disk
        return refused(lambda: read_triangles(file), "memory are free", "simplify the mesh")


@case(
    "meshes",
    "memory for 10⁷ faces",
    quantity="memory that reading takes, for each face of 10⁷",
    unit="GB",
    bound=2.2,
    reference="the peak at 5·10⁴ faces, in proportion",
    reason="8 times the file's 27 bytes a face, what is asked for before reading: 2.2 GB",
)
def _memory() -> float:
    vertices, faces = sheet(158)
    with tempfile.TemporaryDirectory() as folder:
        surface(vertices, faces).save(Path(folder) / "a.ply")
        tracemalloc.start()
        read_triangles(Path(folder) / "a.ply")
        peak = tracemalloc.get_traced_memory()[1]
        tracemalloc.stop()
    return 1e7 * peak / len(faces) / 1e9
