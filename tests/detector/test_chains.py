"""Chains and correlations at another frame period."""

from __future__ import annotations

import numpy as np
import pytest

from mtp_bench.detector.chains import decayed


@pytest.mark.parametrize(("steps", "expected"), [(1.0, -0.5), (2.0, 0.25), (0.3 / 0.1, -0.125), (1.5, -(0.5**1.5))])
def test_a_negative_correlation_over_frames(steps: float, expected: float) -> None:
    assert float(decayed(np.asarray(-0.5), steps)) == pytest.approx(expected)
    assert float(decayed(np.asarray(-0.5), np.inf)) == 0.0
