"""Two-bounce echoes against closed forms and image theory, and what must not have any."""

from dataclasses import replace

import numpy as np
import pytest

from handbench.radar.data.arrays import SPEED_OF_LIGHT_M_S, AntennaArray, qar50
from handbench.radar.simulation.causes import Causes
from handbench.radar.simulation.effects import multipath as multipath_effect
from handbench.radar.simulation.effects.motion import moving_samples
from handbench.radar.simulation.effects.multipath import multipath
from handbench.radar.simulation.physics.bundles import traced_nodes
from handbench.radar.simulation.physics.ray_tubes import Hits, patches_of, tubes_around
from handbench.radar.simulation.scene import Body, EchoScene
from handbench.radar.simulation.scene_echoes import Echoes, bare_echoes
from tests.radar.samples import relative_error
from tests.radar.simulation.effects.plates import cylinder, dihedral, joined, plate, sphere_body
from tests.radar.simulation.effects.small_scenes import shaped

FAR_M = 500.0
TONE_HZ = np.array([77e9])
WAVELENGTH_M = SPEED_OF_LIGHT_M_S / TONE_HZ[0]
TONES_HZ = np.linspace(72e9, 82e9, 11)
SPARSE = AntennaArray(qar50().tx_m[::6], qar50().rx_m[::6])
CORNER = dihedral(0.02, 0.03, (0.01, 0.005, 0.33))
FINGERS = joined(
    cylinder((-0.011, 0.0, 0.31), 8e-3, 0.04), cylinder((0.011, 0.0, 0.32), 8e-3, 0.04)
)


def state(body: Body, frequencies_hz=TONES_HZ, array: AntennaArray = SPARSE) -> Echoes:
    return shaped(EchoScene(array, frequencies_hz, np.zeros(len(frequencies_hz)), body), multipath)


def twice(body: Body, frequencies_hz=TONES_HZ, array: AntennaArray = SPARSE) -> np.ndarray:
    """The two-bounce echoes alone."""
    bounced = state(body, frequencies_hz, array).bounced
    none = np.zeros((len(frequencies_hz), *array.channels))
    return none if bounced is None else bounced


def cross_section_m2(body: Body, elevation_rad: float = 0.0) -> float:
    """Monostatic, from afar."""
    antenna_m = FAR_M * np.array([[0.0, np.sin(elevation_rad), -np.cos(elevation_rad)]])
    sample = twice(body, TONE_HZ, AntennaArray(antenna_m, antenna_m))[0, 0, 0]
    return 4 * np.pi / WAVELENGTH_M**2 * abs(sample * FAR_M**2) ** 2


@pytest.mark.parametrize(
    ("turn_deg", "within"),
    [
        # Depth of field and the 0.2 mm next to the edge where rays do not leave their own surface:
        # below 0.5 %.
        pytest.param(0, 5e-3, marks=pytest.mark.slow),
        (5, 0.02),
        (20, 0.02),
    ],
)
def test_a_turned_dihedral_echoes_like_the_plate_that_it_lights_twice(turn_deg, within):
    width_m = 2 * 0.06 * np.sin(np.pi / 4 - np.radians(turn_deg))
    expected = 4 * np.pi * (width_m * 0.05) ** 2 / WAVELENGTH_M**2
    assert cross_section_m2(dihedral(0.06, 0.05, turn_rad=np.radians(turn_deg))) == pytest.approx(
        expected, rel=within
    )


def test_tones_and_antennas_between_the_nodes_are_interpolated():
    """Each antenna has tubes of its own, whose borders jump by a patch from one to the next."""
    array = AntennaArray(qar50().tx_m[:47:2], qar50().rx_m[:47])
    assert len(traced_nodes(array)[1]) < 15
    whole = twice(CORNER, TONES_HZ, array)
    one = twice(CORNER, TONES_HZ[4:5], AntennaArray(array.tx_m, array.rx_m[20:21]))
    assert relative_error(whole[4:5, :, 20:21], one) < 0.08


def test_a_tube_that_crosses_a_caustic_is_a_quarter_turn_ahead():
    """A cylinder of the radius R mirrors rays along its axis of symmetry to a line R/2 before it,
    and a sphere to a point: the field gains j behind the one and j² behind the other (Balanis, sec.
    13.2.2)."""
    radius_m = np.array([0.02, np.inf]), np.array([0.02, 0.02])
    for length_m, crossed in ((5e-3, (0, 0)), (0.03, (1, 2))):
        for curved_m, count in zip(radius_m, crossed, strict=True):
            corners_m = 4e-4 * np.array([[[0.0, 1, 0], [1, -1, 0], [-1, -1, 0]]])
            normals = -np.eye(3)[2] - corners_m / [*curved_m, 1.0]  # hollow, seen from -z
            mirror = patches_of(corners_m, normals / np.linalg.norm(normals, axis=2, keepdims=True))
            wall = patches_of(
                np.array([[[0, 1.0, -length_m], [-1, -1, -length_m], [1, -1, -length_m]]]),
                np.tile(np.eye(3)[2], (1, 3, 1)),
            )
            zero = np.zeros(1, int)
            face = np.zeros((1, 1), np.int32)  # of the type for which the kernel is compiled
            hits = Hits(zero, zero, face, np.zeros((1, 3)), np.zeros(1))
            tubes = tubes_around(hits, mirror, wall, np.array([[0.0, 0, -500]]))
            assert tubes.caustics[0] == count


def test_flat_and_convex_bodies_have_no_second_bounce():
    for body in (
        plate((-0.03, -0.03, 0.3), (0, 0.06, 0), (0.06, 0, 0), 20),
        sphere_body(0.01, (0, 0, 0.3)),
    ):
        assert not twice(body).any()


def test_transmitters_and_receivers_can_be_swapped():
    there, back = twice(FINGERS), twice(FINGERS, TONES_HZ, AntennaArray(SPARSE.rx_m, SPARSE.tx_m))
    assert relative_error(back.transpose(0, 2, 1), there) < 1e-5


def test_motion_turns_the_bounces_with_the_target():
    # of 0.2 mm until the first tone is measured
    causes, count = Causes.model_validate({"motion": {"velocity_m_s": 0.2}}), len(TONES_HZ)
    made = state(FINGERS)
    made.scene = replace(made.scene, time_s=np.full(count, 1e-3), causes=causes)
    made.surface = made.surface.where(np.arange(1))  # the bounces alone, but for one facet
    turned = moving_samples(made)[0]
    moved = twice(Body(FINGERS.vertices_m + [0, 0, 2e-4], FINGERS.faces))
    # 0.2 mm turn the echoes by 0.6 rad; what is left over is the tubes' borders.
    assert relative_error(turned, moved) < 0.03
    assert relative_error(made.bounced, moved) > 0.3


def test_the_pattern_acts_on_both_legs():
    made = bare_echoes(EchoScene(SPARSE, TONE_HZ, np.zeros(1), CORNER))
    made.pattern = 2.0
    made.shape(multipath)
    towards = [np.array([0.01, 0.005, 0.32]) - leg.position_m for leg in SPARSE.legs]
    squared = [(way[:, 2] / np.linalg.norm(way, axis=1)) ** 2 for way in towards]
    assert (
        relative_error(made.bounced, twice(CORNER, TONE_HZ) * np.outer(*squared)) < 0.03
    )  # the corner is 20 mm wide


@pytest.mark.parametrize(
    ("reflection", "two", "expected"),
    [([1.0, 0.5j], True, 0.5j), ([0.5j, 0.1], False, -0.25)],  # of one; of none
)
def test_layers_reflect_each_in_its_way(reflection, two, expected, monkeypatch):
    """Each tube meets both plates once."""
    metal, layers = twice(CORNER, TONE_HZ), np.array(reflection)[:, None]
    monkeypatch.setattr(multipath_effect, "echo_reflections", lambda *_: layers)
    bare = bare_echoes(EchoScene(SPARSE, TONE_HZ, np.zeros(1), CORNER))
    second = bare.surface.facets.face >= len(CORNER.faces) // 2
    bare.surface = replace(bare.surface, layer=(second & two).astype(int))
    bare.shape(multipath)
    assert relative_error(bare.bounced, expected * metal) < 1e-6


def test_the_peak_of_a_trihedral_is_its_third_bounce(monkeypatch):
    # Closed form: 12πa⁴/λ² of three squares of side a, of geometrical and of physical
    # optics.
    turn = 0.3 + 2 * np.pi / 3 * np.arange(3)
    edges = np.stack([np.cos(turn), -np.sin(turn), -np.full(3, np.sqrt(0.5))], axis=1) * np.sqrt(
        2 / 3
    )
    body = joined(
        *(plate(np.zeros(3), 0.03 * edges[i], 0.03 * edges[(i + 1) % 3], 16) for i in range(3))
    )
    expected = 12 * np.pi * 0.03**4 / WAVELENGTH_M**2
    assert cross_section_m2(body) == pytest.approx(expected, rel=5e-3)
    monkeypatch.setattr(multipath_effect, "BOUNCES", 2)
    assert cross_section_m2(body) < 1e-3 * expected
