"""Command lines: the nodes, `bringup`, and `ctc` with its subcommands."""

import os

# A robot's matrices are too small for threads. OpenBLAS starts them nevertheless, one for each
# processor, which delays the start of every process.
os.environ.setdefault('OPENBLAS_NUM_THREADS', '1')
