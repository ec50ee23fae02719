"""The page of the keys of `--json`: of `compare` and `score` made from the declarations of the rows."""

from __future__ import annotations

from pydantic import BaseModel

from mtp_bench.core import Column, columns_of
from mtp_bench.scoring.driving import DrivingRow
from mtp_bench.scoring.rows import (
    Bin,
    Clear,
    Details,
    Errors,
    OfficialRow,
    PairedRow,
    Reliability,
    Row,
    Tracking,
)

CONTENT = {  # of `compare --json` and `score --json`
    "env": "Id of the environment.",
    "definitions": "Version of the definitions that every number follows.",
    "rows": "A row per agent, setting and subset.",
    "condition": "Conditions of the numbers.",
    "paired": "Differences of each agent to a control, by subset; `compare` alone.",
    "details": "A row per agent and setting, over all targets.",
    "official": "Numbers of MFEval and UniAD; `score --official` alone.",
    "skipped": "Rows of the data that could not be used, by reason.",
    "ms_per_frame": "Mean time of a frame, by row; differs from machine to machine.",
    "failures": "Agents that failed, with the reason; `compare` alone.",
    "doubts": "What the doctor doubts about the data; `compare` alone.",
}
CONDITION = {
    "source": "Kind of data.",
    "folder": "Name of the folder of own scenes.",
    "split": "Split of the scenes.",
    "detector": "Detector by which agents choose their settings.",
    "card": "Digest of the card.",
    "detections": "Origin of the detections, with the number of scenes.",
    "truth": "Complete, or prediction targets only.",
    "weights": "Origin of the event weights.",
    "budget": "Budgets of false forecasts, and where they come from.",
    "presence": "Presence model of baselines that the run names: its file, or scores; empty: the detector's.",
    "trained": "Agents with parts that were trained on the scored scenes.",
}
PER_SCENE = {  # of `Report.per_scene`, beside columns of rows
    "seed": "Number of the run, from 0 on.",
    "scene": "Name of the scene.",
    "frames": "Frames of the scene.",
    "covered": "Targets that have a forecast.",
    "bADE": "Budgeted ADE at the budgets of all scenes together, metres.",
    "bADE_sum": "The same, summed over the targets, metres.",
    "forecasts": "Number of forecasts.",
    "false_forecasts": "Forecasts of no true object.",
    "identity_switches": "The agent's own ones; null for an agent that states no tracks.",
}

_WHERE = {
    "scene": "Name of the scene.",
    "class": "Class of the object.",
    "object": "Number of the object in the scene; null for a false forecast.",
    "object_id": "Its whole id in the source.",
    "frame": "Frame of the event; of a moment its worst one that has its cause.",
    "until": "Last frame.",
    "error": "What the target adds to bADE, metres; of a moment the mean of its frames. null: not a target.",
    "parts": "Its parts, metres, by name: the largest first, below threshold last.",
    "minADE": "minADE of the forecast in that frame, metres; null without one.",
    "confidence": "Confidence of the forecast; of a run of false forecasts the highest.",
    "view": "Command that opens it.",
    "old_id": "Track that matched the object before.",
    "new_id": "Track that matches it now.",
    "old_id_in_file": "Id of that track in a file of stored tracks.",
    "new_id_in_file": "The same of the track now.",
}
WORST = {  # the file of `worst --json`, beside env and agent
    "error": "Mean error of all targets of the listed scenes, metres.",
    "parts": "Its parts by name, metres.",
    "faults": "Their sums by part of the stack, metres.",
    "cost": "Sum over all targets of what moments are sorted by, metres.",
    "moments": "The moments, in the order of the list.",
}
MOMENT = {  # of `worst --json`
    **_WHERE,
    "moment": "Name, as `--at` takes it.",
    "first": "First frame.",
    "start": "Time of the first frame since the begin of the scene, seconds.",
    "end": "Time of the last frame, seconds.",
    "frames": "Number of its targets.",
    "cost": "Sum over its frames of the error without the part below threshold, metres.",
    "fault": "`detector`, `tracker`, `predictor`, `forecast` (tracker or predictor), `confidence` or `data`.",
    "cause": "Name of its largest part.",
    "distance": "Distance from the ego in that frame, metres; null without an ego.",
    "borrowed": "True if the detections behind its cause are mostly those of other objects.",
}
EVENT = {  # of `events --json`
    **_WHERE,
    "event": "Name, as `--at` takes it.",
    "kind": "`ids`, `lost`, `reacquired`, `spurious` or `collision`.",
    "time": "Time since the begin of the scene, seconds.",
    "position": "Place of the object, metres, frame of the scene.",
    "wrong": "True for a loss whose track is still output, outside the gate.",
    "error_before": "Error of the object in the frame before, metres.",
    "cause": "Of a collision: the part of the stack at fault, and what was known of the object before; else null.",
    "at_fault": "Of a collision: true if the ego is at fault, false if not; else null.",
}

DRIVING = {  # of `compare --json` on a closed loop
    "env": "Id of the environment.",
    "rows": "A row per agent, the best drive score first.",
    "failures": "Agents that failed, with the reason.",
}

PAGE = "definitions/json.md"
HEAD = """\
# Keys of --json

`mtp-bench compare --json FILE` and `mtp-bench score --json FILE` write one object; `--json -` prints it. null stands
for undefined. **`error` is bADE**; per scene its key is `bADE`. An interval holds the two ends, at 95 %, of the number
in the line above it. Arrows point to better values, metres are means over targets, and [What is measured](index.md)
defines the numbers.

`mtp-bench worst --json` and `events --json` write lists of moments and of events, at the end of this page.
"""
SECTIONS: dict[str, type[BaseModel]] = {
    "rows[]": Row,
    "paired[]": PairedRow,
    "details[]": Details,
    "details[].bins[]": Bin,
    "details[].own.*, and beside the keys of a bin": Errors,
    "details[].reliability[]": Reliability,
    "details[].tracking": Tracking,
    "details[].tracking.all, and by class": Clear,
    "official[]": OfficialRow,
}
_FLAT = ("errors", "classes")  # fields whose keys stand beside the others


def page() -> str:
    """The page in Markdown."""
    parts = [
        HEAD,
        _table("The file", _plain(CONTENT)),
        _table("condition", _plain(CONDITION)),
    ]
    parts += [_table(title, keys_of(kind)) for title, kind in SECTIONS.items()]
    plain = {
        "Rows of Report.per_scene (other keys as in rows[])": PER_SCENE,
        "The file of worst --json": WORST,
        "moments[] of worst --json": MOMENT,
        "events[] of events --json": EVENT,
        "The file of compare --json on a closed loop": DRIVING,
    }
    parts += [_table(title, _plain(keys)) for title, keys in plain.items()]
    return "\n".join([*parts, _table("rows[] of a closed loop", keys_of(DrivingRow))])


def keys_of(kind: type[BaseModel]) -> dict[str, tuple[str, str, str]]:
    """Unit, direction and meaning of each key of a kind of row. Raises KeyError for one that says no meaning."""
    columns = {column.key: column for column in columns_of(kind)}
    keys, unit = {}, ""
    for name, field in kind.model_fields.items():
        if name in _FLAT:
            continue
        column = columns.get(name, Column(help=field.description or ""))
        if not column.help:
            raise KeyError(f"{kind.__name__}.{name} has no help")
        unit = unit if column.interval else column.unit
        keys[name] = (unit, column.arrow, column.help)
    return keys


def _plain(meanings: dict[str, str]) -> dict[str, tuple[str, str, str]]:
    return {key: ("", "", meaning) for key, meaning in meanings.items()}


def _table(title: str, keys: dict[str, tuple[str, str, str]]) -> str:
    lines = [
        f"| `{key}` | {unit} {arrow} | {meaning} |"
        for key, (unit, arrow, meaning) in keys.items()
    ]
    return "\n".join(
        [f"## {title}\n", "| key | unit | meaning |", "|---|---|---|", *lines, ""]
    )
