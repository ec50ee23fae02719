"""Write the tables and the figure of robustness anew from the levels in `leaderboard/robustness`.

    python -m docs.generate.robustness

Tables stand between ``<!-- robustness: NAME -->`` and ``<!-- /robustness -->``. The names are ``in short``, a row per
environment and error; ``tracking-free``, differences to other agents by level; ``switches``, gains of
hypotheses on identity switches; the id of an environment, a row per error
and agent; ``trained``, networks trained with noise.
"""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from pathlib import Path

from mtp_bench.core.files import write_text
from mtp_bench.running import Level, LevelRow, Robustness
from mtp_bench.scoring import RANKED_OBJECTS, numbers_of
from mtp_bench.viz import draw_curves

from .blocks import filled_blocks, table

ROOT = Path(__file__).resolve().parents[2]
LEVELS = ROOT / "leaderboard" / "robustness"
PAGES = (
    ROOT / "leaderboard" / "RESULTS.md",
    ROOT / "docs" / "environment" / "robustness.md",
)
PICTURES = {
    False: ROOT / "docs" / "pictures" / "robustness.svg",
    True: ROOT / "docs" / "pictures" / "robustness_dark.svg",
}
SHOWN = ("stp", "mtp", "tracking_free", "affinity", "stp_modes_tracklets")
RATIOS = SHOWN[1:]
TRACKING_AGENTS = ("stp_modes_tracklets", "mtp")
CONTROLS = ("stp_same_samples", "stp_neighbours")
SEES_TRUTH = ("perfect_association_same_samples", "gt_tracks")
NONE = "–"
DRAWN_ENV = "MTP-nuScenes-v0"
DRAWN_KNOBS = ("noise", "score", "delay")


def stored(env: str, knob: str) -> Robustness:
    """Return the measured levels of an error, in their order."""
    paths = (LEVELS / env).glob(f"{knob}-*.json")
    levels = [Level.model_validate_json(path.read_bytes()) for path in paths]
    levels.sort(key=lambda level: level.rows[0].level)
    agents = dict.fromkeys(row.agent for row in levels[0].rows)
    asked = tuple(agent for agent in agents if agent not in SEES_TRUTH)
    is_drive = levels[0].detector is None
    return Robustness(env, knob, asked, ("mtp",), tuple(levels), is_drive)


def curves() -> list[Robustness]:
    """Return all errors of all environments that were measured."""
    paths = LEVELS.glob("*-v0/*.json")
    found = {(path.parent.name, path.stem.rpartition("-")[0]) for path in paths}
    return [stored(env, knob) for env, knob in sorted(found)]


def filled(page: str) -> str:
    """Return ``page`` with its tables made anew."""

    def content(name: str) -> str:
        if name == "in short":
            return in_short(curves())
        if name == "tracking-free":
            return tracking_free(curves())
        if name == "switches":
            return switches(curves())
        if name == "trained":
            return trained()
        return values([curve for curve in curves() if curve.env == name])

    return filled_blocks(page, "robustness", content)


def in_short(found: Sequence[Robustness]) -> str:
    """Return the table of the best agents and of what the strongest level costs stp."""
    heads = ["environment", "error", "best agent", "`stp`: strongest − recorded"]
    heads += [f"`{agent}` / `stp`" for agent in RATIOS]
    rows = []
    for curve in found:
        ratios = curve.mean_relative
        cells = [
            f"{ratios[agent]:.2f}" if agent in ratios else NONE for agent in RATIOS
        ]
        rows.append(
            [curve.env, curve.knob, _leaders(curve), _rise(curve, "stp"), *cells]
        )
    return table(heads, rows)


def _leaders(curve: Robustness) -> str:
    """Return the best agent from each level on where it changes; a star: surely ahead."""
    parts: list[str] = []
    last = None
    for leader in curve.leaders:
        if leader.agent != last:
            begin = f"from {leader.level:g} on " if parts else ""
            parts.append(f"{begin}`{leader.agent}`")
        last = leader.agent
    sure = [f"{leader.level:g}" for leader in curve.leaders if leader.is_ahead]
    note = f" (significant only at {', '.join(sure)})" if sure else ""
    if len(sure) == len(curve.levels):
        note = " (significant at all levels)"
    return ", ".join(parts) + note


def _rise(curve: Robustness, agent: str) -> str:
    """Return what the strongest level costs an agent, with its interval."""
    row = [row for row in curve.on("all") if row.agent == agent][-1]
    return _difference(curve, row, None, curve.recorded)


def _difference(
    curve: Robustness, row: LevelRow, agent: str | None, level: float | None
) -> str:
    mean, interval, _ = numbers_of(curve.difference(row, agent, level))
    if mean is None:
        return NONE
    low, high = interval or (mean, mean)
    return f"{_signed(mean)} [{_signed(low)}, {_signed(high)}]"


def tracking_free(found: Sequence[Robustness]) -> str:
    """Return bADE of tracking_free less that of two agents by level."""
    rows = []
    for curve in found:
        own = [row for row in curve.on("all") if row.agent == "tracking_free"]
        rows.append(_by_level(curve, own, TRACKING_AGENTS))
    heads = ["environment", "error", *(f"− `{other}`" for other in TRACKING_AGENTS)]
    return table(heads, rows)


def switches(found: Sequence[Robustness]) -> str:
    """Return bADE of mtp on identity switches less that of its controls by level.

    Environments with too few of them to rank are left out.
    """
    rows = []
    for curve in found:
        own = [row for row in curve.on("ids") if row.agent == "mtp"]
        if any((row.effective_objects or 0) >= RANKED_OBJECTS for row in own):
            rows.append(_by_level(curve, own, CONTROLS))
    heads = ["environment", "error", *(f"− `{other}`" for other in CONTROLS)]
    return table(heads, rows)


def _by_level(
    curve: Robustness, own: Sequence[LevelRow], others: Sequence[str]
) -> list[str]:
    """Return a row of differences to other agents by level; a star: p < .05."""
    cells = []
    for other in others:
        parts = []
        for row in own:
            difference = curve.difference(row, other)
            if difference is not None:
                star = r"\*" if difference.significant else ""
                parts.append(_at(curve, row, _signed(difference.mean) + star))
        cells.append(", ".join(parts) or NONE)
    return [curve.env, curve.knob, *cells]


def _signed(number: float) -> str:
    return f"{number:+.3f}".replace("-", "−")


def _at(curve: Robustness, row: LevelRow, text: str) -> str:
    """Return a level and a text, bold as recorded."""
    at_level = f"{row.level:g}: {text}"
    return f"**{at_level}**" if row.level == curve.recorded else at_level


def values(found: Sequence[Robustness]) -> str:
    """Return the table of an environment: a row per error and agent, a value per level."""
    heads = ["error", "agent", "value by level", "strongest − recorded"]
    rows = []
    for curve in found:
        for agent in SHOWN:
            own = [row for row in curve.on("all") if row.agent == agent]
            if own:  # not all agents drive
                by_level = ", ".join(_at(curve, row, f"{row.value:.3f}") for row in own)
                rows.append([curve.knob, f"`{agent}`", by_level, _rise(curve, agent)])
    return table(heads, rows)


def trained() -> str:
    """Return the gains of networks that were trained with noise, a row per level."""
    curve = stored("MTP-Intersection-v0-trained", "noise")
    noisy = [agent for agent in curve.agents if agent.endswith("_noise")]
    heads = ["noise"]
    for agent in noisy:
        heads += [f"`{agent.removesuffix('_noise')}`", "with noise, less that"]
    by_level: dict[float, list[str]] = {}
    for agent in noisy:
        recorded_agent = agent.removesuffix("_noise")
        for row in curve.on("all"):
            if row.agent == agent:
                (other,) = (
                    each.value
                    for each in curve.on("all")
                    if (each.agent, each.level) == (recorded_agent, row.level)
                )
                cells = by_level.setdefault(row.level, [f"{row.level:g}"])
                cells.append(f"{other:.3f}")
                cells.append(_difference(curve, row, recorded_agent, None))
    return table(heads, list(by_level.values()))


def inputs_digest() -> str:
    """Return the sha256 of the levels that the figure is drawn from."""
    digest = hashlib.sha256()
    for knob in DRAWN_KNOBS:
        for path in sorted((LEVELS / DRAWN_ENV).glob(f"{knob}-*.json")):
            digest.update(path.read_bytes())
    return digest.hexdigest()


def main() -> None:
    """Fill in the pages and draw the figure."""
    for page in PAGES:
        text = page.read_text(encoding="utf-8")
        write_text(page, filled(text))
    drawn = [stored(DRAWN_ENV, knob) for knob in DRAWN_KNOBS]
    for is_dark, path in PICTURES.items():
        draw_curves(drawn, path, SHOWN, is_dark)
        svg = path.read_text(encoding="utf-8")
        note = f"<!-- drawn from levels with the sha256 {inputs_digest()} -->\n"
        write_text(path, svg + note)


if __name__ == "__main__":
    main()
