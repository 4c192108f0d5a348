"""Solvers for structures with rigid amplitude limiters: numpy, scipy and numba, nothing else."""
