"""The posed hand's signed distance in the hand frame, as tests look at it."""

from handbench.bench.scenes.bones import hand_from_palm
from handbench.bench.scenes.hand import palm_field
from handbench.bench.scenes.hand_pose import Pose
from handbench.bench.scenes.implicit import Field
from handbench.bench.scenes.people import MEAN, Person


def hand_field(pose: Pose, person: Person = MEAN) -> Field:
    """Signed distance (approximately, exact sign) to the posed hand's skin, metres, in the hand
    frame."""
    field, turn = palm_field(pose, person), hand_from_palm(pose)
    return lambda points: field(points @ turn)
