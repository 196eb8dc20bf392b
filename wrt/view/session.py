"""A view: a thread that renders the picture of a camera, restarts when the camera moves, and makes frames."""

from __future__ import annotations

import contextlib
import dataclasses
import threading
import time
import warnings
from collections.abc import Callable, Iterator
from concurrent.futures import Future
from typing import Any

from wrt.errors import InputError, one_line
from wrt.rendering.passes import Progress
from wrt.rendering.reading import PLAIN
from wrt.rendering.renderer import Renderer
from wrt.scene.camera import Camera
from wrt.scene.integrators import INTEGRATORS
from wrt.values import number
from wrt.view.controls import Look, Settings, camera_values, changed, moved_camera
from wrt.view.frames import Encoder, Frame, Source
from wrt.view.picture import composed, shown_image
from wrt.view.pictures import Pictures, file_of

Listener = Callable[[Frame | dict[str, Any]], None]
"""Called in another thread with frames, and with messages of other kinds."""

REST_SECONDS = 0.15
"""Time without a move until the picture is rendered in full again."""

GROWING = 12.0
"""Seconds for which passes grow as in every render, to three seconds; then they begin again with short ones."""

MOST_SAMPLES = 1024
"""Samples per pixel at which a view stops, unless the scene asks for more."""

LAYER_SAMPLES = 16
"""Samples per pixel of layers and the like, which have little noise."""

CLOSING_SECONDS = 2.0
"""Longest wait for a thread that may be compiling or reading a large file; it ends by itself afterwards."""

_SHUTDOWN = "shutdown"
"""In the message of thread pools when the interpreter has begun to end, in all versions of Python."""


def _text_of(error: Exception) -> str:
    """Return the text of an error for the page."""
    if isinstance(error, (InputError, OSError)):
        return str(error)
    if isinstance(error, MemoryError):
        return str(error) or "not enough memory"
    return one_line(f"{type(error).__name__}: {error}")


class Session:
    """One scene that several pages may show; they share its camera and its settings.

    Other threads call the methods without an underscore, which leave their wishes in fields and wake the thread. The
    thread takes one step after the other, see `_next_step`: load the scene, answer a request, render a preview, or
    render a pass. A wish ends a pass early.

    Attributes:
        settings: the settings of the render.
        camera: the wanted camera, None until the scene is loaded.
        error: why there is no picture, or the last reload failed; "" if all is well.
    """

    def __init__(self, open: Callable[[], Renderer], *, name: str = "", spp: int | None = None) -> None:
        """Start the thread.

        Args:
            open: makes the renderer, in that thread; called again by `reload`.
            name: shown as the title, and the name of saved pictures.
            spp: samples per pixel at which to stop.
        """
        self.name, self.settings, self.error = name, Settings(), ""
        self.camera: Camera | None = None
        self._open, self._spp = open, spp
        self._changed = threading.Condition()
        self._listeners: list[Listener] = []
        self._encoder = Encoder(self._tell)
        self._requests: list[tuple[Callable[[], Any], Future[Any]]] = []
        self._reload, self._closed = True, False
        self._is_loaded = False  # whether the last reload went well
        self._serial: Any = None  # the page's number of the camera
        self._moved_at = -1.0
        # Of the thread alone.
        self._pictures: Pictures | None = None
        self._home: Camera | None = None  # the scene's own camera
        self._passes: tuple[Renderer, Iterator[Progress]] | None = None
        self._progress: Progress | None = None  # of the last pass
        self._running: Renderer | None = None  # in a pass that can be ended
        self._thread = threading.Thread(target=self._run, name="wrt-view", daemon=True)
        self._thread.start()

    # --- For other threads ---

    def listen(self, listener: Listener) -> Callable[[], None]:
        """Call `listener` from now on, first with the present state; return the function that ends it."""
        with self._changed:
            self._listeners.append(listener)
            self._changed.notify()
        listener(self.state())
        if (latest := self._encoder.latest) is not None:
            listener(latest)

        def end() -> None:
            with self._changed, contextlib.suppress(ValueError):
                self._listeners.remove(listener)

        return end

    def state(self) -> dict[str, Any]:
        """Return the message that describes the view to a page."""
        camera, pictures = self.camera, self._pictures
        size = {} if pictures is None else {"width": pictures.main.width, "height": pictures.main.height}
        return {
            "type": "state",
            "name": self.name,
            "error": self.error,
            "camera": None if camera is None else camera_values(camera),
            "home": None if pictures is None else camera_values(pictures.home),
            "bounds": None if pictures is None else pictures.base.scene.bounds.tolist(),
            "settings": dataclasses.asdict(self.settings),
            "integrator": None if pictures is None else pictures.base.integrator,
            "own_integrators": [name for name, cls in INTEGRATORS.items() if cls is not None],
            **dataclasses.asdict(self._encoder.look),
            **size,
        }

    def move(self, values: object, serial: Any = None) -> None:
        """Look through a moved camera; `values` are some of `CAMERA_KEYS`.

        Raises:
            InputError: on unusable values.
        """
        with self._changed:
            if self.camera is None:
                return
            self.camera, self._serial = moved_camera(self.camera, values), serial
            self._moved_at = time.monotonic()
            self._end_pass()

    def change(self, message: dict[str, Any]) -> None:
        """Change settings, the exposure, the tone curve or whether to denoise.

        Raises:
            InputError: on unusable values.
        """
        old, look = self._encoder.look, changed(self._encoder.look, message)
        begins_to_denoise = look.denoise and not old.denoise
        if look != old:
            self._encoder.show(look)
        settings = changed(self.settings, message)
        if settings != self.settings or begins_to_denoise:
            with self._changed:
                self.settings = settings
                if self._is_loaded:
                    self.error = ""  # of the previous settings
                self._end_pass()
        if begins_to_denoise:  # also a finished picture
            self._request(self._show_again)
        self._tell(self.state())

    def reload(self) -> None:
        """Open the scene again, with the present camera if its own has not changed."""
        with self._changed:
            self._reload = True
            self._end_pass()

    def save(self, suffix: str) -> Future[bytes]:
        """Return the bytes of a picture file (.png, .exr, .npy), as `wrt render` writes them at this sample count."""
        return self._request(lambda: file_of(self._finished_main(), suffix, self._encoder.look))

    def pick(self, x: object, y: object) -> Future[dict[str, Any] | None]:
        """Return the surface at a place from (0, 0) at the top left to (1, 1), see `Pictures.pick`.

        Raises:
            InputError: if that is not a place.
        """
        u, v = (number(value, name, minimum=0.0, maximum=1.0) for value, name in ((x, "x"), (y, "y")))

        def pick() -> dict[str, Any] | None:
            pictures, camera = self._present()
            return pictures.pick(camera, u, v)

        return self._request(pick)

    def codes(self) -> Any:
        """Return the newest picture as (H, W, 3) 8-bit codes, or None."""
        return self._encoder.codes()

    def close(self) -> None:
        """End the threads; a running pass is left unfinished."""
        with self._changed:
            self._closed = True
            self._end_pass()
        self._thread.join(CLOSING_SECONDS)
        self._encoder.close()
        for _, future in self._requests:
            future.cancel()
        if not self._thread.is_alive():
            self._pictures, self._passes = None, None  # and their memory on the device

    def _request(self, answer: Callable[[], Any]) -> Future[Any]:
        """Let the thread call a function, and return its future result."""
        future: Future[Any] = Future()
        with self._changed:
            self._requests.append((answer, future))
            self._end_pass()
        return future

    def _end_pass(self) -> None:
        """End a pass that is out of date, and wake the thread; call it with the lock held."""
        if self._running is not None:
            self._running.device.cancelled.set()
        self._changed.notify()

    def _tell(self, message: Frame | dict[str, Any]) -> None:
        for listener in list(self._listeners):
            listener(message)

    # --- The thread ---

    def _run(self) -> None:
        while not self._closed:
            step = self._next_step()
            if step is None:
                with self._changed:
                    self._changed.wait_for(lambda: self._closed or self._next_step() is not None, timeout=60.0)
                continue
            try:
                with warnings.catch_warnings():
                    warnings.simplefilter("ignore")
                    step()
            except Exception as error:  # noqa: BLE001  # the page shows it; the thread must live on to answer
                if isinstance(error, RuntimeError) and _SHUTDOWN in str(error):
                    return
                self.error = _text_of(error)
                self._tell(self.state())

    def _next_step(self) -> Callable[[], None] | None:
        """Return what the thread does next, None to wait for a change."""
        pictures, camera = self._pictures, self.camera
        if self._reload:
            return self._load
        if self._requests and (pictures is None or not self._is_moving()):
            return self._answer
        if pictures is None or camera is None or not self._listeners or self.error:
            return None
        if self._is_moving():
            return self._preview
        renderer = pictures.shown(self.settings)
        is_finished = (
            renderer is not None and pictures.is_aimed(renderer, camera) and renderer.spp >= self._target(renderer)
        )
        return None if is_finished else self._pass

    def _is_moving(self) -> bool:
        return time.monotonic() - self._moved_at < REST_SECONDS

    def _target(self, renderer: Renderer) -> int:
        if not renderer.renders_light:
            return LAYER_SAMPLES
        return self._spp or max(renderer.settings.spp, MOST_SAMPLES)

    def _present(self) -> tuple[Pictures, Camera]:
        if self._pictures is None or self.camera is None:
            raise InputError(self.error or "there is no scene yet")
        return self._pictures, self.camera

    def _load(self) -> None:
        self._reload = False
        self._passes, self._is_loaded = None, False
        renderer = self._open()
        self._pictures = Pictures(renderer)
        if self._home is None:
            self._encoder.look = Look.from_settings(renderer.settings)
        with self._changed:
            if self._home != self._pictures.home:
                self._home = self.camera = self._pictures.home
        self.error, self._is_loaded = "", True
        self._tell(self.state())
        self._preview()  # so that a page finds a picture when it opens

    def _answer(self) -> None:
        with self._changed:
            answer, future = self._requests.pop(0)
        if not future.set_running_or_notify_cancel():
            return
        try:
            future.set_result(answer())
        except (InputError, OSError, MemoryError) as error:
            future.set_exception(error)
        except Exception as error:  # noqa: BLE001  # it goes to the caller
            future.set_exception(OSError(_text_of(error)))
        self._passes = None

    def _finished_main(self) -> Renderer:
        """Return the renderer of the picture, with as many samples in each pixel as any has."""
        pictures, camera = self._present()
        main = pictures.aim(pictures.main, camera)
        samples = main.film.tally()
        if samples.most == 0 or samples.most != samples.least:  # a pass was ended early
            for _ in main.passes(spp=max(1, samples.most)):
                pass
        return main

    def _preview(self) -> None:
        """Render one sample of few pixels, so few that the picture follows the hand."""
        (pictures, camera), settings, serial = self._present(), self.settings, self._serial
        renderer = pictures.aim(pictures.preview(settings), camera)
        for progress in renderer.passes(spp=renderer.spp + 1):
            pictures.timed(progress.paths_per_second)
        self._put(renderer, settings, serial, progress=None)

    def _pass(self) -> None:
        """Render a pass of the picture, unless something has changed."""
        (pictures, camera), settings = self._present(), self.settings
        renderer = pictures.aim(pictures.get(settings), camera)
        target = self._target(renderer)
        if renderer.spp >= target:
            return
        if self._passes is None or self._passes[0] is not renderer or renderer.spp == 0:
            self._passes = renderer, renderer.passes(spp=target)
        with self._changed:
            if self._reload or self._closed or self.settings != settings or self._is_moving():
                return
            renderer.device.cancelled.clear()
            self._running, serial = renderer, self._serial
        old_seconds, old_paths = renderer.seconds_render, renderer.paths
        try:
            progress = next(self._passes[1], None)
        finally:
            with self._changed:
                self._running = None
                ended = renderer.device.cancelled.is_set()
                renderer.device.cancelled.clear()
        if progress is None or ended:
            self._passes = None
            return
        rate = (renderer.paths - old_paths) / max(renderer.seconds_render - old_seconds, 1e-9)
        progress = dataclasses.replace(progress, paths_per_second=rate)  # of this pass alone
        if renderer.renders_light:
            pictures.timed(rate)
        if progress.seconds > GROWING:
            self._passes = None
        self._put(renderer, settings, serial, progress)

    def _show_again(self) -> None:
        """Make a frame of the picture so far."""
        pictures, camera = self._present()
        renderer = pictures.shown(self.settings)
        if renderer is not None and renderer.spp > 0 and pictures.is_aimed(renderer, camera):
            self._put(renderer, self.settings, self._serial, self._progress)

    def _put(self, renderer: Renderer, settings: Settings, serial: Any, progress: Progress | None) -> None:
        fetch, is_radiance = shown_image(renderer, settings.layer)
        self._progress = progress or self._progress
        width, height = renderer.film.picture_size
        guided = renderer.renders_light and progress is not None and self._encoder.look.denoise
        guides = renderer._film_guides() if guided else None
        header = {
            "serial": serial,
            "moving": progress is None,
            "spp": renderer.spp,
            "target": self._target(renderer),
            "noise": None if progress is None else progress.noise,
            "paths_per_second": None if progress is None else progress.paths_per_second,
            "seconds": renderer.seconds_render,
            "width": width,
            "height": height,
        }
        reading, parts = (renderer.film.reading, composed(renderer)) if is_radiance else (PLAIN, None)
        self._encoder.put(Source(fetch, is_radiance, header, guides, parts, reading))
