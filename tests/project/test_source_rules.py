"""Rules of the sources whose breach is a fault: what imports what, and how kernels are declared."""

import ast
import functools
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest
from conftest import ROOT

KERNEL_FILES = sorted((ROOT / "kernels").rglob("*.py"))
HOST_FILES = sorted((ROOT / "wrt").rglob("*.py"))


def name_of(path: Path) -> str:
    return str(path.relative_to(ROOT))


@functools.cache
def tree_of(path: Path) -> ast.Module:
    return ast.parse(path.read_text(encoding="utf-8"))


@functools.cache
def nodes_of(path: Path) -> tuple[ast.AST, ...]:
    return tuple(ast.walk(tree_of(path)))


@functools.cache
def modules() -> dict[str, Path]:
    """Return the files of wrt and of its kernels by their full names."""
    found = {}
    for path in [*HOST_FILES, *KERNEL_FILES]:
        parts = path.relative_to(ROOT).with_suffix("").parts
        parts = parts if parts[0] == "wrt" else ("wrt", *parts)
        found[".".join(parts[:-1] if parts[-1] == "__init__" else parts)] = path
    return found


@functools.cache
def imported(path: Path, *, types: bool = False) -> set[str]:
    """Return the modules that a file imports, also in functions; `types`: also for type checkers alone."""

    def walk(node: ast.AST) -> Iterator[str]:
        if not types and isinstance(node, ast.If) and ast.unparse(node.test) == "TYPE_CHECKING":
            return
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            for alias in node.names:
                full = f"{node.module}.{alias.name}"
                yield full if full in modules() else "." * node.level + (node.module or "")
        for child in ast.iter_child_nodes(node):
            if isinstance(child, (ast.stmt, ast.excepthandler)):
                yield from walk(child)

    return set(walk(tree_of(path)))


def within(name: str, packages: tuple[str, ...]) -> bool:
    return any(name == package or name.startswith(package + ".") for package in packages)


def test_kernels_import_warp_and_themselves_and_keep_their_annotations():
    """Warp reads annotations as objects, which `from __future__ import annotations` turns into text."""
    assert len(KERNEL_FILES) > 20
    for path in KERNEL_FILES:
        for name in imported(path):
            standard = name.split(".")[0] in sys.stdlib_module_names and name != "__future__"
            assert standard or within(name, ("warp", "wrt.kernels")), f"{name_of(path)} imports {name}"


def test_functions_are_differentiated_where_adjoints_are_complete():
    """Importing `kernels/gradients` completes the adjoints of Warp."""
    found = {path.parent for path in KERNEL_FILES for node in nodes_of(path) if is_call_of(node, "wp.grad")}
    assert found == {ROOT / "kernels" / "gradients"}


def is_call_of(node: ast.AST, function: str) -> bool:
    return isinstance(node, ast.Call) and ast.unparse(node.func) == function


def test_kernels_are_declared_without_gradients():
    """Gradients would be half of the compiled code, and nothing uses them."""
    count = 0
    for path in KERNEL_FILES:
        for function in nodes_of(path):
            for each in function.decorator_list if isinstance(function, ast.FunctionDef) else ():
                call = each if isinstance(each, ast.Call) else None
                if ast.unparse(each if call is None else call.func) == "wp.kernel":
                    options = {k.arg: ast.unparse(k.value) for k in call.keywords} if call else {}
                    assert options.get("enable_backward") == "False", f"{name_of(path)}: {function.name}"
                    count += 1
    assert count >= 5


def test_static_expressions_do_not_hang_on_loop_variables():
    """Warp's hash leaves such a `wp.static` out, so two kernels would be taken for one another."""

    def names_in(node):
        return {each.id for each in ast.walk(node) if isinstance(each, ast.Name)}

    loops = [(path, node) for path in KERNEL_FILES for node in nodes_of(path) if isinstance(node, ast.For)]
    assert loops
    for path, loop in loops:
        for call in ast.walk(loop):
            if isinstance(call, ast.Call) and ast.unparse(call.func) == "wp.static":
                names = {name for argument in call.args for name in names_in(argument)}
                assert not names & names_in(loop.target), f"{name_of(path)} line {call.lineno}: {ast.unparse(call)}"


ORDER = (
    *("wrt.cli", "wrt.view", "wrt.api", "wrt.progress", "wrt.distributed", "wrt.gradients", "wrt.checking"),
    "wrt.rendering",
    *("wrt.compiling", "wrt.upload", "wrt.animation", "wrt.studio", "wrt.io", "wrt.describe", "wrt.develop"),
    *("wrt.backend", "wrt.spmd", "wrt.kernels", "warp", "wrt.scene"),
)
"""From the command line down: a folder imports only what comes after it."""

RUN_KERNELS = ("wrt.backend", "wrt.spmd", "wrt.kernels", "warp")
ABOUT_FILES = ("wrt.animation", "wrt.studio", "wrt.io", "wrt.describe", "wrt.develop")
APART = {
    **dict.fromkeys(("wrt.upload", "wrt.compiling"), ABOUT_FILES),
    **dict.fromkeys(("wrt.backend", "wrt.spmd"), ("wrt.scene",)),
    **dict.fromkeys(("wrt.animation", "wrt.studio", "wrt.describe", "wrt.develop"), RUN_KERNELS),
}
"""What comes after a folder and is not for it, either."""


@pytest.mark.parametrize("part", [part for part in ORDER if part not in ("wrt.kernels", "warp")])
def test_imports_run_one_way(part: str) -> None:
    not_for_it = (*ORDER[: ORDER.index(part)], *APART.get(part, ()))
    paths = [path for name, path in modules().items() if within(name, (part,))]
    assert paths
    for path in paths:
        for name in imported(path, types=True):
            assert not within(name, not_for_it), f"{name_of(path)} imports {name}"


def circles(graph: dict[str, set[str]]) -> list[str]:
    """Return the nodes on circles or between them: what remains without first and last nodes."""
    nodes = set(graph)
    while True:
        targets = {target for node in nodes for target in graph[node]}
        inner = {node for node in nodes if graph[node] & nodes and node in targets}
        if inner == nodes:
            return sorted(nodes)
        nodes = inner


def test_imports_make_no_circle_and_each_folder_has_a_place():
    assert circles({"a": {"b"}, "b": {"a", "c"}, "c": set()}) == ["a", "b"]
    graph = {name: imported(path) & set(modules()) for name, path in modules().items()}
    assert len(graph) > 250
    assert sum(map(len, graph.values())) > 500
    assert circles(graph) == []
    folders = {f"wrt.{path.parent.name}" for path in (ROOT / "wrt").glob("*/__init__.py")}
    assert folders - {"wrt.meshes"} <= set(ORDER)
