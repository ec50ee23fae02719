"""Score a baseline in memory, with a line for each scene as it is finished."""

import mtp_bench


def line(result):
    """Called after each scene."""
    print(
        f"{result.scene}: {result.covered} of {result.targets} targets have a forecast"
    )


report = mtp_bench.evaluate("stp", "MTP-Roundabout-v0", scenes=2, on_scene=line)
(row,) = [row for row in report.rows if row.subset == "all"]
print(f"bADE of {row.agent}: {row.error:.2f} m over {row.targets} targets")
