"""What a number rests on: the scorer, the content of the data, the machine."""

from __future__ import annotations

import hashlib
import os
import platform
from collections.abc import Iterable
from pathlib import Path

from ..scoring.definitions import DEFINITIONS, GOLDEN
from .record import HardwarePart


def scorer_digest() -> str:
    """Hex sha256 of the version of the definitions and of the scorer's golden results, wherever its files are."""
    return hashlib.sha256(f"{DEFINITIONS}\n{GOLDEN}".encode()).hexdigest()


def data_manifest(digests: Iterable[str]) -> str:
    """Hex sha256 over the digests of the scenes, in their order."""
    return hashlib.sha256("\n".join(digests).encode()).hexdigest()


def hardware() -> HardwarePart:
    """This machine, without names that tell whose it is."""
    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 0
    cpu = _field(Path("/proc/cpuinfo"), "model name") or platform.processor() or platform.machine()
    gpus = [_field(path, "Model") for path in sorted(Path("/proc/driver/nvidia/gpus").glob("*/information"))]
    gpu = ", ".join(filter(None, gpus)) or None  # the models that NVIDIA's driver names
    return HardwarePart(cpu=cpu, cores=cores, memory_gib=round(_memory() / 2**30, 1), gpu=gpu)


def _memory() -> float:
    try:
        return float(os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE"))
    except (AttributeError, OSError, ValueError):
        return 0.0


def _field(path: Path, name: str) -> str:
    """Value of the first line ``name : value`` of a file of /proc; empty where there is none."""
    try:
        lines = path.read_text(encoding="utf-8", errors="replace").splitlines()
    except OSError:
        return ""
    return next((line.split(":", 1)[1].strip() for line in lines if line.split(":")[0].strip() == name), "")
