"""What tests need beyond pip: a test without it is skipped, and the reason says how to get it on Debian."""

import ctypes.util
import os
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import pytest

from mtp_bench.judge.gateway.sandbox import sandbox_backend

CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
CHROMEDRIVER = shutil.which("chromedriver")
_VULKAN_DRIVERS = ("/usr/share/vulkan/icd.d", "/etc/vulkan/icd.d", "/usr/local/share/vulkan/icd.d")


class Program(NamedTuple):
    """A program, or several that serve one purpose."""

    is_found: Callable[[], bool]
    remedy: str


def has_vulkan() -> bool:
    """Return True for Vulkan's loader with a driver: one that the system lists, or a file that a variable names."""
    if ctypes.util.find_library("vulkan") is None:
        return False
    named = os.environ.get("VK_DRIVER_FILES") or os.environ.get("VK_ICD_FILENAMES")
    if named:
        return any(Path(name).exists() for name in named.split(os.pathsep))
    return any(path for folder in _VULKAN_DRIVERS for path in Path(folder).glob("*.json"))


PROGRAMS = {
    "bash": Program(lambda: shutil.which("bash") is not None, "apt-get install bash"),
    "browser": Program(
        lambda: CHROMIUM is not None and CHROMEDRIVER is not None, "apt-get install chromium chromium-driver"
    ),
    "git": Program(lambda: shutil.which("git") is not None, "apt-get install git"),
    "sandbox": Program(
        lambda: sandbox_backend() != "none",
        "apt-get install bubblewrap libseccomp2, and let this user make user namespaces",
    ),
    "ssh-keygen": Program(lambda: shutil.which("ssh-keygen") is not None, "apt-get install openssh-client"),
    "Vulkan driver": Program(has_vulkan, "apt-get install libvulkan1 mesa-vulkan-drivers"),
}


def require_program(name: str) -> None:
    """Skip the test without the program of this name."""
    program = PROGRAMS[name]
    if not program.is_found():
        pytest.skip(f"no {name}; {program.remedy}")
