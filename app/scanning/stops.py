"""Frames put together by the table's angle: what is lit, its dark partner, where the colour comes from."""

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import Generic, Protocol, TypeVar

import numpy as np

from app.errors import ReconstructionError
from app.recording.shot import Role, Shot

# Angles closer than this belong to one stop of the table, degrees.
_SAME_ANGLE_DEG = 1e-3


class Circumstances(Protocol):
    """What an entry of a recording and a shot have in common."""

    @property
    def role(self) -> Role: ...
    @property
    def lasers_on(self) -> tuple[str, ...]: ...
    @property
    def exposure_us(self) -> float | None: ...


T = TypeVar("T", bound=Circumstances)
U = TypeVar("U", bound=Circumstances)


@dataclass(frozen=True, eq=False, slots=True)
class LitPair(Generic[T]):
    """A lit frame and its laser-off partner of the same exposure, where there is one."""

    lit: T
    dark: T | None


@dataclass(frozen=True, eq=False, slots=True)
class LitView(Generic[T]):
    """One look at the stripe of one laser (or of several lit at once).

    Attributes:
        lasers: which lasers are lit.
        exposures: the same view, longest exposure first; a single one where there is no stack.
    """

    lasers: tuple[str, ...]
    exposures: tuple[LitPair[T], ...]


@dataclass(frozen=True, eq=False, slots=True)
class Texture(Generic[T]):
    """A colour picture and the nominal angle at which it was taken."""

    frame: T
    turn_rad: float
    is_here: bool


@dataclass(frozen=True, eq=False, slots=True)
class Stop(Generic[T]):
    """All frames of one stop of the table.

    Attributes:
        number: 0 for the first stop.
        turn_rad: nominal angle, right-handed about the upward axis.
        views: the lit frames.
        darks: the laser-off frames.
        texture: colour picture of this stop, or the nearest; None where the recording has none.
    """

    number: int
    turn_rad: float
    views: tuple[LitView[T], ...]
    darks: tuple[T, ...]
    texture: Texture[T] | None

    @property
    def frames(self) -> tuple[T, ...]:
        """Dark frames first: they show markers without a stripe across them."""
        return self.darks + tuple(pair.lit for view in self.views for pair in view.exposures)


def group_stops(
    frames: Iterable[T], turn_of: Callable[[T], float], textures: Sequence[T] = ()
) -> list[Stop[T]]:
    """Stops in the order in which their first frame was taken.

    Args:
        frames: scan and texture frames.
        turn_of: nominal angle of a frame, radians.
        textures: colour frames to choose the nearest from, for stops that have none of their own.
    """
    groups: dict[int, list[T]] = {}
    for frame in frames:
        groups.setdefault(round(np.degrees(turn_of(frame)) / _SAME_ANGLE_DEG), []).append(frame)
    lit = [group for group in groups.values() if any(_is_lit(frame) for frame in group)]
    angles = np.array([turn_of(frame) for frame in textures])
    stops = []
    for number, group in enumerate(lit):
        turn = turn_of(group[0])
        darks = tuple(sorted((f for f in group if not f.lasers_on), key=lambda f: f.role is not Role.TEXTURE))
        texture: Texture[T] | None = None
        if darks:
            texture = Texture(darks[0], turn, is_here=True)
        elif len(textures):
            nearest = int(np.argmax(np.cos(angles - turn)))
            texture = Texture(textures[nearest], float(angles[nearest]), is_here=False)
        stops.append(Stop(number, turn, tuple(_views(group, darks)), darks, texture))
    return stops


def stops_of_shots(
    shots: Iterable[Shot], turn_rad: Callable[[float], float], *, each_alone: bool = False
) -> Iterator[Stop[Shot]]:
    """Stops of a stream, each handed on when the first frame of the next one arrives.

    A stop without a colour picture of its own gets the last one that was taken.

    Args:
        shots: scan and texture frames; others are passed over.
        turn_rad: `angle_deg` of a shot as a right-handed turn.
        each_alone: every shot is a stop of its own, as while the table turns steadily, and waits for none.

    Raises:
        ReconstructionError: a shot has no angle.
    """
    number, waiting, last = 0, list[Shot](), None

    def turn_of(shot: Shot) -> float:
        if shot.angle_deg is None:
            raise missing_angle(shot.name or "A shot")
        return turn_rad(shot.angle_deg)

    def together() -> Iterator[Stop[Shot]]:
        nonlocal number, last
        for stop in group_stops(waiting, turn_of, [last] if last is not None else []):
            yield Stop(number, stop.turn_rad, stop.views, stop.darks, stop.texture)
            number += 1
        dark = [shot for shot in waiting if not shot.lasers_on]
        last = dark[-1] if dark else last

    for shot in shots:
        if shot.role not in (Role.SCAN, Role.TEXTURE):
            continue
        if waiting and abs(np.degrees(turn_of(shot) - turn_of(waiting[0]))) > _SAME_ANGLE_DEG:
            yield from together()
            waiting = []
        waiting.append(shot)
        if each_alone:
            yield from together()
            waiting = []
    yield from together()


def missing_angle(name: str) -> ReconstructionError:
    return ReconstructionError(
        f"{name} has no table angle.",
        "Give every scan frame an angle_deg, or a time_s together with turntable.seconds_per_turn.",
    )


def _is_lit(frame: Circumstances) -> bool:
    return frame.role is Role.SCAN and bool(frame.lasers_on)


def _views(group: Sequence[T], darks: Sequence[T]) -> Iterator[LitView[T]]:
    by_lasers: dict[tuple[str, ...], list[T]] = {}
    for frame in group:
        if _is_lit(frame):
            by_lasers.setdefault(tuple(sorted(frame.lasers_on)), []).append(frame)
    for lasers, frames in by_lasers.items():
        exposures = {frame.exposure_us for frame in frames}
        if len(frames) > 1 and len(exposures) == len(frames) and None not in exposures:
            frames.sort(key=lambda frame: -(frame.exposure_us or 0.0))
            yield LitView(lasers, tuple(LitPair(frame, _partner(frame, darks)) for frame in frames))
        else:
            for frame in frames:
                yield LitView(lasers, (LitPair(frame, _partner(frame, darks)),))


def _partner(lit: T, darks: Sequence[T]) -> T | None:
    """The dark frame of the same exposure: a difference of unlike ones shows the room, not the stripe."""
    return next((dark for dark in darks if dark.exposure_us == lit.exposure_us), None)
