"""Rules that the sources keep: what imports what, how kernels are declared, how long files get."""

from __future__ import annotations

import ast
import functools
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest
from conftest import ONE_OF_A_FILE, ROOT

KERNEL_FILES = sorted((ROOT / "kernels").rglob("*.py"))
HOST_FILES = sorted((ROOT / "wrt").rglob("*.py"))
IN_PLACE = {"boxes"}
"""Arrays that one kernel fills and others then sort in place: everywhere under one name."""

MOST_LINES = 450
"""Of a file."""

MOST_LINES_OF_FUNCTIONS = {"wrt": 80, "kernels": 100}

MOST_MODULES = 15
"""In a folder."""

Graph = dict[str, set[str]]


def name_of(path: Path) -> str:
    return str(path.relative_to(ROOT))


@functools.cache
def tree_of(path: Path) -> ast.Module:
    return ast.parse(path.read_text(encoding="utf-8"))


@functools.cache
def nodes_of(path: Path) -> tuple[ast.AST, ...]:
    return tuple(ast.walk(tree_of(path)))


@functools.cache
def functions(path: Path) -> tuple[ast.FunctionDef, ...]:
    """Return every function of a file, at any depth."""
    return tuple(node for node in nodes_of(path) if isinstance(node, ast.FunctionDef))


@functools.cache
def imports(path: Path) -> tuple[tuple[str, ast.stmt], ...]:
    """Return every imported module by its full name, at any depth."""
    found = (node for node in nodes_of(path) if isinstance(node, (ast.Import, ast.ImportFrom)))
    return tuple((name, node) for node in found for name in names_imported(node))


def names_imported(node: ast.Import | ast.ImportFrom) -> list[str]:
    if isinstance(node, ast.Import):
        return [alias.name for alias in node.names]
    # `from wrt import x` may import a module.
    modules = [f"wrt.{alias.name}" for alias in node.names] if node.module == "wrt" else []
    return ["." * node.level + (node.module or ""), *modules]


def imports_of_module(tree: ast.Module) -> set[str]:
    """Return what is imported as soon as the module is, so not inside functions nor for type checkers."""
    found = set()

    def visit(nodes: list[ast.stmt]) -> None:
        for node in nodes:
            if isinstance(node, (ast.FunctionDef, ast.AsyncFunctionDef)):
                continue
            if isinstance(node, ast.If) and ast.unparse(node.test) == "TYPE_CHECKING":
                continue
            if isinstance(node, (ast.Import, ast.ImportFrom)):
                found.update(names_imported(node))
            for field in ("body", "orelse", "finalbody", "handlers"):
                visit(getattr(node, field, []))

    visit(tree.body)
    return found


def within(name: str, package: str) -> bool:
    return name == package or name.startswith(package + ".")


def decorators(function: ast.FunctionDef) -> dict[str, ast.expr]:
    return {ast.unparse(d.func if isinstance(d, ast.Call) else d): d for d in function.decorator_list}


def test_there_are_kernels_to_look_at() -> None:
    kernels = [f for path in KERNEL_FILES for f in functions(path) if "wp.kernel" in decorators(f)]
    assert len(kernels) >= 5
    assert len(KERNEL_FILES) > 20


def test_kernels_import_warp_and_themselves() -> None:
    for path in KERNEL_FILES:
        for name, node in imports(path):
            standard = name.split(".")[0] in sys.stdlib_module_names and name != "__future__"
            allowed = within(name, "warp") or within(name, "wrt.kernels") or standard
            assert allowed, f"{name_of(path)} line {node.lineno}: imports {name}"


def test_kernels_keep_their_annotations() -> None:
    """Warp reads them as objects, which `from __future__ import annotations` turns into text."""
    for path in KERNEL_FILES:
        assert "__future__" not in {name for name, _ in imports(path)}, name_of(path)


def test_kernels_are_declared_without_gradients() -> None:
    """They are half of the compiled code, and nobody asks for them."""
    for path in KERNEL_FILES:
        for function in functions(path):
            decorator = decorators(function).get("wp.kernel")
            if decorator is None:
                continue
            where = f"{name_of(path)}: {function.name}"
            options = {k.arg: k.value for k in decorator.keywords} if isinstance(decorator, ast.Call) else {}
            off = options.get("enable_backward")
            assert isinstance(off, ast.Constant), f"{where}: enable_backward must be written out"
            assert off.value is False, where


def test_every_public_thing_of_the_device_is_explained() -> None:
    """Functions and structs; those inside a factory, and those with an underscore, are explained by its text."""
    for path in KERNEL_FILES:
        tree = tree_of(path)
        assert ast.get_docstring(tree), f"{name_of(path)} says nothing about itself"
        for node in tree.body:
            if isinstance(node, (ast.FunctionDef, ast.ClassDef)) and not node.name.startswith("_"):
                assert ast.get_docstring(node), f"{name_of(path)} line {node.lineno}: {node.name} has no docstring"


def test_kernels_fill_only_arrays_named_out() -> None:
    """An array argument that a kernel only writes ends in _out; state that it reads as well needs not."""
    for path in KERNEL_FILES:
        for function in functions(path):
            if "wp.kernel" not in decorators(function):
                continue
            where = f"{name_of(path)}: {function.name}"
            arrays = {a.arg for a in function.args.args if a.annotation and "wp.array" in ast.unparse(a.annotation)}
            elements = [node for node in ast.walk(function) if isinstance(node, ast.Subscript)]
            written = {base(node) for node in elements if is_store(node)}
            read = {base(node) for node in elements if not is_store(node)}
            for name in arrays & written - read:
                assert name.endswith("_out") or name in IN_PLACE, f"{where} writes {name}"
            for name in arrays:
                assert not name.endswith("_out") or name not in read, f"{where} reads {name}"


def is_store(node: ast.Subscript) -> bool:
    return isinstance(node.ctx, ast.Store)


def base(node: ast.expr) -> str:
    while isinstance(node, (ast.Subscript, ast.Attribute)):
        node = node.value
    return node.id if isinstance(node, ast.Name) else ""


def test_static_expressions_do_not_hang_on_loop_variables() -> None:
    """Warp's hash leaves such a `wp.static` out, so two kernels would be taken for one another."""
    loops = [(path, node) for path in KERNEL_FILES for node in nodes_of(path) if isinstance(node, ast.For)]
    assert loops
    for path, loop in loops:
        variables = names_in(loop.target)
        for call in ast.walk(loop):
            if isinstance(call, ast.Call) and ast.unparse(call.func) == "wp.static":
                names = {name for argument in call.args for name in names_in(argument)}
                assert not names & variables, f"{name_of(path)} line {call.lineno}: {ast.unparse(call)}"


def names_in(node: ast.AST) -> set[str]:
    return {each.id for each in ast.walk(node) if isinstance(each, ast.Name)}


ONE_WAY = {
    "wrt/scene": ("warp", "wrt.kernels", "wrt.io", "wrt.upload", "wrt.rendering", "wrt.backend", "wrt.api", "wrt.cli"),
    "wrt/io": ("warp", "wrt.kernels", "wrt.upload", "wrt.rendering", "wrt.backend", "wrt.api", "wrt.cli"),
    "wrt/upload": ("wrt.io", "wrt.rendering", "wrt.api", "wrt.cli"),
    "wrt/backend": ("wrt.scene", "wrt.io", "wrt.upload", "wrt.rendering", "wrt.api", "wrt.cli"),
    "wrt/spmd": ("wrt.scene", "wrt.io", "wrt.upload", "wrt.rendering", "wrt.backend", "wrt.api", "wrt.cli"),
    "wrt/rendering": ("wrt.api", "wrt.cli"),
}
"""Arrows run one way: io -> scene <- upload -> kernels; rendering -> upload, backend, io; cli -> rendering."""

EXCEPT = {
    ("wrt/scene/camera.py", "wrt.kernels.camera.camera"),
    ("wrt/scene/camera.py", "wrt.kernels.camera.models"),
    ("wrt/scene/lights/__init__.py", "wrt.kernels.lights.record"),
    ("wrt/scene/lights/__init__.py", "wrt.kernels.lights.shapes"),
    ("wrt/scene/materials/__init__.py", "wrt.kernels.bsdf"),
    ("wrt/scene/materials/__init__.py", "wrt.kernels.bsdf.record"),
    *(("wrt/scene/large_mesh_normals.py", name) for name in ("wrt.backend", "wrt.backend.device")),
}
"""Imported only in calls: `register_material` and its like, and the normals of large meshes, which a kernel sums."""


@pytest.mark.parametrize("part", ONE_WAY)
def test_imports_run_one_way(part: str) -> None:
    paths = [path for path in HOST_FILES if name_of(path).startswith(part)]
    assert paths
    for path in paths:
        for name, node in imports(path):
            if (name_of(path), name) in EXCEPT:
                continue
            for forbidden in ONE_WAY[part]:
                assert not within(name, forbidden), f"{name_of(path)} line {node.lineno}: imports {name}"


def modules() -> dict[str, Path]:
    """Return the files of wrt and of its kernels by their full names."""
    packages = {"wrt": HOST_FILES, "kernels": KERNEL_FILES}
    found = {}
    for folder, paths in packages.items():
        for path in paths:
            parts = path.relative_to(ROOT).with_suffix("").parts
            parts = parts if folder == "wrt" else ("wrt", *parts)
            found[".".join(parts[:-1] if parts[-1] == "__init__" else parts)] = path
    return found


@functools.cache
def import_graph() -> Graph:
    """Return for each module those that it imports, in functions as well, but not for type checkers alone."""
    paths = modules()

    def imported(node: ast.AST) -> Iterator[str]:
        if isinstance(node, ast.If) and ast.unparse(node.test) == "TYPE_CHECKING":
            return
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom) and node.module:
            for alias in node.names:
                full = f"{node.module}.{alias.name}"
                yield full if full in paths else node.module
        for child in ast.iter_child_nodes(node):
            yield from imported(child)

    return {name: {other for other in imported(tree_of(path)) if other in paths} for name, path in paths.items()}


def circles(graph: Graph) -> list[list[str]]:
    """Return the nodes that lie on circles, together with those that share one with them (Tarjan 1972)."""
    index: dict[str, int] = {}
    low: dict[str, int] = {}
    open_nodes: list[str] = []
    found = []

    def visit(node: str) -> None:
        index[node] = low[node] = len(index)
        open_nodes.append(node)
        for other in graph[node]:
            if other not in index:
                visit(other)
            if other in open_nodes:
                low[node] = min(low[node], low[other])
        if low[node] == index[node]:
            start = open_nodes.index(node)
            if len(open_nodes) > start + 1:
                found.append(sorted(open_nodes[start:]))
            del open_nodes[start:]

    for node in graph:
        if node not in index:
            visit(node)
    return found


def inside(graph: Graph, package: str) -> Graph:
    """Return the graph among the modules and the folders in a package, each folder taken as one."""

    def part(name: str) -> str:
        return ".".join(name.split(".")[: package.count(".") + 2])

    parts: Graph = {}
    for name, others in graph.items():
        if within(name, package):
            parts.setdefault(part(name), set()).update(part(o) for o in others if within(o, package))
    return {name: others - {name} for name, others in parts.items()}


FOLDERS_IN_CIRCLES = {"wrt.kernels"}
"""Packages whose folders may import one another: records in kernels/scene hold those of folders that read scenes."""


def test_imports_make_no_circle() -> None:
    graph = import_graph()
    assert circles({"a": {"b"}, "b": {"c"}, "c": {"a", "d"}, "d": set()}) == [["a", "b", "c"]]
    assert len(graph) > 250
    assert circles(graph) == []


def test_folders_make_no_circle() -> None:
    packages = [name for name, path in modules().items() if path.name == "__init__.py"]
    assert len(packages) > 40
    for package in packages:
        if package not in FOLDERS_IN_CIRCLES:
            assert circles(inside(import_graph(), package)) == [], package


def test_heavy_imports_wait_until_they_are_needed() -> None:
    heavy = ("warp", "trimesh", "PIL", "OpenEXR", "OpenImageIO", "tqdm", "wrt.kernels", "wrt.spmd")
    for path in HOST_FILES:
        # The compiler itself is imported only where a wide kernel is compiled.
        if not name_of(path).startswith("wrt/spmd/"):
            for name in imports_of_module(tree_of(path)):
                assert not any(within(name, package) for package in heavy), f"{name_of(path)} imports {name} at once"


def test_files_stay_short() -> None:
    for path in [*KERNEL_FILES, *HOST_FILES]:
        assert len(path.read_text(encoding="utf-8").splitlines()) <= MOST_LINES, name_of(path)


def test_functions_stay_short() -> None:
    for path in [*KERNEL_FILES, *HOST_FILES]:
        most = MOST_LINES_OF_FUNCTIONS[path.relative_to(ROOT).parts[0]]
        for function in functions(path):
            length = (function.end_lineno or 0) - function.lineno + 1
            assert length <= most, f"{name_of(path)}: {function.name} has {length} lines"


def test_folders_hold_few_modules() -> None:
    for folder in {path.parent for path in [*KERNEL_FILES, *HOST_FILES]}:
        names = [path.name for path in folder.glob("*.py") if path.name != "__init__.py"]
        assert len(names) <= MOST_MODULES, name_of(folder)


def test_a_quick_run_takes_tests_that_there_are() -> None:
    for file, name in ONE_OF_A_FILE.items():
        assert name is None or name in {function.name for function in functions(ROOT / "tests" / file)}
