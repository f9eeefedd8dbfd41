"""Effects that are off cost and change nothing; captures do not depend on the number of workers."""

import numpy as np
import pytest

from handbench.radar.simulation.selection import choose
from handbench.radar.simulation.simulate import simulate_scene
from handbench.support.rays import Rays
from tests.radar.simulation.effects.small_scenes import (
    EVERYTHING,
    bead_scene,
    no_random_numbers,
    simulated,
)

__all__ = ["no_random_numbers"]  # a fixture

RANDOM = ("positions", "motion", "channels", "oscillator", "noise")


def test_what_is_off_draws_no_number_and_casts_no_ray(no_random_numbers, monkeypatch):
    monkeypatch.delattr(Rays, "_tensor")
    simulated(bead_scene(EVERYTHING), "obliquity", "pattern", "coupling", "dead", "converter")


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
        "shadow",
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


def test_frames_and_seeds():
    scene = bead_scene(EVERYTHING)
    rows = choose(scene, "auto")
    once, again = (simulate_scene(scene, rows, frames=2).capture.samples for _ in range(2))
    assert np.array_equal(once, again)
    other = simulate_scene(bead_scene(EVERYTHING, seed=4), rows, frames=2).capture.samples
    assert not np.array_equal(once, other)
