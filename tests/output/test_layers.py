"""Layers hold what geometry and materials say of the first surface, and change nothing of the picture.

The alpha of a transparent picture is the layer of what covers each pixel; lights are hidden from the camera alone.
"""

import dataclasses
import json
from typing import Any

import numpy as np
import OpenEXR
import pytest
from numpy.typing import NDArray
from PIL import Image
from support.cameras import camera_rays
from support.composites import WITH_OPACITY
from support.covering_kernels import covering, render_with
from support.statistics import t_test_mean

import wrt
from wrt.cli import main
from wrt.develop.picture import develop_image
from wrt.scene.layers import LAYERS, channel_names

Array = NDArray[np.float64]

MATERIALS = [wrt.Mirror((0.9, 0.5, 0.2)), wrt.Conductor(metal="gold"), wrt.RoughConductor(0.3, metal="copper")]
MATERIALS.append(wrt.Plastic(0.4))


@pytest.fixture(autouse=True)
def _two_kernels(monkeypatch):
    """One that is small, one of all models."""
    models = (material.model for material in MATERIALS)
    render_with([WITH_OPACITY, covering("diffuse", *models, aovs=True, composite="holes")], monkeypatch)


def render(scene: wrt.Scene, spp: int = 1, *, centred: bool = True, **options: Any) -> wrt.Renderer:
    """Render layers, by default with all samples in the middle of their pixels."""
    defaults = {"layers": tuple(LAYERS), "width": 32, "height": 24, "sampler": "independent"}
    scene.environment = scene.environment or wrt.ConstantEnvironment(1.0)
    renderer = wrt.Renderer(scene, **{**defaults, **options})
    if centred:
        renderer._inputs[2].zero_()
    for _ in renderer.passes(spp=spp):
        pass
    return renderer


SMOOTH = np.array([0.6, 0.0, 0.8])


def two_panes() -> wrt.Scene:
    """A tilted red pane with normals of its own before a grey wall, which does not fill the picture."""
    scene = wrt.Scene(camera=wrt.PerspectiveCamera((0.0, 0.0, 4.0), (0.0, 0.0, 0.0), fov_degrees=40.0))
    red, grey = wrt.Diffuse((0.8, 0.2, 0.1)), wrt.Diffuse(0.5)
    scene.add(wrt.quad((-2.0, -1.2, -1.0), (4.0, 0.0, 0.0), (0.0, 2.4, 0.0)), material=grey)
    pane = wrt.quad((-0.6, -0.5, 0.3), (1.2, 0.0, 0.4), (0.0, 1.0, 0.0))
    scene.add(wrt.Mesh(pane.vertices, pane.faces, np.tile(SMOOTH, (4, 1)), pane.uvs), material=red)
    scene.add(wrt.quad((-2.0, 1.3, 0.0), (4.0, 0.0, 0.0), (0.0, 0.1, 0.0)), material=grey)
    return scene


# --- Against geometry ------------------------------------------------------------------------------


@pytest.mark.slow
@pytest.mark.parametrize("integrator", ["path", "aov"])
def test_layers_of_panes_agree_with_geometry(integrator, device):
    scene = two_panes()
    layers = render(scene, integrator=integrator, device=device).layers()
    middles = np.stack(np.meshgrid(np.arange(32) + 0.5, np.arange(24) + 0.5), axis=-1)
    rays = camera_rays(scene.camera, 32, 24, middles, device=device).directions.reshape(24, 32, 3)
    origin = np.array([0.0, 0.0, 4.0])
    depth = np.full((24, 32), np.inf)
    number = np.zeros((24, 32), int)
    normal, uv = np.zeros((24, 32, 3)), np.zeros((24, 32, 2))
    for i, shape in enumerate(scene.shapes):
        corner, right, _, top = shape.mesh.vertices.astype(np.float64)
        u, v = right - corner, top - corner
        n = np.cross(u, v) / np.linalg.norm(np.cross(u, v))
        t = ((corner - origin) @ n) / (rays @ n)
        place = origin + t[..., None] * rays - corner
        at = np.stack([place @ u / (u @ u), place @ v / (v @ v)], axis=2)
        hit = (at > 0).all(axis=2) & (at < 1).all(axis=2) & (t < depth)
        depth[hit], number[hit], normal[hit], uv[hit] = t[hit], i + 1, n, at[hit]
    is_hit = number > 0
    assert set(np.unique(number)) == {0, 1, 2, 3}
    position = np.where(is_hit[..., None], origin + np.where(is_hit, depth, 0.0)[..., None] * rays, 0.0)
    albedo = np.array([(0.0, 0.0, 0.0), (0.5, 0.5, 0.5), (0.8, 0.2, 0.1), (0.5, 0.5, 0.5)])[number]
    for name, expected in (
        ("object", number),
        ("material", np.array([0, 1, 2, 1])[number]),
        ("alpha", is_hit),
        ("depth", depth),
        ("z", np.where(is_hit, 4.0 - position[..., 2], np.inf)),
        ("position", position),
        ("normal", np.where(number[..., None] == 2, SMOOTH, normal)),
        ("geometric_normal", normal),
        ("uv", uv),
        ("albedo", albedo),
        ("motion", np.zeros((24, 32, 2))),
    ):
        np.testing.assert_allclose(layers[name], expected, rtol=1e-6, atol=2e-6, err_msg=name)


# --- Albedo, means, and what has none ----------------------------------------------------------------


@pytest.mark.slow
@pytest.mark.parametrize("material", MATERIALS, ids=lambda material: material.type_name)
def test_albedo_equals_radiance_under_a_white_sky(material, device):
    """The share of light from everywhere that is sent to the viewer: by the same samples, so to the last digits."""
    scene = wrt.Scene(environment=wrt.ConstantEnvironment(1.0))
    scene.camera = wrt.PerspectiveCamera((0.0, 0.0, 3.0), (0.0, 0.0, 0.0), fov_degrees=20.0)
    scene.add(wrt.quad((-1.0, -1.0, 0.0), (2.0, 0.0, 0.5), (0.0, 2.0, 0.0)), material=material)
    renderer = render(scene, 16, max_depth=2, width=8, height=8, device=device)
    np.testing.assert_allclose(renderer.layers()["albedo"], renderer.image(), rtol=1e-6)
    assert renderer.image().min() > 0.05


@pytest.mark.slow
def test_albedo_of_clear_glass_is_white_from_both_sides(device):
    """Radiance is 2.25 times as high within; what counts is the light that gets through."""
    scene = wrt.Scene()
    scene.add(wrt.box((-1.0, -1.0, -1.0), (1.0, 1.0, 1.0)), material=wrt.Dielectric(ior=1.5))
    for origin in ((0.0, 0.0, 0.0), (0.0, 0.0, 5.0)):
        scene.camera = wrt.PerspectiveCamera(origin, (0.0, 0.0, -1.0), fov_degrees=20.0)
        albedo = render(scene, 16, width=8, height=8, device=device).layers()["albedo"]
        np.testing.assert_allclose(albedo, 1.0, rtol=1e-5)


def test_coverage_is_a_mean_and_depth_is_not(device):
    """An edge that covers 0.3 of a column of pixels, 0.7 of another: depth is one of two, by the pixel's middle."""
    scene = wrt.Scene(camera=wrt.OrthographicCamera((0.0, 0.0, 4.0), (0.0, 0.0, 0.0), view_height=8.0))
    scene.add(wrt.quad((-9.0, -9.0, 0.0), (8.3, 0.0, 0.0), (0.0, 18.0, 0.0)), material=wrt.Diffuse(0.5))  # to x = −0.7
    scene.add(wrt.quad((1.7, -9.0, 1.0), (9.0, 0.0, 0.0), (0.0, 18.0, 0.0)), material=wrt.Diffuse(0.5))  # from x = 1.7
    layers = render(scene, 4096, centred=False, filter="box", width=8, height=8, device=device).layers()
    n = 4096 * 8
    for column in (3, 5):
        mean = float(layers["alpha"][:, column].mean())
        assert t_test_mean(mean, 0.3 * 0.7 / n, n, 0.3) > 0.01
        np.testing.assert_allclose(layers["albedo"][:, column, 0], 0.5 * layers["alpha"][:, column], rtol=1e-6)
        np.testing.assert_array_equal(layers["object"][:, column], 0)
        np.testing.assert_array_equal(layers["depth"][:, column], np.inf)
    np.testing.assert_array_equal(layers["object"][:, (0, 1, 2, 6, 7)], [[1, 1, 1, 2, 2]] * 8)
    np.testing.assert_allclose(layers["depth"][:, (0, 6)], [[4.0, 3.0]] * 8, rtol=1e-6)


# --- Motion ----------------------------------------------------------------------------------------

CAMERAS: dict[str, tuple[Any, dict[str, Any]]] = {
    "perspective": (wrt.PerspectiveCamera, {"fov_degrees": 40.0, "shift_x": 0.1, "shift_y": -0.2}),
    "orthographic": (wrt.OrthographicCamera, {"view_height": 3.0}),
    "panorama": (wrt.PanoramaCamera, {"horizontal_degrees": 60.0, "vertical_degrees": 45.0}),
    "fisheye": (wrt.FisheyeCamera, {"fov_degrees": 90.0}),
}


def project(kind: str, camera: Any, points: Array, width: int, height: int) -> Array:
    """Return where docs/cameras.md says that points are in the picture, pixels."""
    x, y, z = (np.tensordot(points - np.asarray(camera.origin), np.asarray(axis), 1) for axis in camera.frame())
    if kind == "perspective":
        full = 2.0 * np.tan(np.radians(camera.fov_degrees) / 2.0)
        a = (x / z - full * camera.shift_x) * height / full
        b = (y / z - full * camera.shift_y) * height / full
    elif kind == "orthographic":
        a, b = (v * height / camera.view_height for v in (x, y))
    elif kind == "panorama":
        a = np.arctan2(x, z) * width / np.radians(camera.horizontal_degrees)
        b = np.arctan2(y, np.hypot(x, z)) * height / np.radians(camera.vertical_degrees)
    else:
        rho = np.arctan2(np.hypot(x, y), z) * min(width, height) / np.radians(camera.fov_degrees)
        a, b = (v / np.maximum(np.hypot(x, y), 1e-30) * rho for v in (x, y))
    return np.stack([a + width / 2, height / 2 - b], axis=-1)


@pytest.mark.parametrize("kind", CAMERAS)
def test_a_moving_camera_moves_what_it_sees(kind, device, report):
    """From where the film shows a point as the shutter opens to where it does as it closes."""
    make, options = CAMERAS[kind]
    turn = np.radians(3.0)
    moved = np.eye(4)
    moved[:3, :3] = [[np.cos(turn), 0.0, np.sin(turn)], [0.0, 1.0, 0.0], [-np.sin(turn), 0.0, np.cos(turn)]]
    moved[:3, 3] = (0.1, -0.05, 0.2)
    motion = wrt.Motion((0.0, 1.0), np.stack([np.eye(4), moved]))
    begin = make((0.0, 0.0, 4.0), (0.0, 0.0, 0.0), **options)
    scene = two_panes()
    scene.camera = make((0.0, 0.0, 4.0), (0.0, 0.0, 0.0), shutter_close=1.0, motion=motion, **options)
    layers = render(scene, device=device).layers()
    is_hit = layers["object"] > 0
    points = layers["position"].astype(np.float64)
    # As the shutter closes, the camera sees the points as the first one would see them moved back.
    back = (points - moved[:3, 3]) @ moved[:3, :3]
    expected = project(kind, begin, back, 32, 24) - project(kind, begin, points, 32, 24)
    error = np.abs(layers["motion"] - expected)[is_hit].max()
    report(f"{kind}: largest error of up to {np.abs(expected[is_hit]).max():.1f} pixels", float(error), 0.0)
    assert error < 2e-4
    if kind != "orthographic":
        # Where nothing is hit, directions turn: about the vertical axis, by all of a panorama's longitude.
        assert (layers["motion"][~is_hit] != 0.0).any()
    if kind == "panorama":
        # A left turn of 3 degrees, of 60 over 32 pixels.
        np.testing.assert_allclose(layers["motion"][~is_hit][:, 0], 3.0 / 60.0 * 32.0, rtol=1e-4)


@pytest.mark.slow
def test_a_moving_shape_moves_on_the_film(device):
    """A pane that goes 0.3 m to the right and 0.1 m up while the shutter is open, before a wall that stands still."""
    scene = two_panes()
    scene.camera = wrt.OrthographicCamera((0.0, 0.0, 4.0), (0.0, 0.0, 0.0), view_height=3.0, shutter_close=1.0)
    scene.shapes[1] = wrt.Shape(scene.shapes[1].mesh, transform=wrt.Motion.translation((0.3, 0.1, 0.0)))
    layers = render(scene, device=device).layers()
    is_hit = layers["object"] == 2
    assert 0.05 < is_hit.mean() < 0.5
    np.testing.assert_array_equal(layers["motion"][~is_hit], 0.0)
    expected = np.tile(np.array([0.3, -0.1]) * 24.0 / 3.0, (int(is_hit.sum()), 1))
    np.testing.assert_allclose(layers["motion"][is_hit], expected, rtol=1e-5)


# --- The picture is the same -----------------------------------------------------------------------


@pytest.mark.slow
def test_layers_do_not_change_the_picture(device):
    scene = two_panes()
    plain = render(scene, 8, centred=False, layers=(), device=device)
    with_layers = render(scene, 8, centred=False, device=device)
    np.testing.assert_array_equal(plain.image(), with_layers.image())
    assert plain.layers() == {}
    assert not any(name.startswith("layer") for name in plain.film.state())
    assert with_layers.rays == plain.rays + with_layers.paths


# --- Transparent pictures ----------------------------------------------------------------------------


def block(material: wrt.Material) -> wrt.Scene:
    """A box that covers a part of the picture, under a constant environment of 0.8."""
    camera = wrt.PerspectiveCamera((0.4, 0.5, 3.0), (0.0, 0.0, 0.0), fov_degrees=40.0)
    scene = wrt.Scene(camera=camera, environment=wrt.ConstantEnvironment(0.8))
    scene.add(wrt.box((-0.5, -0.5, -0.5), (0.5, 0.5, 0.5)), material=material)
    return scene


def seen(scene: wrt.Scene, spp: int = 4, **options: Any) -> wrt.Renderer:
    defaults = {"layers": (), "width": 24, "height": 18, "transparent": True}
    return render(scene, spp, centred=False, **{**defaults, **options})


def test_a_hidden_environment_still_lights_the_scene(device):
    """Light leaves a convex body after one reflection: each covered sample has a radiance of ρ times 0.8."""
    for material, radiance in ((wrt.Diffuse(0.5), 0.4), (wrt.Mirror(), 0.8)):
        renderer = seen(block(material), device=device)
        alpha = renderer.alpha()
        assert alpha is not None
        assert (alpha.min(), alpha.max()) == (0.0, 1.0)
        assert ((alpha > 0.0) & (alpha < 1.0)).any()
        cover = np.repeat(alpha[:, :, None], 3, axis=2)
        np.testing.assert_allclose(renderer.image(), radiance * cover, atol=1e-6)
        assert renderer.layers() == {}
        opaque = seen(block(material), device=device, transparent=False, layers=("depth",))
        assert opaque.alpha() is None
        np.testing.assert_allclose(opaque.image(), renderer.image() + 0.8 * (1.0 - cover), atol=1e-5)
    # A ray passes the front and then the back of what is half there by one half each.
    holes = seen(block(wrt.Diffuse(0.5, opacity=0.5)), 64, device=device)
    inside = seen(block(wrt.Diffuse(0.5)), 64, device=device).alpha()
    assert holes.alpha()[inside == 1.0].mean() == pytest.approx(0.75, abs=0.02)
    assert holes.image()[inside == 0.0].max() == 0.0


@pytest.mark.slow
@pytest.mark.parametrize("integrator", ["path", "whitted"])
def test_a_hidden_lamp_covers_no_pixels(integrator):
    """It hangs before a wall and is hidden, but it lights the wall if it faces that."""
    across, up, pictures = (0.8, 0.0, 0.0), (0.0, 0.8, 0.0), []
    for edges in ((up, across), (across, up)):
        scene = wrt.Scene(camera=wrt.PerspectiveCamera((0, 0, 3), (0, 0, 0), fov_degrees=40.0))
        scene.add(wrt.quad((-5, -5, 0), (10, 0, 0), (0, 10, 0)), material=wrt.Diffuse(0.5))
        scene.environment = wrt.ConstantEnvironment(0.8)
        scene.add_light(wrt.RectangleLight((-0.4, -0.4, 1.0), *edges, radiance=3.0))
        pictures.append(seen(scene, 64, integrator=integrator))
    assert seen(scene, integrator=integrator, transparent=False).image().max() == pytest.approx(3.0)
    towards, away = pictures
    np.testing.assert_array_equal(away.alpha(), np.ones((18, 24)))
    assert away.image().max() < 0.5
    assert towards.image()[9, 12].min() > 1.5 * away.image()[9, 12].max()


def test_a_checkpoint_keeps_coverage_and_is_refused_by_other_layers(device, tmp_path):
    scene = block(wrt.Diffuse(0.5))
    unbroken = seen(scene, 13, device=device)
    seen(scene, 5, device=device).save_checkpoint(tmp_path / "a.ckpt")
    resumed = wrt.Renderer.resume(tmp_path / "a.ckpt", scene, device=device)
    for _ in resumed.passes(spp=13):
        pass
    np.testing.assert_array_equal(resumed.alpha(), unbroken.alpha())
    for name, options in (("layers", {"layers": ("uv",), "transparent": True}), ("transparent", {})):
        renderer = wrt.Renderer(scene, width=24, height=18, sampler="independent", device=device, **options)
        with pytest.raises(wrt.InputError, match=name):
            renderer.load_checkpoint(tmp_path / "a.ckpt")


# --- Files -----------------------------------------------------------------------------------------


def test_png_has_straight_alpha_and_the_others_associated(tmp_path):
    colors = np.array([[[0.5, 0.25, 0.125], [0.25, 0.125, 0.0625], [0.0, 0.0, 0.0]]], np.float32)
    alpha = np.array([[1.0, 0.5, 0.0]], np.float32)
    for name in ("a.png", "a.exr", "a.npy"):
        wrt.save_image(tmp_path / name, colors, alpha=alpha)
    with Image.open(tmp_path / "a.png") as picture:
        assert picture.mode == "RGBA"
        codes = np.asarray(picture)
    assert codes[0, :, 3].tolist() == [255, 128, 0]
    straight = np.array([[colors[0, 0], colors[0, 0], np.zeros(3)]])
    np.testing.assert_array_equal(codes[:, :, :3], develop_image(straight, tone="none", exposure=0.0))
    channels = OpenEXR.File(str(tmp_path / "a.exr"), separate_channels=True).channels()
    np.testing.assert_array_equal(channels["A"].pixels, alpha)
    np.testing.assert_array_equal(channels["R"].pixels, colors[:, :, 0])
    np.testing.assert_array_equal(np.load(tmp_path / "a.npy"), np.dstack([colors, alpha]))
    for name in ("a.exr", "a.npy"):
        np.testing.assert_array_equal(wrt.load_image(tmp_path / name), colors)
    with pytest.raises(wrt.InputError, match="alpha must be"):
        wrt.save_image(tmp_path / "c.png", colors, alpha=np.ones((3, 1)))


@pytest.mark.slow
def test_an_exr_file_has_named_layers(tmp_path):
    """OpenImageIO reads what the renderer holds."""
    import OpenImageIO

    renderer = render(two_panes(), layers=("depth", "albedo", "alpha", "object"))
    renderer.save(tmp_path / "a.exr")
    expected = {name: renderer.image()[..., k] for k, name in enumerate("RGB")}
    for layer, values in renderer.layers().items():
        for k, name in enumerate(channel_names(layer)):
            expected[name] = values if values.ndim == 2 else values[..., k]
    assert set(expected) == set("RGBA") | {"albedo.R", "albedo.G", "albedo.B", "depth.Z", "object.N"}
    source = OpenImageIO.ImageInput.open(str(tmp_path / "a.exr"))
    spec, pixels = source.spec(), source.read_image("float")
    assert set(spec.channelnames) == set(expected)
    for name, values in expected.items():
        np.testing.assert_array_equal(pixels[..., spec.channelnames.index(name)], values)
    source.close()
    np.testing.assert_array_equal(wrt.load_image(tmp_path / "a.exr"), renderer.image())


@pytest.mark.slow
def test_layers_alone_make_files_without_light(tmp_path, capsys):
    scene = tmp_path / "a.toml"
    wrt.save_scene(scene, two_panes())
    size = ["--size", "16x12", "--spp", "1", "--sampler", "independent"]
    render_it = ["render", str(scene), *size, "--integrator", "aov", "--quiet", "--json"]
    assert main([*render_it, "-o", str(tmp_path / "a.exr"), "--layers", "normal,uv"]) == 0
    channels = OpenEXR.File(str(tmp_path / "a.exr"), separate_channels=True).channels()
    assert set(channels) == {"normal.X", "normal.Y", "normal.Z", "uv.U", "uv.V"}
    assert json.loads(capsys.readouterr().out)["mean_radiance"] == [0.0] * 3
    for name in LAYERS:
        assert main([*render_it, "-o", str(tmp_path / "a.png"), "--layers", name]) == 0
        assert wrt.load_image(tmp_path / "a.png").any()


def test_files_name_the_objects_and_materials_of_their_numbers(tmp_path):
    scene = two_panes()
    red = wrt.Diffuse((0.8, 0.2, 0.1), name="red “é”")
    scene.shapes[1] = dataclasses.replace(scene.shapes[1], name="pane “é”", material=red)
    objects = {str(number): shape.name for number, shape in enumerate(scene.shapes, 1)}
    for layer, key, expected in (
        ("object", "Objects", objects),
        ("material", "Materials", {"1": "diffuse 1", "2": "red “é”"}),
    ):
        renderer = render(scene, layers=(layer,), integrator="aov")
        renderer.save(tmp_path / "a.exr")
        renderer.save(tmp_path / "a.png")
        assert json.loads(OpenEXR.File(str(tmp_path / "a.exr")).header()[key]) == expected
        with Image.open(tmp_path / "a.png") as picture:
            assert json.loads(picture.text[key]) == expected
