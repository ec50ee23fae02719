"""Recordings read back from their files, as rerun itself reads them."""

from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mtp_bench.core import Rollout, Scene
from mtp_bench.viz.rerun.shown import Colors, track_colors

Rows = dict[int, dict[str, Any]]


def read(path: Path) -> dict[str, Rows]:
    """Values by entity, frame (-1: static) and component."""
    from rerun.chunk import RrdReader

    found: dict[str, Rows] = {}
    for chunk in RrdReader(path).stream():
        batch = chunk.to_record_batch()
        rows = found.setdefault(chunk.entity_path.removeprefix("/"), {})
        columns = {name: batch.column(i).to_pylist() for i, name in enumerate(batch.schema.names)}
        for i in range(batch.num_rows):
            if not chunk.is_static and "frame" not in columns:
                continue  # of the timeline of an event, which repeats rows of the others
            row = rows.setdefault(-1 if chunk.is_static else columns["frame"][i], {})
            row |= {name.split(":")[-1]: column[i] for name, column in columns.items() if column[i] is not None}
    return found


def boxes(rows: Rows, frame: int) -> NDArray[np.float64]:
    """Boxes [n, 7] of a frame; yaw from the quaternion."""
    row = rows[frame]
    if not row["centers"]:
        return np.zeros((0, 7))
    turn = np.array(row["quaternions"])
    yaw = 2 * np.arctan2(turn[:, 2], turn[:, 3])
    return np.column_stack([row["centers"], yaw, 2 * np.array(row["half_sizes"])])


def assert_recorded(
    found: dict[str, Rows], scene: Scene, rollout: Rollout, hypotheses: Iterable[int], samples: int
) -> None:
    """Truth, detections, these hypotheses and the heaviest ``samples`` of each forecast are what was said."""
    center = rollout.object_box[:, None, None, :2].astype(np.float64)
    future = (center + rollout.forecast / 100.0).astype(np.float32)
    weight = rollout.forecast_log_weight
    heaviest = np.argsort(np.argsort(-weight, axis=1, kind="stable"), axis=1, kind="stable") < samples
    for t in range(rollout.frames):
        for path, table in (("world/gt", scene.truth), ("world/det", scene.detections)):
            expected = table.box[table.rows(t)].astype(np.float32)
            np.testing.assert_allclose(boxes(found[path], t), expected, rtol=1e-6, atol=1e-5, err_msg=f"{path} {t}")
        names = [label.rpartition(" ")[2] for label in found["world/gt"][t].get("labels") or []]
        assert names == [scene.short_name(g) for g in scene.truth.object_id[scene.truth.rows(t)].tolist()]
        rows = rollout.tracks.rows(t)
        for h in hypotheses:
            mine, logged = rollout.member[rows, h], found[f"world/hyp/{h:02d}/box"]
            np.testing.assert_allclose(boxes(logged, t), rollout.track_box[rows][mine], rtol=1e-6, atol=1e-5)
            labels = found[f"world/hyp/{h:02d}/name"][t]["labels"]
            assert [int(label) for label in labels] == rollout.track_id[rows][mine].tolist()
            assert logged[t]["colors"] == _packed(track_colors(rollout.track_id[rows][mine]))
        objects = rollout.objects.rows(t)
        stated = np.isfinite(weight[objects]) & heaviest[objects]
        strips = np.concatenate([  # those of nothing have an entity of their own
            np.asarray(found[path][t]["strips"], dtype=np.float32).reshape(-1, future.shape[2] + 1, 3)
            for path in ("world/forecast", "world/false_forecast") if path in found
        ])  # fmt: skip
        start = rollout.object_box[objects, None, :2].astype(np.float32)[np.nonzero(stated)[0]]
        said = np.concatenate([start, future[objects][stated]], 1)
        np.testing.assert_array_equal(_sorted(strips[..., :2]), _sorted(said))
        assert set(strips[..., 2].ravel().tolist()) <= set(rollout.object_box[objects, 2].astype(np.float32).tolist())


def _packed(colors: Colors) -> list[int]:
    """Numbers of opaque colours [n, 3], as rerun stores them: RGBA."""
    return [(r << 24) + (g << 16) + (b << 8) + 255 for r, g, b in colors.tolist()]


def _sorted(paths: NDArray[np.floating]) -> NDArray[np.floating]:
    """Paths [n, points, 2] in an order of their own."""
    return paths[np.lexsort(paths.reshape(len(paths), -1).T)]
