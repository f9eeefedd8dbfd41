"""Methods from elsewhere: packages with an entry point, good and bad ones."""

import re
import sys
import tomllib
from pathlib import Path

import numpy as np
import pytest

from handbench.cli.main import main
from handbench.radar.methods import registry
from handbench.radar.methods.registry import METHODS, method, methods, source_key
from handbench.support.errors import HandbenchError
from handbench.support.files import content_hash
from tests.radar.simulated_points import point_capture

ROOT = Path(__file__).parents[3]
_, PAGE = (ROOT / "docs" / "python.md").read_text("utf-8").split("## A method of your own")
CODE, PROJECT = (
    re.findall(rf"```{language}\n(.*?)```", PAGE, re.DOTALL)[0] for language in ("python", "toml")
)
ENTRY = "[handbench.methods]\n{} = {}\n"


@pytest.fixture
def site(tmp_path, monkeypatch) -> Path:
    """A folder of installed packages; plug-ins are looked for anew, and forgotten afterwards."""
    method("2fsk")
    before = dict(METHODS)
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.setattr(registry, "_begun", set())
    monkeypatch.setattr(registry, "BROKEN", {})
    monkeypatch.setattr(sys, "dont_write_bytecode", True)
    yield tmp_path
    METHODS.clear()
    METHODS.update(before)
    for name, module in list(sys.modules.items()):
        if (getattr(module, "__file__", None) or "").startswith(str(tmp_path)):
            del sys.modules[name]


def install(
    site: Path, name: str, entry_points: str, version="0.1", requires=(), **modules: str
) -> None:
    """What pip leaves of a package: its modules, and a folder that says what it is."""
    about = site / f"{name.replace('-', '_')}-{version}.dist-info"
    about.mkdir()
    lines = ["Metadata-Version: 2.1", f"Name: {name}", f"Version: {version}"]
    lines += [f"Requires-Dist: {line}" for line in requires]
    (about / "METADATA").write_text("\n".join([*lines, ""]))
    (about / "entry_points.txt").write_text(entry_points)
    for module, code in modules.items():
        (site / f"{module}.py").write_text(code)


def install_page(site: Path) -> None:
    project = tomllib.loads(PROJECT)["project"]
    [(name, module)] = project["entry-points"]["handbench.methods"].items()
    about = project["name"], ENTRY.format(name, module), project["version"], project["dependencies"]
    install(site, *about, **{module: CODE})


def test_the_package_of_the_page_adds_its_method(site, capsys):
    install_page(site)
    found = method("wide2fsk")
    assert found.distribution == "wide-methods" and found.configure({}, "").f2_hz == 81e9
    assert method("2fsk").distribution is None
    capture = point_capture((0.0, 0.0, 0.3), np.array([82e9, 81e9]))
    axis = {"start_m": -0.002, "stop_m": 0.002, "step_m": 0.001}
    depth = found.run(capture, found.configure({"x": axis, "y": axis}, ""), 0).depth
    assert depth.method == "wide2fsk"
    assert abs(depth.z_m[2, 2] - 0.30) < 5e-4  # without noise, at the first z_e
    assert main(["list", "methods"]) == 0
    [line] = [each for each in capsys.readouterr().out.splitlines() if "wide2fsk" in each]
    assert line.endswith("wide-methods")


BROKEN = {
    "exit": ("raise SystemExit(3)", "SystemExit: 3"),
    "lines": ("raise RuntimeError('two\\nlines')", "RuntimeError: two lines"),
    "nothing": ("", "bad registers no method"),
    "name": (CODE.replace("wide2fsk", "../3fsk"), "cannot be the name of a file"),
    "twice": (
        CODE.replace("wide2fsk", "ours") + CODE.replace("wide2fsk", "2fsk"),
        "method '2fsk': is registered twice, first by handbench",
    ),
    "defaults": (
        CODE.replace("f2_hz: float = 81.0e9", "steps: int"),
        "method 'wide2fsk': defaults: key 'steps' is missing",
    ),
    "base": (
        CODE.replace('source="this page"', 'base="2fks"'),
        "its base '2fks' is unknown; did you mean '2fsk'?",
    ),
}


@pytest.mark.parametrize(("code", "reason"), BROKEN.values(), ids=BROKEN)
def test_a_broken_plug_in_is_named_in_one_line_and_harms_nobody(
    site, capsys, monkeypatch, code, reason
):
    elsewhere = [folder for folder in sys.path if Path(folder or ".").resolve() != ROOT]
    monkeypatch.setattr(sys, "path", elsewhere)  # as where it is installed
    install_page(site)
    install(site, "bad-methods", ENTRY.format("bad", "bad"), bad=code)
    before = set(METHODS)
    assert {m.id for m in methods()} == before | {"wide2fsk"}  # nothing of it is left
    [line] = capsys.readouterr().err.splitlines()
    assert (
        line.startswith("plug-in bad of bad-methods: was not loaded and is left out: ")
        and reason in line
    )
    words = r"unknown id 'ours'.*could not be loaded: bad of bad-methods"
    with pytest.raises(HandbenchError, match=words):
        method("ours")


def test_a_changed_plug_in_has_another_key(site):
    """Its module, another module of its package, its version, the version of what it requires: each
    counts; what Python leaves there does not. A built-in method has its file's."""
    package, about = site / "wide", site / "wide_methods-0.1.dist-info" / "METADATA"
    package.mkdir()
    (package / "__init__.py").write_text(CODE)
    (package / "helper.py").write_text("a = 1")
    requires = ["numpy>=1", "no-such-library; extra == 'gpu'"]
    install(site, "wide-methods", ENTRY.format("wide", "wide"), requires=requires)

    def key() -> str:
        source_key.cache_clear()
        return content_hash(*source_key(method("wide2fsk")))

    seen = [key()]
    known = "wide-methods 0.1", "no-such-library none", f"numpy {np.__version__}"
    assert source_key(method("wide2fsk"))[:3] == known
    for file in (package / "helper.py", package / "__init__.py", about):
        file.write_text(file.read_text().replace("0.1", "0.2") + "#")
        seen.append(key())
    assert len(set(seen)) == 4
    (package / "__pycache__").mkdir()
    (package / "__pycache__" / "helper.pyc").write_text("what Python leaves there")
    assert key() == seen[-1]
    assert source_key(method("2fsk")) == source_key(method("3fsk"))
