"""Code that one process generates and another compiles, which could not generate it.

Only the process that has registered a model can generate the kernels that call it: its module may be a program, a cell
of a notebook, or a file that nothing else should run. Compiling takes ten times as long, and needs the code alone.
"""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Any

from wrt.backend.backend import Backend, Kernel
from wrt.backend.describe import describe_arguments
from wrt.backend.kernel_cache import Build
from wrt.backend.warp_start import initialize_warp

Code = dict[str, Any]
"""A module's C++ for the CPU, and what the table of artefacts says of it once it is compiled; as JSON has it."""


def generate(call: str, kernel: Kernel) -> Code:
    """Return the code of a kernel's module.

    Args:
        call: the name of the kernel in the table of artefacts.
        kernel: the kernel.
    """
    declared = kernel.declared()
    build = Build(declared.module, "cpu")
    symbols = build.symbols()
    structs: dict[str, list[Any]] = {}
    kernels = {
        each.func.__qualname__: [symbol, *describe_arguments(each, structs.__setitem__)]
        for each, symbol in symbols.items()
    }
    source, meta = build.generate()
    binary, meta_file = build.files_in(Path())
    return {
        "name": build.name,
        "identifier": build.identifier,
        "binary": binary.name,
        "meta_file": meta_file.name,
        "meta": meta,
        "source": source,
        "options": build.options,
        "call": call,
        "value": {"kernel": [kernel.module, kernel.key]},
        "kernels": kernels,
        "structs": structs,
    }


def compile_code(backend: Backend, code: Code) -> None:
    """Compile code that another process has generated, and add it to the table of artefacts.

    Raises:
        OSError: when there is not enough disk space.
        RuntimeError: when the compiler rejects it.
    """
    initialize_warp()
    build = _GeneratedBuild(code)
    file, _ = build.files_in(build.provide())
    for name, entry in code["structs"].items():
        backend.artefacts.add("structs", name, entry)
    backend.artefacts.add("values", code["call"], code["value"])
    backend.add_file(code["name"], file, code["kernels"], code["options"]["cpu_compiler_flags"])
    backend.artefacts.save()


class _GeneratedBuild(Build):
    """A module whose code alone is known."""

    def __init__(self, code: Code) -> None:
        context: Any = sys.modules["warp._src.context"]
        self._code, self._device = code, context.runtime.get_device("cpu")

    @property
    def name(self) -> str:
        return str(self._code["name"])

    @property
    def identifier(self) -> str:
        return str(self._code["identifier"])

    def files_in(self, folder: Path) -> tuple[Path, Path]:
        return folder / self._code["binary"], folder / self._code["meta_file"]

    def run_compiler(self, folder: Path) -> None:
        from warp._src.build import build_cpu

        runtime: Any = sys.modules["warp._src.context"].runtime
        folder.mkdir(parents=True, exist_ok=True)
        binary, meta = self.files_in(folder)
        source, options = folder / f"{self.identifier}.cpp", self._code["options"]
        source.write_text(self._code["source"], encoding="utf-8")
        build_cpu(
            str(binary),
            str(source),
            mode=options["mode"],
            fast_math=options["fast_math"],
            verify_fp=options["verify_fp"],
            fuse_fp=options["fuse_fp"],
            extra_flags=options["cpu_compiler_flags"],
            optimization_level=2 if options["optimization_level"] is None else options["optimization_level"],
            use_precompiled_headers=options["use_precompiled_headers"],
            pch_dir=runtime.get_clang_pch_dir() if options["use_precompiled_headers"] else None,
            block_dim=options["block_dim"],
            enable_tiles_in_stack_memory=options["enable_tiles_in_stack_memory"],
            extra_include_dirs=options["extra_cpu_include_dirs"],
        )
        meta.write_text(json.dumps(self._code["meta"], sort_keys=True), encoding="utf-8")
