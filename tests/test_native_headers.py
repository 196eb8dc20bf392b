"""Headers of C++ are whole: a compiler takes each as it stands, and little C++ is left in strings of Python."""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator
from pathlib import Path

import pytest
from conftest import ROOT, Report
from warp._src import context
from warp._src.build import build_cpu
from warp._src.codegen import codegen_cast_macros

from wrt.backend.warp_backend import initialize_warp
from wrt.kernels import native

FOLDER = Path(native.__file__).parent
HEADERS = sorted(str(path.relative_to(FOLDER)) for path in FOLDER.rglob("*.h"))

# What the translator puts before the driver (`wrt/spmd`), made as small as it can be.
FRAME = """
#include "lanes/memory.h"
typedef lanes::Floats Result;
namespace {
struct Given { lanes::Ints n; };
struct Steps {
    lanes::Mask waiting;
    Result end(lanes::Mask) { return Result(0.0f); }
};
struct Path { Steps steps; lanes::Ints home; Path(int) {} };
inline void begin(Path&, const Given&, lanes::Mask) {}
inline void move(Path&, const Path&, lanes::Move) {}
struct Pixels {
    Given given_;
    lanes::Mask begun_, sampled_;
    Pixels(int) {}
    void begin(lanes::Ints, lanes::Mask) {}
    void share(int, int) {}
    void start() {}
    void carry(const Pixels&) {}
    void finish(const Result&) {}
    void after() {}
    lanes::Ints left() { return lanes::Ints(0); }
};
}
#define ROUND
#define ARGUMENTS_IN const int count_in
#define ARGUMENTS count_in
#define TARGET_in count_in
#define FIXED 0
"""


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


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder of the constants, the same for all tests."""
    made = tmp_path_factory.mktemp("headers")
    (made / "constants.h").write_text(native.constants_header())
    return made


@pytest.mark.parametrize("name", HEADERS)
def test_headers_compile_as_they_stand(name: str, folder: Path) -> None:
    frame = FRAME if name == "lanes/pool.h" else ""
    compile_headers(f'{frame}#include "{name}"\n', folder)


@pytest.mark.parametrize("kind", ["", "exact/"])
def test_headers_compile_as_loops(kind: str, folder: Path) -> None:
    """The branch that CUDA gets, where what is for vectors alone is left out. A module has exact shapes or not."""
    included = "".join(f'#include "{name}"\n' for name in HEADERS if kind == name[: name.rfind("/") + 1])
    compile_headers(f"#define WRT_VECTORS 0\n{INTRINSICS}{included}", folder)


@pytest.mark.parametrize(
    ("header", "mistake"),
    [
        ("boxes.h", ("slab.shift = o *", "slab.shift = missing *")),
        pytest.param("triangles.h", ("V det,", "V unknown det,"), marks=pytest.mark.slow),
    ],
)
def test_mistakes_in_headers_are_noticed(header: str, mistake: tuple[str, str], tmp_path: Path) -> None:
    text = (FOLDER / header).read_text()
    assert mistake[0] in text
    (tmp_path / "constants.h").write_text(native.constants_header())
    (tmp_path / header).write_text(text.replace(*mistake))
    (tmp_path / "vectors.h").write_text((FOLDER / "vectors.h").read_text())
    (tmp_path / "boxes.h").touch()
    compile_headers("", tmp_path, headers=tmp_path)
    with pytest.raises(Exception, match="build failed"):
        compile_headers(f'#include "{header}"\n', tmp_path, headers=tmp_path)


def test_modules_depend_on_no_file() -> None:
    """Warp hashes the text that a module gets, so it must be whole."""
    for name in HEADERS:
        text = native.text_of(name)
        assert "#include" not in text
        assert str(ROOT) not in text
        assert len(re.findall(r"^#ifndef WRT_\w+_H$", text, re.MULTILINE)) == len(set(native.headers_of(name)))


def test_constants_are_those_of_python() -> None:
    text = native.constants_header()
    assert f"constexpr int NODE_FLOATS = {native.constants.NODE_FLOATS};" in text
    assert f"constexpr double BOX_PAD = {native.constants.BOX_PAD};" in text


# How a call, an assignment or a return ends.
STATEMENT = re.compile(r"[\w)\]}](\(.*\)| [-+*/&|]?= .*|\+\+);\s*(//.*)?$|^\s*return\b.*;")


def test_little_is_written_in_strings(report: Report) -> None:
    """A string, other than a docstring, is C++ if one of its lines ends like a call, an assignment or a return of C++.

    Of such strings all lines count that are not empty, as they stand in the source. A string in pieces, with values
    between them, is one.
    """
    lines = {}
    for folder in ("kernels", "wrt"):
        for path in sorted((ROOT / folder).rglob("*.py")):
            if not any(parent.is_symlink() for parent in path.parents):
                lines[str(path.relative_to(ROOT))] = sum(map(len, strings_of_cpp(path.read_text(encoding="utf-8"))))
    for path, count in sorted(lines.items(), key=lambda item: -item[1])[:8]:
        report(f"{path}: lines of C++ in strings", count)
    assert 0 < sum(lines.values()) < 150


def strings_of_cpp(source: str) -> Iterator[list[str]]:
    """Return the lines of each string that is C++."""
    tree, rows = ast.parse(source), source.encode().splitlines(keepends=True)
    others = set()
    for node in ast.walk(tree):
        first = getattr(node, "body", None)
        if isinstance(first, list) and first and isinstance(first[0], ast.Expr):
            others.add(first[0].value)
        if isinstance(node, ast.JoinedStr):
            others.update(inner for inner in ast.walk(node) if inner is not node)
    for node in ast.walk(tree):
        is_string = isinstance(node, ast.JoinedStr) or (isinstance(node, ast.Constant) and isinstance(node.value, str))
        if is_string and node not in others:
            # As `ast.get_source_segment` does, which parts the whole source into rows for each string.
            found = rows[node.lineno - 1 : node.end_lineno]
            found[-1] = found[-1][: node.end_col_offset]
            found[0] = found[0][node.col_offset :]
            text = b"".join(found).decode().strip("rf").strip("\"'").replace("\\n", "\n")
            lines = [line for line in text.split("\n") if line.strip()]
            if any(STATEMENT.search(line) for line in lines):
                yield lines
