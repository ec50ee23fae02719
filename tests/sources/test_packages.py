"""Every source that a card can name has a package of its name, which opens and describes it."""

from __future__ import annotations

from importlib import import_module
from typing import get_args

import pytest

from mtp_bench.cards import Source
from mtp_bench.sources.base import SourcePackage

NAMES = [get_args(section.model_fields["name"].annotation)[0] for section in get_args(get_args(Source)[0])]


@pytest.mark.parametrize("name", NAMES)
def test_a_section_has_a_package(name: str) -> None:
    assert isinstance(import_module(f"mtp_bench.sources.{name}").PACKAGE, SourcePackage)
