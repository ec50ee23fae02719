"""The sentences of errors."""

from __future__ import annotations

import pytest

from mtp_bench.errors import nearest

KNOWN = ("MTP-KITTI-v0", "MTP-nuScenes-v0", "stp")


@pytest.mark.parametrize(
    ("got", "meant"),
    [
        ("mtp-nuscenes-v0", "MTP-nuScenes-v0"),
        ("MTP-KITI-v0", "MTP-KITTI-v0"),
        ("STP", "stp"),
        ("mtp-kitti", "MTP-KITTI-v0"),
    ],
)
def test_the_nearest_name_whatever_its_case(got: str, meant: str) -> None:
    assert nearest(got, KNOWN) == f": did you mean {meant!r}?"
