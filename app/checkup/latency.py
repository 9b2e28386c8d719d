"""How long a picture is under way, and how many old ones a camera keeps: a laser is the signal."""

import statistics
import time
from collections.abc import Sequence
from dataclasses import dataclass

from app.checkup.raw_camera import Arrival, RawReader, Signal
from app.devices.bench import Bench
from app.vision.stripe import Image

# By so much a camera's times may be wrong without harm.
STAMP_SLACK_S = 0.012
_TRIALS = 8
# As a share of the whole change: a frame that shows more was exposed after the switching altogether.
_WHOLE = 0.85
_CHANGED = 0.3
_LONGEST_S = 1.5
_PAUSES = 2
_LEAST_PAUSE_S = 0.5
_MOST_STALE = 12
_CATCH_UP = 60
# A picture that came sooner than this after it was asked for had been waiting.
_WAITED_PERIODS = 0.3


@dataclass(frozen=True, slots=True)
class Bounds:
    """A number that lies between two."""

    low: float
    high: float

    @property
    def middle(self) -> float:
        return 0.5 * (self.low + self.high)

    @property
    def half_width(self) -> float:
        return 0.5 * abs(self.high - self.low)


@dataclass(frozen=True, slots=True)
class Latency:
    """What switching a laser showed of a camera.

    Attributes:
        latency_s: from the beginning of an exposure to the arrival of its picture. Boards act when they
            have understood and answer later, so that the upper end is the likely one; it is the safe one too.
        late_stamps_s: what has to be added to the camera's own times; None where it tells none.
        command_s: how long the board takes to switch a laser.
        most_s: the longest time from a command to the first picture that shows it in full.
    """

    latency_s: Bounds
    late_stamps_s: Bounds | None
    command_s: float
    most_s: float

    @property
    def has_right_stamps(self) -> bool:
        """Whether the camera's own times can be relied on."""
        return _are_right(self.late_stamps_s)


@dataclass(frozen=True, eq=False, slots=True)
class _Trial:
    """One switching: the last frame that does not show it in full, and the first that does."""

    sent_s: float
    answered_s: float
    before: Arrival
    after: Arrival


def first_signal(bench: Bench, reader: RawReader, dark: Image) -> tuple[str, Signal] | None:
    """A laser whose light is seen, however late its picture comes; it is left on. None where there is none.

    Args:
        dark: picture with all lasers off.
    """
    channels = bench.turntable.facts.laser_channels
    for laser, entry in bench.lasers.items():
        if entry.channel not in channels:
            continue
        bench.switch(laser, True)
        signal = Signal.of(dark, reader.image(reader.grab_for(_LONGEST_S)[-1]))
        if signal is not None:
            return laser, signal
        bench.switch(laser, False)
    return None


def measure_latency(
    bench: Bench, laser: str, signal: Signal, reader: RawReader, period_s: float
) -> Latency | None:
    """Switch a laser, which is lit, off and on at different moments between two frames.

    The first frame that shows the change in full began after the command was sent, the one before it did
    not begin after the answer: every trial leaves an interval, and they have a common part. None where no
    change was seen.
    """
    trials: list[_Trial] = []
    wait_s = _LONGEST_S
    for number in range(_TRIALS):
        is_on = number % 2 == 1
        newest = _catch_up(reader, period_s)
        with reader.grabbing() as arrivals:
            time.sleep(number / _TRIALS * period_s)
            sent_s = time.monotonic()
            bench.switch(laser, is_on)
            answered_s = time.monotonic()
            time.sleep(wait_s)
        arrivals = [newest, *arrivals]
        trial = _found(reader, signal, arrivals, is_on, sent_s, answered_s)
        if trial is None:
            return None
        trials.append(trial)
        # The next ones need not be waited for much longer than this one.
        wait_s = min(_LONGEST_S, 1.5 * (trial.after.arrived_s - sent_s) + 3.0 * period_s)
    stamps = _stamps(trials)
    return Latency(
        _by_stamps(trials) if _are_right(stamps) else _by_switching(trials),
        stamps,
        statistics.median(t.answered_s - t.sent_s for t in trials),
        max(t.after.arrived_s - t.sent_s for t in trials),
    )


def measure_stale(
    bench: Bench, laser: str, signal: Signal, reader: RawReader, period_s: float, latency_s: float
) -> int:
    """How many pictures of an old state come first after nobody has read for much longer than the latency.

    The laser is lit, and so it is afterwards.
    """
    counts = []
    for number in range(_PAUSES):
        is_on = number % 2 == 1
        pause_s = max(_LEAST_PAUSE_S, 2.0 * latency_s + 6.0 * period_s)
        _catch_up(reader, period_s)
        # First let it fill whatever it keeps them in, for it may keep the oldest.
        time.sleep(pause_s)
        bench.switch(laser, is_on)
        time.sleep(pause_s)
        stale = 0
        # Looked at afterwards, so that looking does not make it a late reader again.
        for arrival in [reader.grab() for _ in range(_MOST_STALE)]:
            if _progress(reader, signal, arrival, is_on) > _CHANGED:
                break
            stale += 1
        counts.append(stale)
    return min(counts)


def _catch_up(reader: RawReader, period_s: float) -> Arrival:
    """Read until pictures have to be waited for; the last one."""
    arrival = reader.grab()
    for _ in range(_CATCH_UP):
        if arrival.arrived_s - arrival.asked_s > _WAITED_PERIODS * period_s:
            break
        arrival = reader.grab()
    return arrival


def _progress(reader: RawReader, signal: Signal, arrival: Arrival, is_on: bool) -> float:
    """How much of a change a frame shows, 0..1."""
    share = signal.share(reader.image(arrival))
    return share if is_on else 1.0 - share


def _found(
    reader: RawReader,
    signal: Signal,
    arrivals: Sequence[Arrival],
    is_on: bool,
    sent_s: float,
    answered_s: float,
) -> _Trial | None:
    """Where the change is, looked for by halves, for looking is dear; the first frame came before it."""
    low, high = 0, len(arrivals) - 1
    if _progress(reader, signal, arrivals[high], is_on) < _WHOLE:
        return None
    while high - low > 1:
        middle = (low + high) // 2
        if _progress(reader, signal, arrivals[middle], is_on) < _WHOLE:
            low = middle
        else:
            high = middle
    return _Trial(sent_s, answered_s, arrivals[low], arrivals[high])


def _common(bounds: Sequence[Bounds]) -> Bounds:
    """What all intervals hold; where they contradict each other, for some frame was late, the usual one."""
    low, high = max(b.low for b in bounds), min(b.high for b in bounds)
    if low > high:
        low, high = statistics.median(b.low for b in bounds), statistics.median(b.high for b in bounds)
    return Bounds(low, high)


def _by_switching(trials: Sequence[_Trial]) -> Bounds:
    return _common([Bounds(t.before.arrived_s - t.answered_s, t.after.arrived_s - t.sent_s) for t in trials])


def _by_stamps(trials: Sequence[_Trial]) -> Bounds:
    """From the camera's own times, where they have been found right."""
    lags = [t.after.arrived_s - t.after.raw.exposed_s for t in trials if t.after.raw.exposed_s is not None]
    return Bounds(min(lags), statistics.median(lags))


def _stamps(trials: Sequence[_Trial]) -> Bounds | None:
    bounds = [
        Bounds(trial.sent_s - trial.after.raw.exposed_s, trial.answered_s - trial.before.raw.exposed_s)
        for trial in trials
        if trial.after.raw.exposed_s is not None and trial.before.raw.exposed_s is not None
    ]
    return _common(bounds) if len(bounds) == len(trials) else None


def _are_right(stamps: Bounds | None) -> bool:
    return stamps is not None and stamps.low <= STAMP_SLACK_S and stamps.high >= -STAMP_SLACK_S
