"""Draw the definitions: scenes of a few boxes, and what the scorer says of them.

    python -m docs.generate.drawings        # docs/definitions/*.svg

Every mark and every number of a drawing comes from `mtp_bench.scoring`; only the scenes are invented. A test draws them
again and compares.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np

from mtp_bench.core import Ints, Rollout, Scene
from mtp_bench.scoring import (
    AgentScores,
    SceneScore,
    find_targets,
    live_frames,
    score_scene,
)
from mtp_bench.scoring.bade import CardBudget, errors_at
from mtp_bench.scoring.forecasts import (
    Candidates,
    RecordedForecasts,
    match_by_confidence,
)
from mtp_bench.scoring.incremental_matching import final_match
from mtp_bench.scoring.lineage import hypotheses, lineage_events, match_hypotheses
from mtp_bench.scoring.parts import PART_NAMES, error_parts, reference_errors
from mtp_bench.scoring.rank import gap_closed
from mtp_bench.scoring.statistics import UnitSums
from mtp_bench.scoring.table import agent_table
from tests.support.scoring_scenes import (
    Thing,
    at,
    make_card,
    make_rollout,
    make_scene,
    random_case,
    with_detections,
)

from .svg import (
    BLACK,
    BLUE,
    GREEN,
    GREY,
    LIGHT,
    ORANGE,
    PURPLE,
    VERMILLION,
    Point,
    box,
    circle,
    drawing,
    line,
    text,
)

FOLDER = Path(__file__).resolve().parents[1] / "definitions"
CARD = (
    make_card()
)  # P = 2 past frames, T = 3 future ones, k = 4; cars: gate 2 m, miss error c = 10 m
C = CARD.task.miss_error["car"]
STEP, LEFT = 58.0, 130.0  # px of a frame; where the first one is


def targets() -> str:
    """Which frames of two objects are targets, and which frames are live."""
    there = {"a": range(10), "b": [*range(4), *range(5, 10)]}
    scene = make_scene(
        [
            [at(i, (9 * i, 2 * t)) for i, name in enumerate(there) if t in there[name]]
            for t in range(10)
        ]
    )
    found, live = find_targets(scene, CARD), live_frames(scene, CARD)
    wanted = set(zip(found.object_id.tolist(), found.frame.tolist(), strict=True))
    first, last = np.flatnonzero(live)[[0, -1]].tolist()
    lines = [
        box(
            (_column((first + last) / 2), 92),
            ((last - first + 1) * STEP - 6, 120),
            LIGHT,
        )
    ]
    lines.append(
        text(
            (_column((first + last) / 2), 24),
            "live frames: false forecasts count",
            GREY,
            "middle",
        )
    )
    for i, name in enumerate(there):
        y = 72.0 + 52 * i
        lines.append(text((16, y + 5), f"object {name}"))
        lines += [
            line([(_column(t), y), (_column(t + 1), y)], GREEN)
            for t in there[name]
            if t + 1 in there[name]
        ]
        lines += [
            circle((_column(t), y), 9, GREEN if (i, t) in wanted else "white", GREEN)
            for t in there[name]
        ]
    lines += [text((_column(t), 172), str(t), GREY, "middle") for t in range(10)]
    lines.append(text((16, 172), "frame", GREY))
    lines += [
        circle((26, 200), 9, GREEN, GREEN),
        text((44, 205), f"a target: {CARD.task.past} known frames, this one"),
    ]
    lines.append(text((44, 224), f"among them, and {CARD.task.future} after it"))
    lines += [
        circle((366, 200), 9, "white", GREEN),
        text((384, 205), "true, but no target"),
    ]
    return drawing(_column(10), 240, lines)


def events() -> str:
    """An identity switch, a loss and a re-acquisition."""
    ids = [1, 1, 1, 2, 2, None, None, 2, 2]  # the track on the object in each frame
    scene = make_scene([[at(0, (2 * t, 0))] for t in range(len(ids))])
    said = make_rollout(
        [[at(i, (2 * t, 0.3))] if i is not None else [] for t, i in enumerate(ids)]
    )
    stated = hypotheses(said, CARD)
    found = lineage_events(
        scene.truth,
        said,
        stated,
        match_hypotheses(scene.truth, said, stated.member, CARD),
        scene.annotated_frames,
    )
    lines = [text((16, 77), "true object"), text((16, 125), "tracks")]
    lines.append(line([(_column(0), 72), (_column(len(ids) - 1), 72)], GREEN))
    for t, i in enumerate(ids):
        kinds = [
            kind for kind in ("ids", "lost", "reacquired") if getattr(found, kind)[t, 0]
        ]
        lines.append(circle((_column(t), 72), 9, GREEN))
        lines += [
            text((_column(t), 40), kind, BLACK, "middle", bold=True) for kind in kinds
        ]
        lines += [line([(_column(t), 46), (_column(t), 60)], BLACK) for _ in kinds]
        if i is not None:
            color = BLUE if i == 1 else VERMILLION
            lines.append(box((_column(t), 120), (40, 24), "white", color))
            lines.append(text((_column(t), 125), str(i), color, "middle"))
        lines.append(text((_column(t), 168), str(t), GREY, "middle"))
    lines.append(text((16, 168), "frame", GREY))
    return drawing(_column(10), 184, lines)


def matching() -> str:
    """The matching at two cuts of the confidence: as many as possible, then the surest, then the nearest."""
    true = [(4.0, 0.0), (16.0, 0.0), (19.0, 0.0), (31.0, 0.0)]
    said = [
        ((5.4, 0.0), 0.9),
        ((4.2, -0.3), 0.1),
        ((17.2, 0.3), 0.8),
        ((15.6, -0.8), 0.3),
        ((37.0, 0.0), 0.2),
    ]
    gate = CARD.task.forecast_gate["car"]
    lines = []
    for panel, least in enumerate((0.5, 0.0)):
        kept = [(place, sure) for place, sure in said if sure >= least]
        scene, rollout = _now(
            true,
            [_forecast(i, place, place, sure) for i, (place, sure) in enumerate(kept)],
        )
        matched = _matched(scene, rollout)
        top = 30 + 150 * panel

        def px(place: Point, top: float = top) -> Point:
            return 17 * place[0] + 20, top + 62 - 17 * place[1]

        covered, false = (
            int((matched >= 0).sum()),
            len(kept) - int((matched >= 0).sum()),
        )
        which = f"confidence {least:g} or more" if least else "every forecast"
        lines.append(
            text(
                (16, top),
                f"{which}: {covered} of {len(true)} targets covered, {false} false",
                bold=True,
            )
        )
        for place, forecast in zip(true, matched.tolist(), strict=True):
            lines += [
                circle(px(place), 17 * gate, stroke=GREY, dashed=True),
                circle(px(place), 7, GREEN),
            ]
            if forecast >= 0:
                lines.append(line([px(place), px(kept[forecast][0])], PURPLE, 3))
        for i, (place, sure) in enumerate(kept):
            color = PURPLE if i in matched else VERMILLION
            x, y = px(place)
            lines += [
                circle((x, y), 5, color),
                text((x + 6, y + (20 if place[1] < 0 else -7)), f"{sure:g}", color),
            ]
    x = 400.0
    for i, (color, words) in enumerate(
        ((GREEN, "true object, its gate"), (PURPLE, "matched"), (VERMILLION, "false"))
    ):
        lines += [circle((x, 322), 5, color), text((x + 10, 327), words)]
        x += (165.0, 90.0, 0.0)[i]
    return drawing(700, 340, lines)


def miss_error() -> str:
    """The cost of targets: the best sample, at most c; c without a forecast."""
    true = [(5.0, 17.0), (5.0, 10.0), (5.0, 4.0)]
    samples = [
        [[(3 * t, slope * t) for t in (1, 2, 3)] for slope in (-1.2, -0.5, 0.3, 1.0)],
        [[(-6 * t, slope * t) for t in (1, 2, 3)] for slope in (-0.7, -0.4, 0.1, 0.5)],
        None,
    ]
    things = [
        _forecast(
            i,
            place,
            [[(place[0] + x, place[1] + y) for x, y in path] for path in paths],
            1.0,
        )
        for i, (place, paths) in enumerate(zip(true, samples, strict=True))
        if paths is not None
    ]
    score = _one_frame(true, things, speed=3.0)

    def px(place: Point) -> Point:
        return 16 * (place[0] + 15), 340 - 16 * place[1]

    lines = []
    for i, place in enumerate(true):
        future = [place, *((place[0] + 3 * t, place[1]) for t in (1, 2, 3))]
        paths = [
            [place, *((place[0] + x, place[1] + y) for x, y in path)]
            for path in samples[i] or ()
        ]
        away = [
            np.hypot(*(np.array(path) - np.array(future))[1:].T).mean()
            for path in paths
        ]
        for path, error in zip(paths, away, strict=True):
            best = bool(np.isclose(error, min(away)))
            lines.append(
                line([px(point) for point in path], PURPLE, 4 if best else 1.5)
            )
        lines += [
            box(px(place), (64, 30), GREEN),
            line([px(point) for point in future], GREEN, 3),
        ]
        lines += [circle(px(point), 4, GREEN) for point in future[1:]]
        best_of = (
            f"minADE {score.min_ade[i]:.1f} m" if score.covered[i] else "no forecast"
        )
        lines.append(
            text(
                (490, px(place)[1] - 4),
                f"costs {score.capped[i]:.1f} m",
                BLACK,
                bold=True,
            )
        )
        lines.append(text((490, px(place)[1] + 15), f"{best_of}, c = {C:g} m", GREY))
    return drawing(680, 310, lines)


def budgets() -> str:
    """The error against the number of false forecasts, and the ten budgets whose mean ranks."""
    scene, said = random_case(3, frames=14, objects=6)
    score = score_scene(scene, said, CARD)
    allowed = CardBudget("MTP-Test-v0", 8, len(score)).budgets(len(score))
    grid = np.linspace(0, 10, 101)
    curve, at_budgets = (
        errors_at([score.cuts], values).error.mean(axis=1)
        for values in (grid, allowed.all)
    )
    top = float(np.ceil(score.miss_error.mean())) + 1

    def px(false: float, error: float) -> Point:
        return 70 + 52 * false, 30 + 200 * (1 - error / top)

    mean = float(at_budgets.mean())
    lines = [line([px(0, top), px(0, 0), px(10, 0)], GREY, 1.5)]
    lines += [text((px(n, 0)[0], 250), str(n), GREY, "middle") for n in range(0, 11, 2)]
    lines += [
        text((60, px(0, e)[1] + 5), f"{e:g}", GREY, "end")
        for e in np.linspace(0, top, 5)[::2]
    ]
    lines.append(text((330, 272), "false forecasts that are allowed", BLACK, "middle"))
    lines.append(text((16, 20), "error, m"))
    lines.append(
        line(
            [px(x, y) for x, y in zip(grid.tolist(), curve.tolist(), strict=True)],
            BLUE,
            2.5,
        )
    )
    lines += [
        circle(px(x, y), 5, VERMILLION)
        for x, y in zip(allowed.all.tolist(), at_budgets.tolist(), strict=True)
    ]
    lines.append(
        line(
            [px(allowed.all[0], mean), px(allowed.all[-1], mean)],
            VERMILLION,
            1.5,
            dashed=True,
        )
    )
    lines.append(
        text(
            (px(allowed.all[-1], mean)[0] + 10, px(0, mean)[1] + 5),
            f"bADE: {mean:.1f} m",
            VERMILLION,
        )
    )
    empty = float(score.miss_error.mean())
    lines.append(line([px(0, empty), px(10, empty)], GREY, 1.5, dashed=True))
    lines.append(
        text(
            (px(10, empty)[0], px(0, empty)[1] - 6),
            f"nothing predicted: {empty:.1f} m",
            GREY,
            "end",
        )
    )
    return drawing(680, 284, lines)


def gap() -> str:
    """The share of the gap from one hypothesis to perfect association that an agent closes."""
    away = np.linspace(-0.1, 0.1, 8)  # eight units, one target each
    best, single = "perfect association", "same samples"
    errors = {best: 0.6 + away, "agent": 1.1 + 0.5 * away, single: 1.6 + away}
    found = gap_closed(
        *(
            UnitSums(10, np.ones(8), errors[name], 8.0)
            for name in ("agent", single, best)
        )
    )
    assert found.closed is not None

    def px(error: float) -> float:
        return 60 + 300 * error

    lines = [line([(px(0), 90), (px(2), 90)], GREY, 1.5)]
    for (name, values), color in zip(
        errors.items(), (GREEN, PURPLE, BLUE), strict=True
    ):
        error = float(values.mean())
        lines += [
            circle((px(error), 90), 8, color),
            text((px(error), 66), name, color, "middle", bold=True),
        ]
        lines.append(text((px(error), 120), f"{error:.1f} m", BLACK, "middle"))
    high, own = (float(errors[name].mean()) for name in (single, "agent"))
    lines += [line([(px(own), 140), (px(high), 140)], ORANGE, 5)]
    lines.append(
        text(
            (px((own + high) / 2), 164),
            f"{100 * found.closed:.0f} % of the association gap closed",
            BLACK,
            "middle",
        )
    )
    lines.append(text((px(0), 30), "bADE, m: less is better", GREY))
    return drawing(680, 180, lines)


def parts() -> str:
    """The cost of targets and its parts: one target with a forecast, and one for each cause of having none."""
    causes = (
        "below_threshold",
        "no_forecast",
        "other_class",
        "off_place",
        "undetected_new",
        "undetected_seen",
    )
    true = [(30.0 * i, 0.0) for i in range(1 + len(causes))]
    seen: list[list[Thing]] = [[], []]
    for i, (x, y) in enumerate(true):
        cause = causes[i - 1] if i else ""
        if cause != "undetected_new":
            seen[0].append(at(i, (x, y)))
        if cause not in ("undetected_new", "undetected_seen"):
            off = (0.0, 1.5 * CARD.task.forecast_gate["car"])[cause == "off_place"]
            seen[1].append(at(i, (x, y + off), class_id=int(cause == "other_class")))

    def ahead(i: int, off: float, confidence: float = 0.9, now: float = 0.0) -> Thing:
        return _forecast(
            i,
            (true[i][0] + now, 0.0),
            [[(true[i][0] + off, 0.0)] * CARD.task.future] * 4,
            confidence,
        )

    false = [_forecast(50 + i, (15.0 + 30 * i, 9.0), (0.0, 0.0), 0.5) for i in range(9)]
    said = {
        "agent": [ahead(0, 7.6), ahead(1, 0.5, 0.1), *false],
        "perfect association": [ahead(0, 5.4, now=1.9)],
        "ground-truth tracks": [ahead(0, 2.0)],
    }
    runs = {}
    for name, things in said.items():
        scene, rollout = _now(true, things)
        detected = with_detections(
            scene, [*seen, *[[] for _ in range(scene.frames - len(seen))]]
        )
        runs[name] = AgentScores(
            name, 1, 4, "equal", ((score_scene(detected, rollout, CARD),),)
        )
    references = reference_errors(
        runs["perfect association"], runs["ground-truth tracks"], 4
    )
    found = error_parts(
        replace(agent_table(runs["agent"], None), split=references), "all"
    )
    colors = dict(zip(found, (GREEN, ORANGE, BLUE, PURPLE, GREY), strict=False))
    lines, scale = [], 46.0
    for i in range(len(true)):
        y, x = 24.0 + 34 * i, 160.0
        lines.append(
            text((16, y + 5), "with a forecast" if i == 0 else "without a forecast")
        )
        for name, part in found.items():
            if part[i]:
                color, width = colors.get(name, LIGHT), scale * float(part[i])
                lines.append(box((x + width / 2, y), (width, 22), color))
                lines.append(
                    text(
                        (x + 4, y + 5),
                        PART_NAMES[name],
                        "white" if color != LIGHT else BLACK,
                    )
                )
                x += width
        lines.append(
            text(
                (x + 8, y + 5),
                f"{sum(float(part[i]) for part in found.values()):.1f} m",
                BLACK,
                bold=True,
            )
        )
    return drawing(700, 34 * len(true) + 16, lines)


DRAWINGS: dict[str, Callable[[], str]] = {
    drawn.__name__: drawn
    for drawn in (targets, events, matching, miss_error, budgets, parts, gap)
}


def _column(t: float) -> float:
    return LEFT + STEP * t


def _forecast(i: int, place: Point, paths: object, confidence: float) -> Thing:
    """A forecast object; ``paths`` [K, T, 2] absolute, or a place where it stays."""
    futures = np.broadcast_to(np.asarray(paths, dtype=float), (4, CARD.task.future, 2))
    return at(i, place, forecast=futures, confidence=confidence)


def _now(
    true: list[Point], said: list[Thing], speed: float = 0.0
) -> tuple[Scene, Rollout]:
    """A scene with a single live frame, and what is said in it; its objects move along x, m per frame."""
    now = CARD.task.past - 1
    frames = [
        [at(i, (x + speed * (t - now), y)) for i, (x, y) in enumerate(true)]
        for t in range(now + 4)
    ]
    answers = [said if t == now else [] for t in range(len(frames))]
    return make_scene(frames), make_rollout([[] for _ in frames], answers, samples=4)


def _one_frame(true: list[Point], said: list[Thing], speed: float = 0.0) -> SceneScore:
    """The score of such a scene."""
    return score_scene(*_now(true, said, speed), CARD)


def _matched(scene: Scene, rollout: Rollout) -> Ints:
    """The forecast of each target in the only live frame, -1 for none."""
    found, forecasts = find_targets(scene, CARD), RecordedForecasts.of(rollout)
    near = Candidates.of(scene, found, forecasts, live_frames(scene, CARD), CARD)
    matched = final_match(
        match_by_confidence(near, forecasts.confidence).additions, len(scene.truth.box)
    )
    return matched[found.row]


def main() -> None:
    """Write all drawings."""
    for name, draw in DRAWINGS.items():
        (FOLDER / f"{name}.svg").write_text(draw())


if __name__ == "__main__":
    main()
