"""A page with one surface, to turn."""

import numpy as np
from PIL import Image

from handbench.bench.results import Surface
from handbench.reports.figures.layers import shaded
from handbench.reports.page import scene3d
from handbench.reports.page.rendering import image, render


def page(name: str, title: str, surface: Surface) -> str:
    """The page of a height field; HandbenchError where nothing was observed."""
    scene = scene3d.plain(name, title, surface)
    picture = shaded(surface, np.isfinite(surface.z_m))[::-1, ::-1]
    still = image(Image.fromarray(np.round(255 * picture).astype(np.uint8)), f"{title}, seen from the array.", shown=2)
    facts = {"methods": [{"name": title, "title": title}], "shown": title, "scales": scene3d.scales(), "still": still}
    return render("single.html", name=name, scenes=[scene], **facts)
