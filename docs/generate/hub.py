"""Write the leaderboard as a dataset and as a static Space: two folders that a hub of datasets takes as they are.

    python -m docs.generate.hub FOLDER [OWNER]        # FOLDER/dataset and FOLDER/space

All of it is read from the records and from the tables of ``leaderboard/index.parts``, so `make pages` comes first.
Equal records give equal bytes. OWNER is the account on the hub that links lead to.
"""

from __future__ import annotations

import csv
import hashlib
import json
import re
import sys
import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from mtp_bench import __version__, card_ids, load_card
from mtp_bench.core import Column, Table, to_csv
from mtp_bench.core.errors import MtpBenchError
from mtp_bench.core.files import make_folder, write_text
from mtp_bench.judge import Record, load_record, record_paths
from mtp_bench.scoring import DEFINITIONS
from mtp_bench.scoring.report_tables import SUBSET_NAMES
from mtp_bench.scoring.statistics import ratio
from mtp_bench.sources import package_of
from mtp_bench.viz.pages import source_of

ROOT = Path(__file__).resolve().parents[2]
LEADERBOARD, TEMPLATES = ROOT / "leaderboard", Path(__file__).with_suffix("")
NAME = "mtp-bench-leaderboard"
POLICY = (  # of the page: its own style and script, and the file beside it
    "default-src 'none'; style-src {}; script-src {}; connect-src 'self'; img-src data:; base-uri 'none'; "
    "form-action 'none'"
)
DTYPES = {
    "Boolean": "bool",
    "Integer": "int64",
    "Float": "float64",
    "Text": "string",
}  # of Croissant: of `datasets`
MEANINGS = {  # of columns whose declarations have no sentence, or one about the page
    "env": "Id of the environment.",
    "definitions": "Version of the definitions that the numbers follow; those of two versions do not compare.",
    "place": "Position by bADE in the environment. Blank: shown, not ranked.",
    "rank_range": "end of the range of ranks that the tests leave open.",
    "submission": "Name of the submission.",
    "not_ranked_because": "Reason of a missing place.",
    "trained_on_scored": "Part of the submission that was trained on the scored scenes, as declared.",
    "added": "True for a record that is not part of the leaderboard.",
    "difference": "bADE minus that of the single-hypothesis pipeline (stp) on the same targets.",
    "weights": "Ships: the baseline runs as it is. Train: its network is trained first. Blank: another submission.",
    "p": "p of the sign-flip test of the difference, over units of at most 20 s.",
    "gap_blank_because": "Reason of a missing `gap`.",
    "association_gap_blank_because": "Reason of a missing `association_gap`.",
    "status": "finished, partial, crashed or rejected.",
    "digest": "Digest (sha256) of the record without its times, memory, machine and date.",
    "level": "Verification: scored, re-scored, re-run or hidden; numbers of the last are those of hidden scenes.",
    "checked": "Date and signer of the level, and the seal of the hidden scenes.",
    "made": "Day on which the record was made (UTC).",
}


@dataclass(frozen=True)
class Field:
    """A column of a CSV file: its heading with the unit, its type as Croissant names it, and its meaning."""

    heading: str
    kind: str
    meaning: str


def fields_of(
    text: str, columns: Sequence[Mapping[str, str]], rows: Sequence[Mapping[str, Any]]
) -> list[Field]:
    """The columns of the CSV ``text`` of ``rows``, in its order. Raises KeyError for one without a meaning."""
    known = {
        column["key"]: MEANINGS.get(column["key"]) or column["help"]
        for column in columns
    }
    fields, before = [], ""
    for heading in next(csv.reader(text.splitlines())):
        name = heading.partition(" [")[0]
        key, _, end = (
            (name, "", "") if name in known else name.rpartition("_")
        )  # intervals have two columns
        values, meaning = [row.get(key) for row in rows], known[key]
        if end:
            values = [value and value[end == "high"] for value in values]
            meaning = MEANINGS.get(key, f"end of the 95 % interval of `{before}`.")
            meaning = f"{'Upper' if end == 'high' else 'Lower'} {meaning}"
        if not meaning:
            raise KeyError(
                f"column {heading!r} has no meaning; add one to MEANINGS of docs/generate/hub.py"
            )
        fields.append(Field(heading, _kind(values, heading), meaning))
        before = before if end else name
    return fields


def _kind(values: Sequence[Any], heading: str) -> str:
    kinds = {type(value) for value in values if value is not None}
    if kinds == {bool}:
        return "Boolean"
    if (
        kinds == {int} and None not in values
    ):  # readers have no blank among whole numbers
        return "Integer"
    return "Float" if (kinds or " [" in heading) and kinds <= {int, float} else "Text"


def scenes_table(records: Sequence[Record]) -> Table:
    """A row per record and public scene: the weight of its targets and their bADE on each subset."""
    subsets = [
        subset
        for subset in SUBSET_NAMES
        if any(subset in record.targets.subsets for record in records)
    ]
    columns = [
        Column(key=key) for key in ("env", "definitions", "submission", "digest")
    ]
    columns += [
        Column(key="scene", help="Name of the scene."),
        Column(key="units", help="Parts of at most 20 s."),
    ]
    for subset in subsets:
        weight = "number of targets" if subset == "all" else "weight of the targets"
        columns.append(
            Column(key=f"weight_{subset}", help=f"{SUBSET_NAMES[subset]}: {weight}.")
        )
        columns.append(
            Column(
                key=f"bADE_{subset}",
                unit="m",
                help=f"{SUBSET_NAMES[subset]}: bADE, mean over seeds.",
            )
        )
    if any(record.drives for record in records):
        columns.append(
            Column(
                key="drive_score",
                help="Drive score of a closed loop, mean over seeds, 0 to 1.",
            )
        )
    rows = [row for record in records for row in _scene_rows(record)]
    return Table("scenes", "Scenes", "", rows, columns)


def _scene_rows(record: Record) -> list[dict[str, Any]]:
    """The rows of the scenes of one record."""
    about = {
        "env": record.env.id,
        "definitions": record.scorer.definitions,
        "submission": record.submission.name,
        "digest": record.digest,
    }
    rows: list[dict[str, Any]] = [
        {**about, "scene": scene, "units": units}
        for scene, units in zip(record.scenes, record.targets.scene_units, strict=True)
    ]
    for subset in record.subsets:
        weights = record.targets.scene_sums(record.unit_weight(subset)).tolist()
        errors = record.targets.scene_sums(record.unit_error(subset)).tolist()
        for row, weight, error in zip(rows, weights, errors, strict=True):
            row[f"weight_{subset}"] = _short(weight)
            if record.drives is None:
                row[f"bADE_{subset}"] = _short(ratio(error, weight))
    if record.drives is not None:
        for row, score in zip(rows, record.drives.scene_scores, strict=True):
            row["drive_score"] = _short(score)
    return rows


def _short(value: float | None) -> float | None:
    return None if value is None else float(f"{value:.6g}")


def records_of(digests: Sequence[str], folder: Path) -> list[Record]:
    """The records of a board in its order. Raises MtpBenchError unless it has all of ``folder`` and no other."""
    records = {
        record.digest: record for record in map(load_record, record_paths(folder))
    }
    if other := {*digests} ^ {*records}:
        raise MtpBenchError(
            f"{len(other)} records are not both in {folder} and on its board; run `make pages`"
        )
    return [records[digest] for digest in digests]


def croissant(
    texts: Mapping[str, str],
    fields: Mapping[str, Sequence[Field]],
    facts: Mapping[str, str],
) -> str:
    """The metadata of CSV files, by their names without suffix, in the format Croissant 1.0."""
    terms = (
        "citeAs column equivalentProperty extract field fileProperty fileObject fileSet format includes isLiveDataset "
        "jsonPath key md5 parentField path recordSet references regex repeated replace samplingRate separator source "
        "subField transform"
    )
    context: dict[str, Any] = {
        "@language": "en",
        "@vocab": "https://schema.org/",
        "sc": "https://schema.org/",
        "cr": "http://mlcommons.org/croissant/",
        "rai": "http://mlcommons.org/croissant/RAI/",
        "dct": "http://purl.org/dc/terms/",
        "conformsTo": "dct:conformsTo",
        **{term: f"cr:{term}" for term in terms.split()},
        **{
            term: {"@id": f"cr:{term}", "@type": "@json"}
            for term in ("data", "examples")
        },
        "dataType": {"@id": "cr:dataType", "@type": "@vocab"},
    }
    about = {
        "@type": "sc:Dataset",
        "conformsTo": "http://mlcommons.org/croissant/1.0",
        "name": NAME,
        "url": facts["url"],
        "description": f"Results of tracking and trajectory prediction together: mtp_bench, definitions {DEFINITIONS}.",
        "license": f"https://spdx.org/licenses/{facts['licence']}.html",
        "version": __version__,
        "creator": {"@type": "sc:Organization", "name": "The mtp_bench contributors"},
        "isLiveDataset": False,
        "datePublished": facts["newest"],
        "citeAs": f"The mtp_bench contributors: mtp_bench {__version__}",
    }
    files, sets = [], []
    for name, text in texts.items():
        file, content = f"{name}.csv", text.encode()
        files.append(
            {
                "@type": "cr:FileObject",
                "@id": file,
                "name": file,
                "contentUrl": file,
                "encodingFormat": "text/csv",
                "contentSize": f"{len(content)} B",
                "sha256": hashlib.sha256(content).hexdigest(),
            }
        )
        listed = [
            {
                "@type": "cr:Field",
                "@id": f"{name}/{key}",
                "name": key,
                "description": each.meaning,
                "dataType": f"sc:{each.kind}",
                "source": {
                    "fileObject": {"@id": file},
                    "extract": {"column": each.heading},
                },
            }
            for each in fields[name]
            for key in [each.heading.partition(" [")[0]]
        ]
        sets.append(
            {"@type": "cr:RecordSet", "@id": name, "name": name, "field": listed}
        )
    content_of = {
        "@context": context,
        **about,
        "distribution": files,
        "recordSet": sets,
    }
    return json.dumps(content_of, indent=1, ensure_ascii=False) + "\n"


def environment_tables(ids: Sequence[str]) -> tuple[str, str]:
    """Rows in Markdown of environments, and of their data with licences and citations."""
    lines, data = [], {}
    for env_id in ids:
        if env_id not in card_ids():
            lines.append(f"| `{env_id}` | not in this version of the package | |")
            continue
        card = load_card(env_id)
        about = package_of(card).dataset
        data[about.name] = f"| {about.name} | {about.licence} | {about.citation} |"
        mixed = (
            " where a scene has no stored ones"
            if card.source.traits.mixed_detections
            else ""
        )
        kind = "stored" if card.detector is None else f"simulated{mixed}"
        lines.append(f"| `{env_id}` | {card.summary} | {kind}: {card.detector_name} |")
    return "\n".join(lines), "\n".join(data.values())


def hub_files(leaderboard: Path = LEADERBOARD, owner: str = "OWNER") -> dict[str, str]:
    """The content of each file by its path in the folder."""
    table = leaderboard / "index.parts" / "leaderboard"
    board = json.loads(table.with_suffix(".json").read_text(encoding="utf-8"))
    records = records_of(
        [row["digest"] for row in board["rows"]], leaderboard / "records"
    )
    scenes = scenes_table(records)
    texts = {
        "leaderboard": table.with_suffix(".csv").read_text(encoding="utf-8"),
        "scenes": to_csv(scenes),
    }
    columns = {
        "leaderboard": board["columns"],
        "scenes": [vars(column) for column in scenes.columns],
    }
    rows = {"leaderboard": board["rows"], "scenes": scenes.rows}
    fields = {
        name: fields_of(text, columns[name], rows[name]) for name, text in texts.items()
    }
    licence = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))[
        "project"
    ]["license"]
    envs = [*dict.fromkeys(record.env.id for record in records)]
    facts = {
        "owner": owner,
        "name": NAME,
        "url": f"https://huggingface.co/datasets/{owner}/{NAME}",
        "env": envs[0],
        "licence": licence,
        "tag": licence.lower(),
        "version": __version__,
        "definitions": DEFINITIONS,
        "newest": max(record.measured.made for record in records),
        "records": str(len(records)),
        "submissions": str(len({record.submission.name for record in records})),
        "environments": str(len(envs)),
        "scenes": str(len(scenes.rows)),
    }
    facts["env_table"], facts["data_table"] = environment_tables(envs)
    for name, listed in fields.items():
        facts[f"{name}_table"] = "\n".join(
            f"| `{each.heading}` | {each.meaning} |" for each in listed
        )
        types = [
            f"  - {{name: {json.dumps(each.heading)}, dtype: {DTYPES[each.kind]}}}"
            for each in listed
        ]
        facts[f"{name}_features"] = "\n".join(types)
    page = (TEMPLATES / "space.html").read_text(encoding="utf-8")
    inline = (
        re.findall(f"<{tag}>(.*?)</{tag}>", page, re.DOTALL)[0]
        for tag in ("style", "script")
    )
    facts["policy"] = POLICY.format(*map(source_of, inline))
    return {
        "dataset/README.md": filled("dataset.md", facts),
        **{f"dataset/{name}.csv": text for name, text in texts.items()},
        "dataset/croissant.json": croissant(texts, fields, facts),
        "space/README.md": filled("space.md", facts),
        "space/index.html": filled("space.html", facts),
        "space/leaderboard.csv": texts["leaderboard"],
    }


def filled(name: str, facts: Mapping[str, str]) -> str:
    """A template with each ``{{ key }}`` replaced by its fact; KeyError for an unknown one."""
    text = (TEMPLATES / name).read_text(encoding="utf-8")
    return re.sub(r"\{\{ (\w+) \}\}", lambda match: facts[match[1]], text)


def main(folder: str, owner: str = "OWNER") -> None:
    """Write the files below ``folder``; others that lie there stay."""
    for name, text in hub_files(owner=owner).items():
        make_folder((Path(folder) / name).parent)
        write_text(Path(folder) / name, text)


if __name__ == "__main__":
    main(*sys.argv[1:])
