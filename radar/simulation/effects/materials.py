"""The effects "skin" and "dielectric": reflection by skin and by plastic, and the delay of the
echoes of balls in foam.

Foam (n − 1 ≪ 1): rays are straight, and a path of length ℓ inside is longer by (n − 1)ℓ. Plastic:
only its front surface is simulated, since refraction is strong inside.
"""

from __future__ import annotations

import numpy as np

from handbench.radar.simulation.scene_echoes import Echoes


def skin(echoes: Echoes) -> None:
    """Apply the reflection of skin, a half-space under a horny layer that is thick only on the
    palm: weaker than metal's, with a phase that depends on frequency.

    The reflection is that at normal incidence. An image forms where transmitter, receiver and
    surface are specular; at 0.3 m the angle of incidence is then 18° at most, between opposite
    corners of the array. Up to this angle, in either polarisation, Γ of thin skin and of a palm of
    140 µm stays within 0.3 dB and 0.04 rad of normal incidence, and the error of the depth within
    0.01 mm. A palm of 430 µm is near a quarter wave: the difference is 2.5 dB, and 1.5 mm of its
    depth error of 2.6 mm.
    """
    if echoes.scene.target is not None:
        echoes.material = echoes.scene.target.material


def dielectric(echoes: Echoes) -> None:
    """Delay the echoes of balls in foam, and give a target of plastic its partial reflection."""
    echoes.ball_delay_m = np.array([ball.foam_delay_m for ball in echoes.scene.balls])
    target = echoes.scene.target
    if target is not None and target.material.kind == "plastic":
        echoes.material = target.material
