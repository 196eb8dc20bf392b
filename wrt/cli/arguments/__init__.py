"""The arguments of the command line: options, their types, and their completion."""
