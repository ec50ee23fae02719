"""Envs on scenes in memory."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from mtp_bench import MTPEnv
from mtp_bench.core import Scene
from tests.support.small_scenes import MemorySource, make_scene, write_card

MakeEnv = Callable[..., MTPEnv]


@pytest.fixture
def make_env(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> MakeEnv:
    def make(*scenes: Scene, **keywords: Any) -> MTPEnv:
        source = MemorySource(*(scenes or (make_scene(),)))
        monkeypatch.setattr("mtp_bench.env.environment.open_source", lambda card, data: source)
        return MTPEnv(write_card(tmp_path), **keywords)

    return make
