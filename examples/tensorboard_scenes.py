"""Metrics of every finished scene in TensorBoard, while an agent runs: `tensorboard --logdir runs/tensorboard`."""

# needs: tensorboard

from torch.utils.tensorboard import SummaryWriter

import mtp_bench

writer, finished = SummaryWriter("runs/tensorboard"), []


def log(result):
    """Called after every finished scene."""
    for name in ("min_ade", "min_fde", "coverage"):
        if getattr(result, name) is not None:  # there are targets
            writer.add_scalar(
                f"{result.agent}/{name}", getattr(result, name), len(finished)
            )
    finished.append(result)


mtp_bench.evaluate("stp", "MTP-Roundabout-v0", scenes=2, on_scene=log)
writer.close()
print(f"{len(finished)} scenes in runs/tensorboard")
