"""What two versions may differ in (`benchmarks/same_results.py`): by design, or not."""

import copy

import pytest

from benchmarks.same_results import Case, Part, differences, report

WHOLE = Case("MTP-PETS-v0", None, ("stp",))
SOME = Case("MTP-KITTI-v0", 2, ("stp",))
OWN = Case("MTP-PETS-v0", None, ("stp",), ("--files", "log"))
ROW = {"agent": "stp", "subset": "all", "error": 1.5, "plain_error": 1.25, "p": None, "place": 1}


def results(definitions: str = "3.0", **changed: object) -> Part:
    """Return the results of a case: one array, one row with these fields changed."""
    return {
        "table": {"all": {"definitions": definitions}},
        "rollouts": {"stp": {"scene/forecast": "1a2b"}},
        "rows": {"stp all": {**ROW, **changed}, "stp_hedged all": {**ROW, "agent": "stp_hedged"}},
    }


def differs(case: Case, before: Part, after: Part) -> bool:
    """Return True if the program ends with exit status 1."""
    return report({"case": before}, {"case": after}, {"case": case})


@pytest.mark.parametrize(
    ("case", "field", "fault"),
    [
        (SOME, "error", False),
        (OWN, "error", False),
        (WHOLE, "error", True),
        (SOME, "plain_error", True),
        (OWN, "plain_error", True),
    ],
)
def test_new_budgets_move_bade_where_scenes_are_not_a_whole_split(case: Case, field: str, fault: bool) -> None:
    assert differs(case, results(), results("3.1", **{field: 2.0})) is fault


def test_the_same_definitions_excuse_no_number() -> None:
    assert differs(SOME, results(), results(error=2.0))


def test_no_array_of_a_rollout_may_change() -> None:
    after = results("3.1")
    after["rollouts"]["stp"]["scene/forecast"] = "3c4d"
    assert differs(SOME, results(), after)


def test_added_columns_arrays_and_controls_are_by_design(capsys: pytest.CaptureFixture[str]) -> None:
    after = results(energy=0.5)
    after["rollouts"]["stp"]["scene/ego_size"] = "5e6f"
    after["rows"]["stp_neighbours all"] = after["rows"].pop("stp_hedged all")
    after["rows"]["stp all"]["place"] = 2
    assert not differs(WHOLE, results(), after)
    printed = capsys.readouterr().out
    assert all(name in printed for name in ("rows/energy", "rollouts/scene/ego_size", "rows/place"))


def test_an_agent_that_was_asked_for_may_not_vanish() -> None:
    after = results("3.1")
    del after["rows"]["stp all"]
    assert differs(SOME, results(), after)


def test_a_place_may_not_change_among_the_same_agents() -> None:
    assert differs(WHOLE, results(), results(place=2))


def test_a_stored_run_keeps_every_number() -> None:
    stored = {"stored run": results()}
    moved = {"stored run": results("3.1", error=2.0)}
    assert report(stored, moved, {})
    assert not report(stored, {"stored run": results("3.1")}, {})


def test_differences_name_section_row_and_field() -> None:
    before = results()
    after = copy.deepcopy(before)
    after["rows"]["stp all"]["error"] = None
    assert [str(each) for each in differences(before, after)] == ["rows/stp all/error: 1.5 -> None"]
