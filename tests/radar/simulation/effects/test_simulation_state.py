"""Effects that are off cost and change nothing; captures do not depend on the number of workers."""

import numpy as np
import pytest

from handbench.radar.simulation import scene_echoes
from handbench.radar.simulation.catalogue import EFFECTS
from handbench.radar.simulation.selection import choose
from handbench.radar.simulation.simulate import Stopwatch, simulate_scene
from handbench.support.rays import Rays
from tests.radar.simulation.effects.small_scenes import bead_scene, simulated

EVERYTHING = {
    "noise": {"phase_noise_rad": 0.05},
    "oscillator": {"level_dbc_hz": -80.0},
    "motion": {"amplitude_m": 1e-4},
    "pattern": {"beamwidth_deg": 60.0},
    "coupling": {"level_db": -20.0},
    "positions": {"sigma_m": 2e-5},
    "channels": {"gain_db": 0.5, "phase_rad": 0.1},
    "dead": {"tx": (1,)},
    "converter": {"bits": 12},
}
RANDOM = ("positions", "motion", "channels", "oscillator", "noise")
CASTING = ("shadow_centre", "shadow_antennas", "multipath")


@pytest.fixture
def no_random_numbers(monkeypatch):
    """Refuses what scenes draw from; the estimates' own numbers, always the same, come from
    elsewhere."""

    def refuse(*arguments, **named):
        raise AssertionError("drew a random number")

    monkeypatch.setattr(np.random, "default_rng", refuse)
    monkeypatch.setattr(np.random, "SeedSequence", refuse)


def test_what_is_off_draws_no_number_and_casts_no_ray(no_random_numbers):
    before = Rays.cast
    simulated(bead_scene(EVERYTHING), "obliquity", "pattern", "coupling", "dead", "converter")
    assert Rays.cast == before


def test_quick_estimates_draw_none_of_the_scene_s_numbers_and_cast_no_ray(no_random_numbers):
    before = Rays.cast
    scene = bead_scene(EVERYTHING)
    estimates = [effect.estimate(scene) for effect in EFFECTS if not effect.missing(scene)]
    assert sum(estimate is not None for estimate in estimates) >= 3
    assert Rays.cast == before


@pytest.mark.parametrize("name", CASTING)
def test_what_casts_rays_does_so_when_it_is_on(name):
    before = Rays.cast
    simulated(bead_scene(), name)
    assert Rays.cast > before


@pytest.mark.parametrize("name", RANDOM)
def test_what_draws_numbers_does_so_when_it_is_on(name, no_random_numbers):
    with pytest.raises(AssertionError, match="drew a random number"):
        simulated(bead_scene(EVERYTHING), name)


@pytest.mark.parametrize("other", [name for name in RANDOM if name != "noise"])
def test_no_effect_changes_anothers_draws(other, monkeypatch):
    drawn = {}
    original = np.random.SeedSequence

    def record(entropy, *arguments, **named):
        drawn.setdefault(tuple(entropy), 0)
        drawn[tuple(entropy)] += 1
        return original(entropy, *arguments, **named)

    monkeypatch.setattr(np.random, "SeedSequence", record)
    simulated(bead_scene(EVERYTHING), "noise")
    alone = set(drawn)
    drawn.clear()
    simulated(bead_scene(EVERYTHING), "noise", other)
    assert alone < set(drawn) and max(drawn.values()) == 1


def test_a_shot_is_the_same_for_any_number_of_workers(monkeypatch):
    names = (
        "positions",
        "obliquity",
        "shadow_antennas",
        "multipath",
        "motion",
        "channels",
        "oscillator",
        "noise",
    )
    found = []
    for workers in ("1", "2", "3"):
        monkeypatch.setenv("HANDBENCH_WORKERS", workers)
        found.append(simulated(bead_scene(EVERYTHING), *names, frames=2).capture.samples)
    assert np.array_equal(found[0], found[1]) and np.array_equal(found[0], found[2])


def test_rows_say_what_each_effect_took():
    rows = simulated(bead_scene(EVERYTHING), "noise", "dead").rows
    assert [row.effect for row in rows if row.on] == [scene_echoes.TARGET, "noise", "dead"]
    assert all((row.seconds is not None) == row.on for row in rows)


def test_time_inside_another_counts_once(monkeypatch):
    ticks = iter([0.0, 1.0, 5.0, 7.0])  # outer begins, inner begins and ends, outer ends
    monkeypatch.setattr(
        "handbench.radar.simulation.simulate.time.perf_counter", lambda: next(ticks)
    )
    watch = Stopwatch()
    with watch.timed("outer"), watch.timed("inner"):
        pass
    assert watch.seconds == {"inner": 4.0, "outer": 3.0}


def test_frames_and_seeds():
    scene = bead_scene(EVERYTHING)
    rows = choose(scene, "auto", 0.1)
    once, again = (simulate_scene(scene, rows, frames=2).capture.samples for _ in range(2))
    assert np.array_equal(once, again)
    other = simulate_scene(bead_scene(EVERYTHING, seed=4), rows, frames=2).capture.samples
    assert not np.array_equal(once, other)
