"""A view: a thread that renders what is looked at, restarts when the camera moves, and makes frames."""

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
from wrt.rendering.renderer import Renderer
from wrt.scene.camera import Camera
from wrt.values import number
from wrt.view.controls import Settings, camera_values, denoise_of, exposure_of, moved_camera, tone_of
from wrt.view.frames import Encoder, Frame
from wrt.view.picture import Look, shown_image
from wrt.view.pictures import Pictures, file_of

Listener = Callable[[Frame | dict[str, Any]], None]
"""Called in another thread with frames, and with messages of other kinds."""

REST_SECONDS = 0.15
"""Time without a move until the picture is rendered in full again."""

WATCHED_PASS = 3.0
"""Seconds of a pass while somebody watches: each ends with a frame, which costs time. Moves and picks end it early."""

WARMING_UP = 12.0
"""Seconds of rendering after which passes take WATCHED_PASS; earlier they grow as in every render."""

MOST_SAMPLES = 1024
"""Samples per pixel at which a view rests, unless the scene asks for more: a desk should become quiet some time."""


CLOSING_SECONDS = 2.0
"""Longest wait for a thread that may be compiling or reading a large file; it ends by itself afterwards."""


_SHUTDOWN = "shutdown"
"""What thread pools say when the interpreter has begun to end, in all versions of Python."""


def _text_of(error: Exception) -> str:
    """Return what the page shows of an error."""
    if isinstance(error, (InputError, OSError)):
        return str(error)
    if isinstance(error, MemoryError):
        return str(error) or "not enough memory"
    return one_line(f"{type(error).__name__}: {error}")


class Session:
    """One scene that several pages may look at; they share its camera and its settings.

    Attributes:
        settings: what is rendered.
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
        self._open, self._spp = open, spp
        self._changed = threading.Condition()
        self._listeners: list[Listener] = []
        self._encoder = Encoder(self._tell)
        self._pictures: Pictures | None = None
        self._home: Camera | None = None  # the scene's own
        self._camera: Camera | None = None  # the one wanted
        self._serial: Any = None  # the page's number of that camera
        self._moved_at = -1.0
        self._busy: Renderer | None = None  # in a pass that a move may end
        self._requests: list[tuple[Callable[[], Any], Future[Any]]] = []
        self._reload, self._closed = True, False
        self._is_loaded = False  # whether the last reload went well
        self._passes: tuple[Renderer, Iterator[Progress]] | None = None
        self._progress: Progress | None = None  # of the last pass
        self._thread = threading.Thread(target=self._run, name="wrt-view", daemon=True)
        self._thread.start()

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
        camera, pictures = self._camera, self._pictures
        own = {} if pictures is None else {"width": pictures.main.width, "height": pictures.main.height}
        return {
            "type": "state",
            "name": self.name,
            "error": self.error,
            "camera": None if camera is None else camera_values(camera),
            "home": None if pictures is None else camera_values(pictures.home),
            "bounds": None if pictures is None else pictures.base.scene.bounds.tolist(),
            "settings": dataclasses.asdict(self.settings),
            "integrator": None if pictures is None else pictures.base.integrator,
            "exposure": self._encoder.look.exposure,
            "tone": self._encoder.look.tone,
            "denoise": self._encoder.look.denoise,
            **own,
        }

    def move(self, values: object, serial: Any = None) -> None:
        """Look through a moved camera; `values` are some of `CAMERA_KEYS`.

        Raises:
            InputError: on unusable values.
        """
        with self._changed:
            if self._camera is None:
                return
            self._camera, self._serial = moved_camera(self._camera, values), serial
            self._moved_at = time.monotonic()
            self._end_pass()

    def change(self, values: dict[str, Any]) -> None:
        """Change settings, the exposure, the tone curve or whether to denoise.

        Raises:
            InputError: on unusable values.
        """
        look = self._encoder.look
        if "exposure" in values:
            look = dataclasses.replace(look, exposure=exposure_of(values["exposure"]))
        if "tone" in values:
            look = dataclasses.replace(look, tone=tone_of(values["tone"]))
        if "denoise" in values:
            look = dataclasses.replace(look, denoise=denoise_of(values["denoise"]))
        begins_to_denoise = look.denoise and not self._encoder.look.denoise
        if look != self._encoder.look:
            self._encoder.show(look)
        settings = self.settings.changed(values)
        if settings != self.settings or begins_to_denoise:
            with self._changed:
                self.settings = settings
                if self._is_loaded:
                    self.error = ""  # of the former settings
                self._end_pass()
        if begins_to_denoise:  # also of a picture that is finished
            self._ask(self._show_again)
        self._tell(self.state())

    def reload(self) -> None:
        """Open the scene again, with the present camera if its own has not changed."""
        with self._changed:
            self._reload = True
            self._end_pass()

    def save(self, suffix: str) -> Future[bytes]:
        """Return the bytes of a picture file (.png, .exr, .npy), as `wrt render` writes them at this sample count."""
        return self._ask(lambda: file_of(self._present_main(), suffix, self._encoder.look))

    def pick(self, x: object, y: object) -> Future[dict[str, Any] | None]:
        """Return what is seen at a place in the picture, from (0, 0) at the top left to (1, 1); None if nothing.

        Raises:
            InputError: if that is not a place.
        """
        u, v = (number(value, name, minimum=0.0, maximum=1.0) for value, name in ((x, "x"), (y, "y")))
        return self._ask(lambda: self._required().pick(self._required_camera(), u, v))

    def codes(self) -> Any:
        """Return the newest picture as (H, W, 3) 8-bit codes, or None."""
        return self._encoder.codes()

    @property
    def camera(self) -> Camera | None:
        """The camera in use, or None before there is a scene."""
        return self._camera

    def close(self) -> None:
        """End the threads; a running pass is left unfinished."""
        with self._changed:
            self._closed = True
            self._end_pass()
        self._thread.join(CLOSING_SECONDS)
        self._encoder.close()
        self.cancel_requests()
        if not self._thread.is_alive():
            self._pictures, self._passes = None, None  # and their memory on the device

    def cancel_requests(self) -> None:
        """Cancel what was asked for and is not answered yet."""
        with self._changed:
            requests, self._requests = self._requests, []
        for _, future in requests:
            future.cancel()

    def _ask(self, answer: Callable[[], Any]) -> Future[Any]:
        future: Future[Any] = Future()
        with self._changed:
            self._requests.append((answer, future))
            self._end_pass()
        return future

    def _end_pass(self) -> None:
        """End a pass that is out of date, and wake the thread; call it with the lock held."""
        if self._busy is not None:
            self._busy.device.cancelled.set()
        self._changed.notify()

    def _tell(self, what: Frame | dict[str, Any]) -> None:
        for listener in list(self._listeners):
            listener(what)

    def _required(self) -> Pictures:
        if self._pictures is None:
            raise InputError(self.error or "there is no scene yet")
        return self._pictures

    def _required_camera(self) -> Camera:
        if self._camera is None:
            raise InputError(self.error or "there is no scene yet")
        return self._camera

    def _present_main(self) -> Renderer:
        main = self._required().aim(self._required().main, self._required_camera())
        samples = main.film.tally()
        most = samples.most
        if most == 0 or most != samples.least:  # after a pass that was ended
            for _ in main.passes(spp=max(1, most)):
                pass
        return main

    def _run(self) -> None:
        while not self._closed:
            try:
                with warnings.catch_warnings():
                    warnings.simplefilter("ignore")
                    worked = self._step()
            except Exception as error:  # noqa: BLE001  # the page shows it, and without this thread nobody would answer
                if isinstance(error, RuntimeError) and _SHUTDOWN in str(error):
                    return
                self._fail(_text_of(error))
                worked = False
            if not worked:
                with self._changed:
                    self._changed.wait_for(lambda: self._has_work() or self._closed, timeout=60.0)

    def _fail(self, text: str) -> None:
        self.error = text
        self._tell(self.state())

    def _has_work(self) -> bool:
        if self._reload or self._requests:
            return True
        pictures = self._pictures
        if pictures is None or self._camera is None or not self._listeners or self.error:
            return False
        shown = pictures.shown(self.settings)
        return shown is None or not pictures.is_aimed(shown, self._camera) or shown.spp < self._target(shown)

    def _target(self, renderer: Renderer) -> int:
        if not renderer.renders_light:
            return 16
        return self._spp or max(renderer.settings.spp, MOST_SAMPLES)

    def _step(self) -> bool:
        """Do the next thing; return whether there was anything to do."""
        if self._reload:
            self._reload = False
            self._load()
            return True
        pictures, camera, settings = self._pictures, self._camera, self.settings
        moving = time.monotonic() - self._moved_at < REST_SECONDS
        if self._requests and (not moving or pictures is None):
            self._answer()
            return True
        if pictures is None or camera is None or not self._listeners or (self.error and not moving):
            return False
        if moving:
            self._preview(pictures, settings, camera)
            return True
        renderer = pictures.aim(pictures.get(settings), camera)
        return self._pass(renderer, settings)

    def _load(self) -> None:
        self._passes, self._is_loaded = None, False
        renderer = self._open()
        self._pictures = Pictures(renderer)
        if self._home is None:
            self._encoder.look = Look.of(renderer.settings)
        with self._changed:
            if self._home != self._pictures.home:
                self._home = self._camera = self._pictures.home
        self.error, self._is_loaded = "", True
        self._tell(self.state())
        if self._camera is not None:  # so that a page finds a picture when it opens
            self._preview(self._pictures, self.settings, self._camera)

    def _answer(self) -> None:
        with self._changed:
            if not self._requests:  # they were cancelled
                return
            request = answer, future = self._requests[0]
        outcome: Any = None
        error: Exception | None = None
        try:
            outcome = answer()
        except Exception as found:  # noqa: BLE001  # who asked gets it
            error = found if isinstance(found, (InputError, OSError, MemoryError)) else OSError(_text_of(found))
        with self._changed:
            if request in self._requests:  # it was not cancelled meanwhile
                self._requests.remove(request)
                future.set_result(outcome) if error is None else future.set_exception(error)
        self._passes = None

    def _preview(self, pictures: Pictures, settings: Settings, camera: Camera) -> None:
        """Render one sample of few pixels, as many as can follow the hand."""
        serial = self._serial
        renderer = pictures.aim(pictures.preview(settings), camera)
        for progress in renderer.passes(spp=renderer.spp + 1):
            pictures.timed(progress.paths_per_second)
        self._put(renderer, settings, serial, progress=None)

    def _pass(self, renderer: Renderer, settings: Settings) -> bool:
        """Render a pass of the picture; return whether it still needs more."""
        target = self._target(renderer)
        if renderer.spp >= target:
            return False
        if self._passes is None or self._passes[0] is not renderer or renderer.spp == 0:
            seconds = WATCHED_PASS if renderer.seconds_render > WARMING_UP else None
            self._passes = renderer, renderer.passes(spp=target, pass_seconds=seconds)
        with self._changed:
            if self._reload or self._closed or self._camera is None or self.settings != settings:
                return True
            if time.monotonic() - self._moved_at < REST_SECONDS:
                return True
            renderer.device.cancelled.clear()
            self._busy, serial = renderer, self._serial
        seconds_before, paths_before = renderer.seconds_render, renderer.paths
        try:
            progress = next(self._passes[1], None)
        finally:
            with self._changed:
                self._busy = None
                ended = renderer.device.cancelled.is_set()
                renderer.device.cancelled.clear()
        if progress is None or ended:
            self._passes = None
            return True
        rate = (renderer.paths - paths_before) / max(renderer.seconds_render - seconds_before, 1e-9)
        progress = dataclasses.replace(progress, paths_per_second=rate)  # of this pass alone
        if renderer.renders_light:
            self._required().timed(rate)
        if progress.seconds > WARMING_UP and renderer.seconds_render - progress.seconds < WARMING_UP:
            self._passes = None  # begin again with shorter passes
        self._put(renderer, settings, serial, progress)
        return True

    def _show_again(self) -> None:
        """Make a frame of the picture so far."""
        pictures, camera = self._required(), self._required_camera()
        renderer = pictures.shown(self.settings)
        if renderer is not None and renderer.spp > 0 and pictures.is_aimed(renderer, camera):
            self._put(renderer, self.settings, self._serial, self._progress)

    def _put(self, renderer: Renderer, settings: Settings, serial: Any, progress: Progress | None) -> None:
        fetch, is_radiance = shown_image(renderer, settings.layer)
        self._progress = progress or self._progress
        guided = is_radiance and progress is not None and self._encoder.look.denoise
        guides = renderer.denoising_guides() if guided else None
        header = {
            "serial": serial,
            "moving": progress is None,
            "spp": renderer.spp,
            "target": self._target(renderer),
            "noise": None if progress is None else progress.noise,
            "paths_per_second": None if progress is None else progress.paths_per_second,
            "seconds": renderer.seconds_render,
            "width": renderer.film.width,
            "height": renderer.film.height,
        }
        self._encoder.put(fetch, is_radiance, header, guides)
