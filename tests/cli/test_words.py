"""Hints for mistyped names."""

import pytest

from handbench.support.config import suggest


@pytest.mark.parametrize(
    ("name", "hint"),
    [("FSK3", "'3fsk'"), ("Broadbnad", "'broadband'"), ("xyz", "2fsk, 3fsk, broadband")],
)
def test_a_similar_name_is_suggested_or_all_are_listed(name, hint):
    assert hint in suggest(name, ["3fsk", "broadband", "2fsk"])
