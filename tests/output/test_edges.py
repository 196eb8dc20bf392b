"""Lines along edges cover what geometry says, on every camera, and are drawn as they should be.

On the film a triangle whose sides are lines of width w leaves a smaller one open: that of sides moved inwards by w / 2,
which is smaller by the factor 1 − w / 2r where r is the radius of the inscribed circle.
"""

import dataclasses
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from PIL import Image
from support.cameras import camera_rays
from support.statistics import t_test_mean

import wrt
from wrt.cli import main
from wrt.scene.mesh import merge
from wrt.view.controls import Look
from wrt.view.frames import Source
from wrt.view.picture import composed

Array = NDArray[np.float64]
SIDE = 64


def rendered(scene: wrt.Scene, spp: int = 256, **options: Any) -> wrt.Renderer:
    """Render square pictures by a box filter with independent samples, so that their errors are known."""
    defaults = {"width": SIDE, "height": SIDE, "filter": "box", "sampler": "independent", "integrator": "aov"}
    renderer = wrt.Renderer(scene, **{**defaults, "edges": True, "layers": ("edges", "alpha"), **options})
    for _ in renderer.passes(spp=spp):
        pass
    return renderer


def require_covered(renderer: wrt.Renderer, pixels: float, spp: int = 256) -> None:
    """Require that lines cover an area of the film, by a test of the mean at a significance of 1 %."""
    n = SIDE * SIDE * spp
    share = pixels / SIDE**2
    mean = float(renderer.layers()["edges"].mean(dtype=np.float64))
    assert t_test_mean(mean, share * (1.0 - share) / n, n, share) > 0.01, (SIDE**2 * mean, pixels)


def open_share(corners: Array, width: float) -> tuple[float, float]:
    """Return the area of a triangle with these (3, 2) corners on the film, and the part of it beside its lines."""
    a, b, c = corners
    area = 0.5 * abs((b - a)[0] * (c - a)[1] - (b - a)[1] * (c - a)[0])
    radius = 2.0 * area / sum(np.linalg.norm(q - p) for p, q in ((a, b), (b, c), (c, a)))
    return area, max(0.0, 1.0 - width / (2.0 * radius)) ** 2


PERSPECTIVE = wrt.PerspectiveCamera((0.3, 0.2, 4.0), (0.0, 0.0, 0.0), fov_degrees=40.0)
TILTED = wrt.Mesh(
    np.array([[-1.0, -0.8, 1.2], [1.1, -0.9, -1.5], [-0.7, 0.9, -0.5], [1.2, 0.4, 0.9]]),
    np.array([[0, 1, 2], [2, 1, 3]]),
)
"""Two triangles, seen obliquely."""


@pytest.mark.parametrize("width", [1.0, 5.0])
def test_lines_cover_what_their_triangles_leave(width, device):
    """Seen obliquely by a perspective camera, whose scale changes by a factor of two over each triangle."""
    scene = wrt.Scene(camera=PERSPECTIVE)
    scene.add(TILTED, material=wrt.Diffuse(0.5))
    points = scene.camera.project(TILTED.vertices, SIDE, SIDE)
    pieces = [open_share(points[face], width) for face in TILTED.faces]
    expected = sum(area * (1.0 - share) for area, share in pieces)
    require_covered(rendered(scene, edge_width=width, device=device), expected)


CAMERAS = {
    "fisheye": wrt.FisheyeCamera((0.2, 0.1, 1.6), (0.0, 0.0, 0.0), fov_degrees=150.0),
    "panorama": wrt.PanoramaCamera((0.2, 0.1, 1.6), (0.0, 0.0, 0.0), horizontal_degrees=140.0, vertical_degrees=120.0),
    "distorted": dataclasses.replace(PERSPECTIVE, distortion=(-0.25, 0.06, 0.01, -0.01)),
}


@pytest.mark.parametrize(
    "name", [pytest.param(name, marks=() if name == "fisheye" else pytest.mark.slow) for name in CAMERAS]
)
def test_lines_are_as_wide_where_the_film_bends_them(name, device):
    """Against the distance of random points of the film from the edges, which are projected piece by piece."""
    camera, width, count = CAMERAS[name], 4.0, 400_000
    scene = wrt.Scene(camera=camera)
    scene.add(TILTED, material=wrt.Diffuse(0.5))
    renderer = rendered(scene, edge_width=width, device=device)
    films = np.random.default_rng(3).random((count, 2)) * SIDE
    rays = camera_rays(camera, SIDE, SIDE, films, device=device)
    is_on_line = np.zeros(count, bool)
    for face in TILTED.faces:
        p0, p1, p2 = TILTED.vertices[face].astype(np.float64)
        columns = np.stack(
            [np.broadcast_to(p1 - p0, (count, 3)), np.broadcast_to(p2 - p0, (count, 3)), -rays.directions]
        )
        u, v, t = np.linalg.solve(columns.transpose(1, 2, 0), (rays.origins - p0)[..., None])[..., 0].T
        is_hit = np.flatnonzero(rays.visible & (u > 0.0) & (v > 0.0) & (u + v < 1.0) & (t > 0.0))
        share = np.linspace(0.0, 1.0, 200)[:, None]
        places = np.concatenate([p + (q - p) * share for p, q in ((p0, p1), (p1, p2), (p2, p0))])
        places = camera.project(places, SIDE, SIDE)
        for some in np.array_split(is_hit, 50):
            apart = np.linalg.norm(films[some, None] - places[None], axis=2).min(axis=1)
            is_on_line[some] |= apart <= 0.5 * width
    expected = float(is_on_line.mean())
    n = SIDE * SIDE * 256
    mean = float(renderer.layers()["edges"].mean(dtype=np.float64))
    variance = expected * (1.0 - expected) * (1.0 / n + 1.0 / count)
    assert expected > 0.05
    assert t_test_mean(mean, variance, count, expected) > 0.01, (mean, expected)


def triangle(x: float, y: float, z: float = 0.0, size: float = 1.0) -> wrt.Mesh:
    """Return a triangle with a right angle at a point, which faces the camera."""
    corners = np.array([[x, y, z], [x + size, y, z], [x, y + size, z]])
    return wrt.Mesh(corners, np.array([[0, 1, 2]]))


def covered(size: float, width: float) -> float:
    """Return how much the lines of such a triangle cover, in pixels, of a picture that shows 4 m."""
    legs = size * SIDE / 4.0
    area, share = open_share(np.array([[0.0, 0.0], [legs, 0.0], [0.0, legs]]), width)
    return area * (1.0 - share)


def test_lines_move_deform_and_blur_with_their_surface(device):
    """None of these changes how much they cover, apart from growth."""
    lens = {"aperture_radius": 0.02, "focus_distance": 7.0, "shutter_close": 1.0}
    fov = 2.0 * float(np.degrees(np.arctan(0.2)))
    scene = wrt.Scene(camera=wrt.PerspectiveCamera((0.0, 0.0, 10.0), (0.0, 0.0, 0.0), fov_degrees=fov, **lens))
    plain = wrt.Diffuse(0.5)
    scene.add(triangle(-1.6, -1.6), material=plain)
    scene.add(triangle(0.2, -1.6), material=plain, transform=wrt.Motion.translation((0.5, 0.3, 0.0)))
    scaled = np.diag([-0.5, 0.5, 0.5, 1.0])
    scaled[:3, 3] = (1.5, 0.6, 0.0)
    scene.add(triangle(0.0, 0.0), material=plain, transform=scaled)
    keys = np.stack([triangle(-1.5, 0.1, size=size).vertices for size in (0.6, 1.4)])
    scene.add(triangle(-1.5, 0.1), material=plain, deformation=wrt.Deformation((0.0, 1.0), keys))
    growing = np.mean([covered(0.6 + 0.8 * (k + 0.5) / 1000, 2.0) for k in range(1000)])
    expected = 2.0 * covered(1.0, 2.0) + covered(0.5, 2.0) + float(growing)
    require_covered(rendered(scene, edge_width=2.0, device=device), expected)


def nested() -> wrt.Scene:
    """A triangle behind the middle of another, and shapes without lines: a sphere, and one that is to have none."""
    scene = wrt.Scene(camera=wrt.OrthographicCamera((0.0, 0.0, 5.0), (0.0, 0.0, 0.0), view_height=4.0))
    plain = wrt.Diffuse(0.5)
    scene.add(triangle(-1.9, -1.9, 0.0, 3.0), material=plain)
    scene.add(triangle(-1.5, -1.5, -1.0, 0.9), material=plain)
    scene.add(wrt.spheres([(1.0, 1.0, 0.0)], 0.5), material=plain)
    scene.add(triangle(-1.9, 1.2, 0.0, 0.7), material=plain, edges=False)
    return scene


def test_surfaces_hide_lines_but_not_those_of_wireframes(device):
    front, behind = covered(3.0, 1.5), covered(0.9, 1.5)
    require_covered(rendered(nested(), edge_width=1.5, device=device), front)
    wires = rendered(nested(), edge_width=1.5, wireframe=True, device=device)
    require_covered(wires, front + behind)
    np.testing.assert_array_equal(wires.layers()["alpha"], rendered(nested(), device=device).layers()["alpha"])


# --- Polygons -------------------------------------------------------------------------------------------

CORNERS = [(0, 0, 0), (2, 0, 0), (2, 1, 0), (1, 0.5, 0), (0, 1, 0), (3, 0, 0), (3, 1, 0), (4, 0.5, 0)]
POLYGONS = [(0, 1, 2, 3, 4), (1, 5, 6, 2), (5, 7, 6)]
"""A pentagon with a corner that turns inwards, a square, and a triangle."""


def file_of(suffix: str, polygons: list[tuple[int, ...]]) -> str:
    points = [" ".join(map(str, corner)) for corner in CORNERS]
    if suffix == ".obj":
        faces = [" ".join(["f", *(str(k + 1) for k in polygon)]) for polygon in polygons]
        return "\n".join([*(f"v {point}" for point in points), *faces, ""])
    faces = [" ".join(map(str, (len(polygon), *polygon))) for polygon in polygons]
    head = f"OFF\n{len(points)} {len(polygons)} 0"
    if suffix == ".ply":
        coordinates = "".join(f"property float {axis}\n" for axis in "xyz")
        head = f"ply\nformat ascii 1.0\nelement vertex {len(points)}\n{coordinates}element face {len(polygons)}\n"
        head += "property list uchar int vertex_indices\nend_header"
    return "\n".join([head, *points, *faces, ""])


def drawn(mesh: wrt.Mesh) -> set[frozenset[tuple[float, ...]]]:
    """Return the pairs of points between which a mesh has edges."""
    sides = np.full(len(mesh.faces), 7) if mesh.sides is None else mesh.sides
    each = zip(mesh.faces, sides, strict=True)
    ends = ((face[k], face[(k + 1) % 3]) for face, side in each for k in range(3) if side >> k & 1)
    return {frozenset(tuple(np.round(mesh.vertices[i].astype(float), 5).tolist()) for i in pair) for pair in ends}


@pytest.mark.parametrize("suffix", [".obj", ".off", ".ply"])
@pytest.mark.parametrize("polygons", [POLYGONS, POLYGONS[1:2]], ids=["mixed", "squares"])
def test_polygons_of_files_keep_their_edges(suffix, polygons, tmp_path):
    """Also once they are mirrored, smoothed, merged, and written to a scene file."""
    (tmp_path / f"a{suffix}").write_text(file_of(suffix, polygons))
    pairs = {(polygon[k - 1], corner) for polygon in polygons for k, corner in enumerate(polygon)}
    expected = {frozenset(tuple(map(float, CORNERS[i])) for i in pair) for pair in pairs}
    for degrees in (0.0, 60.0):
        mesh = wrt.load_mesh(tmp_path / f"a{suffix}", smooth_degrees=degrees)
        assert drawn(mesh) == expected
        mirror = np.diag([-1.0, 1.0, 1.0, 1.0])
        assert drawn(mesh.transformed(mirror).transformed(mirror)) == expected
        assert drawn(mesh.transformed(mirror)) == {frozenset((-x + 0.0, y, z) for x, y, z in pair) for pair in expected}
        assert drawn(merge([mesh, wrt.Mesh(mesh.vertices, mesh.faces[:1])], "both")) > expected
    scene = wrt.Scene(shapes=[wrt.Shape(mesh)])
    scene.save(tmp_path / "a.toml")
    assert drawn(wrt.load(tmp_path / "a.toml").shapes[0].mesh) == expected
    with pytest.raises(wrt.InputError, match="sides must be"):
        wrt.Mesh(mesh.vertices, mesh.faces, sides=np.full(len(mesh.faces), 8))


def test_diagonals_are_not_drawn(device):
    """Each cell of a grid of squares stays open, except for half the width along its edges."""
    scene = wrt.Scene(camera=wrt.OrthographicCamera((0.0, 0.0, 5.0), (0.0, 0.0, 0.0), view_height=4.0))
    for x, y in np.ndindex(3, 2):
        scene.add(wrt.quad((x - 1.7, y - 0.9, 0.0), (1.0, 0.0, 0.0), (0.0, 1.0, 0.0)), material=wrt.Diffuse(0.5))
    pixels, width = SIDE / 4.0, 3.0
    require_covered(rendered(scene, edge_width=width, device=device), 6.0 * (pixels**2 - (pixels - width) ** 2))


# --- The picture ----------------------------------------------------------------------------------------

COLOR = (1.0, 0.25, 0.0)


def test_lines_have_their_colour_in_pictures(tmp_path, monkeypatch):
    """Whatever the tone and the exposure, over what is denoised, and on surfaces alone where alpha is below 1."""
    scene = nested()
    scene.environment = wrt.ConstantEnvironment(3.0)
    options = {"integrator": None, "edge_color": COLOR, "edge_width": 6.0, "layers": (), "spp": 8}
    for transparent in (False, True):
        renderer = rendered(scene, transparent=transparent, **options)
        lines = renderer._film_layers()["edges"]
        image, alpha, shown = renderer.image(), renderer.alpha(), renderer.finished()
        assert (lines == 1.0).sum() > 100
        seen = np.ones_like(lines) if alpha is None else alpha
        share = np.divide(lines, seen, out=np.zeros_like(lines), where=seen > 0.0)[..., None]
        expected = image * (1.0 - share) + lines[..., None] * COLOR
        np.testing.assert_allclose(shown[..., :3], expected, rtol=1e-5, atol=1e-6)
        if alpha is not None:
            np.testing.assert_array_equal(shown[..., 3], alpha)
        renderer.save(tmp_path / "a.png", tone="agx", exposure=-1.0)
        with Image.open(tmp_path / "a.png") as picture:
            codes = np.asarray(picture)
        assert {tuple(code) for code in codes[..., :3][lines == 1.0].tolist()} == {(255, 137, 0)}
        assert np.array_equal(wrt.develop_image(shown, tone="agx", exposure=-1.0), codes)
        if alpha is None:
            page = Source(renderer.image, True, composed=composed(renderer)).codes(Look(-1.0, "agx"))
            assert np.array_equal(page, codes)
        renderer.save(tmp_path / "a.npy")
        np.testing.assert_array_equal(np.load(tmp_path / "a.npy"), shown)
    renderer = rendered(scene, denoise=False, **options)
    renderer.settings = dataclasses.replace(renderer.settings, denoise=True)
    monkeypatch.setattr(type(renderer), "denoised", lambda self: np.full((SIDE, SIDE, 3), 0.5, np.float32))
    np.testing.assert_allclose(renderer.finished()[lines == 1.0], [COLOR] * int((lines == 1.0).sum()))


def test_a_wireframe_is_lines_on_paper(tmp_path):
    """White, a background, or none: then the lines are all that covers the picture. It needs no light."""
    for options, paper in (
        ({}, 1.0),
        ({"background": (0.1, 0.2, 0.3)}, (0.1, 0.2, 0.3)),
        ({"transparent": True}, None),
    ):
        renderer = rendered(nested(), 4, integrator=None, wireframe=True, edge_color=COLOR, layers=(), **options)
        lines = renderer._film_layers()["edges"][..., None]
        assert 0.0 < lines.mean() < 1.0
        shown = renderer.finished()
        if paper is None:
            np.testing.assert_array_equal(shown[..., 3:], lines)
        expected = lines * COLOR + (1.0 - lines) * (0.0 if paper is None else np.asarray(paper))
        np.testing.assert_allclose(shown[..., :3], expected, rtol=1e-5, atol=1e-6)
        for suffix in (".npy", ".png", ".exr"):
            renderer.save(tmp_path / f"a{suffix}")
        np.testing.assert_array_equal(np.load(tmp_path / "a.npy"), shown)
        with Image.open(tmp_path / "a.png") as picture:
            codes = np.asarray(picture)
        expected_codes = wrt.develop_image(shown, tone="none", exposure=0.0)
        assert np.abs(codes.astype(int) - expected_codes.astype(int)).max() <= 1  # one of them is dithered
    with pytest.raises(wrt.InputError, match="a wireframe has no target of noise"):
        renderer.render(noise=0.01)


def test_crops_parts_and_checkpoints_have_the_same_lines(tmp_path):
    whole = rendered(nested(), 8, edge_color=COLOR).layers()["edges"]
    crop = rendered(nested(), 8, crop=(10, 20, 50, 60)).layers()["edges"]
    np.testing.assert_array_equal(crop, whole[20:60, 10:50])
    renderer = rendered(nested(), 3, wireframe=True, edge_color=COLOR)
    renderer.save_checkpoint(tmp_path / "a.ckpt")
    resumed = wrt.Renderer.resume(tmp_path / "a.ckpt", nested())
    resumed.render(spp=8)
    parts = wrt.merge([renderer.part(number, 2, spp=8) for number in (1, 2)])
    wires = rendered(nested(), 8, wireframe=True, edge_color=COLOR)
    for other in (resumed, parts):
        np.testing.assert_array_equal(other.layers()["edges"], wires.layers()["edges"])
    np.testing.assert_array_equal(parts.finished(), wires.finished())


def test_the_options_reach_the_picture(tmp_path):
    """By their names in the shell, in a scene file and in Python; the studio's ground has no lines."""
    scene = wrt.load(triangle(-0.5, -0.5))
    scene.save(tmp_path / "a.toml")
    scene.settings = dataclasses.replace(scene.settings, wireframe=True, edge_width=2.0)
    scene.save(tmp_path / "b.toml")
    size = ["--size", "48x36", "--spp", "2", "--quiet"]
    flags = ["--wireframe", "--edge-width", "2", "--edge-color", "red"]
    assert main(["render", str(tmp_path / "a.toml"), "-o", str(tmp_path / "a.npy"), *size, *flags]) == 0
    assert main(["render", str(tmp_path / "b.toml"), "-o", str(tmp_path / "b.npy"), *size, *flags[3:]]) == 0
    image = wrt.render(
        triangle(-0.5, -0.5), wireframe=True, edge_width=2.0, edge_color="red", width=48, height=36, spp=2
    )
    for name in ("a", "b"):
        np.testing.assert_array_equal(np.load(tmp_path / f"{name}.npy"), image)
    assert (image[0] == 1.0).all()
    assert (image[..., 1] < 0.5).any()
    with pytest.raises(wrt.InputError, match="without its edges"):
        wrt.Renderer(scene, wireframe=False, integrator="aov", layers=("depth",)).sharing(edges=True)
