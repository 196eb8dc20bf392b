"""Read the shape `sdfgrid`, a surface in a grid of signed distances, as triangles."""

from __future__ import annotations

from wrt.errors import InputError
from wrt.io.mitsuba.fields.isosurface import MOST_CELLS, isosurface
from wrt.io.mitsuba.plugin import Plugin
from wrt.io.volume.read import read_volume
from wrt.scene.mesh import Mesh

_PARTS = 4
"""Parts of a cell along each axis; fewer for large grids."""


def distance_grid(plugin: Plugin) -> Mesh:
    """Return the surface of an `sdfgrid` in its unit cube.

    Raises:
        InputError: when its file cannot be read, or has no surface.
    """
    path = plugin.file()
    smooth = plugin.choice("normals", "smooth", "smooth", "analytic") == "smooth"
    plugin.ignore("watertight")
    try:
        values = read_volume(path).values
        if values.ndim != 3:
            raise InputError(f"{path.name}: has {values.shape[3]} channels, and distances have one")
        # A surface crosses about as many cells as three sides of the cube have.
        crossed = 6 * max(values.shape) ** 2
        parts = max(1, min(_PARTS, int((MOST_CELLS / crossed) ** (1.0 / 3.0))))
        return isosurface(values.astype(float), parts, smooth=smooth)
    except InputError as error:
        raise plugin.error(str(error)) from None
