"""Features of photographs and their matches, in COLMAP's database, and the cameras it is told of."""

from collections import defaultdict
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from handbench.groundtruth.cameras.cameras import Camera, pycolmap
from handbench.groundtruth.photos.photos import Photo
from handbench.support.progress import say

DATABASE = "database.db"
LONGEST_SIDE_PX = 3200  # features are found on photographs no larger than this
MOST_FEATURES = 4096  # of a photograph
SMALL_PX = 1200  # longer side below which photographs are doubled in size, for features: others have enough of them
LARGE_PX = 2000  # longer side from which they are halved, where lenses are known and a board holds the cameras: most of
# the features at their full size are dropped for their number, after most of the work
FAINT = 0.004  # least contrast of a feature of the halved ones, against 0.0067: smooth skin has hardly any other


@dataclass(frozen=True)
class Lenses:
    """Knowledge of the lenses before anything is registered.

    cameras: one for each photograph, held fixed. intrinsics: fx, fy, cx, cy in pixels of one camera that took all
    photographs, held fixed; without distortion, unless it is free. focal_px: a focal length for every name, where
    nothing else is known. shared: one lens for all photographs of a size (True), one for each photograph (False), or
    one for all photographs of one camera body, or of a size where EXIF data do not tell (None).
    """

    cameras: tuple[Camera, ...] | None = None
    intrinsics: tuple[float, float, float, float] | None = None
    free_distortion: bool = False
    focal_px: dict[str, float] | None = None
    shared: bool | None = None

    @property
    def known(self) -> bool:
        """True if nothing about the lenses is left to be estimated."""
        return self.cameras is not None or (self.intrinsics is not None and not self.free_distortion)

    def groups(self, photos: tuple[Photo, ...]) -> list[list[str]]:
        """The photographs' names, those together that share a camera."""
        if self.cameras is not None or (self.shared is False and self.intrinsics is None):
            return [[photo.name] for photo in photos]
        by_body = self.shared is None and self.intrinsics is None
        groups = defaultdict(list)
        for photo in photos:
            groups[(photo.body if by_body else None, photo.width, photo.height)].append(photo.name)
        return list(groups.values())

    def given(self, name: str, width: int, height: int) -> "pycolmap.Camera | None":
        """The known camera of a photograph, None where it has to be estimated."""
        if self.cameras is not None:
            return next(camera.colmap() for camera in self.cameras if camera.name == name)
        if self.intrinsics is None:
            return None
        model, rest = ("OPENCV", (0.0,) * 4) if self.free_distortion else ("PINHOLE", ())
        return Camera(name=name, width=width, height=height, model=model, params=(*self.intrinsics, *rest)).colmap()


def find_features(photos: tuple[Photo, ...], database: Path, lenses: Lenses, seed: int = 0) -> None:
    """Write the photographs' features, and what is known of their cameras, into a new database."""
    pycolmap.logging.minloglevel = int(pycolmap.logging.FATAL)
    pycolmap.set_random_seed(seed)
    say(f"features of {len(photos)} photographs")
    folder, mode = photos[0].path.parent, pycolmap.CameraMode
    reader = pycolmap.ImageReaderOptions(camera_model="RADIAL")
    pycolmap.Database.open(database).close()
    for names in lenses.groups(photos):
        # before the features, since these come in the order in which threads are done
        pycolmap.import_images(database, folder, mode.SINGLE, names, reader)
    octaves, held = defaultdict(list), lenses.known and lenses.focal_px  # by known lenses and a board
    for photo in photos:
        side_px = max(photo.width, photo.height)  # octave −1 is that of twice the size, 1 that of half of it
        octaves[-1 if side_px < SMALL_PX else int(bool(held) and side_px >= LARGE_PX)].append(photo.name)
    for octave, names in octaves.items():
        options = pycolmap.FeatureExtractionOptions(max_image_size=LONGEST_SIDE_PX)
        options.sift.max_num_features = MOST_FEATURES
        options.sift.first_octave = octave
        if octave > 0:
            options.sift.peak_threshold = FAINT
        pycolmap.extract_features(database, folder, names, mode.PER_IMAGE, reader, options, device=pycolmap.Device.cpu)
    _write_cameras(database, photos, lenses)


def _write_cameras(database: Path, photos: tuple[Photo, ...], lenses: Lenses) -> None:
    """Give the database's cameras what is known of them, or else the median focal length of their photographs."""
    guess_px = lenses.focal_px or {photo.name: photo.focal_px for photo in photos if photo.focal_px is not None}
    with pycolmap.Database.open(database) as stored:
        images = stored.read_all_images()
        for camera in stored.read_all_cameras():
            names = [image.name for image in images if image.camera_id == camera.camera_id]
            known = lenses.given(names[0], camera.width, camera.height)
            focal_px = [guess_px[name] for name in names if name in guess_px]
            if known is not None:
                known.camera_id = camera.camera_id
                camera = known
            elif focal_px:
                camera.params = [float(np.median(focal_px)), *camera.params[1:]]
            else:
                continue
            camera.has_prior_focal_length = True
            stored.update_camera(camera)


def match(database: Path, seed: int) -> None:
    """Match every pair, and keep the matches that one motion explains."""
    say("matching every pair")
    matching = pycolmap.FeatureMatchingOptions(num_threads=1)  # with more, the index of descriptors does not repeat
    verification = pycolmap.TwoViewGeometryOptions()
    verification.ransac.random_seed = seed
    pycolmap.match_exhaustive(database, matching, verification_options=verification, device=pycolmap.Device.cpu)


def pipeline_options(seed: int) -> "pycolmap.IncrementalPipelineOptions":
    """COLMAP's options to register and triangulate photographs so that the same seed gives the same model."""
    options = pycolmap.IncrementalPipelineOptions(random_seed=seed, extract_colors=False)
    options.num_threads = 1  # sums over threads would not repeat bit for bit
    options.mapper.random_seed = options.triangulation.random_seed = seed
    options.triangulation.ignore_two_view_tracks = False
    return options


def agreement(database: Path, posed: "pycolmap.Reconstruction") -> float:
    """Keep the matches that the known motion of all cameras explains instead; returns their number, over that of the
    matches that any motion explained."""
    with pycolmap.Database.open(database) as stored:
        before = stored.num_inlier_matches()
    pycolmap.guided_geometric_verification(posed, database, num_threads=1)
    with pycolmap.Database.open(database) as stored:
        return stored.num_inlier_matches() / max(before, 1)


def scales_px(database: Path) -> dict[str, np.ndarray]:
    """Photograph → the scale [n] of each of its features, standard deviation of the blur that it was found at."""
    with pycolmap.Database.open(database) as stored:
        keypoints = {image.name: stored.read_keypoints(image.image_id) for image in stored.read_all_images()}
    # x, y and the shape [2, 2], a turned multiple of the unit matrix
    return {name: np.sqrt(np.abs(np.linalg.det(k[:, 2:6].reshape(-1, 2, 2)))) for name, k in keypoints.items()}
