"""Exact echoes of a few spheres by the T-matrices of treams (Beutel, Fernandez-Corbaton, Rockstuhl,
Comput. Phys. Commun. 297 (2024) 109076), which the tests hold simulations and the series of one
sphere against.

treams 0.4 needs a SciPy below 1.15, so that this runs in an environment of its own:

    python -m venv VENV && VENV/bin/pip install treams "scipy<1.15"
    PYTHONPATH=. VENV/bin/python tests/references/exact/sphere_clusters.py     # writes the .npz
"""

from __future__ import annotations

import time
from pathlib import Path

import numpy as np

SPEED_OF_LIGHT_M_S = 299792458.0
FREQUENCIES_HZ = np.array([79.5e9, 82e9])
SKIN, COAT = 6.4 * (1 - 1.35j), 3.2 - 0.6j  # time e^{+jωt}
SCENES = {  # spheres as centre and radii from inside to outside; permittivities likewise
    "sphere": ([((0.0, 0.0, 0.29), [8e-3])], [SKIN]),
    "coated sphere": ([((0.01, -0.02, 0.29), [7.7e-3, 8e-3])], [SKIN, COAT]),
    "two spheres": ([((-0.011, 0.0, 0.29), [8e-3]), ((0.011, 0.0, 0.29), [8e-3])], [SKIN]),
    "sphere before a larger one": (
        [((0.004, 0.0, 0.265), [5e-3]), ((0.0, 0.0, 0.311), [12e-3])],
        [SKIN],
    ),
}


def antennas_m() -> tuple[np.ndarray, np.ndarray]:
    """A few places [t, 3] and [r, 3] on the sides of a square like the array's."""
    along = np.linspace(-0.07, 0.07, 6)
    tx_m = [(x, y, 0.0) for y in (-0.07, 0.07) for x in along]
    return np.array(tx_m), np.array([(x, y, 0.0) for x in (-0.07, 0.07) for y in along])


def echoes(
    spheres: list,  # type: ignore[type-arg]
    permittivities: list[complex],
    frequency_hz: float,
) -> np.ndarray:
    """Samples [t, r] of dipoles along y, as `tests.references.exact.cylinders` scales them."""
    import treams

    k = 2 * np.pi * frequency_hz / SPEED_OF_LIGHT_M_S
    fillings = [treams.Material(np.conj(e)) for e in permittivities] + [
        treams.Material()
    ]  # its time is e^{−iωt}
    centres_m = np.array([centre for centre, _ in spheres])
    largest = max(radii[-1] for _, radii in spheres) * k
    further = (
        (4.3, 3) if len(spheres) == 1 else (2, 2)
    )  # orders: what is left out is below 1e-8, of clusters 1e-4
    highest = int(np.ceil(largest + further[0] * np.cbrt(largest) + further[1]))
    single = [
        treams.TMatrix.sphere(highest, k, radii, fillings).changepoltype("parity")
        for _, radii in spheres
    ]
    whole = (
        treams.TMatrix.cluster(single, centres_m).interaction.solve()
        if len(spheres) > 1
        else single[0]
    )
    tx_m, rx_m = antennas_m()
    basis = treams.SphericalWaveBasis.default(highest, len(spheres), centres_m)
    field = {"k0": k, "material": treams.Material(), "poltype": "parity"}
    received = np.asarray(treams.efield(rx_m, basis=basis, modetype="singular", **field))[
        :, 1
    ]  # along y
    scattered = np.empty((len(tx_m), len(rx_m)), complex)
    for t, place_m in enumerate(tx_m):
        dipole = treams.SphericalWaveBasis.default(1, 1, [place_m])
        carried = treams.expand((basis, dipole), ("regular", "singular"), **field)
        scattered[t] = received @ (
            np.asarray(whole) @ (np.asarray(carried) @ _waves_of(dipole, place_m, k, field))
        )
    return 1j * SPEED_OF_LIGHT_M_S / frequency_hz * np.conj(scattered)


def _waves_of(  # type: ignore[no-untyped-def]
    dipole,
    place_m: np.ndarray,
    k: float,
    field: dict,  # type: ignore[type-arg]
) -> np.ndarray:
    """Amplitudes of the three electric waves of degree 1 that are the field (1 + ∇∇·/k²)(y
    e^{ikR}/R)."""
    import treams

    away_m = np.array(
        [[0.02, 0.01, 0.03], [-0.01, 0.03, 0.01], [0.01, -0.02, -0.03], [0.0, 0.05, 0.01]]
    )
    r = np.linalg.norm(away_m, axis=1)[:, None]
    unit, y = away_m / r, np.array([0.0, 1.0, 0.0])
    radial = unit * unit[:, 1:2]
    known = (
        np.exp(1j * k * r) / r * (y - radial + (1j * k * r - 1) / (k * r) ** 2 * (y - 3 * radial))
    )
    waves = np.asarray(treams.efield(place_m + away_m, basis=dipole, modetype="singular", **field))
    found, *_ = np.linalg.lstsq(waves.reshape(-1, waves.shape[-1]), known.ravel(), rcond=None)
    assert np.abs(waves @ found - known).max() < 1e-9 * np.abs(known).max()
    return found


if __name__ == "__main__":
    kept = {}
    for name, (spheres, permittivities) in SCENES.items():
        start = time.perf_counter()
        samples = np.array([echoes(spheres, permittivities, f) for f in FREQUENCIES_HZ])
        kept[name.replace(" ", "_")] = samples.astype(np.complex64)
        print(f"{name}: {time.perf_counter() - start:.0f} s", flush=True)
    tx_m, rx_m = antennas_m()
    np.savez_compressed(
        Path(__file__).with_suffix(".npz"),
        frequencies_hz=FREQUENCIES_HZ,
        tx_m=tx_m,
        rx_m=rx_m,
        **kept,
    )
