"""Names that differ in their Unicode form only, and names of many bytes, wherever a benchmark or a
capture names something."""

import unicodedata

import pytest

from handbench.support.config import checked_name
from handbench.support.errors import HandbenchError
from handbench.support.files import inside

COMPOSED = unicodedata.normalize("NFC", "Prüfkörper")
TAKEN_APART = unicodedata.normalize("NFD", COMPOSED)


@pytest.mark.parametrize("stored", [COMPOSED, TAKEN_APART])
@pytest.mark.parametrize("asked", [COMPOSED, TAKEN_APART])
def test_a_file_is_found_by_either_form_of_its_name(stored, asked, tmp_path):
    file = tmp_path / stored / f"{stored}.npz"
    file.parent.mkdir()
    file.touch()
    assert inside(tmp_path, f"{asked}/{asked}.npz", "maps") == file.resolve()


def test_the_exact_name_comes_first_and_a_missing_one_stays(tmp_path):
    for name in (COMPOSED, TAKEN_APART):
        (tmp_path / name).touch()
        assert inside(tmp_path, name, "path").name == name
    assert inside(tmp_path, "fehlt-ü", "path") == tmp_path.resolve() / "fehlt-ü"
    with pytest.raises(HandbenchError, match="is outside the folder"):
        inside(tmp_path, f"../{COMPOSED}", "path")


def test_a_name_has_one_form_and_few_bytes():
    assert checked_name(TAKEN_APART) == COMPOSED
    assert checked_name("a" * 80) == "a" * 80
    assert checked_name("\U0001d49c" * 25) == "\U0001d49c" * 25
    with pytest.raises(ValueError, match="is a name of 320 bytes; use at most 100 bytes"):
        checked_name("\U0001d49c" * 80)
