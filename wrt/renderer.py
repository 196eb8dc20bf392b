"""The progressive renderer: passes over a film until there are enough."""

from __future__ import annotations

import dataclasses
import math
import time
import warnings
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from wrt._version import __version__
from wrt.build.camera import CropWindow, build_camera
from wrt.build.filters import filter_table
from wrt.build.integrators import WITHOUT_LIGHT, choose_integrator, integrator_features, path_settings
from wrt.build.light_choice import LIGHT_CHOICES
from wrt.build.lights import has_light
from wrt.build.scene_data import build_scene
from wrt.camera import CAMERAS
from wrt.checkpoint import SETTINGS_OF_PICTURE, read_checkpoint, refuse_to_be_copied, require_same, write_checkpoint
from wrt.device import Device
from wrt.errors import InputError
from wrt.files import PathLike
from wrt.film import Film
from wrt.fingerprint import scene_fingerprint
from wrt.framing import frame_camera
from wrt.pace import samples_of_next_pass
from wrt.render_kernel import RenderKernel
from wrt.scene import RenderSettings, Scene, Shape
from wrt.values import integer, number, one_of

STRATEGIES = ("mis", "light", "bsdf")
"""How light that both samplings find is weighed: shared, or left to one of them alone."""

MAX_SPP = 2**31 - 1


@dataclass(frozen=True)
class Progress:
    """What one pass has come to.

    Attributes:
        pass_index: passes since `Renderer.passes` was called, from 1.
        spp: samples in every pixel so far.
        target_spp: samples per pixel asked for; None where only time limits.
        seconds: rendering time since `Renderer.passes` was called.
        seconds_left: estimate of the time still needed.
        paths_per_second: camera paths a second since `Renderer.passes` was called.
        rays_per_second: rays of every kind a second, likewise.
        noise: mean standard error of the pixels over their mean radiance, or None
            while pixels have only one sample. Too high, but for the sampler "independent": see `Renderer.variance`.
    """

    pass_index: int
    spp: int
    target_spp: int | None
    seconds: float
    seconds_left: float | None
    paths_per_second: float
    rays_per_second: float
    noise: float | None


class Renderer:
    """Traces a scene pass after pass; the picture gets better with each and can be had at any time.

    The picture depends on scene, size, seed, sample count, device and version alone: bit for bit
    the same for any number of threads, any split into passes, and after any stop and resume.
    """

    __reduce_ex__ = refuse_to_be_copied

    def __init__(
        self,
        scene: Scene,
        *,
        width: int | None = None,
        height: int | None = None,
        device: str = "cpu",
        seed: int = 0,
        threads: int | None = None,
        max_depth: int | None = None,
        filter: str | None = None,
        sampler: str | None = None,
        strategy: str = "mis",
        crop: CropWindow | None = None,
        integrator: str | None = None,
        light_choice: str = "auto",
        min_attenuation: float | None = None,
        ao_distance: float | None = None,
        layers: Sequence[str] | None = None,
        clamp_indirect: float | None = None,
        regularization: float | None = None,
        max_scatterings: int | None = None,
    ) -> None:
        """Build a scene for a device and compile its kernel.

        Args:
            scene: what to render; later changes to it are not seen.
            width: pixels; by default the scene's own setting, as for height, max_depth, filter and sampler.
            height: pixels.
            device: "cpu", "cuda" or "cuda:N".
            seed: 0 to 2³² − 1; other seeds give statistically independent pictures.
            threads: CPU threads; by default all cores.
            max_depth: most segments in a path.
            filter: reconstruction filter, see `wrt.scene.FILTERS`.
            sampler: where random numbers come from, see `wrt.scene.SAMPLERS`.
            strategy: "mis", or "light" or "bsdf" to find surface and image lights by only one of both.
            crop: the part of the picture to render, in its pixels: first column, first row, and the column and row
                after the last; by default the scene's own setting, which by default is all of it.
            integrator: what the picture shows, see `wrt.scene.INTEGRATORS`; by default the scene's own setting, as for
                what follows, which is described at `wrt.RenderSettings`.
            light_choice: how next-event estimation chooses a light: "auto", or "power" or "tree" to compare the two.
            min_attenuation: of integrator "whitted".
            ao_distance: of integrator "ao", metres.
            layers: names of `wrt.layers.LAYERS` to render beside the light, for `layers`.
            clamp_indirect: of integrator "path", biased: most indirect radiance that a path brings.
            regularization: of integrator "path", biased: roughness that surfaces gain along a path.
            max_scatterings: of integrator "volpath".

        Raises:
            InputError: on values that cannot be used, an empty scene, or a device that is not there.
        """
        given: dict[str, Any] = {
            "width": width,
            "height": height,
            "max_depth": max_depth,
            "filter": filter,
            "crop": crop,
            "sampler": sampler,
            "integrator": integrator,
            "min_attenuation": min_attenuation,
            "ao_distance": ao_distance,
            "layers": layers,
            "clamp_indirect": clamp_indirect,
            "regularization": regularization,
            "max_scatterings": max_scatterings,
        }
        self.settings: RenderSettings = dataclasses.replace(
            scene.settings, **{k: v for k, v in given.items() if v is not None}
        )
        self.integrator = choose_integrator(scene, self.settings)
        if self.width * self.height >= 2**31:
            raise InputError(f"a picture of {self.width}x{self.height} has more than the 2^31 pixels that are possible")
        self.seed = integer(seed, "seed", minimum=0, maximum=2**32 - 1)
        self.strategy = one_of(strategy, STRATEGIES, "strategy")
        self.light_choice = one_of(light_choice, LIGHT_CHOICES, "light_choice")
        self.scene = dataclasses.replace(scene, shapes=list(scene.shapes), lights=list(scene.lights))
        if not scene.shapes:
            raise InputError("the scene has no shapes to render")
        if self.scene.camera is None:
            points = np.concatenate([shape.outline for shape in self.scene.shapes])
            self.scene.camera = frame_camera(points, self.width / self.height)
        if not isinstance(self.scene.camera, tuple(CAMERAS.values())):
            given_camera = type(self.scene.camera).__name__
            raise InputError(f"the scene's camera must be one of wrt's cameras, not {given_camera}")
        if self.integrator not in WITHOUT_LIGHT and not has_light(self.scene):
            warnings.warn("the scene has no light: the picture will be black", UserWarning, stacklevel=2)

        self.device = Device(device, threads=threads)
        x0, y0, x1, y1 = self.crop
        self.film = Film(x1 - x0, y1 - y0, self.device, self.settings.layers)
        with self.device.compiling() as compile:
            uv, choose = "uv" in self.settings.layers, partial(self._choose_kernel, compile=compile)
            self._built = build_scene(
                self.scene, self.device, texture_coordinates=uv, light_choice=light_choice, on_features=choose
            )
        self.film.require_memory()  # check again, now that the scene has taken its memory
        self._inputs = self._prepare()
        self.seconds_render, self.paths, self._updated = 0.0, 0, False

    def _choose_kernel(self, features: Any, compile: Callable[[Any], None]) -> None:
        """Take the kernel for scenes with these features, and have all be compiled that is needed from here on."""
        features = dataclasses.replace(features, sampler=self.settings.sampler)
        features = integrator_features(features, self.integrator, self.settings)
        self._kernel = RenderKernel(self.device, features, self.film.width, self.film.height)
        self._kernel.compile(compile)

    def _prepare(self) -> list[Any]:
        """Return what the kernel takes after the number of samples."""
        import warp as wp

        path = path_settings(self.scene, self.settings, self.integrator)
        path.strategy = STRATEGIES.index(self.strategy)
        assert self.scene.camera is not None
        camera = build_camera(self.scene.camera, self.width, self.height, self.crop, device=self.device.name)
        table = wp.array(filter_table(self.settings.filter), dtype=float, device=self.device.name)
        self._kernel.records = (self._built.data, self.film.data, self.film.layers.data)
        return [self.seed, camera, table, self._built.data, path, self.film.data, self.film.layers.data]

    @property
    def width(self) -> int:
        """Width of the whole picture, pixels."""
        return self.settings.width

    @property
    def height(self) -> int:
        """Height of the whole picture, pixels."""
        return self.settings.height

    @property
    def crop(self) -> CropWindow:
        """The part of the picture that is rendered: first column and row, and those after the last."""
        return self.settings.crop or (0, 0, self.width, self.height)

    @property
    def threads(self) -> int:
        """CPU threads in use; 1 on CUDA."""
        return self.device.threads

    @property
    def seconds_compile(self) -> float:
        """Seconds that this renderer has been blocked until kernels were compiled or loaded."""
        return self.device.seconds_compile

    @property
    def seconds_compile_beside(self) -> float:
        """Seconds that another process has spent compiling the wide kernel so far, while this one was rendering."""
        return self._kernel.seconds_beside

    @property
    def spp(self) -> int:
        """Samples that every pixel has at least."""
        return int(self.film.counts.min())

    @property
    def rays(self) -> int:
        """Rays of every kind traced by this renderer."""
        return self.film.rays

    def passes(
        self, *, spp: int | None = None, time: float | None = None, pass_seconds: float | None = None
    ) -> Iterator[Progress]:
        """Render until every pixel has `spp` samples or `time` seconds are over, whichever is first.

        Yields after each pass, the first of one sample a pixel. Stopping early, by leaving the loop
        or by KeyboardInterrupt, leaves a film that can be looked at, saved and gone on with. Long passes
        are faster on the CPU: many samples of a pixel at a time look for the same things in memory.

        Args:
            spp: total samples per pixel, those already there counted in; by default the scene's
                setting, or without limit where `time` is given.
            time: seconds of rendering; the pass that runs then is finished.
            pass_seconds: what a pass after the first should take about, at most 10 s; by default a quarter of what
                all before it took, but 0.4 s at least. On CUDA at most 0.4 s, for nothing can interrupt one there.
        """
        if spp is None and time is None:
            spp = self.settings.spp
        if spp is not None:
            spp = integer(spp, "spp", minimum=1, maximum=MAX_SPP)
        if time is not None:
            time = number(time, "time", above=0.0)
        if pass_seconds is not None:
            pass_seconds = number(pass_seconds, "pass_seconds", above=0.0)
        return self._passes(spp, time, pass_seconds)

    def _passes(self, spp: int | None, limit: float | None, pass_seconds: float | None) -> Iterator[Progress]:
        target = MAX_SPP if spp is None else spp
        seconds = 0.0
        paths = 0
        rays_before = self.rays
        done = self.spp
        pass_index = 0
        step = 1
        left = 0.0
        while done < target:
            pass_index += 1
            done += step
            before = int(self.film.counts.sum(dtype=np.int64))
            started = time.perf_counter()
            try:
                self._kernel.launch([done, *self._inputs], left)
            finally:
                elapsed = time.perf_counter() - started
                traced = int(self.film.counts.sum(dtype=np.int64)) - before
                seconds += elapsed
                paths += traced
                self.seconds_render += elapsed
                self.paths += traced
            yield self._progress(pass_index, done, spp, seconds, limit, paths, self.rays - rays_before)
            if limit is not None and seconds >= limit:
                return
            per_sample = elapsed * self.film.pixels / max(traced, 1)
            limited = math.inf if limit is None else limit - seconds
            left = min((target - done) * per_sample, limited)
            short = not self.device.is_cpu or self._kernel.is_being_compiled
            step = samples_of_next_pass(done, target, seconds, limited, per_sample, asked=pass_seconds, short=short)

    def compile(self) -> float:
        """Compile now what makes passes faster, and return the seconds it took.

        Else it is compiled while a picture renders that takes long enough, by another process, and passes change over
        to it once it is there. The picture is the same, bit for bit.
        """
        started = time.perf_counter()
        self._kernel.wait_for_wide()
        return time.perf_counter() - started

    def _progress(
        self, index: int, done: int, spp: int | None, seconds: float, limit: float | None, paths: int, rays: int
    ) -> Progress:
        left = None
        if spp is not None:
            left = (spp - done) * seconds * self.film.pixels / max(paths, 1)
        if limit is not None:
            left = min(max(limit - seconds, 0.0), left if left is not None else limit)
        return Progress(
            pass_index=index,
            spp=done,
            target_spp=spp,
            seconds=seconds,
            seconds_left=left,
            paths_per_second=paths / max(seconds, 1e-9),
            rays_per_second=rays / max(seconds, 1e-9),
            noise=self.film.noise(),
        )

    def image(self) -> NDArray[np.float32]:
        """Return (H, W, 3) float32 linear radiance as estimated so far, of the part that is rendered."""
        return self.film.mean()

    def device_image(self) -> Any:
        """Return `image` where it is: a (H, W) wp.array of vec3 on the renderer's device.

        Other frameworks take it without a copy, by DLPack: `torch.from_dlpack(image)`, `jax.dlpack.from_dlpack(image)`.
        """
        return self.film.device_mean()

    def update_vertices(self, shape: Shape | int, vertices: Any, normals: Any = None) -> None:
        """Move a shape's vertices and start the picture anew: the next frame of a simulation.

        The ray tree follows, which takes a fraction of the time that building one does, and suits the places that
        it was built for. Nothing else of the scene changes.

        Args:
            shape: one of the scene's shapes, or its number; it must not give off light, nor the scene have shapes
                that move during a picture or are in several places.
            vertices: (N, 3) NumPy array, or Warp array of vec3 on the device, which never leaves it; metres, in world
                space, as many as the shape's mesh has.
            normals: likewise, shading normals. By default those of a mesh that has some are computed anew.

        Raises:
            InputError: where the shape cannot be updated, on arrays of other sizes, or values that are not finite.
        """
        if isinstance(shape, Shape):
            numbers = [i for i, each in enumerate(self.scene.shapes) if each is shape]
            if not numbers:
                raise InputError(f"{shape.name}: not one of the scene's shapes")
            number = numbers[0]
        else:
            number = integer(shape, "shape", minimum=0, maximum=len(self.scene.shapes) - 1)
        self._built.world.update(number, self.scene.shapes[number], vertices, normals)
        self._updated = True
        self.film.clear()

    def variance(self) -> NDArray[np.float64]:
        """Return (H, W, 3) float64 variance of the estimate; NaN below two samples.

        It is that of so many independent samples. Other samplers spread a pixel's samples more evenly than chance
        does, so with them it is too high: an upper bound on average. Where it must be right, choose "independent".
        """
        return self.film.variance()

    def layers(self) -> dict[str, NDArray[Any]]:
        """Return the layers that were asked for: (H, W, channels), or (H, W) where there is one channel.

        float32, or uint32 for numbers of objects and materials, which count from 1; 0 is where nothing was met.
        """
        return self.film.layers.arrays(self.film.counts, [shape.material for shape in self.scene.shapes])

    def save(self, path: PathLike, *, force: bool = False) -> None:
        """Write the picture as `wrt render` does: with its layers, and what it was made with as the file's metadata.

        Raises:
            InputError: see `wrt.save_image`, also for `force`; and where there are layers and the file is not .exr.
        """
        from wrt.output import save_render

        save_render(Path(path), self, force=force)

    def save_checkpoint(self, path: PathLike) -> None:
        """Write everything that resuming needs, atomically. An existing file is replaced only if it is a checkpoint.

        Raises:
            InputError: where it cannot be written or would replace another file; or where vertices were updated, which
                a checkpoint does not hold.
        """
        if self._updated:
            raise InputError(f"{path}: no checkpoint of a picture whose vertices were updated; make a new Renderer")
        write_checkpoint(path, self._identity(), self.film.state())

    @classmethod
    def resume(cls, path: PathLike, scene: Scene, *, device: str = "cpu", threads: int | None = None) -> Renderer:
        """Return a renderer that goes on from a checkpoint, with its size, seed and settings.

        Raises:
            InputError: where the file is not a checkpoint, or of another scene or version.
        """
        header, arrays = read_checkpoint(path)
        options = {key: header.get(key) for key in ("seed", "strategy", "light_choice", *SETTINGS_OF_PICTURE)}
        try:
            renderer = cls(scene, device=device, threads=threads, **options)  # type: ignore[arg-type]
        except InputError as error:
            raise InputError(f"{path}: {error}") from None
        renderer.restore(path, header, arrays)
        return renderer

    def load_checkpoint(self, path: PathLike) -> None:
        """Go on from a checkpoint of this very scene, size, seed and settings.

        Raises:
            InputError: naming what differs.
        """
        self.restore(path, *read_checkpoint(path))

    def restore(self, path: PathLike, header: dict[str, Any], arrays: dict[str, NDArray[Any]]) -> None:
        """Take over the content of a checkpoint read from `path`."""
        require_same(path, header, self._identity())
        for name, array in self.film.arrays().items():
            found = arrays.get(name)
            if found is None or found.shape != array.shape or found.dtype != array.dtype:
                raise InputError(f"{path}: damaged, its array {name!r} is missing or of another shape")
        try:
            self.film.check(arrays, len(self.scene.shapes))
        except InputError as error:
            raise InputError(f"{path}: damaged, {error}") from None
        self.film.restore(arrays)

    def _identity(self) -> dict[str, Any]:
        import warp as wp

        return {
            "wrt": __version__,
            "warp": wp.config.version,
            **{key: getattr(self.settings, key) for key in SETTINGS_OF_PICTURE},
            "seed": self.seed,
            "strategy": self.strategy,
            "crop": list(self.crop) if self.crop != (0, 0, self.width, self.height) else None,
            "integrator": self.integrator,
            "layers": list(self.settings.layers),
            "light_choice": self.light_choice,
            "scene": scene_fingerprint(self.scene),
        }
