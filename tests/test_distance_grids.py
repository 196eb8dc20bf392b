"""Mitsuba's `sdfgrid` becomes a closed mesh on the zero surface of the trilinear interpolation."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import wrt
from wrt.io.mitsuba.fields.isosurface import isosurface
from wrt.io.mitsuba.surfaces import is_closed

SCENE = """<scene version="3.0.0"><shape type="sdfgrid"><string name="filename" value="ball.vol"/>
<string name="normals" value="{}"/></shape></scene>"""


def ball(count: int = 20) -> np.ndarray:
    """Return the (z, y, x) distances to a ball in the unit cube, not in its middle."""
    z, y, x = np.mgrid[0:count, 0:count, 0:count] / (count - 1.0)
    return np.sqrt((x - 0.4) ** 2 + (y - 0.5) ** 2 + (z - 0.55) ** 2) - 0.3


def trilinear(values: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Return values at (N, 3) points of the unit cube, by SciPy."""
    from scipy.interpolate import RegularGridInterpolator

    axes = [np.linspace(0.0, 1.0, size) for size in values.shape]
    return RegularGridInterpolator(axes, values)(points[:, ::-1])


def write(path: Path, values: np.ndarray) -> None:
    header = b"VOL\x03" + np.array([1, *values.shape[::-1], 1], "<i4").tobytes() + np.zeros(6, "<f4").tobytes()
    path.write_bytes(header + values.astype("<f4").tobytes())


def test_vertices_lie_on_the_surface_and_faces_look_outwards() -> None:
    values = ball()
    mesh = isosurface(values, 3, smooth=True)
    assert is_closed(mesh)
    assert np.abs(trilinear(values, mesh.vertices)).max() < 1e-5
    radial = mesh.vertices - [0.4, 0.5, 0.55]
    assert (np.einsum("ij,ij->i", mesh.normals, radial / np.linalg.norm(radial, axis=1)[:, None]) > 0.9999).all()


def test_a_plane_is_exact_whatever_its_slope() -> None:
    z, y, x = np.mgrid[0:5, 0:7, 0:9].astype(float)
    values = 0.3 * x / 8 + 0.5 * y / 6 - 0.7 * z / 4 - 0.05
    mesh = isosurface(values, 2, smooth=True)
    normal = np.array([0.3, 0.5, -0.7]) / np.linalg.norm([0.3, 0.5, -0.7])
    np.testing.assert_allclose(mesh.normals, np.tile(normal, (len(mesh.normals), 1)), atol=1e-5)
    np.testing.assert_allclose(mesh.vertices @ [0.3, 0.5, -0.7], 0.05, atol=1e-6)
    a, b, c = (mesh.vertices[mesh.faces[:, k]].astype(np.float64) for k in range(3))
    across = np.cross(b - a, c - a)
    large = np.linalg.norm(across, axis=1) > 1e-6
    assert (across[large] @ normal > 0.0).all()


@pytest.mark.parametrize("normals", ["smooth", "analytic"])
def test_a_file_is_read(normals: str, tmp_path: Path) -> None:
    write(tmp_path / "ball.vol", ball())
    (tmp_path / "scene.xml").write_text(SCENE.format(normals), "utf-8")
    (shape,) = wrt.load(tmp_path / "scene.xml", strict=True).shapes
    assert (shape.mesh.normals is not None) == (normals == "smooth")
    np.testing.assert_allclose(shape.bounds, [[0.1, 0.2, 0.25], [0.7, 0.8, 0.85]], atol=0.003)


@pytest.mark.parametrize("fault", ["truncated", "other", "empty", "one sign"])
def test_bad_files_are_refused_in_one_line(fault: str, tmp_path: Path) -> None:
    path = tmp_path / "ball.vol"
    write(path, np.abs(ball()) + 1.0 if fault == "one sign" else ball())
    data = path.read_bytes()
    path.write_bytes({"truncated": data[:-4], "other": b"ABC" + data[3:], "empty": b"", "one sign": data}[fault])
    (tmp_path / "scene.xml").write_text(SCENE.format("smooth"), "utf-8")
    with pytest.raises(wrt.InputError, match=r"scene\.xml: line 1: .*ball\.vol|one sign") as caught:
        wrt.load(tmp_path / "scene.xml")
    assert "\n" not in str(caught.value)
