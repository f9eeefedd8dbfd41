"""The skin of a hand that moves its fingers, against the surface of the hand in the other pose."""

import numpy as np
import pytest

from handbench.bench.scenes.bones import hand_from_palm
from handbench.bench.scenes.build import build
from handbench.bench.scenes.echoes import echo_scene, surfaces
from handbench.bench.scenes.hand import SkinnedHand, hand_mesh
from handbench.bench.scenes.hand_pose import FingerPose, Pose, ThumbPose, WristPose, between
from handbench.bench.scenes.people import MEAN, person
from handbench.bench.scenes.scene_file import SceneFile
from handbench.support.config import parse
from tests.bench.scenes.hand_field import hand_field

BEND = {"mcp_deg": 20.0, "pip_deg": 25.0, "dip_deg": 10.0}
SPREAD_DEG = {"index": 12.0, "middle": 0.0, "ring": -10.0, "little": -22.0}
OPEN, BENT = (
    Pose(**{name: FingerPose(spread_deg=deg, **bend) for name, deg in SPREAD_DEG.items()})
    for bend in ({}, BEND)
)
BENT = BENT.model_copy(update={"thumb": ThumbPose(radial_deg=45.0, mcp_deg=15.0, ip_deg=20.0)})
EXTENDED = OPEN.model_copy(update={"wrist": WristPose(flexion_deg=-15.0)})
TURNED = OPEN.model_copy(update={"turn_deg": (10.0, -20.0, 30.0)})


@pytest.fixture(scope="module")
def open_hand() -> tuple[np.ndarray, np.ndarray, SkinnedHand]:
    surface = hand_mesh(OPEN, 3e-3)
    vertices_m = np.asarray(surface.vertices)
    return vertices_m, np.asarray(surface.triangles), SkinnedHand(vertices_m, OPEN, MEAN)


def volume_m3(vertices_m: np.ndarray, faces: np.ndarray) -> float:
    return float(np.linalg.det(vertices_m[faces]).sum() / 6)


@pytest.mark.parametrize("pose", [BENT, EXTENDED])
def test_a_moved_skin_is_that_of_the_other_pose(open_hand, pose):
    """The implicit surface of the other pose, which skinning does not use, within 0.6 mm on the
    mean (joints fold in another way); the volume within 4 %, at all times."""
    vertices_m, faces, hand = open_hand
    for share in (0.3, 1.0):
        now = between(OPEN, pose, share)
        moved_m = hand.posed(now)
        assert volume_m3(moved_m, faces) == pytest.approx(volume_m3(vertices_m, faces), rel=0.04)
        assert np.abs(hand_field(now)(moved_m)).mean() < 6e-4


def test_a_turned_hand_is_rigid_and_the_start_exact(open_hand):
    vertices_m, _, hand = open_hand
    turned_m = vertices_m @ hand_from_palm(TURNED).T
    assert np.abs(hand.posed(TURNED) - turned_m).max() < 1e-12  # rounding
    assert np.array_equal(hand.posed(OPEN), vertices_m)


def test_fingers_move_in_a_scene_as_fast_as_their_joints():
    """A straight index finger that bends at the knuckle at 1 rad/s: its tip, some 82 mm away, has
    82 mm/s towards the palm; the palm rests, and after the end of the motion all do."""
    start, end = (
        {"index": {"spread_deg": 0.0, "mcp_deg": float(np.degrees(rad))}} for rad in (0, 0.4)
    )
    target = {"kind": "hand", "pose": start, "edge_m": 3e-3, "person": 3, "offset_m": [0, 0]}
    target["motion"] = {"pose": end, "duration_s": 0.4}
    sensor = {"sweep": [], "tones_hz": [82e9], "frame_period_s": 0.25}
    values = {"version": 1, "name": "h", "target": target, "sensor": sensor}
    scene = build(parse(SceneFile, values, "test"))
    (first_m, first), (_, second), (_, last) = surfaces(scene, echo_scene(scene), 3)
    assert np.array_equal(first_m, np.asarray(scene.target_mesh.vertices))
    reach_m = 1e-3 * (39.8 + 22.4 + 15.8) * np.mean(person(3).bones["index"][1:])
    speed_m_s = np.linalg.norm(first, axis=1)
    fastest = first[speed_m_s.argmax()]
    assert 0.95 < speed_m_s.max() / reach_m < 1.2  # tip tissue is a little further away
    assert fastest[2] < -0.9 * speed_m_s.max()  # towards the radar, which the palm faces
    assert np.median(speed_m_s) < 1e-3 and np.linalg.norm(second, axis=1).max() > 0.05
    assert np.abs(last).max() == 0
