"""Mechanical rules of plain English: openings of docstrings, words of messages, and one meaning for each class name."""

import ast
import re
from collections import Counter
from functools import cache

import pytest

from tests.conftest import REPOSITORY

FOLDERS = ("mtp_bench", "baselines", "benchmarks", "docs", "examples")
OPENING = re.compile(r"(What|Who|Whose|Whom|Where|When|How|Whether|That|Those|Nobody|Nothing|None)\b")
NEGATION = re.compile(r"(?<!there )\b(is|are|was|were|be) no(?! longer|t\b)\b|\b(is|are) none\b", re.IGNORECASE)
PEOPLE = re.compile(r"\b(nobody|somebody|whoever|whatever|anybody|who)\b", re.IGNORECASE)
DOCUMENTED = (ast.Module, ast.ClassDef, ast.FunctionDef, ast.AsyncFunctionDef)


@cache
def nodes(folder: str) -> list[tuple[str, ast.AST]]:
    """Place and node of all constants and all that may have a docstring in the modules of a folder."""
    found: list[tuple[str, ast.AST]] = []
    for path in sorted((REPOSITORY / folder).rglob("*.py")):
        name = path.relative_to(REPOSITORY)
        kept = (node for node in ast.walk(ast.parse(path.read_text())) if isinstance(node, (*DOCUMENTED, ast.Constant)))
        found += [(f"{name}:{getattr(node, 'lineno', 1)}", node) for node in kept]
    return found


def first_lines(folder: str) -> dict[str, str]:
    """First lines of the docstrings of a folder, by place."""
    documented = [(place, ast.get_docstring(node)) for place, node in nodes(folder) if isinstance(node, DOCUMENTED)]
    return {place: text.splitlines()[0] for place, text in documented if text}


def messages(folder: str) -> dict[str, str]:
    """Strings of several words, by place; docstrings are among them."""
    constants = [(place, node.value) for place, node in nodes(folder) if isinstance(node, ast.Constant)]
    return {place: text for place, text in constants if isinstance(text, str) and " " in text and len(text) > 20}


@pytest.mark.parametrize("folder", FOLDERS)
def test_docstrings_begin_with_a_verb_or_a_noun(folder: str) -> None:
    assert {place: line for place, line in first_lines(folder).items() if OPENING.match(line)} == {}


@pytest.mark.parametrize("folder", FOLDERS)
def test_docstrings_do_not_speak_of_people(folder: str) -> None:
    assert {place: line for place, line in first_lines(folder).items() if PEOPLE.search(line)} == {}


@pytest.mark.parametrize("folder", FOLDERS)
def test_texts_say_is_not_a(folder: str) -> None:
    texts = {**messages(folder), **first_lines(folder)}
    assert {place: NEGATION.findall(text) for place, text in texts.items() if NEGATION.search(text)} == {}


def test_class_names_stand_for_one_thing() -> None:
    classes = [node.name for _, node in nodes("mtp_bench") if isinstance(node, ast.ClassDef)]
    assert {name: count for name, count in Counter(classes).items() if count > 1 and not name.startswith("_")} == {}


@pytest.mark.parametrize("text", ["Where a track ends.", "Nobody is told.", "What is drawn"])
def test_the_rules_can_fail(text: str) -> None:
    assert OPENING.match(text) or PEOPLE.search(text)
    assert NEGATION.search("x is no folder")
    assert not NEGATION.search("there is no folder x, and it is not a file")
