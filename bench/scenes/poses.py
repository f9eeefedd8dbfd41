"""Hand poses as joint angles, and three letters of the American manual alphabet."""

from __future__ import annotations

from calibration import Config


class FingerPose(Config):
    """One finger, degrees: flexion of its three joints and `spread`, the abduction at the knuckle towards the thumb."""

    mcp_deg: float = 0.0
    pip_deg: float = 0.0
    dip_deg: float = 0.0
    spread_deg: float = 0.0


class ThumbPose(Config):
    """The thumb, degrees.

    Its metacarpal leaves the wrist `radial_deg` from the fingers' direction within the palm's plane and `palmar_deg`
    out of that plane; `opposition_deg` turns it about its own axis (0: it bends across the palm, positive: the pulp
    turns to face the palm); `mcp_deg` and `ip_deg` bend its two joints.
    """

    radial_deg: float = 40.0
    palmar_deg: float = 25.0
    opposition_deg: float = 20.0
    mcp_deg: float = 10.0
    ip_deg: float = 10.0


class Pose(Config):
    """All joint angles of a right hand; the defaults are an open, flat hand."""

    thumb: ThumbPose = ThumbPose()
    index: FingerPose = FingerPose(spread_deg=4.0)
    middle: FingerPose = FingerPose(spread_deg=0.0)
    ring: FingerPose = FingerPose(spread_deg=-4.0)
    little: FingerPose = FingerPose(spread_deg=-10.0)


POSES = {
    "B": Pose(
        thumb=ThumbPose(radial_deg=13, palmar_deg=23, opposition_deg=19, mcp_deg=60, ip_deg=34),
        index=FingerPose(mcp_deg=2, pip_deg=3, dip_deg=2, spread_deg=-3.4),
        middle=FingerPose(mcp_deg=2, pip_deg=4, dip_deg=2, spread_deg=-0.5),
        ring=FingerPose(mcp_deg=2, pip_deg=4, dip_deg=2, spread_deg=1.2),
        little=FingerPose(mcp_deg=2, pip_deg=4, dip_deg=3, spread_deg=2.3),
    ),
    "F": Pose(
        thumb=ThumbPose(radial_deg=23, palmar_deg=30.5, opposition_deg=30, mcp_deg=28, ip_deg=3),
        index=FingerPose(mcp_deg=24, pip_deg=93, dip_deg=22, spread_deg=11),
        middle=FingerPose(mcp_deg=8, pip_deg=8, dip_deg=4, spread_deg=3),
        ring=FingerPose(mcp_deg=3, pip_deg=5, dip_deg=3, spread_deg=-6),
        little=FingerPose(mcp_deg=1, pip_deg=4, dip_deg=3, spread_deg=-17),
    ),
    "U": Pose(
        thumb=ThumbPose(radial_deg=16, palmar_deg=41, opposition_deg=3, mcp_deg=64, ip_deg=42),
        index=FingerPose(mcp_deg=2, pip_deg=3, dip_deg=2, spread_deg=-2.6),
        middle=FingerPose(mcp_deg=2, pip_deg=4, dip_deg=2, spread_deg=0.5),
        ring=FingerPose(mcp_deg=88, pip_deg=105, dip_deg=56, spread_deg=0),
        little=FingerPose(mcp_deg=83, pip_deg=99, dip_deg=55, spread_deg=-6),
    ),
}
