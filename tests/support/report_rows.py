"""Rows and details of reports, made by hand."""

from typing import Any

from mtp_bench.scoring import SUBSETS
from mtp_bench.scoring.rows import Bin, Clear, Details, Errors, PairedRow, Reliability, Row, Tracking

Setting = tuple[str, int, int, str]  # agent, hypotheses, samples, budget


def row_content(**values: Any) -> dict[str, Any]:
    """A row as JSON whose other fields are missing."""
    return {**dict.fromkeys(Row.model_fields), **values}


def row(setting: Setting, subset: str, **values: Any) -> Row:
    """A row with an error of .345 m; ``values`` replace fields."""
    content = row_content(
        **_setting(setting), subset=subset, minADE=0.123, minFDE=0.234, error=0.345, energy_score=0.345,
        interval=(0.31, 0.38), error_by_score=0.111, plain_error=0.789, fixed_error=0.456, localisation=0.567,
        missed=0.678, coverage=0.9, targets=40, effective_targets=38.0, objects=25, effective_objects=24.0, scenes=11,
        effective_units=10.5, seeds=3, ms_per_frame=1.5,
    )  # fmt: skip
    return Row.model_validate(content | values)


def rows(*settings: Setting, **values: Any) -> list[Row]:
    return [row(setting, subset, **values) for setting in settings for subset in SUBSETS]


def pair(setting: Setting, other: str, subset: str = "all", **values: Any) -> PairedRow:
    base: dict[str, Any] = {
        **_setting(setting), "other": other, "subset": subset, "error": None, "interval": None, "p": 0.5,
        "minADE": None, "minADE_interval": None, "targets": 40, "shared": 30, "scenes": 11,
    }  # fmt: skip
    return PairedRow.model_validate({**base, **values})


def detail(setting: Setting) -> Details:
    errors = Errors(
        minADE=0.1, minFDE=0.2, error=7.125, plain_error=0.3, coverage=0.9, targets=17, objects=9, scenes=11
    )  # fmt: skip
    clear = Clear(TP=1, FP=2, FN=3, IDS=4, FRAG=5, MOTA=0.89, MOTP=0.3, IDF1=0.61, HOTA=0.52)
    bins = [Bin(by="class", bin="car", errors=errors), Bin(by="motion", bin="moving", errors=errors)]
    content: dict[str, Any] = {
        **_setting(setting), "seeds": 3, "nothing_predicted": 20.0, "miss_rate": 0.333, "PI_ADE": 0.444, "EPA": 0.781,
        "AP_f": 0.222, "brier": 0.155, "reliability": [Reliability(confidence=0.95, matched=0.66, forecasts=9)],
        "forecasts_per_frame": 12.3, "false_per_frame": 4.5, "curve": [(i / 10, 3.75) for i in range(12)],
        "k_curve": {"1": 0.5}, "bins": bins, "own": {"all_h_ids": errors},
        "own_events": {"ids": 34, "lost": 462, "wrong": 3, "reacquired": 99}, "guessed_parents": 0.0,
        "tracking": Tracking(all=clear, classes={}, false_positives=6, false_tracks=7),
        "invalid": {}, "dropped_detections": 0,
    }  # fmt: skip
    return Details.model_validate(content)


def _setting(setting: Setting) -> dict[str, Any]:
    return dict(zip(("agent", "hypotheses", "samples", "budget"), setting, strict=True))
