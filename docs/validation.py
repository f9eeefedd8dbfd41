"""Make the figure and tables of docs/measurements/validation.md, which compare the simulation with
closed forms: python docs/validation.py OUT.png (from the repository's root)."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes

from handbench.bench.scenes.build import load_scene
from handbench.bench.scenes.echoes import echo_scene
from handbench.bench.scenes.stand import cuboid, plate_box_m
from handbench.radar.data.capture import RadarCapture
from handbench.radar.methods.registry import method
from handbench.radar.simulation.ablation import Ablation
from handbench.radar.simulation.catalogue import CONTAINED, EFFECTS
from handbench.radar.simulation.causes import Causes, Pattern
from handbench.radar.simulation.known_effects import IDS
from handbench.radar.simulation.scene import Body, EchoScene, Material
from handbench.radar.simulation.selection import choose
from handbench.radar.simulation.simulate import simulate_scene
from tests.radar.simulation.effects.closed_forms import (
    phase_errors_rad,
    plate_over_angle,
    power_over_range,
    refined,
    sphere_over_ka,
)

EXACT, OURS, OTHER = "black", "tab:blue", "tab:orange"
TONES_HZ = np.array([79.5e9, 81.8e9, 82.0e9])
BASE = ("obliquity", "shadow_centre")


def db(ratio: np.ndarray) -> np.ndarray:
    """Return a ratio of powers in decibels."""
    return 10 * np.log10(ratio)


def most_db(ratio: np.ndarray) -> float:
    """Return the largest deviation of power ratios from 1, decibels."""
    return float(np.abs(db(ratio)).max())


def draw_sphere(axes: Axes) -> None:
    """Plot the radar cross section of a metal sphere over its size ka, by facets, closed form and
    Mie's series, and print the deviations."""
    ka = np.concatenate([np.linspace(0.2, 10, 200), np.linspace(10, 60, 400)])
    facets, closed, mie = sphere_over_ka(ka)
    axes.plot(ka, db(mie), color=EXACT, label="Mie's series")
    axes.plot(ka, db(closed), color=OTHER, label="physical optics, closed form")
    axes.plot(ka[::8], db(facets)[::8], ".", color=OURS, label="physical optics, facets")
    axes.set(xscale="log", ylim=(-12, 6), xlabel="ka", ylabel="σ / πa² in dB", title="Metal sphere")
    large = ka >= 25
    print(
        f"sphere, ka ≥ 25: facets within {most_db(facets[large]):.2f} dB of πa², Mie "
        f"{most_db(mie[large]):.2f} dB; "
        f"facets within {most_db(facets / closed):.3f} dB of their integral everywhere"
    )
    for low, high in ((1, 2), (2, 5), (5, 10), (10, 20), (20, 30), (30, 60)):
        within = (ka >= low) & (ka <= high)
        print(
            f"  ka {low} to {high}: physical optics within {most_db((facets / mie)[within]):.2f} "
            "dB of Mie"
        )


def draw_plate(axes: Axes) -> None:
    """Plot the scattering pattern of a metal plate over the angle, by facets and in closed form,
    and print the deviations."""
    degrees = np.linspace(0, 60, 481)
    (facets, exact), (even, _) = plate_over_angle(degrees), plate_over_angle(degrees, oblique=False)
    peak = exact.max()
    axes.plot(degrees, db(exact / peak), color=EXACT, label="closed form")
    axes.plot(degrees, db(even / peak), color=OTHER, label="facets that scatter evenly")
    axes.plot(degrees[::3], db(facets / peak)[::3], ".", color=OURS, label="facets")
    axes.set(
        ylim=(-60, 3), xlabel="angle from the normal in degrees", ylabel="σ against its peak in dB"
    )
    axes.set_title("Metal plate of ten wavelengths")
    lobes = exact > 1e-3 * peak
    print(
        f"plate: peak {most_db(facets[:1] / exact[:1]):.1e} dB from 4πA²/λ²; to 30 dB below it, "
        "that is up to "
        f"{degrees[lobes].max():.0f}°: {most_db((facets / exact)[lobes]):.2f} dB, without "
        "obliquity "
        f"{most_db((even / exact)[lobes]):.2f} dB"
    )


def draw_refinement(axes: Axes) -> None:
    """Plot how the error of the echoes falls with the size of the facets, and print the orders of
    convergence."""
    per_wavelength = np.array([2, 4, 8, 16])
    errors = refined(tuple(per_wavelength))
    axes.loglog(1 / per_wavelength, errors, "o-", color=OURS, label="curved sheet")
    axes.loglog(
        1 / per_wavelength, 0.36 / per_wavelength**2, "--", color=EXACT, label="second order"
    )
    axes.set(
        xlabel="edges", ylabel="relative error of the samples", title="Refinement, against λ/32"
    )
    axes.set_xticks([], minor=True)
    axes.set_xticks(1 / per_wavelength, [f"λ/{n}" for n in per_wavelength])
    print(
        "refinement: errors", errors.round(4), "orders", np.log2(errors[:-1] / errors[1:]).round(2)
    )


def draw_range(axes: Axes) -> None:
    """Plot how the received power falls with range for a point and for balls, and print the
    exponents."""
    range_m = np.geomspace(0.15, 9.6, 13)
    powers = power_over_range(range_m)
    for power, name, style in zip(
        powers, ("point", "facets of a ball", "Mie's ball"), ("-", ".", "x"), strict=True
    ):
        level = db(power * range_m**4 / (power * range_m**4)[-1])
        axes.semilogx(
            range_m, level, style, color={"-": EXACT, ".": OURS, "x": OTHER}[style], label=name
        )
    axes.set(
        xlabel="range in m",
        ylabel="power · R⁴ in dB",
        title="Falling with R⁻⁴: a point, a ball of 5 mm",
    )
    orders = -np.diff(np.log2(powers), axis=1) / np.diff(np.log2(range_m))
    print(
        "range: exponents of a point",
        orders[0].round(5)[[0, -1]],
        "of a ball",
        orders[1].round(3)[[0, -1]],
    )


def stand(scene: object, reflectivity_db: float) -> tuple[Body, ...]:
    """Return the back plate of the benchmark's stand as bodies in the radar frame."""
    vertices_m, faces = cuboid(plate_box_m(), 5e-3)
    return (
        Body(scene.radar_from_photo.points(vertices_m), faces, reflectivity_db=reflectivity_db),
    )


def cases(letter: str) -> Iterator[tuple[str, str, EchoScene]]:
    """Yield the cases that are measured on the hand of one letter, each as its name, the effect
    that is switched, and the scene."""
    scene = load_scene(f"bench/run/benchmarks/hand_{letter}.toml")
    causes = Causes(pattern=Pattern(beamwidth_deg=60.0))
    hand = replace(
        echo_scene(scene), frequencies_hz=TONES_HZ, time_s=np.zeros(3), causes=causes, room=()
    )

    def of(material: Material, **changes: object) -> EchoScene:
        return replace(hand, target=replace(hand.target, material=material), **changes)

    yield "obliquity", "obliquity", hand
    yield "pattern of 60°", "pattern", hand
    yield "skin, palm 15 µm", "skin", of(Material(kind="skin", palm_thickness_m=15e-6))
    yield "skin, palm 140 µm", "skin", of(Material(kind="skin"))
    yield "skin, palm 430 µm", "skin", of(Material(kind="skin", palm_thickness_m=430e-6))
    yield "plastic", "dielectric", of(Material(kind="plastic", loss_tangent=0.015))
    yield "foam hand", "dielectric", of(Material(kind="foam"))
    for level_db in (-10.0, -30.0):
        yield (
            f"back plate of {level_db:g} dB",
            "clutter",
            of(Material(), room=stand(scene, level_db)),
        )


def calibration_target() -> tuple[str, str, EchoScene]:
    """Return the case that is measured on the calibration target, balls in foam: its name, the
    effect that is switched, and the scene."""
    scene = echo_scene(load_scene("bench/run/benchmarks/target.toml"))
    scene = replace(scene, frequencies_hz=TONES_HZ, time_s=np.zeros(3), room=())
    return "foam of the balls", "dielectric", scene


def measured_mm(scene: EchoScene, effect: str) -> tuple[float, float]:
    """Return mean and median of the absolute change, mm, that an effect causes in the depth map of
    3-FSK, over the pixels that have a depth both with and without it."""
    fsk = method("3fsk")
    config, depths = fsk.configure({}, "docs/validation.py"), []
    base = tuple(
        name for name in BASE if not EFFECTS[IDS.index(name)].missing(scene)
    )  # foam is not opaque
    changed = tuple(name for name in base if name != effect) if effect in base else (*base, effect)
    for effects in (base, changed):
        capture = simulate_scene(scene, choose(scene, effects)).capture
        depths.append(
            fsk.run(RadarCapture(capture.samples, TONES_HZ, scene.array), config, 0).depth.z_m
        )
    change_mm = 1e3 * np.abs(depths[1] - depths[0])
    return float(np.nanmean(change_mm)), float(np.nanmedian(change_mm))


def main(picture: Path) -> None:
    """Draw the figure to the file `picture`, and print the tables."""
    figure, axes = plt.subplots(2, 2, figsize=(11, 8), layout="constrained")
    for panel, draw in zip(
        axes.flat, (draw_sphere, draw_plate, draw_refinement, draw_range), strict=True
    ):
        draw(panel)
        panel.legend()
        panel.grid(alpha=0.3)
    figure.savefig(picture, dpi=90)
    for tolerance, spreading in ((None, True), (1e-5, False)):
        print(
            f"phase, tolerance {tolerance}: {phase_errors_rad(tolerance, spreading).max():.1e} "
            "rad at most"
        )
    print("hand | case | estimate mm | measured mm (median)")
    every = [(letter, case) for letter in "fb" for case in cases(letter)]
    for letter, (name, effect, scene) in (*every, ("target", calibration_target())):
        there = [
            known for known in EFFECTS if known.id in (*BASE, effect) and not known.missing(scene)
        ]
        estimate = Ablation(scene, there, CONTAINED).change({effect})["3fsk"]
        mean_mm, median_mm = measured_mm(scene, effect)
        print(
            f"{letter} | {name} | {estimate.depth_mm:.3f} | {mean_mm:.3f} ({median_mm:.3f})",
            flush=True,
        )


if __name__ == "__main__":
    main(Path(sys.argv[1]))
