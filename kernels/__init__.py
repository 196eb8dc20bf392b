"""Device code: everything here runs inside Warp kernels, on the CPU and on CUDA alike.

These modules import `warp` and each other, never the host side of wrt. They do without
`from __future__ import annotations`, because Warp reads the annotations themselves.
"""
