"""Starting without Warp where all kernels have been compiled before.

Importing Warp and declaring kernels to it takes longer than a first picture: it reads the code of every function anew.
What it compiled before can be run without that. So the command line has a small stand-in take the place of `warp`;
where that lacks anything, Warp itself is imported, and the render starts over.
"""

from __future__ import annotations

import gc
import sys
from collections.abc import Callable
from typing import TypeVar

from wrt.cache_folders import remove_leftovers
from wrt.errors import InputError
from wrt.lean.builds import Builds, Missing, loaded_by_warp

Result = TypeVar("Result")

_OF_WARP = ("warp", "wrt.kernels", "wrt.build", "wrt.device", "wrt.film", "wrt.film_layers", "wrt.renderer")
"""Modules that hold things of Warp's."""


def run_lean(run: Callable[[], Result]) -> Result:
    """Return what `run` does, which it does without Warp if it can.

    Only for a process of one's own: modules are imported anew where it cannot, and `run` is called again.
    """
    if "warp" in sys.modules or (builds := Builds.known()) is None:
        return run()
    if builds:
        from wrt.lean.stand_in import StandIn

        stand_in = sys.modules["warp"] = StandIn(builds)
        try:
            result = run()
            remove_leftovers()
            return result
        except (InputError, OSError, MemoryError):
            raise
        except Exception as error:  # whatever it is: were it not for the stand-in, it comes again
            if stand_in.rendered and not isinstance(error, Missing):
                raise  # after what may have been hours
            _forget()
        gc.unfreeze()  # what was kept for good is of no use any more, and may be large
        gc.collect()
    result = run()
    if "warp" in sys.modules:  # missing if the input was refused before anything needed Warp
        builds.note(loaded_by_warp())
    return result


def next_render() -> None:
    """Allow the next render to start over with Warp where something is missing, although others were rendered."""
    if hasattr(stand_in := sys.modules.get("warp"), "builds"):
        vars(stand_in)["rendered"] = False


def _forget() -> None:
    """Have the next import of Warp be one, by modules that know nothing of the stand-in."""
    for name in list(sys.modules):
        if any(name == each or name.startswith(f"{each}.") for each in _OF_WARP):
            parent, _, child = name.rpartition(".")
            if parent in sys.modules:
                vars(sys.modules[parent]).pop(child, None)
            del sys.modules[name]
