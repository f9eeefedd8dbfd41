"""The tables of docs/real_data.md, from measured sets that you have downloaded:

    python -m docs.real_data FOLDER WORK

FOLDER: has the files of the sets somewhere below it; a set whose files are missing is left out.
WORK: gets a capture for each set. Where the files are from, and their layout, is in
docs/real_tape.toml, real_tumour.toml and real_chair.toml.
"""

from __future__ import annotations

import shutil
import sys
import tomllib
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
from scipy.io import loadmat
from scipy.ndimage import map_coordinates

import handbench as hb
from handbench.bench.datasets.dataset import open_capture
from handbench.bench.stages.image import configured
from handbench.radar.data.arrays import SPEED_OF_LIGHT_M_S
from handbench.radar.data.capture import RadarCapture
from handbench.radar.methods.registry import method
from handbench.support.files import write_text

HERE = Path(__file__).parent
MERIT = ("frequencies.csv", "antenna_locations.csv", "channel_names.csv")
TUMOURS_M = {"tumour-11mm": (0.015, 0.0, 0.035), "tumour-20mm": (0.015, 0.0, 0.030)}
RINGS = (range(10), range(10, 20), range(20, 24))  # antennas at one height
# of the chair's stereo camera: focal length; the middle's column and row
FOCAL_PX, COLUMN_PX, ROW_PX = 700.0, 640.0, 360.0


def gather(folder: Path, work: Path) -> list[str]:
    """Make WORK/NAME of each set whose files are below `folder`, and return the sets' names."""
    complete = []
    for name, (save, *files) in SETS.items():
        paths = [next(folder.rglob(file), None) for file in files]
        if None in paths:
            print(f"{name}: left out; {folder} lacks some of {', '.join(files)}")
            continue
        shutil.rmtree(work / name, ignore_errors=True)
        save(work / name, *paths)
        complete.append(name)
    return complete


def save_tumour(folder: Path, *files: Path) -> None:
    """Copy the files of a tumour into its capture, with a mapping that describes them."""
    folder.mkdir(parents=True)
    for file in files:
        shutil.copy(file, folder)
    mapping = (HERE / "real_tumour.toml").read_text("utf-8")
    if folder.name == "tumour-20mm":
        mapping = mapping.replace("11mm", "20mm").replace("_P3", "_P5")
    write_text(folder / "mapping.toml", mapping)


def save_tape(folder: Path, samples_file: Path, probe_file: Path) -> None:
    """Write the tape's capture. Its samples are divided by the phase of the probe, twice, and x and
    y are turned, as the set's own script does; Tx and Rx are 60 mm to either side of the place."""
    data, probe = loadmat(samples_file)["data"][0, 0], loadmat(probe_file)["ProbeResponse2"]
    samples = data["measurements"] / np.exp(2j * np.angle(probe[::4, 0]))  # [12, 12, frequency]
    place_m = -1e-3 * np.stack([data["X"], data["Y"], 0 * data["X"]], axis=-1).reshape(-1, 3)
    aside_m = np.array([0.06, 0.0, 0.0])
    frequencies_hz = np.linspace(5.7e9, 8.2e9, 101)
    save_pairs(folder, samples, frequencies_hz, place_m - aside_m, place_m + aside_m)


def save_chair(folder: Path, samples_file: Path, stereo_file: Path) -> None:
    """Write the chair's capture: one transmitter and four receivers at 3 stops × 64 snapshots."""
    samples = np.load(samples_file)[:, :, :4].conj()  # [stop, snapshot, receiver, frequency]
    x_mm, y_mm, right_mm = np.meshgrid(
        19.34 * np.arange(-1, 2),
        2.42 * np.arange(64) - 76.23,
        [0, 2.418, 4.835, 7.253],
        indexing="ij",
    )
    tx_m, rx_m = (
        1e-3 * np.stack([x, y_mm, 0 * x], axis=-1).reshape(-1, 3) for x in (x_mm, x_mm + right_mm)
    )
    save_pairs(folder, samples, 60e9 + 14.646800195407914e6 * np.arange(256), tx_m, rx_m)
    shutil.copyfile(stereo_file, folder / "depth1.mat")


def save_pairs(
    folder: Path,
    samples: np.ndarray,
    frequencies_hz: np.ndarray,
    tx_m: np.ndarray,
    rx_m: np.ndarray,
) -> None:
    """Write a capture of samples [..., frequency] of as many pairs of antennas [n, 3], with the
    description of its set."""
    hb.save_capture(
        folder,
        samples.reshape(len(tx_m), -1).T[None],
        frequencies_hz,
        tx_m,
        rx_m,
        pairs=np.repeat(np.arange(len(tx_m))[:, None], 2, axis=1),
        **tomllib.loads((HERE / f"real_{folder.name}.toml").read_text("utf-8")),
    )


SETS = {  # what makes a capture of a set, and its files
    "tape": (save_tape, "CopperTape_15cm.mat", "ProbeResponse2.mat"),
    "tumour-11mm": (save_tumour, "B0_P3_p000.csv", "B0_P3_p036.csv", *MERIT),
    "tumour-20mm": (save_tumour, "B0_P5_p000.csv", "B0_P5_p036.csv", *MERIT),
    "chair": (save_chair, "sar_raw.npy", "depth1.mat"),
}


def imaged(folder: Path, echoes: RadarCapture) -> hb.Depth:
    """Image echoes by broadband backprojection, as the capture's description sets it up."""
    config = configured(open_capture(folder).about, "broadband", {})
    return hb.Depth(method("broadband").run(echoes, config))


def tape(work: Path) -> pd.DataFrame:
    """Image the tape, 150 mm away, by four methods."""
    rows = []
    for id in ("2fsk", "3fsk", "narrowband", "broadband"):
        depth = hb.load(work / "tape").reconstruct(id)
        strong_mm = 1e3 * depth.z_m[depth.amplitude_db >= -6]
        rows.append(
            [id, np.nanmedian(strong_mm), np.nanstd(strong_mm), np.isfinite(strong_mm).sum()]
        )
    return pd.DataFrame(rows, columns=["method", "distance mm", "std mm", "pixels"])


def tumours(work: Path) -> pd.DataFrame:
    """Image both tumours as they are, and with the rings' delays from the first one."""
    captures = {name: open_capture(work / name).echoes() for name in TUMOURS_M}
    (first, first_m), *_ = TUMOURS_M.items()
    delays_m = ring_delays_m(captures[first], first_m)
    rows = []
    for name, echoes in captures.items():
        for what, extra_m in (("as measured", np.zeros(3)), ("rings corrected", delays_m)):
            depth = imaged(work / name, advanced(echoes, extra_m))
            peak_m = depth.points_m()[depth.amplitude_db[np.isfinite(depth.z_m)].argmax()]
            error_mm = 1e3 * np.linalg.norm(peak_m - TUMOURS_M[name])
            rows.append([f"{name}, {what}", peak_m, error_mm])
    return pd.DataFrame(rows, columns=["set", "peak m", "error mm"])


def ring_delays_m(echoes: RadarCapture, target_m: tuple[float, float, float]) -> np.ndarray:
    """Find for each ring of antennas the extra path [ring], metres in vacuum, with which its own
    image is brightest at the height of a known target, within 12 mm beside it."""
    x, y = np.meshgrid(np.arange(-0.01, 0.0101, 0.0025), np.arange(-0.0075, 0.0101, 0.0025))
    points_m = np.array(target_m) + np.stack([x.ravel(), y.ravel(), 0 * x.ravel()], axis=1)
    away_m = np.linalg.norm(points_m[:, None] - echoes.aperture.tx_m, axis=2)
    wavenumber = 2 * np.pi * echoes.frequencies_hz / SPEED_OF_LIGHT_M_S
    slower = SPEED_OF_LIGHT_M_S / echoes.wave_speed_m_s
    candidates_m = np.arange(-0.08, 0.101, 0.01)
    best = []
    for ring in RINGS:
        path_m = slower * (away_m[:, ring, None] + away_m[:, None, ring])
        phases = np.exp(1j * wavenumber[:, None, None, None] * path_m)
        tones = np.einsum("fptr,ftr->fp", phases, echoes.samples[0][:, ring][:, :, ring])
        images = np.exp(1j * np.outer(candidates_m, wavenumber)) @ tones
        best.append(candidates_m[np.abs(images).max(axis=1).argmax()])
    return np.array(best)


def advanced(echoes: RadarCapture, delays_m: np.ndarray) -> RadarCapture:
    """Return the capture without each ring's extra path [ring], metres in vacuum."""
    of_antenna_m = np.repeat(delays_m, [len(ring) for ring in RINGS])
    turns = np.outer(echoes.frequencies_hz, of_antenna_m) / SPEED_OF_LIGHT_M_S
    samples = echoes.samples * np.exp(2j * np.pi * turns)[..., None]
    return replace(echoes, samples=samples.astype(np.complex64))


def chair(work: Path) -> pd.DataFrame:
    """Compare the chair's depths with those of the stereo camera, less the radar's range offset."""
    depth = hb.load(work / "chair").reconstruct("broadband")
    stereo_m = loadmat(work / "chair" / "depth1.mat")["depimg"] / 1e3
    x_m, y_m = np.meshgrid(depth.x_m, depth.y_m)
    seen = np.isfinite(depth.z_m) & (depth.amplitude_db > -15)
    z_m, offset_m = np.where(seen, depth.z_m, 1.0), 0.0
    for _ in range(10):  # the offset changes where a pixel is in the camera's image
        px_per_m = FOCAL_PX / (z_m - offset_m)
        pixels = [ROW_PX - px_per_m * y_m, COLUMN_PX - px_per_m * x_m]
        truth_m = map_coordinates(stereo_m, pixels, order=0, mode="nearest")
        use = seen & (truth_m < 1.9)  # the chair, not the wall behind it
        offset_m = float(np.median((z_m - truth_m)[use]))
    error_mm = 1e3 * np.median(np.abs(z_m - offset_m - truth_m)[use])
    return pd.DataFrame([{"offset mm": 1e3 * offset_m, "median error mm": error_mm}])


TABLES = {"tape": tape, "tumour-20mm": tumours, "chair": chair}


def main(folder: Path, work: Path) -> None:
    """Print the tables of all sets that are there."""
    complete = gather(folder, work)
    for name, table in TABLES.items():
        if name in complete:
            print(table(work).round(2), "\n")


if __name__ == "__main__":
    main(Path(sys.argv[1]), Path(sys.argv[2]))
