"""The progressive renderer."""

from __future__ import annotations

import dataclasses
import time
from collections.abc import Callable, Iterator
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from wrt import _above
from wrt.backend.device import Device
from wrt.develop.denoise import denoise, require_denoiser
from wrt.errors import InputError, warn
from wrt.io.safe_read import PathLike
from wrt.rendering import checkpoint
from wrt.rendering.catchers import Catchers, Caught, any_catchers
from wrt.rendering.editing import EditablePicture
from wrt.rendering.film import Film
from wrt.rendering.film_aovs import Labels, labels_of
from wrt.rendering.guides import Guides
from wrt.rendering.noise import NoiseEstimate
from wrt.rendering.passes import LONGEST_PASS, Limits, Progress, Schedule
from wrt.rendering.photons import Photons
from wrt.rendering.reading import PLAIN, Reading
from wrt.rendering.render_kernel import RenderKernel
from wrt.rendering.wide_kernel import WideKernel
from wrt.scene.layers import CATCHER, LIGHT_GROUPS, SHADOW
from wrt.scene.scene import RenderSettings, Scene, require_scene
from wrt.studio.framing import with_camera
from wrt.upload.camera import CropWindow, filter_table, outside_cameras
from wrt.upload.integrators import (
    WITH_PHOTONS,
    choose_integrator,
    hint_at_caustics,
    integrator_features,
    needs_light,
    path_settings,
)
from wrt.upload.lights.choice import LIGHT_CHOICES
from wrt.upload.lights.table import has_light
from wrt.upload.scene_data import SceneUpload
from wrt.values import integer, one_of

if TYPE_CHECKING:
    from typing_extensions import Self

    from wrt.rendering.part import Part

STRATEGIES = ("mis", "light", "bsdf")
"""How surface and image lights are sampled: by lights and BSDFs with MIS weights, or by one of them alone."""


class Renderer(EditablePicture):
    """Renders a scene pass after pass; the picture improves with each and is available at any time.

    The picture depends only on scene, size, seed, sample count, device and version. It is the same bit for bit for any
    number of threads, any split into passes, and after any stop and resume.
    """

    longest_pass = LONGEST_PASS
    """Most seconds of a pass."""

    first_pass = 1
    """Samples per pixel of the first pass, which shows how long they take."""

    def __init__(
        self,
        scene: Scene,
        *,
        device: str = "cpu",
        seed: int = 0,
        threads: int | None = None,
        strategy: str = "mis",
        light_choice: str = "auto",
        **settings: Any,
    ) -> None:
        """Build a scene for a device and compile its kernel.

        Args:
            scene: the scene; later changes to it have no effect.
            device: "cpu", "cuda" or "cuda:N".
            seed: 0 to 2³² − 1; other seeds give statistically independent pictures.
            threads: CPU threads; by default all cores.
            strategy: "mis", or "light" or "bsdf" to sample surface and image lights with only one technique.
            light_choice: how next-event estimation selects a light: "auto", or "power" or "tree" to compare the two.
            settings: fields of `wrt.RenderSettings`; by default those of the scene.

        Raises:
            InputError: on unusable values, an empty scene, or a device that does not exist.
            TypeError: on a setting that does not exist.
        """
        require_scene(scene, "a renderer")
        self._use(scene, scene.settings.changed(**settings))
        self.seed = integer(seed, "seed", minimum=0, maximum=2**32 - 1)
        self.strategy = one_of(strategy, STRATEGIES, "strategy")
        self.light_choice = one_of(light_choice, LIGHT_CHOICES, "light_choice")
        self.scene = with_camera(scene, self.width / self.height)
        if needs_light(self.integrator) and not has_light(self.scene):
            warn("the scene has no light: the picture will be black", UserWarning)
        hint_at_caustics(self.scene, self.settings, self.integrator)
        self.has_updated_vertices = False
        self.device = Device(device, threads=threads)
        self._catchers = Catchers(self) if self._has_catchers else None
        self._start_film()
        self._build()
        if self._catchers is not None:
            self._catchers.prepare()
        self.device.backend.artefacts.save()

    def _build(self, like: RenderKernel | None = None) -> None:
        """Build the scene on the device, and compile its kernel at the same time, or use one `like` that if it can."""
        has_uv = "uv" in self.settings.layers
        caustics = self.settings.caustics
        upload = SceneUpload(
            self.scene,
            self.device,
            texture_coordinates=has_uv,
            edges="edges" in self.settings.film_layers,
            light_choice=self.light_choice,
            caustics=caustics,
        )
        if caustics and upload.casters is None and like is None:
            warn(
                "caustics: no surface is a mirror, or glass or plastic that is smooth enough, so there are none",
                UserWarning,
            )
        self._choose_kernel(upload.features, upload.casters, like=like)
        with self.device.compiling(self._to_compile()):
            self._built = upload.finish(self._kernel.read)
        del upload  # and with it copies of meshes
        self.film.require_memory()  # check again, now that the scene has taken its memory
        self._start_kernel()
        if like is not None:
            self._kernel.share_wide(like)
        self._guides = Guides(self) if self.settings.denoise and self.renders_light else None

    def _beside(self, scene: Scene) -> Renderer:
        """Return a renderer of a scene with the size, the seed and the random numbers of this one, for a second film.

        Args:
            scene: shapes of this renderer's scene, seen by a camera of the same type.
        """
        other = type(self).__new__(type(self))
        other.__dict__.update(self.__dict__)
        other.scene, other.has_updated_vertices, other._catchers = scene, False, None
        other.settings = dataclasses.replace(self.settings, layers=())
        other._start_film()
        other._build(self._kernel)
        return other

    def sharing(self, **settings: Any) -> Renderer:
        """Return a renderer with other settings and a film of its own that shares the scene on the device.

        The scene is not built again, and nothing is compiled unless the integrator or the layers need another kernel.
        All renderers of a scene share its camera and parameters: after `set_camera` or `set_parameters` on one, call it
        on another before that renders again.

        Args:
            settings: fields of `wrt.RenderSettings`, except the filter and the sampler. An integrator that cannot
                render caustics leaves them out.

        Raises:
            InputError: on unusable settings, on `caustics` if this renderer has none, or when memory does not suffice
                for the film.
        """
        return self._sharing(settings)

    def of_window(self, window: CropWindow) -> Renderer:
        """Return a renderer that shares the scene, whose film has the pixels of a window alone.

        Its film is a piece of this one's: without the pixels beside it, its picture differs at the border.
        """
        return self._sharing({"crop": window}, PLAIN)

    def _sharing(self, settings: dict[str, Any], reading: Reading | None = None) -> Renderer:
        renderer = Renderer.__new__(Renderer)
        for name in ("scene", "seed", "strategy", "light_choice", "has_updated_vertices", "device", "_built"):
            setattr(renderer, name, getattr(self, name))
        if (settings.get("integrator") or WITH_PHOTONS[0]) not in WITH_PHOTONS:
            settings = {"caustics": False, **settings}
        renderer._use(self.scene, dataclasses.replace(self.settings, **settings), reading)
        if "edges" in renderer.settings.film_layers and not self._built.has_edges:
            raise InputError("the scene was built without its edges; make a new Renderer")
        if renderer.settings.caustics and not self.settings.caustics:
            raise InputError("caustics must be chosen before the scene is built; make a new Renderer")
        renderer._start_film()
        renderer._guides, renderer._catchers = None, Catchers(renderer) if renderer._has_catchers else None
        renderer._choose_kernel(self._built.features, self._built.casters, self._built.read)
        with self.device.compiling(renderer._to_compile()):
            renderer._start_kernel()
        renderer._kernel.share_wide(self._kernel)
        return renderer

    def _use(self, scene: Scene, settings: RenderSettings, reading: Reading | None = None) -> None:
        self.settings = settings
        self._reading = Reading.of(settings) if reading is None else reading
        self.integrator = choose_integrator(scene, settings)
        self._has_catchers = self.renders_light and any_catchers(scene)
        if self._has_catchers:
            if LIGHT_GROUPS in settings.layers:
                raise InputError("a picture with shadow catchers has no layers of light groups; leave one of them out")
            self.settings = dataclasses.replace(settings, transparent=True)
        elif SHADOW in settings.layers:
            raise InputError("the layer 'shadow' needs light, and a shape with shadow_catcher = true")
        if self.width * self.height >= 2**31:
            raise InputError(f"a picture of {self.width}x{self.height} has more than the 2^31 pixels that are possible")

    def _start_film(self) -> None:
        x0, y0, x1, y1 = self.window
        layers = (*self.settings.film_layers, *((CATCHER,) if self._has_catchers else ()))
        self.film = Film(x1 - x0, y1 - y0, self.device, layers, self.scene.light_groups, self._reading)
        self.film.aovs.data.edge_width = self.settings.edge_width
        self.seconds_render, self.paths = 0.0, 0
        self.noise_estimate = NoiseEstimate(self.film)

    def _choose_kernel(self, features: Any, casters: Any, read: Any = None, like: RenderKernel | None = None) -> None:
        """Choose the kernel for a scene with these features.

        Args:
            features: the features.
            casters: what photons are aimed at, if anything.
            read: those for which the scene was uploaded, if it was.
            like: another kernel, which is used if it can render the scene.
        """
        of_picture = {"sampler": self.settings.sampler, "cameras": outside_cameras(self.scene.camera)}
        features = integrator_features(dataclasses.replace(features, **of_picture), self.integrator, self.settings)
        features = features if like is None else like.features_for(features)
        self._kernel = RenderKernel(self.device, features, self.film.width, self.film.height, read=read)
        self._photons: Photons | None = None
        if features.caustics:
            self._photons = Photons(self.device, features, casters, self.seed, self.width, self.height)
            self._photons.look_from(self.camera)

    def _to_compile(self) -> list[Any]:
        return [*self._kernel.to_compile(), *(self._photons.kernels if self._photons else ())]

    def _start_kernel(self) -> None:
        path = path_settings(self.scene, self.settings, self.integrator, self.device.name)
        path.strategy = STRATEGIES.index(self.strategy)
        table = self.device.backend.array(filter_table(self.settings.filter), float, self.device.name)
        self._shared_inputs = [self._device_camera(), table, self._built.data, path]
        self._kernel.start((self._built.data, self.film.data, self.film.aovs.data))
        if self._photons is not None:
            self._photons.start(self._built.data)

    @property
    def _wide_kernels(self) -> list[WideKernel]:
        return [self._kernel.wide, *((self._photons.wide,) if self._photons else ())]

    @property
    def _inputs(self) -> list[Any]:
        """The arguments of the kernel after the number of samples."""
        return self.arguments_for(self.film)

    def arguments_for(self, film: Film) -> list[Any]:
        """Return the kernel's arguments, without the first (the target count), for a film of this picture's size."""
        return [self.seed, *self._shared_inputs, film.data, film.aovs.data]

    @property
    def threads(self) -> int:
        """CPU threads in use; 1 on CUDA."""
        return self.device.threads

    @property
    def seconds_compile(self) -> float:
        """Seconds that this renderer has waited for kernels to be compiled or loaded."""
        return self.device.seconds_compile

    @property
    def seconds_compile_beside(self) -> float:
        """Seconds that another process has spent compiling the wide kernel during rendering."""
        return sum(wide.seconds for wide in self._wide_kernels)

    @property
    def rays(self) -> int:
        """Rays of every kind traced by this renderer."""
        return self.film.rays

    def passes(
        self,
        *,
        spp: int | None = None,
        time: float | None = None,
        noise: float | None = None,
        adaptive: bool | None = None,
        pass_seconds: float | None = None,
    ) -> Iterator[Progress]:
        """Render until `spp` samples, `time` or `noise` is reached, whichever is first.

        Yields after each pass; the first takes one sample a pixel. After an early stop, by leaving the loop or by
        KeyboardInterrupt, the film can be viewed, saved and continued. Long passes are faster on the CPU, because many
        samples of a pixel in a row read the same memory.

        Args:
            spp: total samples per pixel, including those already taken. Without `spp`, `time` and `noise` the settings
                decide.
            time: seconds of rendering; the pass that runs then is finished.
            noise: relative noise of the whole picture, such as 0.01; see `noise`.
            adaptive: whether tiles that are good enough for this noise stop before the others; slightly biased
                (docs/noise.md).
            pass_seconds: approximate duration of a pass after the first, at most 10 s, on CUDA 0.4 s; by default a
                quarter of the time of all earlier passes, at least 0.4 s.
        """
        limits = Limits.of(self, spp, time, noise, adaptive, pass_seconds)
        self._kernel.expect(least := limits.least_seconds(self.film))
        if self._photons is not None:
            self._photons.wide.expect(least)
        return self._run(limits)

    def render(self, *, progress: Callable[[Progress], object] | None = None, **limits: Any) -> NDArray[np.float32]:
        """Render as `passes` does, and return the picture; see `finished`.

        Args:
            progress: called with the Progress after each pass.
            limits: options of `passes`.
        """
        for done in self.passes(**limits):
            if progress is not None:
                progress(done)
        return self.finished()

    def _run(self, limits: Limits) -> Iterator[Progress]:
        schedule = Schedule(limits, self.film, self.noise_estimate, first=self.first_pass, longest=self.longest_pass)
        while (target := schedule.next_target(short=self._passes_are_short)) is not None:
            yield schedule.progress(*self._trace(target, schedule.seconds_left))

    @property
    def _passes_are_short(self) -> bool:
        """Whether passes are short, to switch soon to a wide kernel or as nothing can interrupt one on a GPU."""
        return not self.device.is_cpu or any(wide.is_being_compiled for wide in self._wide_kernels)

    def noise(self) -> float | None:
        """Return the relative noise: the mean standard error of the pixels over their mean radiance, or None.

        While rendering towards a target of noise it is estimated from how the picture converges, see
        `wrt.rendering.noise`. Otherwise it follows from the variance of the samples and is an upper bound,
        except with the sampler "independent"; see `variance`. None while pixels have too few samples.
        """
        estimated = self.noise_estimate.noise_now()
        return self.film.noise() if estimated is None else estimated

    def _trace(self, target: int, seconds_left: float) -> tuple[float, int]:
        """Bring every pixel to `target` samples; return the seconds and camera paths that it took."""
        before = self.film.tally().samples
        started = time.perf_counter()
        try:
            with self.film.leaving_out(self.noise_estimate.stopped_pixels(), target):
                self._launch(target, seconds_left)
        finally:  # an interrupted pass counts, too
            seconds = time.perf_counter() - started
            paths = self.film.tally().samples - before
            self.seconds_render += seconds
            self.paths += paths
        return seconds, paths

    def _launch(self, target: int, seconds_left: float) -> None:
        if self._photons is None:
            self._kernel.launch([target, *self._inputs], seconds_left)
            return
        camera, _, scene, path = self._shared_inputs
        self._photons.prepare(seconds_left, self.seconds_render)
        sample = self.film.tally().least
        while sample < target:
            sample = min(self._photons.provide(sample, camera, scene, path), target)
            self._kernel.launch([sample, *self._inputs], seconds_left)
            if self.device.cancelled.is_set():
                return

    @property
    def lanes(self) -> int:
        """Paths that the kernel of the next pass follows at once; 1 for the scalar one."""
        return self._kernel.lanes

    def compile(self) -> float:
        """Compile the wide kernels now, which make passes faster, and return the seconds that it took.

        Otherwise another process compiles it during a render that is long enough, and passes switch to it when it is
        ready. The picture is the same, bit for bit.
        """
        started = time.perf_counter()
        for wide in self._wide_kernels:
            wide.wait()
        if self._catchers is not None:
            self._catchers.prepare().compile()
        return time.perf_counter() - started

    def denoised(self) -> NDArray[np.float32]:
        """Return `image` without most of its noise, by Open Image Denoise; the film keeps its samples.

        Guided by albedo and normals of what is seen, in mirrors and through glass too, for which more rays are traced.

        Raises:
            InputError: when Open Image Denoise is not installed, or there is no picture of radiance.
        """
        require_denoiser()
        guides, picture = self._film_guides(), self._caught(denoised=True)
        if picture is not None:
            return picture.image
        self._require_samples()
        # A denoiser takes noise that pixels share for a part of the picture, so they are blended afterwards.
        means = denoise(self.film.means(), **guides, threads=self._denoising_threads)
        return self._reading.picture(means)

    @property
    def _denoising_threads(self) -> int | None:
        """CPU threads of the denoiser; None for all."""
        return self.threads if self.device.is_cpu else None

    def _caught(self, *, denoised: bool = False) -> Caught | None:
        return None if self._catchers is None else self._catchers.caught(denoised=denoised)

    def denoising_guides(self) -> dict[str, NDArray[np.float32]]:
        """Return what `denoised` is guided by: "albedo" and "normal", (H, W, 3) each; see `wrt.develop.denoise`.

        Raises:
            InputError: when there is no picture of radiance.
        """
        return {name: self._reading.picture(means) for name, means in self._film_guides().items()}

    def _film_guides(self) -> dict[str, NDArray[np.float32]]:
        """Return `denoising_guides` for the film's pixels, before they are blended."""
        if not self.renders_light:
            raise InputError(f"integrator {self.integrator} renders only layers, which are not denoised")
        if self._guides is None:
            self._guides = Guides(self)
        return self._guides.layers()

    def device_image(self) -> Any:
        """Return `image` as a (H, W) wp.array of vec3 on the renderer's device.

        Other frameworks share it without a copy, as (H, W, 3): by DLPack, `torch.from_dlpack(image)` or
        `jax.dlpack.from_dlpack(image)`, and by `__cuda_array_interface__`, or `__array_interface__` on the CPU. On a
        GPU it is made on Warp's current stream.
        """
        if self._catchers is not None:
            raise InputError("a picture with shadow catchers is made of two films on the host: call image()")
        return self.film.device_mean()

    def device_film(self) -> dict[str, Any]:
        """Return the film itself as (H, W) Warp arrays on the renderer's device, without a copy; only read them.

        With the filter "shared" a crop has further pixels beside it, and means are not blended yet.
        They change with each pass, and hold the next picture after `update_vertices` or `set_camera`. Other frameworks
        share them as `device_image`; dividing `total` by `count` gives the picture, in double precision.

        Returns:
            "total" and "total_of_squares", vec3d sums of samples and of their squares; int32 "count" of samples, and
            "rejected", the ones that were not finite and count as black; int64 "rays".
        """
        return self.film.on_device()

    def save_checkpoint(self, path: PathLike) -> None:
        """Write everything needed to resume, atomically. An existing file is replaced only if it is a checkpoint.

        Raises:
            InputError: when it cannot be written or would replace another file, or when vertices were updated, which
                a checkpoint does not store.
        """
        if self.has_updated_vertices:
            raise InputError(f"{path}: no checkpoint of a picture whose vertices were updated; make a new Renderer")
        arrays = {**self.film.state(), **self.noise_estimate.state()}
        checkpoint.write_checkpoint(path, checkpoint.identity_of(self), arrays)

    def load_checkpoint(self, path: PathLike) -> None:
        """Continue from a checkpoint of the same scene, size, seed and settings.

        Raises:
            InputError: listing the differences.
        """
        self._restore(path, *checkpoint.read_checkpoint(path))

    def _restore(self, path: PathLike, header: dict[str, Any], arrays: dict[str, NDArray[Any]]) -> None:
        checkpoint.require_same(path, header, checkpoint.identity_of(self))
        try:
            self.film.check(arrays, len(self.scene.shapes))
            self.noise_estimate.restore(arrays)
        except InputError as error:
            raise InputError(f"{path}: damaged, {error}") from None
        self.film.restore(arrays)

    @classmethod
    def resume(cls, path: PathLike, scene: Scene, *, device: str = "cpu", threads: int | None = None) -> Self:
        """Return a renderer that continues from a checkpoint, with its size, seed and settings.

        Raises:
            InputError: when the file is not a checkpoint, or of another scene or version.
        """
        header, arrays = checkpoint.read_checkpoint(path)
        names = ("seed", "strategy", "light_choice", *checkpoint.SETTINGS_OF_PICTURE)
        options: dict[str, Any] = {name: header.get(name) for name in names}
        try:
            options["integrator"] = checkpoint.integrator_in(header)
            renderer = cls(scene, device=device, threads=threads, **options)
        except InputError as error:
            raise InputError(f"{path}: {error}") from None
        renderer._restore(path, header, arrays)
        return renderer

    def __reduce_ex__(self, protocol: Any) -> Any:
        """Raise TypeError: the arrays and threads of a renderer belong to a device."""
        raise TypeError(
            "a Renderer cannot be copied or pickled; copy its Scene and a file from save_checkpoint instead, and "
            "continue with Renderer.resume"
        )

    def variance(self) -> NDArray[np.float64]:
        """Return (H, W, 3) float64 variance of the estimate; NaN below two samples.

        The estimate assumes independent samples. Other samplers distribute a pixel's samples more evenly, so that it is
        an upper bound on average. For an unbiased one, choose "independent".
        """
        return self.film.variance()

    def _labels(self) -> Labels:
        return labels_of(self.scene.shapes)

    def view(self, *, spp: int | None = None) -> Any:
        """Return a live view of the picture for a notebook; see `wrt.Scene.view`."""
        return _above.viewer().view_renderer(self, spp=spp)

    def __repr__(self) -> str:
        return f"<wrt.Renderer {self.width}x{self.height} {self.integrator} on {self.device.name}, {self.spp} spp>"

    def _repr_png_(self) -> bytes | None:
        picture: bytes | None = _above.viewer().picture_of_renderer(self)
        return picture

    def part(self, number: int, of: int, *, spp: int | None = None) -> Part:
        """Render part `number` of `of`, counted from 1, for `wrt.merge`; this renderer's own picture stays as it is.

        Args:
            number: which part.
            of: number of parts; each has a few bands of rows from all over the picture.
            spp: samples per pixel; by default those of the scene's settings.

        Raises:
            InputError: if there is no such part, or vertices were updated.
        """
        from wrt.rendering.part import render_part

        return render_part(self, number, of, spp=spp)
