"""Two-bounce echoes against closed forms and image theory, and what must not have any."""

from dataclasses import replace

import numpy as np
import pytest

from handbench.radar.data.arrays import SPEED_OF_LIGHT_M_S, AntennaArray, qar50
from handbench.radar.simulation.causes import Motion
from handbench.radar.simulation.effects import multipath as multipath_effect
from handbench.radar.simulation.effects.motion import moving_samples
from handbench.radar.simulation.effects.multipath import land, multipath
from handbench.radar.simulation.physics.reflection import reflections
from handbench.radar.simulation.scene import Body, EchoScene, Material
from handbench.radar.simulation.scene_echoes import Echoes, bare_echoes
from tests.radar.samples import relative_error
from tests.radar.simulation.effects.plates import cylinder, dihedral, joined, plate, sphere_body
from tests.radar.simulation.effects.small_scenes import shaped

FAR_M = 500.0
METAL = np.ones((1, 2, 1025), complex)  # over that at normal incidence
SKIN = Material(kind="plastic", permittivity=6.4, loss_tangent=1.35)
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
    whole = twice(CORNER, TONES_HZ, array)
    one = twice(CORNER, TONES_HZ[4:5], AntennaArray(array.tx_m, array.rx_m[20:21]))
    assert relative_error(whole[4:5, :, 20:21], one) < 0.08


def field(tx_m, mirror, wall, dipole=(0.0, 1.0, 0.0), fresnel=METAL):
    """Of the tube from a transmitter over a mirror to a wall, both as corners and normals."""
    tx_m, mirror, wall = (np.array(one, float) for one in (tx_m, mirror, wall))
    start_m, normal = mirror[0].mean(axis=0), mirror[1].sum(axis=0)
    ray, normal = (start_m - tx_m) / np.linalg.norm(start_m - tx_m), normal / np.linalg.norm(normal)
    after, flat_m2 = ray - 2 * ray @ normal * normal, np.cross(*np.diff(wall[0], axis=0)) / 2
    zero, made = np.zeros(1, int), np.empty(1, np.complex64)
    rays = tx_m[None], start_m[None], after[None], zero, zero, np.zeros(1)
    surfaces = mirror[None], wall[None], flat_m2[None], np.zeros((2, 1), int), fresnel
    land(*rays, *surfaces, np.array(dipole, float), np.empty((19, 1), np.float32), made)
    return made[0]


def facet(middle_m, normal, size_m=1e-4):
    """Corners and normals of a small flat triangle."""
    normal = np.array(normal, float) / np.linalg.norm(normal)
    u = np.cross(normal, [0.3, 0.9, 0.1])
    edges = np.stack([u, np.cross(normal, u), -u - np.cross(normal, u)])
    return middle_m + size_m * edges, np.tile(normal, (3, 1))


def test_a_tube_that_crosses_a_caustic_is_a_quarter_turn_ahead():
    """A cylinder of the radius R mirrors rays along its axis of symmetry to a line R/2 before it,
    and a sphere to a point: the field gains j behind the one and j² behind the other (Balanis, sec.
    13.2.2)."""
    radius_m = np.array([0.02, np.inf]), np.array([0.02, 0.02])
    for length_m, gained in ((5e-3, (1, 1)), (0.03, (1j, -1))):
        for curved_m, gain in zip(radius_m, gained, strict=True):
            corners_m = 4e-4 * np.array([[0.0, 1, 0], [1, -1, 0], [-1, -1, 0]])
            normals = -np.eye(3)[2] - corners_m / [*curved_m, 1.0]  # hollow, seen from -z
            mirror = corners_m, normals / np.linalg.norm(normals, axis=1, keepdims=True)
            wall_m = np.array([[0, 1.0, -length_m], [-1, -1, -length_m], [1, -1, -length_m]])
            made = field((1.0, 0, -500), mirror, (wall_m, np.tile(np.eye(3)[2], (3, 1))))
            assert made / abs(made) == pytest.approx(gain, abs=1e-2)


def over_two_mirrors(dipole, fresnel=METAL):
    """The field over a right-angled dihedral with its edge along y, met at 45°."""
    mirrors = facet((-0.1, 0, 1.0), (1, 0, -1)), facet((0.1, 0, 1.0), (-1, 0, -1))
    return field((-0.1, 0, 0), *mirrors, dipole, fresnel)


def test_a_metal_dihedral_turns_the_field_across_its_edge():
    """Image theory: two mirrors at a right angle turn space by 180° about the edge: a field along
    it stays, one across it comes back as its opposite, and one at 45° comes back crossed (Ruck et
    al., Radar Cross Section Handbook)."""
    along = over_two_mirrors((0, 1, 0))
    assert over_two_mirrors((1, 0, 0)) == pytest.approx(-along, rel=1e-5)
    assert abs(over_two_mirrors((0.5**0.5, 0.5**0.5, 0))) < 1e-5 * abs(along)


@pytest.mark.parametrize(("dipole", "part"), [((0, 1, 0), 0), ((1, 0, 0), 1)])
def test_skin_reflects_by_fresnels_formulas(dipole, part):
    """At 45°; the formulas as in Born & Wolf, sec. 1.5.2."""
    n, inside = np.sqrt(6.4 * (1 - 1.35j)), np.sqrt(6.4 * (1 - 1.35j) - 0.5)
    s = (0.5**0.5 - inside) / (0.5**0.5 + inside)
    p = (inside - n**2 * 0.5**0.5) / (inside + n**2 * 0.5**0.5)
    fresnel = reflections(SKIN, np.array([80e9]), np.maximum(np.linspace(0, 1, 1025), 1e-6))
    expected = (s, p)[part] ** 2 * over_two_mirrors(dipole)
    assert over_two_mirrors(dipole, fresnel) == pytest.approx(expected, rel=3e-3)


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
    motion, count = Motion(velocity_m_s=0.2), len(TONES_HZ)
    made = state(FINGERS)
    made.scene = replace(made.scene, time_s=np.full(count, 1e-3), motion=motion)
    made.facets = made.facets.where(np.arange(1))  # the bounces alone, but for one facet
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
    monkeypatch.setattr(multipath_effect, "reflections", lambda *_: METAL.repeat(2, axis=0))
    second = np.arange(len(CORNER.faces)) >= len(CORNER.faces) // 2
    body = replace(CORNER, palm=second & two)
    bare = bare_echoes(EchoScene(SPARSE, TONE_HZ, np.zeros(1), body))
    bare.material = Material(kind="skin")
    bare.shape(multipath)
    assert relative_error(bare.bounced, expected * metal) < 1e-6
