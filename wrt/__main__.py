"""Runs the command line: as ``python -m wrt``, and as the program ``wrt``."""

from wrt.cli import main
from wrt.process import end


def run() -> None:
    """Run the command line and end the process with its status."""
    end(main())


if __name__ == "__main__":
    run()
