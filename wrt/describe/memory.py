"""The memory of a picture in words, for `wrt info --memory`."""

from __future__ import annotations

from wrt.backend import current_backend
from wrt.memory_needed import DeviceMemory

PARTS = ("geometry", "trees", "materials", "lights", "film", "layers")


def memory_text(memory: DeviceMemory, width: int, height: int) -> str:
    """Return lines that tell what a picture of width x height pixels takes on a GPU, and which GPU here has that."""
    parts = [(name, _size(getattr(memory, name))) for name in PARTS if getattr(memory, name)]
    peak = f"{_size(memory.peak)} while the ray tree is built"
    if memory.peak_if_cut > memory.peak:
        peak += f"; {_size(memory.peak_if_cut)} if it cuts large triangles"
    rows = [*parts, ("in all", _size(memory.kept)), ("at most", peak)]
    backend = current_backend()
    backend.start()
    for name in (f"cuda:{number}" for number in range(backend.gpus())):
        free = backend.memory_of(name)
        fits = memory.peak <= free
        rows.append((name, f"{_size(free)} free: {'enough' if fits else 'not enough'}"))
    return "\n".join([f"memory of a picture of {width}x{height} on a GPU", *(f"  {a:<9} {b}" for a, b in rows)])


def _size(number: int) -> str:
    return f"{number / 1e9:.2f} GB" if number >= 1e9 else f"{number / 1e6:.1f} MB"
