"""The documentation's code runs, its commands are known, its links lead somewhere, its figures say
what makes them; and the conventions that no other test holds."""

from __future__ import annotations

import argparse
import contextlib
import importlib.util
import io
import re
import shlex
import tomllib
from collections.abc import Iterator
from importlib import import_module
from pathlib import Path

import h5py
import numpy as np
import pytest

from handbench.bench.datasets.dataset import open_capture
from handbench.bench.datasets.mapping import Mapping
from handbench.bench.evaluation.depth_errors import error_map
from handbench.bench.run.benchmark_file import BenchFile
from handbench.bench.scenes.scene_file import HandTarget, Mount, SceneFile
from handbench.calibration.transforms import load_transform
from handbench.cli import main
from handbench.groundtruth.cameras.cameras import Camera
from handbench.radar.data.arrays import qar50
from handbench.radar.data.depthmap import amplitude_db
from handbench.radar.data.grid import PixelGrid
from handbench.radar.methods.registry import method

ROOT = Path(__file__).parents[1]
DOCS = ROOT / "docs"
PAGES = [ROOT / "README.md", ROOT / "CONTRIBUTING.md", *sorted(DOCS.rglob("*.md"))]
FENCE = re.compile(r"^```(\w*)\n(.*?)^```", re.DOTALL | re.MULTILINE)
SMALL = {
    "x": {"start_m": -0.02, "stop_m": 0.02, "step_m": 0.001},
    "y": {"start_m": -0.03, "stop_m": 0.01, "step_m": 0.001},
}

every_page = pytest.mark.parametrize(
    "page", PAGES, ids=lambda page: page.relative_to(ROOT).as_posix()
)


def blocks(page: Path, language: str) -> list[str]:
    """The page's fenced blocks in a language ("" for none)."""
    return [code for found, code in FENCE.findall(page.read_text("utf-8")) if found == language]


def spans(page: Path) -> list[str]:
    """The page's inline code, each on one line."""
    return [
        " ".join(span.split())
        for span in re.findall(r"`([^`]+)`", FENCE.sub("", page.read_text("utf-8")))
    ]


# Code


def test_the_functions_of_the_equations_exist():
    for name in spans(DOCS / "methods.md"):
        if re.match(r"handbench\.radar\.\w+\.", name):
            module, _, function = name.rpartition(".")
            assert callable(getattr(import_module(module), function, None)), name


@pytest.fixture
def own_data(tmp_path, monkeypatch):
    """What the programs of the page write, in a folder of their own."""
    monkeypatch.chdir(tmp_path)
    for code in blocks(DOCS / "own_data.md", "python"):
        exec(compile(code, "docs/own_data.md", "exec"), {"__name__": "page"})
    return tmp_path


@pytest.mark.parametrize(
    (
        "capture",
        "point_m",
        "near_m",
    ),  # two arrays see it at an angle, and 3-FSK takes the path's slope as 2
    [
        ("mine", (0.010, -0.020, 0.300), 1e-4),
        ("scan", (0.0, 0.0, 0.300), 1e-4),
        ("two", (0.010, 0.0, 0.300), 1e-3),
    ],
)
def test_echoes_written_with_h5py_alone_are_imaged_where_they_came_from(
    own_data, capture, point_m, near_m
):
    chosen, echoes = method("3fsk"), open_capture(own_data / capture).echoes()
    depth = chosen.run(echoes, chosen.configure(SMALL, "test"), 0).depth
    row, column = np.unravel_index(depth.amplitude_db.argmax(), depth.z_m.shape)
    assert (depth.x_m[column], depth.y_m[row]) == pytest.approx(point_m[:2], abs=1e-9)
    assert depth.z_m[row, column] == pytest.approx(point_m[2], abs=near_m)


def toml_of(page: str, marked: str) -> str:
    """The page's one TOML block that holds a text."""
    [code] = [code for code in blocks(DOCS / page, "toml") if marked in code]
    return code


def test_the_smallest_mapping_reads_what_matlab_writes(tmp_path):
    (tmp_path / "mapping.toml").write_text(
        toml_of("own_data.md", 'file = "hand.mat"'), encoding="utf-8"
    )
    Mapping.model_validate(tomllib.loads((tmp_path / "mapping.toml").read_text("utf-8")))
    random = np.random.default_rng(0)
    xr = random.standard_normal((3, 2, 4)) + 1j * random.standard_normal(
        (3, 2, 4)
    )  # [rx, tx, frequency]
    stored = np.empty(xr.T.shape, [("real", "f8"), ("imag", "f8")])
    stored["real"], stored["imag"] = xr.T.real, xr.T.imag
    with h5py.File(tmp_path / "hand.mat", "w") as file:
        file["xr"], file["f"] = stored, np.linspace(79, 82, 4)[:, None]
        file["tx"], file["rx"] = np.arange(6.0).reshape(2, 3).T, np.arange(9.0).reshape(3, 3).T
    echoes = open_capture(tmp_path).echoes()
    np.testing.assert_allclose(echoes.samples[0], xr.transpose(2, 1, 0), rtol=1e-6)
    np.testing.assert_allclose(
        echoes.aperture.tx_m, 1e-3 * np.array([(0, 1, 2), (-3, 4, 5)]), atol=1e-15
    )


def test_the_smallest_transforms_are_read(tmp_path):
    texts = [block for block in blocks(DOCS / "own_data.md", "json") if '"matrix"' in block]
    expected = ((-0.1, 0.2, 0.3), (0.1, 0.2, 0.1))  # the second is the identity
    for text, moved_m in zip(texts, expected, strict=True):
        (tmp_path / "t.json").write_text(text, encoding="utf-8")
        transform = load_transform(tmp_path / "t.json").require("photo", "radar", "page")
        assert transform.points(np.array([0.1, 0.2, 0.1])) == pytest.approx(moved_m)


def test_scenes_and_benchmarks_of_the_first_pages_are_valid():
    SceneFile.model_validate(tomllib.loads(toml_of("tutorial.md", "[target]")))
    first = toml_of("tutorial.md", 'name = "first"')
    more = ("config = {", "[tradeoff]")
    texts = [first + toml_of("tutorial.md", part) for part in more]
    texts.append(toml_of("own_data.md", "[calibration]"))
    second, swept, own = (BenchFile.model_validate(tomllib.loads(text)) for text in texts)
    assert method("3fsk").configure(second.method[-1].config, "page").f3_hz == 72e9
    assert swept.tradeoff is not None and len(own.capture) == 2
    given = tomllib.loads(toml_of("own_data.md", "[methods.3fsk]"))["methods"]["3fsk"]
    assert method("3fsk").configure(given, "page").ladder_hz == (81.0e9, 80.8e9, 78.5e9)


# Commands


def quoted_commands(page: Path) -> Iterator[tuple[str, bool]]:
    """Every `handbench …` of a page, and whether it is whole: a line to type, without what stands
    for more."""
    for code in blocks(page, ""):
        for line in code.replace("\\\n", " ").splitlines():
            if line.startswith("handbench "):
                yield line, not re.search(r"[\[\]…]|\w\|\w", line.split("#")[0])
    yield from ((span, False) for span in spans(page) if span.startswith("handbench "))


def problem(command: str, whole: bool) -> str | None:
    """What the parser does not know of a command; of a whole one, also what it misses."""
    _, *words = shlex.split(command.replace("[", " ").replace("]", " "), comments=True)
    chosen, names = main.parser(), words.copy()
    while known := [a for a in chosen._actions if isinstance(a, argparse._SubParsersAction)]:
        if not names or names[0] in ("COMMAND", "NAME") or names[0].startswith("-"):
            break
        if names[0] not in known[0].choices:
            return f"no command {names[0]}"
        chosen = known[0].choices[names.pop(0)]
    for word in words:
        if re.match(r"--?[a-z]", word) and word.split("=")[0] not in chosen._option_string_actions:
            return f"{chosen.prog} has no {word}"
    if not whole:
        return None
    errors = io.StringIO()
    try:
        with contextlib.redirect_stderr(errors):
            main.parser().parse_args(words)
    except SystemExit:
        return errors.getvalue().splitlines()[-1]
    return None


@every_page
def test_commands_are_known(page):
    """Those of handbench, modules, scripts and targets of the Makefile."""
    assert [(c, found) for c, whole in quoted_commands(page) if (found := problem(c, whole))] == []
    text, makefile = page.read_text("utf-8"), (ROOT / "Makefile").read_text("utf-8")
    modules = re.findall(r"python -m ((?:handbench|tests|docs)[\w.]*)", text)
    assert [m for m in modules if importlib.util.find_spec(m.rstrip(".")) is None] == []
    scripts = re.findall(r"python ((?:docs|tests|bench)/[\w/]+\.py)", text)
    assert [script for script in scripts if not (ROOT / script).is_file()] == []
    typed = "\n".join([*blocks(page, ""), *spans(page)])
    targets = re.findall(r"^make ([a-z-]+)", typed, re.MULTILINE)
    assert [t for t in targets if not re.search(rf"^{t}:", makefile, re.MULTILINE)] == []


# Links and figures


@every_page
def test_links_lead_to_files_and_headings(page):
    for target in re.findall(r"\]\(([^)\s]+)\)", FENCE.sub("", page.read_text("utf-8"))):
        file, _, heading = target.partition("#")
        there = page.parent / file if file else page
        assert "://" in target or there.exists(), target
        assert "://" in target or not heading or heading in headings(there), target


def headings(page: Path) -> set[str]:
    """The anchors of a page's headings, as GitHub makes them."""
    lines = re.findall(r"^#+ (.+)$", FENCE.sub("", page.read_text("utf-8")), re.MULTILINE)
    return {re.sub(r"[^\w\- ]", "", line.lower()).replace(" ", "-") for line in lines}


@every_page
def test_every_figure_says_what_makes_it(page):
    """A command, which `test_commands_are_known` looks up, or the version that made it."""
    _, *parts = re.split(r"!\[[^\]]*\]\([^)]+\)", page.read_text("utf-8"))
    for after in parts:
        assert re.search(
            r"figures? (?:is|are) made by(?:\s*```\n|[^`]*`)(?:python|make|handbench) |"
            r"figure was made with version 0\.2's [^,]+, commit c54b71c",
            after,
        ), after[:200]


# Conventions


def test_the_tests_of_the_conventions_exist():
    text = (DOCS / "conventions.md").read_text("utf-8")
    for file, test in re.findall(r"`(tests/[\w/]+\.py)::(\w+)`", text):
        assert f"def {test}(" in (ROOT / file).read_text("utf-8"), test


def test_radar_x_points_left():
    """Whoever looks along z with y up has z × y to the right; and x = y × z."""
    x, y, z = np.eye(3)
    right = np.cross(z, y)
    assert x @ right == -1
    np.testing.assert_array_equal(np.cross(y, z), x)
    assert (qar50().tx_m[:, 2] == 0).all() and (qar50().rx_m[:, 2] == 0).all()


def test_an_unturned_target_has_the_radars_axes():
    moved = HandTarget(
        kind="hand", pose="F", distance_m=0.3, offset_m=(0.01, -0.02)
    ).radar_from_target()
    np.testing.assert_allclose(moved.points(np.eye(3)), np.eye(3) + (0.01, -0.02, 0.3), atol=1e-15)


def test_the_board_faces_the_radar():
    """Unturned, the print's x points to the right of who looks at it from the radar, y up, z
    towards the radar."""
    radar_from_photo = Mount(rotation_deg=(0, 0, 0)).radar_from_photo()
    np.testing.assert_allclose(radar_from_photo.rotation, np.diag([-1, 1, -1]), atol=1e-15)
    assert np.linalg.det(Mount().radar_from_photo().rotation) == pytest.approx(1)


def test_a_camera_looks_along_z():
    """A point to the right and below of the optical axis falls right and below of the picture's
    middle."""
    camera = Camera(
        name="a",
        width=300,
        height=200,
        model="PINHOLE",
        params=(100, 100, 150, 100),
        R=np.eye(3).tolist(),
        t=(0, 0, 0),
    )
    np.testing.assert_allclose(
        camera.project(np.array([[0.0, 0.0, 1.0], [0.1, 0.2, 1.0]])), [(150, 100), (160, 120)]
    )


def test_an_error_behind_the_reference_is_positive():
    x_m = y_m = np.arange(3) * 1e-3
    errors = error_map(
        x_m, y_m, np.full((3, 3), 0.302), np.full((3, 3), 0.300), np.zeros((3, 3)), None
    )
    assert errors.error_m == pytest.approx(2e-3)


def test_images_are_stored_rows_upwards():
    points_m = PixelGrid(np.array([-0.01, 0.0, 0.01]), np.array([-0.02, 0.02])).points_m(0.3)
    assert points_m.shape == (2, 3, 3)
    assert points_m[0, 0].tolist() == [-0.01, -0.02, 0.3]
    assert points_m[1, 0].tolist() == [-0.01, 0.02, 0.3]


def test_decibels_are_of_power():
    assert amplitude_db(np.array([0.1, 1.0, 10.0])).tolist() == [-40, -20, 0]
