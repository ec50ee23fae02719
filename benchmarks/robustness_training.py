"""Does a network forecast better under noise if it was trained with noise?

    python benchmarks/robustness_training.py FOLDER [--jobs 2]

Two networks learn from the training scenes of MTP-Intersection-v0 twice: with the recorded and with the doubled noise. They
are compared with the shipped ones, which learned from the recorded noise alone, at all levels of `noise`. Weights and
submissions are written to FOLDER, the levels to leaderboard/robustness/MTP-Intersection-v0-trained.
"""

import argparse
import shutil
import time
from pathlib import Path

from benchmarks.robustness import FOLDER
from mtp_bench.core.parallel import Workers
from mtp_bench.running import RunOptions, robustness
from mtp_bench.training import TrainingRequest, train_predictor, training_windows

ROOT = Path(__file__).parents[1]
ENV = "MTP-Intersection-v0"
NETWORKS = {"tracking_free": "tracking_free", "stp_modes_tracklets": "modes"}
NOISY_ENV = "TwiceTheNoise"
LEVELS_FOLDER = FOLDER / f"{ENV}-trained"
SCENES = 60  # as the shipped weights
SCORED_SCENES = 60


def noisy_card(folder: Path) -> Path:
    """Write a card of the environment with twice the noise."""
    text = (ROOT / "envs" / f"{ENV}.toml").read_text(encoding="utf-8")
    noisy = text.replace(f'"{ENV}"', f'"{NOISY_ENV}"')
    path = folder / f"{NOISY_ENV}.toml"
    path.write_text(f"{noisy}\n[perturb]\nnoise = 2.0\n", encoding="utf-8")
    return path


def retrained(agent: str, folder: Path, jobs: int) -> Path:
    """Train the network of an agent with both noises, and return a submission with it."""
    submission = folder / f"{agent}_noise"
    weights = submission / "weights.safetensors"
    if not weights.exists():
        shutil.copytree(ROOT / "baselines" / agent, submission, dirs_exist_ok=True)
        manifest = submission / "submission.toml"
        text = manifest.read_text(encoding="utf-8")
        text = text.replace(f'name = "{agent}"', f'name = "{agent}_noise"')
        text = text.replace(
            "[parameters]", f'[parameters]\nweights = "{weights.absolute()}"'
        )
        manifest.write_text(text, encoding="utf-8")
        card = noisy_card(folder)
        request = TrainingRequest(NETWORKS[agent], ENV, "tracklets", also=(str(card),))
        options = RunOptions(scenes=SCENES, split="train", workers=Workers(jobs))
        start = time.monotonic()
        train_predictor(training_windows(request, options), request, weights)
        print(f"{agent}: trained in {time.monotonic() - start:.0f} s", flush=True)
    return submission


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("folder", type=Path)
    parser.add_argument("--jobs", type=int, default=1)
    given = parser.parse_args()
    given.folder.mkdir(parents=True, exist_ok=True)
    agents: list[object] = []
    for agent in NETWORKS:
        agents += [agent, retrained(agent, given.folder, given.jobs)]
    options = RunOptions(scenes=SCORED_SCENES, workers=Workers(given.jobs))
    result = robustness(agents, ENV, "noise", options=options, folder=LEVELS_FOLDER)
    for agent in NETWORKS:
        for row in result.on("all"):
            if row.agent == f"{agent}_noise":
                change = result.difference(row, agent)
                assert change is not None
                print(
                    f"noise {row.level:g}, {agent}: {change.mean:+.3f} m, p {change.p:.4f}"
                )


if __name__ == "__main__":
    main()
