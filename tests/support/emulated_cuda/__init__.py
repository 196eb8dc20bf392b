"""CUDA kernels without a GPU: the PTX that NVRTC makes of them is translated to C++, and runs on the CPU.

Warp's own compilers do both steps, so neither a driver nor a compiler need be installed. PTX has the operations that a
GPU runs, with fused products and NVIDIA's elementary functions. Threads of a grid run one after another.

What this cannot show: faults of the last step from PTX to machine code, races between threads, memory that only a CPU
or only a GPU can reach, and speed. Approximate instructions are computed by the C library.
"""
