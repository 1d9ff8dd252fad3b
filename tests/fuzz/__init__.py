"""Damaged and hostile files through the program."""

import os

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # the runs are forked, and threads of BLAS do not outlive that
