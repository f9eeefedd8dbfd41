"""Joint covariance of the cameras, and the covariance that it gives to points in space."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from handbench.groundtruth.cameras.cameras import pycolmap
from handbench.groundtruth.sparse.bundle import Bundle, pseudo_inverse
from handbench.groundtruth.sparse.frame import Scale
from handbench.groundtruth.sparse.jacobians import pixel_jacobians
from handbench.support.files import read_npz, write_npz
from handbench.support.limits import KEPT_BYTES

NOT_SEEN = 1e-12  # of the information on a point: where nothing tells a direction, nothing moves along it


@dataclass(frozen=True)
class CameraCovariance:
    """Joint covariance [d, d] of all cameras' parameters; places: photograph → its columns, its pose's six first; free:
    the intrinsics that the others are, by their places."""

    matrix: np.ndarray
    places: dict[str, np.ndarray]
    free: tuple[int, ...]

    def save(self, file: Path) -> None:
        """Write as .npz."""
        names = tuple(self.places)
        write_npz(file, matrix=self.matrix, names=names, places=np.array([*self.places.values()]), free=self.free)

    @classmethod
    def load(cls, file: Path) -> "CameraCovariance":
        """Read what `save` wrote."""
        found = read_npz(file, ("matrix", "names", "places", "free"), most=KEPT_BYTES)
        places = dict(zip(found["names"].tolist(), found["places"], strict=True))
        return cls(found["matrix"], places, tuple(found["free"].astype(int).tolist()))


def camera_covariance(bundle: Bundle, scale: Scale) -> CameraCovariance:
    """Covariance of a bundle's cameras where its model stands, in its frame.

    The board's corners hold the frame if there are any, else known poses do, to scale.residual_m, else nothing: then it
    is the covariance of least trace, about the frame of all photographs together (an inner constraint).
    """
    information, _, _ = bundle.normal().reduced(0.0)
    if scale.source == "poses" and scale.residual_m:
        for image in bundle.images:
            columns = bundle.place[image.name][:3]  # the centre −Rᵀt moves by −Rᵀτ: any τ by as much
            information[columns, columns] += 1 / scale.residual_m**2
    return CameraCovariance(pseudo_inverse(information), bundle.place, bundle.free)


def point_covariance(
    images: "list[pycolmap.Image]", known: CameraCovariance, points_m: np.ndarray, seen: np.ndarray
) -> np.ndarray:
    """Covariance [n, 3, 3] (m²) that the cameras' own uncertainty gives to points [n, 3] that the photographs
    seen [n, images] see: the points move to where the rays of the moved cameras meet again, by least squares."""
    information = np.zeros((len(points_m), 3, 3))
    moved = np.zeros((len(points_m), 3, len(known.matrix)))
    for image, mask in zip(images, seen.T, strict=True):
        columns = known.places[image.name]
        by_point, by_camera = pixel_jacobians(image, points_m[mask], known.free)
        information[mask] += np.einsum("nia,nib->nab", by_point, by_point)
        at = np.nonzero(mask)[0]
        moved[at[:, None, None], np.arange(3)[:, None], columns] -= np.einsum("nia,nib->nab", by_point, by_camera)
    shift = np.linalg.pinv(information, rcond=NOT_SEEN, hermitian=True) @ moved
    return shift @ known.matrix @ np.swapaxes(shift, -1, -2)
