"""The places of the antennas on TI's boards.

Sources: antenna_geometry.c in TI's mmWave SDK 3.6 and radar toolbox; of the cascade, module_param.m
(TI_Cascade_TX_position_azi, …) and cascade_MIMO_signalProcessing.m of TI's mmWave Studio.
"""

from pathlib import Path
from typing import Any

import numpy as np

from handbench.bench.datasets.ti_profile import ChirpProfile
from handbench.radar.data.arrays import SPEED_OF_LIGHT_M_S, load_positions
from handbench.support.caller import option
from handbench.support.errors import HandbenchError

# The antennas of boards in units of (to the left, down), transmitters and then receivers, and the
# unit in metres: gAntDef_* and gAntennaSpacing of antenna_geometry.c in TI's SDK and radar toolbox.
# TI's x points right and z up, and its angles take the beat's phase, which grows with the path, to
# rise with the index towards +x and +z: so indices count to the left and down (TX2 of the standard
# boards is the upper one). AWR1843BOOST has no unit there: TI takes half a wavelength of the chirp.
STANDARD = ((0, 1), (2, 0), (4, 1)), ((0, 0), (1, 0), (2, 0), (3, 0))
AOP = ((0, 0), (2, 2), (0, 2)), ((1, 1), (1, 0), (0, 1), (0, 0))
# Indices of the cascade, in half a wavelength of 76.8 GHz, count to the right and up: TI's
# cascade_MIMO_signalProcessing.m plots its angles, taken in the same way, with both signs reversed.
CASCADE_TX = (11, 6), (10, 4), (9, 1), *((right, 0) for right in (32, 28, 24, 20, 16, 12, 8, 4, 0))
CASCADE_RX = [(first + k, 0) for first in (11, 50, 46, 0) for k in range(4)]
CASCADE = tuple([(-right, -up) for right, up in side] for side in (CASCADE_TX, CASCADE_RX))
BOARDS: dict[str, Any] = {
    "IWR6843ISK": (*STANDARD, 2.5e-3),
    "IWR6843AOP": (*AOP, 2.5e-3),
    "AWR1843BOOST": (*STANDARD, None),
    "MMWCAS-RF-EVM": (*CASCADE, SPEED_OF_LIGHT_M_S / 2 / 76.8e9),
}
# receivers fed from the other side: antPhaseRot of TI's people tracking, with this geometry
SIGNS = {"IWR6843AOP": (-1, 1, -1, 1)}


def antennas(
    source: Path, profile: ChirpProfile, transmitters: np.ndarray
) -> tuple[dict[str, np.ndarray], np.ndarray | None]:
    """Return the positions [n, 3] in metres of the antennas that were on, under the keys "tx_m" and
    "rx_m", and their gains [tx, rx] (None: all 1).

    transmitters: numbers of the transmitters that were on. Positions are from tx_m.csv and
    rx_m.csv, which list all antennas by number, or else from the profile's board. Raises
    HandbenchError if neither gives them.
    """
    used = {"tx_m": transmitters - 1, "rx_m": np.array(profile.receivers) - 1}
    signs: tuple[int, ...] | None = None
    if any((source / f"{name}.csv").exists() for name in used):
        tables = {name: load_positions(source / f"{name}.csv") for name in used}
    elif profile.board is not None:
        *both, unit_m = BOARDS[profile.board]
        unit_m = unit_m or SPEED_OF_LIGHT_M_S / profile.tones_hz()[[0, -1]].sum()
        tables = {
            name: unit_m * np.array([(left, -down, 0) for left, down in places])
            for name, places in zip(used, both, strict=True)
        }
        middle_m = sum(table.mean(axis=0) for table in tables.values()) / 2
        tables = {name: table - middle_m for name, table in tables.items()}
        signs = SIGNS.get(profile.board)
    else:
        raise HandbenchError(
            f"{source}: nothing gives the positions of the antennas; add tx_m.csv and rx_m.csv "
            f"(x_m,y_m,z_m), or {option('--set board=…', 'board')} with one of {', '.join(BOARDS)}"
        )
    for name, index in used.items():
        if index.max() >= (there := len(tables[name])):
            asked = f"the profile uses antenna {index.max() + 1}"
            raise HandbenchError(
                f"{source}: {asked}, but {name} has only {there} positions; add the others"
            )
    gains = np.tile(signs, (len(transmitters), 1))[:, used["rx_m"]] if signs else None
    return {name: tables[name][index] for name, index in used.items()}, gains
