"""Read frames of an MP4 video by their times, a few of them in memory at once."""

from __future__ import annotations

import math
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from strand.io.budget import Budget
from strand.io.lerobot.mp4_samples import count_samples
from strand.support.extras import import_extra
from strand.support.files import FileFormatError

_HELD = 24  # images that a decoder may hold: those that others refer to, and those that wait
_SAMPLE = 96  # bytes of a frame in the index of a video
_BYTES = {True: 2, False: 3}  # bytes of a pixel of codes, and of colours
_BLOCK = 64  # pixels to whose multiples decoders widen images
_NEAR = 2  # frames ahead that are decoded rather than sought, until key frames turn out to be farther apart
_BACK = 16  # frames before a frame whose own key frame is shown after it
# 12-bit formats, whose first plane has codes
_PLANES = ("gray12le", "yuv420p12le", "yuv422p12le", "yuv444p12le")


class Video:
    """An open video; `close` it.

    A frame is sought by the key frame before it, unless decoding on from the frame before is as fast. Both
    give the same pixels.

    Parameters
    ----------
    path : Path
    size : (int, int)
        Height and width that the video must have.
    rate : float
        Frames per second.
    codes : bool
        Whether its pixels are 12-bit codes of depth instead of colours.
    budget : Budget
    """

    def __init__(self, path: Path, size: tuple[int, int], rate: float, codes: bool, budget: Budget) -> None:
        self.path, self._size, self._codes = path, size, codes
        self._tolerance, self._step = 0.25 / rate, 1.0 / rate
        pixels = math.prod(side + _BLOCK for side in size)
        samples = count_samples(path)
        self._held = _HELD * _BYTES[codes] * pixels + _SAMPLE * samples
        budget.take(path, self._held)
        av = import_extra("av")
        self._errors = av.FFmpegError
        options = {"max_pixels": f"{pixels}", "err_detect": "explode", "enable_drefs": "0"}
        try:
            self._container = av.open(str(path.absolute()), format="mp4", options=options)
        except (av.FFmpegError, ValueError) as error:
            raise self._convert(error) from error
        try:
            self._stream = self._open_stream()
        except BaseException:
            self.close()
            raise
        self._frames: Iterator[Any] | None = None
        self._shown: tuple[float, Any] | None = None
        # seconds between a key frame and the farthest frame that was sought from it
        self._span = _NEAR * self._step

    def close(self) -> None:
        """Close the file."""
        self._frames = self._shown = None
        self._container.close()

    def read(self, time: float) -> NDArray[Any]:
        """Return the image at a time, seconds: (H, W) uint16 codes, or (H, W, 3) uint8 colours."""
        try:
            frame = self._find(time)
            return self._convert_codes(frame) if self._codes else self._convert_colors(frame)
        except (self._errors, ValueError, OverflowError) as error:
            raise self._convert(error, time) from error

    def _open_stream(self) -> Any:
        if not self._container.streams.video:
            raise FileFormatError(self.path, "expected a video, got none")
        stream = self._container.streams.video[0]
        self._require_size(stream.codec_context.width, stream.codec_context.height)
        stream.codec_context.thread_count = 1
        return stream

    def _find(self, time: float) -> Any:
        shown = self._shown
        if shown is not None and abs(shown[0] - time) <= self._tolerance:
            return shown[1]
        if self._frames is None or shown is None or not 0 < time - shown[0] <= self._span:
            return self._seek(time)
        return self._decode_to(time)

    def _seek(self, time: float) -> Any:
        """Return the frame at a time, decoded from a key frame before it.

        Some frames are shown before the key frame that precedes them in the file; they need an earlier one.
        """
        back, base = 0.0, self._stream.time_base
        while True:
            place = math.floor(max(time + self._tolerance - back, 0.0) / base)
            self._container.seek(place, stream=self._stream, backward=True)
            self._frames = self._container.decode(self._stream)
            self._shown = None
            first = self._show_next()
            if first is not None and first <= time + self._tolerance:
                self._span = max(self._span, time - first)
                return self._decode_to(time)
            if back > time:
                raise ValueError("no frame at this time")
            back = max(2.0 * back, _BACK * self._step)

    def _decode_to(self, time: float) -> Any:
        """Return the frame at a time from those that follow."""
        while self._shown is not None:
            at, frame = self._shown
            if abs(at - time) <= self._tolerance:
                return frame
            if at > time:
                break
            self._show_next()
        raise ValueError("no frame at this time")

    def _show_next(self) -> float | None:
        """Decode the next frame, and return its time; None at the end."""
        assert self._frames is not None
        self._shown = None
        frame = next(self._frames, None)
        if frame is None:
            self._frames = None
            return None
        if frame.pts is None:
            raise ValueError("a frame without a time")
        if frame.is_corrupt:
            raise ValueError("a damaged frame")
        self._require_size(frame.width, frame.height)
        self._shown = float(frame.pts * self._stream.time_base), frame
        return self._shown[0]

    def _require_size(self, width: int, height: int) -> None:
        if (height, width) != self._size:
            wanted = f"{self._size[1]} x {self._size[0]}"
            raise FileFormatError(self.path, f"expected images of {wanted} pixels, got {width} x {height}")

    def _convert_codes(self, frame: Any) -> NDArray[np.uint16]:
        if frame.format.name not in _PLANES:
            raise ValueError(
                f"expected 12-bit codes of depth ({', '.join(_PLANES)}), got {frame.format.name}"
            )
        plane = frame.planes[0]
        rows = np.frombuffer(plane, np.uint16)[: self._size[0] * plane.line_size // 2]
        return rows.reshape(self._size[0], -1)[:, : self._size[1]].copy()

    def _convert_colors(self, frame: Any) -> NDArray[np.uint8]:
        colors: NDArray[np.uint8] = frame.to_ndarray(format="rgb24")
        return colors

    def _convert(self, error: Exception, time: float | None = None) -> FileFormatError:
        text = getattr(error, "strerror", None) or str(error)
        place = None if time is None else f"at {time:.3f} s"
        with suppress(AttributeError):
            self._frames = self._shown = None
        return FileFormatError(self.path, f"truncated, damaged or not a video of a data set ({text})", place)
