"""Run the published method on simulated copies of the paper's string, and print counts and errors by seed.

python benches/demo.py [--seeds N]
"""

from __future__ import annotations

import strand
from lib.results import make_parser, run_bench
from lib.tables import print_head, print_row
from strand.report.tables import count_chains, measure_accuracy

STAGES = (7, 1)  # segments and whole strings, as the paper reports
MAX_LENGTH_ERROR = 0.02  # of the length
MAX_RMS = 1e-3  # metres


def main() -> int:
    parser = make_parser(__doc__)
    parser.add_argument("--seeds", type=int, default=10, metavar="N", help="from 0 on (default: 10)")
    arguments = parser.parse_args()
    print_head("seed", "chains traced", "segments", "whole strings", "length error %", "RMS mm")
    published, good = strand.Config.published(), 0
    for seed in range(arguments.seeds):
        scene = strand.synthetic.scene("paper", seed=seed)
        model = strand.reconstruct(
            scene.views, scene.radius, scene.bounds, ropes=1, config=published, keep_stages=True
        )
        counts = count_chains(model)
        error = measure_accuracy(model.chains[0], scene.truth[0])
        errors = f"{error.length_error * 100:+.2f}", f"{error.rms * 1e3:.2f}"
        print_row(seed, *counts, *errors)
        good += counts[1:] == STAGES and abs(error.length_error) < MAX_LENGTH_ERROR and error.rms < MAX_RMS
    print(f"\nseven segments, one string, length within 2 %, RMS under 1 mm: {good} of {arguments.seeds}")
    return 0


if __name__ == "__main__":
    run_bench(main)
