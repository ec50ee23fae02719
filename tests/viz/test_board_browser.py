"""The leaderboard in a real browser: sorting, filters, details, and that nothing leaves the page or runs in it."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from mtp_bench.viz.board.entries import Entry
from mtp_bench.viz.board.page import board_files, parts_folder, write_board
from tests.support.board_records import FEW, HOSTILE, LEVELS_OF, MAIN, board_of, made_up, made_up_board
from tests.support.browser import ENTER, Browser, chromium

pytestmark = pytest.mark.needs("browser")

FIRST = f'section[data-env="{MAIN}"]'
NAMES = """return [...document.querySelectorAll(`section[data-env="${arguments[0]}"] tbody.entry`)]
    .filter((e) => !e.hidden).map((e) => e.querySelector(".open").textContent)"""
HEADINGS = f"""return [...document.querySelectorAll(`{FIRST} tbody.heading`)].filter((e) => e.checkVisibility())
    .map((e) => e.nextElementSibling.querySelector(".open").textContent)"""  # the entries below them
COUNT = "return document.getElementById('_count').textContent"
RANKED = ["braided_paths", "forest_of_maybe", "calm_hedge", "late_decider", "stp", "straight_on"]
UNRANKED = ["gt_tracks", "pooled_many", "sleeper", "short_of_breath"]


@pytest.fixture(scope="module")
def browser(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Browser]:
    with chromium(tmp_path_factory.mktemp("browser")) as started:
        yield started


@pytest.fixture(scope="module")
def page(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("page") / "board of all.html"
    write(path, board_of(*made_up_board(), links=["record.json"] * 13, levels=LEVELS_OF))
    return path


def write(path: Path, entries: list[Entry]) -> None:
    write_board(path, board_files(entries, folder=parts_folder(path).name))


@pytest.fixture
def opened(browser: Browser, page: Path) -> Iterator[Browser]:
    """The page, wide and freshly loaded; afterwards the console is clean and only its own files were asked for."""
    browser.resize(1700, 1000)
    with only(browser, page):
        yield browser


@contextmanager
def only(browser: Browser, page: Path) -> Iterator[None]:
    """Loads a page; afterwards the console is clean and only it and its parts were asked for."""
    browser.script("location.href = 'about:blank'")  # the address of the page before may have a place and filters
    browser.forget()
    browser.open(page)
    yield
    assert browser.console() == []
    asked = {address.split("#")[0] for address in browser.requests()} - {page.as_uri()}
    assert not [address for address in asked if not address.startswith(("data:", f"{parts_folder(page).as_uri()}/"))]


def names(browser: Browser, env: str = MAIN) -> list[str]:
    found: list[str] = browser.script(NAMES, env)
    return found


def hash_of(browser: Browser) -> str:
    return str(browser.script("return location.hash"))


def header(key: str) -> str:
    return f'{FIRST} thead button[aria-describedby="_about-{key}"]'


def sorted_by(browser: Browser) -> list[list[str]]:
    found: list[list[str]] = browser.script(
        f"""return [...document.querySelectorAll(`{FIRST} th[aria-sort]`)].map((header) =>
            [header.querySelector("button").getAttribute("aria-describedby").slice(7), header.ariaSort])"""
    )
    return found


def test_it_opens_by_rank_a_click_sorts_and_another_turns_the_order(opened: Browser) -> None:
    assert (names(opened), sorted_by(opened)) == (RANKED + UNRANKED, [["rank", "ascending"]])
    assert opened.script(COUNT) == "13 entries"
    opened.click(header("error"))
    assert sorted_by(opened) == [["error", "ascending"]]
    # an agent that crashed everywhere has the error of predicting nothing; a partial record is last
    best, last = ["gt_tracks", "pooled_many", *RANKED, "sleeper"], ["short_of_breath"]
    assert names(opened) == best + last
    opened.click(header("error"))
    assert (sorted_by(opened), names(opened)) == ([["error", "descending"]], best[::-1] + last)
    assert not opened.script(HEADINGS)
    opened.click(header("rank"))
    assert opened.script(HEADINGS) == ["gt_tracks", "pooled_many"]


def choose(browser: Browser, control: str, value: str) -> None:
    browser.script(
        """const chosen = document.getElementById(`_${arguments[0]}`);
        chosen.value = arguments[1];
        chosen.dispatchEvent(new Event("input", { bubbles: true }));""",
        control,
        value,
    )


def test_details_are_loaded_when_they_are_opened(opened: Browser) -> None:
    button = f"{FIRST} tbody.entry .open"
    expanded = f"return document.querySelector('{button}').getAttribute('aria-expanded')"
    assert not opened.script(f"return document.querySelector('{FIRST} .detail')")
    opened.click(button)
    assert "without forecast" in detail(opened)
    assert opened.script(expanded) == "true"
    assert hash_of(opened) == f"#{MAIN}/braided_paths"
    opened.type(button, ENTER)
    assert not opened.script(f"return document.querySelector('{FIRST} .detail').checkVisibility()")
    assert opened.script(expanded) == "false"
    assert hash_of(opened) == f"#{MAIN}"


def detail(browser: Browser) -> str:
    return str(browser.wait_for(f"return document.querySelector('{FIRST} .detail .panels')?.innerText"))


def at(browser: Browser, page: Path, place: str) -> None:
    browser.script("location.href = arguments[0]", f"{page.as_uri()}#{place}")


def test_the_address_opens_an_entry_and_keeps_the_filters(opened: Browser, page: Path) -> None:
    opened.type("#_text", "a b&c?")
    choose(opened, "level", "1")
    opened.click("#_unranked")
    assert hash_of(opened) == "#?text=a+b%26c%3F&level=1&unranked=no"
    at(opened, page, f"{MAIN}?text=paths&level=2")
    assert opened.wait_for(f"{COUNT} === '2 of 13 entries'")
    assert names(opened) == ["braided_paths"]
    assert opened.script("return document.getElementById('_text').value") == "paths"
    at(opened, page, f"{MAIN}/sleeper?env={FEW}")
    assert "signal 9" in detail(opened)  # a place is shown whatever the filters say
    assert opened.script("return document.activeElement.textContent") == "sleeper"


def test_no_width_makes_the_page_scroll_sideways(opened: Browser) -> None:
    opened.click(f"{FIRST} tbody.entry .open")
    assert detail(opened)
    for width in (360, 390, 768, 1120, 1366, 1700):
        opened.resize(width, 900)
        assert opened.script("return document.documentElement.scrollWidth") <= width


def test_no_table_of_the_leaderboard_is_cut_off(browser: Browser, repository: Path) -> None:
    tables = "[...document.querySelectorAll('.ranking')]"
    wider = f"{tables}.filter((table) => table.scrollWidth > table.parentElement.clientWidth).length"
    with only(browser, repository / "leaderboard" / "index.html"):
        for width in (390, 741, 1246, 1400, 1600, 1900):
            browser.resize(width, 900)
            assert browser.script(f"return {wider}") == 0, width


def test_hostile_texts_do_not_run(browser: Browser, tmp_path: Path) -> None:
    texts = [HOSTILE, "<script>window.hacked=1</script>", "<!-- <script>", '" autofocus onfocus="window.hacked=1']
    records = [
        made_up(
            f"hostile_{i}",
            1.0 + i,
            submission={"authors": [x], "description": x},
            missed={"reasons": {x: f"rejected: {x}"}},
        )
        for i, x in enumerate(texts)
    ]
    path = tmp_path / "hostile.html"
    write(path, board_of(*records, links=["javascript:window.hacked=1"] * 4))
    with only(browser, path):
        assert names(browser) == [record.submission.name for record in records]
        browser.click(f"{FIRST} tbody.entry .open")
        assert detail(browser)
        assert browser.script("return [...document.querySelectorAll('.detail a')].every((a) => a.protocol === 'file:')")
        assert browser.script("return typeof window.hacked") == "undefined"


def test_a_script_that_slipped_in_would_not_run(browser: Browser, tmp_path: Path) -> None:
    html = board_files([]).page.replace(
        "</footer>", "<script>window.hacked=1</script><img src='https://a.invalid/x'></footer>"
    )
    path = tmp_path / "slipped.html"
    path.write_text(html)
    browser.forget()
    browser.open(path)
    assert browser.script("return typeof window.hacked") == "undefined"
    refused = browser.console()
    assert len(refused) == 2
    assert all("Content Security Policy" in message for message in refused)
