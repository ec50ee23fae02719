"""The page that says where things are names all rooms, and paths that exist."""

import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent
PAGES = ("docs/project/rooms.md", "CONTRIBUTING.md")
PATH = re.compile(r"`((?:mtp_bench|docs|tests|baselines|envs|benchmarks)/[\w./-]*)`")
EXAMPLES = re.compile(r"walks|strided|Walks|_bundled")  # files of the examples, and made ones


def paths_named(page: str) -> set[str]:
    return {path for path in PATH.findall((ROOT / page).read_text()) if not EXAMPLES.search(path)}


@pytest.mark.parametrize("page", PAGES)
def test_paths_named_on_a_page_exist(page: str) -> None:
    paths = paths_named(page)
    assert paths
    assert sorted(path for path in paths if not (ROOT / path).exists()) == []


def test_the_page_lists_all_rooms() -> None:
    rooms = {f"mtp_bench/{folder.parent.name}/" for folder in (ROOT / "mtp_bench").glob("*/__init__.py")}
    assert rooms == {path for path in paths_named(PAGES[0]) if re.fullmatch("mtp_bench/\\w+/", path)}
