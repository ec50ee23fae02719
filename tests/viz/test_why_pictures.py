"""The pictures of `docs/visualization/why.md`: what they say is still so, and they are small."""

from __future__ import annotations

import runpy
from pathlib import Path

import pytest
from PIL import Image

PICTURES = ("focus_ids", "focus_lost", "focus_reacquired")


@pytest.mark.parametrize("name", PICTURES)
def test_a_committed_picture_says_what_would_be_drawn_today(name: str, repository: Path, tmp_path: Path) -> None:
    path = repository / "docs" / "pictures" / f"{name}.png"
    assert path.stat().st_size < 150_000
    script = runpy.run_path(str(repository / "docs" / "make_pictures.py"))
    script["take"](script["SIMULATED"][name], tmp_path / "now.png")
    with Image.open(path) as committed, Image.open(tmp_path / "now.png") as now:
        shown = [{key: image.text[key] for key in ("Title", "Description")} for image in (committed, now)]  # type: ignore[attr-defined]
        assert shown[0] == shown[1], "make it again: python docs/make_pictures.py"
        assert committed.size == now.size


def test_the_page_shows_every_committed_picture(repository: Path) -> None:
    page = (repository / "docs" / "visualization" / "why.md").read_text()
    assert all(f"../pictures/{name}.png" in page for name in PICTURES)
    assert sorted(path.stem for path in (repository / "docs" / "pictures").glob("focus_*.png")) == sorted(PICTURES)
