"""Selection of effects: the tolerance is a budget, a list is a list, and what a scene lacks is
reported."""

import dataclasses

import pytest

from handbench.radar.simulation import selection
from handbench.radar.simulation.catalogue import Effect
from handbench.radar.simulation.effects.quick_estimate import QuickEstimate
from handbench.radar.simulation.scene import Material
from handbench.support.errors import HandbenchError
from tests.radar.simulation.effects.small_scenes import bead_scene


def effect(name, worst_mm, lacks="", cost_s=1.0, **more):
    def refuse(echoes):
        raise AssertionError("a quick estimate applies nothing")

    values = {"apply": refuse, "cost_s": lambda scene: cost_s} | more.pop("changed", {})
    size = None if worst_mm is None else QuickEstimate(worst_mm, "as the test says", **more)
    return Effect(name, lacks, lambda scene: not lacks, estimate=lambda scene: size, **values)


@pytest.fixture
def catalogue(monkeypatch):
    def install(*effects):
        monkeypatch.setattr(selection, "EFFECTS", effects)

    return install


def on(choices):
    return [choice.effect for choice in choices if choice.on]


def test_what_is_left_out_stays_below_the_tolerance_together(catalogue):
    sizes = {"a": 0.02, "b": 0.025, "c": 0.015, "d": 0.5, "e": 0.03}
    catalogue(*(effect(name, size, factor=3.0) for name, size in sizes.items()))
    choices = selection.choose(bead_scene(), "auto", 0.1)
    # Twice 0.020 + 0.025 fit into 0.1; with 0.015 they would not, though each of them is small
    # enough.
    assert on(choices) == ["c", "d", "e"]
    assert sum(selection.SAFETY * sizes[c.effect] for c in choices if not c.on) <= 0.1
    assert all("about 0.02 mm" in c.why for c in choices if c.effect == "a")


def test_a_quick_estimate_decides_as_far_as_it_is_sure(catalogue):
    catalogue(
        effect("a", 0.03),
        effect("b", 0.03, factor=3.0),
        effect("c", 0.009),
        effect("d", 3.0),
        effect("e", None),
    )
    assert on(selection.choose(bead_scene(), "auto", 0.1)) == ["a", "d", "e"]
    assert on(selection.choose(bead_scene(), "auto", 1e-9)) == ["a", "b", "c", "d", "e"]
    assert on(selection.choose(bead_scene(), "auto", 70.0)) == ["e"]


def test_what_takes_no_time_is_on(catalogue):
    catalogue(effect("clear", 0.001), effect("cheap", 0.001, cost_s=1e-6))
    cheap = selection.choose(bead_scene(), "auto", 0.1)[1]
    assert cheap.on and "of the time" in cheap.why


def test_what_the_scene_lacks_is_off_and_reported(catalogue):
    catalogue(effect("a", 9.0, lacks="[noise] in the scene"), effect("b", 9.0))
    first, second = selection.choose(bead_scene(), "auto", 0.1)
    assert not first.on and first.why == "needs [noise] in the scene" and first.depth_mm is None
    assert second.on


@pytest.mark.parametrize(
    ("names", "message"), [(("nois",), "did you mean 'noise'"), (("noise", "noise"), "twice")]
)
def test_names_are_checked(names, message):
    with pytest.raises(HandbenchError, match=message):
        selection.choose(bead_scene({"noise": {"phase_noise_rad": 0.1}}), names, 0.1)


def test_per_antenna_shadows_contain_those_from_the_centre(catalogue):
    catalogue(effect("shadow_centre", 5.0), effect("shadow_antennas", 2.0))
    choices = selection.choose(bead_scene(), "auto", 0.1)
    assert on(choices) == ["shadow_antennas"] and "contained" in choices[0].why
    catalogue(effect("shadow_centre", 5.0), effect("shadow_antennas", 0.001))
    assert on(selection.choose(bead_scene(), "auto", 0.1)) == ["shadow_centre"]


@pytest.mark.parametrize("kind", ["skin", "plastic"])
def test_how_strongly_a_target_echoes_is_never_left_out(kind):
    body = dataclasses.replace(bead_scene().target, material=Material(kind=kind))
    choices = selection.choose(bead_scene(target=body), "auto", 1e3)
    assert {"obliquity", "skin" if kind == "skin" else "dielectric"} <= set(on(choices))
