"""One BLAS thread a process: numbers don't depend on how many cores there are."""

from __future__ import annotations

import os

# OpenBLAS and its like read these when numpy is loaded, and never again.
THREADS = ("OPENBLAS", "OMP", "MKL", "BLIS")
ONE_THREAD = {f"{name}_NUM_THREADS": "1" for name in THREADS} | {"VECLIB_MAXIMUM_THREADS": "1"}


def use_one_thread() -> None:
    """Makes this process compute in one thread, if numpy isn't loaded yet.

    Blocked sums depend on the number of threads in their last digits, and a pool of processes with
    a pool of threads each gets in its own way.
    """
    os.environ.update(ONE_THREAD)
