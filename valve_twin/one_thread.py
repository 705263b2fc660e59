# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Hold BLAS to one thread; to be imported before numpy, by what is started as a process.

Our matrices have a handful of columns: a second thread gives nothing, spins beside other processes
(measured on two busy cores: 5 to 15 times the time), and the last bits of a result depend on the
number of threads. Whoever sets one of the variables himself keeps what he set.
"""

import os

_NAMES = {"OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS"}

if not _NAMES & os.environ.keys():
    os.environ["OMP_NUM_THREADS"] = "1"  # each of them listens to this one, too
