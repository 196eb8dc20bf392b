"""Blender's Cycles as one of the renderers that are compared: python cycles_worker.py FOLDER --device CPU.

See worker.py. Runs where `bpy` is installed (pip install bpy, for the Python that it is made for); the parts of wrt
that it imports need only NumPy. Materials without an equal in Cycles (plastics) become the nearest that it has.
"""

from __future__ import annotations

import os
import sys
import time
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).resolve().parents[2]))

import numpy as np
from worker import STARTED, serve

import wrt


class CyclesWorker:
    """A scene in Blender, whose world is y up too: only the surroundings are rotated."""

    def __init__(self, folder: Path, device: str) -> None:
        import bpy

        addon_utils = __import__("addon_utils")  # which bpy brings, so it comes second
        imported = time.perf_counter()
        self.bpy = bpy
        self.folder = folder
        self.source = wrt.load(folder / "scene.toml")
        bpy.ops.wm.read_factory_settings(use_empty=True)
        addon_utils.enable("cycles")
        self.scene = bpy.context.scene
        self.settle(device)
        self.images: dict[int, Any] = {}
        self.camera()
        for number, shape in enumerate(self.source.shapes):
            if shape.transform is not None or shape.deformation is not None:
                raise NotImplementedError("no shapes that move or stand in several places")
            self.link(f"shape {number}", self.mesh(shape.mesh), self.material(shape))
        for light in self.source.lights:
            self.light(light)
        self.world()
        self.seconds = {"import": imported - STARTED, "load": time.perf_counter() - imported}

    def settle(self, device: str) -> None:
        """Set the options that all scenes share; paths end as in wrt."""
        settings, render, cycles = self.source.settings, self.scene.render, self.scene.cycles
        render.engine = "CYCLES"
        render.resolution_x, render.resolution_y, render.resolution_percentage = settings.width, settings.height, 100
        render.use_persistent_data = True
        render.image_settings.file_format = "OPEN_EXR"
        render.image_settings.color_depth = "32"
        render.filepath = str(self.folder / "cycles.exr")
        self.scene.view_settings.view_transform = "Standard"
        for name in ("max_bounces", "diffuse_bounces", "glossy_bounces", "transmission_bounces", "volume_bounces"):
            setattr(cycles, name, max(0, settings.max_depth - 2))  # Cycles counts from the first surface on
        cycles.min_light_bounces = 4
        cycles.use_adaptive_sampling = cycles.use_denoising = False
        cycles.light_sampling_threshold = cycles.blur_glossy = 0.0
        cycles.sample_clamp_direct = cycles.sample_clamp_indirect = 0.0
        cycles.pixel_filter_type = "BOX"
        cycles.device = device
        if device == "GPU":
            preferences = self.bpy.context.preferences.addons["cycles"].preferences
            preferences.compute_device_type = "OPTIX"
            preferences.get_devices()
            for each in preferences.devices:
                each.use = each.type == "OPTIX"

    def link(self, name: str, data: Any, material: Any = None) -> Any:
        """Add an object to the scene."""
        added = self.bpy.data.objects.new(name, data)
        self.scene.collection.objects.link(added)
        if material is not None:
            data.materials.append(material)
        return added

    def place(self, target: Any, matrix: np.ndarray) -> None:
        """Set an object's matrix to the world."""
        from mathutils import Matrix

        target.matrix_world = Matrix(matrix.tolist())

    def camera(self) -> None:
        """Make the camera; one that moves has keys at both ends of the time that the shutter is open."""
        camera = self.source.camera
        if not isinstance(camera, wrt.PerspectiveCamera):
            raise NotImplementedError("perspective cameras only")
        data = self.bpy.data.cameras.new("camera")
        data.sensor_fit = "VERTICAL"
        data.angle = np.radians(camera.fov_degrees)
        far = camera.distance_in_focus
        data.clip_start, data.clip_end = 1e-4 * far, 1e4 * far
        if camera.aperture_radius > 0.0:
            data.dof.use_dof = True
            data.dof.focus_distance = camera.distance_in_focus
            data.dof.aperture_fstop = 1e-3 * data.lens / (2.0 * camera.aperture_radius)
        added = self.scene.camera = self.link("camera", data)
        matrix = looking(camera.origin, np.array(camera.target) - camera.origin, camera.up)
        if camera.motion is None or camera.shutter_close <= camera.shutter_open:
            self.place(added, matrix)
            return
        self.scene.render.use_motion_blur = True
        self.scene.render.motion_blur_shutter = 1.0
        self.scene.render.motion_blur_position = "START"
        added.rotation_mode = "QUATERNION"
        self.bpy.context.preferences.edit.keyframe_new_interpolation_type = "LINEAR"
        for frame, seconds in ((1, camera.shutter_open), (2, camera.shutter_close)):
            self.place(added, camera.motion.at(seconds) @ matrix)
            added.keyframe_insert("location", frame=frame)
            added.keyframe_insert("rotation_quaternion", frame=frame)
        self.scene.frame_set(1)

    def mesh(self, mesh: wrt.Mesh) -> Any:
        """Return a mesh with its texture coordinates, flat."""
        data = self.bpy.data.meshes.new(mesh.name)
        corners = mesh.faces.ravel()
        data.vertices.add(len(mesh.vertices))
        data.loops.add(len(corners))
        data.polygons.add(len(mesh.faces))
        data.vertices.foreach_set("co", mesh.vertices.ravel())
        data.loops.foreach_set("vertex_index", corners)
        data.polygons.foreach_set("loop_start", np.arange(0, len(corners), 3, dtype=np.int32))
        if mesh.uvs is not None:
            data.uv_layers.new().uv.foreach_set("vector", mesh.uvs[corners].ravel())
        data.update()
        data.shade_flat()
        return data

    def material(self, shape: wrt.Shape) -> Any:
        """Return the material of a shape, with its light."""
        material = self.bpy.data.materials.new(shape.name)
        material.use_nodes = True
        tree = material.node_tree
        tree.nodes.clear()
        out = tree.nodes.new("ShaderNodeOutputMaterial")
        surface = self.surface(tree, shape.material)
        if shape.emits:
            material.cycles.emission_sampling = "FRONT"
            glow = tree.nodes.new("ShaderNodeEmission")
            glow.inputs["Color"].default_value = (*np.asarray(shape.emission, np.float64), 1.0)
            front = tree.nodes.new("ShaderNodeMath")
            front.operation = "SUBTRACT"
            front.inputs[0].default_value = 1.0
            back = tree.nodes.new("ShaderNodeNewGeometry").outputs["Backfacing"]
            tree.links.new(back, front.inputs[1])
            tree.links.new(front.outputs[0], glow.inputs["Strength"])
            total = tree.nodes.new("ShaderNodeAddShader")
            tree.links.new(surface.outputs[0], total.inputs[0])
            tree.links.new(glow.outputs[0], total.inputs[1])
            surface = total
        tree.links.new(surface.outputs[0], out.inputs["Surface"])
        return material

    def surface(self, tree: Any, material: wrt.Material) -> Any:
        """Return the node of a reflection model; roughness is the root of alpha."""

        def node(kind: str, fresnel: str = "", **values: Any) -> Any:
            made = tree.nodes.new(f"ShaderNodeBsdf{kind}")
            if fresnel:
                made.fresnel_type = fresnel  # inputs hang on it
            if hasattr(made, "distribution"):
                made.distribution = "GGX"  # of one bounce
            for name, value in values.items():
                self.plug(tree, made.inputs[name.replace("_", " ")], value)
            return made

        if isinstance(material, wrt.Diffuse):
            return node("Diffuse", Color=material.reflectance, Roughness=0.0)
        if isinstance(material, (wrt.Conductor, wrt.RoughConductor)) and material.eta is not None:
            rough = 0.0 if isinstance(material, wrt.Conductor) else float(material.alpha) ** 0.5
            return node("Metallic", "PHYSICAL_CONDUCTOR", IOR=material.eta, Extinction=material.k, Roughness=rough)
        if isinstance(material, wrt.Dielectric):
            return node("Glass", Color=(1.0, 1.0, 1.0), Roughness=0.0, IOR=material.ior / material.exterior_ior)
        if isinstance(material, wrt.Plastic):
            return node("Principled", Base_Color=material.reflectance, Roughness=0.0, IOR=material.ior)
        if isinstance(material, wrt.Principled) and material.metallic == 1.0:
            return node("Principled", Base_Color=material.base_color, Metallic=1.0, Roughness=material.roughness)
        raise NotImplementedError(f"no counterpart of {type(material).__name__}")

    def plug(self, tree: Any, socket: Any, value: Any) -> None:
        """Set an input of a node: a number, a colour, or an image."""
        if isinstance(value, wrt.ImageTexture):
            made = tree.nodes.new("ShaderNodeTexImage")
            made.image = self.image(value.pixels)
            tree.links.new(made.outputs["Color"], socket)
        elif socket.type == "RGBA":
            socket.default_value = (*np.broadcast_to(np.asarray(value, np.float64), 3), 1.0)
        elif socket.type == "VECTOR":
            socket.default_value = tuple(np.broadcast_to(np.asarray(value, np.float64), 3))
        else:
            socket.default_value = float(value)

    def image(self, pixels: np.ndarray) -> Any:
        """Return linear pixels as an image; Blender's first row is the lowest."""
        if id(pixels) not in self.images:
            height, width = pixels.shape[:2]
            image = self.bpy.data.images.new("image", width, height, float_buffer=True, is_data=True)
            rgba = np.concatenate([pixels, np.ones((height, width, 1), np.float32)], axis=2)[::-1]
            image.pixels.foreach_set(np.ascontiguousarray(rgba, np.float32).ravel())
            image.pack()
            self.images[id(pixels)] = image
        return self.images[id(pixels)]

    def light(self, light: Any) -> None:
        """Make a light from a direction."""
        if not isinstance(light, wrt.DirectionalLight) or light.angle_degrees > 0.0:
            raise NotImplementedError(f"no counterpart of {type(light).__name__}")
        data = self.bpy.data.lights.new("sun", "SUN")
        irradiance = np.asarray(light.irradiance, np.float64)
        data.energy = float(irradiance.max())
        data.color = tuple(irradiance / irradiance.max())
        data.angle = 0.0
        self.place(self.link("sun", data), looking((0.0, 0.0, 0.0), np.array(light.direction), (0.0, 1.0, 0.0)))

    def world(self) -> None:
        """Make the surroundings, and what fills the scene."""
        world = self.bpy.data.worlds.new("world")
        self.scene.world = world
        world.use_nodes = True
        tree = world.node_tree
        tree.nodes.clear()
        out = tree.nodes.new("ShaderNodeOutputWorld")
        sky = tree.nodes.new("ShaderNodeBackground")
        environment = self.source.environment
        if environment is None:
            sky.inputs["Strength"].default_value = 0.0
        elif isinstance(environment, wrt.ConstantEnvironment):
            self.plug(tree, sky.inputs["Color"], environment.radiance)
        elif isinstance(environment, wrt.ImageEnvironment) and environment.rotation_degrees == 0.0:
            texture = tree.nodes.new("ShaderNodeTexEnvironment")
            texture.image = self.image(environment.pixels)
            sky.inputs["Strength"].default_value = environment.scale
            # Cycles' middle column looks along +x and its right turns to −y, z up; that of wrt along −z and +x, y up.
            split, joined = tree.nodes.new("ShaderNodeSeparateXYZ"), tree.nodes.new("ShaderNodeCombineXYZ")
            tree.links.new(tree.nodes.new("ShaderNodeTexCoord").outputs["Generated"], split.inputs[0])
            for source, target in (("Z", "X"), ("X", "Y")):
                minus = tree.nodes.new("ShaderNodeMath")
                minus.operation = "MULTIPLY"
                minus.inputs[1].default_value = -1.0
                tree.links.new(split.outputs[source], minus.inputs[0])
                tree.links.new(minus.outputs[0], joined.inputs[target])
            tree.links.new(split.outputs["Y"], joined.inputs["Z"])
            tree.links.new(joined.outputs[0], texture.inputs["Vector"])
            tree.links.new(texture.outputs["Color"], sky.inputs["Color"])
        else:
            raise NotImplementedError(f"no counterpart of {type(environment).__name__}")
        tree.links.new(sky.outputs[0], out.inputs["Surface"])
        medium = self.source.medium
        if medium is not None:
            fog = tree.nodes.new("ShaderNodeVolumeCoefficients")
            fog.inputs["Absorption Coefficients"].default_value = tuple(medium.absorption)
            fog.inputs["Scatter Coefficients"].default_value = tuple(medium.scattering)
            fog.inputs["Anisotropy"].default_value = medium.g
            tree.links.new(fog.outputs[0], out.inputs["Volume"])

    def about(self) -> dict[str, Any]:
        """Return version and seconds."""
        return {"version": self.bpy.app.version_string, "seconds": self.seconds}

    def render(self, spp: int, seed: int) -> float:
        """Render a new picture and return the seconds, with those of writing it (as at one sample per pixel)."""
        self.scene.cycles.samples = spp
        self.scene.cycles.seed = seed * 2654435761 % 2**31  # neighbours share part of their patterns
        started = time.perf_counter()
        self.bpy.ops.render.render(write_still=True)
        return time.perf_counter() - started

    def picture(self) -> Any:
        """Return (H, W, 3) float32."""
        image = self.bpy.data.images.load(self.scene.render.filepath)
        image.colorspace_settings.name = "Non-Color"
        width, height = image.size
        pixels = np.empty(4 * width * height, np.float32)
        image.pixels.foreach_get(pixels)
        self.bpy.data.images.remove(image)
        return np.ascontiguousarray(pixels.reshape(height, width, 4)[::-1, :, :3])

    def save(self, path: str) -> None:
        """Write the last picture as PNG."""
        self.scene.render.image_settings.file_format = "PNG"
        self.scene.render.image_settings.color_depth = "8"
        self.bpy.data.images["Render Result"].save_render(path)


def looking(origin: Any, direction: np.ndarray, up: Any) -> np.ndarray:
    """Return the (4, 4) place of something that looks along −z, y up."""
    z = -direction / np.linalg.norm(direction)
    x = np.cross(up, z)
    if np.linalg.norm(x) < 1e-9:
        x = np.cross((1.0, 0.0, 0.0), z)
    x /= np.linalg.norm(x)
    matrix = np.eye(4)
    matrix[:3] = np.stack([x, np.cross(z, x), z, np.asarray(origin, np.float64)], axis=1)
    return matrix


if __name__ == "__main__":
    serve(CyclesWorker)
    sys.stdout.flush()
    os._exit(0)  # bpy's own end takes seconds, and may crash
