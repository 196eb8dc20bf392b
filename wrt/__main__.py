"""Runs the command line as ``python -m wrt``."""

import sys

from wrt.cli import main

sys.exit(main())
