"""Hooks of mkdocs: add generated pages and files of the repository to those of docs/.

No document is kept twice. A page that is a file of the repository is read from there (`generate/repository.py`);
the pages of environments, of the reference and of the commands are made from the library.
"""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

from mkdocs.config.defaults import MkDocsConfig
from mkdocs.structure.files import File, Files
from mkdocs.structure.pages import Page

ROOT = Path(__file__).resolve().parent.parent
sys.path.insert(0, str(ROOT))

from docs.generate import (
    commands,
    environments,
    gallery,
    json_keys,
    notebooks,
    recordings,
    reference,
    repository,
)
from mtp_bench.core import long_work


def on_config(config: MkDocsConfig) -> MkDocsConfig:
    """Complete the navigation with the generated pages."""
    _section(config.nav, "Start").append({"Notebooks": notebooks.navigation()})
    _section(config.nav, "Environments").extend(environments.navigation())
    _section(config.nav, "Reference").extend(
        [*reference.navigation(), {"Commands": commands.PAGE}]
    )
    return config


@long_work("making the pages and pictures of the site", 30)
def on_files(files: Files, config: MkDocsConfig) -> Files:
    """Add the pages and pictures that do not lie in docs/."""
    pages = {
        **environments.pages(),
        gallery.PAGE: gallery.page(),
        **reference.pages(),
        commands.PAGE: commands.page(),
    }
    pages[json_keys.PAGE] = json_keys.page()
    for place, text in pages.items():
        files.append(File.generated(config, place, content=text))
    for place, content in repository.board(config.repo_url or "").items():
        files.append(File.generated(config, place, content=content))
    for place, content in notebooks.files().items():
        files.append(File.generated(config, place, content=content))
    drawn = {place: picture for place, (picture, _) in recordings.failures().items()}
    for place, picture in {**recordings.frames(), **drawn}.items():
        files.append(File.generated(config, place, content=picture))
    for source, place in repository.files().items():
        files.append(File.generated(config, place, abs_src_path=str(ROOT / source)))
    return files


def on_page_markdown(
    markdown: str, page: Page, config: MkDocsConfig, files: Files
) -> str:
    """Links are written for readers of the repository; here they lead to the pages of the site."""
    if (
        page.file.src_uri == "index.md"
    ):  # its table needs the width, and its section has no other page
        page.meta["hide"] = ["navigation"]
    if page.file.src_uri == environments.TABLE:
        markdown = environments.linked(markdown)
    if page.file.src_uri == recordings.WHY:
        markdown = recordings.shown(markdown)
    return repository.relinked(markdown, page.file.src_uri, config.repo_url or "")


def _section(nav: Any, title: str) -> list[Any]:
    """The pages of a section of the navigation."""
    (found,) = [item[title] for item in nav if title in item]
    assert isinstance(found, list)
    return found
