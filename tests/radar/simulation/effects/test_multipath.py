"""Two-bounce echoes against closed forms and image theory, and what must not have any."""

from dataclasses import replace

import numpy as np
import pytest

from handbench.radar.data.arrays import SPEED_OF_LIGHT_M_S, AntennaArray, qar50
from handbench.radar.simulation.effects import multipath as multipath_effect
from handbench.radar.simulation.effects.motion import moving_samples
from handbench.radar.simulation.effects.multipath import land, multipath
from handbench.radar.simulation.reflection import reflections
from handbench.radar.simulation.scene import Body, EchoScene, Material, Motion
from handbench.radar.simulation.scene_echoes import bare_echoes
from tests.radar.samples import relative_error
from tests.radar.simulation.effects.plates import cylinder, dihedral, joined, plate, sphere_body
from tests.radar.simulation.effects.small_scenes import shaped

FAR_M = 500.0
METAL = np.ones((1, 2, 1025), complex)  # over that at normal incidence
TONE_HZ = np.array([77e9])
WAVELENGTH_M = SPEED_OF_LIGHT_M_S / TONE_HZ[0]
TONES_HZ = np.linspace(72e9, 82e9, 11)
SPARSE = AntennaArray(qar50().tx_m[::6], qar50().rx_m[::6])
CORNER = dihedral(0.02, 0.03, (0.01, 0.005, 0.33))
FINGERS = joined(
    cylinder((-0.011, 0.0, 0.31), 8e-3, 0.04), cylinder((0.011, 0.0, 0.32), 8e-3, 0.04)
)


def scene(body: Body, tones_hz=TONES_HZ, array: AntennaArray = SPARSE) -> EchoScene:
    return EchoScene(array, tones_hz, np.zeros(len(tones_hz)), body)


def twice(*scene_of) -> np.ndarray:
    """The two-bounce echoes alone."""
    return shaped(scene(*scene_of), multipath).bounced


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
    """σ = 4π/λ² |S R²|², monostatic and from afar, is that of the plate, 4πA²/λ²."""
    turn_rad, antenna_m = np.radians(turn_deg), [[0.0, 0.0, -FAR_M]]
    corner = dihedral(0.06, 0.05, turn_rad=turn_rad)
    sample = twice(corner, TONE_HZ, AntennaArray(antenna_m, antenna_m))[0, 0, 0]
    area_m2 = 2 * 0.06 * np.sin(np.pi / 4 - turn_rad) * 0.05
    assert (abs(sample) * FAR_M**2 / area_m2) ** 2 == pytest.approx(1, rel=within)


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


@pytest.mark.parametrize(
    ("curved_m", "wall_m", "gain"),
    [
        ((0.02, np.inf), 5e-3, 1),
        ((0.02, np.inf), 0.03, 1j),
        ((0.02, 0.02), 5e-3, 1),
        ((0.02, 0.02), 0.03, -1),
    ],
)
def test_a_tube_that_crosses_a_caustic_is_a_quarter_turn_ahead(curved_m, wall_m, gain):
    """A cylinder of the radius R mirrors rays along its axis of symmetry to a line R/2 before it,
    and a sphere to a point: the field gains j behind the one and j² behind the other (Balanis, sec.
    13.2.2)."""
    corners_m = 4e-4 * np.array([[0.0, 1, 0], [1, -1, 0], [-1, -1, 0]])
    normals = [0, 0, -1] - corners_m / [*curved_m, 1.0]  # hollow, seen from -z
    mirror = corners_m, normals / np.linalg.norm(normals, axis=1, keepdims=True)
    wall = [[0, 1, -wall_m], [-1, -1, -wall_m], [1, -1, -wall_m]], [[0, 0, 1]] * 3
    made = field((1, 0, -500), mirror, wall)
    assert made / abs(made) == pytest.approx(gain, abs=1e-2)


def over_two_mirrors(dipole, fresnel=METAL):
    """The field over a right-angled dihedral with its edge along y, met at 45°."""
    mirrors = []
    for side in (1, -1):
        u, normal = np.array([0, 1e-4, 0]), np.array([side, 0, -1]) / 2**0.5
        v = np.cross(normal, u)
        mirrors.append(([-0.1 * side, 0, 1] + np.stack([u, v, -u - v]), [normal] * 3))
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
    skin = Material(kind="plastic", permittivity=6.4, loss_tangent=1.35)
    n, inside = np.sqrt(6.4 * (1 - 1.35j)), np.sqrt(6.4 * (1 - 1.35j) - 0.5)
    s = (0.5**0.5 - inside) / (0.5**0.5 + inside)
    p = (inside - n**2 * 0.5**0.5) / (inside + n**2 * 0.5**0.5)
    fresnel = reflections(skin, np.array([80e9]), np.maximum(np.linspace(0, 1, 1025), 1e-6))
    expected = (s, p)[part] ** 2 * over_two_mirrors(dipole)
    assert over_two_mirrors(dipole, fresnel) == pytest.approx(expected, rel=3e-3)


@pytest.mark.parametrize(
    "body",
    [plate((-0.03, -0.03, 0.3), (0, 0.06, 0), (0.06, 0, 0), 20), sphere_body(0.01, (0, 0, 0.3))],
)
def test_flat_and_convex_bodies_have_no_second_bounce(body):
    assert not twice(body).any()


def test_transmitters_and_receivers_can_be_swapped():
    there, back = twice(FINGERS), twice(FINGERS, TONES_HZ, AntennaArray(SPARSE.rx_m, SPARSE.tx_m))
    assert relative_error(back.transpose(0, 2, 1), there) < 1e-5


def test_motion_turns_the_bounces_with_the_target():
    """By 0.2 mm, which are 0.6 rad; what is left over is the tubes' borders."""
    made = shaped(scene(FINGERS), multipath)
    made.scene = replace(made.scene, time_s=np.full(11, 1e-3), motion=Motion(velocity_m_s=0.2))
    made.facets = made.facets.where(np.arange(1))  # the bounces alone, but for one facet
    moved = twice(Body(FINGERS.vertices_m + [0, 0, 2e-4], FINGERS.faces))
    assert relative_error(moving_samples(made)[0], moved) < 0.03
    assert relative_error(made.bounced, moved) > 0.3


def bounces(body: Body, **changes) -> np.ndarray:
    """Those of one tone, of echoes with these changes."""
    echoes = replace(bare_echoes(scene(body, TONE_HZ)), **changes)
    echoes.shape(multipath)
    return echoes.bounced


def test_the_pattern_acts_on_both_legs():
    middle_m = np.array([0.01, 0.005, 0.32])  # of a corner that is 20 mm wide
    squared = [leg.directions(middle_m)[:, 2] ** 2 for leg in SPARSE.legs]
    expected = bounces(CORNER) * np.outer(*squared)
    assert relative_error(bounces(CORNER, pattern=2.0), expected) < 0.03


@pytest.mark.parametrize(
    ("reflection", "two", "expected"),
    [([1.0, 0.5j], True, 0.5j), ([0.5j, 0.1], False, -0.25)],  # of one; of none
)
def test_layers_reflect_each_in_its_way(reflection, two, expected, monkeypatch):
    """Each tube meets both plates once."""
    metal, layers = bounces(CORNER), np.array(reflection)[:, None]
    monkeypatch.setattr(multipath_effect, "echo_reflections", lambda *_: layers)
    monkeypatch.setattr(multipath_effect, "reflections", lambda *_: METAL.repeat(2, axis=0))
    second = np.arange(len(CORNER.faces)) >= len(CORNER.faces) // 2
    skin = bounces(replace(CORNER, palm=second & two), material=Material(kind="skin"))
    assert relative_error(skin, expected * metal) < 1e-6
