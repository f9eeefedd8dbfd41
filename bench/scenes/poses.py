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


CURLED = {"mcp_deg": 78.0, "pip_deg": 100.0, "dip_deg": 62.0}

POSES = {
    "B": Pose(
        thumb=ThumbPose(radial_deg=8.0, palmar_deg=38.0, opposition_deg=25.0, mcp_deg=38.0, ip_deg=42.0),
        index=FingerPose(mcp_deg=2.0, pip_deg=3.0, dip_deg=2.0, spread_deg=-3.0),
        middle=FingerPose(mcp_deg=2.0, pip_deg=4.0, dip_deg=2.0, spread_deg=-0.5),
        ring=FingerPose(mcp_deg=2.0, pip_deg=4.0, dip_deg=2.0, spread_deg=1.5),
        little=FingerPose(mcp_deg=2.0, pip_deg=4.0, dip_deg=3.0, spread_deg=3.0),
    ),
    "F": Pose(
        thumb=ThumbPose(radial_deg=28.0, palmar_deg=42.0, opposition_deg=10.0, mcp_deg=22.0, ip_deg=30.0),
        index=FingerPose(mcp_deg=52.0, pip_deg=52.0, dip_deg=28.0, spread_deg=4.0),
        middle=FingerPose(mcp_deg=8.0, pip_deg=8.0, dip_deg=4.0, spread_deg=3.0),
        ring=FingerPose(mcp_deg=3.0, pip_deg=5.0, dip_deg=3.0, spread_deg=-6.0),
        little=FingerPose(mcp_deg=1.0, pip_deg=4.0, dip_deg=3.0, spread_deg=-17.0),
    ),
    "U": Pose(
        thumb=ThumbPose(radial_deg=12.0, palmar_deg=44.0, opposition_deg=25.0, mcp_deg=34.0, ip_deg=45.0),
        index=FingerPose(mcp_deg=2.0, pip_deg=3.0, dip_deg=2.0, spread_deg=-3.0),
        middle=FingerPose(mcp_deg=2.0, pip_deg=4.0, dip_deg=2.0, spread_deg=1.0),
        ring=FingerPose(**CURLED, spread_deg=0.0),
        little=FingerPose(**CURLED, spread_deg=-2.0),
    ),
}
