"""What diagnostics say of the node: counts, times, troubles."""

from __future__ import annotations

from collections import Counter, deque
from statistics import median

from strand_ros.messages import Message, make_status

# levels of diagnostic_msgs/DiagnosticStatus
OK = 0
WARN = 1
ERROR = 2
STALE = 3
_KEPT = 100  # times of the last answers
_HARMLESS = ("skipped",)  # kinds of dropped images that are no trouble


class Health:
    """Counts what happens between two reports and since the start."""

    def __init__(self) -> None:
        self._counts: Counter[str] = Counter()
        self._recent: Counter[str] = Counter()
        self._spent: deque[float] = deque(maxlen=_KEPT)
        self._delays: deque[float] = deque(maxlen=_KEPT)
        self._last_trouble = ""
        self._ropes = 0

    def count_depth(self) -> None:
        """Count a depth image that came."""
        self._count("depth images")

    def count_answer(self, ropes: int, spent: float, delay: float) -> None:
        """Count an answer: its ropes, the time it took, and that since the image was taken, s."""
        self._count("answers")
        self._ropes = ropes
        self._spent.append(spent)
        self._delays.append(delay)

    def count_trouble(self, kind: str, reason: str) -> None:
        """Count a dropped image or an answer without ropes."""
        self._count(kind)
        if kind not in _HARMLESS:
            self._last_trouble = f"{kind}: {reason}"

    def _count(self, kind: str) -> None:
        self._counts[kind] += 1
        self._recent[kind] += 1

    def report(self) -> Message:
        """Return a diagnostic_msgs/DiagnosticStatus of the time since the last one, and begin anew."""
        answers, came = self._recent["answers"], self._recent["depth images"]
        troubles = {
            kind: count
            for kind, count in self._recent.items()
            if kind not in ("answers", "depth images", *_HARMLESS)
        }
        said = ", ".join(f"{count} x {kind}" for kind, count in sorted(troubles.items()))
        if not self._recent:
            level, message = STALE, "no depth images"
        elif not troubles:
            level, message = OK, f"{answers} answers"
        else:
            level = WARN if answers > troubles.get("no rope", 0) + troubles.get("doubt", 0) else ERROR
            message = f"{answers} answers to {came} depth images; {said}. Last: {self._last_trouble}"
        values: list[tuple[str, object]] = [(kind, self._counts[kind]) for kind in sorted(self._counts)]
        values += [("ropes", self._ropes), ("last trouble", self._last_trouble)]
        for name, times in (("ms an answer", self._spent), ("ms since the image", self._delays)):
            if times:
                values.append((f"{name}, median", f"{1e3 * median(times):.1f}"))
                values.append((f"{name}, most", f"{1e3 * max(times):.1f}"))
        self._recent.clear()
        return make_status(level, message, values)
