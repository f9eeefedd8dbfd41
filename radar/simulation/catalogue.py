"""The effects of simulated echoes, in the order in which they are applied; and their selection for
a scene: a list of names, or "auto", which is every effect that the scene has a cause for."""

from collections.abc import Callable
from dataclasses import dataclass
from importlib import import_module
from typing import Any, Literal

from handbench.radar.simulation.meshes import convex_block
from handbench.radar.simulation.scene import Choice, EchoScene
from handbench.support.config import suggest
from handbench.support.errors import HandbenchError

Wanted = tuple[str, ...] | Literal["auto"]


@dataclass(frozen=True)
class Effect:
    """One effect of simulated echoes.

    id: its name in scene files; does: what it does; source: the source of its model; needs: what in
    a scene calls for it, in words; cause: function that tells whether a scene has that; module: the
    one of `simulation.effects` whose function with the effect's name applies it.
    """

    id: str
    does: str
    source: str
    needs: str
    cause: Callable[[EchoScene], bool]
    module: str

    @property
    def apply(self) -> Callable[..., Any]:
        """The function of the effect, whose module is imported when the effect is simulated. It
        takes the `Echoes` and changes them in place or, if the effect is one of RECORDING, it takes
        the `Echoes` and the samples [frame, f, t, r], and returns the samples with the effect."""
        module = import_module(f"handbench.radar.simulation.effects.{self.module}")
        function: Callable[..., Any] = getattr(module, self.id)
        return function


def _has_surface(scene: EchoScene) -> bool:
    return scene.target is not None


def _hides(scene: EchoScene) -> bool:
    """Tell whether a part of the target can hide another part, or the room, and mirror onto it."""
    return scene.target is not None and bool(
        scene.room or scene.balls or not convex_block(scene.target)
    )


def _has_dielectric(scene: EchoScene) -> bool:
    """Return True if the target is of plastic, or its balls are in foam."""
    plastic = scene.target is not None and scene.target.material.kind == "plastic"
    return plastic or any(ball.foam_delay_m > 0 for ball in scene.balls)


def _moves(scene: EchoScene) -> bool:
    """Tell whether the scene's target moves."""
    motion = scene.motion
    rates = (motion.amplitude_m, motion.velocity_m_s, *motion.rotation_deg_s)
    return any(rates) or scene.bent is not None


SURFACE = "a target with a surface"
PARTS = "a target with a surface that is no lone plate or box"

SHAPING: tuple[Effect, ...] = (
    Effect(
        "positions",
        "true antenna positions about the nominal ones",
        "normal errors of the given spread, drawn once per scene",
        "[sensor.positions] with sigma_m",
        lambda scene: scene.sensor.positions.sigma_m > 0,
        "sensor",
    ),
    Effect(
        "pattern",
        "the antennas' directivity",
        "cosᵠ: Balanis, Antenna Theory, sec. 2.6; the QAR50's width is not public",
        "[sensor.pattern] with beamwidth_deg",
        lambda scene: scene.sensor.pattern.beamwidth_deg is not None,
        "sensor",
    ),
    Effect(
        "obliquity",
        "facets scatter by physical optics, each antenna's angle",
        "the integrand 2n·û of physical optics, see handbench.radar.simulation.forward",
        SURFACE,
        _has_surface,
        "surfaces",
    ),
    Effect(
        "shadow",
        "shadows of each antenna, blurred by diffraction",
        "Kirchhoff's integral along outlines: Miyamoto & Wolf 1962",
        PARTS,
        _hides,
        "surfaces",
    ),
    Effect(
        "skin",
        "reflection of skin, with the palm's horny layer",
        "Gabriel et al. 1996 and Alekseev & Ziskin 2007",
        "a target of skin",
        lambda scene: scene.target is not None and scene.target.material.kind == "skin",
        "surfaces",
    ),
    Effect(
        "dielectric",
        "foam delays the echoes of balls; plastic reflects in part",
        "Fresnel at normal incidence, straight rays with (n − 1)·path",
        "a target of plastic, or balls in foam",
        _has_dielectric,
        "surfaces",
    ),
    Effect(
        "roughness",
        "roughness and layer lines: facets displaced and weakened",
        "random Fourier features of a Gaussian correlation; coherent loss exp(−2k²σ²): Ament 1953",
        "[target.roughness] with rms_m or layer_depth_m",
        lambda scene: scene.target is not None and scene.roughness.sigma_m > 0,
        "surfaces",
    ),
    Effect(
        "multipath",
        "echoes over two places of the target",
        "shooting and bouncing rays: Ling, Chou & Lee 1989; Fresnel at both places",
        PARTS,
        _hides,
        "multipath",
    ),
    Effect(
        "motion",
        "the target moves from tone to tone, and its fingers",
        "Δz = (f/Δf)·Δδ, the motion between two tones as a phase; tremor: Elble & Randall 1978",
        "[target.motion] with an amplitude, a velocity, a rotation or a pose",
        _moves,
        "motion",
    ),
)
RECORDING: tuple[Effect, ...] = (
    Effect(
        "coupling",
        "leakage from transmitters to receivers",
        "a direct wave at the level that the scene gives",
        "[sensor.coupling] with level_db",
        lambda scene: scene.sensor.coupling.level_db is not None,
        "sensor",
    ),
    Effect(
        "clutter",
        "echoes of what stands around the target",
        "physical optics of the room, cut out where the target stands before it",
        "[stand] with reflectivity_db",
        lambda scene: bool(scene.room),
        "surfaces",
    ),
    Effect(
        "channels",
        "gain, phase and delay errors of each antenna",
        "normal errors of the given spread, drawn once per scene",
        "[sensor.channels] with an error",
        lambda scene: any(scene.sensor.channels.model_dump().values()),
        "sensor",
    ),
    Effect(
        "oscillator",
        "phase noise of the common oscillator",
        "range correlation, Budge & Burt 1993",
        "[sensor.oscillator] with level_dbc_hz",
        lambda scene: scene.sensor.oscillator.level_dbc_hz is not None,
        "sensor",
    ),
    Effect(
        "noise",
        "thermal noise of the receivers",
        "σ_z = c/(4πΔf)·σ_φ·A_max/A, its mean magnitude √(2/π)·σ_z",
        "[noise] with phase_noise_rad or snr_db",
        lambda scene: scene.noise.between_tones_rad > 0,
        "sensor",
    ),
    Effect(
        "converter",
        "quantisation and clipping by the converter",
        "white noise of step²/12 per quadrature (Widrow & Kollár 2008)",
        "[sensor.converter] with bits",
        lambda scene: scene.sensor.converter.bits is not None,
        "sensor",
    ),
    Effect(
        "dead",
        "antennas that give nothing",
        "zeros in those channels",
        "[sensor.dead] with tx or rx",
        lambda scene: bool(scene.sensor.dead.tx or scene.sensor.dead.rx),
        "sensor",
    ),
)
EFFECTS = SHAPING + RECORDING


def choose(scene: EchoScene, wanted: Wanted) -> tuple[Choice, ...]:
    """Choose the effects with which a scene is simulated: one row per effect, on or off, in the
    order of application.

    wanted: "auto", or the names of the effects. Raises HandbenchError for a wanted effect that is
    unknown, listed twice, or whose cause the scene lacks.
    """
    rows, names = [], () if wanted == "auto" else check_names(wanted)
    for effect in EFFECTS:
        caused = bool(effect.cause(scene))
        if effect.id in names and not caused:
            raise HandbenchError(
                f"effects: '{effect.id}' needs {effect.needs}; add this to the scene, or leave "
                "the effect out"
            )
        on = caused if wanted == "auto" else effect.id in names
        why = "has a cause" if wanted == "auto" else "listed"
        off = "not listed" if caused else f"needs {effect.needs}"
        rows.append(Choice(effect=effect.id, on=on, why=why if on else off))
    return tuple(rows)


def check_names(names: tuple[str, ...]) -> tuple[str, ...]:
    """Return the names. Raises HandbenchError for one that is no effect or is listed twice."""
    known = [effect.id for effect in EFFECTS]
    for name in names:
        if name not in known:
            raise HandbenchError(f"effects: '{name}' is not an effect; {suggest(name, known)}")
        if names.count(name) > 1:
            raise HandbenchError(f"effects: '{name}' is listed twice; list it once")
    return names
