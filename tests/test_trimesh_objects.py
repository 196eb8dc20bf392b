"""A trimesh object loads like the file that it was loaded from, or would be saved to."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from support.meshes import gltf_box, write
from support.same_scenes import differences

import wrt
from wrt.errors import InputWarning
from wrt.io.load_mesh import from_trimesh, load_file, load_object
from wrt.io.mesh.parts import DEFAULT_REFLECTANCE

trimesh = pytest.importorskip("trimesh")
Image = pytest.importorskip("PIL.Image")

ROOT = Path(__file__).resolve().parent.parent
SEEDS = ROOT / "tests" / "corpus" / "seeds"
LOADERS = pytest.mark.parametrize("loader", [trimesh.load, trimesh.load_scene], ids=["load", "load_scene"])

HALF_A_STEP = 0.5 / 255 + 2.0**-24
"""Largest error of a value from 0 to 1 that was rounded to 8 bits by trimesh and then to single precision."""

ASSETS: dict[str, dict[str, float]] = {
    "stanford-bunny.obj": {},
    "nefertiti.obj": {},
    "spot.obj": {},
    "igea.ply": {},
    "fuze/fuze.obj": {},
    # trimesh normalizes normals in double precision.
    "AlphaBlendModeTest.glb": {"normals": 2e-7},
    # trimesh drops samplers, so the image has no levels. It keeps the camera without the
    # scale of its parent node: the camera is left out, and the duck framed like any other.
    "Duck.glb": {"material.base_color.filter": np.inf, "camera": np.inf},
}
"""What may differ between each file and its object, and by how much."""

SAMPLES: dict[str, dict[str, float]] = {
    "meshes/teapot.ply": {},
    "meshes/sweep.ply": {},
    "big.ply": {},
    "little.ply": {},
    "strips.ply": {},
    "text.ply": {},
    "text.stl": {},
    "box.stl": {},
    "box.off": {},
    # trimesh has the second triangles of all quads behind the first ones; they are compared by their number.
    "quads.off": {"vertices": 1.0, "normals": 2.0},
    # trimesh takes options before the image's name as part of the name, and so finds no image for map_Kd.
    "textured.obj": {"material.base_color": np.inf},
}


def check(path: Path, made: object, allowed: dict[str, float]) -> None:
    """Compare the scenes of a file and an object."""
    found = differences(wrt.load(path), wrt.load(made))
    for name, amount in found.items():
        bounds = [bound for key, bound in allowed.items() if name == key or name.startswith(f"{key}.")]
        assert bounds, f"{name} differs by {amount}"
        assert amount <= max(bounds), f"{name} differs by {amount}, which may be {max(bounds)}"


@LOADERS
@pytest.mark.filterwarnings("ignore:trimesh. its camera is left out:wrt.errors.InputWarning")
@pytest.mark.filterwarnings("ignore:.*Duck.glb. its camera shows the mesh at 34%:UserWarning")
@pytest.mark.parametrize("name", ASSETS)
def test_assets_both_ways(name, loader, assets):
    path = assets / "meshes" / name
    check(path, loader(path), ASSETS[name])


@LOADERS
@pytest.mark.filterwarnings("ignore:.*the STL file has no normals:wrt.errors.InputWarning")
@pytest.mark.parametrize("name", SAMPLES)
def test_samples_both_ways(name, loader):
    path = ROOT / name if "/" in name else SEEDS / name
    check(path, loader(path), SAMPLES[name])


def test_every_asset_is_compared(assets):
    there = {str(path.relative_to(assets / "meshes")) for path in (assets / "meshes").rglob("*.*")}
    assert {name for name in there if not name.endswith((".mtl", ".jpg"))} == set(ASSETS)


def test_what_trimesh_changes_of_polygons():
    # trimesh cuts concave polygons into fans and keeps faces of any size together; colours are rounded to 8 bits.
    path = SEEDS / "polygons.obj"
    file, made = load_file(path), load_object(trimesh.load(path))
    np.testing.assert_array_equal(file.bounds, made.bounds)
    assert [type(shape.material.reflectance) for shape in made.shapes] == [wrt.VertexColor]
    (seen,) = made.shapes
    rows = np.concatenate([np.hstack([shape.mesh.vertices, shape.mesh.colors]) for shape in file.shapes])
    for row in np.hstack([seen.mesh.vertices, seen.mesh.colors]):
        assert np.abs(rows - row).max(axis=1).min() < 0.01  # colours are linear here, which makes half a step larger


@pytest.mark.parametrize("name", ["scene.gltf", "scene.glb"])
def test_what_trimesh_loses_of_a_scene(name):
    # trimesh drops nodes with orthographic cameras and loses their children: here the only light. It also
    # drops extensions of materials, scales of normal maps, second coordinates, transforms of textures, and samplers.
    with pytest.warns(InputWarning, match=r"trimesh: node '3' is left out: nothing leads to it"):
        made = load_object(trimesh.load(SEEDS / name))
    file = load_file(SEEDS / name)
    assert len(file.lights) == 1
    assert made.lights == []
    found = differences(wrt.Scene(file.shapes), wrt.Scene(made.shapes))
    lost = {"uvs", "material.coat", "material.normal_map.scale", "material.normal_map.wrap"}
    lost |= {
        f"material.{value}.{key}"
        for value in ("base_color", "metallic", "roughness", "opacity")
        for key in ("scale", "offset", "wrap", "filter", "uv_set")
    }
    rounded = {"material.base_color.factor", "material.opacity.factor", "colors"}
    assert set(found) <= lost | rounded, found
    assert max(found.get(name, 0.0) for name in rounded) <= HALF_A_STEP


# Objects that are made, and their files ------------------------------------------------------------


def image(color: tuple[int, ...], mode: str = "RGB"):
    """Return an image whose right half is darker, so that its mean is no pixel of it."""
    pixels = np.empty((4, 4, len(color)), np.uint8)
    pixels[:, :2], pixels[:, 2:] = color, np.array(color) // 2
    return Image.fromarray(pixels, mode)


def laid(material, **fields):
    box = trimesh.creation.box()
    mesh = trimesh.Trimesh(box.vertices, box.faces, process=False, **fields)
    mesh.visual = trimesh.visual.TextureVisuals(uv=np.linspace(0, 1, 16).reshape(8, 2), material=material)
    return mesh


PBR = {
    "nothing": {},
    "factors": {"baseColorFactor": [255, 51, 102, 255], "metallicFactor": 0.25, "roughnessFactor": 0.5},
    "base colour": {"baseColorTexture": image((200, 100, 50)), "baseColorFactor": [255, 51, 255, 255]},
    "metallic and roughness": {"metallicRoughnessTexture": image((0, 100, 200)), "roughnessFactor": 0.75},
    "normals": {"normalTexture": image((120, 140, 250)), "metallicFactor": 0.0},
    "emission": {"emissiveTexture": image((250, 200, 9)), "emissiveFactor": [1.0, 0.5, 0.25], "doubleSided": True},
    "emission without factor": {"emissiveTexture": image((250, 200, 9))},
    "occlusion": {"occlusionTexture": image((10, 10, 10))},
    "mask": {"baseColorTexture": image((90, 90, 90, 200), "RGBA"), "alphaMode": "MASK", "alphaCutoff": 0.45},
    "blend": {"baseColorFactor": [255, 255, 255, 51], "alphaMode": "BLEND"},
    "alpha that does not count": {"baseColorFactor": [255, 255, 255, 51]},
}


@pytest.mark.parametrize("case", PBR)
def test_physically_based_materials_are_those_of_their_glb_file(case, tmp_path):
    mesh = laid(trimesh.visual.material.PBRMaterial(**PBR[case]))
    mesh.export(tmp_path / "box.glb")
    file, made = load_file(tmp_path / "box.glb"), load_object(mesh)  # the studio of glTF has another light
    assert isinstance(made.shapes[0].material, wrt.Principled)
    found = differences(file, made)
    # Coordinates are saved in single precision, the factor in decimals.
    assert all(amount < 1e-6 for amount in found.values()), found


def test_colors_of_a_physically_based_material_are_linear_and_multiply_it(tmp_path):
    mesh = laid(trimesh.visual.material.PBRMaterial(baseColorFactor=[255, 128, 64, 255], alphaMode="BLEND"))
    mesh.visual.vertex_attributes["color"] = np.tile(np.uint8([[200, 100, 50, 128]]), (8, 1))
    mesh.export(tmp_path / "box.glb")
    found = differences(load_file(tmp_path / "box.glb"), load_object(mesh))
    assert all(amount < 1e-6 for amount in found.values()), found
    colors = load_object(mesh).shapes[0].mesh.colors[0]
    np.testing.assert_allclose(colors, [200 / 255, 100 * 128 / 255**2, 50 * 64 / 255**2, 128 / 255], rtol=1e-6)


def test_simple_materials_are_those_of_their_mtl_file(tmp_path):
    material = trimesh.visual.material.SimpleMaterial(
        image=image((200, 100, 50)), diffuse=[255, 204, 153, 255], specular=[51, 51, 51, 255], glossiness=250.0
    )
    mesh = laid(material)
    mesh.export(tmp_path / "box.obj")
    found = differences(wrt.load(tmp_path / "box.obj"), wrt.load(mesh))
    # Numbers of the file have eight digits.
    assert all(amount < 1e-7 for amount in found.values()), found
    made = load_object(mesh).shapes[0].material
    assert isinstance(made, wrt.Principled)
    assert made.roughness == pytest.approx(0.5)
    np.testing.assert_allclose(made.specular_color, 0.4)


def test_what_is_changed_after_loading_counts(tmp_path):
    write(tmp_path, "a.mtl", "newmtl a\nKd 0.123 0.456 0.789\nKs 0.5 0.5 0.5\nNs 10\nillum 2\nd 0.5\n")
    path = write(tmp_path, "a.obj", "mtllib a.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nusemtl a\nf 1 2 3\n")
    mesh = trimesh.load(path)
    kept = load_object(mesh).shapes[0].material
    assert kept.base_color == (0.123, 0.456, 0.789)  # not rounded to 8 bits, as the attribute is
    assert kept.opacity == 0.5
    mesh.visual.material.diffuse = np.array([255, 0, 51, 255], np.uint8)
    mesh.visual.material.glossiness = 1000.0
    changed = load_object(mesh).shapes[0].material
    np.testing.assert_allclose(changed.base_color, (1.0, 0.0, 0.2))
    assert changed.roughness == 0.0


def test_maps_besides_the_color_come_from_beside_the_file(tmp_path):
    image((128, 128, 255)).save(tmp_path / "n.png")
    write(tmp_path, "a.mtl", "newmtl a\nKd 1 1 1\nnorm n.png\nmap_Ke gone.png\n")
    text = "mtllib a.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nvt 1 0\nvt 0 1\nusemtl a\nf 1/1 2/2 3/3\n"
    path = write(tmp_path, "a.obj", text)
    mesh = trimesh.load(path)
    with pytest.warns(InputWarning, match=r"gone\.png"):
        made = wrt.load(mesh)
    with pytest.warns(InputWarning, match=r"gone\.png"):
        file = wrt.load(path)
    assert differences(file, made) == {}
    assert isinstance(made.shapes[0].material.normal_map, wrt.NormalMap)
    with pytest.raises(wrt.InputError, match=r"'gone\.png', which a material names, cannot be looked up"):
        wrt.load(mesh.copy(), strict=True)  # a copy does not know its file


def test_several_materials_of_one_mesh():
    materials = [trimesh.visual.material.PBRMaterial(metallicFactor=value) for value in (0.25, 0.75)]
    mesh = laid(trimesh.visual.material.MultiMaterial(materials))
    mesh.visual.face_materials = [0] * 5 + [1] * 7
    shapes = from_trimesh(mesh)
    assert [len(shape.mesh.faces) for shape in shapes] == [5, 7]
    assert [shape.material.metallic for shape in shapes] == [0.25, 0.75]
    mesh.visual.face_materials = None
    with pytest.warns(InputWarning, match="does not say which of its 2 materials each face has"):
        (shape,) = from_trimesh(mesh)
    assert isinstance(shape.material, wrt.Diffuse)


def test_one_image_is_there_once_in_however_many_materials():
    picture = image((0, 100, 200))
    kinds = [
        trimesh.visual.material.PBRMaterial(metallicRoughnessTexture=picture, roughnessFactor=factor)
        for factor in (0.25, 0.75)
    ]
    shapes = from_trimesh(trimesh.Scene([laid(kind) for kind in kinds]))
    pixels = {id(shape.material.roughness.pixels) for shape in shapes}
    assert len(pixels | {id(shape.material.metallic.pixels) for shape in shapes}) == 1


@pytest.mark.parametrize("suffix", ["ply", "glb"])
def test_colors_of_vertices_with_alpha_are_those_of_their_file(suffix, tmp_path):
    box = trimesh.creation.box()
    colors = np.arange(32, dtype=np.uint8).reshape(8, 4) * 8
    trimesh.Trimesh(box.vertices, box.faces, vertex_colors=colors, process=False).export(tmp_path / f"box.{suffix}")
    path = tmp_path / f"box.{suffix}"
    mesh = trimesh.load(path, process=False)
    assert differences(wrt.load(path), wrt.load(mesh)) == {}
    seen = load_object(mesh).shapes[0]
    # In glTF, alpha counts only if a material enables it, and here there is no material.
    assert seen.mesh.colors.shape[1] == (4 if suffix == "ply" else 3)


def test_alpha_that_is_zero_everywhere_stands_for_none(tmp_path):
    box = trimesh.creation.box()
    mesh = trimesh.Trimesh(box.vertices, box.faces, vertex_colors=[[9, 99, 199, 0]] * 8, process=False)
    mesh.export(tmp_path / "box.ply")
    for scene in (load_object(mesh), load_file(tmp_path / "box.ply")):
        assert scene.shapes[0].mesh.colors.shape[1] == 3
        np.testing.assert_array_equal(scene.shapes[0].material.opacity, 1.0)


# Normals, axes, cameras, lights --------------------------------------------------------------------


def test_normals_of_a_file_are_kept_even_where_they_are_what_trimesh_would_compute(tmp_path):
    box = trimesh.creation.box()
    assert box.vertex_normals.shape == (8, 3)  # computed normals, which round off the box
    assert len(from_trimesh(box)[0].mesh.vertices) == 24
    box.apply_transform(trimesh.transformations.rotation_matrix(0.3, (1, 2, 3)))
    assert len(from_trimesh(box)[0].mesh.vertices) == 24
    for suffix in ("glb", "ply", "obj"):
        path = tmp_path / f"box.{suffix}"
        box.export(path, **({} if suffix == "ply" else {"include_normals": True}))
        mesh = trimesh.load(path, process=False)
        assert len(load_file(path).shapes[0].mesh.vertices) == 8
        assert differences(load_file(path), load_object(mesh)).get("normals", 0.0) < 2e-7


@pytest.mark.parametrize(("suffix", "axis"), [("stl", "z"), ("off", "z"), ("obj", "y"), ("ply", "y"), ("glb", "y")])
def test_the_axis_is_that_of_the_file(suffix, axis, tmp_path):
    # A ball stands on no axis more than on another, so the type of the file decides.
    ball = trimesh.creation.icosphere(radius=2.0)
    ball.vertices *= (1.0, 1.001, 1.002)
    ball.export(tmp_path / f"ball.{suffix}")
    mesh = trimesh.load(tmp_path / f"ball.{suffix}")
    shown = [wrt.load(tmp_path / f"ball.{suffix}"), wrt.load(mesh), wrt.load(mesh, up=axis)]
    for scene in shown[1:]:
        np.testing.assert_allclose(scene.bounds, shown[0].bounds, rtol=1e-6)
    other = wrt.load(mesh, up="yz".replace(axis, ""))
    assert not np.allclose(other.shapes[0].bounds, shown[0].shapes[0].bounds, rtol=1e-5)


def test_what_lies_on_its_side_is_set_up():
    cone = trimesh.creation.cone(radius=1.0, height=4.0)  # along z
    height = np.ptp(wrt.load(cone).shapes[0].bounds, axis=0)[1]
    assert height == pytest.approx(4.0)
    assert np.ptp(wrt.load(cone, up="y").shapes[0].bounds, axis=0)[1] == pytest.approx(2.0, rel=0.01)


def test_cameras_and_lights_of_a_scene():
    scene = trimesh.Scene(trimesh.creation.box())
    assert wrt.load(scene).camera.fov_degrees == 24.0  # framed by wrt: trimesh creates a camera only on request
    matrix = trimesh.transformations.rotation_matrix(0.5, (0, 1, 0))
    matrix[:3, 3] = 1.0, 2.0, 3.0
    scene.camera = trimesh.scene.Camera(resolution=(80, 60), fov=(60, 45))
    scene.camera_transform = matrix
    made = wrt.load(scene)
    assert made.camera.fov_degrees == pytest.approx(45.0)
    np.testing.assert_allclose(made.camera.origin, (1, 2, 3))
    np.testing.assert_allclose(np.subtract(made.camera.target, made.camera.origin), -matrix[:3, 2])
    assert made.lights == []
    assert len(scene.lights) == 2  # trimesh creates two when asked for lights
    assert wrt.load(scene).lights == []
    lighting = trimesh.scene.lighting
    scene.lights = [
        lighting.PointLight(name="lamp", color=[255, 51, 0, 255], intensity=8.0),
        lighting.SpotLight(
            name="spot", color=[255, 255, 255, 255], intensity=2.0, innerConeAngle=0.1, outerConeAngle=0.5
        ),
        lighting.DirectionalLight(name="sun", color=[255, 255, 255, 255], intensity=3.0),
    ]
    for light in scene.lights:
        scene.graph[light.name] = matrix
    lamp, spot, sun = wrt.load(scene).lights
    np.testing.assert_allclose(lamp.intensity, (8.0, 1.6, 0.0))
    np.testing.assert_allclose(lamp.position, (1, 2, 3))
    np.testing.assert_allclose(spot.direction, -matrix[:3, 2])
    assert np.radians(spot.outer_degrees) == pytest.approx(0.5)
    np.testing.assert_allclose(sun.irradiance, 3.0)
    with pytest.raises(wrt.InputError, match="an up axis is for files without lights and cameras"):
        wrt.load(scene, up="z")


def test_lights_that_trimesh_carries_on_from_gltf(tmp_path):
    points = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0]], np.float32)
    tree = gltf_box(points, np.array([[0, 1, 2]]))
    tree["nodes"] = [
        {"mesh": 0, "children": [1]},
        {"translation": [1, 2, 3], "extensions": {"KHR_lights_punctual": {"light": 0}}},
        {"camera": 0, "translation": [0, 0, 5]},
    ]
    light = {"type": "point", "intensity": 7.0, "color": [1.0, 0.5, 0.25]}
    tree["extensions"] = {"KHR_lights_punctual": {"lights": [light]}}
    tree["cameras"] = [{"type": "perspective", "perspective": {"yfov": 0.6, "znear": 0.1, "aspectRatio": 1.5}}]
    tree["scenes"], tree["scene"] = [{"nodes": [0, 2]}], 0
    path = write(tmp_path, "lit.gltf", json.dumps(tree))
    file, made = wrt.load(path), wrt.load(trimesh.load(path))
    assert len(file.lights) == 1
    # The camera's node must not be mistaken for a parent of the camera; the light's may be.
    assert differences(file, made).keys() <= {"camera", *(f"camera.{key}" for key in ("origin", "target"))}
    np.testing.assert_allclose(made.lights[0].position, (1, 2, 3))


# What is left out, and what is refused -------------------------------------------------------------


def test_textures_of_a_mesh_without_texture_coordinates_are_named():
    box, visual = trimesh.creation.box(), trimesh.visual
    red = visual.material.PBRMaterial(
        baseColorFactor=[255, 0, 0, 255], baseColorTexture=Image.new("RGB", (2, 2), "white")
    )
    box.visual = visual.TextureVisuals(material=red)
    with pytest.warns(InputWarning, match="^trimesh: the textures of material 0 are left out: its mesh has no texture"):
        (shape,) = from_trimesh(box)
    assert shape.material.base_color == (1.0, 0.0, 0.0)


def test_points_and_paths_are_left_out_with_a_warning():
    scene = trimesh.Scene(trimesh.creation.box())
    scene.add_geometry(trimesh.PointCloud(np.zeros((3, 3))), geom_name="dust")
    scene.add_geometry(trimesh.load_path(np.array([[0, 0, 0], [1, 1, 1.0]])), geom_name="way")
    with (
        pytest.warns(
            InputWarning,
            match=r"trimesh: 'dust' is left out: a PointCloud has no triangles; wrt\.spheres shows points$",
        ),
        pytest.warns(InputWarning, match="trimesh: 'way' is left out: a Path3D has no triangles$"),
    ):
        assert len(from_trimesh(scene)) == 1
    for nothing in (trimesh.PointCloud(np.zeros((3, 3))), trimesh.Scene([trimesh.PointCloud(np.zeros((3, 3)))])):
        with pytest.warns(InputWarning), pytest.raises(wrt.InputError, match="no triangles in it"):
            wrt.load(nothing)
    with pytest.raises(wrt.InputError, match="not int"):
        from_trimesh(5)


def test_axes_are_for_everything_that_is_rendered():
    box = wrt.box((0, 0, 0), (1, 2, 3))
    mesh = trimesh.Trimesh(box.vertices, box.faces, process=False)
    for source in (box, mesh):
        picture = wrt.render(source, up="z", width=16, height=12, spp=1)
        np.testing.assert_array_equal(picture, wrt.render(wrt.load(source, up="z"), width=16, height=12, spp=1))
        assert not np.array_equal(picture, wrt.render(source, up="x", width=16, height=12, spp=1))
    with pytest.raises(wrt.InputError, match=r"^Scene: an up axis is for meshes, not for scenes$"):
        wrt.render(wrt.load(box), up="z")
    with pytest.raises(wrt.InputError, match="up must be one of"):
        wrt.render(mesh, up="w")
    for source in (box, mesh, wrt.load(box)):
        with pytest.raises(wrt.InputError, match="a number of triangles is for scenes with a procedural mesh"):
            wrt.load(source, triangles=1000)
        with pytest.raises(wrt.InputError, match="parameters are only for Mitsuba scenes"):
            wrt.render(source, parameters={"a": 1}, width=8, height=8, spp=1)
    cloud = trimesh.Scene([mesh, trimesh.PointCloud(np.zeros((3, 3)))])
    with pytest.raises(wrt.InputError, match="a PointCloud has no triangles"):
        wrt.render(cloud, strict=True, width=8, height=8, spp=1)


def test_objects_without_material_are_of_clay():
    assert from_trimesh(trimesh.creation.box())[0].material.reflectance == DEFAULT_REFLECTANCE
    assert from_trimesh(laid(None))[0].material.reflectance == DEFAULT_REFLECTANCE


def test_a_mesh_is_made_of_an_object_as_of_a_file(tmp_path):
    box = trimesh.creation.box((1, 2, 3))
    placed = trimesh.Scene()
    for x in (0.0, 5.0):
        placed.add_geometry(box, transform=trimesh.transformations.translation_matrix((x, 0, 0)))
    for made in (box, placed):
        made.export(path := tmp_path / "a.stl")
        mesh, file = wrt.load_mesh(made), wrt.load_mesh(path)
        np.testing.assert_allclose(mesh.bounds, file.bounds, atol=1e-6)
        assert len(mesh.faces) == len(file.faces)
    assert wrt.load_mesh(box, smooth_degrees=None).normals is None


@pytest.mark.parametrize(
    "source", [None, b"a.obj", np.zeros((3, 3)), wrt.Scene()], ids=lambda source: type(source).__name__
)
def test_no_mesh_is_made_of_other_things(source):
    with pytest.raises(wrt.InputError, match=f"trimesh object, not {type(source).__name__}; wrt.Mesh takes arrays"):
        wrt.load_mesh(source)


def test_where_a_scene_is_needed_the_function_that_makes_one_is_named(tmp_path):
    box = trimesh.creation.box()
    for source in ("bunny.obj", box):
        kind = type(source).__name__
        makes = f"needs a wrt.Scene, not {kind}; wrt.load makes one"
        with pytest.raises(wrt.InputError, match=f"a renderer {makes}"):
            wrt.Renderer(source)
        with pytest.raises(wrt.InputError, match=f"a turntable {makes}"):
            wrt.turntable(source, frames=2)
        for name in ("a.toml", "a.glb"):
            with pytest.raises(wrt.InputError, match=f"{name} {makes}"):
                wrt.save_scene(tmp_path / name, source)
    with pytest.raises(wrt.InputError, match="a scene file is written to a path, not to Scene"):
        wrt.save_scene(wrt.Scene(), tmp_path / "a.toml")
    with pytest.raises(wrt.InputError, match=r"mesh must be a wrt\.Mesh, not Trimesh; wrt\.load_mesh makes one"):
        wrt.Scene().add(box)
    with pytest.raises(
        wrt.InputError, match=r"shapes must be a list of wrt\.Shape, not .*; wrt\.load makes a scene of a file"
    ):
        wrt.Scene("bunny.obj")
