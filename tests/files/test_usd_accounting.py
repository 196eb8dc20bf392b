"""Every property that the schemas of USD give to what is drawn changes the scene, or is excused or warned of."""

import io
import warnings
from collections.abc import Callable
from fnmatch import fnmatchcase
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from conftest import ROOT
from support.same_scenes import differences

import wrt
from wrt.errors import InputWarning
from wrt.io import memory_limits
from wrt.io.load_mesh import load_file
from wrt.io.usd import reader
from wrt.io.usd.process import read_message, write_message

pytest.importorskip("pxr")
from pxr import Gf, Sdf, Sdr, Tf, Usd, UsdGeom, UsdShade

BASE = (ROOT / "tests/scenes/meshes/painted.usda").read_text("utf-8")
"""Two triangles of a material whose image is placed by a transform."""

LIGHT = "bool inputs:enableColorTemperature = 1\nfloat inputs:colorTemperature = 3000\n"

PRIMS = {
    "PointInstancer": """
        int[] protoIndices = [0, 0]
        point3f[] positions = [(0, 0, 0), (9, 0, 0)]
        int64[] invisibleIds = [1]
        rel prototypes = </p/a>
        def Cube "a" {}
        def Sphere "b" {}
    """,
    "Camera": "float fStop = 2\nfloat focusDistance = 5",
    "SphereLight": LIGHT,
    "RectLight": f"{LIGHT}float inputs:width = 2",
    "DiskLight": LIGHT,
    "DistantLight": LIGHT,
    **dict.fromkeys(("DomeLight", "DomeLight_1"), f"{LIGHT}asset inputs:texture:file = @ramp.png@"),
    "Points": "point3f[] points = [(0, 0, 0), (9, 0, 0)]\nfloat[] widths = [1, 2]",
    **dict.fromkeys(("Mesh", "Cube", "Sphere", "Plane", "Cylinder", "Cone", "Capsule"), ""),
}
"""A prim of each type that is drawn, lights or looks, so that its properties have an effect."""

APPLIED = (
    *("ShapingAPI", "ShadowAPI", "VisibilityAPI", "MotionAPI", "GeomModelAPI", "LightAPI", "LightListAPI"),
    *("MeshLightAPI", "SkelBindingAPI"),
)
"""Schemas that may be applied to any prim."""

PLAIN: dict[str, Any] = {
    **dict.fromkeys(("float", "double", "half"), 0.37),
    "int": 1,
    "asset": Sdf.AssetPath("none.png"),
    "float2": Gf.Vec2f(0.25, 0.75),
    **dict.fromkeys(("float3", "color3f", "normal3f"), Gf.Vec3f(0.1, 0.2, 0.3)),
    "float4": Gf.Vec4f(0.1, 0.2, 0.3, 0.4),
    "matrix4d": Gf.Matrix4d(2.0),
    "string": "other",
    "int[]": [0],
    "int64[]": [0],
    "float[]": [0.5],
    **dict.fromkeys(("color3f[]", "vector3f[]", "point3f[]", "float3[]", "normal3f[]"), [Gf.Vec3f(0.3, 0.2, 0.1)] * 2),
    "float4[]": [Gf.Vec4f(1, 2, 3, 4)],
    "quath[]": [Gf.Quath(0.0, 1.0, 0.0, 0.0)] * 2,
    "quatf[]": [Gf.Quatf(0.0, 0.6, 0.8, 0.0)] * 2,
    "token[]": ["a"],
    "pathExpression": Sdf.PathExpression("/p"),
}
"""A value of each type."""

SPECIAL: dict[str, Any] = {
    "faceVertexCounts": [6],
    "faceVertexIndices": [0, 1, 2, 3, 5, 4],
    "holeIndices": [1],
    "points": [Gf.Vec3f(each, each % 2, 7) for each in range(6)],
    "normals": [Gf.Vec3f(0, 0.6, 0.8)] * 6,
    "ids": [1, 2],
    "invisibleIds": [0],
    "protoIndices": [0],
    "scales": [Gf.Vec3f(2, 2, 2)] * 2,
    "xformOpOrder": ["xformOp:translate", "xformOp:rotateX"],
    "displacement": 0.5,
    "texture:format": "angular",
    "enableColorTemperature": False,
    "colorTemperature": 9000.0,
    "treatAsPoint": True,
    "poleAxis": "Z",
    "useSpecularWorkflow": 1,
    "primvars:displayColor": [Gf.Vec3f(0.3, 0.2, 0.1)],
    "purpose": "guide",
    "visibility": "invisible",
    "opacityThreshold": 0.6,
    "varname": "st2",
}
"""Values of properties that not every value of their type suits, by their names."""


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """Return a folder with an image, where files are described without another process."""
    from wrt.io.usd.prims import Description

    def described(path, time=None):
        arrays = []
        stage = Usd.Stage.Open(str(path))
        with memory_limits.one_load():
            content = Description(stage, stage.GetUsedLayers(), arrays, time).content
        stream = io.BytesIO()
        write_message(stream, {**content, "notes": []}, arrays)
        return read_message(stream.getvalue())

    monkeypatch.setattr(reader, "description", described)
    ramp = np.linspace(0.2, 1.0, 4 * 4 * 3).reshape(4, 4, 3)
    wrt.save_image(tmp_path / "ramp.png", ramp)
    return tmp_path


def loaded(folder: Path, stage: Any) -> tuple[wrt.Scene, list[str]]:
    """Return the scene of a stage, and what was warned of."""
    path = folder / "stage.usda"
    path.unlink(missing_ok=True)
    stage.GetRootLayer().Export(str(path))
    Sdf.Layer.FindOrOpen(str(path)).Reload()
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("ignore", UserWarning)  # of the radius of points
        warnings.simplefilter("always", InputWarning)
        try:
            scene = load_file(path)
        except wrt.InputError as error:
            return wrt.Scene(), [str(error)]
        return scene, [str(each.message) for each in caught]


def stage_of(text: str) -> Any:
    stage = Usd.Stage.CreateInMemory()
    stage.GetRootLayer().ImportFromString(text)
    return stage


def unaccounted(folder: Path, text: str, kind: str, add: Callable[[Any], None], name: str) -> bool:
    """Return whether a property that `add` adds to a stage changes nothing and is neither excused nor warned of."""
    if any(fnmatchcase(f"{kind}.{name}", pattern) for pattern in reader.WITHOUT_EFFECT):
        return False
    before, messages = loaded(folder, stage_of(text))
    stage = stage_of(text)
    add(stage)
    after, new_messages = loaded(folder, stage)
    return messages == new_messages and not differences(before, after)


@pytest.mark.parametrize("kind", PRIMS)
def test_each_property_of_a_prim_is_used_excused_or_warned_of(kind, folder):
    registry = Usd.SchemaRegistry()
    body = BASE[BASE.index("{") + 1 : BASE.index("}\ndef Material")] if kind == "Mesh" else PRIMS[kind]
    text = f'{BASE}def {kind} "p" {{\n{body}\nfloat xformOp:rotateX = 30\ndouble3 xformOp:translate = (0, 3, 0)\n}}\n'
    lost = []
    applied = APPLIED if kind in ("Mesh", "SphereLight") else ()
    schemas = registry.FindConcretePrimDefinition(kind), *map(registry.FindAppliedAPIPrimDefinition, applied)
    specs = {name: schema.GetSchemaPropertySpec(name) for schema in schemas for name in schema.GetPropertyNames()}
    for name, spec in specs.items():

        def add(stage, name=name, spec=spec):
            prim = stage.GetPrimAtPath("/p")
            if isinstance(spec, Sdf.RelationshipSpec):
                prim.CreateRelationship(name, custom=False).SetTargets(["/p/b"])
            else:
                prim.CreateAttribute(name, spec.typeName, custom=False).Set(value_of(name, spec))

        has_value = isinstance(spec, Sdf.RelationshipSpec) or spec.typeName != "opaque"
        if has_value and unaccounted(folder, text, kind, add, name):
            lost.append(name)
    assert lost == []


def value_of(name: str, spec: Any) -> Any:
    base = name.removeprefix("inputs:")
    if base in SPECIAL:
        return SPECIAL[base]
    if spec.typeName == "bool":
        return not spec.default
    if spec.typeName == "token":
        return next((each for each in spec.allowedTokens or () if each != spec.default), "other")
    return PLAIN[str(spec.typeName)]


@pytest.mark.parametrize("kind", ["UsdPreviewSurface", "UsdUVTexture", "UsdTransform2d", "UsdPrimvarReader_float2"])
def test_each_input_of_a_shader_is_used_excused_or_warned_of(kind, folder):
    """And each word of it; "presence" is what opacity means without a word, and the file is needed."""
    node = Sdr.Registry().GetShaderNodeByIdentifier(kind)
    lost = []
    for name in node.GetShaderInputNames():
        text = BASE
        if name == "specularColor":
            text = text.replace("float inputs:opacity = 0.5", "int inputs:useSpecularWorkflow = 1")
        if kind == "UsdUVTexture" and name == "fallback":
            text = text.replace("@ramp.png@", "@@")
        declared = node.GetShaderInput(name)
        type_name = declared.GetTypeAsSdfType().GetSdfType()
        stage = stage_of(text)
        known = UsdShade.Shader(stage.GetPrimAtPath(f"/M/{kind}")).GetInput(name)
        if known and known.HasConnectedSource():
            continue
        for value in [word for word, _ in declared.GetOptions()] or [SPECIAL.get(name, PLAIN.get(str(type_name)))]:

            def add(stage, name=name, type_name=type_name, value=value):
                UsdShade.Shader(stage.GetPrimAtPath(f"/M/{kind}")).CreateInput(name, type_name).Set(value)

            if value not in (declared.GetDefaultValue(), known and known.Get()) and unaccounted(
                folder, text, kind, add, name
            ):
                lost.append(f"{name} {value}")
    assert lost == ["opacityMode presence"] * (kind == "UsdPreviewSurface")


@pytest.mark.parametrize(
    ("kind", "text", "expected"),
    [
        ("Mesh", 'uniform token orientation = "inside"', "Mesh.orientation 'inside'"),
        ("Mesh", 'token visibility = "faint"', "Mesh.visibility 'faint'"),
        ("Cone", 'uniform token axis = "W"', "Cone.axis 'W'"),
        ("Camera", 'token projection = "fisheye"', "Camera.projection 'fisheye'"),
        ("Mesh", "float[] primvars:displayOpacity = [0.5, 1, 1]", ""),
        (
            "Mesh",
            'color3f[] primvars:displayColor = [(1, 0, 0)] (\ninterpolation = "vertex"\n)',
            "a primvar displayColor",
        ),
        ("Mesh", 'texCoord2f[] primvars:st = [(1, 0)] (\ninterpolation = "edge"\n)', "a primvar st"),
        ("Mesh", "normal3f[] normals = [(0, 0, 1)]", "a primvar normals"),
        ("Points", "float[] widths = [1, 0, 1]", "a width of Points that is not positive"),
    ],
)
def test_words_and_values_that_do_not_fit_are_named(kind, text, expected, folder):
    mesh = "int[] faceVertexCounts = [3]\nint[] faceVertexIndices = [0, 1, 2]\n" * (kind == "Mesh")
    points = "point3f[] points = [(0, 0, 0), (9, 0, 0), (0, 9, 0)]\n" * (kind in ("Mesh", "Points"))
    _, messages = loaded(folder, stage_of(f'{BASE}def {kind} "p" {{\n{mesh}{points}{text}\n}}'))
    found = [message.partition(": ")[2] for message in messages]
    assert [message for message in found if not message.startswith(expected or ".")] == []
    assert bool(found) == bool(expected)


def test_types_that_are_not_drawn_are_named_once(folder):
    stage = stage_of(
        f'{BASE}def BasisCurves "a" {{}}\ndef BasisCurves "b" {{}}\ndef Unheard "c" {{}}\ndef Scope "d" {{}}'
    )
    _, messages = loaded(folder, stage)
    assert [message.partition(": ")[2] for message in messages] == [
        "a prim of type BasisCurves is unknown to wrt and left out (2 times)",
        "a prim of type Unheard is unknown to wrt and left out",
    ]


def test_a_unit_of_length_may_be_in_single_precision(folder, monkeypatch):
    def raising(stage: Any) -> float:
        raise Tf.ErrorException

    stage = stage_of(BASE)
    stage.SetMetadata("metersPerUnit", 0.25)
    expected, _ = loaded(folder, stage)
    monkeypatch.setattr(UsdGeom, "GetStageMetersPerUnit", raising)  # as the library does where it is
    scene, messages = loaded(folder, stage)
    assert not messages
    assert not differences(expected, scene)
