"""The list of slow tests, which `make quick` leaves out, names tests that exist."""

from pathlib import Path

from tests.support.costs import SLOW


def test_it_names_tests_that_exist(repository: Path) -> None:
    names = SLOW.read_text(encoding="utf-8").splitlines()
    assert len(names) > 100
    assert names == sorted(set(names))
    for name in names:
        file, *_, function = name.split("::")
        assert f"def {function}(" in (repository / file).read_text(encoding="utf-8"), name
