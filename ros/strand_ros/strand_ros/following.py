"""From a depth image and what belongs to it to ropes, and to the messages about them."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

import strand
from strand.ropes.summary import format_confidence
from strand.support.stamps import SECOND
from strand.tracking.states import UNEXPLAINED
from strand.tracking.track import Track, TrackedRope
from strand_ros.messages import Message, make_header, make_no_ropes, make_ropes
from strand_ros.parameters import Settings
from strand_ros.waiting import Frame, read_stamp

_SHOWN_STATES = ("tracking", "coasting")  # of tracked ropes that points and markers show


class WrongImageError(ValueError):
    """An image does not fit what belongs to it."""


@dataclass(frozen=True)
class Answer:
    """The messages about an image, and what diagnostics say of it.

    `points` is None where no rope is sure enough. `trouble` is empty if there is an answer.
    """

    ropes: Message
    points: Message | None
    markers: Message
    model: strand.Model
    trouble: str
    renewed: str


class Follower:
    """Reconstructs or tracks the ropes of one image after the other."""

    def __init__(self, settings: Settings) -> None:
        self._settings = settings
        self._calibration: tuple[Any, ...] | None = None
        self.reset()

    def reset(self) -> None:
        """Forget all ropes."""
        self._tracker = strand.Tracker(**self._settings.known)
        self._previous: strand.Model | None = None

    def answer(self, frame: Frame) -> Answer:
        """Return the messages about an image.

        Raises
        ------
        WrongImageError
            If an encoding, a size or a frame is wrong, or the lens distorts.
        """
        settings = self._settings
        renewed = self._notice_changes(frame)
        header = make_header(frame.depth.header.stamp, settings.world_frame or frame.depth.header.frame_id)
        track, trouble = None, ""
        try:
            view = _read_view(frame, settings)
            model = _make_empty(view)
            if settings.rope_color is not None:
                view = _mask_by_color(view, settings)
            if settings.mode == "track":
                track = self._tracker.update([view], read_stamp(frame.depth) / SECOND)
                model, trouble = track.model, _judge(track, settings.least_confidence)
            else:
                model = self._reconstruct(view)
        except strand.NotEnoughDataError as error:
            trouble = str(error)
        except (TypeError, ValueError, strand.StrandError) as error:
            raise WrongImageError(str(error)) from error
        shown = model if track is None or track.unexplained <= UNEXPLAINED else _make_empty(view)
        shown = _choose_shown(shown, settings.least_confidence)
        stamp = read_stamp(frame.depth)
        markers = strand.msgs.make_marker_array(shown, header["frame_id"], stamp)
        ropes = make_ropes(model, header, track) if model.chains else make_no_ropes(header, trouble)
        return Answer(ropes, self._make_points(shown, header, stamp), markers, model, trouble, renewed)

    def _notice_changes(self, frame: Frame) -> str:
        """Forget all ropes where time begins anew or the camera is another one; return what changed."""
        info = frame.info
        calibration = (frame.depth.header.frame_id, info.height, info.width, *info.k, *info.d, *info.p)
        before, self._calibration = self._calibration, calibration
        if before is not None and before != calibration:
            self.reset()
            return "another CameraInfo: all begins anew"
        if frame.fresh:
            self.reset()
        return ""

    def _reconstruct(self, view: strand.View) -> strand.Model:
        model = strand.reconstruct(
            [view],
            bounds=self._settings.bounds,
            deadline=self._settings.deadline,
            previous=self._previous,
            **self._settings.known,
        )
        self._previous = model
        return model

    def _make_points(self, shown: strand.Model, header: Message, stamp: int) -> Message | None:
        """Return the nodes of one rope in order, as other trackers publish them."""
        for i, chain in enumerate(shown.chains):
            number = chain.number if isinstance(chain, TrackedRope) else i
            if number == self._settings.cloud_rope:
                count = self._settings.cloud_nodes
                nodes = chain.at(np.linspace(0.0, chain.length, count)) if count else chain.points
                return strand.msgs.make_point_cloud2(nodes, header["frame_id"], stamp)
        return None


def _read_view(frame: Frame, settings: Settings) -> strand.View:
    """Return the view of an image; raise ValueError if another message is not of its camera."""
    own = frame.depth.header.frame_id
    for name, message in ({"camera_info": frame.info} | frame.images).items():
        other = message.header.frame_id
        if other != own:
            raise ValueError(
                f"{name}: expected the depth image's frame {own!r}, got {other!r}; "
                "align depth to colour, or remap the topic"
            )
    return strand.msgs.read_view(
        frame.depth,
        frame.info,
        frame.pose,
        rectified=settings.rectified,
        depth_scale=settings.depth_scale,
        ignore_distortion=settings.ignore_distortion,
        **frame.images,
    )


def _mask_by_color(view: strand.View, settings: Settings) -> strand.View:
    """Return a view with a mask of the ropes' colour.

    If nothing has it, a tracker gets an empty mask, as of a rope that is hidden; otherwise NotEnoughDataError
    is raised.
    """
    image = view.image
    assert image is not None
    assert image.colors is not None
    (fx, fy), (cx, cy) = image.camera
    intrinsics = [[fx, 0.0, cx], [0.0, fy, cy], [0.0, 0.0, 1.0]]
    found = strand.rope_mask(
        image.colors,
        image.depth,
        intrinsics,
        rope_color=settings.rope_color,
        ropes=settings.known["ropes"],
    )
    if not found and settings.mode != "track":
        raise strand.NotEnoughDataError(f"no rope of the given colour: {found.why}")
    return strand.View.from_depth(
        image.depth,
        intrinsics,
        view.pose,
        image.colors,
        mask=found.labels,
        occluders=image.occluders,
        stamp=view.stamp,
    )


def _judge(track: Track, least: float) -> str:
    """Return what is wrong with a track, in words."""
    if not track.ropes:
        return f"no rope is found yet: {track.reason}" if track.reason else "no rope is found yet"
    lost = [str(rope.number) for rope in track.ropes if rope.state == "lost"]
    if lost:
        return f"lost: rope {', '.join(lost)}"
    if track.unexplained > UNEXPLAINED:
        return f"{track.unexplained:.0%} of the ropes' pixels are not explained, as after a gap"
    unsure = [
        f"rope {rope.number}: {format_confidence(rope.confidence)}"
        for rope in track.ropes
        if not _is_sure(rope, least)
    ]
    return f"confidence below {least:g}: {', '.join(unsure)}" if unsure else ""


def _make_empty(view: strand.View) -> strand.Model:
    return strand.Model((), view.pose[None], stamp=view.stamp)


def _choose_shown(model: strand.Model, least: float) -> strand.Model:
    """Return a model of the ropes that points and markers show, since these cannot say how sure they are.

    A tracked rope counts by its state too.
    """
    chains = [
        chain
        for chain in model.chains
        if _is_sure(chain, least) and (not isinstance(chain, TrackedRope) or chain.state in _SHOWN_STATES)
    ]
    return replace(model, chains=tuple(chains))


def _is_sure(chain: strand.Chain, least: float) -> bool:
    return chain.confidence >= least or least == 0.0  # NaN counts with a limit of 0 alone
