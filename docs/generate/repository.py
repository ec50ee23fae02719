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
_FENCED = re.compile(r"^(```.*?^```)", flags=re.MULTILINE | re.DOTALL)
_LINK = re.compile(r"(!?)\[([^\]]*)\]\(([^)\s]+)\)")


def files() -> dict[str, str]:
    """Files of the repository that the site holds, with their places; the records are those that the board links to."""
    board = (ROOT / "leaderboard/index.html").read_text()
    records = [target.removeprefix("./") for target in re.findall(r'href="(\./[^"]+\.json)"', board)]
    return {**PLACES, **{f"leaderboard/{name}": f"leaderboard/{name}" for name in records}}


def source_of(place: str) -> str:
    """The file of the repository that a page is read from."""
    return SOURCES.get(place, f"docs/{place}")


def place_of(source: str) -> str | None:
    """Where a file of the repository lies in the site; None where it does not."""
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
        return f"[{words}]({repo_url.rstrip('/')}/blob/main/{wanted})" if repo_url else words

    parts = _FENCED.split(text)
    return "".join(part if part.startswith("```") else _LINK.sub(link, part) for part in parts)
