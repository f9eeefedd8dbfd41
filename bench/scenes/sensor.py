"""Sensor of the camera: exposure, photon and read noise, white balance, 8-bit sRGB."""

import numpy as np

from bench.scenes.scene_file import Photos

NOISE, EXPOSURE, WHITE_BALANCE, MOTION = 3, 4, 5, 6  # each effect draws from a generator of its own


def generator(seed: int, effect: int, number: int) -> np.random.Generator:
    """Random numbers of one effect in the photograph `number`."""
    return np.random.default_rng([seed, effect, number])


def develop(radiance: np.ndarray, photos: Photos, seed: int, number: int) -> np.ndarray:
    """Radiance [height, width, 3], 1 at white, to 8-bit sRGB [height, width, 3]. The sensor clips at its full well;
    the gains of the white balance come after that."""
    exposed = exposure(photos.exposure_spread, generator(seed, EXPOSURE, number)) * radiance
    raw = np.minimum(_noisy(exposed, photos, generator(seed, NOISE, number)), 1)
    return _srgb(raw * white_balance(photos.white_balance_spread, generator(seed, WHITE_BALANCE, number)))


def exposure(spread: float, random: np.random.Generator) -> float:
    """Factor on the light; spread: its standard deviation in stops."""
    return float(2 ** (spread * random.standard_normal()))


def white_balance(spread: float, random: np.random.Generator) -> np.ndarray:
    """Gains [3] of red, green and blue; spread: standard deviation of red and blue against green, in stops. The
    smallest is 1, as in raw converters: what is clipped stays white."""
    red, blue = spread * random.standard_normal(2)
    gains = 2 ** np.array([red, 0.0, blue])
    return (gains / gains.min()).astype(np.float32)


def _noisy(radiance: np.ndarray, photos: Photos, random: np.random.Generator) -> np.ndarray:
    """Photon and read noise."""
    electrons = np.maximum(radiance, 0) * photos.full_well_e
    spread = np.sqrt(electrons + photos.read_noise_e**2)
    return (electrons + spread * random.standard_normal(radiance.shape, dtype=np.float32)) / photos.full_well_e


def _srgb(linear: np.ndarray) -> np.ndarray:
    """8-bit sRGB (IEC 61966-2-1)."""
    linear = np.clip(linear, 0, 1)
    tone = np.where(linear < 0.0031308, 12.92 * linear, 1.055 * linear ** (1 / 2.4) - 0.055)
    return np.round(255 * tone).astype(np.uint8)
