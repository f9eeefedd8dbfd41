"""Exported echoes through the arithmetic of MAROON's public code, written out here in numpy.

The reference is theirs: single precision as on the device, sums that start at 1e-3 (1 + j) in each
of 32 threads (`cuda/holo_reco_sfcw_optimized.cu`, holo_reco_sfcw_time_domain), antennas with x
negated and the image turned by rot90 (`sensors/radar_control.py`, initialize_reconstruction and
holo_reconstruction_sfcw_cuda_fast), depth by a parabola through decibels
(extract_depth_parabola_fit). 2-FSK is the paper's formula on these images, whose class is in no
version that could be read.
"""

import numpy as np
import pytest

from handbench.bench.run.reconstruct_stage import Imager
from handbench.radar.data.arrays import qar50
from tests.bench.datasets.foreign_captures import AXES, PIXELS, PLACE_M, echoes
from tests.bench.datasets.maroon_writer import write_radar

C = 299792458.0
BROADBAND = {"start_hz": 72e9, "stop_hz": 82e9, "count": 5, "threshold_db": -14.0, "subvoxel": True}


@pytest.fixture(scope="module")
def maroon(tmp_path_factory):
    """The radar's part of a capture in their layout."""
    return write_radar(tmp_path_factory.mktemp("maroon") / "patch" / "30", echoes())


def frame(folder):
    """Echoes [rx, tx, f] of the antennas that their loader keeps, and frequencies."""
    content = np.load(
        next(folder.glob("radar_*/calibrated_data/000000.npy")), allow_pickle=True
    ).item()
    return content.get("xr")[1:95, 1:95, :], content.get("fvec")


def their_axes():
    """Pixels and voxels of the test's box in their frame, x to the right, single precision."""
    values = [np.linspace(m - 0.01, m + 0.01, 11) for m in PLACE_M * [-1, 1, 1]]
    return [axis.astype(np.float32) for axis in values]


def their_image(xr, f_hz, axes):
    """[rows from the top, columns, z] of their kernel over x, y, z [nx], [ny], [nz]."""
    array = qar50()
    c, two_pi = np.float32(C), np.float32(2 * np.pi)
    tx_s, rx_s = ((a * [-1, 1, 1]).astype(np.float32) / c for a in (array.tx_m, array.rx_m))
    x, y, z = (axis / c for axis in axes)
    points = np.stack(np.meshgrid(x, y, z, indexing="ij"), axis=-1).reshape(-1, 1, 3)
    to_rx, to_tx = (
        np.sqrt(((points - antennas) ** 2).sum(axis=-1)) for antennas in (rx_s, tx_s)
    )  # float32 seconds
    image = np.empty(len(points), np.complex64)
    threads = np.arange(94 * 94) % 32
    order = np.argsort(threads, kind="stable")
    starts = np.searchsorted(threads[order], np.arange(32))
    for n, (rx, tx) in enumerate(zip(to_rx, to_tx, strict=True)):
        delay = (rx[:, None] + tx[None, :]).ravel()[order]
        sums = np.full(32, np.complex64(1e-3 + 1e-3j))
        for k, frequency in enumerate(np.float32(f_hz) * two_pi):
            phase = frequency * delay
            terms = xr[:, :, k].ravel()[order] * (np.cos(phase) + 1j * np.sin(phase)).astype(
                np.complex64
            )
            sums = sums + np.add.reduceat(terms, starts)
        image[n] = sums.sum()
    image = image.reshape([len(axis) for axis in axes]) / np.float32(94 * 94)
    return np.rot90(image, k=1, axes=(0, 1))


def ours_of(their_map):
    """Their map, rows from the top and x to the right, as [y, x] of ours."""
    return their_map[::-1, ::-1]


def their_two_tones(folder):
    """2-FSK: from z_e = 0.45 m once by the strongest pixel, then every pixel; metres, rows from the
    top."""
    xr, f_hz = frame(folder)
    chosen = [int(np.flatnonzero(f_hz == tone)[0]) for tone in (81.8e9, 82e9)]
    x, y, _ = their_axes()
    z_e = 0.45
    for last in (False, True):
        images = [
            their_image(xr[:, :, [k]], f_hz[[k]], (x, y, np.float32([z_e])))[:, :, 0]
            for k in chosen
        ]
        phase = np.angle(images[1] * np.conj(images[0]))
        step_m = -C * phase / (4 * np.pi * (f_hz[chosen[1]] - f_hz[chosen[0]]))
        if last:
            return z_e + step_m
        amplitude = np.abs(images[0]) + np.abs(images[1])
        z_e += step_m.ravel()[amplitude.argmax()]


def their_projection(folder):
    """Depth by the parabola, NaN below −14 dB; rows from the top."""
    axes = their_axes()
    volume = np.abs(their_image(*tones_of(folder), axes))
    db = 20 * np.log10(volume / volume.max())
    best, step = db.argmax(axis=2), axes[2][1] - axes[2][0]
    places = np.clip(best[..., None] + [-1, 0, 1], 0, db.shape[2] - 1)
    at = np.take_along_axis(db, places, axis=2)
    a, b, _ = np.polyfit(np.arange(-1, 2) * step, at.reshape(-1, 3).T, 2)
    depth_m = axes[2][best] + np.reshape(-b / (2 * a), best.shape)
    return np.where(at[..., 1] >= -14, depth_m, np.nan)


def tones_of(folder):
    """The five even tones of the test's broadband method."""
    xr, f_hz = frame(folder)
    chosen = [int(np.abs(f_hz - tone).argmin()) for tone in np.linspace(72e9, 82e9, 5)]
    return xr[:, :, chosen], f_hz[chosen]


def rounding_m(z_m):
    """What single precision of 2πf, 3e4 rad/s, makes of a two-tone depth: the same phase error on
    all paths."""
    array, f_hz = qar50(), np.array([81.8e9, 82e9])
    rounded = (np.float32(f_hz) * np.float32(2 * np.pi)).astype(np.float64) - 2 * np.pi * f_hz
    place_m = np.array([*PLACE_M[:2], z_m])
    path_m = sum(np.linalg.norm(place_m - legs, axis=1).mean() for legs in (array.tx_m, array.rx_m))
    return -C * (rounded[1] - rounded[0]) * path_m / C / (4 * np.pi * 0.2e9)


def ours(folder, method_id, config):
    [found] = Imager(folder, method_id, config | {"tolerance": None}).images().results
    return found.depth


def off_um(theirs_m, depth):
    """Median distance of the depths that both have, µm."""
    both = np.isfinite(ours_of(theirs_m)) & np.isfinite(depth.z_m)
    assert both.sum() > 20
    return 1e6 * np.median(np.abs(ours_of(theirs_m) - depth.z_m)[both])


def test_two_tones_agree_with_theirs(maroon):
    """A micrometre: single precision leaves 6e-5 rad of a path's phase, and c/(4π · 200 MHz) is
    0.12 m a radian, over the root of 8836 paths; what their rounded 2πf makes of each path, 4 µm
    here, is known and taken off."""
    depth, theirs_m = ours(maroon, "2fsk", PIXELS), their_two_tones(maroon)
    assert off_um(theirs_m, depth) <= 5
    assert off_um(theirs_m - rounding_m(np.nanmedian(depth.z_m)), depth) <= 1


def test_projections_agree_with_theirs(maroon):
    """The parabola amplifies rounding where three decibels are nearly equal, hence a micrometre in
    the median too. At the ends they go on, we stop."""
    depth, theirs_m = ours(maroon, "broadband", AXES | BROADBAND), their_projection(maroon)
    inside = np.where(np.abs(theirs_m - PLACE_M[2]) < 0.0085, theirs_m, np.nan)
    assert off_um(inside, depth) <= 1
    assert (np.isfinite(ours_of(theirs_m)) == np.isfinite(depth.z_m)).all()
