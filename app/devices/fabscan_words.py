"""The words of the FabScanPi firmware, what its numbers mean, and which of them are traps."""

import re

# On and off; channels are numbered as the FabScanPi server does: 0 right, 1 left.
LASERS = (("M21", "M22"), ("M19", "M20"))
# A number is 16 bits wide, and the processor makes no more counts per second.
MOST_COUNTS, FASTEST = 32767, 2460
# Measured: each count comes so much later than its speed says.
_LATE_S = 3.5e-6


def usual_counts_per_step(version: str) -> int:
    """What T counts of a motor step: one, then two, one again, and four from November 2018 on."""
    digits = version.removeprefix("v.")
    date = int(digits) if re.fullmatch(r"20\d{6}", digits) else 99999999
    if date >= 20181101:
        return 4
    return 2 if 20170301 <= date < 20170701 else 1


def counts_per_s(feed: int) -> float:
    """The speed that comes of a G01 with this F."""
    return feed / (1.0 + feed * _LATE_S)


def move_command(counts: int, feed: int) -> str:
    """A turn at constant speed; it must have one, as the board hangs without."""
    return f"G01 T{counts} F{feed}"


def turn_commands(steps: int, counts_per_step: int, feed: int) -> tuple[str, ...]:
    """A longer turn, in parts whose numbers the board can take."""
    longest, left = MOST_COUNTS // counts_per_step, abs(steps)
    way = counts_per_step if steps > 0 else -counts_per_step
    return tuple(move_command(way * min(longest, left - done), feed) for done in range(0, left, longest))


def is_trap(command: str) -> bool:
    """Whether the firmware, which finds a G in any word, would hang or turn without end."""
    words = {word[0]: word[1:] for word in reversed(command.split(" ")) if word}
    code, speed = (re.match(r"-?\d+", words.get(letter, "")) for letter in "GF")
    if code is None:
        return False
    is_endless = int(code[0]) == 6
    return is_endless or (int(code[0]) == 1 and (speed is None or int(speed[0]) <= 0))
