"""The way from meshes, scenes and renderers up to what shows, saves and reads them.

`wrt/__init__.py`, above all, sets these functions, which return modules.
"""

from collections.abc import Callable
from typing import Any

gradients: Callable[[], Any]
"""`wrt.gradients.renderers`."""

objects: Callable[[], Any]
"""`wrt.io.objects`."""

pictures: Callable[[], Any]
"""`wrt.pictures`."""

scene_files: Callable[[], Any]
"""`wrt.io.toml.writer`."""

viewer: Callable[[], Any]
"""`wrt.view.notebook`."""
