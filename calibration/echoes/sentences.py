"""What self-calibration found, in sentences for the user."""

from collections.abc import Iterator

import numpy as np

from handbench.calibration.echoes.estimate import (
    BLURRED_DB,
    LEAST_EXPLAINED,
    MOST_PHASE_RAD,
    Estimate,
    SelfCalibration,
)

FORMS = {  # words of each estimate, its factor and its unit
    "range_offset_m": ("range offset", 1e3, "mm"),
    "scan_step_x": ("scan step along x", 1.0, "times the recorded one"),
    "scan_step_y": ("scan step along y", 1.0, "times the recorded one"),
    "first_depth_m": ("depth of the strongest point", 1e3, "mm"),
}


def sentences(found: SelfCalibration) -> Iterator[str]:
    """Yield a sentence on each estimate with its standard deviation, on what the echoes cannot tell
    apart, on what the points explain, and on how much sharper the image became."""
    for name, estimate in found.estimates.items():
        yield _sentence(name, estimate)
    if found.gain_sigma is not None:
        yield _gains(found)
    if "range_offset_m" in found.estimates:
        yield (
            f"the range offset is known up to multiples of {1e3 * found.period_m:.0f} mm, after "
            "which the tones' echoes repeat"
        )
    for one, other in found.inseparable:
        words = FORMS[one][0], FORMS[other][0]
        yield f"these echoes hardly tell {words[0]} and {words[1]} apart: their errors go together"
    points = "1 point explains" if found.points == 1 else f"{found.points} points explain"
    share = f"{points} {100 * found.explained:.0f} % of the echoes' power"
    if found.noise_left:
        yield f"{share}; the rest is noise"
    elif found.explained >= LEAST_EXPLAINED:
        yield f"{share}; the rest is further echoes, by which the standard deviations are larger"
    else:
        yield (
            f"{share}; the rest is further echoes, so that points say too little: use a capture of "
            "a few small bright targets (balls, corners), not of a flat or long one"
        )
    if found.sharper_db > -BLURRED_DB:
        yield f"the strongest echo is {found.sharper_db:+.1f} dB higher with these estimates"
    else:
        yield (
            f"the strongest echo is {-found.sharper_db:.1f} dB lower with these estimates, so they "
            "are not taken"
        )


def _sentence(name: str, estimate: Estimate) -> str:
    words, factor, unit = FORMS[name]
    digits = 1 if unit == "mm" else 4
    value, sigma, half_width = (
        f"{factor * number:.{digits}f}"
        for number in (estimate.value, estimate.sigma, estimate.half_width)
    )
    if not estimate.determined:
        return (
            f"{words}: not determined; {value} {unit} would have a 95 % interval of ±{half_width}"
        )
    return f"{words}: {value} {unit}, standard deviation {sigma}, 95 % interval ±{half_width}"


def _gains(found: SelfCalibration) -> str:
    log_gains = np.concatenate(found.log_gains)
    sigma_deg = np.degrees(found.gain_sigma or 0.0)
    if (found.gain_sigma or 0.0) > MOST_PHASE_RAD:
        return f"gains: not determined; the standard deviation of a phase would be {sigma_deg:.0f}°"
    level_db = 20 / np.log(10) * log_gains.real.std()
    phase_deg = np.degrees(log_gains.imag.std())
    return (
        f"{len(log_gains)} gains: levels differ by {level_db:.1f} dB and phases by "
        f"{phase_deg:.0f}° (standard deviations), known to {sigma_deg:.1f}°, but for a common gain "
        "and a shift of the target"
    )
