"""The effects of simulated echoes, in the order in which they are applied, which is that of
known_effects.toml. Each has its cause in a scene and the function that applies it."""

from collections.abc import Callable
from dataclasses import dataclass

from handbench.radar.simulation.effects import (
    clutter,
    dielectric,
    motion,
    multipath,
    sensor,
    target_surface,
)
from handbench.radar.simulation.movement import moves
from handbench.radar.simulation.scene import EchoScene
from handbench.radar.simulation.scene_echoes import Echoes

SURFACE = "a target with a surface"


@dataclass(frozen=True)
class Effect:
    """One effect of simulated echoes.

    id: its name in scene files and in known_effects.toml; needs: the cause that a scene must have,
    in words; cause: function that tells whether a scene has it; apply: function that returns the
    echoes with the effect; way: function from a scene to how the effect is simulated there, in
    words ("": always in the same way).
    """

    id: str
    needs: str
    cause: Callable[[EchoScene], bool]
    apply: Callable[[Echoes], Echoes]
    way: Callable[[EchoScene], str] = lambda scene: ""

    def missing(self, scene: EchoScene) -> str:
        """Return the cause that the scene lacks for this effect, in words; "" if the scene has
        it."""
        return "" if self.cause(scene) else self.needs


def _has_surface(scene: EchoScene) -> bool:
    return scene.target is not None


def _rough(scene: EchoScene) -> bool:
    return scene.target is not None and scene.causes.roughness.sigma_m > 0


def _imperfect_channels(scene: EchoScene) -> bool:
    causes = scene.causes.channels
    return causes.gain_db > 0 or causes.phase_rad > 0 or causes.delay_m > 0


EFFECTS: tuple[Effect, ...] = (
    Effect(
        "positions",
        "[sensor.positions] with sigma_m",
        lambda scene: scene.causes.positions.sigma_m > 0,
        sensor.positions,
    ),
    Effect(
        "pattern",
        "[sensor.pattern] with beamwidth_deg",
        lambda scene: scene.causes.pattern.beamwidth_deg is not None,
        sensor.pattern,
    ),
    Effect("obliquity", SURFACE, _has_surface, target_surface.obliquity),
    Effect("shadow_centre", SURFACE, _has_surface, target_surface.shadow_centre),
    Effect("shadow_antennas", SURFACE, _has_surface, target_surface.shadow_antennas),
    Effect("shadow_diffraction", SURFACE, _has_surface, target_surface.shadow_diffraction),
    Effect(
        "skin",
        "a target of skin",
        lambda scene: scene.target is not None and scene.target.material.kind == "skin",
        target_surface.skin,
    ),
    Effect(
        "dielectric",
        "a target of plastic, or balls in foam",
        dielectric.has_dielectric,
        dielectric.dielectric,
    ),
    Effect(
        "roughness",
        "[target.roughness] with rms_m or layer_depth_m",
        _rough,
        target_surface.roughness,
    ),
    Effect("multipath", SURFACE, _has_surface, multipath.multipath),
    Effect(
        "motion",
        "[target.motion] with an amplitude, a velocity, a rotation or a pose",
        moves,
        motion.motion,
        motion.way_of_motion,
    ),
    Effect(
        "coupling",
        "[sensor.coupling] with level_db",
        lambda scene: scene.causes.coupling.level_db is not None,
        sensor.coupling,
    ),
    Effect(
        "clutter", "[stand] with reflectivity_db", lambda scene: bool(scene.room), clutter.clutter
    ),
    Effect("channels", "[sensor.channels] with an error", _imperfect_channels, sensor.channels),
    Effect(
        "oscillator",
        "[sensor.oscillator] with level_dbc_hz",
        lambda scene: scene.causes.oscillator.level_dbc_hz is not None,
        sensor.oscillator,
    ),
    Effect(
        "noise",
        "[noise] with phase_noise_rad or snr_db",
        lambda scene: scene.causes.noise.between_tones_rad > 0,
        sensor.noise,
    ),
    Effect(
        "converter",
        "[sensor.converter] with bits",
        lambda scene: scene.causes.converter.bits is not None,
        sensor.converter,
    ),
    Effect(
        "dead",
        "[sensor.dead] with tx or rx",
        lambda scene: bool(scene.causes.dead.tx or scene.causes.dead.rx),
        sensor.dead,
    ),
)
# An effect is included in the other one, if that is on.
CONTAINED = {"shadow_centre": "shadow_antennas", "shadow_antennas": "shadow_diffraction"}
# Not needed where no part of the target hides another part or mirrors onto it.
BETWEEN_PARTS = frozenset({"shadow_antennas", "shadow_diffraction", "multipath"})
