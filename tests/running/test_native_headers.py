"""Headers of C++ are whole, and compile in the branch that CUDA gets, too."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
from conftest import ROOT
from warp._src import context
from warp._src.build import build_cpu
from warp._src.codegen import codegen_cast_macros

from wrt.backend.warp_backend import initialize_warp
from wrt.kernels import native

FOLDER = Path(native.__file__).parent
HEADERS = sorted(str(path.relative_to(FOLDER)) for path in FOLDER.rglob("*.h"))

STRICT = """
#pragma clang diagnostic error "-Wall"
#pragma clang diagnostic error "-Wextra"
#pragma clang diagnostic ignored "-Wunused-parameter"
#pragma clang diagnostic ignored "-Wunused-function"
#pragma clang diagnostic ignored "-Wunused-const-variable"
#pragma clang diagnostic ignored "-Wbitwise-instead-of-logical"
"""
"""From here on, below Warp's own headers, warnings are errors."""

# What CUDA has and clang has not.
INTRINSICS = """
float __fmul_rn(float, float);
float fminf(float, float);
float fmaxf(float, float);
int __ffs(unsigned);
struct int2 { int x, y; };
int2 make_int2(int, int);
"""


def compile_headers(text: str, folder: Path, headers: Path = FOLDER) -> None:
    """Compile C++ that includes headers from a folder with Warp's clang, warnings being errors.

    Warp's own headers, which take ten times as long as ours, are precompiled once for each list of folders.
    """
    initialize_warp()
    source = folder / "source.cpp"
    source.write_text(f'#define WP_NO_CRT\n#include "builtin.h"\n{codegen_cast_macros}{STRICT}{text}')
    build_cpu(
        str(folder / "source.o"),
        str(source),
        optimization_level=0,
        use_precompiled_headers=True,
        pch_dir=context.runtime.get_clang_pch_dir(),
        extra_include_dirs=(str(headers), str(folder)),
    )


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["", "exact/"])
def test_headers_compile_as_loops(kind: str, tmp_path: Path) -> None:
    """The branch that CUDA gets, where what is for vectors alone is left out. A module has exact shapes or not."""
    (tmp_path / "constants.h").write_text(native.constants_header())
    included = "".join(f'#include "{name}"\n' for name in HEADERS if kind == name[: name.rfind("/") + 1])
    text = f"#define WRT_VECTORS 0\n{INTRINSICS}{included}"
    compile_headers(text, tmp_path)
    with pytest.raises(Exception, match="build failed"):
        compile_headers(f"{text}inline int mistake(float x) {{ return missing; }}\n", tmp_path)


def test_modules_depend_on_no_file_and_constants_are_those_of_python() -> None:
    """Warp hashes the text that a module gets, so it must be whole."""
    for name in HEADERS:
        text = native.text_of(name)
        assert "#include" not in text
        assert str(ROOT) not in text
        assert len(re.findall(r"^#ifndef WRT_\w+_H$", text, re.MULTILINE)) == len(set(native.headers_of(name)))
    text = native.constants_header()
    assert f"constexpr int NODE_FLOATS = {native.constants.NODE_FLOATS};" in text
    assert f"constexpr double BOX_PAD = {native.constants.BOX_PAD};" in text
