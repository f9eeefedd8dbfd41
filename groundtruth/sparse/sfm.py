"""Structure from motion with pycolmap: photographs to camera poses and sparse points, in an arbitrary frame and scale.

Schönberger & Frahm, "Structure-from-Motion Revisited", CVPR 2016. CPU only; the same seed gives the same poses.
"""

from pathlib import Path

from groundtruth.cameras.cameras import pycolmap
from groundtruth.photos.photos import Photo
from groundtruth.sparse.features import DATABASE, Lenses, find_features, match, pipeline_options
from radar.support.errors import HandbenchError
from radar.support.progress import say

FEWEST_REGISTERED = 3
ATTEMPTS = 4  # with another seed each, while less than half of the photographs register
CONVERGED = 1e-6  # relative fall of an adjustment's cost at which it ends; another one follows
NOTHING_KNOWN = Lenses()


def structure_from_motion(
    photos: tuple[Photo, ...], folder: Path, lenses: Lenses = NOTHING_KNOWN, seed: int = 0
) -> "pycolmap.Reconstruction":
    """Register the photographs; `folder` (empty) receives COLMAP's database.

    Known lenses are held fixed. So is a known focal length, since a plane and free focal lengths do not determine each
    other. Where nothing is known all but the principal point is estimated, from the focal lengths that EXIF data tell.
    HandbenchError when fewer than three photographs register.
    """
    database = folder / DATABASE
    find_features(photos, database, lenses, seed)
    match(database, seed)
    say("registering")
    pictures, best = photos[0].path.parent, pycolmap.Reconstruction()
    for attempt in range(ATTEMPTS):
        options = pipeline_options(seed + attempt)
        options.min_model_size, options.multiple_models = FEWEST_REGISTERED, False
        options.ba_local_function_tolerance = options.ba_global_function_tolerance = CONVERGED
        free_focal = not (lenses.known or lenses.intrinsics or lenses.focal_px)
        options.ba_refine_focal_length = options.mapper.abs_pose_refine_focal_length = free_focal
        options.ba_refine_extra_params = options.mapper.abs_pose_refine_extra_params = not lenses.known
        models = pycolmap.incremental_mapping(database, pictures, folder, options)
        best = max([*models.values(), best], key=lambda model: model.num_reg_images())
        registered = best.num_reg_images()
        if 2 * registered >= len(photos):
            break
    if registered < FEWEST_REGISTERED:
        raise HandbenchError(
            f"{pictures}: only {registered} of {len(photos)} photographs could be registered, "
            f"{FEWEST_REGISTERED} are needed; take more photographs from different places, with more overlap and a "
            "textured surrounding, or give the cameras' intrinsics"
        )
    say(f"registered {registered} of {len(photos)} photographs")
    return best
