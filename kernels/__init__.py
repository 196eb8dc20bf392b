"""Device code, which runs inside Warp kernels on the CPU and on CUDA.

These modules import `warp` and each other, never the host side of wrt. None has `from __future__ import annotations`,
because Warp evaluates annotations itself.
"""
