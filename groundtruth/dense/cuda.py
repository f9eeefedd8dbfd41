"""Depth maps on a CUDA device: COLMAP's PatchMatch for the search, handbench's own final
refinement.

Schönberger et al., "Pixelwise view selection for unstructured multi-view stereo", ECCV 2016. COLMAP
replaces the search on the CPU; it gets the same views, source views and window size. Its planes
then pass through the same refinement with curved windows and the same limits of cost, incidence and
jumps (COLMAP writes no costs). The fusion and its uncertainty thus treat maps from both devices
equally. COLMAP's random numbers are the same in every run; there is no seed to set.

COLMAP's workspace is written from our views and not by its `undistort_images`: our views are
cropped to the region of interest, and COLMAP's stereo puts pixels' centres at whole numbers, as our
K does and its own models do not (colmap issue 1515: half a pixel). All pictures are padded with
black to one size, because some versions distort narrower ones (colmap pull request 4634).

COLMAP's `stereo_fusion` is not used. It accepts depths that agree within 1 % (5 mm on a hand; our
fusion: within 1.25 pixels), and it returns medians without the spread between the views, which our
uncertainty is computed from.
"""

import json
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np
from PIL import Image

from handbench.groundtruth.cameras import pycolmap
from handbench.groundtruth.dense.dense import ViewDepth, depth_of, disparity_range
from handbench.groundtruth.dense.patchmatch import RADIUS, refine
from handbench.groundtruth.dense.views import Stereo, View
from handbench.support.errors import HandbenchError
from handbench.support.progress import say, track

STEEPEST = 1.5  # disparities per pixel, of slopes that are read off the normals
INSTEAD = "--dense cpu, or an empty CUDA_VISIBLE_DEVICES, uses the processor instead"
CHILD = """
import json, sys, pycolmap
options = pycolmap.PatchMatchOptions(**json.loads(sys.argv[2]))
pycolmap.patch_match_stereo(sys.argv[1], options=options)
"""


def depth_maps(views: list[View], sources: list[list[int]]) -> list[ViewDepth]:
    """Compute the depth map of every view with COLMAP's PatchMatch on a CUDA device, followed by
    the same final refinement as on the CPU.

    sources: for each view, the indices of the views that it is matched with. Raises
    HandbenchError if COLMAP fails.
    """
    with tempfile.TemporaryDirectory(prefix="handbench-") as scratch:
        folder = Path(scratch)
        write_workspace(folder, views, sources)
        say("depth maps: COLMAP searches on the CUDA device")
        options = {
            "depth_min": float(min(np.nanmin(view.near_m) for view in views)),
            "depth_max": float(max(np.nanmax(view.far_m) for view in views)),
            "window_radius": RADIUS,
            "filter_min_num_consistent": 1,
        }
        search(folder, options)
        return [
            read_maps(folder, views, i, sources[i]) for i in track(range(len(views)), "depth maps")
        ]


def write_workspace(folder: Path, views: list[View], sources: list[list[int]]) -> None:
    """Write the input of COLMAP's stereo into an empty folder: pictures, cameras, and the list of
    views that each view is matched with (sources: their indices, for each view)."""
    for part in (
        "images",
        "sparse",
        "stereo/depth_maps",
        "stereo/normal_maps",
        "stereo/consistency_graphs",
    ):
        (folder / part).mkdir(parents=True)
    height, width = np.max([view.gray.shape for view in views], axis=0).tolist()
    model = pycolmap.Reconstruction()
    for i, view in enumerate(views):
        (fx, _, cx), (_, fy, cy), _ = view.K
        pose = pycolmap.Rigid3d(pycolmap.Rotation3d(view.R), view.t)
        model.add_camera_with_trivial_rig(
            pycolmap.Camera(
                camera_id=i + 1,
                model="PINHOLE",
                width=width,
                height=height,
                params=[fx, fy, cx, cy],
            )
        )
        model.add_image_with_trivial_frame(pycolmap.Image(_name(i), [], i + 1, i + 1), pose)
        picture = np.zeros((height, width), dtype=np.uint8)
        h, w = view.gray.shape
        picture[:h, :w] = (view.gray.clip(0, 1) * 255).round()
        Image.fromarray(picture).save(folder / "images" / _name(i))
    model.write_binary(folder / "sparse")
    lines = (f"{_name(i)}\n{', '.join(map(_name, chosen))}\n" for i, chosen in enumerate(sources))
    (folder / "stereo" / "patch-match.cfg").write_text("".join(lines))


def search(workspace: Path, options: dict[str, float | int | bool]) -> None:
    """Run COLMAP's PatchMatch on a workspace folder, into which it writes depth and normal maps.

    options: fields of pycolmap.PatchMatchOptions. A child process runs it, because a failure inside
    COLMAP ends the process. Raises HandbenchError with COLMAP's reason if it fails.
    """
    done = subprocess.run(
        [sys.executable, "-P", "-c", CHILD, str(workspace), json.dumps(options)],
        stdin=subprocess.DEVNULL,
        capture_output=True,
        text=True,
        errors="replace",
    )
    if done.returncode != 0:
        lines = [
            line for line in done.stderr.splitlines() if "Check failed" in line or "rror" in line
        ]
        *_, reason = [f"exit code {done.returncode}", *lines]
        raise HandbenchError(
            f"COLMAP's stereo search failed on the CUDA device ({reason.strip()}); {INSTEAD}"
        )


def read_maps(folder: Path, views: list[View], i: int, sources: list[int]) -> ViewDepth:
    """Read the depths and normals of view number i that COLMAP wrote into a workspace, and refine
    them. sources: indices of the views that it is matched with. Raises HandbenchError if a file is
    missing or empty.
    """
    view, depth, normal = views[i], pycolmap.DepthMap(), pycolmap.NormalMap()
    try:
        depth.read(folder / "stereo" / "depth_maps" / f"{_name(i)}.geometric.bin")
        normal.read(folder / "stereo" / "normal_maps" / f"{_name(i)}.geometric.bin")
    except ValueError:
        raise HandbenchError(
            f"{view.name}: COLMAP wrote no depth map; free memory and disk space; {INSTEAD}"
        ) from None
    h, w = view.gray.shape
    depth_m, normals = depth.to_array()[:h, :w], normal.to_array()[:h, :w].astype(float)
    depth_m = np.where(depth_m > 0, depth_m, np.nan)
    stereo = Stereo.of(view, [views[s] for s in sources])
    # the plane n·X = d has 1/z = (n·K⁻¹x)/d at pixel x
    distance = stereo.unit * depth_m * (normals * view.rays()).sum(axis=-1)
    slopes = np.moveaxis(normals[..., :2] / view.K[[0, 1], [0, 1]], -1, 0) / distance
    slopes = np.clip(slopes, -STEEPEST, STEEPEST)
    planes = np.stack([1 / (stereo.unit * depth_m), *slopes]).astype(np.float32)
    low, high = disparity_range(view, stereo.unit)
    low[~((low <= planes[0]) & (planes[0] <= high))] = np.nan
    return depth_of(view, stereo, *refine(stereo, planes, low, high, (), 0))


def _name(i: int) -> str:
    return f"{i}.png"
