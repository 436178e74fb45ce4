"""Command lines: the nodes, `bringup`, and `ctc` with its subcommands."""

import os

# A robot's matrices are too small for threads. OpenBLAS starts them all the same, one for each
# processor, and they compute in vain for a moment at the start of every process.
os.environ.setdefault('OPENBLAS_NUM_THREADS', '1')
