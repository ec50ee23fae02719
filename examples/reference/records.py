"""The truth and the detections of a scene, frame by frame."""

import mtp_bench

card = mtp_bench.load_card("MTP-Merge-v0")
scene = next(mtp_bench.load_scenes(card))
rows = scene.truth.rows(100)  # of frame 100
fastest = abs(scene.truth.velocity[rows, 0]).max()
print(f"{scene.name}, {scene.frames} frames; in frame 100:")
print(
    f"{rows.stop - rows.start} true objects, {scene.detections.counts[100]} detections, at most {fastest:.0f} m/s"
)
