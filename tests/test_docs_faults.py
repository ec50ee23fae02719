"""The page on known faults of the data: its block runs and shows the numbers of the page."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from mtp_bench.cards import load_card
from mtp_bench.sources import describe
from mtp_bench.viz import data_lines, env_table
from tests.test_readme import block

PAGE = "docs/data/faults.md"
ENV = "MTP-ETH-UCY-v0"


@pytest.mark.data
def test_the_block_shows_the_faults(repository: Path, data_root: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("MTP_BENCH_DATA", str(data_root))
    names: dict[str, Any] = {}
    exec(compile(block(repository / PAGE, "python", "scene_of"), PAGE, "exec"), names)
    assert names["duplicate"] < 0.04
    np.testing.assert_allclose(names["half_steps"], [0.92, 0.93, 0.49, 0.45, 0.95, 0.95], atol=0.006)
    np.testing.assert_allclose(names["far_step"], [5.9, 6.5, 15.6], atol=0.06)
    np.testing.assert_allclose(names["last_steps"], [6.7, 7.5, 7.5, 4.6], atol=0.06)


def test_the_fault_of_eth_is_named_where_environments_and_data_are_listed(tmp_path: Path) -> None:
    card = load_card(ENV)
    fault = describe(card, tmp_path).about.known_fault
    assert "biwi_eth" in fault
    assert fault in env_table([card]).cells(card)[-1]
    assert f"known fault: {fault}" in data_lines(describe(card, tmp_path))
