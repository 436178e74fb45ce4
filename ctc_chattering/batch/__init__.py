"""The closed loop compiled by numba, for many runs: equations in the order of the reference."""
