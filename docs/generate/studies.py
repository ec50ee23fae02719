"""Put pages of the study on the site: one file each, without names of files and folders of the machine that made it.

    python -m docs.generate.studies FOLDER [FOLDER...]    # folders that `mtp-bench study` wrote

Pages of recorded data lose their worst moments: those pictures show recordings, whose licences forbid it.
"""

import re
import sys
from pathlib import Path

from mtp_bench import load_card
from mtp_bench.core.files import write_text

ROOT = Path(__file__).resolve().parents[2]
PAGES = ROOT / "docs" / "visualization" / "studies"
ENV = re.compile(r"<h1>[^<]*<span>(MTP-[\w-]+)</span>")
MOMENTS = re.compile(
    r'<section id="gallery">.*?</section>\n*|<a href="#gallery">[^<]*</a>\n', re.DOTALL
)
FILES = re.compile(
    r'<span class="files">[^<]*</span>|<p class="source">tables/[^<]*</p>\n'
)
COMMAND = re.compile(r"<code>mtp-bench (?:view|study) [^<]*")
FOLDER = re.compile(r"(?<= -o )\S+|\S+(?=/runs/)")  # of the study, in a command


def page_of(html: str) -> tuple[str, str]:
    """The environment's id and the page for the site, of a study's ``index.html``."""
    found = ENV.search(html)
    if found is None:
        raise SystemExit(
            "this page names no environment in its title: expected the index.html of `mtp-bench study`"
        )
    env = found[1]
    page = COMMAND.sub(
        lambda command: FOLDER.sub("study", command[0]), FILES.sub("", html)
    )
    return env, page if load_card(env).simulated else MOMENTS.sub("", page)


def main() -> None:
    """Write the pages of the folders that the command line names."""
    for folder in map(Path, sys.argv[1:]):
        env, page = page_of((folder / "index.html").read_text(encoding="utf-8"))
        PAGES.mkdir(exist_ok=True)
        write_text(PAGES / f"{env}.html", page)
        print(f"{PAGES.relative_to(ROOT)}/{env}.html: {len(page) // 1000} kB")


if __name__ == "__main__":
    main()
