"""Compile wide kernels in other processes: for a long render while it runs, for a short one for the next time."""
