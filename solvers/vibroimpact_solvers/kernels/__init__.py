"""Compiled kernels: plain floats and arrays in, arrays out."""
