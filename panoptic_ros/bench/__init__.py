"""Bench: time and memory of stages against named baselines, and the quality of timecode decoders.

Each bench is one module with `add_arguments(parser)`, `measure(args, progress) -> dict` (JSON, SI units in
the names) and `lines(result) -> list[str]` (the table), and is named in `BENCHES`; those of the live
graph need processes, and are in `running.benches`. Times of the others are those
of one thread, inputs already in arrays, first call excluded. Benches only measure: tests never assert a time.
"""

from __future__ import annotations

BENCHES: dict[str, str] = {
    "ablation": "what every mechanism of the core is worth: each off in turn, on simulations and recordings",
    "borders": "people whom image borders cut: with and without the model of borders, and an oracle",
    "clocks": "stamps corrected by timecode against the truth: an hour of mixed rates, and what clocks do",
    "ltc": "timecode decoding: recall, wrong labels, exactness, latency and speed, beside a user's libltc",
    "offsets": "clocks from motion against the truth: errors, stated deviations, poses before and after",
    "patches": "the motion of the surface: time of every stage by the number of views",
    "solve": "2D people to skeletons: time of every stage on one thread, and joints that are far off",
    "sound": "clocks from sound in simulated rooms against the truth, controls, and motion after it",
    "stage1": "voting, assembly, tracking and refinement beside named baselines: time, memory, accuracy",
    "visibility": "what known occluders and depth maps are worth: votes, nodes and people with and without",
}
