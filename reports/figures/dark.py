"""A figure in the colours of a dark page: greys turn around, dark colours get lighter, and the scales of maps stay."""

import numpy as np
from matplotlib.collections import Collection
from matplotlib.colors import to_rgba_array
from matplotlib.figure import Figure
from matplotlib.image import AxesImage
from matplotlib.lines import Line2D
from matplotlib.patches import Patch, PathPatch
from matplotlib.text import Text
from numpy.typing import ArrayLike

PAGE, INK = np.array([0x16, 0x18, 0x1B]) / 255, 0.9  # as in style.css
CONTRAST = 4.5  # of a mark on the page at least (WCAG 2)
COLOURED = {  # what has colours: the properties that hold them
    Text: ("color",),
    Line2D: ("color", "markerfacecolor", "markeredgecolor"),
    Patch: ("facecolor", "edgecolor"),
    Collection: ("facecolor", "edgecolor"),
}


def darken(figure: Figure) -> Figure:
    """The figure itself, each grey and each dark colour in it changed for a dark page."""
    for artist in figure.findobj():
        for name in next((names for kind, names in COLOURED.items() if isinstance(artist, kind)), ()):
            value = getattr(artist, f"get_{name}")()
            colours = np.zeros((0, 4)) if isinstance(value, str) and value == "auto" else to_rgba_array(value)
            if artist.get_alpha() is not None:  # which is applied once more
                colours[:, 3] = colours[:, 3] > 0
            ends = isinstance(artist, PathPatch)  # of a colour bar, which keep their colours
            changed = [dark(colour, lighten=not ends) for colour in colours]
            if changed:
                getattr(artist, f"set_{name}")(changed if isinstance(artist, Collection) else changed[0])
        if isinstance(artist, AxesImage) and (values := artist.get_array()) is not None and values.ndim == 2:  # a map
            artist.set_cmap(artist.cmap.with_extremes(bad=dark(artist.cmap.get_bad())))
    return figure


def dark(colour: ArrayLike, lighten: bool = True) -> tuple[float, float, float, float]:
    """A colour for a dark page: of a grey the one as far from the page, of others, if they are to get lighter, the
    first mixture with white that stands out."""
    *rgb, alpha = to_rgba_array(colour)[0].tolist()
    found = np.array(rgb)
    if np.ptp(found) < 0.02:
        found = INK + found * (PAGE - INK)
    while lighten and np.ptp(rgb) >= 0.02 and luminance(found) + 0.05 < CONTRAST * (luminance(PAGE) + 0.05):
        found += 0.1 * (1 - found)
    red, green, blue = found.tolist()
    return red, green, blue, alpha


def luminance(rgb: np.ndarray) -> float:
    """Relative luminance of an sRGB colour (WCAG 2)."""
    linear = np.where(rgb <= 0.04045, rgb / 12.92, ((rgb + 0.055) / 1.055) ** 2.4)
    return float(linear @ [0.2126, 0.7152, 0.0722])
