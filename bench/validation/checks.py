"""The list of all checks. Each has the kind of thing that it applies to, the name of a mistake, a
condition for it, and advice for the user.

The facts about a thing (an array, a depth map, a photograph of a board, …) are a dictionary of
plain values, which conditions and advice (format strings) use by name. Files that cannot be read
need no check, since their readers report why. capture_warnings.py and mistakes.py compute facts
that need images; benchmark_problems.py checks that captures, methods and depth maps fit together.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from handbench.bench.datasets.native import FAR_M, MESH, PHOTOS, TARGET
from handbench.radar.data.depthmap import FLAGGED

if TYPE_CHECKING:
    from handbench.bench.results.result_folder import Result
    from handbench.calibration.transforms import Transform
    from handbench.groundtruth.mesh.surface import Surface
    from handbench.radar.data.capture import RadarCapture
    from handbench.radar.data.depthmap import DepthMap

LOWEST_HZ = 3e8  # of radars whose arrays have a size in metres
HIGH_HZ = 1e12  # more is likelier a wrong unit
# of an array's extent; beyond, it is most likely in another unit
MOST_WAVELENGTHS, LEAST_WAVELENGTHS = (1000.0, 0.25)
FEWEST_PLACES = 4  # antennas that may span less than LEAST_WAVELENGTHS
FLAT = 0.05  # of an array's largest extent: thinner, it is a plane
SMALL_M = 5e-3  # a surface that small is likelier in another unit
OPEN_PERCENT = 10  # of a surface's edges at its rim
# of an image that nothing near a hand fills, if it is that wide and high
CROWDED_PERCENT, WIDE_M = (50, 0.1)
FAR_PERCENT = 10  # of the distance: a mean error that large is none of a surface in sight
FARTHEST_MM = 50.0  # mean error of what may still be an image
NEAREST_M, FARTHEST_M = (0.05, 2.0)  # of cameras that photograph a hand, from the board next to it
SEEN_FROM = "{photo} was taken {distance_m:.2g} m from the board, as the board's description has it"
# of conjugated echoes; conjugating what is right cost 7 dB or more on random scenes of ten kinds
SHARPER_DB = 3.0
CURE = "check that the surface is in metres and in the radar frame with `handbench inspect`"

Facts = Mapping[str, Any]


class Check(NamedTuple):
    """A check of one kind of thing.

    of: the kind, such as "array"; name: name of the mistake; found: function from the facts (name →
    value) to whether the advice applies; advice: format string, which the facts fill in; fails:
    whether a run would fail because of the mistake.
    """

    of: str
    name: str
    found: Callable[[Facts], Any]
    advice: str
    fails: bool = False


CHECKS = (
    Check(
        "array",
        "frequencies in GHz",
        lambda f: f["highest_hz"] < 1e3,
        "its highest frequency is only {highest_hz:g} Hz; if the frequencies are in gigahertz, "
        "multiply them by 1e9",
    ),
    Check(
        "array",
        "frequencies in MHz",
        lambda f: 1e3 <= f["highest_hz"] < 1e6,
        "its highest frequency is only {highest_hz:g} Hz; if the frequencies are in megahertz, "
        "multiply them by 1e6",
    ),
    Check(
        "array",
        "positions in millimetres",
        lambda f: f["far_m"] > FAR_M,
        "an antenna is {far_m:g} m from the origin; if the positions are in millimetres, "
        "multiply them by 1e-3",
    ),
    Check(
        "array",
        "frequencies a thousand times too high",
        lambda f: f["waves"] > MOST_WAVELENGTHS and f["highest_hz"] > HIGH_HZ,
        "its highest frequency is {highest_hz:g} Hz; if that is a thousand times too high, "
        "multiply the frequencies by 1e-3",
    ),
    Check(
        "array",
        "positions in centimetres",
        lambda f: f["waves"] > MOST_WAVELENGTHS and f["highest_hz"] <= HIGH_HZ,
        f"the antennas span {{extent_m:g}} m, over {MOST_WAVELENGTHS:g} wavelengths; if their "
        "positions are in centimetres, multiply them by 1e-2; if in inches, by 0.0254",
    ),
    Check(
        "array",
        "frequencies in kHz, positions in kilometres",
        lambda f: 0 < f["waves"] < LEAST_WAVELENGTHS and f["places"] > FEWEST_PLACES,
        "the antennas span {extent_m:g} m, only {waves:.2g} wavelengths at {highest_hz:g} Hz; if "
        "the {too_small}, multiply them by 1e3",
    ),
    Check(
        "array",
        "plane along z",
        lambda f: f["looks_along"],
        "the array is in the plane of {beside} and z, so it faces {looks_along}, but z must "
        "point away from the array; exchange the axes",
    ),
    Check(
        "pairs",
        "pairs missing",
        lambda f: f["missing"],
        "{missing} of its {pairs} pairs of antennas were not measured; images leave these out",
    ),
    Check(
        "surface",
        "size",
        lambda f: not SMALL_M <= f["longest_m"] <= FAR_M,
        "is {longest_m:.3g} m long; if it is not in metres, convert it with `handbench "
        "groundtruth --unit`",
    ),
    Check(
        "mesh",
        "inside out",
        lambda f: f["rim_percent"] == 0 and f["volume"] < 0,
        "its triangles are inside out; reverse the order of the vertices of each triangle",
    ),
    Check(
        "mesh",
        "holes",
        lambda f: f["rim_percent"] > OPEN_PERCENT,
        "{rim_percent:.0f} % of its edges belong to only one triangle; fill its holes, or merge "
        "equal vertices",
    ),
    Check(
        "transform",
        "offset in millimetres",
        lambda f: f["offset_m"] > FAR_M,
        "it moves points by {offset_m:g} m; check that its translation is in metres",
    ),
    Check(
        "transform",
        "scale",
        lambda f: not 0.5 < abs(f["scale"]) < 2,
        "its scale is {scale:g}; check that both frames are in metres",
    ),
    Check(
        "transform",
        "inverse",
        lambda f: f["behind"],
        "it moves all of mesh.ply behind the radar; check that it is not the inverse transform",
    ),
    Check(
        "depth map",
        "nothing focuses",
        lambda f: f["on_target_percent"] > CROWDED_PERCENT and f["wide_m"] >= WIDE_M,
        "{on_target_percent:.0f} % of the pixels of the image have a depth, so it may be out of "
        "focus; check the capture with `handbench inspect`",
    ),
    Check(
        "depth map",
        "depths in millimetres",
        lambda f: f["far_m"] > FAR_M,
        f"depths are more than {FAR_M:g} m; if they are in millimetres, multiply them by 1e-3",
    ),
    Check(
        "depth map",
        "pixels likelier wrong than right",
        lambda f: f["flagged_percent"] > CROWDED_PERCENT,
        "{flagged_percent:.0f} % of the pixels with a depth are more likely wrong than right "
        f"(p_gross > {FLAGGED:g})",
    ),
    Check(
        "figures",
        "nothing before the surface",
        lambda f: f["mean_mm"] is None,
        f"no pixel of the depth map is in front of or behind the surface; {CURE}",
    ),
    Check(
        "figures",
        "relative accuracy",
        lambda f: f["mean_mm"] is not None and not 0 <= f["accuracy"] <= 100,
        f"the relative accuracy is {{accuracy:.4g}} %, outside 0 to 100 %; {CURE}",
    ),
    Check(
        "figures",
        "mean error beyond the box",
        lambda f: (
            f["mean_mm"] is not None and 0 <= f["accuracy"] <= 100 and f["mean_mm"] > f["box_mm"]
        ),
        "the mean error, {mean_mm:.3g} mm, is larger than the depth box, {box_mm:.3g} mm; "
        f"{CURE}",
    ),
    Check(
        "figures",
        "mean error next to the distance",
        lambda f: (
            f["mean_mm"] is not None
            and 0 <= f["accuracy"] < 100 - FAR_PERCENT
            and f["mean_mm"] <= f["box_mm"]
        ),
        f"the mean error, {{mean_mm:.3g}} mm, is more than {FAR_PERCENT} % of the distance; {CURE}",
    ),
    Check(
        "result",
        "a figure that no image has",
        lambda f: (
            (f["metric"].startswith("relative_") and not 0 <= f["value"] <= 100)
            or (f["metric"] == "mae_mm" and f["value"] > FARTHEST_MM)
        ),
        "{method}: {title} is {value:.4g} {unit}; check the captures with `handbench inspect`",
    ),
    Check(
        "length",
        "in millimetres",
        lambda f: f["far_m"] > f["most_m"],
        "{name} {far_m:g} m; check that it is in metres, not millimetres",
    ),
    Check(
        "board",
        "in millimetres",
        lambda f: f["far_m"] > FAR_M,
        "a corner is {far_m:g} m away; check that the positions are in metres, not millimetres",
    ),
    Check(
        "box",
        "ends exchanged",
        lambda f: any(
            low >= high for low, high in zip(f["box_m"][:3], f["box_m"][3:], strict=True)
        ),
        "box_m is {box_m}; expected xmin, ymin, zmin, then the larger xmax, ymax, zmax",
        fails=True,
    ),
    Check(
        "capture",
        "target without description",
        lambda f: f["kind"] == "target" and TARGET in f["lacks"],
        f"is a capture of the calibration target without {TARGET}; copy the description of the "
        "target to the capture",
        fails=True,
    ),
    Check(
        "reference",
        "missing",
        lambda f: not f["known"],
        f"has no surface to compare depths with; add {PHOTOS} or {MESH}",
        fails=True,
    ),
    Check(
        "photographs",
        "no scale",
        lambda f: not f["board"] and f["posed"] < 3,
        "nothing gives the scale of the photographs; add board.toml, or poses (R, t) to "
        "cameras.json",
        fails=True,
    ),
    Check(
        "photograph of a board",
        "board too large",
        lambda f: f["distance_m"] >= FARTHEST_M,
        f"{SEEN_FROM}; if that is ten times too far, measure a marker and give its side in metres",
    ),
    Check(
        "photograph of a board",
        "board too small",
        lambda f: f["distance_m"] <= NEAREST_M,
        f"{SEEN_FROM}; if that is ten times too near, measure a marker and give its side in metres",
    ),
    Check(
        "echoes",
        "conjugated",
        lambda f: f["sharper_db"] >= SHARPER_DB,
        "the image of the conjugated echoes is {sharper_db:.0f} dB sharper; if the target is "
        'within {within_m:.2g} m, conjugate the samples (sign = "+" in a mapping.toml, time = '
        '"-jwt" in echoes.h5)',
    ),
)


def warnings_of(kind: str, facts: Facts) -> Iterator[str]:
    """Yield the advice of every check that applies to one thing. kind: what the thing is, as in
    `Check.of`; facts: name → value."""
    return (
        check.advice.format(**facts) for check in CHECKS if check.of == kind and check.found(facts)
    )


def echo_warnings(capture: RadarCapture) -> Iterator[str]:
    """Yield warnings about a capture's echoes: about its antennas, tones and antenna pairs."""
    from handbench.radar.methods.evidence import antenna_problems, tone_problems

    yield from array_warnings(capture)
    for frame, samples in enumerate(capture.samples):
        tones = tone_problems(samples, capture.frequencies_hz) if samples.any() else ()
        if found := [*tones, *antenna_problems(capture, frame)]:
            yield from (f"frame {frame}: {problem}" for problem in found)
            break  # further frames are likely to have the same
    yield from pair_warnings(capture)


def array_warnings(capture: RadarCapture) -> Iterator[str]:
    """Yield warnings about the antennas' positions and the tones of a capture, such as wrong
    units."""
    places = places_m(capture)
    tones_hz = capture.frequencies_hz
    highest_hz = float(tones_hz.max())
    far_m = float(np.abs(places).max())
    extent_m = np.ptp(places, axis=0)
    flat = int(extent_m.argmin())
    upright = flat != 2 and extent_m[flat] < FLAT * extent_m.max() < extent_m[2]
    sized = highest_hz >= 1e6 and far_m <= FAR_M  # else no wavelength is known
    facts = {
        "highest_hz": highest_hz,
        "far_m": far_m,
        "extent_m": float(extent_m.max()),
        "waves": float(extent_m.max()) * highest_hz / capture.wave_speed_m_s if sized else np.nan,
        "places": len(places),
        "too_small": "frequencies are in kHz" if highest_hz < LOWEST_HZ else "positions are in km",
        "looks_along": "xy"[flat] if upright else "",
        "beside": "xy"[1 - flat] if upright else "",
    }
    return warnings_of("array", facts)


def pair_warnings(capture: RadarCapture) -> Iterator[str]:
    """Yield a warning if some antenna pairs of a capture were not measured."""
    measured = getattr(capture.aperture, "measured", None)
    missing, pairs = (0, 0) if measured is None else (int((~measured).sum()), measured.size)
    return warnings_of("pairs", {"missing": missing, "pairs": pairs})


def surface_warnings(surface: Surface) -> Iterator[str]:
    """Yield a warning if a surface seems to be in a wrong unit."""
    used_m = surface.vertices_m[np.unique(surface.faces)]
    return warnings_of("surface", {"longest_m": float(np.ptp(used_m, axis=0).max())})


def mesh_warnings(surface: Surface) -> Iterator[str]:
    """Yield a warning if a surface is closed and inside out, or if many of its edges are at a rim
    (holes)."""
    edges = np.sort(surface.faces[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1)
    a, b, c = np.moveaxis(surface.vertices_m[surface.faces], 1, 0)
    facts = {
        "rim_percent": 100 * float((np.unique(edges, axis=0, return_counts=True)[1] == 1).mean()),
        "volume": float(np.einsum("ij,ij->", a, np.cross(b, c))),  # six times the volume
    }
    return warnings_of("mesh", facts)


def transform_warnings(transform: Transform, mesh: Surface | None) -> Iterator[str]:
    """Yield warnings about the transform radar_from_photo: about its translation, its scale, and
    whether it moves the mesh behind the radar."""
    facts = {
        "offset_m": float(np.abs(transform.matrix[:3, 3]).max()),
        "scale": transform.scale,
        "behind": mesh is not None and bool((transform.points(mesh.vertices_m)[:, 2] <= 0).all()),
    }
    return warnings_of("transform", facts)


def map_warnings(depth: DepthMap) -> Iterator[str]:
    """Yield warnings about a depth map that need no reference: too many pixels are on target,
    depths are implausibly far away, or most pixels are flagged."""
    facts = {
        "on_target_percent": 100 * float(np.isfinite(depth.z_m).mean()),
        "wide_m": min(np.ptp(depth.x_m), np.ptp(depth.y_m)),
        "far_m": float(np.nanmax(np.abs(depth.z_m), initial=0.0)),
        "flagged_percent": 100 * (flagged_share(depth) or 0.0),
    }
    return warnings_of("depth map", facts)


def figure_warnings(depth: DepthMap, values: Mapping[str, float | int | None]) -> Iterator[str]:
    """Yield warnings about implausible scores of a depth map against a surface. values: metric →
    value."""
    mean_mm, accuracy, z = (
        values["mae_mm"],
        values["relative_accuracy_percent"],
        depth.config.get("z"),
    )
    box = (
        z
        if isinstance(z, dict) and {"start_m", "stop_m"} <= z.keys()
        else {"start_m": 0.0, "stop_m": np.inf}
    )
    facts = {
        "mean_mm": None if accuracy is None else mean_mm,
        "accuracy": accuracy,
        "box_mm": 1e3 * (box["stop_m"] - box["start_m"]),
    }
    return warnings_of("figures", facts)


def result_warnings(result: Result) -> Iterator[str]:
    """Yield warnings about the result of a run: those that the run recorded, its failures, and
    values of metrics that are implausible for any image."""
    for capture, texts in result.about.facts.get("doubts", {}).items():
        yield from (f"{capture}: {text}" for text in texts)
    yield from (failure.line for failure in result.about.failures)
    lines: Iterator[Any] = iter(result.table.itertuples(index=False, name="Line"))
    for row in lines:
        title, unit = result.title(row.metric), row.unit
        facts = {
            "metric": row.metric,
            "method": row.method,
            "title": title,
            "value": row.value,
            "unit": unit,
        }
        yield from warnings_of("result", facts)


def flagged_share(depth: DepthMap) -> float | None:
    """Return the share of the pixels on target whose p_gross exceeds FLAGGED; None if the map has
    no p_gross or no pixels on target."""
    seen = np.isfinite(depth.z_m)
    return (
        None
        if depth.p_gross is None or not seen.any()
        else float((depth.p_gross[seen] > FLAGGED).mean())
    )


def on_target(depth: DepthMap) -> str:
    """Return a text with the number of pixels of a depth map that have a depth, and the shares of
    them that its method doubts and that are likelier wrong than right."""
    seen, wrong = np.isfinite(depth.z_m), flagged_share(depth)
    shares = []
    if depth.wrapped is not None and seen.any():
        shares.append(f"{100 * depth.wrapped[seen].mean():.1f} % of them in doubt (wrapped)")
    if wrong is not None:
        shares.append(f"{100 * wrong:.1f} % likelier wrong than right (p_gross > {FLAGGED:g})")
    return ", ".join([f"{np.count_nonzero(seen)} pixels on target", *shares])


def places_m(capture: RadarCapture) -> np.ndarray:
    """Return the positions [n, 3] of all antennas of a capture, metres."""
    return np.concatenate([leg.position_m for leg in capture.aperture.legs])
