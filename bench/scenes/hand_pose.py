"""Hand poses as joint angles, and the 24 static letters of the American manual alphabet (all but J and Z).

The bounds are those of a supple healthy hand: what no hand can do is refused.
"""

from __future__ import annotations

from typing import Annotated

from pydantic import Field

from radar.support.config import Config

Turn = Annotated[float, Field(ge=-180, le=180)]


class FingerPose(Config):
    """One finger, degrees; 0 is straight, in line with the palm.

    `mcp_deg`, `pip_deg` and `dip_deg` bend the knuckle, the middle and the end joint towards the palm (negative: back);
    `spread_deg` turns the finger at the knuckle within the palm's plane, towards the thumb (negative: away from it).
    """

    mcp_deg: float = Field(default=0.0, ge=-30, le=95)
    pip_deg: float = Field(default=0.0, ge=-10, le=120)
    dip_deg: float = Field(default=0.0, ge=-15, le=90)
    spread_deg: float = Field(default=0.0, ge=-30, le=30)


class ThumbPose(Config):
    """The thumb, degrees.

    Its metacarpal leaves the wrist `radial_deg` from the fingers' direction within the palm's plane (negative: across
    the palm) and `palmar_deg` out of that plane, to the palm's side; `opposition_deg` turns it about its own axis (0:
    it bends across the palm, positive: the pulp turns to face the palm); `mcp_deg` and `ip_deg` bend its two joints
    (negative: back, as a hitch-hiker's thumb).
    """

    radial_deg: float = Field(default=40.0, ge=-20, le=80)
    palmar_deg: float = Field(default=25.0, ge=-10, le=70)
    opposition_deg: float = Field(default=20.0, ge=-40, le=90)
    mcp_deg: float = Field(default=10.0, ge=-15, le=75)
    ip_deg: float = Field(default=10.0, ge=-30, le=90)


class WristPose(Config):
    """The wrist, degrees: `flexion_deg` bends the hand to the palm's side (negative: back), `deviation_deg` towards the
    thumb (negative: towards the little finger), as seen from the forearm. The palm stays, the forearm moves."""

    flexion_deg: float = Field(default=0.0, ge=-70, le=80)
    deviation_deg: float = Field(default=0.0, ge=-40, le=25)


class Pose(Config):
    """All joint angles of a right hand; the defaults are an open, flat hand whose palm faces the radar.

    `turn_deg` turns hand and forearm about the palm's centre, about the fixed x, y and z axes in this order: what
    shoulder, elbow and the forearm's rotation do.
    """

    thumb: ThumbPose = ThumbPose()
    index: FingerPose = FingerPose(spread_deg=4.0)
    middle: FingerPose = FingerPose(spread_deg=0.0)
    ring: FingerPose = FingerPose(spread_deg=-4.0)
    little: FingerPose = FingerPose(spread_deg=-10.0)
    wrist: WristPose = WristPose()
    turn_deg: tuple[Turn, Turn, Turn] = (0.0, 0.0, 0.0)


LETTERS = {  # thumb, index, middle, ring and little finger: their angles in the order of the classes
    "A": ((32, 25, 42.5, 38.5, -6), (86, 104, 56, -1), (88, 105, 56, 0), (88, 105, 56, 0), (83, 99, 55, -6)),
    "B": ((13, 23, 19, 60, 34), (2, 3, 2, -3.4), (2, 4, 2, -0.5), (2, 4, 2, 1.2), (2, 4, 3, 2.3)),
    "C": ((18.5, 47, 60, 9.5, 12.5), (36, 34.5, 26.5, -3), (40, 32, 25, -0.5), (40.5, 33, 23.5, 1), (31, 34, 31.5, 3)),
    "D": ((7, 51, 45, 36, 33.5), (2, 3, 2, 1), (64, 60.5, 31.5, -0.5), (63.5, 59.5, 39.5, 1), (56, 40.5, 32.5, 3.5)),
    "E": ((17, 25, 6.5, 67.5, 30.5), (60.5, 102, 44.5, 3.5), (50.5, 107, 50, 0), (45, 100, 49, 0), (45, 102, 50, -2)),
    "F": ((23, 30.5, 30, 28, 3), (24, 93, 22, 11), (8, 8, 4, 3), (3, 5, 3, -6), (1, 4, 3, -17)),
    "G": ((34, 12, 10, 24, 8), (6, 4, 3, -2), (88, 105, 56, 0), (88, 105, 56, 0), (83, 99, 55, -6)),
    "H": ((16, 41, 3, 64, 42), (2, 3, 2, -2.4), (2, 4, 2, 0.5), (88, 105, 56, 0), (83, 99, 55, -6)),
    "I": ((28.5, 41, 10.5, 53, 49.5), (86, 104, 56, -1), (88, 105, 56, 0), (88, 105, 56, 0), (2, 4, 3, -4)),
    "K": ((-1, 13, 72, 6, 7.5), (0, 2, 2, 9), (41, 2, 2, -6), (88, 105, 56, 0), (83, 99, 55, -6)),
    "L": ((64, 6, 10, -6, -4), (2, 3, 2, 2), (88, 105, 56, 0), (88, 105, 56, 0), (83, 99, 55, -6)),
    "M": (
        (12.5, 31, 15, 65.5, 29),
        (73.5, 82.5, 33.5, 0),
        (74.5, 79.5, 34, 0),
        (72.5, 85.5, 32.5, 0),
        (84, 100, 55, -8),
    ),
    "N": ((21.5, 19, 6, 57.5, 40), (72, 88.5, 32, 0.5), (68, 96.5, 31.5, 0), (88, 105, 56, -3), (83, 99, 55, -6)),
    "O": ((6.5, 47, 56, 26, 24.5), (54.5, 58, 35, -2.5), (56, 65, 27.5, 0), (52.5, 68.5, 28, 1), (53.5, 47.5, 45.5, 7)),
    "P": ((-1, 13, 72, 6, 7.5), (0, 2, 2, 9), (41, 2, 2, -6), (88, 105, 56, 0), (83, 99, 55, -6)),
    "Q": ((34, 12, 10, 24, 8), (6, 4, 3, -2), (88, 105, 56, 0), (88, 105, 56, 0), (83, 99, 55, -6)),
    "R": ((16, 41, 3, 64, 42), (23, -10, 4.5, -7), (-3.5, 36, 6, 14.5), (88, 105, 56, 0), (83, 99, 55, -6)),
    "S": ((25, 41.5, 11.5, 49.5, 48.5), (86, 104, 56, -1), (88, 105, 56, 0), (88, 105, 56, 0), (83, 99, 55, -6)),
    "T": ((25.5, 36, 23.5, 42.5, 9), (60, 47.5, 46, 8.5), (90, 107, 56, -2), (88, 105, 56, -1), (83, 99, 55, -6)),
    "U": ((16, 41, 3, 64, 42), (2, 3, 2, -2.6), (2, 4, 2, 0.5), (88, 105, 56, 0), (83, 99, 55, -6)),
    "V": ((16, 41, 3, 64, 42), (2, 3, 2, 8), (2, 4, 2, -7), (88, 105, 56, 0), (83, 99, 55, -6)),
    "W": ((3, 50, 27, 50.5, 40), (2, 3, 2, 11), (2, 4, 2, 0), (2, 4, 2, -11), (64.5, 63.5, 33, 0)),
    "X": ((28.5, 51.5, 28, 57.5, 43.5), (12, 95, 40, 0), (88, 105, 56, 0), (88, 105, 56, 0), (83, 99, 55, -6)),
    "Y": ((54, 14, 20, -4, -4), (86, 104, 56, -1), (88, 105, 56, 0), (88, 105, 56, 0), (2, 4, 3, -20)),
}
WRISTS_DEG = {"G": (0, -25), "H": (0, -25), "P": (25, -20), "Q": (25, -20)}
TURNS_DEG = {
    "C": (0, 52, 0),
    "D": (0, 24, 0),
    "G": (0, 180, 80),
    "H": (0, 180, 80),
    "O": (0, 48, 0),
    "P": (15, 180, 145),
    "Q": (8, 180, 150),
}


def _letter(name: str) -> Pose:
    digits = [
        kind(**dict(zip(kind.model_fields, angles, strict=True)))
        for kind, angles in zip((ThumbPose, *[FingerPose] * 4), LETTERS[name], strict=True)
    ]
    wrist = dict(zip(WristPose.model_fields, WRISTS_DEG.get(name, (0, 0)), strict=True))
    parts = dict(zip(("thumb", "index", "middle", "ring", "little"), digits, strict=True))
    return Pose(**parts, wrist=WristPose(**wrist), turn_deg=TURNS_DEG.get(name, (0, 0, 0)))


POSES = {name: _letter(name) for name in LETTERS}
