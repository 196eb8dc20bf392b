"""The entry point of ``python -m wrt`` and of the program ``wrt``."""

import _signal  # type: ignore[import-not-found]  # the C module behind `signal`, which imports more

# Ctrl-C during the imports ends the process at once, by the signal's default action, without a traceback.
if _signal.getsignal(_signal.SIGINT) is _signal.default_int_handler:
    _signal.signal(_signal.SIGINT, _signal.SIG_DFL)

from wrt.cli import main
from wrt.cli.process import end


def run() -> None:
    """Run the command line and end the process with its status."""
    end(main())


if __name__ == "__main__":
    run()
