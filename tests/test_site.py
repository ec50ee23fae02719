"""The site: built without a warning, whole, and readable without a network."""

import json
import os
import re
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import dataclass, field
from html.parser import HTMLParser
from importlib.util import find_spec
from pathlib import Path
from urllib.parse import unquote, urlsplit

import pytest
from PIL import Image

from docs.generate import notebooks, recordings, reference
from docs.generate.drawings import DRAWINGS, FOLDER
from docs.make_pictures import REAL
from mtp_bench import card_ids, load_card
from mtp_bench.agent.action import ACTION_FIELDS
from tests.support.browser import Browser, chromium
from tests.support.kept import kept
from tests.support.programs import require_program

LARGEST = 500_000  # bytes of a moving picture
LOADED = {"script": "src", "img": "src", "iframe": "src", "source": "src", "link": "href"}  # what a browser fetches


@dataclass
class Page(HTMLParser):
    """Places, links and loaded files of a page."""

    file: Path
    ids: set[str] = field(default_factory=set)
    links: list[str] = field(default_factory=list)
    loaded: list[str] = field(default_factory=list)

    def __post_init__(self) -> None:
        super().__init__()
        self.feed(self.file.read_text())

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        given = {name: value or "" for name, value in attrs}
        self.ids |= {given[name] for name in ("id", "name") if name in given}
        if tag == "a" and "href" in given:
            self.links.append(given["href"])
        if LOADED.get(tag) in given and given.get("rel") != "canonical":
            self.loaded.append(given[LOADED[tag]])


@pytest.fixture(scope="module")
def site(repository: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The site, built as `make docs` does it; a warning is an error."""
    if find_spec("mkdocs") is None:
        pytest.skip("mkdocs is not installed: pip install '.[docs]'")

    def build(folder: Path) -> None:
        command = [sys.executable, "-m", "mkdocs", "build", "--strict", "--site-dir", str(folder)]
        environment = {**os.environ, "NO_MKDOCS_2_WARNING": "1"}
        done = subprocess.run(command, cwd=repository, env=environment, capture_output=True, text=True, check=False)
        assert done.returncode == 0, done.stdout + done.stderr
        assert "WARNING" not in done.stdout + done.stderr

    return kept("site", tmp_path_factory, build)


@pytest.fixture(scope="module")
def pages(site: Path) -> dict[Path, Page]:
    """All pages by their file, but the one that a server shows at any wrong address."""
    return {file: Page(file) for file in sorted(site.rglob("*.html")) if file.name != "404.html"}


def test_no_link_is_dead(site: Path, pages: dict[Path, Page]) -> None:
    dead = []
    for file, page in pages.items():
        for target in (*page.links, *page.loaded):
            parts = urlsplit(target)
            if parts.scheme or parts.netloc:
                continue
            wanted = (file.parent / unquote(parts.path)).resolve() if parts.path else file
            if wanted.is_dir():
                wanted /= "index.html"
            known = pages[wanted].ids if wanted in pages else set()
            if not wanted.exists() or (parts.fragment and wanted in pages and unquote(parts.fragment) not in known):
                dead.append(f"{file.relative_to(site)}: {target}")
    assert not dead


def test_no_link_of_a_part_of_the_board_is_dead(site: Path) -> None:
    board = site / "leaderboard" / "board.html"
    scripts = list((site / "leaderboard" / "index.parts").rglob("*.js"))
    assert scripts
    for script in scripts:
        for target in re.findall(r'(?:href|src)="([^"#]+)"', script.read_text().replace("\\", "")):
            parts = urlsplit(target)
            assert parts.scheme or (board.parent / unquote(parts.path)).resolve().exists(), f"{script.name}: {target}"


def test_nothing_is_loaded_from_elsewhere(site: Path, pages: dict[Path, Page]) -> None:
    loaded = {target for page in pages.values() for target in page.loaded}
    assert loaded
    assert not [target for target in loaded if urlsplit(target).netloc]
    for style in site.rglob("*.css"):
        assert "url(http" not in style.read_text().replace('"', "").replace("'", "")
        assert "@import" not in style.read_text()


@pytest.mark.parametrize("env_id", card_ids())
def test_every_environment_has_its_page(site: Path, env_id: str) -> None:
    text = (site / "environment" / f"{env_id}.html").read_text()
    for name in [*(part.name for part in ACTION_FIELDS), "detection_box", "ego_pose", "dt"]:
        assert f"<code>{name}</code>" in text
    for heading in ("observation", "action", "reward", "data-and-licence", "history"):
        assert f'id="{heading}"' in text
    assert load_card(env_id).digest in text
    simulated, pictured = load_card(env_id).simulated, f'src="pictures/{env_id}.webp"' in text
    assert pictured or not simulated
    assert (recordings.OWN in text) is (pictured and not simulated)


@pytest.mark.data
def test_real_failures_are_in_the_site(site: Path) -> None:
    page = Page(site / "visualization" / "why.html")
    assert {f"../pictures/{name}.png" for name in REAL} <= set(page.loaded)
    assert re.search(r"pedestrian \d+ loses track \d+", page.file.read_text())


@pytest.mark.parametrize("env_id", card_ids())
def test_the_gallery_shows_every_environment(site: Path, env_id: str) -> None:
    (place,) = re.findall(rf'src="(pictures/{env_id}\.\w+)"', (site / "environment" / "gallery.html").read_text())
    picture = site / "environment" / place
    if picture.suffix == ".svg":
        assert not load_card(env_id).simulated
    else:
        with Image.open(picture) as moving:
            assert getattr(moving, "n_frames", 1) > 10
        assert picture.stat().st_size <= LARGEST


def test_the_reference_is_complete(site: Path) -> None:
    ids = {place for file in (site / "reference").glob("*.html") for place in Page(file).ids}
    wanted = {f"mtp_bench.{name}" for name in reference.public_names()}
    for part in reference.PACKAGES:
        wanted |= {f"mtp_bench.{part}.{name}" for name in reference.names_of(part)}
    assert wanted
    assert not wanted - ids


@pytest.mark.parametrize("name", notebooks.NAMES)
def test_a_notebook_is_there_with_its_outputs(site: Path, name: str) -> None:
    cells = json.loads((site / "notebooks" / f"{name}.ipynb").read_text())["cells"]
    code = [cell for cell in cells if cell["cell_type"] == "code"]
    assert all(cell["execution_count"] for cell in code)
    assert any(cell["outputs"] for cell in code)


def test_a_model_of_ones_own_takes_forty_lines() -> None:
    pytest.importorskip("jupytext")
    assert notebooks.code_lines("own_model") <= 40


@pytest.mark.parametrize("name", DRAWINGS)
def test_drawings_show_what_the_scorer_says(name: str) -> None:
    assert (FOLDER / f"{name}.svg").read_text() == DRAWINGS[name](), "run python -m docs.generate.drawings"


@pytest.fixture(scope="module")
def browser(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Browser]:
    require_program("browser")
    with chromium(tmp_path_factory.mktemp("browser")) as opened:
        opened.resize(1600, 900)
        # before the scripts of every page: no choice of an earlier visit
        opened.devtools("Page.addScriptToEvaluateOnNewDocument", source="localStorage.clear()")
        opened.forget()
        yield opened


SHOWN = ("index", "definitions/index", "environment/gallery", "environment/MTP-KITTI-v0", "reference/records",
         "notebooks/own_model", "leaderboard/results")  # fmt: skip


@pytest.mark.parametrize(
    ("name", "scheme"), [*((name, "light") for name in SHOWN), ("index", "dark"), (SHOWN[-1], "dark")]
)
def test_it_fits_and_asks_for_nothing(site: Path, browser: Browser, name: str, scheme: str) -> None:
    browser.prefer(scheme)
    browser.forget()
    browser.open(site / f"{name}.html")
    white = "getComputedStyle(document.body).backgroundColor === 'rgb(255, 255, 255)'"
    assert browser.wait_for(f"return ({white}) === {json.dumps(scheme == 'light')}")  # scripts of the page set it
    for width in (1600, 390):
        browser.resize(width, 900)
        fits = f"return document.documentElement.scrollWidth <= {width}"
        assert browser.wait_for(fits), width  # what was beside the page slides to its place
    assert browser.console() == []
    assert [url for url in browser.requests() if urlsplit(url).scheme in ("http", "https", "ws", "wss")] == []


def test_the_search_works_without_a_server(site: Path, browser: Browser) -> None:
    browser.resize(1600, 900)
    browser.open(site / "index.html")
    browser.click(".md-search__input")
    # the index is read first: what is typed before is not searched
    assert browser.wait_for(
        "return /type to start/i.test(document.querySelector('.md-search-result__meta').textContent)"
    )
    browser.type(".md-search__input", "reacquired")
    assert browser.wait_for("return document.querySelector('.md-search-result__item h1')?.textContent")
    # lunr, which searches, may take terms that end in digits for each other: of a single letter its worker complains then
    assert [line for line in browser.console() if "/workers/search." not in line] == []
