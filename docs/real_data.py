"""The tables and figures of docs/real_data.md, and the table of measured echoes in README.md, from
measured sets that you have downloaded:

    python -m docs.real_data FOLDER WORK

FOLDER: has the files of the sets somewhere below it; a set whose files are missing is left out, and
its tables stay as they are. WORK: the folder to make, with a capture for each set.
"""

from __future__ import annotations

import re
import shutil
import sys
import time
from dataclasses import replace
from datetime import date
from pathlib import Path

import numpy as np
from matplotlib import rc_context
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from scipy.io import loadmat
from scipy.ndimage import uniform_filter1d

from handbench.bench.datasets.mapped_capture import MAPPING
from handbench.bench.evaluation.metrics import TITLES
from handbench.bench.pipeline.image import configuration
from handbench.bench.pipeline.measured import MeasuredImage, image_measured
from handbench.interface import load, save_capture
from handbench.radar.data.arrays import SPEED_OF_LIGHT_M_S, AntennaArray
from handbench.radar.data.capture import RadarCapture
from handbench.radar.methods.registry import method
from handbench.radar.simulation.catalogue import EFFECTS
from handbench.radar.simulation.scene import Body, EchoScene
from handbench.radar.simulation.scene_echoes import bare_echoes
from handbench.reports.figures.measured import measured_figure
from handbench.reports.figures.style import STYLE, save
from handbench.reports.tables.result_tables import table
from handbench.support.cost import machine
from handbench.support.files import write_text

ROOT = Path(__file__).parents[1]
PAGE, README = ROOT / "docs/real_data.md", ROOT / "README.md"
FILES = {
    "tape": ("CopperTape_15cm.mat", "ProbeResponse2.mat"),
    "tumour-11mm": ("B0_P3_p000.csv", "B0_P3_p036.csv"),
    "tumour-20mm": ("B0_P5_p000.csv", "B0_P5_p036.csv"),
    "chair": ("sar_raw.npy", "depth1.mat"),
    "dihedrals": ("m5", "m7", "m10", "m15"),
}
# two scans of a phantom, between which it was turned
TUMOUR = """
version = 1
wave_speed_m_s = 1.05993e8  # permittivity 8

[capture]
name = "NAME"
kind = "other"
source = "github.com/EMFMed/MERIT, SCAN"

[samples]
dataset = "SCAN_p000.csv"
axes = ["frequency", "pair"]
reversed = false
sign = "-"

[background]
dataset = "SCAN_p036.csv"
axes = ["frequency", "pair"]
reversed = false

[frequencies]
dataset = "frequencies.csv"
unit = "Hz"

[tx]
dataset = "antenna_locations.csv"
reversed = false
unit = "m"
x = "left"

[rx]
dataset = "antenna_locations.csv"
reversed = false
unit = "m"
x = "left"

[pairs]
dataset = "channel_names.csv"
reversed = false
first = 1

[capture.methods.broadband]
x = { start_m = -0.06, stop_m = 0.06, step_m = 0.0025 }
y = { start_m = -0.06, stop_m = 0.06, step_m = 0.0025 }
z = { start_m = 0.005, stop_m = 0.06, step_m = 0.0025 }
start_hz = 1.5e9
stop_hz = 4.5e9
count = 76
"""
MERIT = ("frequencies.csv", "antenna_locations.csv", "channel_names.csv")
FILES |= {name: (*files, *MERIT) for name, files in FILES.items() if name.startswith("tumour")}
TUMOURS_M = {"tumour-11mm": (0.015, 0.0, 0.035), "tumour-20mm": (0.015, 0.0, 0.030)}
RINGS = (range(10), range(10, 20), range(20, 24))  # antennas at one height
CAMERA_PX = 700.0, 640.0, 360.0  # focal length and centre of the chair's stereo camera
EDGES_M = {"m5": 0.05, "m7": 0.07, "m10": 0.10, "m15": 0.15}  # of the dihedrals
# of the dihedrals' radar, from its authors' example: below its beam, and to the corner
BELOW_M, DISTANCE_M, DIHEDRAL_HZ = 0.067, 0.896, np.linspace(77e9, 80.07e9, 5)
FLASH_DEG = 34.0, 49.0  # where a face turns its normal to the radar
FRINGE_DEG = 0.5  # fringes of a face and the corner behind it are finer


def gather(folder: Path, work: Path) -> set[str]:
    """Make a capture WORK/NAME of each set whose files are all below `folder`; return the sets'
    names."""
    complete = set()
    for name, files in FILES.items():
        found = {file: next(folder.rglob(file), None) for file in files}
        if None in found.values():
            print(f"{name}: left out; {folder} lacks {', '.join(f for f in found if not found[f])}")
            continue
        complete.add(name)
        if (work / name).exists():
            continue
        given = {file: path for file, path in found.items() if path is not None}
        if name in CAPTURES:
            CAPTURES[name](work / name, given)
        else:
            (work / name).mkdir(parents=True)
            for file, path in given.items():
                shutil.copyfile(path, work / name / file)
        if name in TUMOURS_M:
            text = TUMOUR.replace("NAME", name).replace("SCAN", files[0].split("_p")[0])
            write_text(work / name / MAPPING, text)
    return complete


def span(start_m: float, stop_m: float, step_m: float) -> dict[str, float]:
    """An axis of a method's pixels or voxels."""
    return {"start_m": start_m, "stop_m": stop_m, "step_m": step_m}


def tape_capture(out: Path, files: dict[str, Path]) -> None:
    """A pair of antennas, 120 mm apart, at 12 × 12 places; each sample is divided by the phase of a
    probe's response, passed twice. Both signs of the positions are turned, as the set's own script
    does."""
    data = loadmat(files["CopperTape_15cm.mat"])["data"][0, 0]
    probe = loadmat(files["ProbeResponse2.mat"])["ProbeResponse2"].ravel()[::4]
    samples = data["measurements"].T.reshape(101, 144) * np.exp(-2j * np.angle(probe))[:, None]
    x_mm, y_mm = (-data[axis].T.ravel() for axis in "XY")
    places_m = np.stack([x_mm, y_mm, 0 * x_mm], axis=1) / 1e3
    half_m = np.array([0.06, 0, 0])
    pixels = {"x": span(-0.1, 0.1, 0.005), "y": span(-0.1, 0.1, 0.005)}
    pair = {"f1_hz": 8.2e9, "f2_hz": 7.2e9}
    three = {"f1_hz": 8.2e9, "f2_hz": 7.7e9, "f3_hz": 5.7e9}
    sweep = {"start_hz": 5.7e9, "stop_hz": 8.2e9, "count": 101}
    save_capture(
        out,
        samples[None],
        np.linspace(5.7e9, 8.2e9, 101),
        places_m - half_m,
        places_m + half_m,
        pairs=np.repeat(np.arange(144)[:, None], 2, axis=1),
        kind="other",
        distance_m=0.15,
        methods={
            "2fsk": {**pixels, **pair, "first_depth_m": "auto"},
            "3fsk": {**pixels, **three, "first_depth_m": "auto"},
            "narrowband": {**pixels, **three, "z": span(0.1, 0.2, 0.001)},
            "broadband": {**pixels, **sweep, "z": span(0.05, 0.3, 0.001)},
        },
    )


def chair_capture(out: Path, files: dict[str, Path]) -> None:
    """One transmitter and four receivers at 3 stops × 64 snapshots. The chair is within one
    ambiguity of 32 of the 256 tones, 1.28 m."""
    raw = np.load(files["sar_raw.npy"])[:, :, :4].conj()  # [stop, snapshot, receiver, sample]
    y_mm, x_mm = np.meshgrid(2.42 * np.arange(64) - 76.23, 19.34 * np.arange(-1, 2), indexing="ij")
    places_m = np.stack([x_mm, y_mm, 0 * x_mm], axis=-1).reshape(-1, 3) / 1e3
    across_m = np.multiply.outer([0, 2.418e-3, 4.835e-3, 7.253e-3], [1, 0, 0])
    rx_m = (places_m[:, None] + across_m).reshape(-1, 3)
    channels = np.arange(len(rx_m))
    grid = {"x": span(-0.45, 0.45, 0.03), "y": span(-0.51, 0.45, 0.03), "z": span(1.6, 1.96, 0.02)}
    sweep = {"start_hz": 60e9, "stop_hz": 63.632406e9, "count": 32}
    save_capture(
        out,
        raw.transpose(3, 1, 0, 2).reshape(1, 256, -1),
        60e9 + 14.646800195407914e6 * np.arange(256),
        places_m,
        rx_m,
        pairs=np.stack([channels // 4, channels], axis=1),
        kind="scan",
        methods={"broadband": {**grid, **sweep, "subvoxel": True}},
    )
    shutil.copyfile(files["depth1.mat"], out / "depth1.mat")


CAPTURES = {"tape": tape_capture, "chair": chair_capture}


def tape(work: Path) -> str:
    """Image the tape, draw it, and return its table."""
    images = list(image_measured(work / "tape"))
    save(
        measured_figure(
            [
                (
                    TITLES[i.method],
                    i.depth.x_m,
                    i.depth.y_m,
                    np.where(i.strong, i.depth.z_m, np.nan),
                )
                for i in images
            ]
        ),
        ROOT / "docs/real_tape.png",
    )
    columns = ("", "distance mm", "error mm", "std mm", "pixels", "seconds")
    return table(columns, [tape_row(image) for image in images])


def tape_row(image: MeasuredImage) -> tuple[str, ...]:
    """The tape's line of a method."""
    distance_mm = 1e3 * image.median_m
    return (
        TITLES[image.method],
        f"{distance_mm:.1f}",
        f"{distance_mm - 1e3 * (image.distance_m or np.nan):+.1f}",
        f"{1e3 * image.std_m:.2f}",
        f"{image.strong.sum()}",
        f"{image.seconds:.1f}",
    )


def tumours(work: Path) -> str:
    """Image both tumours as they are and with the rings' delays from the first one; draw them and
    return their table."""
    captures = {name: load(work / name) for name in TUMOURS_M}
    first = next(iter(TUMOURS_M))
    delays_m = ring_delays_m(captures[first].echoes, TUMOURS_M[first])
    lines, panels = [], []
    for name, capture in captures.items():
        settings = configuration(work / name, "broadband", {})
        for what, extra_m in (("as measured", np.zeros(3)), ("rings corrected", delays_m)):
            found = method("broadband").run(advanced(capture.echoes, extra_m), settings, 0)
            depth, truth_m = found.depth, np.array(TUMOURS_M[name])
            level = np.where(np.isfinite(depth.z_m), depth.amplitude_db, -np.inf)
            row, column = np.unravel_index(level.argmax(), level.shape)
            peak_m = np.array([depth.x_m[column], depth.y_m[row], depth.z_m[row, column]])
            lines.append(
                (
                    name,
                    what,
                    ", ".join(f"{1e3 * v:.1f}" for v in truth_m),
                    ", ".join(f"{1e3 * v:.1f}" for v in peak_m),
                    f"{1e3 * np.linalg.norm(peak_m - truth_m):.1f}",
                )
            )
            plane = np.abs(found.volume())[:, row]
            panels.append((f"{name}, {what}", depth.x_m, found.volume_z_m, plane, peak_m, truth_m))
    with rc_context(STYLE):
        figure = Figure(figsize=(5.4, 3.6), layout="constrained")
        for axis, (title, x_m, z_m, plane, peak_m, truth_m) in zip(
            figure.subplots(2, 2, sharex=True, sharey=True).ravel(), panels, strict=True
        ):
            axis.pcolormesh(1e3 * x_m, 1e3 * z_m, plane / plane.max(), cmap="viridis")
            axis.plot(*(1e3 * truth_m[[0, 2]]), "wo", markersize=10, fillstyle="none")
            axis.plot(*(1e3 * peak_m[[0, 2]]), "r+", markersize=10)
            axis.set(title=title, xlabel="x in mm", ylabel="z in mm", aspect="equal")
            axis.label_outer()
    save(figure, ROOT / "docs/real_tumours.png")
    print("delays of the rings, mm of path in vacuum:", (1e3 * delays_m).round())
    return table(("", "", "tumour at mm", "peak at mm", "error mm"), lines)


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
        t, r = (axis.ravel() for axis in np.meshgrid(ring, ring, indexing="ij"))
        path_m = slower * (away_m[:, t] + away_m[:, r])
        tones = np.einsum(
            "fpc,fc->fp",
            np.exp(1j * wavenumber[:, None, None] * path_m),
            echoes.samples[0][:, t, r],
        )
        images = np.exp(1j * np.outer(candidates_m, wavenumber)) @ tones
        best.append(candidates_m[np.abs(images).max(axis=1).argmax()])
    return np.array(best)


def advanced(echoes: RadarCapture, delays_m: np.ndarray) -> RadarCapture:
    """The capture without each ring's extra path, metres in vacuum."""
    of_antenna_m = np.concatenate(
        [[d] * len(ring) for d, ring in zip(delays_m, RINGS, strict=True)]
    )
    turns = np.outer(echoes.frequencies_hz, of_antenna_m) / SPEED_OF_LIGHT_M_S
    samples = echoes.samples * np.exp(2j * np.pi * turns)[None, :, :, None]
    return replace(echoes, samples=samples.astype(np.complex64))


def chair(work: Path) -> str:
    """Compare the chair's depths with those of the stereo camera, less the radar's range offset;
    draw both and return their table."""
    [image] = image_measured(work / "chair")
    depth, folder = image.depth, work / "chair"
    stereo_m = loadmat(folder / "depth1.mat")["depimg"] / 1e3
    x, y = np.meshgrid(depth.x_m, depth.y_m)
    seen = np.isfinite(depth.z_m) & (depth.amplitude_db > -15)
    offset_m = 0.0
    for _ in range(10):  # the offset changes where a pixel is in the camera's image
        z_m = depth.z_m - offset_m
        focal, u0, v0 = CAMERA_PX
        with np.errstate(invalid="ignore"):
            u = (
                np.nan_to_num(u0 - focal * x / z_m)
                .round()
                .astype(int)
                .clip(0, stereo_m.shape[1] - 1)
            )
            v = (
                np.nan_to_num(v0 - focal * y / z_m)
                .round()
                .astype(int)
                .clip(0, stereo_m.shape[0] - 1)
            )
        truth_m = stereo_m[v, u]
        use = seen & (truth_m < 1.9)  # the chair, not the wall behind it
        offset_m = float(np.median(depth.z_m[use] - truth_m[use]))
    error_m = depth.z_m - offset_m - truth_m
    constant_m = np.abs(truth_m[use] - np.median(truth_m[use]))
    panels = [
        ("radar, offset removed", np.where(use, depth.z_m - offset_m, np.nan)),
        ("stereo camera", np.where(use, truth_m, np.nan)),
    ]
    save(
        measured_figure([(title, depth.x_m, depth.y_m, z_m) for title, z_m in panels]),
        ROOT / "docs/real_chair.png",
    )
    columns = ("", "range offset mm", "median error mm", "of one depth for all mm", "pixels", "s")
    median_mm = f"{1e3 * np.median(np.abs(error_m[use])):.0f}"
    line = (
        f"{TITLES[image.method]}, 32 tones",
        f"{1e3 * offset_m:.0f}",
        median_mm,
        f"{1e3 * np.median(constant_m):.0f}",
        f"{use.sum()} of {seen.sum()}",
        f"{image.seconds:.0f}",
    )
    return table(columns, [line])


def dihedrals(work: Path) -> str:
    """Compare the echoes of turned dihedrals with simulated ones; draw both and return a table of
    the faces' flashes."""
    angles_deg = np.concatenate([np.arange(0, FLASH_DEG[0], 1), np.arange(*FLASH_DEG, 0.1)])
    start = time.perf_counter()
    simulated = [
        [dihedral_power(edge_m, np.radians(deg)) for deg in angles_deg]
        for edge_m in EDGES_M.values()
    ]
    print(f"simulated in {time.perf_counter() - start:.0f} s")
    lines = []
    with rc_context(STYLE):
        figure = Figure(figsize=(5.4, 4.2), layout="constrained")
        axes = figure.subplots(2, 2, sharex=True, sharey=True).ravel()
        for axis, (name, edge_m), ours_db in zip(
            axes, EDGES_M.items(), 10 * np.log10(simulated), strict=True
        ):
            cube = np.fromfile(work / "dihedrals" / name, "<c8").reshape(601, 256)
            theirs_deg = 53.8 * np.linspace(1, -1, 601) - 2.8
            theirs_db = 20 * np.log10(np.abs(cube[:, 20]))
            theirs_db = theirs_db - theirs_db.max()
            turned, powers = (
                np.concatenate([-angles_deg[:0:-1], angles_deg]),
                ours_db - ours_db.max(),
            )
            powers = np.concatenate([powers[:0:-1], powers])
            draw_dihedral(axis, edge_m, (theirs_deg, theirs_db), (turned, powers))
            far_deg = np.degrees(0.443 * SPEED_OF_LIGHT_M_S / DIHEDRAL_HZ.mean() / edge_m)
            widths = [flash_width_deg(theirs_deg * side, theirs_db) for side in (1, -1)]
            levels = [
                np.median(db[np.abs(deg) < 3]) - db[np.abs(np.abs(deg) - 42) < 7].max()
                for deg, db in ((theirs_deg, theirs_db), (turned, powers))
            ]
            lines.append(
                (
                    f"{1e2 * edge_m:.0f} cm",
                    " / ".join(f"{width:.2f}" for width in widths),
                    f"{flash_width_deg(turned, powers):.2f}",
                    f"{far_deg:.2f}",
                    *(f"{level:+.1f}" for level in levels),
                )
            )
    save(figure, ROOT / "docs/real_dihedrals.png")
    columns = (
        "edge",
        "width measured °",
        "simulated °",
        "0.443 λ/L °",
        "corner − flash measured dB",
        "simulated dB",
    )
    return table(columns, lines)


def draw_dihedral(axis: Axes, edge_m: float, theirs: tuple, ours: tuple) -> None:
    """Draw power over angle, measured and simulated."""
    axis.plot(*theirs, color="#0072B2", linewidth=0.9, label="measured")
    axis.plot(*ours, color="#D55E00", linewidth=0.9, label="simulated")
    axis.set(title=f"{1e2 * edge_m:.0f} cm", xlim=(-50, 50), ylim=(-25, 1))
    axis.set(xlabel="angle in °", ylabel="power in dB")
    axis.label_outer()
    axis.legend(loc="lower center", fontsize=8)


def flash_width_deg(angle_deg: np.ndarray, power_db: np.ndarray) -> float:
    """How many degrees of FLASH_DEG are within 3 dB of its maximum; the power is first averaged
    over FRINGE_DEG."""
    fine_deg, order = np.arange(*FLASH_DEG, 0.01), np.argsort(angle_deg)
    power = 10 ** (np.interp(fine_deg, angle_deg[order], power_db[order]) / 10)
    power = uniform_filter1d(power, round(FRINGE_DEG / 0.01))
    return 0.01 * np.count_nonzero(power > power.max() / 2)


def dihedral_power(edge_m: float, turn_rad: float) -> float:
    """Simulate the power of a metal dihedral, turned about its upright edge, in the range bin of
    that edge: physical optics with up to four bounces."""
    array = AntennaArray(np.array([[-0.001, 0.0, 0.0]]), np.array([[0.001, 0.0, 0.0]]))
    times_s = np.zeros(len(DIHEDRAL_HZ))
    body = dihedral(edge_m, turn_rad)
    scene = EchoScene(array, DIHEDRAL_HZ, times_s, body, coarser=2.0, mirrors_coarser=2.0)
    echoes = bare_echoes(scene)
    for effect in EFFECTS:
        if effect.id in ("obliquity", "multipath"):
            echoes = effect.apply(echoes)
    phase = 4 * np.pi * DIHEDRAL_HZ * DISTANCE_M / SPEED_OF_LIGHT_M_S
    window = np.hanning(len(DIHEDRAL_HZ) + 2)[1:-1]
    return float(np.abs((window * echoes.samples[0, :, 0, 0] * np.exp(1j * phase)).sum()) ** 2)


def dihedral(edge_m: float, turn_rad: float) -> Body:
    """Two squares at a right angle, open to the radar, whose common edge is upright at
    DISTANCE_M."""
    vertices: list[np.ndarray] = []
    faces: list[list[int]] = []
    low_m, up_m = np.array([0.0, -BELOW_M, DISTANCE_M]), np.array([0.0, edge_m, 0.0])
    for side in (1, -1):
        angle = turn_rad + side * np.pi / 4
        out_m = edge_m * np.array([np.sin(angle), 0.0, -np.cos(angle)])
        n, front = len(vertices), [[0, 2, 1], [0, 3, 2]] if side > 0 else [[0, 1, 2], [0, 2, 3]]
        vertices += [low_m, low_m + out_m, low_m + out_m + up_m, low_m + up_m]
        faces += [[n + i for i in face] for face in front]
    return Body(np.array(vertices), np.array(faces))


TABLES = {"tape": tape, "tumour-20mm": tumours, "chair": chair, "dihedrals": dihedrals}


def renew(page: Path, name: str, text: str) -> None:
    """Replace what is between the markers of a name on a page."""
    marked = re.compile(rf"(<!-- {name}: begin -->\n).*?(<!-- {name}: end -->)", re.DOTALL)
    write_text(page, marked.sub(lambda m: m[1] + text + m[2], page.read_text("utf-8")))


def main(folder: Path, work: Path, *only: str) -> None:
    """Renew the tables and figures of all sets that are there (or of those in `only`)."""
    facts = machine()
    about = f"\n{date.today()}; cores: {facts['cores']}, {facts['processor']}.\n"
    complete = gather(folder, work)
    for name, make in TABLES.items():
        if name in complete and name in (only or TABLES):
            text = make(work) + about
            print(text)
            renew(PAGE, name, text)
            if name == "tape":
                renew(README, "measured", text)


if __name__ == "__main__":
    main(Path(sys.argv[1]), Path(sys.argv[2]), *sys.argv[3:])
