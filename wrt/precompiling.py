"""`precompile`: compile what renders of a scene need, so that they need not wait."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from wrt.api import load
from wrt.backend import current_backend
from wrt.backend.kernel_cache import COMPILED
from wrt.backend.processor import lanes_here
from wrt.rendering.renderer import Renderer
from wrt.scene.scene import Scene


@dataclass(frozen=True)
class Precompiled:
    """What `precompile` has compiled; what the cache had already is not counted.

    Attributes:
        modules: names of the modules of kernels, without the wide kernel.
        seconds: seconds that they took, and loading the others.
        lanes: paths that the wide kernel follows at once; 1 if the scene has only the scalar one on this machine.
        wide_seconds: seconds that compiling the wide kernel took; 0.0 if the cache had it.
    """

    modules: tuple[str, ...]
    seconds: float
    lanes: int
    wide_seconds: float

    def __str__(self) -> str:
        """Return what was done in words."""
        done = []
        if self.modules:
            count = len(self.modules)
            done.append(f"{count} module{'s' if count > 1 else ''} of kernels compiled in {self.seconds:.1f} s")
        if self.wide_seconds > 0.0:
            done.append(f"the wide kernel of {self.lanes} lanes compiled in {self.wide_seconds:.1f} s")
        text = "; ".join(done) or "everything was compiled before"
        return text if self.lanes > 1 else f"{text}; there is only the scalar kernel"


def precompile(source: Any, **options: Any) -> Precompiled:
    """Compile all kernels that renders of a scene need, into the cache.

    They depend on what the scene contains, such as kinds of materials and lights, and on some settings, never on
    values, sizes or numbers of samples. On a CPU with a wide kernel that is compiled too.

    Args:
        source: as for `wrt.load`, or a scene.
        options: as for `wrt.Renderer`, such as device, integrator, sampler, layers and denoise.

    Raises:
        InputError: see `wrt.load` and `wrt.Renderer`.
    """
    scene = source if isinstance(source, Scene) else load(source)
    return precompiled_by(lambda: Renderer(scene, **options))


def precompiled_by(make_renderer: Callable[[], Renderer]) -> Precompiled:
    """Make a renderer and compile its wide kernel; return what was compiled."""
    before = len(COMPILED)
    renderer = make_renderer()
    modules, seconds = tuple(sorted(set(COMPILED[before:]))), renderer.seconds_compile
    renderer.compile()
    return Precompiled(modules, seconds, renderer.lanes, renderer.seconds_compile_beside)


def compile_general(sampler: str | None = None) -> str:
    """Compile the general kernels, which render most scenes whose own kernels are not compiled, and report it.

    CPUs with a wide kernel use them.

    Args:
        sampler: the sampler of later renders; by default that of scenes which name none.
    """
    from wrt.compiling import general, kernel
    from wrt.kernels.core.features import Features
    from wrt.rendering.guides import guide_features
    from wrt.scene.scene import RenderSettings

    lanes = lanes_here()
    if lanes == 0 or not current_backend().artefacts.can_launch:
        return "there is only the scalar kernel"
    started, count = time.perf_counter(), 0
    plain = Features(("diffuse",), False, "none", sampler=sampler or RenderSettings().sampler)
    for scene, width in (plain, lanes), (guide_features(plain, RenderSettings()), kernel.SCALAR):
        for features in general.general_features(scene):
            if not kernel.is_compiled(features, width):
                count += 1
                kernel.compile_kernel(features, width, general.exercise)
    seconds = time.perf_counter() - started
    return f"{count} general kernels compiled in {seconds:.1f} s" if count else "everything was compiled before"
