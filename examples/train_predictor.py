"""Train a network of your own, put it into an agent, check it and make its record.

    python examples/train_predictor.py [FOLDER]

Simulated traffic: nothing is downloaded. FOLDER is a copy of `examples/own_model`, with the trained weights.
"""

import shutil
import subprocess
import sys
from pathlib import Path

import torch
from safetensors.torch import save_file

import mtp_bench
from mtp_bench.prediction import local_future, local_inputs

FOLDER = Path(sys.argv[1] if len(sys.argv) > 1 else "own_model")
ENV = "MTP-Intersection-v0"

# --8<-- [start:windows]
torch.manual_seed(0)
found = mtp_bench.windows(
    ENV, "train", tracker=5, scenes=4
)  # more of them: 500 are there
found = found.select(
    (found.object_id >= 0) & found.future_known.all(axis=1)
)  # tracks of real objects, whole futures
learn, held = found.split((1, 4))  # fold 1 of 4; whole scenes are held out
task = found.task


def features(windows):
    """Inputs of the network [n, 2 P], and the futures to predict [n, T, 2]."""
    seen = local_inputs(windows)  # also: yaw, velocity, score, size, counts, class_id
    past = seen["position"] * seen["alive"][:, :, None]  # masks, never padding
    return torch.from_numpy(past.reshape(len(past), -1)), torch.from_numpy(
        local_future(windows, windows.future)
    )


# --8<-- [end:windows]
# --8<-- [start:train]
sizes = 2 * task.past, 64, task.k * task.future * 2
model = torch.nn.Sequential(
    torch.nn.Linear(*sizes[:2]), torch.nn.ReLU(), torch.nn.Linear(*sizes[1:])
)
optimizer = torch.optim.AdamW(model.parameters(), lr=2e-3)
(x, future), (x_held, future_held) = features(learn), features(held)


def min_ade(x, future):
    """Mean error of the best of k modes, m."""
    modes = model(x).reshape(-1, task.k, task.future, 2)
    return (modes - future[:, None]).norm(dim=-1).mean(-1).min(dim=1).values.mean()


for _epoch in range(20):
    for rows in torch.randperm(len(x)).split(256):
        optimizer.zero_grad()
        min_ade(x[rows], future[rows]).backward()
        optimizer.step()
with torch.no_grad():
    print(f"minADE of held-out scenes: {min_ade(x_held, future_held):.2f} m")
# --8<-- [end:train]

# --8<-- [start:record]
here = Path(__file__).with_name("own_model")
shutil.copytree(
    here, FOLDER, dirs_exist_ok=True, ignore=shutil.ignore_patterns("__pycache__")
)
save_file(model.state_dict(), FOLDER / "model.safetensors")


def mtp_bench_command(*words):
    """Run a command of the library as in a terminal; it stops this script where it fails."""
    subprocess.run([sys.executable, "-m", "mtp_bench", *words], check=True)


mtp_bench_command("check", str(FOLDER), "--scenes", "1")
record = [
    "--scenes",
    "1",
    "--seeds",
    "1",
    "-o",
    str(FOLDER.with_suffix(".record")),
]  # without these: the whole record
mtp_bench_command("submit", str(FOLDER), "--env", ENV, *record)
# --8<-- [end:record]
