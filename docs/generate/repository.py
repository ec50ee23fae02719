"""Files of the repository that are pages of the site, and what becomes of links between them."""

from __future__ import annotations

import os.path
import re
from pathlib import Path, PurePosixPath

ROOT = Path(__file__).resolve().parents[2]
PLACES = {  # file of the repository -> place in the site
    "README.md": "index.md",
    ".github/view.png": "assets/view.png",
    "envs/README.md": "environment/cards.md",
    "envs/reference/README.md": "environment/event_weights.md",
    "envs/reference/examples.svg": "environment/examples.svg",
    "mtp_bench/detector/README.md": "environment/detector.md",
    "baselines/README.md": "agents/baselines.md",
    "mtp_bench/tracking/kernels/README.md": "agents/kernels.md",
    "leaderboard/README.md": "leaderboard/index.md",
    "leaderboard/SUBMITTING.md": "leaderboard/submitting.md",
    "leaderboard/MAINTAINING.md": "leaderboard/maintaining.md",
    "leaderboard/RESULTS.md": "leaderboard/results.md",
    "leaderboard/index.html": "leaderboard/board.html",
    "SECURITY.md": "leaderboard/security.md",
    "CHANGELOG.md": "project/changelog.md",
    "CONTRIBUTING.md": "project/contributing.md",
}
SOURCES = {place: source for source, place in PLACES.items()}
BOARD, _PARTS = "leaderboard/index.html", "leaderboard/index.parts"
_LINKED = re.compile(
    r'(?:href|src)=\\?"\./([^"\\]+\.json)\\?"'
)  # in the page, or in the JSON of a part
_PAGES = {
    "./SUBMITTING.md": "submitting.html",
    "./../docs/definitions/index.md": "../definitions/index.html#bade",
    "./../docs/definitions/index.md#what-others-measure": "../definitions/index.html#what-others-measure",
}  # linked by the board
_BASELINE, _BASELINES = (
    re.compile(r"\./\.\./(baselines/\w+)"),
    "../agents/baselines.html",
)
_FENCED = re.compile(r"^(```.*?^```)", flags=re.MULTILINE | re.DOTALL)
_LINK = re.compile(r"(!?)\[([^\]]*)\]\(([^)\s]+)\)")
_PICTURE = re.compile(r'\b(src|srcset)="(docs/[^"]+)"')  # of HTML in the README


def files() -> dict[str, str]:
    """Files of the repository that the site holds, with their places: without the board, see `board`."""
    return {source: place for source, place in PLACES.items() if source != BOARD}


def board(repo_url: str) -> dict[str, str | bytes]:
    """The board, its parts, and the records that they link to, by their places in the site.

    Links to pages of the repository lead to those of the site; those to code lead to ``repo_url``, or without such an
    address to the page of the baselines.
    """
    parts = sorted(path for path in (ROOT / _PARTS).rglob("*") if path.is_file())
    texts = {PLACES[BOARD]: (ROOT / BOARD).read_text()}
    texts |= {path.relative_to(ROOT).as_posix(): path.read_text() for path in parts}
    linked = sorted({name for text in texts.values() for name in _LINKED.findall(text)})
    code = rf"{repo_url.rstrip('/')}/tree/main/\1" if repo_url else _BASELINES
    pages = {place: _BASELINE.sub(code, text) for place, text in texts.items()}
    for source, page in _PAGES.items():
        pages[PLACES[BOARD]] = pages[PLACES[BOARD]].replace(
            f'href="{source}"', f'href="{page}"'
        )
    return {
        **pages,
        **{
            f"leaderboard/{name}": (ROOT / "leaderboard" / name).read_bytes()
            for name in linked
        },
    }


def source_of(place: str) -> str:
    """The file of the repository that a page is read from."""
    return SOURCES.get(place, f"docs/{place}")


def place_of(source: str) -> str | None:
    """The page of the site for a file of the repository; None if it has none."""
    if source in PLACES:
        return PLACES[source]
    return source.removeprefix("docs/") if source.startswith("docs/") else None


def relinked(text: str, place: str, repo_url: str) -> str:
    """The Markdown of the page at ``place`` with links that hold in the site.

    A link to a file that is a page becomes one to that page. One to another file of the repository becomes a link to
    ``repo_url``; without such an address its text stays, without a link.
    """
    source = source_of(place)

    def link(found: re.Match[str]) -> str:
        mark, words, target = found.groups()
        file, hash_sign, anchor = target.partition("#")
        if not file or "://" in file or file.startswith("mailto:"):
            return found[0]
        wanted = os.path.normpath(PurePosixPath(source).parent / file)
        inside = place_of(wanted)
        if inside is not None:
            return f"{mark}[{words}]({os.path.relpath(inside, PurePosixPath(place).parent)}{hash_sign}{anchor})"
        if not (ROOT / wanted).exists():
            return found[0]  # mkdocs says that it is dead
        return (
            f"[{words}]({repo_url.rstrip('/')}/blob/main/{wanted})"
            if repo_url
            else words
        )

    def picture(found: re.Match[str]) -> str:
        inside = place_of(found[2]) or found[2]
        return f'{found[1]}="{os.path.relpath(inside, PurePosixPath(place).parent)}"'

    text = _PICTURE.sub(picture, text)
    parts = _FENCED.split(text)
    return "".join(
        part if part.startswith("```") else _LINK.sub(link, part) for part in parts
    )
