"""What of a glTF file does not change a picture, by path: keys with no effect, and keys that another one overrules.

Format: Khronos Group 2021, "glTF 2.0 Specification"; section numbers below are its.
"""

from __future__ import annotations

from wrt.io.gltf.materials import EXTENSIONS

_THICKNESSES = "Minimum", "Maximum", "Texture"

_REASONS: dict[str, tuple[str, ...]] = {
    "it describes the file": (
        *("extras", "*.extras", "*.name", "extensionsUsed", "asset.copyright", "asset.generator"),
        *("images.mimeType", "buffers.byteLength", "bufferViews.target", "accessors.min", "accessors.max"),
        *("*.extensions.KHR_xmp_json_ld", "extensions.KHR_xmp_json_ld", "*.extensions.KHR_xmp", "extensions.KHR_xmp"),
        *("skins.skeleton",),
    ),
    "nothing that is shown refers to it, or the scene is at rest": (
        *("accessors", "animations", "buffers", "bufferViews", "cameras", "images", "meshes", "samplers", "skins"),
        *("textures", "meshes.primitives.targets", "animations.channels.sampler"),
        *("meshes.primitives.indices", "meshes.primitives.material"),  # of points and lines, which are warned of
    ),
    "its node is hidden, is only a joint, or has no mesh": (
        *("nodes.mesh", "nodes.camera", "nodes.skin", "nodes.weights", "nodes.extensions.KHR_lights_punctual"),
        *("nodes.extensions.EXT_mesh_gpu_instancing",),
    ),
    "it stands for data that are compressed": (
        *(f"accessors.{key}" for key in ("type", "componentType", "count", "bufferView", "byteOffset")),
        *("bufferViews.buffer", "bufferViews.byteOffset", "bufferViews.byteLength"),
        *("buffers.extensions.EXT_meshopt_compression", "buffers.extensions.KHR_meshopt_compression"),
    ),
    "integers of colours and normals are scaled to 1 or normalised in any case": ("accessors.normalized",),
    "no texture uses it, no skin, or no section defines what it does (3.7.2.1)": (
        *("meshes.primitives.attributes.TEXCOORD_*", "meshes.primitives.attributes.COLOR_[1-9]*"),
        *("meshes.primitives.attributes.JOINTS_*", "meshes.primitives.attributes.WEIGHTS_*"),
        *("meshes.primitives.attributes._*", "nodes.extensions.EXT_mesh_gpu_instancing.attributes._*"),
    ),
    "a primitive without normals is flat, and its tangents are ignored (3.7.2.1)": (
        *("meshes.primitives.attributes.TANGENT", "meshes.primitives.targets.TANGENT"),
        "meshes.primitives.targets.NORMAL",
    ),
    "the picture has its own shape, and shows what is near and far": (
        *("cameras.perspective.aspectRatio", "cameras.orthographic.xmag"),
        *("cameras.*.znear", "cameras.*.zfar"),
    ),
    "it is a hint where the light may be taken as dark": ("extensions.KHR_lights_punctual.lights.range",),
    "it names forms with less detail": ("nodes.extensions.MSFT_lod", "materials.extensions.MSFT_lod"),
    "it is for interaction": (
        *("extensions.KHR_interactivity", "nodes.extensions.KHR_node_hoverability"),
        *("nodes.extensions.KHR_node_selectability",),
    ),
    "what it describes is measured on the mesh": (
        *("materials.occlusionTexture", "materials.extensions.KHR_materials_volume.thicknessTexture"),
    ),
    "its names are in a warning": ("meshes.primitives.extensions.KHR_materials_variants",),
    "it is another form of an image that is shown, or a warning names it": (
        *("textures.sampler", "textures.extensions.KHR_texture_basisu", "textures.extensions.MSFT_texture_dds"),
        *("textures.extensions.EXT_texture_astc",),
    ),
    "it is for coarser pixels: a path tracer takes many samples in each": ("samplers.minFilter",),
    "it matters only if another factor or mode does; textures are also left out with a warning": (
        *("materials.alphaCutoff", "materials.emissiveFactor", "materials.emissiveTexture", "materials.normalTexture"),
        *("materials.*Texture.index", "materials.*Texture.scale"),
        *(f"materials.*Texture.extensions.KHR_texture_transform.{key}" for key in ("offset", "rotation", "scale")),
        *(f"materials.pbrMetallicRoughness.{name}Factor" for name in ("baseColor", "metallic", "roughness")),
        *("materials.pbrMetallicRoughness.baseColorTexture", "materials.pbrMetallicRoughness.metallicRoughnessTexture"),
        *(f"materials.extensions.KHR_materials_{name}" for name in EXTENSIONS),
        "materials.extensions.KHR_materials_anisotropy.anisotropyTexture",
        *("materials.extensions.KHR_materials_iridescence.iridescenceI[oO][rR]",),
        *(f"materials.extensions.KHR_materials_iridescence.iridescenceThickness{end}" for end in _THICKNESSES),
        *("materials.extensions.KHR_materials_volume.attenuation*",),
    ),
}

WITHOUT_EFFECT = {pattern: reason for reason, patterns in _REASONS.items() for pattern in patterns}
"""Patterns of paths for `warn_of_unused`, with the reason."""
