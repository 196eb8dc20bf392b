"""The renderers that can be compared, and talking to them: each in a process and an environment of its own."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import NDArray

import wrt

FOLDER = Path(__file__).resolve().parent

LLVM_HINT = """\
Mitsuba's llvm variants need the library of LLVM, which no package on PyPI has. On Debian or Ubuntu, without installing
it, in an empty folder:
    apt-get download libllvm19 libz3-4 libedit2 libbsd0 libmd0
    for package in *.deb; do dpkg -x "$package" .; done
and then give that folder by --llvm FOLDER. Installed, `sudo apt-get install libllvm19` is enough."""


CYCLES_HINT = """\
pip install bpy, in an environment of the Python that it is made for (3.11 for bpy 4.2 to 5.0), and then
--cycles-python THAT/bin/python"""


class PeerError(Exception):
    """A renderer that is missing, or that ended unexpectedly."""


@dataclass(frozen=True)
class Peer:
    """A renderer.

    Attributes:
        name: on the command line.
        title: in tables.
        script: its worker.
        device: the worker's --device on the CPU and on CUDA; None where it does not run there.
        exact: whether only noise may distinguish its pictures from wrt's; other renderers' are close.
        hint: how to install it.
    """

    name: str
    title: str
    script: str
    device: Mapping[str, str | None]
    exact: bool
    hint: str


def _mitsuba(name: str, variant: str, *, cuda: bool = False, hint: str = "pip install mitsuba") -> Peer:
    device = {"cpu": None if cuda else variant, "cuda": variant if cuda else None}
    return Peer(name, f"Mitsuba `{variant}`", "mitsuba_worker.py", device, True, hint)


OWN = Peer("wrt", "wrt", "wrt_worker.py", {"cpu": "cpu", "cuda": "cuda"}, True, "pip install .")
PEERS = {
    peer.name: peer
    for peer in (
        _mitsuba("mitsuba-llvm", "llvm_ad_rgb", hint=f"pip install mitsuba. {LLVM_HINT}"),
        _mitsuba("mitsuba-scalar", "scalar_rgb"),
        _mitsuba("mitsuba-cuda", "cuda_ad_rgb", cuda=True, hint="pip install mitsuba, and a driver with OptiX"),
        Peer("cycles", "Cycles", "cycles_worker.py", {"cpu": "CPU", "cuda": "GPU"}, False, CYCLES_HINT),
    )
}


@dataclass
class Environments:
    """Where renderers are installed.

    Attributes:
        pythons: the Python that runs a renderer, by the first part of its name ("cycles"); by default this one.
        llvm: folder below which the library of LLVM is.
        more: environment variables beside those of this process.
    """

    pythons: dict[str, str] = field(default_factory=dict)
    llvm: Path | None = None
    more: dict[str, str] = field(default_factory=dict)

    def python(self, peer: Peer) -> str:
        """Return the Python in whose environment a renderer is installed."""
        return self.pythons.get(peer.name.partition("-")[0], sys.executable)

    def variables(self, peer: Peer) -> dict[str, str]:
        """Return the environment variables of a renderer's process."""
        result = dict(os.environ) | self.more
        # Installed packages are compiled to bytecode; a checkout should be, too, after its first run.
        result.pop("PYTHONDONTWRITEBYTECODE", None)
        if self.llvm is not None and peer.script == "mitsuba_worker.py":
            found = sorted(self.llvm.rglob("libLLVM*.so*"))
            if not found:
                raise PeerError(f"{self.llvm}: no libLLVM*.so is below this folder")
            result["DRJIT_LIBLLVM_PATH"] = str(found[-1])
            paths = [str(found[-1].parent), result.get("LD_LIBRARY_PATH", "")]
            result["LD_LIBRARY_PATH"] = os.pathsep.join(path for path in paths if path)
        return result


class Session:
    """A renderer's process with a scene."""

    def __init__(
        self,
        peer: Peer,
        folder: Path,
        environments: Environments,
        device: str = "cpu",
        threads: int | None = None,
        cpus: int | None = None,
    ) -> None:
        """Start it, by default on all cores, and wait until the scene is loaded.

        With `cpus` renders are timed in seconds of CPU over that number, not on the clock.

        Raises:
            PeerError: with the last line of its output, where it ends instead.
        """
        self.peer, self.cpus = peer, cpus
        self.log = folder / f"{peer.name}.log"
        with self.log.open("w", encoding="utf-8") as log:
            self.process = subprocess.Popen(
                command(peer, folder, environments, device) + (["--threads", str(threads)] if threads else []),
                env=environments.variables(peer),
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=log,
                text=True,
            )
        try:
            self.about = self._answer()
        except PeerError:
            self.__exit__()
            raise

    def _answer(self) -> dict[str, Any]:
        assert self.process.stdout is not None
        line = self.process.stdout.readline()
        if not line:
            self.process.wait()
            output = self.log.read_text(encoding="utf-8", errors="replace").strip().splitlines()
            raise PeerError(f"{self.peer.name} ended: {output[-1] if output else 'without output'}")
        answer: dict[str, Any] = json.loads(line)
        return answer

    def ask(self, **question: Any) -> dict[str, Any]:
        """Return the answer to one question."""
        assert self.process.stdin is not None
        self.process.stdin.write(json.dumps(question) + "\n")
        self.process.stdin.flush()
        return self._answer()

    def render(self, spp: int, seed: int, save: Path | None = None) -> float:
        """Render a new picture and return its seconds: on the clock, or with `cpus` those of CPU over that number."""
        answer = self.ask(do="render", spp=spp, seed=seed, save=None if save is None else str(save))
        return float(answer["seconds"]) if self.cpus is None else float(answer["cpu_seconds"]) / self.cpus

    def picture(self, spp: int, seed: int, path: Path) -> tuple[NDArray[np.float64], float]:
        """Return a new picture and its seconds."""
        seconds = self.render(spp, seed, path)
        image = np.load(path).astype(np.float64)
        path.unlink()
        return image, seconds

    def peak_memory(self) -> int:
        """Return its peak memory, bytes."""
        return int(self.ask(do="memory")["bytes"])

    def __enter__(self) -> Session:
        return self

    def __exit__(self, *raised: object) -> None:
        self.process.kill()
        self.process.wait()
        for pipe in (self.process.stdin, self.process.stdout):
            if pipe is not None:
                pipe.close()


def command(peer: Peer, folder: Path, environments: Environments, device: str) -> list[str]:
    """Return the command that starts a worker."""
    if (name := peer.device[device]) is None:
        raise PeerError(f"{peer.name} does not run on {device}")
    return [environments.python(peer), str(FOLDER / peer.script), str(folder), "--device", name]


def first_picture_command(peer: Peer, folder: Path, environments: Environments, device: str, file: Path) -> list[str]:
    """Return the command that a person would type to see a first picture, of one sample per pixel."""
    if peer is OWN:
        start = [sys.executable, "-m", "wrt", "render", str(folder / "scene.toml"), "--spp", "1", "--device", device]
        return [*start, "-o", str(file)]
    return [*command(peer, folder, environments, device), "--picture", str(file)]


def prepare_file(
    file: Path, size: int, *, box: bool, folder: Path, values: Mapping[str, str] = MappingProxyType({})
) -> None:
    """Have all workers read a Mitsuba scene file, as `SharedFile` says."""
    note = {"file": str(file.resolve()), "size": size, "box": box, "values": dict(values)}
    (folder / "file.json").write_text(json.dumps(note), encoding="utf-8")


def prepare(peer: Peer, scene: wrt.Scene, folder: Path) -> None:
    """Write a scene as a renderer's worker reads it; all but Mitsuba's read wrt's own scene file.

    Raises:
        NotImplementedError: where the renderer lacks a feature of the scene.
    """
    if peer.script != "mitsuba_worker.py":
        if not (folder / "scene.toml").exists():
            wrt.save_scene(folder / "scene.toml", scene)
        return
    if not (folder / "scene.json").exists():
        from peers.mitsuba_scene import to_mitsuba
        from peers.mitsuba_worker import write_scene

        settings = scene.settings
        size = {"width": settings.width, "height": settings.height}
        tree = to_mitsuba(scene, folder, **size, max_depth=settings.max_depth)
        if tree["integrator"]["type"] == "volpathmis" and all(len(set(m.extinction)) == 1 for m in scene.media):
            tree["integrator"]["type"] = "volpath"  # the faster one of the two, where channels need no weighing
        write_scene(tree, folder)
