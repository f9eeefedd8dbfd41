"""Small slips that no other test would notice: each test pins one formula, boundary or path by what
it means."""

import sys
from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import brentq

from handbench.radar.data.arrays import AntennaArray, PlanarScan, qar50
from handbench.radar.data.grid import VoxelGrid
from handbench.radar.imaging.api import GridImager, image_points
from handbench.radar.imaging.plan import GridPlan
from handbench.radar.imaging.tree import DIRECT, Family
from handbench.radar.methods.depth_uncertainty import UNRELATED_RAD, incoherent
from handbench.radar.methods.fsk_config import ThreeToneConfig
from handbench.radar.simulation.causes import Converter
from handbench.radar.simulation.effects.multipath import multipath
from handbench.radar.simulation.effects.quick_estimate import CENTRE_M, count_mirroring
from handbench.radar.simulation.effects.sensor import full_scale
from handbench.radar.simulation.forward import Scatterers, simulate
from handbench.radar.simulation.physics import facets
from handbench.radar.simulation.physics.reflection import skin_permittivity
from handbench.radar.simulation.scene import Body, EchoScene, Material
from handbench.radar.simulation.scene_echoes import bare_echoes, front_facets
from handbench.support.errors import HandbenchError
from handbench.support.progress import track
from tests.radar.direct_sums import direct_sum
from tests.radar.exact import tone_images
from tests.radar.samples import noise, relative_error
from tests.radar.simulation.effects.closed_forms import sphere_body
from tests.radar.simulation.effects.plates import dihedral, plate
from tests.radar.simulation.effects.small_scenes import (
    TONES_HZ,
    bead_scene,
    estimated,
    simulated_change,
)

pytestmark = pytest.mark.usefixtures("planned")

SPARSE = AntennaArray(qar50().tx_m[::12], qar50().rx_m[::12])


def test_a_bar_on_a_terminal_leaves_stdout_to_results(capsys, monkeypatch):
    monkeypatch.setattr(sys.stderr, "isatty", lambda: True)
    monkeypatch.setenv("TERM", "xterm")  # a dumb terminal has no bar
    assert list(track(range(3), "exact volume")) == [0, 1, 2]
    shown = capsys.readouterr()
    assert shown.out == "" and "exact volume" in shown.err


# --- imaging
# --------------------------------------------------------------------------------------------------------


def test_a_phase_is_noise_where_three_deviations_fill_its_circle():
    undone = lambda phase_rad: phase_rad / np.sqrt(1 - (phase_rad / UNRELATED_RAD) ** 2)  # noqa: E731
    limit_rad = brentq(lambda phase_rad: 3 * undone(phase_rad) - np.pi, 0.1, 0.99 * UNRELATED_RAD)
    sigma_m = 0.03 / np.pi * limit_rad * np.array([1 - 1e-9, 1 + 1e-9])
    assert incoherent(sigma_m, 0.03).tolist() == [False, True]


@pytest.mark.parametrize("probability", [0.0, 1.0])
def test_a_flag_needs_a_probability_between_never_and_always(probability):
    axis = {"start_m": 0.0, "stop_m": 0.01, "step_m": 0.001}
    with pytest.raises(ValueError, match="wrap_probability"):
        ThreeToneConfig(x=axis, y=axis, first_depth_m=0.3, wrap_probability=probability)


def test_a_plane_of_a_deep_plan_is_sorted_anew_at_every_depth():
    """0.2 m are several leaves deep, so that each depth lies in other ones."""
    tones_hz = np.array([82e9, 81.8e9])
    grid = VoxelGrid(4e-3 * np.arange(-8, 9), 4e-3 * np.arange(-5, 6), np.array([0.25, 0.45]))
    plan = GridPlan(tones_hz, SPARSE, grid, Family(1e-4, True), planes=True)
    imager = GridImager(plan, tones_hz, SPARSE, apart=True)
    samples = noise((2, *SPARSE.channels))
    for z_m in (0.25, 0.31, 0.449):
        points_m = VoxelGrid(grid.x_m, grid.y_m, np.array([z_m])).points_m().reshape(-1, 3)
        exact = tone_images(samples, tones_hz, SPARSE, points_m)
        images = imager.upsampler.volume(*imager.nodes(samples, np.array([z_m])), carrier=True)
        assert relative_error(images.reshape(2, -1), exact) < 1e-4


def test_an_echo_on_an_antenna_is_refused_where_it_would_be_infinite():
    there = Scatterers(SPARSE.rx_m[[0, 3]] + [[0, 0, 0.3], [0, 0, 0]], np.ones(2))
    with pytest.raises(HandbenchError, match=r"point 1 at .* lies on an antenna"):
        simulate(there, TONES_HZ, SPARSE, tolerance=None)
    assert np.isfinite(simulate(there, TONES_HZ, SPARSE, tolerance=None, spreading=False)).all()


def test_a_scan_of_more_positions_than_are_decomposed_at_once_meets_the_tolerance():
    random = np.random.default_rng(4)
    scan = PlanarScan(np.c_[random.uniform(-0.05, 0.05, (DIRECT + 40, 2)), np.zeros(DIRECT + 40)])
    tones_hz, points_m = np.array([24e9, 26e9]), random.uniform(-0.01, 0.01, (50, 3)) + [0, 0, 0.2]
    samples = noise((2, DIRECT + 40))
    images = image_points(samples, tones_hz, scan, points_m, 1e-3)
    assert relative_error(images, direct_sum(samples, tones_hz, scan, points_m)) < 1e-3


# --- what bodies are made of
# ----------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("wet", "permittivity"), [(False, [1133.6, 1119.2, 990.76]), (True, [29010.0, 15357.0, 1832.8])]
)
def test_every_dispersion_of_skin_is_the_tabulated_one(wet, permittivity):
    """Gabriel's models at 10 kHz, 100 kHz and 1 MHz as table 3 of doi 10.1186/s12938-018-0473-9 has
    them (five digits): there the slow dispersions count, which millimetre waves hardly feel."""
    assert skin_permittivity(np.array([1e4, 1e5, 1e6]), wet).real == pytest.approx(
        permittivity, rel=1e-4
    )


def test_the_estimate_meets_what_happens_to_a_target_of_foam():
    body = replace(
        sphere_body(0.015, 5, (0.01, -0.005, 0.3)),
        material=Material(kind="foam", permittivity=1.03),
    )
    scene = EchoScene(SPARSE, TONES_HZ, np.zeros(3), target=body)
    changes, level_db = estimated(scene, "obliquity", "dielectric", without="dielectric")
    change, expected_db = simulated_change(scene, "obliquity", "dielectric", without="dielectric")
    assert changes["3fsk"].depth_mm == pytest.approx(change.depth_mm, rel=0.2)
    assert level_db == pytest.approx(expected_db, abs=0.1)


# --- what the scene does
# --------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("effect", "causes"),
    [
        ("noise", {"noise": {"phase_noise_rad": 0.02}}),
        ("oscillator", {"oscillator": {"level_dbc_hz": -70.0}}),
    ],
    ids=["noise", "oscillator"],
)
def test_what_every_frame_draws_anew_is_estimated_as_it_will_be_simulated(effect, causes):
    """With the very numbers of the simulation's first frame: a closed form knows their spread
    alone."""
    scene, names = bead_scene(causes), ("obliquity", "shadow_centre", effect)
    changes, level_db = estimated(scene, *names, without=effect)
    change, expected_db = simulated_change(scene, *names, without=effect)
    assert changes["3fsk"].depth_mm == pytest.approx(change.depth_mm, rel=0.4)
    assert level_db == pytest.approx(expected_db, abs=0.5)


def test_headroom_is_told_in_decibels_of_amplitude():
    samples = np.array([1 - 3j, 2 + 2j])
    assert full_scale(samples, Converter(bits=8, headroom_db=20.0)) == pytest.approx(30)


@pytest.mark.parametrize("away", [(1, 0), (-1, 0), (0, 1), (0, -1)])
def test_a_facet_counts_when_only_one_side_of_the_aperture_sees_it(away):
    """A facet whose plane meets the aperture 0.05 m off its centre: antennas on either side see one
    of its faces."""
    place_m, towards = np.array([0.0, 0.0, 0.3]), np.array([*away, 0.0])
    along = place_m - 0.05 * towards  # away from where the plane meets the aperture
    across = np.cross(along, towards)
    for side in (1, -1):
        body = plate(place_m, 1e-3 * side * across, 1e-3 * along, 1)
        assert len(front_facets(EchoScene(qar50(), TONES_HZ, np.zeros(3), target=body), body)) > 0


def test_a_mesh_that_would_become_too_many_facets_is_refused(monkeypatch):
    """Edges of 42 mm split to 1.4 mm make 4⁵ facets of each of the two triangles."""
    made = plate((0.0, 0.0, 0.3), (0.03, 0, 0), (0, 0.03, 0), 1)
    monkeypatch.setattr(facets, "MOST_FACETS", 2 * 4**5)
    assert len(facets.facets_of(made, 1.4e-3)) == 2 * 4**5
    monkeypatch.setattr(facets, "MOST_FACETS", 2 * 4**5 - 1)
    with pytest.raises(HandbenchError, match="more than 2047 facets; remesh"):
        facets.facets_of(made, 1.4e-3)


TURN = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])  # a quarter about z
TURNED = AntennaArray(SPARSE.tx_m @ TURN.T, SPARSE.rx_m @ TURN.T)


def test_two_bounces_echo_the_same_whichever_way_the_scene_is_turned():
    """No axis is special to a tube's footprint; rays are cast in single precision."""
    corner = dihedral(0.03, 0.04, (0.02, 0.01, 0.3), 4, turn_rad=0.1)
    echoes = []
    whole = (
        (SPARSE, corner.vertices_m, np.eye(3)[1]),
        (TURNED, corner.vertices_m @ TURN.T, TURN[:, 1]),
    )
    for array, vertices_m, dipole in whole:
        angle_deg = float(np.degrees(np.arctan2(dipole[1], dipole[0])))
        body = Body(vertices_m, corner.faces)
        scene = EchoScene(array, TONES_HZ, np.zeros(3), body, polarisation_deg=angle_deg)
        echoes.append(multipath(bare_echoes(scene)).extra_echoes())
    assert relative_error(echoes[1], echoes[0]) < 1e-5


def test_mirrors_catch_the_same_whichever_way_the_scene_is_turned():
    """A quarter turn about z changes nothing but on which side of a cell rays at its edge count (1
    of 4945)."""
    plates = facets.facets_of(dihedral(0.03, 0.04, (0.0, 0.0, 0.3), 40))
    turned = facets.Facets(
        plates.position_m @ TURN.T, plates.area_m2, plates.normal @ TURN.T, plates.face
    )
    count = count_mirroring(plates, CENTRE_M)
    assert count > 0
    assert count_mirroring(turned, CENTRE_M) == pytest.approx(count, rel=2e-3)
