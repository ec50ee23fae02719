"""The figure of H and k: a map with the number in each cell."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from ..findings import Findings
from ..table import Tables
from .common import n_of, where
from .style import Figure, color, draw

if TYPE_CHECKING:
    from matplotlib.axes import Axes


def surface_figure(found: Findings, tables: Tables) -> Figure | None:
    """MinADE over H and k as maps, and the cost of H beside them; None where no target is covered."""
    table = tables["surface"]
    rows = where(table.rows, agent=found.subject.name)
    known = (("minADE", "all"), ("minADE_ids", "ids"))
    fields = [(f, n) for f, n in known if any(getattr(row, f) is not None for row in rows)]
    if not fields:
        return None

    def paint(*axes: Axes) -> None:
        for axis, (field, subset) in zip(axes, fields, strict=True):
            _map(axis, rows, field)
            axis.set_title(f"minADE on {subset}, m", loc="left")
        axes[0].set_ylabel("hypotheses H (time of a frame)")

    knees = [row for row in tables["knee"].rows if row.knee is not None] if "knee" in tables else []
    said = " ".join(f"Knee over {row.of}: {row.knee:g}." for row in knees) or "No knee: the error does not bend."
    sentence = f"Expected minADE, m, of k random samples out of those of H hypotheses. {said}"
    size = (9.2, 3.2) if len(fields) > 1 else None
    return draw("surface", table.title, sentence, n_of(found), paint, panels=len(fields), size=size, grid="")


def _map(axis: Axes, rows: list[Any], field: str) -> None:
    """One number over H and k as a map with the number in each cell."""
    import matplotlib as mpl

    counts, ks = sorted({row.H for row in rows}), sorted({row.k for row in rows})
    cost = {row.H: row.cost for row in rows}
    value = np.full((len(counts), len(ks)), np.nan)
    for row in rows:
        if (known := getattr(row, field)) is not None:
            value[counts.index(row.H), ks.index(row.k)] = known
    low, high = np.nanmin(value), np.nanmax(value)
    cells, shade = np.ma.masked_invalid(value), mpl.colormaps["cividis"]
    axis.pcolormesh(cells, cmap=shade, vmin=low, vmax=high, edgecolors=color("paper"), linewidth=2)
    for i, j in zip(*np.nonzero(np.isfinite(value)), strict=True):
        dark = (value[i, j] - low) / max(high - low, 1e-12) > 0.5
        ink = "#000001" if dark else "#fffffe"  # on cells, which are the same on light and dark pages
        axis.text(j + 0.5, i + 0.5, f"{value[i, j]:.2f}", ha="center", va="center", color=ink, fontsize=9)
    axis.set_xticks(np.arange(len(ks)) + 0.5, [str(k) for k in ks])
    names = [f"{h}" if cost[h] is None else f"{h}  ({cost[h]:.1f} ms)" for h in counts]
    axis.set_yticks(np.arange(len(counts)) + 0.5, names)
    axis.set_xlabel("samples k")
