"""Selection of effects: the tolerance is a budget, a list is a list, and what a scene lacks is
said."""

import dataclasses

import numpy as np
import pytest

from handbench.radar.simulation import selection
from handbench.radar.simulation.catalogue import EFFECTS, Effect
from handbench.radar.simulation.causes import Causes
from handbench.radar.simulation.effects.quick_estimate import QuickEstimate
from handbench.radar.simulation.known_effects import DECLARED, IDS
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


def test_what_the_scene_lacks_is_off_and_said(catalogue):
    catalogue(effect("a", 9.0, lacks="[noise] in the scene"), effect("b", 9.0))
    first, second = selection.choose(bead_scene(), "auto", 0.1)
    assert not first.on and first.why == "needs [noise] in the scene" and first.depth_mm is None
    assert second.on


def test_a_list_asks_for_no_estimate_unless_explained(monkeypatch):
    refusing = effect(
        "noise", 0.0, changed={"cost_s": lambda scene: 1 / 0, "apply": lambda echoes: echoes}
    )
    monkeypatch.setattr(selection, "EFFECTS", (refusing,))
    [row] = selection.choose(bead_scene(), ("noise",), 0.1)
    assert row.on and row.depth_mm is None
    with pytest.raises(ZeroDivisionError):
        selection.choose(bead_scene(), ("noise",), 0.1, explain=True)


def test_a_listed_effect_without_its_cause_is_an_error():
    with pytest.raises(HandbenchError, match=r"'noise' needs \[noise\]"):
        selection.choose(bead_scene(), ("noise",), 0.1)


@pytest.mark.parametrize(
    ("names", "message"), [(("nois",), "did you mean 'noise'"), (("noise", "noise"), "twice")]
)
def test_names_are_checked(names, message):
    with pytest.raises(HandbenchError, match=message):
        selection.choose(bead_scene({"noise": {"phase_noise_rad": 0.1}}), names, 0.1)


def test_a_level_of_nothing_is_left_out_of_the_row(catalogue):
    catalogue(effect("a", 0.0, changed={"apply": lambda echoes: echoes}))
    [row] = selection.choose(bead_scene(), "auto", 0.1, explain=True)
    assert row.level_db is None and row.depth_mm == 0 and not row.on


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


def test_every_effect_says_what_it_is():
    assert tuple(effect.id for effect in EFFECTS) == IDS
    assert all(
        about.keys() == {"does", "source"} and all(about.values()) for about in DECLARED.values()
    )


def test_what_takes_the_image_away_is_no_small_change():
    silent = bead_scene({"dead": {"tx": tuple(range(94))}})
    row = next(
        row for row in selection.choose(silent, "auto", 0.1, explain=True) if row.effect == "dead"
    )
    assert row.on and row.pixels_percent >= 100


@pytest.mark.parametrize("tones_hz", [[79.5e9, 82e9], [82e9]])
def test_depths_are_told_between_two_tones_whatever_there_are(tones_hz):
    causes = Causes(positions={"sigma_m": 1e-3})
    tones = {
        "frequencies_hz": np.array(tones_hz),
        "time_s": np.zeros(len(tones_hz)),
        "depth_step_hz": 200e6,
    }
    few = dataclasses.replace(bead_scene(), causes=causes, **tones)
    row = next(
        row for row in selection.choose(few, "auto", 0.1, explain=True) if row.effect == "positions"
    )
    assert row.on and row.depth_mm > 0.1
