"""The trade-off's section on motion: the error of methods, tones and step times on a hand that
moves away from the array at several speeds.

In units of steps, a frame's echoes depend only on how far the hand moves in one step. They are
therefore simulated once for each such distance, with the tones of all settings. Noise is added for
each step time: a tone that takes twice as long has half the noise power.
"""

from collections import defaultdict
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cache
from typing import Any

import numpy as np

from handbench.bench.evaluation.metrics import HEADLINE, METRICS, VELOCITY_MAE, pool
from handbench.bench.evaluation.velocity_errors import velocity_figures
from handbench.bench.pipeline.image import prepare
from handbench.bench.pipeline.score import pixel_errors, reference_of_surface
from handbench.bench.results import Failure, Section, Setting
from handbench.bench.run.outcome import recorded_failure
from handbench.bench.run.sweep import ImagingSetting, known_configs, motion_settings
from handbench.bench.scenes.build import build
from handbench.bench.scenes.echoes import echo_scene
from handbench.bench.scenes.scene_file import SceneFile
from handbench.bench.tradeoff.settings import (
    MeasuredSection,
    TradeoffInputs,
    in_rounds,
    line,
    section,
)
from handbench.calibration.transforms import Transform
from handbench.groundtruth.mesh.depth import Reference
from handbench.groundtruth.mesh.surface import Surface
from handbench.radar.data.capture import RadarCapture
from handbench.radar.data.depthmap import DepthMap
from handbench.radar.data.grid import PixelGrid
from handbench.radar.methods.advice import requested_tones_hz
from handbench.radar.methods.registry import method
from handbench.radar.simulation.causes import Causes, Motion
from handbench.radar.simulation.effects.sensor import strongest_amplitude, thermal_noise
from handbench.radar.simulation.scene import EchoScene
from handbench.radar.simulation.selection import choose
from handbench.radar.simulation.simulate import simulate_scene
from handbench.radar.warmup import compile_kernels
from handbench.support.config import Config, parse

SCENE: dict[str, Any] = {
    "version": 1,
    "name": "moving-hand",
    "target": {"kind": "hand", "pose": "B", "distance_m": 0.285, "edge_m": 1.5e-3},
}
EFFECTS = ("obliquity", "shadow_centre")
NOISE_STEP_S = 1e-3  # the step time that phase_noise_rad refers to
WHERE = "tradeoff.motion"


@dataclass(frozen=True, eq=False)
class MotionFrame:
    """The frame of one imaging setting: its configuration, and its tones in the order in which they
    are measured, [f] Hz."""

    setting: ImagingSetting
    config: Config
    tones_hz: np.ndarray

    @classmethod
    def of(cls, setting: ImagingSetting) -> "MotionFrame":
        """Return the frame that a setting needs; for a velocity, its first tone is repeated."""
        config = method(setting.method).configure(setting.config, WHERE)
        tones_hz = requested_tones_hz(config)
        assert tones_hz is not None
        again_hz = tones_hz[:1] if getattr(config, "doppler", False) else tones_hz[:0]
        return cls(setting, config, np.concatenate([tones_hz, again_hz]))

    @property
    def reference_steps(self) -> float:
        """The time, in steps, of the surface that its depths are compared with: the first tone, or
        the middle of the sweep from which a volume is imaged."""
        volume = hasattr(self.config, "z")
        return (len(self.tones_hz) - 1) / 2 if volume else 0.0


def measure_motion(inputs: TradeoffInputs) -> MeasuredSection:
    """Measure the errors of depth and velocity of every imaging setting at every speed and step
    time, on a simulated hand. The time of a setting is that to measure its frame."""
    knobs = inputs.sweep.motion
    frames = [
        MotionFrame.of(s) for s in motion_settings(inputs.sweep, known_configs(inputs.bench.method))
    ]
    tones = {(hz, step) for frame in frames for step, hz in enumerate(frame.tones_hz.tolist())}
    scene = _scene(sorted(tones, key=lambda tone: tone[::-1]), inputs.bench.seed)
    failures: list[Failure] = []
    compile_kernels()
    at_rest = echoes(scene, 0.0)
    strongest = strongest_amplitude(
        at_rest.samples[0, scene.frequencies_hz.argmax()],
        scene.frequencies_hz.max(),
        scene.array,
        scene.body.vertices_m[:: max(1, len(scene.body.vertices_m) // 4000)],
    )

    @cache
    def reference(x_m: tuple[float, ...], y_m: tuple[float, ...]) -> Reference:
        """Return the hand's depths at time 0, with its velocities at a speed of 1 m/s."""
        vertices_m = scene.body.vertices_m
        surface = Surface(
            vertices_m,
            scene.body.faces,
            np.zeros(len(vertices_m)),
            np.ones(len(vertices_m), bool),
            np.broadcast_to([0.0, 0.0, 1.0], vertices_m.shape),
        )
        still = Transform("radar", "radar", np.eye(4), np.zeros((6, 6)))
        return reference_of_surface(surface, still, PixelGrid(np.array(x_m), np.array(y_m)))

    def measured(motion_m: float) -> Iterator[dict[str, Any]]:
        """Yield the figures of all settings whose hand moves by motion_m in each step."""
        clean = echoes(scene, motion_m) if motion_m else at_rest
        for speed_m_s, step_s in pairs[motion_m]:
            sigma_rad = knobs.phase_noise_rad * np.sqrt(NOISE_STEP_S / step_s)
            samples = thermal_noise(
                clean.samples[0], clean.frequencies_hz, sigma_rad, strongest, (scene.seed,)
            )
            noisy = replace(clean, samples=samples[None])
            for frame in frames:
                row = {"frame": frame, "speed_m_s": speed_m_s, "step_s": step_s}
                with recorded_failure(failures, SCENE["name"], "motion", _name(row)):
                    depth = image(noisy, scene.time_s, frame, step_s)
                    on_grid = reference(tuple(depth.x_m), tuple(depth.y_m))
                    assert on_grid.velocity_m_s is not None  # as the surface has
                    later_m = frame.reference_steps * motion_m
                    moved = on_grid._replace(
                        z_m=on_grid.z_m + later_m, velocity_m_s=speed_m_s * on_grid.velocity_m_s
                    )
                    row |= figures(depth, moved)
                yield row

    pairs: dict[float, list[tuple[float, float]]] = defaultdict(list)
    for speed_m_s in dict.fromkeys(knobs.speed_m_s):
        for step_s in dict.fromkeys(knobs.step_s):
            pairs[round(speed_m_s * step_s, 12)].append((speed_m_s, step_s))
    named = {f"{1e3 * motion_m:g} mm a step": motion_m for motion_m in pairs}
    found = in_rounds(named, 1, measured, "motion")
    rows = sorted(
        (row for some in found.values() for row in some),
        key=lambda row: (row["speed_m_s"], frames.index(row["frame"]), row["step_s"]),
    )
    words = {
        "metric": METRICS[HEADLINE].definition,
        "speeds": ", ".join(f"{v:g}" for v in sorted(set(knobs.speed_m_s))),
        "noise": knobs.phase_noise_rad,
    }
    about = section("motion", _name(rows[0]), words)
    left_out = {"motion_left_out": [failure.line for failure in failures]} if failures else {}
    return MeasuredSection(about, [_line(about, row) for row in rows], left_out)


def _scene(tones: Sequence[tuple[float, int]], seed: int) -> EchoScene:
    """Return the hand before the array, with tones (Hz, time in steps)."""
    scene = echo_scene(build(parse(SceneFile, SCENE, WHERE)))
    frequencies_hz, steps = np.array(tones).T
    return replace(scene, frequencies_hz=frequencies_hz, time_s=steps, seed=seed)


def echoes(scene: EchoScene, motion_m: float) -> RadarCapture:
    """Simulate one frame without noise, in which the target moves by motion_m in each step."""
    moving = replace(scene, causes=Causes(motion=Motion(velocity_m_s=motion_m)))
    effects = (*EFFECTS, "motion") if motion_m else EFFECTS
    return simulate_scene(moving, choose(moving, effects)).capture


def image(capture: RadarCapture, steps: np.ndarray, frame: MotionFrame, step_s: float) -> DepthMap:
    """Image the tones of a frame. steps [f]: when each tone of the capture is measured, in steps;
    step_s: time of a step."""
    measured = list(zip(capture.frequencies_hz.tolist(), steps.tolist(), strict=True))
    index = [measured.index((hz, step)) for step, hz in enumerate(frame.tones_hz.tolist())]
    own = replace(
        capture,
        samples=capture.samples[:, index],
        frequencies_hz=capture.frequencies_hz[index],
        times_s=step_s * np.arange(len(index)),
    )
    every = frame.setting.every_nth_antenna
    return prepare(own, method(frame.setting.method), frame.config, 0, every).image().depth


def figures(depth: DepthMap, reference: Reference) -> dict[str, float | None]:
    """Compute the row's figures: errors of depth and velocity, the share of the hand that was seen,
    and the largest unambiguous velocity."""
    errors = pixel_errors(depth, reference)
    values = pool([errors])
    velocity = velocity_figures(depth, np.isfinite(errors.error_m), reference)
    return {
        "error": values[HEADLINE],
        "seen_percent": values["observed_percent"],
        VELOCITY_MAE: velocity.get(VELOCITY_MAE),
        "velocity_limit_m_s": depth.velocity_limit_m_s,
    }


def _name(row: dict[str, Any]) -> str:
    name = row["frame"].setting.name
    return f"{name}-step-{1e3 * row['step_s']:g}ms-at-{row['speed_m_s']:g}m/s"


def _line(about: Section, row: dict[str, Any]) -> Setting:
    """Make the row of a setting at one speed in the section's table."""
    frame, step_s = row["frame"], row["step_s"]
    tones = len(frame.tones_hz)
    title = f"{frame.setting.title}, {tones} tones, {1e3 * step_s:g} ms, {row['speed_m_s']:g} m/s"
    knobs = {
        "method": frame.setting.method,
        **frame.setting.varied,
        "tones": tones,
        "step_s": step_s,
    }
    known = {key: value for key, value in row.items() if key not in ("round", "frame", "step_s")}
    return line(about, _name(row), title, knobs, seconds=[tones * step_s], **known)
