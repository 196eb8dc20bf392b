"""Python processes that wrt starts import nothing from the current folder, where an upload may be."""

import subprocess
import sys
from pathlib import Path

import pytest

import wrt
from wrt.compiling.kernel import command
from wrt.distributed.processes import Processes
from wrt.io.gltf.step import read_step
from wrt.io.load_mesh import load_file

SHADOWS = (
    "cascadio",
    "ctypes",
    "json",
    "multiprocessing",
    "numpy",
    "pxr",
    "resource",
    "signal",
    "subprocess",
    "warp",
    "wrt",
)


def compile_in_another_process() -> None:
    # In a session of its own, as it lowers the priority of the whole session.
    call = command("wrt.compiling.later", "no-such-table", "nowhere")
    done = subprocess.run(call, check=False, capture_output=True, start_new_session=True)
    assert done.returncode == 1, done.stderr


def read_a_step_file() -> None:
    with pytest.raises(wrt.InputError, match="not a whole STEP file"):
        read_step(Path("part.step"), b"ISO-10303-21;\nHEADER;\nENDSEC;\nDATA;\nENDSEC;\nEND-ISO-10303-21;\n")


def read_a_usd_file() -> None:
    pytest.importorskip("pxr")
    Path("stage.usda").write_text("#usda 1.0\n")
    with pytest.raises(wrt.InputError, match="no triangles"):
        load_file("stage.usda")


def call_in_another_process() -> None:
    processes = Processes(["cpu"])
    try:
        future = processes.submit("0:cpu", lambda: None, "", abs, -1)
        future.result(timeout=120)  # a busy machine takes its time to start a process; `result` does not wait for that
        assert processes.result(future) == 1
    finally:
        processes.close()


@pytest.mark.parametrize(
    "use",
    [
        compile_in_another_process,
        read_a_step_file,
        read_a_usd_file,
        pytest.param(
            call_in_another_process,
            marks=pytest.mark.skipif(sys.version_info < (3, 11), reason="PYTHONSAFEPATH is new in Python 3.11"),
        ),
    ],
)
def test_nothing_is_imported_from_the_current_folder(use, tmp_path, monkeypatch):
    for name in SHADOWS:
        (tmp_path / f"{name}.py").write_text(f"open({str(tmp_path / 'imported')!r}, 'a').write({name!r})\n")
    monkeypatch.chdir(tmp_path)
    use()
    assert not (tmp_path / "imported").exists(), (tmp_path / "imported").read_text()
