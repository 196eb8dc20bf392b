"""The way from meshes and scenes up to what draws them in notebooks: `wrt/__init__.py`, above both, sets it."""

from collections.abc import Callable
from typing import Any

viewer: Callable[[], Any]
"""Returns the module `wrt.view.notebook`."""
