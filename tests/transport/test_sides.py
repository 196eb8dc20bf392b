"""The back of a single-sided surface shows what is behind it to who looks, and stops light; unlit surfaces.

What is not seen changes no bit of a film: scenes are compared with those that lack it.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from support.covering_kernels import covering, rendering_with

import wrt

kernels_of_the_file = rendering_with(covering("diffuse", "mirror", "dielectric", "thin_dielectric", composite="holes"))

BRIGHT = (1.0, 2.0, 3.0)
CAMERA = wrt.PerspectiveCamera((0, 0, 4), (0, 0, 0), fov_degrees=10)
BY_MIRROR = wrt.PerspectiveCamera((4, 0, 0), (0, 0, 0), fov_degrees=10)


def sheet(z: float, *, half: float = 3.0) -> wrt.Mesh:
    """Return a square whose back faces the camera."""
    return wrt.quad((half, -half, z), (-2 * half, 0, 0), (0, 2 * half, 0))


def mirrored_sheet() -> tuple[wrt.Mesh, NDArray[np.float64]]:
    """Return the same at z = −1 as an instance of a mesh whose front a reflection turns."""
    return sheet(1.0), np.diag([1.0, 1.0, -1.0, 1.0])


def film(scene: wrt.Scene, spp: int = 8, **options: Any) -> NDArray[np.float32]:
    return wrt.render(scene, **{"width": 12, "height": 8, "spp": spp, **options})


def lamp(z: float = -2.0) -> wrt.Shape:
    """Return a square that emits towards the camera."""
    return wrt.Shape(wrt.quad((-3, -3, z), (6, 0, 0), (0, 6, 0)), wrt.Emissive(BRIGHT))


def behind(way: str) -> list[wrt.Shape]:
    """Return what is before a sheet at z = −1 and a lamp at z = −2, on the way of the camera's rays to them."""
    if way == "glass":
        return [wrt.Shape(wrt.box((-1, -1, 1), (1, 1, 2)), wrt.Dielectric(ior=1.5))]
    if way == "pane":
        return [wrt.Shape(wrt.quad((-1, -1, 1), (2, 0, 0), (0, 2, 0)), wrt.ThinDielectric())]
    # A mirror at the origin that turns rays along −x to −z
    return [wrt.Shape(wrt.quad((-1, -1, 1), (2, 0, -2), (0, 2, 0)), wrt.Mirror(0.9))] if way == "mirror" else []


SHEETS = {
    "a mesh": {"mesh": sheet(-1.0)},
    "a mirrored instance": dict(zip(("mesh", "transform"), mirrored_sheet(), strict=True)),
    "an exact disk": {"mesh": wrt.disk((0, 0, -1), (0, 0, -1), 2.0)},
    "an exact sphere": {"mesh": wrt.spheres([[0, 0, -40]], [38.9])},
}


@pytest.mark.parametrize("integrator", ["path", "whitted"])
@pytest.mark.parametrize("way", ["straight", "glass", "pane"])
def test_the_eye_sees_what_is_behind_a_back(way: str, integrator: str) -> None:
    alone = wrt.Scene(shapes=[*behind(way), lamp()], camera=CAMERA)
    expected = film(alone, integrator=integrator)
    assert expected.mean() > 0.5
    hidden = wrt.Shape(sheet(-1.0), wrt.Diffuse(0.5), double_sided=False)
    scene = wrt.Scene(shapes=[*behind(way), lamp(), hidden], camera=CAMERA)
    assert np.array_equal(film(scene, integrator=integrator), expected)
    shown = wrt.Shape(sheet(-1.0), wrt.Diffuse(0.5))
    scene = wrt.Scene(shapes=[*behind(way), lamp(), shown], camera=CAMERA)
    assert film(scene, integrator=integrator).mean() < 0.2 * expected.mean()
