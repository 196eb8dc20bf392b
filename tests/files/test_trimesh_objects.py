"""A trimesh object loads like the file that it was loaded from, or would be saved to."""

from pathlib import Path

import numpy as np
import pytest
import trimesh
from conftest import ROOT
from PIL import Image
from support.meshes import volume, write
from support.same_scenes import differences
from trimesh.visual import TextureVisuals
from trimesh.visual.material import MultiMaterial, PBRMaterial, SimpleMaterial

import wrt
from wrt.errors import InputWarning
from wrt.io.load_mesh import from_trimesh, load_file, load_object
from wrt.io.mesh.parts import DEFAULT_REFLECTANCE
from wrt.scene.srgb import linear_from_srgb

SEEDS = ROOT / "tests" / "corpus" / "seeds"


SAMPLES: dict[str, dict[str, float]] = {
    **{name: {} for name in ("teapot.ply", "big.ply", "text.ply", "text.stl", "box.stl", "box.off")},
    # trimesh has the second triangles of all quads behind the first ones; they are compared by their number.
    "quads.off": {"vertices": 1.0, "normals": 2.0},
    # trimesh takes options before the image's name as part of the name, and so finds no image for map_Kd.
    "textured.obj": {"material.base_color": np.inf},
}


def check(path: Path, made: object, allowed: dict[str, float]) -> None:
    """Compare the scenes of a file and an object."""
    for name, amount in differences(wrt.load(path), wrt.load(made)).items():
        bounds = [bound for key, bound in allowed.items() if name == key or name.startswith(f"{key}.")]
        assert bounds, f"{name} differs by {amount}"
        assert amount <= max(bounds), f"{name} differs by {amount}, which may be {max(bounds)}"


@pytest.mark.filterwarnings("ignore:.*the STL file has no normals:wrt.errors.InputWarning")
@pytest.mark.parametrize("name", SAMPLES)
def test_samples_both_ways(name):
    path = ROOT / "meshes" / name if name == "teapot.ply" else SEEDS / name
    for load in (trimesh.load, trimesh.load_scene):
        check(path, load(path), SAMPLES[name])


def image(color: tuple[int, ...], mode: str = "RGB") -> Image.Image:
    """Return an image whose right half is darker, so that its mean is no pixel of it."""
    pixels = np.empty((4, 4, len(color)), np.uint8)
    pixels[:, :2], pixels[:, 2:] = color, np.array(color) // 2
    return Image.fromarray(pixels, mode)


def box(**fields) -> trimesh.Trimesh:
    made = trimesh.creation.box()
    return trimesh.Trimesh(made.vertices, made.faces, process=False, **fields)


def laid(material) -> trimesh.Trimesh:
    mesh = box()
    mesh.visual = TextureVisuals(uv=np.linspace(0, 1, 16).reshape(8, 2), material=material)
    return mesh


PBR = {
    "factors": {"baseColorFactor": [255, 51, 102, 255], "metallicFactor": 0.25, "roughnessFactor": 0.5},
    "base colour": {"baseColorTexture": image((200, 100, 50)), "baseColorFactor": [255, 51, 255, 255]},
    "numbers": {"metallicRoughnessTexture": image((0, 100, 200)), "roughnessFactor": 0.75, "doubleSided": True},
    "emission": {"emissiveTexture": image((250, 200, 9)), "emissiveFactor": [1.0, 0.5, 0.25]},
    "normals": {"normalTexture": image((120, 140, 250))},
    "mask": {"baseColorTexture": image((90, 90, 90, 200), "RGBA"), "alphaMode": "MASK", "alphaCutoff": 0.45},
    "blend": {"baseColorFactor": [255, 128, 64, 51], "alphaMode": "BLEND"},
    "alpha that does not count": {"baseColorFactor": [255, 255, 255, 51]},
}


def colored(material) -> trimesh.Trimesh:
    mesh = laid(material)
    mesh.visual.vertex_attributes["color"] = np.tile(np.uint8([[200, 100, 50, 128]]), (8, 1))
    return mesh


def ball() -> trimesh.Trimesh:
    """Return a mesh that stands on no axis more than on another, so that the type of the file decides."""
    mesh = trimesh.creation.icosphere(subdivisions=2, radius=2.0)
    mesh.vertices *= (1.0, 1.001, 1.002)
    return mesh


VALUES = {"diffuse": [255, 204, 153, 255], "specular": [51, 51, 51, 255], "glossiness": 250.0}
MADE = {  # An object, and the type of its file
    **{case: (laid(PBRMaterial(**values)), "glb") for case, values in PBR.items()},
    "colours that multiply": (colored(PBRMaterial(**PBR["blend"])), "glb"),
    "simple material": (laid(SimpleMaterial(image=image((200, 100, 50)), **VALUES)), "obj"),
    "alpha of vertices": (box(vertex_colors=np.arange(32, dtype=np.uint8).reshape(8, 4) * 8), "ply"),
    "alpha that is zero everywhere": (box(vertex_colors=[[9, 99, 199, 0]] * 8), "ply"),
}


@pytest.mark.parametrize("case", MADE)
def test_objects_load_like_their_files(case, tmp_path):
    mesh, suffix = MADE[case]
    path = tmp_path / f"box.{suffix}"
    mesh.export(path)
    # The format may say that a mesh without normals is flat.
    scenes = load_file(path, smooth_degrees=60.0), load_object(mesh, smooth_degrees=60.0)
    found = differences(*scenes)  # the studio of glTF has another light
    # Up to single precision and the digits of decimals
    assert all(amount < 1e-6 for amount in found.values()), found


@pytest.mark.parametrize(("suffix", "axis"), [("stl", "z"), ("off", "z"), ("obj", "y"), ("ply", "y"), ("glb", "y")])
def test_the_up_axis_follows_the_file_type(suffix, axis, tmp_path):
    ball().export(path := tmp_path / f"ball.{suffix}")
    reloaded = trimesh.load(path)
    bounds = {up: wrt.load(reloaded, up=up).shapes[0].bounds for up in ("y", "z", None)}
    np.testing.assert_allclose(bounds[None], bounds[axis], rtol=1e-6)
    assert not np.allclose(bounds["y"], bounds["z"], rtol=1e-5)


TRIANGLE = "mtllib a.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nvt 1 0\nvt 0 1\nusemtl a\nf 1/1 2/2 3/3\n"


def test_changes_after_loading_count(tmp_path):
    write(tmp_path, "a.mtl", "newmtl a\nKd 0.123 0.456 0.789\nKs 0.5 0.5 0.5\nNs 10\nillum 2\nd 0.5\n")
    mesh = trimesh.load(write(tmp_path, "a.obj", TRIANGLE))
    before = load_object(mesh).shapes[0].material
    assert before.base_color == (0.123, 0.456, 0.789)  # not rounded to 8 bits, as the attribute is
    assert before.opacity == 0.5
    mesh.visual.material.diffuse = np.array([255, 0, 51, 255], np.uint8)
    mesh.visual.material.glossiness = 1000.0
    changed = load_object(mesh).shapes[0].material
    np.testing.assert_allclose(changed.base_color, (1.0, 0.0, 0.2))
    assert changed.roughness == 0.0


def test_other_maps_are_read_beside_the_file(tmp_path):
    image((128, 128, 255)).save(tmp_path / "n.png")
    write(tmp_path, "a.mtl", "newmtl a\nKd 1 1 1\nnorm n.png\nmap_Ke gone.png\n")
    path = write(tmp_path, "a.obj", TRIANGLE)
    mesh = trimesh.load(path)
    with pytest.warns(InputWarning, match=r"gone\.png"):
        made = wrt.load(mesh)
    with pytest.warns(InputWarning, match=r"gone\.png"):
        assert differences(wrt.load(path), made) == {}
    assert isinstance(made.shapes[0].material.normal_map, wrt.NormalMap)
    with pytest.raises(wrt.InputError, match=r"'n\.png', which a material names, cannot be looked up"):
        wrt.load(mesh.copy(), strict=True)  # a copy does not know its file


def test_several_materials_of_one_mesh_and_one_image_of_several():
    picture = image((0, 100, 200))
    materials = [PBRMaterial(metallicFactor=value, metallicRoughnessTexture=picture) for value in (0.25, 0.75)]
    mesh = laid(MultiMaterial(materials))
    mesh.visual.face_materials = [0] * 5 + [1] * 7
    first, second = from_trimesh(mesh)
    assert (len(first.mesh.faces), len(second.mesh.faces)) == (5, 7)
    assert (first.material.metallic.factor, second.material.metallic.factor) == ((0.25,) * 3, (0.75,) * 3)
    assert first.material.metallic.pixels is second.material.roughness.pixels
    mesh.visual.face_materials = None
    with pytest.warns(InputWarning, match="does not say which of its 2 materials each face has"):
        from_trimesh(mesh)


def test_colors_are_decoded_and_mirrored_meshes_keep_their_fronts():
    (shape,) = from_trimesh(box(vertex_colors=np.full((8, 4), 128, np.uint8)))
    np.testing.assert_allclose(shape.mesh.colors, [[linear_from_srgb(128 / 255)] * 3 + [128 / 255]] * 24, rtol=1e-6)
    assert shape.material.opacity.alpha
    scene, mirror = trimesh.Scene(), np.diag([-1.0, 1.0, 1.0, 1.0])
    mirror[0, 3] = 7.0
    scene.add_geometry(box(), transform=mirror)
    (moved,) = from_trimesh(scene)
    np.testing.assert_allclose(moved.mesh.bounds, [[6.5, -0.5, -0.5], [7.5, 0.5, 0.5]])
    assert volume(moved.mesh.translated([-7, 0, 0])) == pytest.approx(1.0)
    scene.graph.update(frame_to="again", geometry="geometry_0")
    first, second = load_object(scene).shapes
    assert first.mesh is second.mesh
    for plain in (box(), laid(None)):
        assert from_trimesh(plain)[0].material.reflectance == DEFAULT_REFLECTANCE


@pytest.mark.parametrize("count", [12, 8, 1])
@pytest.mark.parametrize("scale", [1, 255])
def test_colors_are_of_faces_or_vertices_as_their_number_says(count, scale):
    codes = np.random.default_rng(count).integers(0, 256, (count, 3))
    colors = codes.astype(np.uint8) if scale == 255 else codes / 255.0
    mesh = box()
    mesh.visual = trimesh.visual.ColorVisuals(vertex_colors=colors)  # without a mesh, trimesh checks nothing
    (shape,) = from_trimesh(mesh)
    found = shape.mesh.colors[shape.mesh.faces]
    rows = np.broadcast_to(linear_from_srgb(codes / 255.0), (max(count, 8), 3))
    expected = np.repeat(rows[:, None], 3, axis=1) if count == 12 else rows[mesh.faces]
    np.testing.assert_allclose(found, expected, rtol=1e-5)


def test_what_a_mesh_carries_beside_is_accounted_for():
    mesh = laid(PBRMaterial())
    mesh.vertex_attributes["heat"] = np.zeros(8)
    mesh.face_attributes["region"] = np.zeros(12)
    mesh.face_attributes["normal"] = np.zeros((12, 3))
    mesh.visual.vertex_attributes["uv1"] = np.zeros((8, 2))
    mesh.metadata["gltf_extensions"] = {"X_more": {}}
    mesh.visual.material._data["sheenFactor"] = 1.0
    with pytest.warns(InputWarning) as warned:
        from_trimesh(mesh)
    kinds = "vertex attribute 'heat'", "face attribute 'region'", "vertex attribute 'uv1' of its texture"
    kinds += "extension X_more", "sheenFactor of a material"
    messages = {f"trimesh: {kind} is unknown to wrt and left out" for kind in kinds}
    assert {str(each.message) for each in warned} == messages
    mesh = box()
    mesh.visual = trimesh.visual.ColorVisuals(vertex_colors=np.zeros((13, 4), np.uint8))
    with pytest.warns(InputWarning, match="the 13 colours of 'trimesh' are left out: it has 8 vertices and 12 faces"):
        from_trimesh(mesh)


def test_tangents_are_read_where_they_fit_the_vertices():
    material = trimesh.visual.material.PBRMaterial(normalTexture=Image.new("RGB", (2, 2), (200, 128, 200)))
    visual = trimesh.visual.TextureVisuals(uv=np.zeros((3, 2)), material=material)
    mesh = trimesh.Trimesh(np.eye(3), [[0, 1, 2]], visual=visual, process=False)
    mesh.vertex_attributes["TANGENT"] = np.tile((0.6, 0.8, 0.0, -1.0), (3, 1))
    (shape,) = from_trimesh(mesh)
    assert np.allclose(shape.mesh.tangents, (0.6, 0.8, 0.0, -1.0))
    mesh.vertex_attributes["TANGENT"] = np.ones((3, 3))
    with pytest.warns(wrt.InputWarning, match="vertex attribute 'TANGENT'"):
        (shape,) = from_trimesh(mesh)
    assert shape.mesh.tangents is None


def test_cameras_and_lights_of_a_scene():
    scene = trimesh.Scene(box())
    assert wrt.load(scene).camera.fov_degrees == 24.0  # framed by wrt: trimesh creates a camera only on request
    matrix = trimesh.transformations.rotation_matrix(0.5, (0, 1, 0))
    matrix[:3, 3] = 1.0, 2.0, 3.0
    scene.camera = trimesh.scene.Camera(resolution=(80, 60), fov=(60, 45))
    scene.camera_transform = matrix
    assert len(scene.lights) == 2  # trimesh creates two when asked for lights
    made = wrt.load(scene)
    assert made.lights == []
    assert (made.camera.origin, made.camera.fov_degrees) == (pytest.approx((1, 2, 3)), pytest.approx(45.0))
    np.testing.assert_allclose(np.subtract(made.camera.target, made.camera.origin), -matrix[:3, 2])
    points = np.array([[0.3, -0.2, -1.0], [-0.5, 0.1, -2.0]])
    pixels = points / -points[:, 2:] * (1, -1, -1) @ scene.camera.K.T
    placed = points @ matrix[:3, :3].T + matrix[:3, 3]
    np.testing.assert_allclose(made.camera.project(placed, 80, 60), pixels[:, :2])
    lighting, white = trimesh.scene.lighting, [255, 255, 255, 255]
    scene.lights = [
        lighting.PointLight(name="lamp", color=[255, 51, 0, 255], intensity=8.0),
        lighting.SpotLight(name="spot", color=white, intensity=2.0, innerConeAngle=0.1, outerConeAngle=0.5),
        lighting.DirectionalLight(name="sun", color=white, intensity=3.0),
    ]
    for light in scene.lights:
        scene.graph[light.name] = matrix
    lamp, spot, sun = wrt.load(scene).lights
    np.testing.assert_allclose(lamp.intensity, (8.0, 1.6, 0.0))
    np.testing.assert_allclose(lamp.position, (1, 2, 3))
    np.testing.assert_allclose(spot.direction, -matrix[:3, 2])
    assert np.radians(spot.outer_degrees) == pytest.approx(0.5)
    np.testing.assert_allclose(sun.irradiance, 3.0)


def test_objects_without_triangles_or_uvs_are_warned_of():
    line = trimesh.load_path(np.eye(3))
    scene = trimesh.Scene(box())
    scene.add_geometry(line, geom_name="wire")
    with pytest.warns(InputWarning, match=r"trimesh: 'wire' is left out: a Path3D has no triangles$"):
        assert len(from_trimesh(scene)) == 1
    with pytest.raises(wrt.InputError, match="a Path3D has no triangles"):
        wrt.load(scene, strict=True)
    for empty in (line, trimesh.Scene([line])):
        with pytest.warns(InputWarning), pytest.raises(wrt.InputError, match="no triangles in it"):
            wrt.load(empty)
    mesh = box()
    mesh.visual = TextureVisuals(material=PBRMaterial(baseColorTexture=image((9, 9, 9))))
    with pytest.warns(InputWarning, match="^trimesh: the textures of material 0 are left out: its mesh has no texture"):
        from_trimesh(mesh)
