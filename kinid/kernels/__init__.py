"""Batch kernels: numba loops over samples, laid out so that the compiler works on many samples at once."""
