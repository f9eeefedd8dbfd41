"""What physics and algebra say of imaging and simulation without any reference: nothing changes
with the frame, the order, the direction or the unit, and sums go through.

Tolerances: exact sums are compared to ROUNDING of the terms' own size, since terms may cancel at
single points: steering is good to 1e-7 rad, and float32 sums of N terms to √N · 6e-8. Two fast
images, each within its tolerance of the truth, are within twice of it of each other; where both
come from the same plan, one linear map, ROUNDING holds.
"""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.stats import ortho_group

from handbench.radar.data.arrays import AntennaArray, PlanarScan, qar50
from handbench.radar.data.capture import RadarCapture
from handbench.radar.data.grid import VoxelGrid
from handbench.radar.imaging.api import image_points, project_volume
from handbench.radar.imaging.plan import fresh_plans
from handbench.radar.simulation.forward import Scatterers, simulate
from tests.radar.exact import tone_images
from tests.radar.samples import noise, relative_error
from tests.strategies import examples

pytestmark = pytest.mark.usefixtures("planned")

ROUNDING = 1e-6
seeds = st.integers(0, 2**31)
tolerances = st.sampled_from([None, 1e-2, 1e-4])
few = examples(3)


class Scene:
    """A random array, points before it, tones, samples and facets."""

    def __init__(self, seed: int, points: int = 60) -> None:
        generator = self.generator = np.random.default_rng(seed)
        antennas = generator.uniform(-0.07, 0.07, (17, 3))
        self.array = AntennaArray(antennas[:9], antennas[9:])
        self.points_m = generator.uniform([-0.05, -0.05, 0.2], [0.05, 0.05, 0.3], (points, 3))
        self.tones_hz = generator.uniform(70e9, 85e9, 6)
        self.samples = noise((6, 9, 8), seed)
        normal = generator.normal([0, 0, -1], 0.3, (points, 3))
        self.normal = normal / np.linalg.norm(normal, axis=1)[:, None]
        self.facets = Scatterers(self.points_m, generator.uniform(0.5, 1, points), self.normal)

    def image(self, tolerance: float | None, **changes) -> np.ndarray:
        """The image, with samples, tones_hz, array or points_m changed."""
        given_ = {
            name: getattr(self, name) for name in ("samples", "tones_hz", "array", "points_m")
        } | changes
        return image_points(*given_.values(), tolerance)

    def assert_equal(
        self, found: np.ndarray, expected: np.ndarray, tolerance: float | None
    ) -> None:
        """Of two images: to twice the tolerance, of the size that noise gives them, or to the
        rounding of all terms."""
        size = np.linalg.norm(self.samples) * np.sqrt(found.size)
        assert np.linalg.norm(found - expected) < (2 * tolerance if tolerance else ROUNDING) * size


def assert_equal_echoes(found: np.ndarray, expected: np.ndarray, tolerance: float | None) -> None:
    """Of two simulations; the rounding is that of 60 terms in float32."""
    assert relative_error(found, expected) < (2 * tolerance if tolerance else ROUNDING)


@examples(6)
@given(seeds, tolerances, st.sampled_from([0.0, 1.0, 1e3]), st.floats(0.05, 50.0), st.booleans())
def test_scene_and_array_may_move_turn_grow_and_change_their_order_together(
    seed, tolerance, offset_m, scale, swapped
):
    """Turns are mirrored, too; wavelengths grow with lengths; transmitters and receivers change
    places where swapped. Both legs fade as 1/R, and facets grow as the square. The offset itself
    rounds paths to 2⁻⁵³ · 1e3 m: 4e-10 rad."""
    scene = Scene(seed)
    turn = ortho_group.rvs(3, random_state=seed)
    shift_m = scene.generator.uniform(-offset_m, offset_m, 3)
    order = f, t, r = tuple(scene.generator.permutation(n) for n in (6, 9, 8))
    p = scene.generator.permutation(60)
    ways = (0, 2, 1) if swapped else (0, 1, 2)

    def elsewhere(places_m: np.ndarray) -> np.ndarray:
        return scale * (places_m @ turn.T + shift_m)

    def changed(samples: np.ndarray) -> np.ndarray:
        return samples[np.ix_(*order)].transpose(ways).copy()

    ends = [elsewhere(scene.array.tx_m)[t], elsewhere(scene.array.rx_m)[r]]
    there = {
        "samples": changed(scene.samples),
        "tones_hz": scene.tones_hz[f] / scale,
        "array": AntennaArray(*(ends[::-1] if swapped else ends)),
        "points_m": elsewhere(scene.points_m)[p],
    }
    scene.assert_equal(scene.image(tolerance, **there), scene.image(tolerance)[p], tolerance)
    facets = replace(
        scene.facets,
        position_m=elsewhere(scene.points_m),
        normal=scene.normal @ turn.T,
        weight=scale**2 * scene.facets.weight,
    )
    found = simulate(facets.where(p), there["tones_hz"], there["array"], tolerance=tolerance)
    here = simulate(scene.facets, scene.tones_hz, scene.array, tolerance=tolerance)
    assert_equal_echoes(found, changed(here), tolerance)
    scan = {"samples": noise((6, 9), seed), "array": PlanarScan(scene.array.tx_m)}
    moved = there | {
        "samples": scan["samples"][np.ix_(f, t)],
        "array": PlanarScan(elsewhere(scene.array.tx_m)[t]),
    }
    scene.assert_equal(
        scene.image(tolerance, **moved), scene.image(tolerance, **scan)[p], tolerance
    )


@few
@given(seeds, tolerances, st.complex_numbers(max_magnitude=3), st.complex_numbers(max_magnitude=3))
def test_imaging_is_linear_at_any_tolerance(seed, tolerance, a, b):
    # One plan is one linear map: however coarse, sums go through it to single precision.
    scene = Scene(seed)
    other = noise(scene.samples.shape, seed + 1)
    mixed = scene.image(tolerance, samples=(a * scene.samples + b * other).astype(np.complex64))
    expected = a * scene.image(tolerance) + b * scene.image(tolerance, samples=other)
    scene.assert_equal(mixed / 6, expected / 6, None)


@few
@given(seeds, tolerances, st.booleans())
def test_imaging_is_the_adjoint_of_simulation_for_any_geometry(seed, tolerance, apart):
    """⟨echoes(w), S⟩ = ⟨w, image(S)⟩, with the tones apart tone for tone."""
    scene = Scene(seed)
    weights = scene.generator.standard_normal(60)
    tones = [np.s_[i : i + 1] for i in range(6)] if apart else [np.s_[:]]
    images = image_points(
        scene.samples, scene.tones_hz, scene.array, scene.points_m, tolerance, apart
    ).reshape(-1, 60)
    for image, chosen in zip(images, tones, strict=True):
        part = Scatterers(scene.points_m, weights)
        echoes = simulate(
            part, scene.tones_hz[chosen], scene.array, spreading=False, tolerance=tolerance
        )
        difference = np.vdot(echoes.astype(complex), scene.samples[chosen]) - np.vdot(
            weights, image
        )
        size = np.linalg.norm(weights) * np.sqrt(60) * np.linalg.norm(scene.samples[chosen])
        assert (
            abs(difference) < (2 * tolerance if apart and tolerance else ROUNDING) * size
        )  # apart: other plans


@few
@given(seeds, tolerances)
def test_captures_and_frames_know_nothing_of_each_other(seed, tolerance):
    """To the last bit: whatever was imaged before, and wherever in its file a frame lies."""
    scene = Scene(seed)
    frames = noise((3, *scene.samples.shape), seed)
    order = scene.generator.permutation(3)
    captures = [
        RadarCapture(samples, scene.tones_hz, scene.array) for samples in (frames, frames[order])
    ]
    with fresh_plans():
        first = [
            scene.image(tolerance, samples=captures[0].tones(scene.tones_hz, i)[0])
            for i in range(3)
        ]
    with fresh_plans():
        scene.image(tolerance, points_m=scene.points_m + 0.5)
        again = [
            scene.image(tolerance, samples=captures[1].tones(scene.tones_hz, i)[0])
            for i in range(3)
        ]
    assert np.array_equal(np.array(first)[order], again)


@pytest.mark.parametrize("tolerance", [None, 1e-3])
def test_threads_change_no_bit_of_echoes_tones_and_projections(tolerance, monkeypatch):
    scene, grid = (
        Scene(1, 3000),
        VoxelGrid(1e-3 * np.arange(40), 1e-3 * np.arange(40), 0.25 + 1e-3 * np.arange(20)),
    )
    found = []
    for workers in ("1", "2", "5"):
        monkeypatch.setenv("HANDBENCH_WORKERS", workers)
        with fresh_plans():
            echoes = simulate(scene.facets, scene.tones_hz, qar50(), tolerance=tolerance)
            tones = tone_images(echoes, scene.tones_hz, qar50(), scene.points_m)
            peaks = project_volume(echoes, scene.tones_hz, qar50(), grid, tolerance)
            found.append(
                (
                    echoes,
                    tones,
                    peaks.index,
                    peaks.magnitude,
                    peaks.rival,
                    peaks.second,
                    peaks.error,
                )
            )
    for others in found[1:]:
        assert all(
            np.array_equal(a, b, equal_nan=True) for a, b in zip(found[0], others, strict=True)
        )
