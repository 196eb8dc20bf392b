"""The process in which Pixar's library reads a USD file. It sends a plain description for the readers beside it.

A layer names other files, which composing opens, and a few references can multiply prims without end. So each layer is
checked before the library opens it; before they are composed, the process gives up opening files at all; and its memory
is limited relative to the size of the files. The library does not ask before it takes memory: the process ends then.
"""

from __future__ import annotations

import contextlib
import os
import resource
import sys
from pathlib import Path
from typing import Any

from pxr import Ar, Sdf, Tf, Usd, UsdGeom, UsdShade, UsdUtils, Work

from wrt.errors import InputError
from wrt.io import memory_limits
from wrt.io.safe_read import confined_to, require_file, require_inside
from wrt.io.usd.process import SECONDS, SECONDS_PER_MEGABYTE, write_message

_SUFFIXES = ("usd", "usda", "usdc", "usdz")

_SOLIDS = ("Cube", "Sphere", "Plane", "Cylinder", "Cone", "Capsule")
"""Shapes that triangles are made of."""

_SILENT = ("Xform", "Scope", "Material", "Shader", "GeomSubset", "NodeGraph", "SkelRoot", "")
"""Types that hold others, or are read with the prims that use them."""

_OF_LIGHTS = tuple(
    f"inputs:{name}"
    for name in ("color", "intensity", "exposure", "normalize", "enableColorTemperature", "colorTemperature")
)

_ATTRIBUTES: dict[str, tuple[str, ...]] = {
    "Mesh": ("points", "faceVertexCounts", "faceVertexIndices", "orientation"),
    "PointInstancer": ("protoIndices",),
    "Camera": ("verticalAperture", "projection", "focalLength", "fStop", "focusDistance"),
    "Cube": ("size",),
    "Sphere": ("radius",),
    "Plane": ("width", "length", "axis"),
    **dict.fromkeys(("Cylinder", "Cone", "Capsule"), ("radius", "height", "axis")),
    "SphereLight": (*_OF_LIGHTS, "inputs:radius", "treatAsPoint"),
    "RectLight": (*_OF_LIGHTS, "inputs:width", "inputs:height"),
    "DiskLight": (*_OF_LIGHTS, "inputs:radius"),
    "DistantLight": (*_OF_LIGHTS, "inputs:angle"),
    "DomeLight": (*_OF_LIGHTS, "inputs:texture:file"),
}
"""The attributes of each type that are read."""

_BYTES_PER_PRIM = 1024
"""Memory of a prim's description; the prim itself takes about as much."""

_BYTES_PER_INSTANCE = 4096
"""Counted for a prim within an instance, which takes 0.1 ms to visit: this bounds the time to a few seconds."""

_THREADS = 4
"""Threads of Pixar's library at most. The stacks of more, 6 MB each, would count as memory of prims."""

_NOW = Usd.TimeCode.Default()


def main() -> None:
    """Read the file `sys.argv[1]`, confined to the folder `sys.argv[2]` unless that is empty; send what it holds."""
    path, folder = Path(sys.argv[1]), Path(sys.argv[2]) if sys.argv[2] else None
    result = os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)  # what the library prints
    _limit(resource.RLIMIT_CORE, 0)
    _limit(resource.RLIMIT_FSIZE, 0)
    arrays: list[memoryview[Any]] = []
    content: dict[str, Any]
    try:
        with confined_to(folder), memory_limits.one_load():
            content = _content(path, arrays)
    except InputError as error:
        content, arrays = {"error": str(error)}, []
    except UnicodeDecodeError:
        content, arrays = {"error": f"{path}: not a USD file that can be read: a name in it is not UTF-8"}, []
    write_message(result, content, arrays)
    os._exit(0)  # without taking the stage apart


def _content(path: Path, arrays: list[memoryview[Any]]) -> dict[str, Any]:
    Work.SetConcurrencyLimit(min(_THREADS, Work.GetConcurrencyLimit()))
    notes = UsdUtils.CoalescingDiagnosticDelegate()  # or they are printed
    Usd.SchemaRegistry()  # reads files of the library
    bounds = _Bounds()
    try:
        with Ar.ResolverScopedCache():  # keeps archives open
            layers, files = _layers(path, bounds)
            _limit(resource.RLIMIT_NOFILE, 0)
            stage = Usd.Stage.Open(layers[0], Usd.Stage.LoadAll)
            bounds.set(2 * memory_limits.most(memory_limits.MESHES))  # arrays as they are stored, and unpacked
            content = _Description(stage, arrays).content
    except Tf.ErrorException as error:
        raise _unreadable(path, error) from None
    messages = [str(note.commentary) for note in notes.TakeUncoalescedDiagnostics()]
    return {**content, "files": files, "notes": messages}


def _unreadable(path: Path, error: Any) -> InputError:
    reason = str(error.args[0].commentary)
    if "bad_alloc" in reason:
        raise MemoryError
    reason = reason.replace(f"@{path.absolute()}@", "").replace(str(path.absolute()), path.name)
    return InputError(f"{path}: not a USD file that can be read: {' '.join(reason.split())}")


# Limits --------------------------------------------------------------------------------------------


def _limit(what: int, most: int) -> None:
    hard = resource.getrlimit(what)[1]
    resource.setrlimit(what, (most if hard == resource.RLIM_INFINITY else min(most, hard), hard))


class _Bounds:
    """The memory and the time that the process may take, by the size of the files that it has been given so far."""

    def __init__(self) -> None:
        self._start: int | None = None
        with contextlib.suppress(FileNotFoundError):  # there is no /proc on macOS
            self._start = int(Path("/proc/self/statm").read_text().split()[5]) * resource.getpagesize()

    def set(self, arrays: int = 0) -> None:
        """Set the limits; `arrays` are the bytes beside those of layers and prims."""
        _limit(resource.RLIMIT_CPU, SECONDS + SECONDS_PER_MEGABYTE * (memory_limits.size_of_files() >> 20))
        if self._start is not None:
            _limit(resource.RLIMIT_DATA, self._start + memory_limits.most(memory_limits.COMPOSED) + arrays)


# Layers --------------------------------------------------------------------------------------------


def _layers(path: Path, bounds: _Bounds) -> tuple[list[Any], list[str]]:
    """Return the layers that a file may be composed of, its own first, and their files.

    Layers that cannot be opened are missing.
    """
    require_file(path)
    bounds.set()
    root = Sdf.Layer.FindOrOpen(str(path.absolute()))
    if not root:
        raise InputError(f"{path}: not a USD file that can be read: Pixar's library finds no layer in it")
    layers, files = {root.identifier: root}, [str(path)]
    waiting = [root]
    while waiting:
        layer = waiting.pop()
        for asset in layer.GetCompositionAssetDependencies():
            found = _checked(layer, _evaluated(asset, root, layer))
            if found is None or found[0] in layers:
                continue
            files.append(found[1])
            bounds.set()
            with contextlib.suppress(Tf.ErrorException):  # composing will tell
                opened = Sdf.Layer.FindOrOpen(found[0])
                if opened:
                    layers[found[0]] = opened
                    waiting.append(opened)
    return list(layers.values()), files


def _evaluated(asset: str, root: Any, layer: Any) -> str:
    """Return the path that an expression in a path's place gives; most are none."""
    if not Sdf.VariableExpression.IsExpression(asset):
        return asset
    variables = {**layer.expressionVariables, **root.expressionVariables}
    return str(Sdf.VariableExpression(asset).Evaluate(variables).value or "")


def _checked(layer: Any, asset: str) -> tuple[str, str] | None:
    """Return the identifier and the file of a layer that another names, or None if Pixar's library cannot open it.

    Raises:
        InputError: if the file is none that may be read; `confined_to` raises another.
    """
    if not asset:
        return None
    identifier = str(Sdf.ComputeAssetPathRelativeToLayer(layer, asset))
    name = str(Sdf.Layer.SplitIdentifier(identifier)[0])
    require_inside(Path(_beside(layer, _outer(name))))  # before its existence makes any difference
    found = str(Ar.GetResolver().Resolve(name))
    if not found or Sdf.FileFormat.GetFileExtension(found).lower() not in _SUFFIXES:
        return None
    require_file(Path(_outer(found)))
    return identifier, _outer(found)


def _beside(layer: Any, name: str) -> str:
    """Return the path of a file that a layer names, whether or not it exists."""
    return os.path.normpath(Path(_outer(layer.realPath)).parent / name)


def _outer(path: str) -> str:
    """Return the path of a USDZ archive where a path leads into one."""
    return str(Ar.SplitPackageRelativePathOuter(path)[0])


# What the stage holds ------------------------------------------------------------------------------


class _Description:
    """Describes a stage as what JSON holds, and arrays.

    Attributes:
        content: `up` and `metersPerUnit` of the stage; `prims` in order, each with its `kind`, `path` and `place` (row
            of `places`); `shapes` by the key that prims which share one have; `materials` by path, as the name of their
            shader in `nodes`; `left_out`, which are warnings.
    """

    def __init__(self, stage: Any, arrays: list[memoryview[Any]]) -> None:
        self._stage, self._arrays = stage, arrays
        self._cache = UsdGeom.XformCache(_NOW)
        self._places = bytearray()
        self._unknown: set[str] = set()
        self.content: dict[str, Any] = {"prims": [], "shapes": {}, "materials": {}, "nodes": {}, "left_out": []}
        self.content["up"] = str(UsdGeom.GetStageUpAxis(stage))
        self.content["metersPerUnit"] = None
        with contextlib.suppress(Tf.ErrorException):  # of another type
            self.content["metersPerUnit"] = UsdGeom.GetStageMetersPerUnit(stage)
        classes: dict[str, tuple[bool, bool]] = {}
        walk = iter(Usd.PrimRange(stage.GetPseudoRoot(), Usd.TraverseInstanceProxies()))
        for prim in walk:
            memory_limits.take(
                memory_limits.COMPOSED, _BYTES_PER_INSTANCE if prim.IsInstanceProxy() else _BYTES_PER_PRIM
            )
            kind = str(prim.GetTypeName())
            if kind not in classes:  # asking takes as long as all else
                classes[kind] = prim.IsA(UsdGeom.Imageable), prim.IsA(UsdGeom.PointInstancer)
            is_shown, is_instancer = classes[kind]
            if is_shown and _is_hidden(prim):
                walk.PruneChildren()
                continue
            if is_instancer:
                self._add("PointInstancer", prim, **self._instances(UsdGeom.PointInstancer(prim)))
                walk.PruneChildren()
            elif kind == "Mesh" or kind in _SOLIDS:
                self._add("Shape", prim, shape=self._shape(prim, kind))
            elif kind in _ATTRIBUTES:  # a camera or a light
                self._add(kind, prim, values=self._values(prim, kind))
            elif kind not in _SILENT and kind not in self._unknown:
                self._unknown.add(kind)
                self._leave_out(prim, f"a {kind} is not supported")
        self.content["places"] = self._array(memoryview(self._places).cast("d"))

    def _add(self, kind: str, prim: Any, **values: Any) -> None:
        self.content["prims"].append({"kind": kind, "path": str(prim.GetPath()), **values})
        self._places += memoryview(self._cache.GetLocalToWorldTransform(prim)).cast("B")

    def _leave_out(self, prim: Any, what: str) -> None:
        self.content["left_out"].append(f"{prim.GetPath()}: {what}; left out")

    def _array(self, values: memoryview[Any]) -> dict[str, int]:
        memory_limits.take(memory_limits.MESHES, values.nbytes)
        self._arrays.append(values)
        return {"array": len(self._arrays) - 1}

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
        value = attribute.Get()
        if isinstance(value, Sdf.AssetPath) and value.path and not value.resolvedPath:
            layers = [spec.layer for spec in attribute.GetPropertyStack(_NOW) if spec.layer.realPath]
            if layers and not Ar.IsPackageRelativePath(layers[0].identifier):
                return {"asset": _beside(layers[0], value.path)}
        return self._plain(value)

    def _values(self, prim: Any, kind: str) -> dict[str, Any]:
        attributes = {name: prim.GetAttribute(name) for name in _ATTRIBUTES[kind]}
        return {name: self._value(attribute) for name, attribute in attributes.items() if attribute}

    def _shape(self, prim: Any, kind: str) -> str:
        """Describe a mesh or a solid, unless it has been, and return its key, which instances of it have too."""
        key = str((prim.GetPrimInPrototype() if prim.IsInstanceProxy() else prim).GetPath())
        if key not in self.content["shapes"]:
            shape: dict[str, Any] = {"kind": kind, "path": str(prim.GetPath()), "values": self._values(prim, kind)}
            shape["material"] = self._material(prim)
            self.content["shapes"][key] = shape | (self._of_mesh(prim) if kind == "Mesh" else {})
        return key

    def _of_mesh(self, prim: Any) -> dict[str, Any]:
        mesh, primvars = UsdGeom.Mesh(prim), UsdGeom.PrimvarsAPI(prim)
        scheme = mesh.GetSubdivisionSchemeAttr()
        normals = [self._plain(mesh.GetNormalsAttr().Get()), str(mesh.GetNormalsInterpolation())]
        return {
            "subdivided": scheme.HasAuthoredValue() and str(scheme.Get()) != "none",
            "normals": [self._primvar(primvars.GetPrimvar("normals")), normals],  # the first that is valid counts
            "uvs": self._primvar(primvars.FindPrimvarWithInheritance(_coordinates(primvars))),
            "colors": self._primvar(primvars.FindPrimvarWithInheritance("displayColor")),
            "subsets": [
                [self._plain(subset.GetIndicesAttr().Get()), self._material(subset.GetPrim())]
                for subset in UsdShade.MaterialBindingAPI(prim).GetMaterialBindSubsets()
            ],
        }

    def _primvar(self, primvar: Any) -> list[Any] | None:
        """Return the values of a primvar and their interpolation, or None."""
        if not primvar or not primvar.HasValue():
            return None
        return [self._plain(primvar.ComputeFlattened()), str(primvar.GetInterpolation())]

    def _instances(self, instancer: Any) -> dict[str, Any]:
        """Return the places of a point instancer, the prototype of each, and the shapes within each prototype."""
        prototypes: list[dict[str, Any]] = []
        for root in instancer.GetPrototypesRel().GetTargets():
            prototype = self._stage.GetPrimAtPath(root)
            prototypes.append({"above": None, "shapes": []})
            if not prototype:
                self._leave_out(instancer.GetPrim(), f"its prototype {root} is not there")
                continue
            prototypes[-1]["above"] = self._plain(self._cache.GetLocalToWorldTransform(prototype.GetParent()))
            for prim in Usd.PrimRange(prototype, Usd.TraverseInstanceProxies()):
                memory_limits.take(memory_limits.COMPOSED, _BYTES_PER_PRIM)
                kind = str(prim.GetTypeName())
                if kind == "Mesh" or kind in _SOLIDS:
                    place = self._plain(self._cache.GetLocalToWorldTransform(prim))
                    prototypes[-1]["shapes"].append([self._shape(prim, kind), place])
        exclude, all_of_them = UsdGeom.PointInstancer.ExcludeProtoXform, UsdGeom.PointInstancer.IgnoreMask
        places = instancer.ComputeInstanceTransformsAtTime(_NOW, _NOW, exclude, all_of_them)
        return {
            "values": self._values(instancer.GetPrim(), "PointInstancer"),
            "instances": self._plain(places),
            "shown": [bool(each) for each in instancer.ComputeMaskAtTime(_NOW)],
            "prototypes": prototypes,
        }

    # Materials -------------------------------------------------------------------------------------

    def _material(self, prim: Any) -> str | None:
        """Describe the material that is bound to a prim, and return its path; None if there is none."""
        bound, _ = UsdShade.MaterialBindingAPI(prim).ComputeBoundMaterial()
        if not bound:
            return None
        path = str(bound.GetPath())
        if path not in self.content["materials"]:
            shader, _, _ = bound.ComputeSurfaceSource()
            self.content["materials"][path] = self._node(shader.GetPrim()) if shader else None
        return path

    def _node(self, prim: Any) -> str:
        """Describe a shader and all shaders connected to it, and return its path."""
        nodes, waiting = self.content["nodes"], [prim]
        while waiting:
            shader = UsdShade.Shader(waiting.pop())
            path = str(shader.GetPath())
            if path in nodes:
                continue
            identity = shader.GetPrim().GetAttribute("info:id")
            nodes[path] = {"id": str(identity.Get()) if identity else "", "inputs": {}, "sources": {}}
            for shader_input in UsdShade.ConnectableAPI(shader).GetInputs():
                name = str(shader_input.GetBaseName())
                nodes[path]["inputs"][name] = self._input(shader_input)
                if sources := shader_input.GetConnectedSources()[0]:
                    source = sources[0].source.GetPrim()
                    nodes[path]["sources"][name] = [str(source.GetPath()), str(sources[0].sourceName)]
                    waiting.append(source)
        return str(prim.GetPath())

    def _input(self, shader_input: Any) -> Any:
        """Return an input's value, from the material if it is connected to that, or None."""
        for attribute in UsdShade.Utils.GetValueProducingAttributes(shader_input):
            if UsdShade.Utils.GetType(attribute.GetName()) == UsdShade.AttributeType.Input:
                value = self._value(attribute)
                if value is not None:
                    return value
        return None


def _is_hidden(prim: Any) -> bool:
    """Return whether an imageable prim and those below it are not to be rendered."""
    if str(prim.GetAttribute("visibility").Get()) == "invisible":
        return True
    return str(prim.GetAttribute("purpose").Get()) in ("guide", "proxy")


def _coordinates(primvars: Any) -> str:
    """Return the name of a mesh's texture coordinates: "st", or else the first of that role."""
    if primvars.FindPrimvarWithInheritance("st"):
        return "st"
    found = (each for each in primvars.FindPrimvarsWithInheritance() if each.GetTypeName().role == "TextureCoordinate")
    return next((str(each.GetPrimvarName()) for each in found), "st")
