"""Hints for mistyped names, and for lengths and frequencies in another unit."""

import pytest

from handbench.bench.scenes.scene_file import SceneFile
from handbench.radar.methods.registry import method
from handbench.support.config import parse, suggest
from handbench.support.errors import HandbenchError


@pytest.mark.parametrize(
    ("name", "hint"),
    [("FSK3", "'3fsk'"), ("Broadbnad", "'broadband'"), ("xyz", "2fsk, 3fsk, broadband")],
)
def test_a_similar_name_is_suggested_or_all_are_listed(name, hint):
    assert hint in suggest(name, ["3fsk", "broadband", "2fsk"])


@pytest.mark.parametrize(
    ("section", "given", "key", "unit"),
    [
        ("target", {"radius_m": 30}, "target.radius_m", "millimetres"),
        ("target", {"offset_m": [0, -300]}, "target.offset_m.1", "millimetres"),
        ("sensor", {"tones_hz": [82.0]}, "sensor.tones_hz.0", "gigahertz"),
        (
            "sensor",
            {"sweep": [{"start_hz": 72e3, "stop_hz": 82e9, "count": 2}]},
            "start_hz",
            "megahertz",
        ),
    ],
)
def test_a_value_in_another_unit_is_asked_about(section, given, key, unit):
    scene = {"version": 1, "name": "s", "target": {"kind": "sphere"}}
    scene[section] = scene.get(section, {}) | given
    with pytest.raises(HandbenchError, match=f"{key}.*{unit}"):
        parse(SceneFile, scene, "s.toml")


def test_a_tone_of_a_method_in_gigahertz_is_asked_about():
    with pytest.raises(HandbenchError, match=r"f1_hz.*gigahertz"):
        parse(method("3fsk").config, {"f1_hz": 82}, "--set")
