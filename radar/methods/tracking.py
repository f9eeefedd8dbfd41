"""Depth and velocity over the frames of a sequence: each pixel has a Kalman filter, whose target
keeps its velocity but for a random acceleration (Bar-Shalom, Li & Kirubarajan, Estimation with
Applications to Tracking and Navigation, 2001, sections 5.2 and 6.3).

The state of a pixel is x = (z, v): depth and radial velocity, with the covariance P. A frame
measures both, y = x + e, with the variances R = diag(σ_z², σ_v²). Between two frames, T apart,

    x⁻ = F x            F = [1  T/u]     where u = z/|p| is the cosine of the angle off the axis:
    P⁻ = F P Fᵀ + Q         [0   1 ]     a surface that moves along z by 1 m recedes by u
    Q  = a² g gᵀ        g = (T²/2u, T), a: the hand's acceleration

and the frame corrects this by

    ν = y − x⁻,  S = P⁻ + R,  K = P⁻ S⁻¹,  x = x⁻ + K ν,  P = (I − K) P⁻.

Not all of R is noise: speckle moves a pixel's depth by as much in the next frame, until the target
has moved by a resolution cell. Filters do not reduce such an error, and their innovations ν do not
contain it: they are smaller than S says. Of a measurement's variance R, the share κ = mean(ν²/S) is
new in every frame, and the state has the variance κP + (1 − κ)R.
"""

from __future__ import annotations

import weakref
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from handbench.radar.data.capture import RadarCapture
from handbench.radar.data.depthmap import DepthMap
from handbench.radar.data.grid import PixelGrid
from handbench.radar.imaging.device import current_device
from handbench.radar.methods.depth_uncertainty import fsk_with_uncertainty
from handbench.radar.methods.fsk_config import TrackedConfig
from handbench.support.errors import HandbenchError

LEAST = 1e-9  # of a standard deviation, so that S has an inverse
GATE = 5.0  # standard deviations within which a measurement is of the same surface
# capture (weak reference), configuration, device and last two tracks (by frame) of the latest call
_last: tuple[Any, ...] = ()
MEASURED = ("velocity_m_s", "sigma_m", "velocity_sigma_m_s")


@dataclass(frozen=True)
class Track:
    """The state of the filters of all pixels at one time: x [ny, nx, 2], depth and radial velocity,
    and its covariance P [ny, nx, 2, 2], both NaN off target."""

    grid: PixelGrid
    x: np.ndarray
    P: np.ndarray
    time_s: float


def track(
    maps: Iterable[DepthMap], frame_times_s: Sequence[float], acceleration_m_s2: float
) -> Iterator[DepthMap]:
    """Yield for each frame the depth map that follows from it and all frames before it.

    Args:
        maps: depth maps of the frames on one grid, with velocities and standard deviations.
        frame_times_s: when each frame starts, ascending, seconds.
        acceleration_m_s2: root mean square of the target's acceleration along the line of sight.

    Raises:
        HandbenchError: a map has no velocities or standard deviations, or another grid, or the
            times are not ascending.
    """
    before = None
    for depth, time_s in zip(maps, frame_times_s, strict=True):
        before, found = step(before, depth, time_s, acceleration_m_s2)
        yield found


def tracked(capture: RadarCapture, config: TrackedConfig, frame: int = 0) -> DepthMap:
    """Return the depth map of a frame by 3fsk-doppler, corrected by all frames before it, which are
    imaged, too, unless the last call was for one of them.

    Raises HandbenchError for several frames without times, and as `fsk_with_uncertainty` does.
    """
    global _last
    times_s = capture.frame_times_s
    if times_s is None:
        if frame > 0:
            raise HandbenchError(
                "frame_times_s: are missing, but a track needs the time of every frame; add "
                "frame_times_s [frame] in seconds to the echoes, or use the method 3fsk-doppler"
            )
        times_s = np.zeros(1)
    last, device = _last, current_device()
    known = last and last[0]() is capture and last[1:3] == (config, device)
    tracks: dict[int, Track] = {n: last[3][n] for n in last[3] if n < frame} if known else {}
    for n in range(max(tracks, default=-1) + 1, frame + 1):
        try:
            depth = fsk_with_uncertainty(capture, config, n)
        except HandbenchError as error:
            raise HandbenchError(f"frame {n}, which the track needs: {error}") from None
        tracks[n], found = step(
            tracks.get(n - 1), depth, float(times_s[n]), config.acceleration_m_s2
        )
    kept = {n: tracks[n] for n in (frame - 1, frame) if n in tracks}
    _last = weakref.ref(capture), config, device, kept
    return found


def step(
    before: Track | None, depth: DepthMap, time_s: float, acceleration_m_s2: float
) -> tuple[Track, DepthMap]:
    """Continue a track by the depth map of a frame at time_s: (track, the map corrected by the
    frames before it). before: the track up to the frame before; None for the first frame.

    A pixel starts from its measurement if it had no depth before, and again if the measurement is
    too far from what the track predicts: another surface is there. Raises HandbenchError as `track`
    does.
    """
    measured = _measured(depth, time_s)
    if before is None:
        return measured, depth
    if time_s <= before.time_s:
        raise HandbenchError(
            f"frame_times_s: {time_s:g} s follows {before.time_s:g} s; put the frames in the order "
            "in which they were measured"
        )
    if not all(map(np.array_equal, vars(before.grid).values(), vars(measured.grid).values())):
        raise HandbenchError(
            f"maps: the map at {time_s:g} s has other pixels x_m, y_m than the one before; use one "
            "grid for all frames"
        )
    known = np.isfinite(measured.x + before.x).all(axis=-1)
    points_m = before.grid.points_at_m(np.flatnonzero(known), before.x[known, 0])
    cosine = points_m[:, 2] / np.linalg.norm(points_m, axis=1)
    interval_s = time_s - before.time_s
    x, P = predicted(before.x[known], before.P[known], cosine, interval_s, acceleration_m_s2)
    x, P, new = corrected(x, P, measured.x[known], measured.P[known])
    state = replace(measured, x=measured.x.copy(), P=measured.P.copy())
    state.x[known], state.P[known] = x, P
    R, P = (np.diagonal(each.P, axis1=-2, axis2=-1) for each in (measured, state))
    variance = new * P + (1 - new) * R
    sigma_m, velocity_sigma_m_s = np.moveaxis(np.sqrt(variance), -1, 0)
    return state, replace(
        depth,
        z_m=state.x[..., 0],
        velocity_m_s=state.x[..., 1],
        sigma_m=sigma_m,
        velocity_sigma_m_s=velocity_sigma_m_s,
    )


def predicted(
    x: np.ndarray, P: np.ndarray, cosine: np.ndarray, interval_s: float, acceleration_m_s2: float
) -> tuple[np.ndarray, np.ndarray]:
    """Predict the state of n pixels after interval_s: (x⁻ [n, 2], P⁻ [n, 2, 2]). cosine [n]: u."""
    T, one, zero = interval_s / cosine, np.ones_like(cosine), np.zeros_like(cosine)
    F = np.moveaxis(np.array([[one, T], [zero, one]]), -1, 0)
    g = np.stack([T * interval_s / 2, interval_s * one], axis=-1)
    Q = acceleration_m_s2**2 * g[:, :, None] * g[:, None, :]
    return (F @ x[..., None])[..., 0], F @ P @ F.swapaxes(1, 2) + Q


def corrected(
    x: np.ndarray, P: np.ndarray, y: np.ndarray, R: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Correct the predicted state x [n, 2], P [n, 2, 2] of n pixels by the measurement y, R:
    (x, P, share κ [2] of R that is new). A pixel whose measurement is beyond the gate takes it."""
    innovation, S = y - x, P + R
    inverse = np.linalg.inv(S)
    K = P @ inverse
    near = np.einsum("ni,nij,nj->n", innovation, inverse, innovation) <= GATE**2
    new = np.ones(2)
    if near.any():
        expected = np.diagonal(S[near], axis1=-2, axis2=-1)
        new = np.minimum((innovation[near] ** 2 / expected).mean(axis=0), 1)
    x = np.where(near[:, None], x + (K @ innovation[..., None])[..., 0], y)
    return x, np.where(near[:, None, None], P - K @ P, R), new


def _measured(depth: DepthMap, time_s: float) -> Track:
    """Return a depth map's measurement, y and R, as a track that starts with it."""
    if missing := [name for name in MEASURED if getattr(depth, name) is None]:
        raise HandbenchError(
            f"maps: the map at {time_s:g} s has no {', '.join(missing)}; use maps of a method that "
            "measures velocities, such as 3fsk-doppler"
        )
    R = np.zeros((*depth.z_m.shape, 2, 2))
    velocity_m_s, *sigmas = (np.asarray(getattr(depth, name)) for name in MEASURED)
    R[..., 0, 0], R[..., 1, 1] = (np.maximum(sigma, LEAST) ** 2 for sigma in sigmas)
    y = np.stack([depth.z_m, velocity_m_s], axis=-1)
    return Track(PixelGrid(depth.x_m, depth.y_m), y, R, time_s)
