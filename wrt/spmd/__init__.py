"""The compiler of render kernels for 4, 8 or 16 lanes, for CPUs with registers of as many numbers."""
