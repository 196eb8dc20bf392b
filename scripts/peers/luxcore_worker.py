"""LuxCore as one of the renderers that are compared: python luxcore_worker.py FOLDER --device PATHCPU.

See worker.py. Runs where `pyluxcore` and NumPy are installed; the parts of wrt that it imports need only NumPy. Scenes
with rough metals and plastics, which LuxCore lacks, are left out.
"""

from __future__ import annotations

import os
import sys
import time
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).resolve().parents[2]))
sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

import numpy as np
from worker import STARTED, serve

import wrt
from peers.ply_files import write_ply


def words(values: Any) -> str:
    """Return numbers as LuxCore's properties have them."""
    return " ".join(repr(float(x)) for x in np.asarray(values, np.float64).ravel())


def color(value: Any) -> str:
    """Return a colour as three numbers."""
    return words(np.broadcast_to(np.asarray(value, np.float64), 3))


class LuxCoreWorker:
    """A scene of LuxCore; every picture is a session of its own."""

    def __init__(self, folder: Path, engine: str) -> None:
        import pyluxcore

        pyluxcore.Init(lambda text: None)
        imported = time.perf_counter()
        self.lux = pyluxcore
        self.folder = folder
        self.engine = engine
        self.source = wrt.load(folder / "scene.toml")
        self.scene = pyluxcore.Scene()
        lines = [*self.camera(), *self.world()]
        for number, shape in enumerate(self.source.shapes):
            lines += self.shape(number, shape)
        for number, light in enumerate(self.source.lights):
            if not isinstance(light, wrt.DirectionalLight) or light.angle_degrees > 0.0:
                raise NotImplementedError(f"no counterpart of {type(light).__name__}")
            lines += [
                f'scene.lights.sun{number}.type = "sharpdistant"',
                f"scene.lights.sun{number}.direction = {words(light.direction)}",
                f"scene.lights.sun{number}.color = {color(light.irradiance)}",
            ]
        self.parse(lines)
        self.film: Any = None
        self.seconds = {"import": imported - STARTED, "load": time.perf_counter() - imported}

    def parse(self, lines: list[str]) -> None:
        """Add properties to the scene."""
        properties = self.lux.Properties()
        properties.SetFromString("\n".join(lines) + "\n")
        self.scene.Parse(properties)

    def camera(self) -> list[str]:
        """Return the properties of the camera."""
        camera = self.source.camera
        if not isinstance(camera, wrt.PerspectiveCamera) or self.source.settings.width != self.source.settings.height:
            raise NotImplementedError("perspective cameras and square pictures only")
        if camera.motion is not None and camera.shutter_close > camera.shutter_open:
            raise NotImplementedError("no moving cameras")
        raised = -2.0 / self.source.settings.height
        lines = [
            'scene.camera.type = "perspective"',
            f"scene.camera.lookat.orig = {words(camera.origin)}",
            f"scene.camera.lookat.target = {words(camera.target)}",
            f"scene.camera.up = {words(camera.up)}",
            f"scene.camera.fieldofview = {camera.fov_degrees}",
            # Row y of its film is what the camera sees at H − 1 − y: a pixel too low.
            f"scene.camera.screenwindow = -1 1 {-1.0 + raised} {1.0 + raised}",
            "scene.camera.autofocus.enable = 0",
            f"scene.camera.lensradius = {camera.aperture_radius}",
            f"scene.camera.focaldistance = {camera.distance_in_focus}",
        ]
        return lines + (['scene.camera.volume = "fog"'] if self.source.medium is not None else [])

    def world(self) -> list[str]:
        """Return the properties of the surroundings, and of what fills the scene."""
        lines = []
        environment, medium = self.source.environment, self.source.medium
        if medium is not None:
            lines += [
                'scene.volumes.fog.type = "homogeneous"',
                f"scene.volumes.fog.absorption = {words(medium.absorption)}",
                f"scene.volumes.fog.scattering = {words(medium.scattering)}",
                f"scene.volumes.fog.asymmetry = {color(medium.g)}",
                "scene.volumes.fog.multiscattering = 1",
                'scene.world.volume.default = "fog"',
            ]
        if isinstance(environment, wrt.ConstantEnvironment):
            lines += ['scene.lights.sky.type = "constantinfinite"']
            lines += [f"scene.lights.sky.color = {color(environment.radiance)}"]
        elif environment is not None:
            raise NotImplementedError(f"no counterpart of {type(environment).__name__}")
        return lines

    def shape(self, number: int, shape: wrt.Shape) -> list[str]:
        """Return the properties of a shape, its mesh in a file."""
        if shape.transform is not None or shape.deformation is not None:
            raise NotImplementedError("no shapes that move or stand in several places")
        file = self.folder / f"luxcore_{number}.ply"
        write_ply(shape.mesh, file)
        material = f"scene.materials.m{number}"
        lines = [f"{material}.{line}" for line in self.surface(shape.material)]
        if shape.emits:
            lines += [f"{material}.emission = {color(shape.emission)}"]
        return [*lines, f'scene.objects.o{number}.ply = "{file}"', f'scene.objects.o{number}.material = "m{number}"']

    def surface(self, material: wrt.Material) -> list[str]:
        """Return the properties of a reflection model."""
        if isinstance(material, wrt.Diffuse) and not isinstance(material.reflectance, wrt.ImageTexture):
            return ['type = "matte"', f"kd = {color(material.reflectance)}"]
        if isinstance(material, wrt.Dielectric):
            index = material.ior / material.exterior_ior
            return ['type = "glass"', "kr = 1 1 1", "kt = 1 1 1", f"interiorior = {index}", "exteriorior = 1"]
        raise NotImplementedError(f"no counterpart of {type(material).__name__}")

    def about(self) -> dict[str, Any]:
        """Return version and seconds."""
        return {"version": self.lux.Version(), "seconds": self.seconds}

    def render(self, spp: int, seed: int) -> float:
        """Render a new picture and return the seconds, with those of starting (as at one sample per pixel)."""
        settings = self.source.settings
        depth = settings.max_depth - 1  # the camera's ray does not count
        properties = self.lux.Properties()
        properties.SetFromString(
            f'renderengine.type = "{self.engine}"\nrenderengine.seed = {seed + 1}\nsampler.type = "SOBOL"\n'
            f"film.width = {settings.width}\nfilm.height = {settings.height}\n"
            'film.filter.type = "NONE"\nfilm.outputs.0.type = "RGB"\n'
            'film.outputs.0.filename = "picture.exr"\nfilm.imagepipelines.0.0.type = "NOP"\n'
            f"path.pathdepth.total = {depth}\npath.pathdepth.diffuse = {depth}\npath.pathdepth.glossy = {depth}\n"
            f"path.pathdepth.specular = {depth}\npath.russianroulette.depth = 5\npath.russianroulette.cap = 0.05\n"
            f"path.clamping.variance.maxvalue = 0\nbatch.haltspp = {spp}\n"
        )
        started = time.perf_counter()
        session = self.lux.RenderSession(self.lux.RenderConfig(properties, self.scene))
        session.Start()
        while not session.HasDone():
            time.sleep(0.005)
            session.UpdateStats()
        session.Stop()
        seconds = time.perf_counter() - started
        self.film = session.GetFilm()
        self.session = session  # owns the film
        return seconds

    def picture(self) -> Any:
        """Return (H, W, 3) float32."""
        settings = self.source.settings
        pixels = np.zeros(3 * settings.width * settings.height, np.float32)
        self.film.GetOutputFloat(self.lux.FilmOutputType.RGB, pixels, 0, True)
        return np.ascontiguousarray(pixels.reshape(settings.height, settings.width, 3)[::-1])

    def save(self, path: str) -> None:
        """Write the last picture as PNG."""
        properties = self.lux.Properties()
        self.film.SaveOutput(path, self.lux.FilmOutputType.RGB_IMAGEPIPELINE, properties)


if __name__ == "__main__":
    serve(LuxCoreWorker)
    os._exit(0)  # what its libraries do at the end may crash
