"""Registration of photographs with pycolmap: features, matches and structure from motion, in an
arbitrary frame and scale. If cameras and poses are known, the matches that agree with them are
triangulated instead.

Schönberger & Frahm, "Structure-from-Motion Revisited", CVPR 2016. It runs on the CPU only; the same
seed gives the same poses.
"""

from collections import defaultdict
from pathlib import Path

from handbench.groundtruth.cameras import Camera, pycolmap, registered_images, set_pose
from handbench.groundtruth.markers import focal_length_px
from handbench.groundtruth.options import Lenses
from handbench.groundtruth.photos import FEWEST, Photo
from handbench.groundtruth.sparse.inputs import Known
from handbench.support.errors import HandbenchError
from handbench.support.progress import say

DATABASE = "database.db"
FEWEST_POINTS = 20  # of the model, in a photograph with a known pose
LONGEST_SIDE_PX = 3200  # features are found on photographs no larger than this
# longer side below which photographs are doubled in size, for features: others have enough of them
SMALL_PX = 1200
# longer side from which they are quartered, where lenses are known and a board holds the cameras:
# at half the size they halve the cameras' part of a surface's error, 4 µm, in four times the time
LARGE_PX = 2000
# least contrast of a quartered one's feature, against 0.0067: smooth skin has hardly any other
FAINT = 0.002
ATTEMPTS = 4  # with another seed each, while less than half of the photographs register
CONVERGED = 1e-6  # relative fall of an adjustment's cost at which it ends; another one follows
# least share of matches that agree with the poses; wrong poses reach a quarter
LEAST_AGREEING = 0.5


def named_pictures(photos: tuple[Photo, ...], folder: Path) -> Path:
    """Return a folder in which COLMAP finds the photographs under their names.

    This is the photographs' own folder if possible. If a file has another name, a format that
    COLMAP does not read, or is stretched, it is a new folder inside `folder`, with links and
    copies.
    """
    if all(photo.plain and photo.path.name == photo.name for photo in photos):
        return photos[0].path.parent
    pictures = folder / "pictures"
    if not pictures.is_dir():
        pictures.mkdir()
        for photo in photos:
            if photo.plain:
                (pictures / photo.name).symlink_to(photo.path.resolve())
            else:
                photo.save_copy(pictures / photo.name)
    return pictures


def import_photographs(
    photos: tuple[Photo, ...], pictures: Path, database: Path, lenses: Lenses
) -> None:
    """Write the photographs, and the lenses that they share, into a new COLMAP database at the path
    `database`. pictures: folder in which COLMAP finds them. Without EXIF data of any camera, "auto"
    is one lens for each size of photographs."""
    modes = pycolmap.CameraMode
    mode = {"auto": modes.AUTO, "one": modes.SINGLE, "each": modes.PER_IMAGE}[lenses]
    if mode == modes.AUTO and not any(_has_exif(pictures / photo.name) for photo in photos):
        mode = modes.SINGLE
    groups = defaultdict(list)
    for photo in photos:
        size = (photo.width, photo.height)
        groups[size if mode == modes.SINGLE else None].append(photo.name)
    pycolmap.Database.open(database).close()
    reader = pycolmap.ImageReaderOptions(camera_model="RADIAL")
    for names in groups.values():
        pycolmap.import_images(database, pictures, mode, names, reader)


def _has_exif(picture: Path) -> bool:
    """Tell whether EXIF data name the camera and the focal length."""
    bitmap = pycolmap.Bitmap.read(picture, as_rgb=False)
    return bitmap is not None and bool(bitmap.exif_camera_model())


def find_features(known: Known, database: Path, lenses: Lenses = "auto", seed: int = 0) -> bool:
    """Detect features in all photographs, and write them and the cameras into a new COLMAP database
    at the path `database`. seed: of COLMAP's random numbers. Returns True if known cameras or views
    of the board give the focal lengths."""
    pycolmap.logging.minloglevel = int(pycolmap.logging.FATAL)
    pycolmap.set_random_seed(seed)
    say(f"features of {len(known.photos)} photographs")
    pictures = named_pictures(known.photos, database.parent)
    # before the features, since these come in the order in which threads are done
    import_photographs(known.photos, pictures, database, "each" if known.cameras else lenses)
    octaves = defaultdict(list)
    held = bool(known.cameras) and known.board is not None
    for photo in known.photos:
        # octave −1 is that of twice the size, 2 that of a quarter
        side_px = max(photo.width, photo.height)
        octave = -1 if side_px < SMALL_PX else 2 if held and side_px >= LARGE_PX else 0
        octaves[octave].append(photo.name)
    for octave, names in octaves.items():
        options = pycolmap.FeatureExtractionOptions(max_image_size=LONGEST_SIDE_PX)
        options.sift.first_octave = octave
        if octave > 0:
            options.sift.peak_threshold = FAINT
        pycolmap.extract_features(
            database, pictures, names, extraction_options=options, device=pycolmap.Device.cpu
        )
    return _write_cameras(database, known)


def _write_cameras(database: Path, known: Known) -> bool:
    """Set the cameras in a COLMAP database to the known ones or, if unknown, their focal lengths to
    those that the board gives: in the photographs of a camera or, if these show too little of it,
    in all. Returns True if the focal lengths were set."""
    given = {camera.name: camera for camera in known.cameras}
    with pycolmap.Database.open(database) as stored:
        images = stored.read_all_images()
        for camera in stored.read_all_cameras():
            names = [image.name for image in images if image.camera_id == camera.camera_id]
            if given:
                lens = given[names[0]].colmap()
                lens.camera_id = camera.camera_id
            else:
                lens, focal_px = camera, _focal_length_px(camera, names, known)
                if focal_px is None:
                    return False
                lens.params = [focal_px, *camera.params[1:]]
            lens.has_prior_focal_length = True
            stored.update_camera(lens)
    return True


def _focal_length_px(camera: "pycolmap.Camera", names: list[str], known: Known) -> float | None:
    if known.board is None:
        return None
    own, size = [known.corners[name] for name in names], (camera.width, camera.height)
    return focal_length_px(own, size, known.board) or focal_length_px(
        known.corners.values(), size, known.board
    )


def match(database: Path, seed: int) -> None:
    """Match the features of every pair of photographs, and write the matches that one epipolar
    geometry or homography explains into the COLMAP database. seed: of the random samples of that
    check."""
    say("matching every pair")
    # with more, the index of descriptors does not repeat
    matching = pycolmap.FeatureMatchingOptions(num_threads=1)
    verification = pycolmap.TwoViewGeometryOptions()
    verification.ransac.random_seed = seed
    pycolmap.match_exhaustive(
        database, matching, verification_options=verification, device=pycolmap.Device.cpu
    )


def pipeline_options(seed: int) -> "pycolmap.IncrementalPipelineOptions":
    """Return COLMAP's options for registration and triangulation, set so that results depend on
    nothing but the seed."""
    options = pycolmap.IncrementalPipelineOptions(random_seed=seed, extract_colors=False)
    options.num_threads = 1  # sums over threads would not repeat bit for bit
    options.mapper.random_seed = options.triangulation.random_seed = seed
    options.triangulation.ignore_two_view_tracks = False
    return options


def keep_agreeing_matches(database: Path, posed: "pycolmap.Reconstruction") -> float:
    """Remove the matches that contradict the known poses of the model `posed` from a COLMAP
    database. Returns the share of matches that remain."""
    with pycolmap.Database.open(database) as stored:
        before = stored.num_inlier_matches()
    pycolmap.guided_geometric_verification(posed, database, num_threads=1)
    with pycolmap.Database.open(database) as stored:
        return stored.num_inlier_matches() / before if before else 1.0


def structure_from_motion(
    known: Known, folder: Path, lenses: Lenses = "auto", seed: int = 0
) -> "pycolmap.Reconstruction":
    """Find the cameras' poses and points from photographs, as a COLMAP model in an arbitrary frame
    and scale. `folder` (empty) receives COLMAP's database.

    lenses: how many unknown ones there are. Known lenses are held fixed, and so is a focal length
    that the board gives, since planar scenes do not determine it. Otherwise all intrinsics but the
    principal point are estimated, starting from EXIF focal lengths. Raises HandbenchError if fewer
    than three photographs can be registered.
    """
    photos, database = known.photos, folder / DATABASE
    free_focal = not find_features(known, database, lenses, seed)
    match(database, seed)
    say("registering")
    pictures, best = named_pictures(photos, folder), pycolmap.Reconstruction()
    for attempt in range(ATTEMPTS):
        options = pipeline_options((seed + attempt) % 2**31)
        options.min_model_size, options.multiple_models = FEWEST, False
        options.ba_local_function_tolerance = options.ba_global_function_tolerance = CONVERGED
        options.ba_refine_focal_length = options.mapper.abs_pose_refine_focal_length = free_focal
        options.ba_refine_extra_params = (
            options.mapper.abs_pose_refine_extra_params
        ) = not known.cameras
        models = pycolmap.incremental_mapping(database, pictures, folder, options)
        best = max([*models.values(), best], key=lambda model: model.num_reg_images())
        count = best.num_reg_images()
        if 2 * count >= len(photos):
            break
    if count < FEWEST:
        raise HandbenchError(
            f"photographs: only {count} of {len(photos)} photographs could be registered; expected "
            f"at least {FEWEST}; take more photographs from different places, with more overlap "
            "and a textured surrounding, or give the intrinsics of the cameras"
        )
    say(f"registered {count} of {len(photos)} photographs")
    return best


def triangulate_known_poses(known: Known, folder: Path, seed: int = 0) -> "pycolmap.Reconstruction":
    """Triangulate points from photographs whose cameras and poses are known and do not change.
    Returns a COLMAP model; `folder` (empty) receives COLMAP's database.

    Photographs that show very few of the points are left out. Raises HandbenchError if the features
    contradict the poses, or if fewer than three photographs are left.
    """
    pictures, database = named_pictures(known.photos, folder), folder / DATABASE
    given = {camera.name: camera for camera in known.cameras}
    find_features(known, database, seed=seed)
    model = pycolmap.Reconstruction()  # of the cameras only, with the database's ids
    with pycolmap.Database.open(database) as stored:
        for camera in stored.read_all_cameras():
            model.add_camera_with_trivial_rig(camera)
        for image in stored.read_all_images():
            model.add_image_with_trivial_frame(image, _pose(given[image.name]))
    match(database, seed)
    share = keep_agreeing_matches(database, model)
    if share < LEAST_AGREEING:
        raise HandbenchError(
            f"photographs: only {share:.0%} of the matched features agree with the given poses; "
            f"expected at least {LEAST_AGREEING:.0%}; check that R, t lead from world to camera "
            "(x right, y down, z forward) and belong to these photographs, or leave the poses out"
        )
    say("triangulating")
    model = pycolmap.triangulate_points(
        model, database, pictures, folder, options=pipeline_options(seed)
    )
    for image in registered_images(model):
        if image.num_points3D < FEWEST_POINTS:
            model.deregister_frame(image.frame_id)
    if model.num_reg_images() < FEWEST:
        raise HandbenchError(
            f"photographs: with the given poses, only {model.num_reg_images()} of "
            f"{len(known.photos)} photographs see {FEWEST_POINTS} points; expected at least "
            f"{FEWEST}; take photographs with more overlap and texture"
        )
    # restore the exact poses: COLMAP scales its models, and back
    for image in registered_images(model):
        set_pose(image, _pose(given[image.name]))
    say(
        f"{model.num_points3D()} points of {model.num_reg_images()} photographs with known poses, "
        f"{model.compute_mean_reprojection_error():.2f} px off"
    )
    return model


def _pose(camera: Camera) -> "pycolmap.Rigid3d":
    return pycolmap.Rigid3d(pycolmap.Rotation3d(camera.rotation), camera.translation_m)
