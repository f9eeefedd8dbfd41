"""Import of raw captures of TI's millimetre-wave radars as capture folders. The samples were
recorded by a DCA1000 board (adc_data.bin) or by a cascade; the chirp profile is in the radar's .cfg
or in a .json."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from scipy.signal import hilbert

from handbench.bench.datasets.method_tables import method_tables
from handbench.bench.datasets.native import save_echoes_folder
from handbench.bench.datasets.ti_boards import antennas
from handbench.bench.datasets.ti_profile import WHAT
from handbench.bench.datasets.ti_samples import read_raw
from handbench.radar.data.recording import Recording
from handbench.support.files import require_folder


def import_ti_raw(
    source: str | Path, folder: str | Path, settings: Mapping[str, Any] | None = None
) -> None:
    """Convert the .bin files in a folder, in the order of the numbers in their names, to a capture
    folder.

    settings: fields of `ChirpProfile` that replace those in the folder's .cfg or .json. Raises
    HandbenchError if the files do not agree with the profile.
    """
    source = require_folder(source, WHAT)
    profile, beat = read_raw(source, settings or {})
    if profile.real:
        beat = hilbert(beat, axis=-1)  # of a real mixer's two signs, that of complex sampling
    transmitters = np.unique(profile.transmitters)
    # The phase of I + jQ grows with the path, by 2πfτ at the chirp's frequency f (SPYY005, "The
    # fundamentals of millimeter wave radar sensors": 4πd/λ; echoes of boards have positive beat
    # frequencies): conjugated, it is exp(−j2πf·path/c) but for πSτ², 0.01 rad at 1 m.
    order = np.argsort(profile.transmitters, kind="stable").reshape(len(transmitters), -1)
    samples = beat[:, :, order].conj().transpose(0, 1, 3, 5, 2, 4)
    samples = samples.reshape(len(samples), -1, *samples.shape[3:])  # [frame, sweep, f, tx, rx]
    places_m, gains = antennas(source, profile, transmitters)
    about = {"source": " ".join(filter(None, ("TI raw capture", profile.board)))}
    recording = Recording(samples, profile.tones_hz(), places_m, None, gains, profile.sweeps, about)
    capture = recording.capture()
    facts = {"kind": "other", "methods": method_tables(capture)}
    facts["unknown"] = ("range_offset",)  # of the board and its cables
    save_echoes_folder(folder, capture, facts | about)
