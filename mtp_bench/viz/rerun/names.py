"""Names in recordings: those of the pictures, in signs that the viewer can draw."""

import re

import numpy as np

from ..replay import Replay


def drawable(text: str) -> str:
    """The text with "?" for every sign that the viewer's only font may lack: one of them would end the viewer."""
    return re.sub(r"[^\n\x20-\x7e\xa1-\xac\xae-\u017f\u0391-\u03a1\u03a3-\u03c9\u0410-\u044f]", "?", text)


def object_names(run: Replay) -> dict[int, str]:
    """Name of each true object by its number, such as "car 4"."""
    truth, classes = run.scene.truth, run.card.task.classes
    ids, first = np.unique(truth.object_id, return_index=True)
    nouns = [classes[class_id].replace("_", " ") for class_id in truth.class_id[first].tolist()]
    return {i: drawable(f"{noun} {run.scene.short_name(i)}") for i, noun in zip(ids.tolist(), nouns, strict=True)}


def path_part(name: str) -> str:
    """The name as a part of a path, in which the viewer shows no other signs as they are: "car-4"."""
    return re.sub(r"[^A-Za-z0-9_.]+", "-", name).strip("-")
