"""The cache of windows: what they depend on is in their key."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from mtp_bench.files import file_digest
from mtp_bench.sources.cache import Arrays
from mtp_bench.training import window_cache
from mtp_bench.training.window_cache import cached_windows
from mtp_bench.types import Scene
from tests.support.small_scenes import make_scene


@pytest.fixture(autouse=True)
def cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    monkeypatch.setenv("MTP_BENCH_CACHE", str(tmp_path))
    window_cache.code_digest.cache_clear()
    yield
    window_cache.code_digest.cache_clear()


def made(scene: Scene) -> bool:
    """Whether windows of the scene had to be made."""
    calls: list[int] = []

    def make() -> Arrays:
        calls.append(1)
        return {"box": np.zeros(1)}

    cached_windows(scene, ("asked",), make)
    return bool(calls)


@pytest.mark.parametrize("changes", [{"truth_complete": False}, {"listed_targets": True}, {"name": "two"}])
def test_windows_of_a_changed_scene_are_made_again(changes: dict[str, object]) -> None:
    scene = make_scene()
    assert made(scene)
    assert not made(scene)
    assert made(replace(scene, **changes))  # type: ignore[arg-type]
    assert not made(scene)


MAKERS = [
    "geometry.py", "similar.py", "tracks.py", "types.py",
    "env/action.py", "env/observation.py", "env/spaces.py", "prediction/windows.py",
    "scoring/definitions.py", "scoring/events.py", "scoring/neutral.py", "scoring/targets.py", "tracking/tracker.py",
    "tracking/kernels/enumeration.py", "training/labels.py",
]  # fmt: skip


@pytest.mark.parametrize("name", MAKERS)
def test_windows_are_made_again_where_the_code_changed(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    assert made(make_scene())
    monkeypatch.setattr(
        window_cache, "file_digest", lambda path: file_digest(path) + str(path).endswith(name) * "changed"
    )
    window_cache.code_digest.cache_clear()
    assert made(make_scene())
