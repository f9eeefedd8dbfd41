"""The paper's block of a result folder, computed a second time: nothing here imports handbench.

`python tests/independent/table_by_hand.py RESULT` forms the ten figures (MAE and MAX of four
methods, precision of the two FSK ones) from RESULT/depth and RESULT/scores.csv and compares them
with RESULT/table.csv. With `--echoes FILE --capture NAME` it also makes the depths of that capture
from its echoes, by sums in double precision, and with `--repeats FILE --hand NAME` the strongest
scatterer's depth in each repeat. The definitions are those of docs/methods.md, docs/metrics.md and
docs/conventions.md.
"""

from __future__ import annotations

import argparse
import csv
import json
import sys
from collections.abc import Iterator
from pathlib import Path

import h5py
import numpy as np

LIGHT_M_S = 299_792_458.0
METHODS = ("2fsk", "3fsk", "broadband", "narrowband")
REFERENCES = ("photogrammetry", "completed", "truth")
# Maps, references and repeats are stored in double precision and the table with every digit: what
# may differ is the order of a sum of some ten thousand terms, about 1e-13.
TABLE_RTOL = 1e-9
# FSK's images are within 1e-5 of their largest value. At -10 dB two of them turn a phase by
# 2e-5·√10 = 6.3e-5 rad at most, c/(4πΔf) times as much in depth: 7.5 µm of 2-FSK, 0.7 µm of 3-FSK.
# That one starts from a depth that is off by 7.5 µm, of which the correction undoes all but the
# tenth that the path's slope differs from 2: 0.75 µm more.
FSK_BOUND_M = {"2fsk": 7.5e-6, "3fsk": 1.4e-6}
# times the map's own tolerance: an error of so much of the largest value, at -13 dB
DB_BOUND = 8.7 * 4.5
# two voxels within this of each other may change places by an error of 1e-5 at -13 dB: 2·4.5·1e-5
TIE = 1e-4

Figures = dict[tuple[str, str, str], float]


# Part one: the table from the maps.


def figures(folder: Path) -> Figures:
    """(metric, method, reference) → value in mm, each formed for each capture and averaged over
    them."""
    protocol = json.loads((folder / "result.json").read_text())["protocol"]["id"]
    if protocol != "paper":
        sys.exit(
            f"{folder}: protocol '{protocol}' masks pixels; this check knows the protocol 'paper'"
        )
    precise = precisions(folder)
    found: Figures = {}
    for reference in REFERENCES:
        captures = sorted(
            p.name.removesuffix(f"__{reference}.npz")
            for p in folder.glob(f"depth/*__{reference}.npz")
        )
        for method in METHODS:
            if captures and (folder / "depth" / f"{captures[0]}__{method}.npz").exists():
                absolute = [
                    np.abs(errors_mm(folder, capture, method, reference)) for capture in captures
                ]
                found["mae_mm", method, reference] = float(np.mean([e.mean() for e in absolute]))
                found["max_mm", method, reference] = float(np.mean([e.max() for e in absolute]))
                if method in precise:
                    found["precision_mm", method, reference] = precise[method]
    return found


def errors_mm(folder: Path, capture: str, method: str, reference: str) -> np.ndarray:
    """z − z_ref [n] where both exist."""
    parts = (
        ("photogrammetry", "truth") if reference == "completed" else (reference,)
    )  # the truth fills holes
    ours, *theirs = (np.load(folder / "depth" / f"{capture}__{of}.npz") for of in (method, *parts))
    if not all(np.array_equal(ours[axis], theirs[0][axis]) for axis in ("x_m", "y_m")):
        sys.exit(f"{capture}, {method}: the reference is kept on another method's grid")
    first, *others = (surface["z_m"] for surface in theirs)
    reference_m = np.where(np.isfinite(first), first, others[0]) if others else first
    difference_mm = 1e3 * (ours["z_m"].astype(np.float64) - reference_m)
    return difference_mm[np.isfinite(difference_mm)]


def repeats(folder: Path) -> list[dict[str, str]]:
    """The lines of scores.csv on the strongest scatterer's depth in each repeat."""
    with (folder / "scores.csv").open() as stream:
        return [line for line in csv.DictReader(stream) if line["metric"] == "strongest_z_m"]


def precisions(folder: Path) -> dict[str, float]:
    """Method → standard deviation (n − 1) over the repeats, averaged over the hands, mm."""
    hands: dict[str, dict[str, list[float]]] = {}
    for line in repeats(folder):
        hands.setdefault(line["method"], {}).setdefault(line["capture"], []).append(
            1e3 * float(line["value"])
        )
    spread = {
        method: [np.std(z_mm, ddof=1) for z_mm in of.values()] for method, of in hands.items()
    }
    return {method: float(np.mean(deviations)) for method, deviations in spread.items()}


def table(folder: Path) -> Figures:
    """The same figures as table.csv has them."""
    with (folder / "table.csv").open() as stream:
        lines = [
            line for line in csv.DictReader(stream) if line["method"] in METHODS and line["value"]
        ]
    wanted = ("mae_mm", "max_mm", "precision_mm")
    return {
        (x["metric"], x["method"], x["reference"]): float(x["value"])
        for x in lines
        if x["metric"] in wanted
    }


# Part two: depths from echoes.


class Echoes:
    """The echoes of a capture: samples [frame, frequency, tx, rx] that are read tone by tone."""

    def __init__(self, path: Path) -> None:
        self.file = h5py.File(path)
        self.frequencies_hz, self.tx_m, self.rx_m = (
            self.file[n][:] for n in ("frequencies_hz", "tx_m", "rx_m")
        )

    def samples(self, frequency_hz: float, frame: int) -> np.ndarray:
        """S [tx, rx] of one tone."""
        place = int(np.abs(self.frequencies_hz - frequency_hz).argmin())
        if abs(self.frequencies_hz[place] - frequency_hz) > 1e3:
            sys.exit(f"{self.file.filename}: has no tone at {frequency_hz} Hz")
        return self.file["samples"][frame, place].astype(np.complex128)

    def images(self, points_m: np.ndarray, tones_hz: np.ndarray, frame: int = 0) -> np.ndarray:
        """Σ_t Σ_r S[t, r] e^{+j2πf(|p−t| + |p−r|)/c} of each tone at points [n, 3]: complex128 [f,
        n]. Every pair of antennas counts; the exponential of a sum is the product of two."""
        images = np.empty((len(tones_hz), len(points_m)), np.complex128)
        samples = [self.samples(f, frame) for f in tones_hz]
        for part in (slice(start, start + 4096) for start in range(0, len(points_m), 4096)):
            p = points_m[part, None, :]
            to_t_m, to_r_m = (
                np.sqrt(((p - of_m) ** 2).sum(axis=-1)) for of_m in (self.tx_m, self.rx_m)
            )
            for image, s, f in zip(images, samples, tones_hz, strict=True):
                k = 2j * np.pi * f / LIGHT_M_S
                image[part] = ((np.exp(k * to_t_m) @ s) * np.exp(k * to_r_m)).sum(axis=1)
        return images


def step_m(image_b: np.ndarray, image_a: np.ndarray, f_b: float, f_a: float) -> np.ndarray:
    """Δz = −cφ/(4πΔf), φ = arg(O_b O_a*), Δf = f_b − f_a."""
    return -LIGHT_M_S * np.angle(image_b * image_a.conj()) / (4 * np.pi * (f_b - f_a))


def points(x_m: np.ndarray, y_m: np.ndarray, z_m: np.ndarray | float) -> np.ndarray:
    """Points [ny, nx, 3] above the pixels."""
    x, y = np.meshgrid(x_m, y_m)
    return np.stack([x, y, np.broadcast_to(z_m, x.shape)], axis=-1)


def two_tone(
    echoes: Echoes, x_m: np.ndarray, y_m: np.ndarray, config: dict, frame: int = 0
) -> list[np.ndarray]:
    """2-FSK with one correction of z_e: depths and amplitudes [ny, nx]."""
    f = np.array(config["tones_hz"][:2])
    z_e = config["first_depth_m"]
    for last in (False, True):
        images = echoes.images(points(x_m, y_m, z_e).reshape(-1, 3), f, frame)
        amplitude, dz_m = np.abs(images).mean(axis=0), step_m(images[0], images[1], f[0], f[1])
        if not last:
            z_e += dz_m[amplitude.argmax()]
    seen = 20 * np.log10(amplitude / amplitude.max()) >= config["threshold_db"]
    return [a.reshape(len(y_m), len(x_m)) for a in (np.where(seen, z_e + dz_m, np.nan), amplitude)]


def average(z_m: np.ndarray, size_px: int) -> np.ndarray:
    """Mean of the depths in the window about each depth; what has none stays without."""
    half, mean_m = size_px // 2, np.full(z_m.shape, np.nan)
    for row, column in np.argwhere(np.isfinite(z_m)):
        window = z_m[max(row - half, 0) : row + half + 1, max(column - half, 0) : column + half + 1]
        mean_m[row, column] = window[np.isfinite(window)].mean()
    return mean_m


def three_tone(
    echoes: Echoes, x_m: np.ndarray, y_m: np.ndarray, config: dict, frame: int = 0
) -> list[np.ndarray]:
    """3-FSK from the smoothed 2-FSK depth, with its last averaging filter: depths and amplitudes
    [ny, nx]."""
    f1, f2, f3 = f = np.array(config["tones_hz"])
    z_m = average(two_tone(echoes, x_m, y_m, config, frame)[0], config["filter_px"])
    seen, amplitude = np.isfinite(z_m), np.zeros(z_m.shape)
    o1, o2, o3 = images = echoes.images(points(x_m, y_m, z_m)[seen], f, frame)
    z_m[seen] += (step_m(o1, o3, f1, f3) + step_m(o2, o3, f2, f3)) / 2
    amplitude[seen] = np.abs(images).mean(axis=0)
    return [average(z_m, config["filter_px"]), amplitude]


def columns(echoes: Echoes, xy_m: np.ndarray, config: dict) -> tuple[np.ndarray, np.ndarray]:
    """Magnitudes [n, nz] of the voxels above pixels [n, 2], all tones summed, and their depths
    [nz]."""
    tones_hz = config["tones_hz"]
    if isinstance(tones_hz, dict):
        tones_hz = np.linspace(tones_hz["start_hz"], tones_hz["stop_hz"], tones_hz["count"])
    axis = config["z"]
    z_m = axis["start_m"] + axis["step_m"] * np.arange(
        1 + round((axis["stop_m"] - axis["start_m"]) / axis["step_m"])
    )
    p = np.concatenate(
        [np.repeat(xy_m, len(z_m), axis=0), np.tile(z_m, len(xy_m))[:, None]], axis=1
    )
    total = np.zeros(len(p), np.complex128)
    for chunk in np.array_split(np.array(tones_hz), max(1, len(tones_hz) // 16)):
        total += echoes.images(p, chunk).sum(axis=0)
    return np.abs(total).reshape(len(xy_m), len(z_m)), z_m


def depths_by_hand(
    folder: Path, capture: str, echo_file: Path, count: int = 200, seed: int = 1
) -> Iterator[dict]:
    """For each method, `count` random pixels that its map observes, imaged anew: the largest
    difference of their depths (of a projection: of those that are no tie, with the number of ties)
    and of amplitudes."""
    echoes = Echoes(echo_file)
    for method in METHODS:
        if not (folder / "depth" / f"{capture}__{method}.npz").exists():
            continue  # another benchmark than the paper's
        with np.load(folder / "depth" / f"{capture}__{method}.npz") as kept:
            x_m, y_m, theirs_m = kept["x_m"], kept["y_m"], kept["z_m"]
            config, db = json.loads(str(kept["config"])), kept["amplitude_db"].astype(np.float64)
        seen = np.flatnonzero(np.isfinite(theirs_m))
        at = np.random.default_rng(seed).choice(seen, min(count, len(seen)), replace=False)
        rows, cols = np.unravel_index(at, theirs_m.shape)
        facts: dict = {
            "method": method,
            "pixels": len(at),
            "ties": 0,
            "flipped": 0,
            "tolerance": config["tolerance"],
        }
        if method in FSK_BOUND_M:
            z_m, amplitude = (two_tone if method == "2fsk" else three_tone)(
                echoes, x_m, y_m, config
            )
            facts["flipped"] = int((np.isfinite(z_m) != np.isfinite(theirs_m)).sum())
            with np.errstate(divide="ignore"):  # of a pixel that is not on our target at all
                ours_m, ours_db = z_m.flat[at], 20 * np.log10(amplitude.flat[at] / amplitude.max())
            differing = np.abs(ours_m - theirs_m.flat[at])
        else:
            strongest = np.unravel_index(db.argmax(), db.shape)
            places = np.append(rows, strongest[0]), np.append(cols, strongest[1])
            magnitude, levels_m = columns(
                echoes, np.stack([x_m[places[1]], y_m[places[0]]], axis=1), config
            )
            ours_m, ordered = levels_m[magnitude.argmax(axis=1)][:-1], np.sort(magnitude, axis=1)
            ours_db = 20 * np.log10(ordered[:-1, -1] / ordered[-1, -1])
            ties = ordered[:-1, -2] > (1 - TIE) * ordered[:-1, -1]
            facts["ties"], differing = int(ties.sum()), np.abs(ours_m - theirs_m.flat[at])[~ties]
        facts["depth_m"] = float(differing.max())
        facts["amplitude_db"] = float(np.abs(ours_db - db.flat[at]).max())
        yield facts


def within(facts: dict) -> bool:
    """True where what `depths_by_hand` yields keeps the bounds."""
    bound_m = FSK_BOUND_M.get(facts["method"], 1e-9)  # a projection's depths are whole voxels
    return (
        facts["depth_m"] <= bound_m
        and facts["amplitude_db"] <= DB_BOUND * facts["tolerance"]
        and not facts["flipped"]
    )


def strongest_by_hand(
    folder: Path, hand: str, capture: str, echo_file: Path
) -> dict[str, tuple[float, float]]:
    """Method → largest difference of the strongest scatterer's depths in the repeats, metres, and
    our precision, mm. Settings are those of the method's map of `capture`."""
    echoes, found = Echoes(echo_file), {}
    for method, image in (("2fsk", two_tone), ("3fsk", three_tone)):
        lines = [x for x in repeats(folder) if (x["method"], x["capture"]) == (method, hand)]
        with np.load(folder / "depth" / f"{capture}__{method}.npz") as kept:
            x_m, y_m, config = kept["x_m"], kept["y_m"], json.loads(str(kept["config"]))
        maps = [image(echoes, x_m, y_m, config, frame) for frame in range(len(lines))]
        z_m, levels = np.array([z for z, _ in maps]), np.array([a / a.max() for _, a in maps])
        always = np.isfinite(z_m).all(axis=0)
        scatterer = np.unravel_index(
            np.where(always, levels.mean(axis=0), -1).argmax(), always.shape
        )
        ours_m = z_m[:, *scatterer]
        differing = np.abs(ours_m - [float(line["value"]) for line in lines]).max()
        found[method] = float(differing), 1e3 * float(np.std(ours_m, ddof=1))
    return found


def main(arguments: list[str] | None = None) -> int:
    """Print what was compared; 1 where a bound is not kept."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("result", type=Path)
    for option, text in (
        ("--capture", "a capture of the accuracy"),
        ("--hand", "a capture of the precision"),
    ):
        parser.add_argument(option, help=text)
    for option, of in (("--echoes", "--capture"), ("--repeats", "--hand")):
        parser.add_argument(option, type=Path, help=f"echoes.h5 of {of}")
    given = parser.parse_args(arguments)
    ours, theirs, kept = figures(given.result), table(given.result), True
    if ours.keys() != theirs.keys():
        print(f"not in both: {sorted(ours.keys() ^ theirs.keys())}")
        kept = False
    for key in sorted(ours.keys() & theirs.keys()):
        off = abs(ours[key] / theirs[key] - 1)
        kept &= off <= TABLE_RTOL
        print(
            f"{' '.join(key):40} by hand {ours[key]:.12g}  table {theirs[key]:.12g}  relative "
            f"{off:.1e}"
        )
    if given.echoes:
        for facts in depths_by_hand(given.result, given.capture, given.echoes):
            kept &= within(facts)
            print(facts)
    if given.repeats:
        for method, (off_m, mm) in strongest_by_hand(
            given.result, given.hand, given.capture, given.repeats
        ).items():
            kept &= off_m <= FSK_BOUND_M[method]
            print(
                f"{given.hand}, {method}: strongest scatterer within {1e6 * off_m:.3g} µm, "
                f"precision {mm:.9g} mm"
            )
    print("every bound is kept" if kept else "a bound is NOT kept")
    return 0 if kept else 1


if __name__ == "__main__":
    sys.exit(main())
