"""What `compilable` marks, compiled by numba, with vectors of the processor."""
