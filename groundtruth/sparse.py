"""The sparse stage: registered cameras and points in the metric frame."""

from __future__ import annotations

import tempfile
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from calibration import read_json, write_json
from groundtruth.cameras import Camera, load_pycolmap
from groundtruth.frame import Scale, apply, board_from_model, poses_from_model, registered
from groundtruth.inputs import Inputs
from groundtruth.options import Options
from groundtruth.sfm import structure_from_motion

if TYPE_CHECKING:
    import pycolmap

SCALE = "scale.json"


@dataclass(frozen=True)
class Sparse:
    """A COLMAP model in the mesh's frame, and where its scale comes from."""

    model: pycolmap.Reconstruction
    scale: Scale

    def save(self, folder: Path) -> None:
        """Write the model and the scale into a folder."""
        self.model.write_binary(folder)
        write_json(folder / SCALE, asdict(self.scale))

    @classmethod
    def load(cls, folder: Path) -> Sparse:
        """Read what `save` wrote."""
        model = load_pycolmap().Reconstruction(str(folder))
        return cls(model, Scale(**read_json(folder / SCALE, "a sparse stage's scale")))

    def cameras(self) -> tuple[Camera, ...]:
        """The registered photographs' cameras, by name."""
        return tuple(_camera(image) for image in registered(self.model))


def register(inputs: Inputs, options: Options) -> Sparse:
    """Structure from motion, carried into the metric frame."""
    with tempfile.TemporaryDirectory(prefix="handbench-") as scratch:
        model = structure_from_motion(
            inputs.photos,
            Path(scratch),
            cameras=inputs.cameras,
            intrinsics=options.intrinsics,
            focal_px=inputs.focal_lengths_px(),
            seed=options.seed,
        )
    return Sparse(model, _to_metric_frame(model, inputs, options))


def _to_metric_frame(model: pycolmap.Reconstruction, inputs: Inputs, options: Options) -> Scale:
    if inputs.board is not None:
        matrix, scale = board_from_model(model, inputs.corners, inputs.board)
    elif not options.unscaled:
        matrix, scale = poses_from_model(model, inputs.cameras or ())
    else:
        return Scale("none")
    apply(model, matrix)
    return scale


def _camera(image: pycolmap.Image) -> Camera:
    camera, pose = image.camera, image.cam_from_world()
    return Camera(
        name=image.name,
        width=camera.width,
        height=camera.height,
        model=camera.model_name,
        params=tuple(camera.params.tolist()),
        R=tuple(map(tuple, pose.rotation.matrix().tolist())),
        t=tuple(pose.translation.tolist()),
    )
