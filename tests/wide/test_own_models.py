"""Models from outside run in wide kernels, with the bits of scalar ones; what cannot is named."""

from __future__ import annotations

import math
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import warp as wp
from benchmarks.own import OwnDiffuse, OwnDisk, OwnPerspective
from conftest import ROOT
from support.pages import definitions, program_of
from support.spmd_example import Mirrors, Ray, albedo_at, make_kernel, next_mirror
from support.wide_scenes import LANES, differences, needs_lanes

import wrt
from wrt.compiling.general import tiers
from wrt.kernels.bsdf import BSDFS, diffuse
from wrt.kernels.camera import projections
from wrt.kernels.camera.models import CAMERA_MODELS
from wrt.kernels.core.bsdf import Bsdf, Model
from wrt.kernels.core.spmd_marks import path_function
from wrt.kernels.lights import area_lights
from wrt.kernels.lights.shapes import LIGHT_SHAPES
from wrt.kernels.textures.procedures import PROCEDURES
from wrt.scene.camera import CAMERAS
from wrt.scene.lights import LIGHTS
from wrt.scene.materials import MATERIALS
from wrt.scene.procedural import TEXTURES
from wrt.spmd.ir import Unsupported
from wrt.spmd.translate import wide_code


def scene(material: wrt.Material, light: wrt.Light, camera: wrt.Camera) -> wrt.Scene:
    made = wrt.Scene(camera=camera, environment=wrt.ConstantEnvironment(0.2))
    made.add(wrt.sphere((0.0, 0.5, 0.0), 0.8), material=material)
    made.add(wrt.quad((-4, -0.3, 4), (8, 0, 0), (0, 0, -8)), material=wrt.Diffuse((0.6, 0.4, 0.2)))
    made.add_light(light)
    return made


@pytest.fixture
def registers() -> Any:
    """Leave the registers as they were found."""
    kinds = ((MATERIALS, BSDFS), (LIGHTS, LIGHT_SHAPES), (CAMERAS, CAMERA_MODELS), (TEXTURES, PROCEDURES))
    before = [set(register) for register, _ in kinds]
    yield
    for (register, models), names in zip(kinds, before, strict=True):
        for name in set(register) - names:
            del register[name]
            models.forget(name.replace("-", "_"))


WHERE: dict[str, Any] = {"origin": (0.1, 1.0, 3.5), "target": (0.0, 0.4, 0.0)}


@needs_lanes
@pytest.mark.slow
def test_copies_of_built_in_models_have_their_bits(registers: Any) -> None:
    wrt.register_material(OwnDiffuse, diffuse.DIFFUSE)
    wrt.register_light(OwnDisk, area_lights.DISK)
    wrt.register_camera(OwnPerspective, projections.PERSPECTIVE)
    disk: Any = ((0.0, 3.0, 1.0), (0.0, -1.0, 0.0), 0.7, 9.0)
    copies = scene(OwnDiffuse(0.7), OwnDisk(*disk), OwnPerspective(**WHERE))
    assert differences(copies) == []
    how: Any = {"width": 40, "height": 30, "spp": 17, "seed": 3}
    built_in = scene(wrt.Diffuse(0.7), wrt.DiskLight(*disk), wrt.PerspectiveCamera(**WHERE))
    assert np.array_equal(wrt.render(copies, **how), wrt.render(built_in, **how))


@needs_lanes
@pytest.mark.slow
@pytest.mark.parametrize("lanes", [8, 16])
def test_the_examples_of_the_documentation(lanes: int, registers: Any, tmp_path: Path) -> None:
    programs = {name: program_of("own", f"{name}.py") for name in ("car_paint", "wood")}
    programs |= {name: (ROOT / f"docs/own/{name}.py").read_text("utf-8") for name in ("ring", "fisheye")}
    paint, wood, ring, fisheye = (definitions(code, tmp_path / f"page_{name}.py") for name, code in programs.items())
    assert not {name for tier in tiers() for name in tier.models} & {"flakes"}, "general kernels are for all"
    light = ring["RingLight"]((0.0, 2.5, 1.0), (0.0, -1.0, 0.0), radiance=9.0)
    shown = scene(wrt.Mix(wrt.Diffuse(), paint["Flakes"]()), light, fisheye["StereographicCamera"](**WHERE))
    shown.add(wrt.sphere((1.2, 0.3, 0.0), 0.5), material=wrt.Diffuse(wood["Wood"]()))
    assert differences(shown, lanes=lanes) == []


# --- Warp's functions ---------------------------------------------------------------------------------

vec5 = wp.types.vector(length=5, dtype=wp.float32)
WEIGHTS = wp.constant(vec5(0.1, 0.4, 0.2, 0.2, 0.1))


@wp.struct
class Lobe:
    power: float
    axis: wp.vec3


@wp.func
def lobe_of(power: float, axis: wp.vec3) -> Lobe:
    lobe = Lobe()
    lobe.power = power
    lobe.axis = wp.normalize(axis)
    return lobe


@wp.func
def with_everything(bsdf: Bsdf, wo: wp.vec3, wi: wp.vec3) -> wp.vec3:
    """Functions that wrt's kernels do not call, or not with such arguments; loops, structs, bits and noise."""
    x = wp.abs(wi[0]) + 0.1
    y = wp.frac(x) + wp.round(x) + wp.cosh(x) + wp.log10(x) + wp.cbrt(x) + wp.trunc(x) + wp.mod(x, 0.3) + wp.step(x)
    y += wp.smoothstep(0.0, 1.0, x) + wp.degrees(x) + wp.erf(x)
    values = vec5(0.0)
    for k in range(5):
        values[k] = float(k) * wi[1]
    i = int(wp.clamp(x, 0.0, 1.0) * 4.0)
    values[i] += WEIGHTS[i]
    lobe = lobe_of(y, wo + wi)
    turned = wp.identity(n=3, dtype=float) + wp.outer(lobe.axis, wi)
    n = int(wi[2] * 4.0) + 2
    for j in range(n):
        if j == 3:
            continue
        y += 0.1
        if y > 30.0:
            break
    bits = wp.uint32(wp.cast(x, wp.int32)) * wp.uint32(747796405)
    bits = (bits >> wp.uint32(16)) ^ bits
    noise = wp.noise(wp.rand_init(42), wi * 3.0)
    wide = wp.sqrt(wp.float64(y) * wp.float64(y) + wp.float64(1.0))
    gray = 0.01 * (values[i] + float(bits & wp.uint32(255)) + noise + float(wide) + wp.determinant(turned))
    return bsdf.slots[0] * wp.max(wi[2], 0.0) * wp.abs(gray) if n > 0 else wp.vec3(0.0)


@needs_lanes
@pytest.mark.slow
def test_functions_without_a_version_for_lanes_are_called_for_each(registers: Any) -> None:
    wrt.register_material(OwnDiffuse, Model(with_everything, diffuse.pdf, diffuse.sample, slots=1))
    light = wrt.DiskLight((0.0, 3.0, 1.0), (0.0, -1.0, 0.0), 0.7, 9.0)
    assert differences(scene(OwnDiffuse(0.7), light, wrt.PerspectiveCamera(**WHERE))) == []


@wp.func
def several(x: float):
    return x, 2.0 * x


@wp.func
def with_print(x: float) -> float:
    print(x)
    return x


@wp.func
def with_assert(x: float) -> float:
    assert x < 1.0
    return x


@wp.func
def with_results(x: float) -> float:
    a, b = several(x)
    return a + b


@wp.func
def with_values(x: float) -> float:
    lobe = Lobe(x, wp.vec3(0.0))
    return lobe.power


@wp.func
def with_random(x: float) -> float:
    state = wp.rand_init(1)
    return x * wp.randf(state)


@wp.func
def with_quaternion(x: float) -> float:
    turn = wp.quat_from_axis_angle(wp.vec3(0.0, 0.0, 1.0), x)
    return wp.quat_rotate(turn, wp.vec3(1.0, 0.0, 0.0))[0]


@wp.func
def with_half(x: float) -> float:
    return float(wp.float16(x))


REFUSED = {
    with_print: r"test_own_models\.py:\d+: with_print: `print\(x\)`: a function prints; leave that out",
    with_assert: r"with_assert: `assert x < 1.0`: it has an `assert`; leave it out",
    with_results: r"several: `return x, 2.0 \* x`: a function has several results; return a struct",
    with_values: r"with_values: `lobe = Lobe\(.*`: a struct is made from values; make it empty",
    with_random: r"with_random: `return x \* wp.randf\(state\)`: it draws random numbers; use those",
    with_quaternion: r"with_quaternion: `turn = .*`: it has a quaternion, .*; use vectors and matrices",
    with_half: r"with_half: `return float\(wp.float16\(x\)\)`: it has a type of number other than",
}


@pytest.mark.parametrize("function", REFUSED, ids=lambda f: f.key)
def test_what_cannot_be_translated_is_named_with_what_to_write_instead(function: Any) -> None:
    @wp.func
    @path_function
    def path(mirrors: Mirrors, camera_ray: Ray, seed: int, max_depth: int) -> float:
        light = float(0.0)
        depth = int(0)
        while depth < max_depth:
            depth += 1
            t = next_mirror(mirrors, camera_ray)
            light += function(albedo_at(mirrors, t))
        return light

    with pytest.raises(Unsupported, match=REFUSED[function]):
        wide_code(make_kernel(path, function.key), 16)


# --- Programs -----------------------------------------------------------------------------------------

PROGRAM = """
import sys, warnings
import warp as wp
import wrt
from wrt.compiling.kernel import is_compiled
from wrt.kernels.bsdf import diffuse
from wrt.kernels.core.bsdf import Bsdf, Model

@wp.func
def evaluate(bsdf: Bsdf, wo: wp.vec3, wi: wp.vec3) -> wp.vec3:
    return diffuse.evaluate(bsdf, wo, wi) * FACTOR

class Own(wrt.Diffuse):
    type_name = "own_of_a_program"

wrt.register_material(Own, Model(evaluate, diffuse.pdf, diffuse.sample, slots=1))
scene = wrt.load("cornell-box")
scene.add(wrt.sphere((0.3, 0.3, 0.3), 0.1), material=Own(0.5))
renderer = wrt.Renderer(scene, width=16, height=16)
print(is_compiled(renderer._kernel.features, int(sys.argv[1])), end=" ")
renderer.compile()
print(renderer.lanes)
"""


@needs_lanes
@pytest.mark.slow
def test_programs_compile_once_and_only_what_has_changed(tmp_path: Path) -> None:
    """The model is in `__main__`, which no other process can import; the next run finds its wide kernel."""
    factor = 1.0 + 0.5 * math.modf(os.getpid() * 0.618)[0]  # a kernel that no test has compiled
    printed = []
    for each in (factor, factor, factor + 1.0):
        (tmp_path / "program.py").write_text(PROGRAM.replace("FACTOR", repr(each)))
        command = [sys.executable, "program.py", str(LANES)]
        environment = {name: value for name, value in os.environ.items() if name != "WRT_WIDE"}
        environment["PYTHONPATH"] = str(ROOT)
        done = subprocess.run(command, cwd=tmp_path, env=environment, capture_output=True, text=True)
        assert (done.returncode, done.stderr) == (0, "")
        printed.append(done.stdout)
    assert printed == [f"{known} {LANES}\n" for known in (False, True, False)]
