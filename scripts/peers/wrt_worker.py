"""wrt as one of the renderers that are compared: python wrt_worker.py FOLDER, see worker.py."""

from __future__ import annotations

import sys
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).resolve().parents[2]))
from worker import serve, shared_file

import wrt
from wrt.gradients.backward import Backward
from wrt.rendering.passes import LONGEST_PASS


class WrtWorker:
    """A scene file, as `wrt render` reads it. Each picture has a new renderer, whose building is not counted."""

    def __init__(self, folder: Path, device: str) -> None:
        started = time.perf_counter()
        from wrt.backend.device import Device

        Device(device)
        imported = time.perf_counter()
        shared = shared_file(folder)
        self.scene = wrt.load(shared.file if shared else folder / "scene.toml")
        self.size = {"width": shared.size, "height": shared.size} if shared else {}
        if shared and shared.box:
            self.scene = replace(self.scene, settings=replace(self.scene.settings, filter="box"))
        loaded = time.perf_counter()
        self.device = device
        self.renderer = wrt.Renderer(self.scene, device=device, **self.size)
        built = time.perf_counter() - loaded
        compiled = self.renderer.seconds_compile + self.renderer.compile()
        self.seconds = {
            "import": imported - started,
            "load": loaded - imported,
            "build": built - self.renderer.seconds_compile,
            "kernel": compiled,
        }
        self.first = True

    def about(self) -> dict[str, Any]:
        """Return version, threads and seconds."""
        return {"version": wrt.__version__, "threads": self.renderer.threads, "seconds": self.seconds}

    def render(self, spp: int, seed: int) -> float:
        """Render a new picture and return the seconds."""
        if not self.first or seed:
            del self.renderer  # before there is another one
            self.renderer = wrt.Renderer(self.scene, device=self.device, seed=seed, **self.size)
            self.renderer.compile()
        self.first = False
        started, cpu_started = time.perf_counter(), time.process_time()
        for _ in self.renderer.passes(spp=spp, pass_seconds=LONGEST_PASS):  # as `wrt.render` does
            pass
        self.cpu_seconds = time.process_time() - cpu_started
        return time.perf_counter() - started

    def gradients(self, d_image: Any, names: list[str], spp: int, seed: int) -> dict[str, Any]:
        """Return the derivatives of a loss by parameters."""
        found = self.renderer.gradients(d_image, names, spp=spp, seed=seed)
        Backward(self.renderer).compile()  # only the first gradients are without wide kernels
        return found

    def picture(self) -> Any:
        """Return (H, W, 3) float32."""
        return self.renderer.image()

    def save(self, path: str) -> None:
        """Write the last picture as PNG."""
        wrt.save_image(path, self.renderer.image())


if __name__ == "__main__":
    serve(WrtWorker)
