"""Frames: developed and encoded in a thread of their own, during the next pass."""

from __future__ import annotations

import threading
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cached_property, partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from wrt.develop.denoise import denoise
from wrt.develop.exposure import stops
from wrt.develop.picture import covered
from wrt.develop.picture import develop as develop_parts
from wrt.rendering.reading import PLAIN, Reading
from wrt.view.controls import Look
from wrt.view.picture import MOVING_QUALITY, RESTING_QUALITY, develop, jpeg


@dataclass(frozen=True)
class Frame:
    """A picture for the page.

    Attributes:
        number: counts from 1.
        header: the values beside the picture: samples, noise, paths per second, the camera's serial number, and so on.
        picture: a JPEG file.
    """

    number: int
    header: dict[str, Any]
    picture: bytes


@dataclass
class Source:
    """An image to make frames of.

    Attributes:
        fetch: returns the image, before it is read by `reading`.
        is_radiance: whether a look applies to it.
        header: the header of its frames.
        guides: albedo and normal, to denoise the image with; None to show it as it is.
        composed: arguments of `wrt.develop.picture.develop` for an image with lines or over a background.
        reading: how the image becomes the picture.
    """

    fetch: Callable[[], NDArray[np.float32]]
    is_radiance: bool
    header: dict[str, Any] = field(default_factory=dict)
    guides: dict[str, NDArray[np.float32]] | None = None
    composed: dict[str, Any] | None = None
    reading: Reading = PLAIN

    @cached_property
    def image(self) -> NDArray[np.float32]:
        """The picture, fetched on first use."""
        return self.reading.picture(self.fetch())

    def denoised(self) -> NDArray[np.float32]:
        """Return the picture without most of its noise."""
        guides = self.guides or {}
        return self.reading.picture(denoise(self.fetch(), guides.get("albedo"), guides.get("normal")))

    def codes(self, look: Look) -> NDArray[np.uint8]:
        """Return the image as 8-bit codes."""
        if self.composed is None:
            return develop(self.image, look if self.is_radiance else Look())
        exposure = stops(covered(self.image, self.composed["alpha"]), look.exposure)
        return develop_parts(self.image, **self.composed, tone=look.tone, exposure=exposure).codes

    def shows_same(self, source: Source | None) -> bool:
        """Return whether both show one picture, whose camera rests."""
        if source is None or self.header.get("moving") or source.header.get("moving"):
            return False
        keys = ("serial", "width", "height")
        return self.is_radiance == source.is_radiance and all(self.header.get(k) == source.header.get(k) for k in keys)


class Encoder:
    """Turns the newest image into a frame, and skips older ones.

    Denoising takes longer than rendering a preview, so another thread does it, and its result is shown if the camera
    still rests. Once a picture has been denoised, its later images are shown only denoised, or it would flicker.

    Attributes:
        look: exposure and the like; set it by `show`.
        latest: the newest frame, or None.
    """

    def __init__(self, publish: Callable[[Frame], None]) -> None:
        """Start the thread; `publish` is called in it with each frame."""
        self.look = Look()
        self.latest: Frame | None = None
        self._publish = publish
        self._source: Source | None = None
        self._waiting = threading.Condition()
        self._denoised: Source | None = None  # the last result
        self._denoising = False
        self._due, self._closed = False, False
        self._thread = threading.Thread(target=self._run, name="wrt-frames", daemon=True)
        self._thread.start()

    def put(self, source: Source) -> None:
        """Make a frame of an image; with guides, denoise it and make a frame of the result."""
        with self._waiting:
            self._source, self._due = source, source.guides is None or not source.shows_same(self._denoised)
            if source.guides is not None and not self._denoising:
                threading.Thread(target=self._denoise, args=(source,), name="wrt-denoise", daemon=True).start()
                self._denoising = True
            self._waiting.notify()

    def _denoise(self, source: Source) -> None:
        """Denoise an image, and then the newest one until no newer one has come."""
        while True:
            image = source.denoised()
            with self._waiting:
                newest = self._source
                if self.look.denoise and source.shows_same(newest):
                    header = {**source.header, "denoised": True}
                    result = Source(partial(np.asarray, image), True, header, composed=source.composed)
                    self._denoised, self._due = result, True
                    self._waiting.notify()
                if newest is None or newest is source or newest.guides is None or not self.look.denoise or self._closed:
                    self._denoising = False
                    return
            source = newest

    def show(self, look: Look) -> None:
        """Develop the newest image again with another look."""
        with self._waiting:
            self.look, self._due = look, self._source is not None
            if not look.denoise:
                self._denoised = None
            self._waiting.notify()

    def codes(self) -> NDArray[np.uint8] | None:
        """Return the newest image as 8-bit codes, or None before the first."""
        with self._waiting:
            source, look = self._shown(), self.look
        return None if source is None else source.codes(look)

    def close(self) -> None:
        """End the thread."""
        with self._waiting:
            self._closed = True
            self._waiting.notify()
        self._thread.join()

    def _shown(self) -> Source | None:
        """Return the newest image, or the last denoised one of the same picture."""
        if self._denoised is not None and self._denoised.shows_same(self._source):
            return self._denoised
        return self._source

    def _run(self) -> None:
        number = 0
        while True:
            with self._waiting:
                self._waiting.wait_for(lambda: self._due or self._closed)
                if self._closed:
                    return
                source, look, self._due = self._shown(), self.look, False
            assert source is not None
            quality = MOVING_QUALITY if source.header.get("moving") else RESTING_QUALITY
            number += 1
            self.latest = Frame(number, source.header, jpeg(source.codes(look), quality))
            self._publish(self.latest)
