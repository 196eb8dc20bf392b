"""What cannot be described is refused in one line, which names the value: materials, shapes, cameras, settings."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from PIL import Image
from support.composites import A, B, chain

import wrt

ONE = np.ones((1, 1, 1))
PIXELS = np.ones((1, 1, 3))
EYE, MIRROR, FLAT = np.eye(4), np.diag([-1.0, 1.0, 1.0, 1.0]), np.diag([1.0, 1.0, 0.0, 1.0])
MIRRORED = wrt.Motion([0.0], [MIRROR])
STRETCHED = wrt.Motion([0.0, 1.0], [np.eye(4), np.diag([1.0, 1.1, 1.0, 1.0])])
BOX = {"mesh": wrt.box()}
CORNERS, FACE = np.eye(3), [[0, 1, 2]]
BLOB = {"vertices": CORNERS, "faces": FACE, "name": "blob"}
BUMPS = wrt.NormalMap(np.full((1, 1, 3), 0.5))

MISTAKES: list[tuple[Callable[..., Any], dict[str, Any], str]] = [
    # Numbers, colours and words that all descriptions check alike
    (wrt.Principled, {"metallic": 1.5}, "metallic must be at most 1, not 1.5"),
    (wrt.Principled, {"ior": 0.5}, "ior must be at least 1, not 0.5"),
    (wrt.Principled, {"base_color": (1.2, 0.0, 0.0)}, "base_color[0] must be at most 1, not 1.2"),
    (wrt.Principled, {"thin_walled": 1}, "thin_walled must be true or false, not 1"),
    (wrt.Mirror, {"opacity": "all"}, "opacity must be a number, not 'all'"),
    (wrt.Dielectric, {"fresnel": "Schlick"}, "fresnel must be one of exact, schlick, not 'Schlick'"),
    (wrt.Dielectric, {"exterior_ior": 0.0}, "exterior_ior must be greater than 0, not 0"),
    (wrt.Diffuse, {"normal_map": wrt.ImageTexture(PIXELS)}, "normal_map must be a wrt.NormalMap, not ImageTexture"),
    (wrt.Measured, {"measurement": "paint.bsdf"}, "measurement must be a wrt.Measurement, not str"),
    (wrt.OrenNayar, {"sigma": 2.0}, "sigma must be at most 1.5708"),
    (wrt.Emissive, {"radiance": -1.0}, "radiance must be at least 0"),
    (wrt.Plastic, {"ior": 0.0}, "ior must be greater than 0"),
    (wrt.RoughPlastic, {"alpha": 0.0}, "alpha must be at least 0.0001"),
    (wrt.RoughPlastic, {"distribution": "blinn-phong"}, "distribution must be one of ggx, beckmann"),
    (wrt.Glossy, {"side": 0.0}, "side must be greater than 0"),
    (wrt.Glossy, {"exponent": -1.0}, "exponent must be at least 0"),
    # Names of the presets
    (wrt.ThinDielectric, {"ior": "watr"}, "ior: 'watr' is not a known dielectric (did you mean 'water'?)"),
    (wrt.Dielectric, {"dispersion": "diamnd"}, "dispersion: 'diamnd' is not a known "),
    (wrt.Conductor, {"metal": "gould"}, "metal: 'gould' is not a known "),
    (wrt.Conductor, {"f0": "gould"}, "f0: 'gould' is not a known "),
    # Values that do not go together
    (wrt.Glossy, {"side": 0.1, "exponent": 10.0}, "gloss is given by side or by exponent"),
    (wrt.Conductor, {"eta": 1.0, "f0": 0.5}, "a metal is given by eta and k, by f0 or by metal"),
    (wrt.Conductor, {"eta": 0.0}, "eta must be greater than 0 in each channel"),
    (wrt.RoughDielectric, {"ior": 0.9, "dispersion": 0.5}, "dispersion needs an ior of 1 or more"),
    (wrt.Principled, {"ior": 0, "transmission": 0.5}, "ior 0 means infinite"),
    (wrt.Principled, {"anisotropy": wrt.VertexColor()}, "anisotropy must be a number, or an image"),
    (
        wrt.Principled,
        {"multiple_bounces": True, "anisotropy": 0.5, "roughness": wrt.VertexColor()},
        "multiple_bounces needs roughness and anisotropy to be numbers",
    ),
    (wrt.Principled, {"interior": wrt.Medium(1.0)}, "an interior needs a transmission above 0"),
    (wrt.Principled, {"film_thickness": 300.0, "film_ior": 0.9}, "film_ior must be at least 1"),
    (wrt.RoughConductor, {"film_thickness": 300.0, "multiple_bounces": True}, "multiple_bounces cannot have a film"),
    # Roughness
    (wrt.RoughConductor, {"alpha": (0.1, 0.0)}, "alpha[1] must be at least 0.0001"),
    (wrt.RoughConductor, {"alpha": (0.1, 0.2, 0.3)}, "alpha must be a number, two numbers or an image"),
    (wrt.RoughConductor, {"alpha": (0.1, 0.2), "distribution": "blinn-phong"}, "alpha must be one number"),
    (wrt.RoughConductor, {"alpha": 0.1, "distribution": "abc", "masking": "implicit"}, "alpha must be two numbers, B"),
    (wrt.RoughConductor, {"alpha": (0.1, 99), "distribution": "sgd", "masking": "implicit"}, "alpha[1] (p) must be"),
    (wrt.RoughConductor, {"distribution": "phong"}, "distribution must be one of ggx, "),
    (wrt.RoughConductor, {"masking": "walter"}, "masking must be one of smith, "),
    (
        wrt.RoughConductor,
        {"distribution": "blinn-phong", "alpha": 0.5, "masking": "walter"},
        "masking 'walter' for distribution 'blinn-phong' needs an alpha that is one number, at most 0.3",
    ),
    (wrt.RoughConductor, {"alpha": wrt.VertexColor(), "multiple_bounces": True}, "multiple_bounces needs an alpha"),
    # Materials of materials
    (wrt.Mix, {"first": 0.5}, "first must be a wrt.Material, not float"),
    (wrt.Mix, {"first": A, "second": wrt.Emissive(3.0)}, "second must not emit light; give the shape an emission"),
    (wrt.Diffuse, {"normal_map": wrt.NormalMap(PIXELS, uv_set=1)}, "normal_map follows the first texture coordinates"),
    (wrt.Principled, {"coat_normal_map": wrt.NormalMap(PIXELS, filter=True)}, "coat_normal_map cannot have a filter"),
    (
        wrt.Principled,
        {"normal_map": wrt.NormalMap(PIXELS, convention="mitsuba"), "coat_normal_map": BUMPS},
        "normal_map cannot have Mitsuba's convention where there is a coat_normal_map",
    ),
    (wrt.Mix, {"first": A, "second": B, "normal_map": BUMPS}, "a mix has no normals of its own"),
    (wrt.TwoSided, {"front": chain(7)}, "materials are nested more than 7 deep"),
    # Textures
    (wrt.ImageTexture, {"pixels": PIXELS, "channel": "red"}, "texture image: channel must be one of r, g, b"),
    (wrt.ImageTexture, {"pixels": PIXELS, "wrap": "mirrored"}, "texture image: wrap must be one of repeat, mirror, "),
    (wrt.ImageTexture, {"pixels": PIXELS, "scale": (1.0, 2.0, 3.0)}, "texture image: scale must be two numbers"),
    (wrt.ImageTexture, {"pixels": PIXELS, "uv_set": 2}, "texture image: uv_set must be between 0 and 1"),
    (
        wrt.ImageTexture,
        {"pixels": Image.new("RGB", (2, 2), (200,) * 3)},
        "texture image: pixels must be linear numbers, not codes up to 200",
    ),
    (wrt.ImageTexture, {"pixels": "a.png"}, "texture image: pixels must be an array, such as wrt.load_image('a.png')"),
    (
        wrt.ImageTexture,
        {"pixels": PIXELS, "vertex_colors": True, "vertex_alpha": True},
        "texture image: use either vertex_colors or vertex_alpha",
    ),
    (wrt.NormalMap, {"pixels": 2.0 * PIXELS}, "normal map normal map: pixels must be 0 to 1, not 2"),
    (wrt.NormalMap, {"pixels": PIXELS, "filter": True, "heights": True}, "normal map: filter is for normals"),
    # Densities
    (wrt.DensityGrid, {"values": np.ones((2, 2))}, "density density: values must be (nz, ny, nx)"),
    (wrt.DensityGrid, {"values": ONE * np.nan}, "density density: values must be finite and not negative"),
    (wrt.DensityGrid, {"values": ONE, "upper": (1.0, 0.0, 1.0)}, "density density: lower must be less than upper"),
    (wrt.DensityGrid, {"values": ONE, "albedo": 1.5 * PIXELS[None]}, "density density: albedo must be at most 1"),
    # Meshes and exact shapes
    (wrt.Mesh, {**BLOB, "vertices": CORNERS * [1.0, 1.0, np.nan]}, "blob: vertices must be finite; number 0 is [1.0, "),
    (wrt.Mesh, {**BLOB, "faces": [[0, -1, 2]]}, "blob: a face names vertex -1, but there are 3 vertices"),
    (wrt.Mesh, {**BLOB, "faces": np.uint64([[0, 1, 2**63]])}, f"blob: a face names vertex {2**63}, but"),
    (wrt.Mesh, {**BLOB, "faces": np.zeros((0, 3), int)}, "blob: the mesh has no triangles"),
    (wrt.Mesh, {**BLOB, "faces": [[0.0, 1.0, 2.0]]}, "blob: faces must be integers, not float64"),
    (wrt.disk, {"radius": 0.0}, "radius must be greater than 0"),
    (wrt.disk, {"normal": (0, 0, 0)}, "a disk's normal must have a length above 0"),
    (wrt.cylinder, {"start": (1, 1, 1), "end": (1, 1, 1)}, "a cylinder's start and end must differ"),
    (
        wrt.cylinder,
        {"start": (0, -500, 0), "end": (0, 500, 0), "radius": 1e-4},
        "cylinder: the cylinder at [0.0, ",
    ),
    (wrt.spheres, {"centers": [(0, 0, 0)], "radii": [1.0, 2.0]}, "spheres: radii must be one number or 1, as many"),
    (wrt.spheres, {"centers": CORNERS[:1], "radii": [0.0]}, "spheres: centers must be finite, and radii finite and"),
    (
        wrt.spheres,
        {"centers": CORNERS[:1], "radii": 1.0, "colors": np.uint8([(255, 0, 0)])},
        "spheres: colors must be linear numbers, not codes up to 255",
    ),
    (wrt.spheres, {"centers": [(1e38, 0, 0)], "radii": 3e38}, "spheres: vertices must be finite; number 1"),
    # Where shapes are
    (wrt.Motion, {"times": [], "transforms": np.zeros((0, 4, 4))}, "motion times must be one or more finite"),
    (wrt.Motion, {"times": [0.0, 0.0], "transforms": [EYE, EYE]}, "motion times must ascend"),
    (wrt.Motion, {"times": [0.0], "transforms": [np.eye(3)]}, "motion transforms must be (1, 4, 4), one per key"),
    (wrt.Motion, {"times": [0.0], "transforms": [FLAT]}, "motion transform 0 is not invertible"),
    (wrt.Motion, {"times": [0.0, 1.0], "transforms": [EYE, MIRROR]}, "motion transform 1 mirrors the one before"),
    (
        wrt.Shape,
        {**BOX, "transform": np.eye(3)},
        "shape: transform must be a (4, 4) matrix or a wrt.Motion",
    ),
    (wrt.Shape, {**BOX, "transform": FLAT}, "shape: transform is not invertible"),
    (
        wrt.Shape,
        {**BOX, "transform": "turn"},
        "shape: transform must be a (4, 4) matrix or a wrt.Motion, not str",
    ),
    (wrt.Shape, {**BOX, "transform": EYE * np.nan}, "shape: transform must be finite"),
    (
        wrt.Shape,
        {**BOX, "deformation": wrt.Deformation((0.0, 1.0), np.zeros((2, 9, 3)))},
        "shape: the deformation has 9 vertices, but the mesh has 8",
    ),
    # Settings
    (
        wrt.RenderSettings,
        {"sampler": "halton"},
        "sampler must be one of independent, stratified, sobol, blue-noise",
    ),
    (wrt.RenderSettings, {"clamp_indirect": 0.0}, "clamp_indirect must be greater than 0"),
    (wrt.RenderSettings, {"regularization": 1.5}, "regularization must be at most 1"),
    (wrt.RenderSettings, {"jittered_rays": 17}, "jittered_rays must be between 0 and 16"),
    (
        wrt.RenderSettings,
        {"width": 48, "height": 30, "crop": (0, 0, 49, 30)},
        "crop must lie inside the picture: (49, 30",
    ),
    (wrt.RenderSettings, {"crop": (5, 5, 3, 6)}, "crop must not be empty"),
    (wrt.RenderSettings, {"crop": (0, 0, 0.5, 0.5)}, "crop[2] must be a whole number, not 0.5"),
    (wrt.RenderSettings, {"crop": "0123"}, "crop must be four whole numbers"),
    # Cameras
    (wrt.PerspectiveCamera, {"shutter_open": 1.0, "shutter_close": 0.5}, "camera shutter_close must not be before"),
    (wrt.PerspectiveCamera, {"shift_y": math.inf}, "camera shift_y must be finite"),
    (wrt.PerspectiveCamera, {"motion": 3}, "camera motion must be a wrt.Motion, not int"),
    (wrt.PerspectiveCamera, {"motion": STRETCHED}, "camera motion must be rigid"),
    (wrt.PerspectiveCamera, {"motion": MIRRORED}, "camera motion must be rigid"),
    (wrt.PerspectiveCamera, {"aperture": "hexagon"}, "camera aperture must be one of disk, square, polygon, not"),
    (wrt.PerspectiveCamera, {"aperture_blades": 2}, "camera aperture_blades must be between 3 and"),
    (wrt.OrthographicCamera, {"view_height": 0.0}, "camera view_height must be greater than 0"),
    (wrt.PanoramaCamera, {"vertical_degrees": 181.0}, "camera vertical_degrees must be at most 180"),
    (wrt.FisheyeCamera, {"origin": (0, 0, 0)}, "camera origin and target must differ"),
    # The sky
    (wrt.SunSkyEnvironment, {"sun_direction": (0.0, -1.0, 0.0)}, "sun_direction must point above the horizon"),
    (
        wrt.SphericalHarmonicsEnvironment,
        {"coefficients": np.ones((2, 3))},
        "coefficients must be 1, 4, 9, 16,",
    ),
]


@pytest.mark.parametrize(("make", "values", "message"), MISTAKES, ids=[message[:50] for *_, message in MISTAKES])
def test_what_cannot_be_is_refused(make: Callable[..., Any], values: dict[str, Any], message: str) -> None:
    with pytest.raises(wrt.InputError) as caught:
        make(**values)
    assert str(caught.value).startswith(message)
    assert "\n" not in str(caught.value)
