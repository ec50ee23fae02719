"""Fixtures of the sources: small roots, and a cache for one test."""

from pathlib import Path

import pytest

from tests.support.nuscenes_root import write_root


@pytest.fixture
def data(tmp_path: Path) -> Path:
    return write_root(tmp_path / "data")


@pytest.fixture
def root(request: pytest.FixtureRequest, tmp_path: Path) -> Path:
    """The small root of the dataset that a file of tests is about."""
    return Path(request.module.make_root(tmp_path))


@pytest.fixture
def own_cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Where nuScenes is kept, in a cache of this test alone."""
    monkeypatch.setenv("MTP_BENCH_CACHE", str(tmp_path / "cache"))
    return tmp_path / "cache/nuscenes"
