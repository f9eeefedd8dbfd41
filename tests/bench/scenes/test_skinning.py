"""The skin of a hand that moves its fingers, against the surface of the hand in the other pose."""

import numpy as np
import pytest

from handbench.bench.scenes.build import build
from handbench.bench.scenes.echoes import echo_scene, surfaces
from handbench.bench.scenes.hand import hand_mesh
from handbench.bench.scenes.hand_pose import FingerPose, Pose, ThumbPose, WristPose, between
from handbench.bench.scenes.people import MEAN, person
from handbench.bench.scenes.scene_file import SceneFile
from handbench.bench.scenes.skinning import SkinnedHand
from handbench.support.config import parse
from tests.bench.scenes.hand_field import hand_field

SPREAD_DEG = {"index": 12.0, "middle": 0.0, "ring": -10.0, "little": -22.0}
OPEN = Pose(**{name: FingerPose(spread_deg=angle) for name, angle in SPREAD_DEG.items()})
BENT = Pose(
    **{
        name: FingerPose(spread_deg=angle, mcp_deg=20.0, pip_deg=25.0, dip_deg=10.0)
        for name, angle in SPREAD_DEG.items()
    },
    thumb=ThumbPose(radial_deg=45.0, mcp_deg=15.0, ip_deg=20.0),
)
TURNED = OPEN.model_copy(update={"turn_deg": (10.0, -20.0, 30.0)})
EXTENDED = OPEN.model_copy(update={"wrist": WristPose(flexion_deg=-15.0)})


@pytest.fixture(scope="module")
def open_hand() -> tuple[np.ndarray, np.ndarray]:
    surface = hand_mesh(OPEN, 3e-3)
    return np.asarray(surface.vertices), np.asarray(surface.triangles)


def volume_m3(vertices_m: np.ndarray, faces: np.ndarray) -> float:
    return float(np.linalg.det(vertices_m[faces]).sum() / 6)


def test_the_start_is_exact(open_hand):
    vertices_m, _ = open_hand
    assert np.array_equal(SkinnedHand(vertices_m, OPEN, MEAN).posed(OPEN), vertices_m)


@pytest.mark.parametrize("pose", [BENT, EXTENDED, TURNED])
def test_a_moved_skin_is_that_of_the_other_pose(open_hand, pose):
    """The implicit surface of the other pose, which skinning does not use, within 0.6 mm on the
    mean (joints fold in another way); the volume within 4 %, at all times; no face turns over."""
    vertices_m, faces = open_hand
    hand, before = SkinnedHand(vertices_m, OPEN, MEAN), volume_m3(vertices_m, faces)
    for share in (0.3, 1.0):
        now = between(OPEN, pose, share)
        moved_m = hand.posed(now)
        assert volume_m3(moved_m, faces) == pytest.approx(before, rel=0.04)
        assert np.abs(hand_field(now)(moved_m)).mean() < 6e-4
        corners = [m[faces] for m in (vertices_m, moved_m)]
        areas = [
            np.linalg.norm(np.cross(c[:, 1] - c[:, 0], c[:, 2] - c[:, 0]), axis=1) for c in corners
        ]
        assert (areas[1] / areas[0]).min() > 0.1


def test_a_turned_hand_is_rigid(open_hand):
    vertices_m, faces = open_hand
    moved_m = SkinnedHand(vertices_m, OPEN, MEAN).posed(TURNED)
    edges_m = [
        np.linalg.norm(m[faces[:, 0]] - m[faces[:, 1]], axis=1) for m in (vertices_m, moved_m)
    ]
    assert np.abs(edges_m[1] - edges_m[0]).max() < 1e-12


def test_fingers_move_in_a_scene_as_fast_as_their_joints():
    """A straight index finger that bends at the knuckle at 1 rad/s: its tip, some 82 mm away, has
    82 mm/s towards the palm; the palm rests, and after the end of the motion all do."""
    angle_deg = float(np.degrees(1.0) * 0.4)
    start = {"index": {"spread_deg": 0.0}}
    end = {"index": {"spread_deg": 0.0, "mcp_deg": angle_deg}}
    target = {"kind": "hand", "pose": start, "edge_m": 3e-3, "person": 3, "offset_m": [0, 0]}
    target["motion"] = {"pose": end, "duration_s": 0.4}
    sensor = {"sweep": [], "tones_hz": [82e9], "frame_period_s": 0.25}
    values = {"version": 1, "name": "h", "target": target, "sensor": sensor}
    scene = build(parse(SceneFile, values, "test"))
    (first_m, first), (_, again), (_, last) = surfaces(scene, echo_scene(scene), 3)
    assert np.array_equal(first_m, np.asarray(scene.target_mesh.vertices))
    reach_m = 1e-3 * (39.8 + 22.4 + 15.8) * np.mean(person(3).bones["index"][1:])
    speed_m_s = np.linalg.norm(first, axis=1)
    fastest = first[speed_m_s.argmax()]
    assert 0.95 < speed_m_s.max() / reach_m < 1.2  # tip tissue is a little further away
    assert fastest[2] < -0.9 * speed_m_s.max()  # towards the radar, which the palm faces
    assert np.median(speed_m_s) < 1e-3 and np.linalg.norm(again, axis=1).max() > 0.05
    assert np.abs(last).max() == 0
