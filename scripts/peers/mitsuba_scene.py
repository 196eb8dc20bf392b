"""The same scene in Mitsuba 3, an independent renderer (Jakob et al. 2022), variant scalar_rgb.

What differs between the two is bridged here, exactly:

- Texture rows: Mitsuba puts row 0 of a bitmap at v = 0, wrt at v = 1.
- Environment: Mitsuba's column u = 1/2 looks along +z, wrt's along −z; Mitsuba's first and last row lie on
  the poles, wrt's half a row beside them.
- A normal map seen from behind is mirrored in Mitsuba's `twosided`, and the same sheet in wrt.
- Reflectors are one-sided in Mitsuba unless wrapped in `twosided`; area lights emit from the side where
  corners run counter-clockwise in both.
- Shapes with transforms are instances of a `shapegroup`; emitters, which a group may not have, are copied instead.

What cannot be bridged:

- An interpolated normal. Mitsuba lights a surface by its shading normal alone, wrt asks the geometric one too.
  Compare flat meshes, or smooth ones whose materials are specular.
- Beckmann's distribution where visible normals are drawn: with the exact masking, but weighed by a density with
  Walter's fit to it, which is up to 0.3 % off. Reflectors have normals drawn without regard to the viewer instead;
  a `roughdielectric` cannot: without visible normals its samples' weights are not its values over its densities.
- A mixture of a smooth part and one of single directions. Where `blendbsdf` (3.9) samples a single direction it returns
  (w ρ + (1 − w) f cosθ) / (w + (1 − w) p), as if the probability w were a density like p. That loses light: its
  picture of a mixture, direct light only, is not the mean of its pictures of the two parts.
- A pane that is not opaque counts as a segment of the path in Mitsuba, and blocks its shadow rays: paths must be
  long, and light from points or directions does not come through. It does not dim a surface's own emission.
- Segments of paths in media: Mitsuba counts scattering events and `null` boundaries among them. Paths must be long.
"""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import Any

import numpy as np

import wrt
from wrt.scene.exact.analytic import Analytic
from wrt.scene.exact.spheres import Spheres
from wrt.scene.lights import Light
from wrt.scene.materials import Material
from wrt.scene.materials.body import Body
from wrt.scene.scene import Shape
from wrt.scene.textures import ColorSource

VARIANT = "scalar_rgb"


def load_mitsuba() -> Any:
    """Return the module mitsuba with its variant chosen."""
    import mitsuba

    if mitsuba.variant() != VARIANT:
        mitsuba.set_variant(VARIANT)
    return mitsuba


def to_mitsuba(
    scene: wrt.Scene, folder: str | Path, *, width: int, height: int, max_depth: int, rr_depth: int = 5
) -> dict[str, Any]:
    """Return `scene` as a dictionary for `mitsuba.load_dict`.

    Args:
        scene: with a camera.
        folder: where meshes are written; it must exist until the dictionary has been loaded.
        width: pixels.
        height: pixels.
        max_depth: most segments in a path.
        rr_depth: segments after which Russian roulette may end a path.
    """
    integrator = "volpathmis" if scene.media else "path"
    result: dict[str, Any] = {
        "type": "scene",
        "integrator": {"type": integrator, "max_depth": max_depth, "rr_depth": rr_depth},
        "sensor": _sensor(scene.camera, width, height),
    }
    if scene.medium is not None:
        # By reference: what has the same medium on both sides must not be told two.
        result = {"fog": {**_medium(scene.medium), "id": "fog"}, **result}
        result["sensor"]["medium"] = {"type": "ref", "id": "fog"}
    groups: dict[tuple[int, int], str] = {}
    for i, shape in enumerate(scene.shapes):
        place = shape.transform
        if isinstance(place, wrt.Motion) or shape.deformation is not None:
            raise NotImplementedError(f"{shape.name}: Mitsuba 3 has no motion blur")
        file = Path(folder) / f"shape_{i}.ply"
        if place is None or shape.emits:
            result[f"shape_{i}"] = _shape(dataclasses.replace(shape, mesh=shape.mesh_at(0.0)), file)
            interior = getattr(shape.material, "interior", None)
            if interior is not None:
                result[f"shape_{i}"]["interior"] = _medium(interior)
            if scene.medium is not None and isinstance(shape.material, Body):
                result[f"shape_{i}"]["exterior"] = {"type": "ref", "id": "fog"}
            continue
        key = (id(shape.mesh), id(shape.material))
        if key not in groups:
            groups[key] = f"group_{i}"
            result[groups[key]] = {"type": "shapegroup", "shape": _shape(shape, file)}
        to_world = load_mitsuba().ScalarTransform4f(place.tolist())
        result[f"shape_{i}"] = {"type": "instance", "to_world": to_world, "group": {"type": "ref", "id": groups[key]}}
    for i, light in enumerate(scene.lights):
        result[f"light_{i}"] = _light(light)
    if scene.environment is not None:
        result["environment"] = _environment(scene.environment)
    return result


def _rgb(value: Any) -> dict[str, Any]:
    return {"type": "rgb", "value": [float(x) for x in np.broadcast_to(np.asarray(value, np.float64), 3)]}


def _sensor(camera: wrt.Camera | None, width: int, height: int) -> dict[str, Any]:
    mi = load_mitsuba()
    if not isinstance(camera, (wrt.PerspectiveCamera, wrt.OrthographicCamera)):
        raise NotImplementedError(f"Mitsuba has no {type(camera).__name__}")
    if camera.motion is not None and camera.shutter_close > camera.shutter_open:
        raise NotImplementedError("Mitsuba 3 has no motion blur")
    to_world = mi.ScalarTransform4f().look_at(
        origin=list(camera.origin), target=list(camera.target), up=list(camera.up)
    )
    lens: dict[str, Any] = {"type": "perspective"}
    if camera.aperture_radius > 0.0:
        focus = camera.distance_in_focus
        lens = {"type": "thinlens", "aperture_radius": camera.aperture_radius, "focus_distance": focus}
    if isinstance(camera, wrt.OrthographicCamera):
        # Its picture is 2 wide, before `to_world`.
        half_width = 0.5 * camera.view_height * width / height
        to_world = to_world @ mi.ScalarTransform4f().scale([half_width, half_width, 1.0])
        lens = {"type": "orthographic"}
    else:
        lens |= {"fov": camera.fov_degrees, "fov_axis": "y"}
        if lens["type"] == "perspective":
            # Shares of width and height by which its picture moves to the right and down.
            lens["principal_point_offset_x"] = camera.shift_x * height / width
            lens["principal_point_offset_y"] = -camera.shift_y
    return {
        **lens,
        "near_clip": 1e-4 * camera.distance_in_focus,
        "far_clip": 1e4 * camera.distance_in_focus,
        "to_world": to_world,
        "film": {
            "type": "hdrfilm",
            "width": width,
            "height": height,
            "rfilter": {"type": "box"},
            "pixel_format": "rgb",
            "component_format": "float32",
        },
        "sampler": {"type": "independent"},
    }


def _shape(shape: Shape, path: Path) -> dict[str, Any]:
    if shape.emits and shape.two_sided_emission:
        raise NotImplementedError(f"{shape.name}: Mitsuba's area lights have one side")
    mesh = shape.mesh
    if isinstance(mesh, Spheres) and len(mesh.faces) == 1 and not mesh.inside_out[0]:
        form = {"type": "sphere", "center": mesh.centers[0].tolist(), "radius": float(mesh.radii[0])}
    elif isinstance(mesh, Analytic):
        raise NotImplementedError(f"{shape.name}: of exact shapes only single spheres are translated")
    else:
        write_ply(mesh, path)
        form = {"type": "ply", "filename": str(path), "face_normals": mesh.normals is None}
    result: dict[str, Any] = {**form, "bsdf": _bsdf(shape.material)}
    if shape.emits:
        result["emitter"] = {"type": "area", "radiance": _color(shape.emission)}
    return result


def _medium(medium: wrt.Medium) -> dict[str, Any]:
    if any(medium.emission):
        raise NotImplementedError("Mitsuba's media do not emit")
    pairs = zip(medium.scattering, medium.extinction, strict=True)
    albedo = [s / t if t > 0.0 else 0.0 for s, t in pairs]
    phase = {"type": "hg", "g": medium.g} if medium.g else {"type": "isotropic"}
    most = max(medium.extinction)  # colours end at 1
    if medium.density is not None:
        grid = medium.density
        sigma_t = grid.values[..., None] * np.divide(medium.extinction, most)
        colors = np.reshape(albedo, (1, 1, 1, 3)) if grid.albedo is None else grid.albedo
        return {
            "type": "heterogeneous",
            "sigma_t": _volume(sigma_t, grid),
            "albedo": _volume(colors, grid),
            "scale": most * grid.factor,
            "phase": phase,
        }
    density = {"sigma_t": _rgb([t / most for t in medium.extinction]), "scale": most}
    return {"type": "homogeneous", "albedo": _rgb(albedo), **density, "phase": phase}


def _volume(values: Any, grid: wrt.DensityGrid) -> dict[str, Any]:
    mi = load_mitsuba()
    volume = mi.VolumeGrid(np.ascontiguousarray(values, np.float32))
    to_world = mi.ScalarTransform4f(grid.to_world.tolist())
    return {"type": "gridvolume", "grid": volume, "to_world": to_world, "raw": True}


def _color(value: ColorSource) -> dict[str, Any]:
    mi = load_mitsuba()
    if isinstance(value, wrt.ImageTexture):
        pixels = value.pixels * np.float32(value.factor)
        if value.channel is not None:
            pixels = np.repeat(pixels[..., ["rgb".index(value.channel)]], 3, axis=2)
        return {
            "type": "bitmap",
            "bitmap": mi.Bitmap(np.ascontiguousarray(pixels[::-1])),
            "raw": True,
            "filter_type": "bilinear",
            "wrap_mode": "repeat",
        }
    if isinstance(value, wrt.VertexColor):
        return {"type": "mesh_attribute", "name": "vertex_color"}
    return _rgb(value)


def _number(value: ColorSource) -> Any:
    """Return a number that may vary; of a texture Mitsuba takes the luminance, wrt one channel."""
    if isinstance(value, wrt.ImageTexture):
        return _color(dataclasses.replace(value, channel=value.channel or "r"))
    return value


def _bsdf(material: Material) -> dict[str, Any]:
    if material.opacity != 1.0:
        opaque = dataclasses.replace(material, opacity=1.0)
        return {"type": "mask", "opacity": _number(material.opacity), "nested": _bsdf(opaque)}
    if isinstance(material, wrt.Mix):
        parts = {"bsdf_0": _bsdf(material.first), "bsdf_1": _bsdf(material.second)}
        return {"type": "blendbsdf", "weight": _number(material.weight), **parts}
    if isinstance(material, wrt.TwoSided):
        return {"type": "twosided", "bsdf_0": _bsdf(material.front)["bsdf"], "bsdf_1": _bsdf(material.back)["bsdf"]}
    if isinstance(material, wrt.Null):
        return {"type": "null"}
    if isinstance(material, (wrt.Dielectric, wrt.ThinDielectric, wrt.RoughDielectric)):
        return _boundary(material)
    inner = _reflector(material)
    if material.normal_map is not None:
        pixels = material.normal_map.pixels * 2.0 - 1.0
        pixels[..., :2] *= material.normal_map.scale
        colors = wrt.ImageTexture(0.5 * pixels / np.abs(pixels).max() + 0.5)  # of any length; Mitsuba has no scale
        # Without what it does against black spots and dark edges by default: wrt has a way of its own.
        repairs = {"flip_invalid_normals": False, "use_shadowing_function": False}
        inner = {"type": "normalmap", "normalmap": _color(colors), "bsdf": inner, **repairs}
    return {"type": "twosided", "bsdf": inner}


def _boundary(material: wrt.Dielectric | wrt.ThinDielectric | wrt.RoughDielectric) -> dict[str, Any]:
    result = {
        "type": "thindielectric" if isinstance(material, wrt.ThinDielectric) else "dielectric",
        "int_ior": material.ior,
        "ext_ior": material.exterior_ior,
        "specular_reflectance": _color(material.specular_reflectance),
        "specular_transmittance": _color(material.specular_transmittance),
    }
    if isinstance(material, wrt.RoughDielectric):
        result |= _microfacets(material) | {"type": "roughdielectric"}
    return result


def _reflector(material: Material) -> dict[str, Any]:
    """Return one side of an opaque surface."""
    if isinstance(material, wrt.Diffuse):
        return {"type": "diffuse", "reflectance": _color(material.reflectance)}
    if isinstance(material, wrt.Mirror):
        return {"type": "conductor", "material": "none", "specular_reflectance": _color(material.reflectance)}
    if isinstance(material, wrt.Conductor) and material.f0 is None:
        return {"type": "conductor", "eta": _rgb(material.eta), "k": _rgb(material.k)}
    if isinstance(material, wrt.RoughConductor) and material.f0 is None:
        optics = {"eta": _rgb(material.eta), "k": _rgb(material.k)}
        factor = {"specular_reflectance": _color(material.reflectance)}
        return {"type": "roughconductor", **_microfacets(material), **optics, **factor}
    if isinstance(material, wrt.RoughConductor) and material.reflectance == (1.0, 1.0, 1.0):
        alpha = _microfacets(material)["alpha_u"]
        if material.distribution != "ggx" or not isinstance(material.alpha, float):
            raise NotImplementedError("Schlick's reflectance is in Mitsuba's principled alone, GGX by one roughness")
        return {"type": "principled", "base_color": _color(material.f0), "metallic": 1.0, "roughness": alpha**0.5}
    if isinstance(material, wrt.Principled) and material.metallic == 1.0 and material.features == ():
        # The metals of both are GGX by α = roughness² with Schlick's reflectance; of the dielectrics little is alike.
        color, roughness = _color(material.base_color), _number(material.roughness)
        return {"type": "principled", "base_color": color, "metallic": 1.0, "roughness": roughness}
    if isinstance(material, (wrt.Plastic, wrt.RoughPlastic)):
        result = {
            "type": "plastic",
            "int_ior": material.ior,
            "ext_ior": material.exterior_ior,
            "nonlinear": material.nonlinear,
            "diffuse_reflectance": _color(material.reflectance),
            "specular_reflectance": _color(material.specular_reflectance),
        }
        if isinstance(material, wrt.RoughPlastic):
            facets = _microfacets(material)
            facets["alpha"] = facets.pop("alpha_u")
            del facets["alpha_v"]  # there is one
            result |= facets | {"type": "roughplastic"}
        return result
    raise NotImplementedError(f"no Mitsuba counterpart of {type(material).__name__}")


def _microfacets(material: wrt.RoughConductor | wrt.RoughDielectric | wrt.RoughPlastic) -> dict[str, Any]:
    """Return distribution and roughness; Mitsuba has two distributions, and for each one masking."""
    masking = {"ggx": "smith-separable", "beckmann": "walter"}.get(material.distribution)
    if material.masking != masking or material.multiple_bounces:
        raise NotImplementedError(f"Mitsuba has no {material.distribution} with {material.masking}, or more bounces")
    along = material.alpha if isinstance(material.alpha, tuple) else (material.alpha, material.alpha)
    result = {"distribution": material.distribution, "alpha_u": along[0], "alpha_v": along[1]}
    if material.distribution == "beckmann" and not isinstance(material, wrt.RoughDielectric):
        # See above: so that the picture is the mean of the model.
        result["sample_visible"] = False
    return result


def _light(light: Light) -> dict[str, Any]:
    if isinstance(light, wrt.PointLight):
        return {"type": "point", "position": list(light.position), "intensity": _rgb(light.intensity)}
    if isinstance(light, wrt.SpotLight):
        return _spot(light)
    if isinstance(light, wrt.ProjectorLight):
        return _projector(light)
    if isinstance(light, (wrt.RectangleLight, wrt.DiskLight, wrt.SphereLight)):
        black = {"type": "diffuse", "reflectance": _rgb(0.0)}
        return {**_form(light), "bsdf": black, "emitter": {"type": "area", "radiance": _rgb(light.radiance)}}
    if light.angle_degrees > 0.0:
        raise NotImplementedError("Mitsuba's directional light has no diameter")
    return {"type": "directional", "direction": list(light.direction), "irradiance": _rgb(light.irradiance)}


def _spot(light: wrt.SpotLight) -> dict[str, Any]:
    if light.falloff != "linear":
        raise NotImplementedError("Mitsuba's spots fade linearly with the angle")
    up = light.up if light.texture is not None else np.eye(3)[np.abs(light.direction).argmin()].tolist()
    result = {
        "type": "spot",
        "to_world": _looking(light.position, light.direction, up),
        "intensity": _rgb(light.intensity),
        "beam_width": light.inner_degrees,
        "cutoff_angle": light.outer_degrees,
    }
    if light.texture is not None:  # Mitsuba's u points to the left
        result["texture"] = _color(dataclasses.replace(light.texture, pixels=light.texture.pixels[:, ::-1]))
    return result


def _projector(light: wrt.ProjectorLight) -> dict[str, Any]:
    texture = wrt.ImageTexture(np.ones((1, 1, 3))) if light.texture is None else light.texture
    colored = dataclasses.replace(texture, pixels=texture.pixels[::-1] * np.float32(np.array(light.irradiance) / np.pi))
    return {
        "type": "projector",
        "to_world": _looking(light.position, light.direction, light.up),
        "irradiance": _color(colored),  # Mitsuba's v points down
        "fov": light.fov_degrees,
    }


def _looking(position: Any, direction: Any, up: Any) -> Any:
    target = np.array(position) + direction
    return load_mitsuba().ScalarTransform4f().look_at(origin=list(position), target=target.tolist(), up=list(up))


def _form(light: wrt.RectangleLight | wrt.DiskLight | wrt.SphereLight) -> dict[str, Any]:
    """Return the shape of a light; Mitsuba's rectangle is [-1, 1]², its disk has radius 1, both face +z."""
    mi = load_mitsuba()
    if isinstance(light, wrt.SphereLight):
        return {"type": "sphere", "center": list(light.center), "radius": light.radius}
    if light.two_sided:
        raise NotImplementedError("Mitsuba's area lights have one side")
    matrix = np.eye(4)
    if isinstance(light, wrt.RectangleLight):
        u, v = 0.5 * np.array(light.edge_u), 0.5 * np.array(light.edge_v)
        normal, middle = np.cross(u, v), np.array(light.origin) + u + v
        matrix[:3] = np.stack([u, v, normal / np.linalg.norm(normal), middle], axis=1)
        return {"type": "rectangle", "to_world": mi.ScalarTransform4f(matrix)}
    normal = np.array(light.normal)
    u = np.cross(normal, np.eye(3)[np.abs(normal).argmin()])
    u /= np.linalg.norm(u)
    axes = [light.radius * u, light.radius * np.cross(normal, u), normal, np.array(light.center)]
    matrix[:3] = np.stack(axes, axis=1)
    return {"type": "disk", "to_world": mi.ScalarTransform4f(matrix)}


def _environment(environment: wrt.ConstantEnvironment | wrt.ImageEnvironment) -> dict[str, Any]:
    mi = load_mitsuba()
    if isinstance(environment, wrt.ConstantEnvironment):
        return {"type": "constant", "radiance": _rgb(environment.radiance)}
    # Rows at v = j / 2H for all j hold the interpolated image exactly: every second one is a row of it.
    rows = np.pad(environment.pixels.astype(np.float64), ((1, 1), (0, 0), (0, 0)), mode="edge")
    height = len(environment.pixels)
    pixels = np.empty((2 * height + 1, *rows.shape[1:]))
    pixels[1::2] = rows[1:-1]
    pixels[0::2] = 0.5 * (rows[:-1] + rows[1:])
    axis = np.array(environment.rotation_axis)
    return {
        "type": "envmap",
        "bitmap": mi.Bitmap(pixels.astype(np.float32)),
        "scale": environment.scale,
        "to_world": mi.ScalarTransform4f()
        .rotate((axis / np.linalg.norm(axis)).tolist(), environment.rotation_degrees)
        .rotate([0, 1, 0], 180.0),
    }


def write_ply(mesh: wrt.Mesh, path: Path) -> None:
    """Write a mesh as a binary PLY file with its normals, texture coordinates and colours."""
    groups = (("x y z", mesh.vertices), ("nx ny nz", mesh.normals), ("u v", mesh.uvs), ("r g b", mesh.colors))
    names = [name for group, array in groups if array is not None for name in group.split()]
    arrays = [array for _, array in groups if array is not None]
    properties = "".join(f"property float {name}\n" for name in names)
    header = (
        f"ply\nformat binary_little_endian 1.0\nelement vertex {len(mesh.vertices)}\n{properties}"
        f"element face {len(mesh.faces)}\nproperty list uchar int vertex_indices\nend_header\n"
    )
    faces = np.empty(len(mesh.faces), dtype=[("count", "u1"), ("indices", "<i4", 3)])
    faces["count"] = 3
    faces["indices"] = mesh.faces
    path.write_bytes(header.encode() + np.hstack(arrays).astype("<f4").tobytes() + faces.tobytes())
