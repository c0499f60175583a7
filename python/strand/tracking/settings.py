"""The settings of a tracker."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from strand.config import Config
from strand.ropes.model import Model
from strand.support.checks import check_integer, check_lengths


@dataclass(frozen=True, eq=False)
class Settings:
    """The arguments of `Tracker`, checked; lengths in metres."""

    radius: float | tuple[float, ...] | None
    ropes: int | None
    lengths: tuple[float, ...] | None
    model: Model | None
    config: Config | None

    @property
    def typical_radius(self) -> float | None:
        """The first radius, metres."""
        return None if self.radius is None else float(np.ravel(self.radius)[0])

    @property
    def length(self) -> float | tuple[float, ...] | None:
        """The lengths as `reconstruct` takes them, metres."""
        if self.lengths is None:
            return None
        return self.lengths[0] if len(self.lengths) == 1 else self.lengths


def check_settings(
    radius: float | Sequence[float] | None,
    ropes: int | None,
    length: float | Sequence[float] | None,
    model: Model | None,
    config: Config | None,
) -> Settings:
    """Check what a tracker is told."""
    radii = None if radius is None else check_lengths("radius", radius)
    lengths = None if length is None else check_lengths("length", length)
    count = None if ropes is None else check_integer("ropes", ropes, 1)
    if config is not None and not isinstance(config, Config):
        raise TypeError(f"config: expected a Config or None, got {type(config).__name__}")
    if model is not None:
        if not isinstance(model, Model):
            raise TypeError(f"model: expected a Model or None, got {type(model).__name__}")
        if not model.chains:
            raise ValueError("model: expected at least one chain, got none")
        if any(chain.closed for chain in model.chains):
            raise ValueError("model: expected open chains, got a closed one")
        if count is not None and len(model.chains) != count:
            raise ValueError(f"model: expected {count} chains, as many as ropes, got {len(model.chains)}")
    if lengths is not None and len(lengths) > 1:
        if count is not None and count != len(lengths):
            raise ValueError(f"length: expected one length or {count}, one for each rope, got {len(lengths)}")
        count = len(lengths)
    if radii is not None and len(radii) > 1 and count is not None and len(radii) > count:
        raise ValueError(f"radius: expected one radius, or at most {count}, got {len(radii)}")
    single = radius is not None and np.ndim(radius) == 0
    given = radii[0] if radii is not None and single else radii
    return Settings(given, count, lengths, model, config)
