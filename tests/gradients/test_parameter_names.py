"""Every attribute of a material, a light, a medium or an environment is a parameter, or there is a reason."""

import dataclasses

import numpy as np

import wrt
from wrt.scene.lights import LIGHTS
from wrt.scene.materials import MATERIALS

WHY_NOT = {
    "it is no number": ("name", "group", "distribution", "masking", "fresnel", "falloff", "metal", "measurement"),
    "it chooses a kernel or what a body is": ("multiple_bounces", "nonlinear", "thin_walled", "two_sided", "priority"),
    "it is the probability of a choice": ("opacity", "mix.weight"),
    "it moves directions, and so all that a path finds after them": (*("normal_map", "coat_normal_map", "medium.g"),),
    "a row of slots is overwritten for each channel, whose adjoint Warp gets wrong": ("dispersion",),
    "a table is made from it": (
        *("rough-plastic.alpha", "rough-plastic.ior", "rough-plastic.exterior_ior"),
        *("imageenvironment.scale", "sphericalharmonicsenvironment.scale"),
    ),
    "it moves light, or an edge of it": (
        *("position", "direction", "up", "origin", "edge_u", "edge_v", "center", "normal", "radius"),
        *("inner_degrees", "outer_degrees", "fov_degrees", "angle_degrees", "rotation_degrees", "rotation_axis"),
    ),
    "quotients do not prove it": ("principled.film", "principled.film_thickness", "principled.film_ior"),
    "it is the emission of a shape, under that name": ("emissive.radiance",),
    "densities in a grid have none": ("density",),
}

P = wrt.Principled
BODY = {"transmission": 0.6, "coat": 0.2, "sheen_color": 0.3}
BURLEY = {"anisotropy": 0.3, "transmission": 0.4, "coat": 0.5}
FOG = wrt.Medium((0.3, 0.2, 0.5), (0.1, 0.4, 0.2), emission=(0.1, 0.0, 0.2))
PIXELS = np.full((2, 4, 3), 0.5, np.float32)
UP, DOWN = (0.0, 2.0, 0.0), (0.3, -1.0, 0.2)

MATERIALS_WITH_ALL = [
    *(cls.example() for cls in MATERIALS.values()),
    P((0.5, 0.4, 0.3), 0.3, 0.5, anisotropy=0.3, emission=0.5, interior=FOG, **BODY),
    wrt.Glossy(exponent=20.0),
    wrt.Conductor(film_thickness=200.0),
    wrt.Conductor(f0=0.5),
    wrt.RoughConductor(film_thickness=200.0),
    wrt.RoughConductor(f0=0.5),
    wrt.Burley(**BURLEY, interior=FOG),
    wrt.Burley(thin_walled=True, diffuse_transmission=0.3),
    *(cls(interior=FOG) for cls in (wrt.Dielectric, wrt.RoughDielectric, wrt.Null)),
]
LAMPS = [
    *(wrt.PointLight(UP, **{amount: 1.0}) for amount in ("intensity", "power", "color")),
    *(wrt.SpotLight(UP, DOWN, **{amount: 1.0}) for amount in ("intensity", "power", "color")),
    wrt.SpotLight(UP, DOWN, 1.0, texture=wrt.ImageTexture(PIXELS)),
    *(wrt.ProjectorLight(UP, DOWN, **{amount: 1.0}) for amount in ("irradiance", "color")),
    wrt.ProjectorLight(UP, DOWN, texture=wrt.ImageTexture(PIXELS)),
    *(wrt.DirectionalLight(DOWN, **{amount: 1.0}) for amount in ("irradiance", "color")),
    *(wrt.RectangleLight(UP, (1, 0, 0), (0, 0, 1), **{amount: 1.0}) for amount in ("radiance", "power")),
    *(wrt.DiskLight(UP, DOWN, **{amount: 1.0}) for amount in ("radiance", "power")),
    *(wrt.SphereLight(UP, **{amount: 1.0}) for amount in ("radiance", "power")),
]
SKIES = [
    wrt.ConstantEnvironment(0.5),
    wrt.ImageEnvironment(PIXELS),
    wrt.SphericalHarmonicsEnvironment(np.ones((4, 3))),
]


def names_in(owner, **options):
    """Return the attributes of something in a scene that are parameters."""
    scene = wrt.Scene(**options)
    if isinstance(owner, wrt.scene.materials.Material):
        scene.add(wrt.quad((0, 0, 0), (1, 0, 0), (0, 1, 0)), material=owner, name="it")
    elif isinstance(owner, wrt.scene.lights.Light):
        scene.add_light(dataclasses.replace(owner, name="it"))
    prefixes = ("it.", "medium.", "environment.")
    found = {name.split(".")[1] for name in wrt.parameters(scene) if name.startswith(prefixes)}
    return found | ({"pixels"} if "texels" in found else set())


def test_every_attribute_is_a_parameter_or_has_a_reason_not_to_be():
    assert {type(each) for each in MATERIALS_WITH_ALL} == set(MATERIALS.values())
    assert {type(each) for each in LAMPS} == set(LIGHTS.values())
    parameters = {}
    for each in (*MATERIALS_WITH_ALL, *LAMPS):
        parameters.setdefault(type(each), set()).update(names_in(each))
    parameters[wrt.Medium] = names_in(None, medium=FOG)
    parameters |= {type(each): names_in(each, environment=each) for each in SKIES}
    reasons = {name for names in WHY_NOT.values() for name in names}
    used = set()
    for cls, names in parameters.items():
        kind = getattr(cls, "type_name", "") or cls.__name__.lower()
        for field in dataclasses.fields(cls):
            here = {field.name, f"{kind}.{field.name}"} & reasons
            used |= here
            assert (field.name in names) != bool(here), f"{kind}.{field.name}"
    assert used == reasons
