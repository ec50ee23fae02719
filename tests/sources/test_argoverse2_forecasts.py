"""Argoverse 2's form of forecasts, a pickle: what is read, and the one error of each wrong file."""

import pickle
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from mtp_bench.core import DataError
from mtp_bench.sources import StoredForecasts, forecast_forms, open_source, package_of
from mtp_bench.sources.argoverse2 import forecasts
from tests.support.forecast_files import LOG, av2, av2_object, stamp, write_log
from tests.support.source_files import with_source

CARD = with_source("MTP-AV2-v0", detector=None)
OLD_NUMPY = ((b"numpy._core", b"numpy.core"),)


def read(data: Path, content: bytes) -> StoredForecasts:
    (data / "f.pkl").write_bytes(content)
    scenes = open_source(CARD, data)
    return forecast_forms(package_of(CARD))["av2"].open(CARD, str(data), data / "f.pkl")(scenes.load(LOG))


def renamed(content: bytes) -> bytes:
    """The pickle as an older NumPy names its functions: in a frame or not, a name has its length before it."""
    for new, old in (
        (b"numpy._core.multiarray", b"numpy.core.multiarray"),
        (b"numpy._core.numeric", b"numpy.core.numeric"),
    ):
        content = content.replace(b"\x8c" + bytes([len(new)]) + new, b"\x8c" + bytes([len(old)]) + old)
        content = content.replace(b"c" + new + b"\n", b"c" + old + b"\n")
    return content


def unframed(value: Any, protocol: int) -> bytes:
    """A pickle without frames, whose lengths a change would break."""
    import io

    stream = io.BytesIO()
    pickler: Any = pickle._Pickler(stream, protocol)
    pickler.framer.start_framing = lambda: None
    pickler.dump(value)
    return stream.getvalue()


@pytest.mark.parametrize("protocol", [2, 3, 4, 5])
@pytest.mark.parametrize("age", ["new", "old"])
def test_what_is_read(protocol: int, age: str, tmp_path: Path) -> None:
    content = unframed(av2(), protocol) if age == "old" else pickle.dumps(av2(), protocol)
    if age == "old":
        assert b"numpy._core" in content
        content = renamed(content)
        assert b"numpy._core" not in content
    stored = read(write_log(tmp_path), content)
    assert stored.frame.tolist() == [0, 1, 1, 1]
    assert stored.class_name.tolist() == ["car", "car", "bus", "skipped"]
    assert stored.identity.tolist() == ["3", "3", "11", "4"]
    np.testing.assert_allclose(stored.confidence, [0.9, 0.8, 0.25, 0.5])
    # less the origin of the log; the bus states the height 51 in a city whose ground is at 50
    np.testing.assert_allclose(stored.box[0], [10, 4, 0, 0.5, 4, 2, 1.5])
    np.testing.assert_allclose(stored.box[2], [20, -10, 1, -1, 9, 3, 3])
    assert stored.path.shape == (4, 5, 6, 2)
    np.testing.assert_allclose(stored.path[1, 0, [0, 5]], np.array([[5, 4], [-7.5, 4]]))
    np.testing.assert_allclose(stored.path[1, 4, [0, 5]], np.array([[6, 4], [-1.5, 4]]))  # 0.6 times as fast
    assert np.argmax(stored.log_weight, axis=1).tolist() == [1] * 4
    assert stored.others == 1


def change(**changes: Any) -> Callable[[Any], Any]:
    return lambda content: content[LOG][stamp(1)][1].update(changes)


def laughs() -> list[Any]:
    """A list of lists of lists ..., ten in each: its text has 10 to the power of 40 letters."""
    nested: list[Any] = ["ha"]
    for _ in range(40):
        nested = [nested] * 10
    return nested


WRONG: dict[str, tuple[Callable[[Any], Any], str]] = {
    "no log": (lambda content: content.pop(LOG), "1 other logs, but none for scene 'a-log'; --split"),
    "a list of logs": (lambda content: content.update({LOG: []}), "1 other logs, but none for scene 'a-log'"),
    "a missing frame": (
        lambda content: content[LOG].pop(stamp(1)),
        f"log 'a-log', time {stamp(1)}: no list of up to 10000 objects, expected one for each frame, empty where"),
    "a dict of objects": (lambda content: content[LOG].update({stamp(1): {}}), "no list of up to 10000 objects"),
    "no dict": (lambda content: content[LOG].update({stamp(1): [3]}), "object 0: int, expected a dict"),
    "no score": (lambda content: content[LOG][stamp(1)][1].pop("score"), "object 1, score: NoneType, expected numbers"),
    "a flat forecast": (change(prediction_m=np.zeros(60)),
                        r"object 1, prediction_m: numbers of shape \(60,\), expected \(-1, -1, 2\)"),
    "no forecast": (change(prediction_m=None), "object 1, prediction_m: NoneType, expected numbers"),
    "words": (change(prediction_m=np.array([[["1", "2"]]])), "prediction_m: ndarray, expected numbers"),
    "lists that never end": (change(prediction_m=laughs()), r"prediction_m: .*expected \(-1, -1, 2\)"),
    "too few weights": (change(score=np.ones(3)), r"object 1: samples of shape \(5, 6, 2\), expected \(3, 6, 2\): as many as weights"),
    "another length": (change(prediction_m=np.zeros((5, 3, 2))), r"samples of shape \(5, 3, 2\), expected \(5, 6, 2\)"),
    "a box in words": (change(size="big"), "object 1, size: str, expected numbers"),
    "two sides": (change(size=[1.0, 2.0]), r"object 1, size: numbers of shape \(2,\), expected \(3,\)"),
    "one coordinate": (change(current_translation_m=[1.0]), "object 1: a place of 1 numbers, expected x y"),
    "two yaws": (change(yaw=[1.0, 2.0]), r"object 1, yaw: numbers of shape \(2,\), expected \(\)"),
    "a number without end": (change(size=[10**400, 1, 1]), "object 1, size: "),
}  # fmt: skip


@pytest.mark.parametrize("case", WRONG)
def test_a_wrong_file(case: str, tmp_path: Path) -> None:
    wrong, message = WRONG[case]
    content = av2()
    wrong(content)
    with pytest.raises(DataError, match=message) as caught:
        read(write_log(tmp_path), pickle.dumps(content))
    assert "\n" not in str(caught.value)


def test_names_that_never_end_are_no_names(tmp_path: Path) -> None:
    content = {LOG: {stamp(0): [av2_object((1, 1), (1, 0), 0.5, name=laughs(), instance_id=laughs())]}}
    content[LOG] |= {stamp(1): [], stamp(2): []}
    stored = read(write_log(tmp_path), pickle.dumps(content))
    assert (stored.class_name.tolist(), stored.identity.tolist()) == ([""], [""])


def test_too_many_objects(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(forecasts, "MAX_OBJECTS", 2)
    with pytest.raises(DataError, match="no list of up to 2 objects"):
        read(write_log(tmp_path), pickle.dumps(av2()))


def test_a_pickle_of_another_thing(tmp_path: Path) -> None:
    with pytest.raises(DataError, match="list, expected a dict of logs"):
        read(write_log(tmp_path), pickle.dumps([av2()]))
