"""Draw the definitions: scenes of a few boxes, and what the scorer says of them.

    python -m docs.generate.drawings        # docs/definitions/*.svg

Every mark and every number of a drawing comes from `mtp_bench.scoring`; only the scenes are invented. A test draws them
again and compares.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np

from mtp_bench.scoring import SceneScore, find_targets, live_frames, score_scene
from mtp_bench.scoring.bade import budgets_of, errors_at
from mtp_bench.scoring.lineage import hypotheses, lineage_events, match_hypotheses
from mtp_bench.scoring.statistics import gap_closed
from tests.support.scoring_scenes import Thing, at, make_card, make_rollout, make_scene, random_case

from .svg import BLACK, BLUE, GREEN, GREY, LIGHT, ORANGE, PURPLE, VERMILLION, Point, box, circle, drawing, line, text

FOLDER = Path(__file__).resolve().parents[1] / "definitions"
CARD = make_card()  # P = 2 past frames, T = 3 future ones, k = 4; cars: gate 2 m, miss error c = 10 m
C = CARD.task.miss_error["car"]
STEP, LEFT = 58.0, 130.0  # px of a frame; where the first one is


def targets() -> str:
    """Which frames of two objects are targets, and which frames are live."""
    there = {"a": range(10), "b": [*range(4), *range(5, 10)]}
    scene = make_scene([[at(i, (9 * i, 2 * t)) for i, name in enumerate(there) if t in there[name]] for t in range(10)])
    found, live = find_targets(scene, CARD), live_frames(scene, CARD)
    wanted = set(zip(found.object_id.tolist(), found.frame.tolist(), strict=True))
    first, last = np.flatnonzero(live)[[0, -1]].tolist()
    lines = [box((_column((first + last) / 2), 92), ((last - first + 1) * STEP - 6, 120), LIGHT)]
    lines.append(text((_column((first + last) / 2), 24), "live frames: false forecasts count", GREY, "middle"))
    for i, name in enumerate(there):
        y = 72.0 + 52 * i
        lines.append(text((16, y + 5), f"object {name}"))
        lines += [line([(_column(t), y), (_column(t + 1), y)], GREEN) for t in there[name] if t + 1 in there[name]]
        lines += [circle((_column(t), y), 9, GREEN if (i, t) in wanted else "white", GREEN) for t in there[name]]
    lines += [text((_column(t), 172), str(t), GREY, "middle") for t in range(10)]
    lines.append(text((16, 172), "frame", GREY))
    lines += [circle((26, 200), 9, GREEN, GREEN), text((44, 205), f"a target: {CARD.task.past} known frames, this one")]
    lines.append(text((44, 224), f"among them, and {CARD.task.future} after it"))
    lines += [circle((366, 200), 9, "white", GREEN), text((384, 205), "true, but no target")]
    return drawing(_column(10), 240, lines)


def events() -> str:
    """An identity switch, a loss and a re-acquisition."""
    ids = [1, 1, 1, 2, 2, None, None, 2, 2]  # the track on the object in each frame
    scene = make_scene([[at(0, (2 * t, 0))] for t in range(len(ids))])
    said = make_rollout([[at(i, (2 * t, 0.3))] if i is not None else [] for t, i in enumerate(ids)])
    stated = hypotheses(said, CARD)
    found = lineage_events(scene.truth, said, stated, match_hypotheses(scene.truth, said, stated.member, CARD))
    lines = [text((16, 77), "true object"), text((16, 125), "tracks")]
    lines.append(line([(_column(0), 72), (_column(len(ids) - 1), 72)], GREEN))
    for t, i in enumerate(ids):
        kinds = [kind for kind in ("ids", "lost", "reacquired") if getattr(found, kind)[t, 0]]
        lines.append(circle((_column(t), 72), 9, GREEN))
        lines += [text((_column(t), 40), kind, BLACK, "middle", bold=True) for kind in kinds]
        lines += [line([(_column(t), 46), (_column(t), 60)], BLACK) for _ in kinds]
        if i is not None:
            color = BLUE if i == 1 else VERMILLION
            lines.append(box((_column(t), 120), (40, 24), "white", color))
            lines.append(text((_column(t), 125), str(i), color, "middle"))
        lines.append(text((_column(t), 168), str(t), GREY, "middle"))
    lines.append(text((16, 168), "frame", GREY))
    return drawing(_column(10), 184, lines)


def coverage() -> str:
    """Which targets a forecast covers, and which forecasts are false, by the place that they state now."""
    true = [(4.0, 4.0), (16.0, 4.0), (28.0, 4.0)]
    said = [(5.2, 4.8), (18.4, 4.9), (36.0, 4.0)]
    score = _one_frame(true, [_forecast(i, place, place, 0.9 - 0.1 * i) for i, place in enumerate(said)])

    def px(place: Point) -> Point:
        return 16 * place[0] + 20, 150 - 16 * place[1]

    gate = 16 * CARD.task.forecast_gate["car"]
    lines = []
    for place, covered in zip(true, score.covered, strict=True):
        lines += [box(px(place), (64, 32), GREEN), circle(px(place), gate, stroke=GREY, dashed=True)]
        lines.append(text((px(place)[0], 150), "covered" if covered else "uncovered", BLACK, "middle", bold=True))
    for place, false in zip(said, score.cuts.false, strict=True):
        color = VERMILLION if false else PURPLE
        lines += [circle(px(place), 4, color), box(px(place), (64, 32), "none", color)]
        lines.append(text((px(place)[0], 36), "false" if false else "right", color, "middle"))
    lines.append(text((20, 182), f"A forecast belongs to a true object if it begins within {gate / 16:g} m of it."))
    return drawing(680, 196, lines)


def miss_error() -> str:
    """The cost of targets: the best sample, at most c; c without a forecast."""
    true = [(5.0, 17.0), (5.0, 10.0), (5.0, 4.0)]
    samples = [
        [[(3 * t, slope * t) for t in (1, 2, 3)] for slope in (-1.2, -0.5, 0.3, 1.0)],
        [[(-6 * t, slope * t) for t in (1, 2, 3)] for slope in (-0.7, -0.4, 0.1, 0.5)],
        None,
    ]
    things = [
        _forecast(i, place, [[(place[0] + x, place[1] + y) for x, y in path] for path in paths], 1.0)
        for i, (place, paths) in enumerate(zip(true, samples, strict=True)) if paths is not None
    ]  # fmt: skip
    score = _one_frame(true, things, speed=3.0)

    def px(place: Point) -> Point:
        return 16 * (place[0] + 15), 340 - 16 * place[1]

    lines = []
    for i, place in enumerate(true):
        future = [place, *((place[0] + 3 * t, place[1]) for t in (1, 2, 3))]
        paths = [[place, *((place[0] + x, place[1] + y) for x, y in path)] for path in samples[i] or ()]
        away = [np.hypot(*(np.array(path) - np.array(future))[1:].T).mean() for path in paths]
        for path, error in zip(paths, away, strict=True):
            best = bool(np.isclose(error, min(away)))
            lines.append(line([px(point) for point in path], PURPLE, 4 if best else 1.5))
        lines += [box(px(place), (64, 30), GREEN), line([px(point) for point in future], GREEN, 3)]
        lines += [circle(px(point), 4, GREEN) for point in future[1:]]
        best_of = f"minADE {score.min_ade[i]:.1f} m" if score.covered[i] else "no forecast"
        lines.append(text((490, px(place)[1] - 4), f"costs {score.capped[i]:.1f} m", BLACK, bold=True))
        lines.append(text((490, px(place)[1] + 15), f"{best_of}, c = {C:g} m", GREY))
    return drawing(680, 310, lines)


def budgets() -> str:
    """The error against the number of false forecasts, and the ten budgets whose mean ranks."""
    scene, said = random_case(3, frames=14, objects=6)
    score = score_scene(scene, said, CARD)
    allowed = budgets_of(len(score), 8.0)
    grid = np.linspace(0, 10, 101)
    curve, at_budgets = (errors_at([score.cuts], values).error.mean(axis=1) for values in (grid, allowed.all))
    top = float(np.ceil(score.miss_error.mean())) + 1

    def px(false: float, error: float) -> Point:
        return 70 + 52 * false, 30 + 200 * (1 - error / top)

    mean = float(at_budgets.mean())
    lines = [line([px(0, top), px(0, 0), px(10, 0)], GREY, 1.5)]
    lines += [text((px(n, 0)[0], 250), str(n), GREY, "middle") for n in range(0, 11, 2)]
    lines += [text((60, px(0, e)[1] + 5), f"{e:g}", GREY, "end") for e in np.linspace(0, top, 5)[::2]]
    lines.append(text((330, 272), "false forecasts that are allowed", BLACK, "middle"))
    lines.append(text((16, 20), "error, m"))
    lines.append(line([px(x, y) for x, y in zip(grid.tolist(), curve.tolist(), strict=True)], BLUE, 2.5))
    lines += [circle(px(x, y), 5, VERMILLION) for x, y in zip(allowed.all.tolist(), at_budgets.tolist(), strict=True)]
    lines.append(line([px(allowed.all[0], mean), px(allowed.all[-1], mean)], VERMILLION, 1.5, dashed=True))
    lines.append(text((px(allowed.all[-1], mean)[0] + 10, px(0, mean)[1] + 5), f"mean {mean:.1f} m ranks", VERMILLION))
    empty = float(score.miss_error.mean())
    lines.append(line([px(0, empty), px(10, empty)], GREY, 1.5, dashed=True))
    lines.append(text((px(10, empty)[0], px(0, empty)[1] - 6), f"nothing predicted: {empty:.1f} m", GREY, "end"))
    return drawing(680, 284, lines)


def gap() -> str:
    """The share of the gap from STP to ground-truth tracks that an agent closes."""
    away = np.linspace(-0.1, 0.1, 8)  # eight units, one target each
    errors = {"GT tracks": 0.6 + away, "agent": 1.1 + 0.5 * away, "STP": 1.6 + away}
    found = gap_closed(errors["agent"], errors["STP"], errors["GT tracks"], np.ones(8))
    assert found is not None

    def px(error: float) -> float:
        return 60 + 300 * error

    lines = [line([(px(0), 90), (px(2), 90)], GREY, 1.5)]
    for (name, values), color in zip(errors.items(), (GREEN, PURPLE, BLUE), strict=True):
        error = float(values.mean())
        lines += [circle((px(error), 90), 8, color), text((px(error), 66), name, color, "middle", bold=True)]
        lines.append(text((px(error), 120), f"{error:.1f} m", BLACK, "middle"))
    high, own = (float(errors[name].mean()) for name in ("STP", "agent"))
    lines += [line([(px(own), 140), (px(high), 140)], ORANGE, 5)]
    lines.append(text((px((own + high) / 2), 164), f"{100 * found.closed:.0f} % of the gap closed", BLACK, "middle"))
    lines.append(text((px(0), 30), "error, m: less is better", GREY))
    return drawing(680, 180, lines)


DRAWINGS: dict[str, Callable[[], str]] = {
    drawn.__name__: drawn for drawn in (targets, events, coverage, miss_error, budgets, gap)
}


def _column(t: float) -> float:
    return LEFT + STEP * t


def _forecast(i: int, place: Point, paths: object, confidence: float) -> Thing:
    """A forecast object; ``paths`` [K, T, 2] absolute, or a place where it stays."""
    futures = np.broadcast_to(np.asarray(paths, dtype=float), (4, CARD.task.future, 2))
    return at(i, place, forecast=futures, confidence=confidence)


def _one_frame(true: list[Point], said: list[Thing], speed: float = 0.0) -> SceneScore:
    """The score of a scene with a single live frame; its objects move along x, m per frame."""
    now = CARD.task.past - 1
    frames = [[at(i, (x + speed * (t - now), y)) for i, (x, y) in enumerate(true)] for t in range(now + 4)]
    answers = [said if t == now else [] for t in range(len(frames))]
    return score_scene(make_scene(frames), make_rollout([[] for _ in frames], answers, samples=4), CARD)


def main() -> None:
    """Write all drawings."""
    for name, draw in DRAWINGS.items():
        (FOLDER / f"{name}.svg").write_text(draw())


if __name__ == "__main__":
    main()
