"""Every error says what was got, what was expected and where."""

import numpy as np

import mtp_bench

try:
    mtp_bench.MTPEnv("MTP-Intersektion-v0")
except mtp_bench.UnknownNameError as error:
    print(error)
task = mtp_bench.MTPEnv("MTP-Intersection-v0").task
try:
    mtp_bench.make_action(
        task, np.zeros((2, 7)), np.zeros(2, dtype=int), np.zeros((2, 5, 2))
    )
except mtp_bench.MtpBenchError as error:  # the base class of all
    print(error)
