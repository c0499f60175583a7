"""Track simulated ropes of all kinds, and compare each frame with the truth.

python benches/tracking.py [--first SEED] [--seeds N] [--kinds KIND ...] [--no-masks] [--anchors] [--lengths]

Each kind of `strand.synthetic.SEQUENCES` has N sequences with plain noise, and N through an imitated stereo
camera. The tracker is told the radius and the number of ropes; with `--lengths` their lengths, with
`--anchors` where grippers hold them. It begins by itself.

A frame is right if the Fréchet distance is below 5 radii, in the direction of the first frames. `material`
is the error of points at the same arc length. `distance` is that of the centreline: of all of it, and of the
parts that nothing hides. Lost frames have no answer, or a distance above 5 radii. `after` is the share of
right frames in the half second after a rope was hidden by 15 % or more, and `recovery` the time until the
first right one. `sd` is the share of points within two deviations. `acted on` is the share of nine places
along the ropes that the rule of docs/tracking.md acts on, and how many of these are 2 radii off the rope.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from lib.results import make_parser, run_bench
from lib.tables import print_head, print_row
from lib.tracking_truth import ACTED, MUCH, RIGHT, SOON, Judged, Watched, match_events, track_sequence
from strand.synthetic import SEQUENCES, sequence

CAMERAS = {"plain": None, "stereo": "d435"}
FIRST_STILL = 20  # frames until the jitter of a rope at rest is measured


def main() -> int:
    parser = make_parser(__doc__)
    parser.add_argument("--first", type=int, default=0, metavar="SEED", help="the first seed (default: 0)")
    parser.add_argument("--seeds", type=int, default=1, metavar="N", help="how many (default: 1)")
    parser.add_argument("--kinds", nargs="+", default=list(SEQUENCES), choices=SEQUENCES, metavar="KIND")
    parser.add_argument("--frames", type=int, default=90, metavar="N", help="of a sequence (default: 90)")
    parser.add_argument("--no-masks", action="store_true", help="give colour and depth alone")
    parser.add_argument("--anchors", action="store_true", help="say where grippers hold the ropes")
    parser.add_argument("--lengths", action="store_true", help="say how long the ropes are")
    arguments = parser.parse_args()
    titles = (
        "right",
        "material / mm",
        "distance: all, seen / mm",
        "lost",
        "after",
        "recovery / s",
        "hidden: recall, precision",
        "sd",
        "acted on, wrong",
    )
    print_head("kind", "camera", *titles, "ms: median, 99 %")
    everything: list[Watched] = []
    for kind in arguments.kinds:
        for camera, device in CAMERAS.items():
            group = []
            for seed in range(arguments.first, arguments.first + arguments.seeds):
                made = sequence(kind, seed, camera=device, frames=arguments.frames, color=arguments.no_masks)
                group.append(
                    track_sequence(
                        made,
                        masks=not arguments.no_masks,
                        anchors=arguments.anchors,
                        lengths=arguments.lengths,
                    )
                )
            print_row(kind, camera, *summarize(group))
            everything += group
    print_row("**all**", "", *summarize(everything))
    print_totals(everything)
    return 0


def summarize(group: Sequence[Watched]) -> list[str]:
    """Return the cells of a row."""
    ropes = [one for watched in group for one in watched.ropes]
    found = [one for one in ropes if one is not None]
    right = sum(one.frechet < RIGHT for one in found) / len(ropes)
    lost = (len(ropes) - sum(one.distance < RIGHT * group[0].sequence.radius for one in found)) / len(ropes)
    after, recovery = zip(*(measure_recovery(watched) for watched in group), strict=True)
    after, recovery = [x for x in after if x is not None], [x for x in recovery if x is not None]
    both, predicted, hidden = (
        sum(getattr(one, name) for one in found) for name in ("both", "predicted", "hidden")
    )
    acted = sum(one.acted for one in found) / (len(ACTED) * len(ropes))
    seconds = 1e3 * np.array([x for watched in group for x in watched.seconds])
    return [
        f"{right:.2f}",
        f"{1e3 * np.median([one.material for one in found]):.1f}",
        ", ".join(
            f"{1e3 * np.nanmedian([getattr(one, name) for one in found]):.2f}"
            for name in ("distance", "seen_distance")
        ),
        f"{lost:.3f}",
        f"{np.mean(after):.2f}" if after else "",
        f"{np.mean(recovery):.2f}" if recovery else "",
        f"{both / hidden:.2f}, {both / max(predicted, 1):.2f}" if hidden else "",
        f"{np.mean([one.within for one in found]):.2f}",
        f"{acted:.2f}, {sum(one.astray for one in found)}",
        f"{np.median(seconds):.1f}, {np.quantile(seconds, 0.99):.1f}",
    ]


def measure_recovery(watched: Watched) -> tuple[float | None, float | None]:
    """Return the share of right frames soon after an occlusion, and the time to the first right one, s."""
    count = len(watched.sequence.nodes[0])
    shares, times = [], []
    for rope in range(count):
        frames: list[Judged | None] = watched.ropes[rope::count]
        ends = [k for k in range(1, len(frames)) if is_hidden(frames[k - 1]) and not is_hidden(frames[k])]
        for k in ends:
            begun = float(watched.sequence.times[k])
            soon = [one for one in frames[k:] if one is not None and one.time < begun + SOON]
            if any(is_hidden(one) for one in soon) or not soon:
                continue
            shares.append(np.mean([one.frechet < RIGHT for one in soon]))
            first = [one.time for one in frames[k:] if one is not None and one.frechet < RIGHT]
            times.append((first[0] if first else float(watched.sequence.times[-1])) - begun)
    return (float(np.mean(shares)), float(np.mean(times))) if shares else (None, None)


def is_hidden(one: Judged | None) -> bool:
    return one is not None and one.share_hidden > MUCH


def print_totals(everything: Sequence[Watched]) -> None:
    """Print what is counted over all sequences."""
    ropes = [one for watched in everything for one in watched.ropes if one is not None]
    true, reported, matched, turned = (
        sum(column) for column in zip(*map(match_events, everything), strict=True)
    )
    frames = sum(len(watched.seconds) for watched in everything)
    beside = 1e3 * sum(watched.beside for watched in everything) / frames
    turned_frames = sum(one.turned for one in ropes)
    exchanged = sum(watched.exchanged for watched in everything)
    print(f"\nFrames with a rope the other way round: {turned_frames}; with exchanged ropes: {exchanged}.")
    print(f"Crossings made or undone: {true}; reported: {reported}; true: {matched}; reversed: {turned}.")
    print(f"The second thread takes {beside:.0f} ms of processor time a frame.")
    for watched in everything:
        if watched.sequence.kind == "still" and len(watched.ropes) > FIRST_STILL:
            lines = np.array([one.points for one in watched.ropes[FIRST_STILL:] if one is not None])
            jitter = 1e3 * np.sqrt(np.square(lines - lines.mean(axis=0)).sum(axis=2).mean())
            print(f"{watched.sequence.name}: jitter {jitter:.2f} mm.")


if __name__ == "__main__":
    run_bench(main)
