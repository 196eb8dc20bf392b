"""What the prims of a stage hold, in plain values; for the process in which Pixar's library reads a USD file."""

from __future__ import annotations

import contextlib
import math
import os
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from pxr import Ar, Sdf, Tf, Usd, UsdGeom, UsdShade

from wrt.io import memory_limits
from wrt.io.usd.process import ARRAY, PREVIEW

_SOLIDS = ("Cube", "Sphere", "Plane", "Cylinder", "Cone", "Capsule")
"""Shapes that triangles are made of."""

_READ_WITH_OTHERS = ("Material", "Shader", "GeomSubset", "NodeGraph")
"""Types that are read with the prims that use them."""

_GROUPS = ("Xform", "Scope", "SkelRoot", "")
"""Types that hold others."""

_OF_LIGHTS = tuple(
    f"inputs:{name}"
    for name in ("color", "intensity", "exposure", "normalize", "enableColorTemperature", "colorTemperature")
)

_OF_DOMES = (*_OF_LIGHTS, "inputs:texture:file", "inputs:texture:format")

_ATTRIBUTES: dict[str, tuple[str, ...]] = {
    "Mesh": ("points", "faceVertexCounts", "faceVertexIndices", "orientation", "holeIndices"),
    "Points": ("points",),
    "PointInstancer": ("protoIndices",),
    "Camera": (
        *("verticalAperture", "horizontalApertureOffset", "verticalApertureOffset"),
        *("projection", "focalLength", "fStop", "focusDistance"),
    ),
    "Cube": ("size",),
    "Sphere": ("radius",),
    "Plane": ("width", "length", "axis"),
    **dict.fromkeys(("Cylinder", "Cone", "Capsule"), ("radius", "height", "axis")),
    "SphereLight": (*_OF_LIGHTS, "inputs:radius", "treatAsPoint"),
    "RectLight": (*_OF_LIGHTS, "inputs:width", "inputs:height"),
    "DiskLight": (*_OF_LIGHTS, "inputs:radius"),
    "DistantLight": (*_OF_LIGHTS, "inputs:angle"),
    "DomeLight": _OF_DOMES,
    "DomeLight_1": (*_OF_DOMES, "poleAxis"),
}
"""The attributes of each type that are read."""

_OF_INSTANCES = (*("positions", "orientations", "orientationsf", "scales", "ids", "invisibleIds", "prototypes"),)
"""The properties of a point instancer that the library reads to compute places and masks."""

_READ_BY_LIBRARY = ("xformOp:", "!invert!xformOp:", "material:binding")
"""Beginnings of the names of other properties that the library reads."""

_CODES_PER_SECOND = 24.0
"""Time codes in a second where a file gives none."""

_ALL_AROUND = 180.0
"""Degrees from the axis of a light's cone up to which it lights everything."""

_SHORT = 16
"""Elements of a value up to which instances are compared by it, and not by where it is."""

_BYTES_PER_PLACE = 16 * 8

_BYTES_PER_PRIM = 1024
"""Memory of a prim's description; the prim itself takes about as much."""

_BYTES_PER_INSTANCE = 4096
"""Counted for a prim within an instance, which takes 0.1 ms to visit: this bounds the time to a few seconds."""


class _Prim:
    """A prim whose properties are read, and which of them were."""

    def __init__(self, prim: Any, *used: str) -> None:
        self.prim = prim
        self._used = {*used, "visibility", "purpose", "xformOpOrder"}

    def attribute(self, name: str) -> Any:
        """Return an attribute, which is used then."""
        self._used.add(name)
        return self.prim.GetAttribute(name)

    def use(self, *names: str) -> None:
        """Note that the library reads attributes."""
        self._used.update(names)

    def unused(self, time: Any) -> Iterator[str]:
        """Yield the kinds of properties that say something else than the schema does, and were not used."""
        prim, kind = self.prim, str(self.prim.GetTypeName())
        definition = prim.GetPrimDefinition()
        for name in prim.GetAuthoredPropertyNames():
            attribute = prim.GetAttribute(name)
            words = attribute.GetMetadata("allowedTokens") if attribute and name in self._used else None
            if words and (word := attribute.Get(time)) not in (None, *words):
                yield f"{kind}.{name} {str(word)!r}"
            if name in self._used or name.startswith(_READ_BY_LIBRARY):
                continue
            if prim.GetProperty(name).IsCustom() or (not kind and name not in definition.GetPropertyNames()):
                continue  # of no schema
            if not attribute:
                if prim.GetRelationship(name).GetTargets():
                    yield f"{kind}.{name}"
            elif attribute.GetConnections():
                yield f"{kind}.{name}"
            else:
                value = attribute.Get(time)
                if name.endswith("shaping:cone:angle") and isinstance(value, float) and value >= _ALL_AROUND:
                    continue
                if value is not None and value != definition.GetAttributeFallbackValue(name):
                    yield f"{kind}.{name}"


def _metres_per_unit(stage: Any) -> float | None:
    """Return the unit of length of a stage, or None if it is not a number; some files have it in single precision."""
    with contextlib.suppress(Tf.ErrorException):  # of another type
        return float(UsdGeom.GetStageMetersPerUnit(stage))
    unit = stage.GetRootLayer().pseudoRoot.GetInfo("metersPerUnit")
    return float(unit) if isinstance(unit, (int, float)) and 0.0 < unit < math.inf else None


def times_of(stage: Any, layers: list[Any]) -> tuple[float, float, float] | None:
    """Return the first and the last time code of a stage and their number in a second, or None if nothing changes."""
    samples = {time for layer in layers for time in layer.ListAllTimeSamples() if math.isfinite(time)}
    if not samples:
        return None
    first, last = min(samples), max(samples)
    given = stage.GetStartTimeCode(), stage.GetEndTimeCode()
    if stage.HasAuthoredTimeCodeRange() and all(map(math.isfinite, given)):
        first, last = given
    rate = stage.GetTimeCodesPerSecond()
    return first, max(first, last), rate if 0.0 < rate < math.inf else _CODES_PER_SECOND


class Description:
    """Describes a stage at a time as what JSON holds, and arrays.

    Attributes:
        content: `up` and `metersPerUnit` of the stage; `animation`, its first and last second; `prims` in order, each
            with its `kind`, `path` and `place` (row of `places`); `shapes` by the key that prims which share one have;
            `prototypes` of instancers by path; `materials` by path, as the name of their shader in `nodes`;
            `left_out`, which are warnings; `unused`, the number of each kind of content that is left out.
    """

    def __init__(self, stage: Any, layers: list[Any], arrays: list[memoryview[Any]], seconds: float | None) -> None:
        self._stage, self._arrays = stage, arrays
        times = times_of(stage, layers)
        self._time = Usd.TimeCode(times[0] + (seconds or 0.0) * times[2]) if times else Usd.TimeCode.Default()
        self._cache = UsdGeom.XformCache(self._time)
        self._places = bytearray()
        self._classes: dict[str, tuple[bool, bool]] = {}
        self._unused: Counter[str] = Counter()
        self._described: set[str] = set()
        self._inherited_by: dict[str, str] = {}
        self.content: dict[str, Any] = {"shapes": {}, "prototypes": {}, "materials": {}, "nodes": {}, "left_out": []}
        self.content["animation"] = [0.0, (times[1] - times[0]) / times[2]] if times and times[1] > times[0] else None
        self.content["up"] = str(UsdGeom.GetStageUpAxis(stage))
        self.content["metersPerUnit"] = _metres_per_unit(stage)
        self.content["prims"] = self._prims(Usd.PrimRange(stage.GetPseudoRoot(), Usd.TraverseInstanceProxies()))
        self.content["places"] = self._array(memoryview(self._places).cast("d"))
        self.content["unused"] = self._unused

    def _prims(self, prims: Any) -> list[dict[str, Any]]:
        """Describe the prims of a range that are drawn, light or look."""
        found: list[dict[str, Any]] = []
        walk = iter(prims)
        for each in walk:
            is_proxy = each.IsInstanceProxy()
            memory_limits.take(memory_limits.COMPOSED, _BYTES_PER_INSTANCE if is_proxy else _BYTES_PER_PRIM)
            kind = str(each.GetTypeName())
            if kind not in self._classes:  # asking takes as long as all else
                self._classes[kind] = each.IsA(UsdGeom.Imageable), each.IsA(UsdGeom.PointInstancer)
            is_shown, is_instancer = self._classes[kind]
            prim = _Prim(each)
            if is_shown and self._is_hidden(prim):
                walk.PruneChildren()
                continue
            values: dict[str, Any] = {}
            if is_instancer:
                values = self._instances(prim)
                walk.PruneChildren()
            elif kind in ("Mesh", "Points", *_SOLIDS):
                values = {"shape": self._shape(prim, kind)}
            elif kind in _ATTRIBUTES:  # a camera or a light
                values = {"values": self._values(prim, kind)}
            elif kind in _READ_WITH_OTHERS:
                continue
            elif kind not in _GROUPS:
                self._unused[f"a prim of type {kind}"] += 1
                continue
            if values:
                drawn_as = "PointInstancer" if is_instancer else "Shape" if "shape" in values else kind
                found.append({"kind": drawn_as, "path": str(each.GetPath()), "place": self._place(each), **values})
            self._account(prim)
        return found

    def _is_hidden(self, prim: _Prim) -> bool:
        """Return whether an imageable prim and those below it are not to be rendered."""
        if str(prim.attribute("visibility").Get(self._time)) == "invisible":
            return True
        return str(prim.attribute("purpose").Get(self._time)) in ("guide", "proxy")

    def _account(self, prim: _Prim) -> None:
        """Count the unused properties of a prim, unless it is an instance of a prim that was counted."""
        key = _key(prim.prim)
        if key not in self._described:
            self._described.add(key)
            self._unused.update(prim.unused(self._time))
            if prim.prim.HasAuthoredMetadata("clips"):
                self._unused["the metadata clips"] += 1

    def _place(self, prim: Any) -> int:
        """Return the number of a new place, which is where a prim is."""
        self._places += memoryview(self._cache.GetLocalToWorldTransform(prim)).cast("B")
        return len(self._places) // _BYTES_PER_PLACE - 1

    def _array(self, values: memoryview[Any]) -> dict[str, int]:
        memory_limits.take(memory_limits.MESHES, values.nbytes)
        self._arrays.append(values)
        return {ARRAY: len(self._arrays) - 1}

    def _plain(self, value: Any) -> Any:
        """Return a value, or None if it is none of a known type."""
        if value is None or isinstance(value, (bool, int, float, str)):
            return value
        if isinstance(value, Sdf.AssetPath):
            return {"asset": str(value.resolvedPath or value.path)}
        with contextlib.suppress(TypeError):  # of arrays of texts, and of types of no schema
            return self._array(memoryview(value))
        return None

    def _value(self, attribute: Any) -> Any:
        """Return the value of an attribute; the path of a file is relative to the layer that gives it."""
        value = attribute.Get(self._time)
        if isinstance(value, Sdf.AssetPath) and value.path and not value.resolvedPath:
            layers = [spec.layer for spec in attribute.GetPropertyStack(self._time) if spec.layer.realPath]
            if layers and not Ar.IsPackageRelativePath(layers[0].identifier):
                return {"asset": beside(layers[0], value.path)}
        return self._plain(value)

    def _values(self, prim: _Prim, kind: str) -> dict[str, Any]:
        attributes = {name: prim.attribute(name) for name in _ATTRIBUTES[kind]}
        for name, attribute in attributes.items():
            if name.startswith("inputs:") and not attribute.HasAuthoredValue():
                before = prim.attribute(name.removeprefix("inputs:"))  # its name before USD 21.02
                attributes[name] = before if before and before.HasAuthoredValue() else attribute
        return {name: self._value(attribute) for name, attribute in attributes.items() if attribute}

    def _shape(self, prim: _Prim, kind: str) -> str:
        """Describe a mesh, points or a solid, unless it has been; return its key, which instances of it have too."""
        key = _key(prim.prim) + self._inherited(prim.prim)
        if key not in self.content["shapes"]:
            primvars = UsdGeom.PrimvarsAPI(prim.prim)
            shape: dict[str, Any] = {
                "kind": kind,
                "path": str(prim.prim.GetPath()),
                "values": self._values(prim, kind),
                "material": self._material(prim.prim),
                "colors": [[name, self._primvar(primvar)] for name, primvar in _colors(primvars).items()],
                "opacities": self._primvar(primvars.FindPrimvarWithInheritance("displayOpacity")),
            }
            if kind == "Mesh":
                shape |= self._of_mesh(prim, primvars)
            elif kind == "Points":
                widths = self._plain(prim.attribute("widths").Get(self._time))
                own = [widths, str(UsdGeom.Points(prim.prim).GetWidthsInterpolation())]
                shape["widths"] = self._primvar(primvars.GetPrimvar("widths")) or own
            self.content["shapes"][key] = shape
        return key

    def _inherited(self, prim: Any) -> str:
        """Return a text of what a prim inherits from beyond the prototype that instances share: material and values."""
        root = prim
        while root.IsInstanceProxy():
            root = root.GetParent()
        if root == prim:
            return ""
        path = str(root.GetPath())
        if path not in self._inherited_by:
            materials = _bound_to(root)
            values = {}
            for each in UsdGeom.PrimvarsAPI(root).FindInheritablePrimvars():
                value = each.Get(self._time)
                is_short = len(value) <= _SHORT if hasattr(value, "__len__") else True
                values[str(each.GetName())] = str(value) if is_short else str(each.GetAttr().GetPath())
            found = [_key(each.GetPrim()) for each in materials], values
            self._inherited_by[path] = f" {found}" if materials or values else ""
        return self._inherited_by[path]

    def _of_mesh(self, prim: _Prim, primvars: Any) -> dict[str, Any]:
        scheme = prim.attribute("subdivisionScheme")
        normals = self._plain(prim.attribute("normals").Get(self._time))
        interpolation = str(UsdGeom.Mesh(prim.prim).GetNormalsInterpolation())
        subsets = []
        for subset in UsdShade.MaterialBindingAPI(prim.prim).GetMaterialBindSubsets():
            part = _Prim(subset.GetPrim(), "familyName", "familyType")
            if str(subset.GetElementTypeAttr().Get(self._time)) != "face":
                self._account(part)
                continue
            subsets.append([self._plain(part.attribute("indices").Get(self._time)), self._material(part.prim)])
            self._account(part)
        return {
            "subdivided": scheme.HasAuthoredValue() and str(scheme.Get(self._time)) != "none",
            "faceted": scheme.HasAuthoredValue() and str(scheme.Get(self._time)) == "none",
            # The first that is valid counts.
            "normals": [self._primvar(primvars.GetPrimvar("normals")), [normals, interpolation]],
            "uvs": [[name, self._primvar(primvar)] for name, primvar in _coordinates(primvars).items()],
            "subsets": subsets,
        }

    def _primvar(self, primvar: Any) -> list[Any] | None:
        """Return the values of a primvar and their interpolation, or None."""
        if not primvar or not primvar.HasValue():
            return None
        return [self._plain(primvar.ComputeFlattened(self._time)), str(primvar.GetInterpolation())]

    def _instances(self, prim: _Prim) -> dict[str, Any]:
        """Return the places of a point instancer, the prototype of each, and which of them are shown."""
        instancer = UsdGeom.PointInstancer(prim.prim)
        prim.use(*_OF_INSTANCES)
        exclude, all_of_them = UsdGeom.PointInstancer.ExcludeProtoXform, UsdGeom.PointInstancer.IgnoreMask
        places = instancer.ComputeInstanceTransformsAtTime(self._time, self._time, exclude, all_of_them)
        return {
            "values": self._values(prim, "PointInstancer"),
            "instances": self._plain(places),
            "colors": self._primvar(UsdGeom.PrimvarsAPI(prim.prim).GetPrimvar("displayColor")),
            "shown": [bool(each) for each in instancer.ComputeMaskAtTime(self._time)],
            "prototypes": [self._prototype(prim.prim, root) for root in instancer.GetPrototypesRel().GetTargets()],
        }

    def _prototype(self, instancer: Any, root: Any) -> str | None:
        """Describe a prototype, unless it has been, and return its path; None if there is none."""
        prim = self._stage.GetPrimAtPath(root)
        if not prim:
            self.content["left_out"].append(f"{instancer.GetPath()}: its prototype {root} is not there; left out")
            return None
        path = str(root)
        if path not in self.content["prototypes"]:
            prototype: dict[str, Any] = {"above": self._place(prim.GetParent())}
            self.content["prototypes"][path] = prototype
            # Prototypes are often below a prim that is not defined, so that they are drawn by instancers alone.
            predicate = Usd.PrimIsActive & Usd.PrimIsLoaded & ~Usd.PrimIsAbstract
            prototype["prims"] = self._prims(Usd.PrimRange(prim, Usd.TraverseInstanceProxies(predicate)))
        return path

    # Materials -------------------------------------------------------------------------------------

    def _material(self, prim: Any) -> str | None:
        """Describe the material that is bound to a prim, and return its path; None if there is none."""
        materials = _bound_to(prim)
        if not materials:
            return None
        previews = (each for each in materials if _identity(each.ComputeSurfaceSource()[0]) == PREVIEW)
        bound = next(previews, materials[0])
        path = str(bound.GetPath())
        if path not in self.content["materials"]:
            shader, _, _ = bound.ComputeSurfaceSource()
            self.content["materials"][path] = self._node(shader.GetPrim()) if shader else None
            displaced, _, _ = bound.ComputeDisplacementSource()  # mostly the same, where the input is accounted for
            is_same = bool(displaced and shader and displaced.GetPath() == shader.GetPath())
            self._account(_Prim(bound.GetPrim(), "outputs:surface", *["outputs:displacement"] * is_same))
        return path

    def _node(self, prim: Any) -> str:
        """Describe a shader and all shaders connected to it, and return its path."""
        nodes, waiting = self.content["nodes"], [prim]
        while waiting:
            shader = UsdShade.Shader(waiting.pop())
            path = str(shader.GetPath())
            if path in nodes:
                continue
            nodes[path] = {"id": _identity(shader), "inputs": {}, "sources": {}}
            for shader_input in UsdShade.ConnectableAPI(shader).GetInputs():
                name = str(shader_input.GetBaseName())
                for attribute in UsdShade.Utils.GetValueProducingAttributes(shader_input)[:1]:
                    if UsdShade.Utils.GetType(attribute.GetName()) == UsdShade.AttributeType.Input:
                        nodes[path]["inputs"][name] = self._value(attribute)
                        continue
                    source, output = attribute.GetPrim(), UsdShade.Output(attribute).GetBaseName()
                    nodes[path]["sources"][name] = [str(source.GetPath()), str(output)]
                    waiting.append(source)
        return str(prim.GetPath())


def _key(prim: Any) -> str:
    """Return the path of a prim, or of what instances of it share."""
    return str((prim.GetPrimInPrototype() if prim.IsInstanceProxy() else prim).GetPath())


def _bound_to(prim: Any) -> list[Any]:
    """Return the materials that are bound to a prim for final pictures and for previews."""
    api, purposes = UsdShade.MaterialBindingAPI(prim), (UsdShade.Tokens.full, UsdShade.Tokens.preview)
    return [bound for purpose in purposes if (bound := api.ComputeBoundMaterial(purpose)[0])]


def _identity(shader: Any) -> str:
    """Return the type of a shader, or "" if there is none."""
    identity = shader.GetPrim().GetAttribute("info:id") if shader else None
    return str(identity.Get() or "") if identity else ""


def _coordinates(primvars: Any) -> dict[str, Any]:
    """Return primvars that may be texture coordinates by their names, first "st", then others of that role."""
    found = {}
    for each in primvars.FindPrimvarsWithInheritance():
        name, kind = str(each.GetPrimvarName()), each.GetTypeName()
        rank = 0 if name == "st" else 1 if kind.role == "TextureCoordinate" else 2
        if rank < 2 or str(kind.scalarType) in ("float2", "double2", "half2"):
            found[name] = rank, each
    return {name: each for name, (_, each) in sorted(found.items(), key=lambda item: item[1][0])}


def _colors(primvars: Any) -> dict[str, Any]:
    """Return primvars that may be colours by their names."""
    found = primvars.FindPrimvarsWithInheritance()
    kinds = ("Color", "")
    three = [
        each for each in found if str(each.GetTypeName().scalarType) in ("color3f", "color3d", "color3h", "float3")
    ]
    return {str(each.GetPrimvarName()): each for each in three if each.GetTypeName().role in kinds}


def beside(layer: Any, name: str) -> str:
    """Return the path of a file that a layer names, whether or not it exists."""
    return os.path.normpath(Path(outer(layer.realPath)).parent / name)


def outer(path: str) -> str:
    """Return the path of a USDZ archive where a path leads into one."""
    return str(Ar.SplitPackageRelativePathOuter(path)[0])
