"""The weights that ship: small, of simulated traffic alone, and made for the envs that they serve."""

from __future__ import annotations

import lzma
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from mtp_bench import card_ids
from mtp_bench.cards import load_card
from mtp_bench.env import MTPEnv
from mtp_bench.errors import SubmissionError
from mtp_bench.prediction.learned.registry import network_of
from mtp_bench.prediction.learned.shipping import rounded, ship
from mtp_bench.prediction.learned.weights import MOST_BYTES as MOST_WEIGHTS
from mtp_bench.prediction.learned.weights import PACKED, SHIPPED, find_weights, read_weights, require_fit, write_weights

FILES = sorted(SHIPPED.glob(f"*.safetensors{PACKED}"))
MOST_BYTES = 2_000_000


def test_they_are_small() -> None:
    assert len(FILES) == 8
    assert sum(file.stat().st_size for file in FILES) < MOST_BYTES
    assert sorted(SHIPPED.iterdir()) == FILES


@pytest.mark.parametrize("file", FILES, ids=lambda file: file.name.split(".")[0])
def test_they_are_of_simulated_traffic_and_serve_their_envs(
    file: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("MTP_BENCH_WEIGHTS", str(tmp_path))
    name, on, env_id = file.name.split(".")[0].split("-", 2)
    card = read_weights(file, network_of(name)).card
    assert card["env"].split(", ")[0] == env_id
    assert card["on"] == on
    for trained_on in card["env"].split(", "):
        assert load_card(trained_on).simulated
    others = [other for other in card_ids() if load_card(other).weights_of == env_id]
    assert others
    for served in (env_id, *others):
        task = MTPEnv(served).task
        assert find_weights(name, on, task) == file
        require_fit(read_weights(file, network_of(name)).sizes, task, file)


def test_what_is_packed_to_ship_keeps_eight_bits_of_each_number(tmp_path: Path) -> None:
    before = read_weights(FILES[0], network_of(FILES[0].name.split("-")[0]))
    source = tmp_path / FILES[0].stem
    noise = np.random.default_rng(0)
    weights = {name: value * noise.normal(1, 0.1, value.shape) for name, value in before.weights.items()}
    write_weights(source, replace(before, weights=weights))
    packed = ship(source, tmp_path)
    after = read_weights(packed, network_of(before.network))
    assert packed.stat().st_size < 0.7 * source.stat().st_size
    assert after.card == before.card
    for name, value in after.weights.items():
        half = weights[name].astype(np.float16).astype(np.float64)
        assert (np.abs(value - half) <= np.maximum(2.0**-8 * np.abs(half), 2.0**-22)).all()
    assert ship(FILES[0], tmp_path).read_bytes() == FILES[0].read_bytes()  # what is rounded stays


def test_rounded_numbers_are_the_nearest_and_finite() -> None:
    every = np.arange(2**16, dtype=np.uint16).view(np.float16)
    finite = every[np.isfinite(every)]
    short = rounded(finite)
    assert np.isfinite(short).all()
    assert (short.view(np.uint16) & 0b111 == 0).all()
    steps = np.unique(short.astype(np.float64))
    inside = np.abs(finite) <= steps[-1]
    at = np.clip(np.searchsorted(steps, finite[inside].astype(np.float64)), 1, len(steps) - 1)
    nearest = np.minimum(np.abs(steps[at] - finite[inside]), np.abs(steps[at - 1] - finite[inside]))
    assert (np.abs(short[inside].astype(np.float64) - finite[inside]) == nearest).all()


@pytest.mark.parametrize("content", [b"", b"no xz", lzma.compress(b"\1" * 9)], ids=["empty", "text", "packed"])
def test_a_broken_packed_file_is_one_error(tmp_path: Path, content: bytes) -> None:
    path = tmp_path / f"modes-truth-MTP-X-v0.safetensors{PACKED}"
    path.write_bytes(content)
    with pytest.raises(SubmissionError, match="not a file of weights"):
        read_weights(path, network_of("modes"))


def test_a_packed_file_cannot_fill_the_memory(tmp_path: Path) -> None:
    path = tmp_path / f"modes-truth-MTP-X-v0.safetensors{PACKED}"
    path.write_bytes(lzma.compress(bytes(MOST_WEIGHTS + 2**20)))
    with pytest.raises(SubmissionError, match="expected at most"):
        read_weights(path, network_of("modes"))
