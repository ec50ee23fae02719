"""The leaderboard in a real browser: sorting, filters, details, and that nothing leaves the page or runs in it."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from mtp_bench.viz.board import board_page
from tests.support.board_records import HOSTILE, LEVELS_OF, board_of, made_up, made_up_board
from tests.support.browser import CHROMIUM, DRIVER, ENTER, MISSING, Browser, chromium

pytestmark = pytest.mark.skipif(not (CHROMIUM and DRIVER), reason=MISSING)

FIRST = "section:nth-of-type(1)"
NAMES = f"""return [...document.querySelectorAll("{FIRST} tbody.entry")].filter((e) => !e.hidden)
    .map((e) => e.querySelector(".title").textContent)"""
RANKED = ["braided_paths", "forest_of_maybe", "calm_hedge", "late_decider", "stp", "straight_on"]
UNRANKED = ["truth_past", "pooled_many", "short_of_breath", "sleeper"]


@pytest.fixture(scope="module")
def browser(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Browser]:
    with chromium(tmp_path_factory.mktemp("browser")) as started:
        yield started


@pytest.fixture(scope="module")
def page(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("page") / "board of all.html"
    path.write_text(board_page(board_of(*made_up_board(), links=["record.json"] * 13, levels=LEVELS_OF)))
    return path


@pytest.fixture
def opened(browser: Browser, page: Path) -> Iterator[Browser]:
    """The page, wide and freshly loaded; afterwards the console is clean and only the page itself was asked for."""
    browser.resize(1700, 1000)
    with only(browser, page):
        yield browser


@contextmanager
def only(browser: Browser, page: Path) -> Iterator[None]:
    """Loads a page; afterwards the console is clean and only the page itself was asked for."""
    browser.forget()
    browser.open(page)
    yield
    assert browser.console() == []
    assert {address for address in browser.requests() if not address.startswith("data:")} == {page.as_uri()}


def names(browser: Browser) -> list[str]:
    found: list[str] = browser.script(NAMES)
    return found


def header(key: str) -> str:
    return f'{FIRST} thead button[data-key="{key}"]'


def sorted_by(browser: Browser) -> list[list[str]]:
    found: list[list[str]] = browser.script(
        f"""return [...document.querySelectorAll("{FIRST} th[aria-sort]")]
        .map((h) => [h.querySelector("button").dataset.key, h.getAttribute("aria-sort")])"""
    )
    return found


def test_it_opens_by_rank(opened: Browser) -> None:
    assert names(opened) == RANKED + UNRANKED
    assert sorted_by(opened) == [["rank", "ascending"]]
    assert opened.script("return document.getElementById('count').textContent") == "13 entries"


def test_a_click_sorts_and_another_turns_the_order(opened: Browser) -> None:
    opened.click(header("error"))
    assert sorted_by(opened) == [["error", "ascending"]]
    best = ["truth_past", "pooled_many", *RANKED, "short_of_breath", "sleeper"]
    assert names(opened) == best
    opened.click(header("error"))
    assert sorted_by(opened) == [["error", "descending"]]
    assert names(opened) == [*best[-2::-1], "sleeper"]  # what has no number stays last


def test_where_more_is_better_the_most_comes_first(opened: Browser) -> None:
    opened.click(header("level"))
    assert names(opened)[0] == "braided_paths"
    assert sorted_by(opened) == [["level", "descending"]]


def test_the_keyboard_sorts_too(opened: Browser) -> None:
    opened.type(header("name"), ENTER)
    assert names(opened) == sorted(RANKED + UNRANKED)


def test_the_other_table_keeps_its_order(opened: Browser) -> None:
    opened.click(header("name"))
    second = NAMES.replace("nth-of-type(1)", "nth-of-type(2)")
    assert opened.script(second) == ["braided_paths", "stp", "calm_hedge"]


def test_text_filters(opened: Browser) -> None:
    opened.type("#text", "PATHS ada")
    assert names(opened) == ["braided_paths"]
    assert opened.script("return document.getElementById('count').textContent") == "2 of 13 entries"
    opened.type("#text", "nobody")
    assert names(opened) == []
    assert opened.script(f"return document.querySelector('{FIRST} .none').checkVisibility()")


@pytest.mark.parametrize(
    ("control", "value", "kept"),
    [
        ("division", "open", ["pooled_many"]),
        ("level", "2", ["braided_paths", "stp"]),
        ("level", "0", RANKED + UNRANKED),
    ],
)
def test_selections_filter(opened: Browser, control: str, value: str, kept: list[str]) -> None:
    choose(opened, control, value)
    assert names(opened) == kept


def test_one_env_is_shown_alone(opened: Browser) -> None:
    choose(opened, "env", "MTP-WILDTRACK-v0")
    shown = (
        "return [...document.querySelectorAll('.board')].filter((b) => b.checkVisibility()).map((b) => b.dataset.env)"
    )
    assert opened.script(shown) == ["MTP-WILDTRACK-v0"]
    assert opened.script("return document.getElementById('count').textContent") == "3 of 13 entries"


def test_the_unranked_can_be_left_out(opened: Browser) -> None:
    opened.click("#unranked")
    assert names(opened) == RANKED


def choose(browser: Browser, control: str, value: str) -> None:
    browser.script(
        """const chosen = document.getElementById(arguments[0]);
        chosen.value = arguments[1];
        chosen.dispatchEvent(new Event("input", { bubbles: true }));""",
        control,
        value,
    )


def test_details_open_and_close(opened: Browser) -> None:
    visible = f"return document.querySelector('{FIRST} tbody.entry .detail').checkVisibility()"
    button = f"{FIRST} tbody.entry .open"
    expanded = f"return document.querySelector('{button}').getAttribute('aria-expanded')"
    assert not opened.script(visible)
    opened.click(button)
    assert opened.script(visible)
    assert opened.script(expanded) == "true"
    assert "localisation" in opened.script(f"return document.querySelector('{FIRST} .detail').innerText")
    opened.type(button, ENTER)
    assert not opened.script(visible)


@pytest.mark.parametrize("width", [360, 390, 768, 1120, 1366, 1700])
def test_no_width_makes_the_page_scroll_sideways(opened: Browser, width: int) -> None:
    opened.resize(width, 900)
    opened.click(f"{FIRST} tbody.entry .open")
    assert opened.script("return document.documentElement.scrollWidth") <= width


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_both_schemes_have_contrast(opened: Browser, scheme: str) -> None:
    opened.prefer(scheme)
    colors = opened.script(
        """const style = getComputedStyle(document.documentElement);
        return ["--card", "--ink", "--soft", "--faint", "--warn", "--accent"].map((n) => style.getPropertyValue(n));"""
    )
    card, *inks = [luminance(color.strip()) for color in colors]
    for ink in inks:
        assert (max(card, ink) + 0.05) / (min(card, ink) + 0.05) >= 4.5  # WCAG 2.2, level AA


def luminance(color: str) -> float:
    channels = [int(color[i : i + 2], 16) / 255 for i in (1, 3, 5)]
    linear = [c / 12.92 if c <= 0.04045 else ((c + 0.055) / 1.055) ** 2.4 for c in channels]
    return 0.2126 * linear[0] + 0.7152 * linear[1] + 0.0722 * linear[2]


def test_hostile_texts_do_not_run(browser: Browser, tmp_path: Path) -> None:
    texts = [HOSTILE, "<script>window.hacked=1</script>", "<!-- <script>", '" autofocus onfocus="window.hacked=1']
    records = [
        made_up(
            f"hostile_{i}", 1.0 + i, submission={"authors": [x], "description": x}, status="partial", status_reason=x
        )
        for i, x in enumerate(texts)
    ]
    path = tmp_path / "hostile.html"
    path.write_text(board_page(board_of(*records, links=["javascript:window.hacked=1"] * 4)))
    with only(browser, path):
        assert names(browser) == [record.submission.name for record in records]
        browser.click(f"{FIRST} tbody.entry .open")
        assert browser.script("return [...document.querySelectorAll('.detail a')].every((a) => a.protocol === 'file:')")
        assert browser.script("return typeof window.hacked") == "undefined"


def test_a_script_that_slipped_in_would_not_run(browser: Browser, tmp_path: Path) -> None:
    html = board_page([]).replace(
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


def test_an_empty_board_opens(browser: Browser, tmp_path: Path) -> None:
    path = tmp_path / "empty.html"
    path.write_text(board_page([]))
    with only(browser, path):
        assert "mtp-bench submit" in browser.script("return document.querySelector('.empty').innerText")
