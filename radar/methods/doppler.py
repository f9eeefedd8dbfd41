"""Radial velocity from a tone that is measured twice in a frame, and images without the motion's
phase.

While the tones are measured one after another, a surface at depth z moves with the radial velocity
v. Tone i, measured at time t_i, has the phase −4πf_i(z + v t_i)/c, so that a depth step between two
tones is wrong by f_b v (t_b − t_a)/(f_b − f_a): 410 times the motion for tones 200 MHz apart. The
tone f_k, measured again after T, turns by

    φ = arg(O_k(T) conj(O_k(0))) = −4πf_k v T/c,    so    v = −cφ/(4πf_k T),

unambiguous within ±c/(4f_k T), and the motion's phase of tone i is φ f_i t_i/(f_k T). It is taken
off every image, pixel by pixel, before any depth step. Times count from the capture's earliest
tone, and depths are those at that time.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from handbench.radar.data.arrays import SPEED_OF_LIGHT_M_S
from handbench.radar.data.capture import RadarCapture
from handbench.radar.data.depthmap import DepthMap
from handbench.radar.methods.pixels import path_gradient_z
from handbench.support.errors import HandbenchError

if TYPE_CHECKING:
    from handbench.radar.methods.fsk import FskStep

SAME = 1e-9  # relative difference of two frequencies that are one tone
MOST = 30.0  # logarithm of an amplitude's factor, at most: squares of images stay numbers


class Repetition(NamedTuple):
    """A tone that is measured twice in a frame.

    measured [2]: indices of its first and its last measurement among the capture's tones;
    limit_m_s: largest unambiguous velocity c/(4f_k T); share [f]: f_i t_i/(f_k T) of the method's
    tones, the motion's phase of each tone at its time t_i relative to that of the repeated tone
    after T.
    """

    measured: np.ndarray
    limit_m_s: float
    share: np.ndarray

    def at_rest(self, images: np.ndarray, again: np.ndarray) -> np.ndarray:
        """Take the motion's phase off images [f, n] of the method's first f tones: they are divided
        by (O_k(T) / O_k(0))^(f_i t_i / f_k T). again [2, n]: O_k(0), O_k(T).

        Noise changes an image's amplitude as much as its phase. So the amplitudes of the result
        show the errors that the repeated tone adds to the phases.
        """
        first, last = again.astype(np.complex128)
        turn = np.divide(last, first, out=np.ones_like(last), where=(first != 0) & (last != 0))
        share = self.share[: len(images), None]
        log = -share * np.log(turn)
        log.real = np.clip(log.real, -MOST, MOST)
        return (images * np.exp(log)).astype(images.dtype)


def repetition(capture: RadarCapture, index: np.ndarray) -> Repetition:
    """Find the first of a method's tones that a capture has measured more than once. index [f]:
    those of the method's tones in the capture. Raises HandbenchError if the capture has no times,
    or no such tone."""
    times_s = capture.times_s
    without = "or use the method with doppler=False"
    if times_s is None:
        raise HandbenchError(
            "times_s: are missing, but a velocity needs the time of every tone; add times_s "
            f"[frequency] in seconds to the echoes, {without}"
        )
    for first in index:
        same = np.isclose(capture.frequencies_hz, capture.frequencies_hz[first], SAME, 0)
        last = int(np.where(same, times_s, -np.inf).argmax())
        if (interval_s := float(times_s[last] - times_s[first])) > 0:
            f, f_k = capture.vacuum_hz[index], float(capture.vacuum_hz[first])
            share = f * (times_s[index] - times_s.min()) / (f_k * interval_s)
            limit_m_s = SPEED_OF_LIGHT_M_S / (4 * f_k * interval_s)
            return Repetition(np.array([first, last]), limit_m_s, share)
    tones_ghz = ", ".join(f"{hz / 1e9:.4g}" for hz in capture.frequencies_hz[index])
    raise HandbenchError(
        f"frequencies: none of the method's tones ({tones_ghz} GHz) is measured at two times "
        f"of a frame, which a velocity needs; measure the first tone again after the last, "
        f"{without}"
    )


def with_velocity(depth: DepthMap, step: FskStep, repeated: Repetition) -> DepthMap:
    """Return the depth map with the radial velocities v = −cφ/(4πfT), m/s, positive away from the
    array, NaN off target.

    φ is the angle of the mean of O(T) conj(O(0)) over the filter of the result. The path grows by
    less than 2 per metre along the line from the array's middle, which is corrected (by 3 % for the
    paper's array at 0.31 m).
    """
    turned = step.again[1].astype(np.complex128) * np.conj(step.again[0])
    # of the numbers, not of the angles, which jump where they wrap
    real, imaginary = (
        step.pixels.means(part, step.echoes.config.filter_px) for part in (turned.real, turned.imag)
    )
    points_m = step.pixels.points_m(step.formed_m)
    cosine = points_m[:, 2] / np.linalg.norm(points_m, axis=1)
    along = path_gradient_z(points_m, step.echoes.aperture)
    factor = 2 * cosine / along
    velocity_m_s = -np.angle(real + 1j * imaginary) / np.pi * repeated.limit_m_s * factor
    return replace(
        depth, velocity_m_s=step.pixels.on_map(velocity_m_s), velocity_limit_m_s=repeated.limit_m_s
    )
