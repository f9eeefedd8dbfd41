"""Hand poses as joint angles, and the 24 static letters of the American manual alphabet (all but J
and Z), which are read from letters.toml.

Angles beyond what a supple healthy hand can do are refused.
"""

from pathlib import Path
from typing import Annotated, Any

from pydantic import Field

from handbench.support.config import Config, read_toml

Turn = Annotated[float, Field(ge=-180, le=180)]


class FingerPose(Config):
    """Joint angles of one finger, degrees; with 0, the finger is straight and in line with the
    palm.

    `mcp_deg`, `pip_deg` and `dip_deg` bend the knuckle, the middle joint and the end joint towards
    the palm (negative: backwards). `spread_deg` turns the finger at the knuckle within the palm's
    plane, towards the thumb (negative: away from it).
    """

    mcp_deg: float = Field(default=0.0, ge=-30, le=95)
    pip_deg: float = Field(default=0.0, ge=-10, le=120)
    dip_deg: float = Field(default=0.0, ge=-15, le=90)
    spread_deg: float = Field(default=0.0, ge=-30, le=30)


class ThumbPose(Config):
    """Joint angles of the thumb, degrees.

    The metacarpal starts at the wrist. `radial_deg` is its angle to the fingers' direction within
    the palm's plane (negative: across the palm), and `palmar_deg` its angle out of that plane, to
    the palm's side. `opposition_deg` turns the thumb about its own axis: with 0 it bends across the
    palm, with positive angles its pulp faces the palm. `mcp_deg` and `ip_deg` bend the two outer
    joints (negative: backwards, as a hitch-hiker's thumb).
    """

    radial_deg: float = Field(default=40.0, ge=-20, le=80)
    palmar_deg: float = Field(default=25.0, ge=-10, le=70)
    opposition_deg: float = Field(default=20.0, ge=-40, le=90)
    mcp_deg: float = Field(default=10.0, ge=-15, le=75)
    ip_deg: float = Field(default=10.0, ge=-30, le=90)


class WristPose(Config):
    """Joint angles of the wrist, degrees, as seen from the forearm.

    `flexion_deg` bends the hand to the palm's side (negative: backwards), and `deviation_deg`
    towards the thumb (negative: towards the little finger). In the hand frame, the palm stays and
    the forearm moves.
    """

    flexion_deg: float = Field(default=0.0, ge=-70, le=80)
    deviation_deg: float = Field(default=0.0, ge=-40, le=25)


class Pose(Config):
    """All joint angles of a right hand. The defaults describe an open, flat hand whose palm faces
    the radar.

    `turn_deg` turns hand and forearm together about the palm's centre, about the fixed x, y and z
    axes in this order.
    """

    thumb: ThumbPose = ThumbPose()
    index: FingerPose = FingerPose(spread_deg=4.0)
    middle: FingerPose = FingerPose(spread_deg=0.0)
    ring: FingerPose = FingerPose(spread_deg=-4.0)
    little: FingerPose = FingerPose(spread_deg=-10.0)
    wrist: WristPose = WristPose()
    turn_deg: tuple[Turn, Turn, Turn] = (0.0, 0.0, 0.0)


def between(start: Any, end: Any, share: float) -> Any:
    """Return the pose whose angles are start + share · (end − start); likewise for one joint's
    angles. share: 0 to 1; beyond, angles may exceed what a hand can do."""
    if isinstance(start, Config):
        angles = {name: between(angle, getattr(end, name), share) for name, angle in start}
        return start.model_copy(update=angles)
    if isinstance(start, tuple):
        return tuple(between(a, b, share) for a, b in zip(start, end, strict=True))
    return start + share * (end - start)


LETTERS = Path(__file__).with_name("letters.toml")
POSES = {name: Pose.model_validate(angles) for name, angles in read_toml(LETTERS, "poses").items()}
