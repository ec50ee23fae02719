"""The weights that ship: small, of simulated traffic alone, and made for the envs that they serve."""

from __future__ import annotations

from pathlib import Path

import pytest

from mtp_bench.cards import HighwaySource, load_card
from mtp_bench.env import MTPEnv
from mtp_bench.networks import LENDERS
from mtp_bench.prediction.learned.registry import network_of
from mtp_bench.prediction.learned.weights import SHIPPED, find_weights, read_weights

FILES = sorted(SHIPPED.glob("*.safetensors"))
MOST_BYTES = 3_000_000


def test_they_are_small() -> None:
    assert len(FILES) == 8
    assert sum(file.stat().st_size for file in FILES) < MOST_BYTES
    assert {file.suffix for file in SHIPPED.iterdir()} == {".safetensors"}


@pytest.mark.parametrize("file", FILES, ids=lambda file: file.stem)
def test_they_are_of_simulated_traffic_and_serve_their_envs(
    file: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("MTP_BENCH_WEIGHTS", str(tmp_path))
    name, on, env_id = file.stem.split("-", 2)
    card = read_weights(file, network_of(name)).card
    assert card["env"].split(", ")[0] == env_id
    assert card["on"] == on
    for trained_on in card["env"].split(", "):
        assert isinstance(load_card(trained_on).source, HighwaySource)
    for borrower in (env_id, *(other for other, lender in LENDERS.items() if lender == env_id)):
        task = MTPEnv(borrower).task
        assert find_weights(name, on, task) == file
        read_weights(file, network_of(name), task)
