"""Methods from elsewhere: packages with an entry point, good and bad ones."""

import re
import sys
import tomllib
from pathlib import Path

import numpy as np
import pytest

from handbench.cli.main import main
from handbench.radar.data.arrays import qar50
from handbench.radar.data.capture import RadarCapture
from handbench.radar.methods import registry
from handbench.radar.methods.registry import METHODS, method, methods, register, source_key
from handbench.radar.simulation.forward import Scatterers, simulate
from handbench.support.config import Config
from handbench.support.errors import HandbenchError
from handbench.support.files import content_hash

ROOT = Path(__file__).parents[3]
PAGE = (ROOT / "docs" / "methods.md").read_text("utf-8")
CODE, PROJECT = (
    re.findall(rf"```{language}\n(.*?)```", PAGE, re.DOTALL)[0] for language in ("python", "toml")
)
ENTRY = "[handbench.methods]\n{} = {}\n"


@pytest.fixture
def site(tmp_path, monkeypatch) -> Path:
    """A folder of installed packages; plug-ins are looked for anew, and forgotten afterwards."""
    method("2fsk")
    before, loaded = dict(METHODS), set(sys.modules)
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.setattr(registry, "_begun", set())
    monkeypatch.setattr(registry, "BROKEN", {})
    monkeypatch.setattr(sys, "dont_write_bytecode", True)
    yield tmp_path
    METHODS.clear()
    METHODS.update(before)
    for name in set(sys.modules) - loaded:
        del sys.modules[name]


def install(
    site: Path, name: str, entry_points: str, version="0.1", requires=(), **modules: str
) -> None:
    """What pip leaves of a package: its modules, and a folder that says what it is."""
    about = site / f"{name.replace('-', '_')}-{version}.dist-info"
    about.mkdir()
    lines = [
        f"Name: {name}",
        f"Version: {version}",
        *(f"Requires-Dist: {line}" for line in requires),
    ]
    (about / "METADATA").write_text("\n".join(["Metadata-Version: 2.1", *lines, ""]))
    (about / "entry_points.txt").write_text(entry_points)
    for module, code in modules.items():
        (site / f"{module}.py").write_text(code)


def install_page(site: Path, code: str = CODE) -> None:
    project = tomllib.loads(PROJECT)["project"]
    [(name, module)] = project["entry-points"]["handbench.methods"].items()
    install(site, project["name"], ENTRY.format(name, module), project["version"], project["dependencies"],
            **{module: code})  # fmt: skip


def test_the_package_of_the_page_adds_its_method(site, capsys):
    assert len([line for line in CODE.splitlines() if line]) <= 10
    install_page(site)
    found = method("wide2fsk")
    assert found.distribution == "wide-methods" and found.configure({}, "").f2_hz == 81e9
    assert method("2fsk").distribution is None
    frequencies_hz = np.array([82e9, 81e9])
    point = Scatterers(np.array([[0.0, 0.0, 0.30]]), np.ones(1))
    capture = RadarCapture(simulate(point, frequencies_hz, qar50())[None], frequencies_hz, qar50())
    axis = {"start_m": -0.002, "stop_m": 0.002, "step_m": 0.001}
    depth = found.run(capture, found.configure({"x": axis, "y": axis}, ""), 0).depth
    assert depth.method == "wide2fsk"
    assert abs(depth.z_m[2, 2] - 0.30) < 5e-4  # without noise, at the first z_e
    assert main(["list"]) == 0
    listed = capsys.readouterr().out
    section = listed[listed.index("wide2fsk") :]
    assert all(
        part in section
        for part in ("source: this page", "plug-in: wide-methods 0.1", "f2_hz = 81000000000.0")
    )


@pytest.mark.parametrize(
    ("code", "reason"),
    [
        ("import no_such_library", "ModuleNotFoundError: No module named 'no_such_library'"),
        ("def f(:", "SyntaxError: "),
        ("raise SystemExit(3)", "SystemExit: 3"),
        ("raise RuntimeError('two\\nlines')", "RuntimeError: two lines"),
        ("", "bad registers no method"),
        (CODE.replace("wide2fsk", "3fsk"), "method '3fsk' is registered twice, first by handbench"),
        (CODE.replace("wide2fsk", "../3fsk"), "cannot name a file"),
        (
            CODE.replace("wide2fsk", "ours") + CODE.replace("wide2fsk", "2fsk"),
            "method '2fsk' is registered twice",
        ),
        (
            CODE.replace("f2_hz: float = 81.0e9", "steps: int"),
            "method 'wide2fsk': defaults: key 'steps' is missing",
        ),
        (
            CODE.replace('source="this page"', 'base="2fks"'),
            "is a variant of '2fks'; did you mean '2fsk'?",
        ),
    ],
)
def test_a_broken_plug_in_is_named_in_one_line_and_harms_nobody(site, capsys, code, reason):
    install_page(site)
    install(site, "bad-methods", ENTRY.format("bad", "bad"), bad=code)
    before = {id: m.run for id, m in METHODS.items()}
    assert {
        m.id: m.run for m in methods() if m.id != "wide2fsk"
    } == before  # nothing of it is left, and all else works
    assert method("wide2fsk").distribution == "wide-methods"
    [line] = capsys.readouterr().err.splitlines()
    assert line.startswith("plug-in bad of bad-methods: left out: ") and reason in line
    assert main(["list"]) == 0
    assert f"bad of bad-methods: {line.partition('left out: ')[2]}" in capsys.readouterr().out
    with pytest.raises(
        HandbenchError, match=r"unknown id 'ours'.*could not be loaded: bad of bad-methods"
    ):
        method("ours")


def test_a_plug_in_for_version_0_2_learns_the_new_name_of_its_import(site, monkeypatch):
    elsewhere = [
        folder for folder in sys.path if Path(folder or ".").resolve() != ROOT
    ]  # as where it is installed
    monkeypatch.setattr(sys, "path", elsewhere)
    install(
        site,
        "old-methods",
        ENTRY.format("old", "old"),
        old=CODE.replace("handbench.radar", "radar"),
    )
    assert "wide2fsk" not in {m.id for m in methods()}
    [reason] = registry.BROKEN.values()
    assert reason.startswith(
        "imports radar.methods.registry, which is handbench.radar.methods.registry since version"
    )


def test_an_entry_point_to_nothing_is_named(site, capsys):
    install(
        site, "bad-methods", ENTRY.format("bad", "bad:missing") + "worse = bad worse\n", bad=CODE
    )
    assert "wide2fsk" not in {m.id for m in methods()}
    assert [line.split(":")[0] for line in capsys.readouterr().err.splitlines()] == [
        "plug-in bad of bad-methods",
        "plug-in worse of bad-methods",
    ]


def test_of_two_plug_ins_with_one_id_the_first_by_name_stays(site):
    install_page(site)
    install(site, "another", ENTRY.format("a", "another"), another=CODE)
    assert method("wide2fsk").distribution == "another"
    assert "first by another" in registry.BROKEN["wide of wide-methods"]


def test_a_plug_in_may_use_other_methods_while_it_is_imported(site):
    install_page(
        site,
        CODE + "\nfrom handbench.radar.methods.registry import method\nassert method('2fsk')\n",
    )
    assert method("wide2fsk") and not registry.BROKEN


def test_a_changed_plug_in_has_another_key(site):
    """Its module, another module of its package, its version, the version of what it requires: each
    counts."""
    (site / "wide").mkdir()
    (site / "wide" / "__init__.py").write_text(CODE)
    (site / "wide" / "helper.py").write_text("a = 1")
    requires = ["numpy>=1", "no-such-library; extra == 'gpu'"]
    install(site, "wide-methods", ENTRY.format("wide", "wide"), requires=requires)

    def key() -> str:
        source_key.cache_clear()
        return content_hash(*source_key(method("wide2fsk")))

    seen = [key(), key()]
    assert seen[0] == seen[1]
    assert source_key(method("wide2fsk"))[0] == "wide-methods 0.1"
    assert source_key(method("wide2fsk"))[1:3] == (
        "no-such-library none",
        f"numpy {np.__version__}",
    )
    (site / "wide" / "helper.py").write_text("a = 2")
    seen.append(key())
    (site / "wide" / "__init__.py").write_text(CODE + "#")
    seen.append(key())
    about = site / "wide_methods-0.1.dist-info"
    (about / "METADATA").write_text(
        (about / "METADATA").read_text().replace("Version: 0.1", "Version: 0.2")
    )
    seen.append(key())
    assert len(set(seen[1:])) == 4
    (site / "wide" / "__pycache__").mkdir()
    (site / "wide" / "__pycache__" / "helper.pyc").write_text(
        "what Python leaves there is no code of its"
    )
    assert key() == seen[-1]


def test_built_in_methods_have_their_file_s_key_and_code_without_a_file_has_none():
    assert (
        source_key(method("2fsk")) == source_key(method("3fsk"))
        and len(source_key(method("2fsk"))) == 1
    )
    try:
        exec("def run(capture, config, frame): ...", typed := {})
        register("typed", Config, "typed at a prompt")(typed["run"])
        with pytest.raises(HandbenchError, match="'typed': its code is in no file"):
            source_key(method("typed"))
    finally:
        METHODS.pop("typed", None)
