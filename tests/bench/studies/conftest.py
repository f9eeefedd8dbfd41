"""Studies as their users run them: from the command line to their files."""

import json

import pytest


@pytest.fixture
def ran(tmp_path, monkeypatch):
    """A function that runs a study's script with some words: what its JSON file holds."""

    def run(script, *words):
        out = tmp_path / "found" / "out.json"
        monkeypatch.setattr("sys.argv", [script.__name__, *words, "-o", str(out)])
        script.main()
        assert out.with_suffix(".csv").is_file()
        return json.loads(out.read_text())

    return run
