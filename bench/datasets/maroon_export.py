"""The way back: a capture as one object at one distance of MAROON, for their tools and for tests of ours."""

from dataclasses import replace
from pathlib import Path

import numpy as np

from bench.datasets.dataset import open_capture
from bench.datasets.maroon import EMPTY_FILTERED, FRAMES, MESHES, METADATA, PHOTOGRAMMETRY, VOLUMES
from bench.datasets.maroon_alignment import ALIGNMENT, save_alignment
from bench.datasets.maroon_frame import Frame, write_frame
from bench.datasets.native import EMPTY, TRUE_TRANSFORM, NativeCapture
from calibration.transforms import Transform, load_transform
from groundtruth.mesh.mesh_files import read_triangles
from radar.data.arrays import SPEED_OF_LIGHT_M_S, AntennaArray, qar50
from radar.data.capture import RadarCapture
from radar.data.echoes_file import load_capture
from radar.methods.registry import method
from radar.support.errors import HandbenchError
from radar.support.files import atomic_folder, atomic_path, write_json

SAME_M = 1e-7  # positions that agree to this are the same


def export_maroon(path: str | Path, root: str | Path, overwrite: bool = False) -> Path:
    """Write the capture at `path` as ROOT/NAME/CENTIMETRES, all or nothing, and return that folder.

    Echoes come back bit for bit. The layout has no place for what a mesh's vertices carry (sigma_m, observed), for a
    transform's covariance, and for the methods' settings but the box of `broadband`. Where the echoes of the empty room
    are known, the frames NNNNNN_emptyfiltered.npy are without them. A simulated capture without transform of its own
    gets the true one. Raises HandbenchError for another array than the radar's, which the layout takes for granted,
    without a distance, and for a folder that is there already, if not to be overwritten.
    """
    capture = open_capture(path)
    about, echoes = capture.about, capture.echoes()
    _require_radar(capture, echoes)
    if about.distance_m is None:
        raise HandbenchError(f"{capture.folder}: gives no distance_m, after which MAROON names its folders; add it")
    folder = Path(root) / about.name / f"{100 * about.distance_m:.0f}"
    if folder.exists() and not overwrite:
        raise HandbenchError(f"{folder}: exists already; choose another -o, or --overwrite to replace it")
    low_ghz, high_ghz = echoes.frequencies_hz.min() / 1e9, echoes.frequencies_hz.max() / 1e9
    with atomic_folder(folder) as temporary:
        radar = temporary / f"radar_{low_ghz:.1f}_{high_ghz:.1f}_{len(echoes.frequencies_hz)}"
        _write_frames(radar / FRAMES, echoes, "")
        empty = capture.folder / EMPTY
        if empty.is_file():
            filtered = replace(echoes, samples=echoes.samples - load_capture(empty).samples)
            _write_frames(radar / FRAMES, filtered, f"_{EMPTY_FILTERED}")
        write_json(radar / VOLUMES, {f"{0:06d}": {"volume": _volume(capture)}})
        box = {"zmin": 0.0, "zmax": 2 * about.distance_m}
        facts = {"distance_meters": about.distance_m, "mask_erosion": 0, "labels": [about.name], "mask_bb": box}
        write_json(temporary / METADATA, facts)
        _write_surfaces(capture, temporary)
    return folder


def _require_radar(capture: NativeCapture, echoes: RadarCapture) -> None:
    ours, radar = echoes.aperture, qar50()
    if (
        not isinstance(ours, AntennaArray)
        or ours.channels != radar.channels
        or max(np.abs(ours.tx_m - radar.tx_m).max(), np.abs(ours.rx_m - radar.rx_m).max()) > SAME_M
        or ours.measured is not None
        or echoes.wave_speed_m_s != SPEED_OF_LIGHT_M_S
    ):
        raise HandbenchError(
            f'{capture.folder}: its antennas are not those of MAROON\'s radar, array = "qar50", all pairs'
        )


def _write_frames(folder: Path, echoes: RadarCapture, suffix: str) -> None:
    for number, samples in enumerate(echoes.samples):
        frame = Frame(samples, echoes.frequencies_hz, len(echoes.samples))
        write_frame(folder / f"{number:06d}{suffix}.npy", number, frame)


def _volume(capture: NativeCapture) -> dict[str, list[float]]:
    """The box of the broadband method for this capture, in their frame."""
    chosen = method("broadband")
    grid = chosen.configure(capture.about.methods.get(chosen.id, {}), str(capture.folder)).grid()
    x_m, y_m, z_m = -grid.x_m[::-1], grid.y_m, grid.z_m
    ends = {key: [axis[end] for axis in (x_m, y_m, z_m)] for key, end in (("bb_min", 0), ("bb_max", -1))}
    return {**ends, "grid_size": [len(axis) for axis in (x_m, y_m, z_m)]}


def _write_surfaces(capture: NativeCapture, folder: Path) -> None:
    """alignment.json; the true surface as "synthetic" mesh; the measured surface, or else the true one, as the meshes
    that are scored. Where nothing was photographed, the photo frame is the radar's own."""
    measured, true, transform = capture.mesh(), capture.truth, capture.transform()
    file = capture.folder / TRUE_TRANSFORM
    if transform is None and file.exists():
        transform = load_transform(file)
    elif transform is None and measured is None and capture.photos is None:
        transform = Transform("photo", "radar", np.eye(4))
    surfaces = {} if measured is None else dict.fromkeys(("whole", "masked"), read_triangles(measured)[:2])
    if transform is not None:
        save_alignment(folder / ALIGNMENT, transform)
        if true is not None:
            vertices_m, faces, _ = read_triangles(true)
            carried = transform.inverse().points(vertices_m), faces
            surfaces = {"synthetic": carried} | (surfaces or dict.fromkeys(("whole", "masked"), carried))
    for kind, (vertices_m, faces) in surfaces.items():
        file = folder / PHOTOGRAMMETRY / MESHES[kind]
        with atomic_path(file) as temporary, temporary.open("w", encoding="ascii") as stream:
            np.savetxt(stream, vertices_m, "v %.9f %.9f %.9f")  # to a nanometre
            np.savetxt(stream, faces + 1, "f %d %d %d")
