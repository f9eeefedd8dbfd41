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


POSES = {
    "A": Pose(
        thumb=ThumbPose(radial_deg=32, palmar_deg=25, opposition_deg=42.5, mcp_deg=38.5, ip_deg=-6),
        index=FingerPose(mcp_deg=86, pip_deg=104, dip_deg=56, spread_deg=-1),
        middle=FingerPose(mcp_deg=88, pip_deg=105, dip_deg=56, spread_deg=0),
        ring=FingerPose(mcp_deg=88, pip_deg=105, dip_deg=56, spread_deg=0),
        little=FingerPose(mcp_deg=83, pip_deg=99, dip_deg=55, spread_deg=-6),
    ),
    "B": Pose(
        thumb=ThumbPose(radial_deg=13, palmar_deg=23, opposition_deg=19, mcp_deg=60, ip_deg=34),
        index=FingerPose(mcp_deg=2, pip_deg=3, dip_deg=2, spread_deg=-3.4),
        middle=FingerPose(mcp_deg=2, pip_deg=4, dip_deg=2, spread_deg=-0.5),
        ring=FingerPose(mcp_deg=2, pip_deg=4, dip_deg=2, spread_deg=1.2),
        little=FingerPose(mcp_deg=2, pip_deg=4, dip_deg=3, spread_deg=2.3),
    ),
    "C": Pose(
        thumb=ThumbPose(radial_deg=18.5, palmar_deg=47, opposition_deg=60, mcp_deg=9.5, ip_deg=12.5),
        index=FingerPose(mcp_deg=36, pip_deg=34.5, dip_deg=26.5, spread_deg=-3),
        middle=FingerPose(mcp_deg=40, pip_deg=32, dip_deg=25, spread_deg=-0.5),
        ring=FingerPose(mcp_deg=40.5, pip_deg=33, dip_deg=23.5, spread_deg=1),
        little=FingerPose(mcp_deg=31, pip_deg=34, dip_deg=31.5, spread_deg=3),
        turn_deg=(0, 52, 0),
    ),
    "D": Pose(
        thumb=ThumbPose(radial_deg=7, palmar_deg=51, opposition_deg=45, mcp_deg=36, ip_deg=33.5),
        index=FingerPose(mcp_deg=2, pip_deg=3, dip_deg=2, spread_deg=1),
        middle=FingerPose(mcp_deg=64, pip_deg=60.5, dip_deg=31.5, spread_deg=-0.5),
        ring=FingerPose(mcp_deg=63.5, pip_deg=59.5, dip_deg=39.5, spread_deg=1),
        little=FingerPose(mcp_deg=56, pip_deg=40.5, dip_deg=32.5, spread_deg=3.5),
        turn_deg=(0, 24, 0),
    ),
    "E": Pose(
        thumb=ThumbPose(radial_deg=17, palmar_deg=25, opposition_deg=6.5, mcp_deg=67.5, ip_deg=30.5),
        index=FingerPose(mcp_deg=60.5, pip_deg=102, dip_deg=44.5, spread_deg=3.5),
        middle=FingerPose(mcp_deg=50.5, pip_deg=107, dip_deg=50, spread_deg=0),
        ring=FingerPose(mcp_deg=45, pip_deg=100, dip_deg=49, spread_deg=0),
        little=FingerPose(mcp_deg=45, pip_deg=102, dip_deg=50, spread_deg=-2),
    ),
    "F": Pose(
        thumb=ThumbPose(radial_deg=23, palmar_deg=30.5, opposition_deg=30, mcp_deg=28, ip_deg=3),
        index=FingerPose(mcp_deg=24, pip_deg=93, dip_deg=22, spread_deg=11),
        middle=FingerPose(mcp_deg=8, pip_deg=8, dip_deg=4, spread_deg=3),
        ring=FingerPose(mcp_deg=3, pip_deg=5, dip_deg=3, spread_deg=-6),
        little=FingerPose(mcp_deg=1, pip_deg=4, dip_deg=3, spread_deg=-17),
    ),
    "G": Pose(
        thumb=ThumbPose(radial_deg=34, palmar_deg=12, opposition_deg=10, mcp_deg=24, ip_deg=8),
        index=FingerPose(mcp_deg=6, pip_deg=4, dip_deg=3, spread_deg=-2),
        middle=FingerPose(mcp_deg=88, pip_deg=105, dip_deg=56, spread_deg=0),
        ring=FingerPose(mcp_deg=88, pip_deg=105, dip_deg=56, spread_deg=0),
        little=FingerPose(mcp_deg=83, pip_deg=99, dip_deg=55, spread_deg=-6),
        wrist=WristPose(flexion_deg=0, deviation_deg=-25),
        turn_deg=(0, 180, 80),
    ),
    "H": Pose(
        thumb=ThumbPose(radial_deg=16, palmar_deg=41, opposition_deg=3, mcp_deg=64, ip_deg=42),
        index=FingerPose(mcp_deg=2, pip_deg=3, dip_deg=2, spread_deg=-2.4),
        middle=FingerPose(mcp_deg=2, pip_deg=4, dip_deg=2, spread_deg=0.5),
        ring=FingerPose(mcp_deg=88, pip_deg=105, dip_deg=56, spread_deg=0),
        little=FingerPose(mcp_deg=83, pip_deg=99, dip_deg=55, spread_deg=-6),
        wrist=WristPose(flexion_deg=0, deviation_deg=-25),
        turn_deg=(0, 180, 80),
    ),
    "I": Pose(
        thumb=ThumbPose(radial_deg=28.5, palmar_deg=41, opposition_deg=10.5, mcp_deg=53, ip_deg=49.5),
        index=FingerPose(mcp_deg=86, pip_deg=104, dip_deg=56, spread_deg=-1),
        middle=FingerPose(mcp_deg=88, pip_deg=105, dip_deg=56, spread_deg=0),
        ring=FingerPose(mcp_deg=88, pip_deg=105, dip_deg=56, spread_deg=0),
        little=FingerPose(mcp_deg=2, pip_deg=4, dip_deg=3, spread_deg=-4),
    ),
    "K": Pose(
        thumb=ThumbPose(radial_deg=-1, palmar_deg=13, opposition_deg=72, mcp_deg=6, ip_deg=7.5),
        index=FingerPose(mcp_deg=0, pip_deg=2, dip_deg=2, spread_deg=9),
        middle=FingerPose(mcp_deg=41, pip_deg=2, dip_deg=2, spread_deg=-6),
        ring=FingerPose(mcp_deg=88, pip_deg=105, dip_deg=56, spread_deg=0),
        little=FingerPose(mcp_deg=83, pip_deg=99, dip_deg=55, spread_deg=-6),
    ),
    "L": Pose(
        thumb=ThumbPose(radial_deg=64, palmar_deg=6, opposition_deg=10, mcp_deg=-6, ip_deg=-4),
        index=FingerPose(mcp_deg=2, pip_deg=3, dip_deg=2, spread_deg=2),
        middle=FingerPose(mcp_deg=88, pip_deg=105, dip_deg=56, spread_deg=0),
        ring=FingerPose(mcp_deg=88, pip_deg=105, dip_deg=56, spread_deg=0),
        little=FingerPose(mcp_deg=83, pip_deg=99, dip_deg=55, spread_deg=-6),
    ),
    "M": Pose(
        thumb=ThumbPose(radial_deg=12.5, palmar_deg=31, opposition_deg=15, mcp_deg=65.5, ip_deg=29),
        index=FingerPose(mcp_deg=73.5, pip_deg=82.5, dip_deg=33.5, spread_deg=0),
        middle=FingerPose(mcp_deg=74.5, pip_deg=79.5, dip_deg=34, spread_deg=0),
        ring=FingerPose(mcp_deg=72.5, pip_deg=85.5, dip_deg=32.5, spread_deg=0),
        little=FingerPose(mcp_deg=84, pip_deg=100, dip_deg=55, spread_deg=-8),
    ),
    "N": Pose(
        thumb=ThumbPose(radial_deg=21.5, palmar_deg=19, opposition_deg=6, mcp_deg=57.5, ip_deg=40),
        index=FingerPose(mcp_deg=72, pip_deg=88.5, dip_deg=32, spread_deg=0.5),
        middle=FingerPose(mcp_deg=68, pip_deg=96.5, dip_deg=31.5, spread_deg=0),
        ring=FingerPose(mcp_deg=88, pip_deg=105, dip_deg=56, spread_deg=-3),
        little=FingerPose(mcp_deg=83, pip_deg=99, dip_deg=55, spread_deg=-6),
    ),
    "O": Pose(
        thumb=ThumbPose(radial_deg=6.5, palmar_deg=47, opposition_deg=56, mcp_deg=26, ip_deg=24.5),
        index=FingerPose(mcp_deg=54.5, pip_deg=58, dip_deg=35, spread_deg=-2.5),
        middle=FingerPose(mcp_deg=56, pip_deg=65, dip_deg=27.5, spread_deg=0),
        ring=FingerPose(mcp_deg=52.5, pip_deg=68.5, dip_deg=28, spread_deg=1),
        little=FingerPose(mcp_deg=53.5, pip_deg=47.5, dip_deg=45.5, spread_deg=7),
        turn_deg=(0, 48, 0),
    ),
    "P": Pose(
        thumb=ThumbPose(radial_deg=-1, palmar_deg=13, opposition_deg=72, mcp_deg=6, ip_deg=7.5),
        index=FingerPose(mcp_deg=0, pip_deg=2, dip_deg=2, spread_deg=9),
        middle=FingerPose(mcp_deg=41, pip_deg=2, dip_deg=2, spread_deg=-6),
        ring=FingerPose(mcp_deg=88, pip_deg=105, dip_deg=56, spread_deg=0),
        little=FingerPose(mcp_deg=83, pip_deg=99, dip_deg=55, spread_deg=-6),
        wrist=WristPose(flexion_deg=25, deviation_deg=-20),
        turn_deg=(15, 180, 145),
    ),
    "Q": Pose(
        thumb=ThumbPose(radial_deg=34, palmar_deg=12, opposition_deg=10, mcp_deg=24, ip_deg=8),
        index=FingerPose(mcp_deg=6, pip_deg=4, dip_deg=3, spread_deg=-2),
        middle=FingerPose(mcp_deg=88, pip_deg=105, dip_deg=56, spread_deg=0),
        ring=FingerPose(mcp_deg=88, pip_deg=105, dip_deg=56, spread_deg=0),
        little=FingerPose(mcp_deg=83, pip_deg=99, dip_deg=55, spread_deg=-6),
        wrist=WristPose(flexion_deg=25, deviation_deg=-20),
        turn_deg=(8, 180, 150),
    ),
    "R": Pose(
        thumb=ThumbPose(radial_deg=16, palmar_deg=41, opposition_deg=3, mcp_deg=64, ip_deg=42),
        index=FingerPose(mcp_deg=23, pip_deg=-10, dip_deg=4.5, spread_deg=-7),
        middle=FingerPose(mcp_deg=-3.5, pip_deg=36, dip_deg=6, spread_deg=14.5),
        ring=FingerPose(mcp_deg=88, pip_deg=105, dip_deg=56, spread_deg=0),
        little=FingerPose(mcp_deg=83, pip_deg=99, dip_deg=55, spread_deg=-6),
    ),
    "S": Pose(
        thumb=ThumbPose(radial_deg=25, palmar_deg=41.5, opposition_deg=11.5, mcp_deg=49.5, ip_deg=48.5),
        index=FingerPose(mcp_deg=86, pip_deg=104, dip_deg=56, spread_deg=-1),
        middle=FingerPose(mcp_deg=88, pip_deg=105, dip_deg=56, spread_deg=0),
        ring=FingerPose(mcp_deg=88, pip_deg=105, dip_deg=56, spread_deg=0),
        little=FingerPose(mcp_deg=83, pip_deg=99, dip_deg=55, spread_deg=-6),
    ),
    "T": Pose(
        thumb=ThumbPose(radial_deg=25.5, palmar_deg=36, opposition_deg=23.5, mcp_deg=42.5, ip_deg=9),
        index=FingerPose(mcp_deg=60, pip_deg=47.5, dip_deg=46, spread_deg=8.5),
        middle=FingerPose(mcp_deg=90, pip_deg=107, dip_deg=56, spread_deg=-2),
        ring=FingerPose(mcp_deg=88, pip_deg=105, dip_deg=56, spread_deg=-1),
        little=FingerPose(mcp_deg=83, pip_deg=99, dip_deg=55, spread_deg=-6),
    ),
    "U": Pose(
        thumb=ThumbPose(radial_deg=16, palmar_deg=41, opposition_deg=3, mcp_deg=64, ip_deg=42),
        index=FingerPose(mcp_deg=2, pip_deg=3, dip_deg=2, spread_deg=-2.6),
        middle=FingerPose(mcp_deg=2, pip_deg=4, dip_deg=2, spread_deg=0.5),
        ring=FingerPose(mcp_deg=88, pip_deg=105, dip_deg=56, spread_deg=0),
        little=FingerPose(mcp_deg=83, pip_deg=99, dip_deg=55, spread_deg=-6),
    ),
    "V": Pose(
        thumb=ThumbPose(radial_deg=16, palmar_deg=41, opposition_deg=3, mcp_deg=64, ip_deg=42),
        index=FingerPose(mcp_deg=2, pip_deg=3, dip_deg=2, spread_deg=8),
        middle=FingerPose(mcp_deg=2, pip_deg=4, dip_deg=2, spread_deg=-7),
        ring=FingerPose(mcp_deg=88, pip_deg=105, dip_deg=56, spread_deg=0),
        little=FingerPose(mcp_deg=83, pip_deg=99, dip_deg=55, spread_deg=-6),
    ),
    "W": Pose(
        thumb=ThumbPose(radial_deg=3, palmar_deg=50, opposition_deg=27, mcp_deg=50.5, ip_deg=40),
        index=FingerPose(mcp_deg=2, pip_deg=3, dip_deg=2, spread_deg=11),
        middle=FingerPose(mcp_deg=2, pip_deg=4, dip_deg=2, spread_deg=0),
        ring=FingerPose(mcp_deg=2, pip_deg=4, dip_deg=2, spread_deg=-11),
        little=FingerPose(mcp_deg=64.5, pip_deg=63.5, dip_deg=33, spread_deg=0),
    ),
    "X": Pose(
        thumb=ThumbPose(radial_deg=28.5, palmar_deg=51.5, opposition_deg=28, mcp_deg=57.5, ip_deg=43.5),
        index=FingerPose(mcp_deg=12, pip_deg=95, dip_deg=40, spread_deg=0),
        middle=FingerPose(mcp_deg=88, pip_deg=105, dip_deg=56, spread_deg=0),
        ring=FingerPose(mcp_deg=88, pip_deg=105, dip_deg=56, spread_deg=0),
        little=FingerPose(mcp_deg=83, pip_deg=99, dip_deg=55, spread_deg=-6),
    ),
    "Y": Pose(
        thumb=ThumbPose(radial_deg=54, palmar_deg=14, opposition_deg=20, mcp_deg=-4, ip_deg=-4),
        index=FingerPose(mcp_deg=86, pip_deg=104, dip_deg=56, spread_deg=-1),
        middle=FingerPose(mcp_deg=88, pip_deg=105, dip_deg=56, spread_deg=0),
        ring=FingerPose(mcp_deg=88, pip_deg=105, dip_deg=56, spread_deg=0),
        little=FingerPose(mcp_deg=2, pip_deg=4, dip_deg=3, spread_deg=-20),
    ),
}
