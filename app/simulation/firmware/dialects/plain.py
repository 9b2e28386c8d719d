"""A home-made board: an Arduino sketch of an evening that greets, takes typed words and answers DONE."""

import math
from collections.abc import Generator, Iterator
from types import MappingProxyType

from app.simulation.firmware.kernel import FIRMWARES, Firmware
from app.simulation.firmware.motion import Motion, ramped_move
from app.simulation.firmware.plant import Plant

_ACCELERATION = 1600.0
_FASTEST, _SLOWEST = 1600.0, 4.0


class Plain(Firmware):
    """Words: HELLO, GO angle speed, TURN angle speed, LIGHT number ON or OFF, WHERE, STOP, MOTOR ON or OFF.

    A move is answered when it is over; STOP, and nothing else, is heard meanwhile. Positions begin at 0 with
    every start.

    Attributes:
        at: steps since the start.
    """

    driver = "template"
    driver_options = MappingProxyType[str, object](
        {
            "hello": "HELLO",
            "hello_answer": r"I AM PLAIN \d+",
            "banner": "PLAIN READY",
            "move": "GO {angle} {speed}",
            "done": "DONE",
            "failed": r"WHAT\?[^\r\n]*",
            "laser_on": "LIGHT {channel} ON",
            "laser_off": "LIGHT {channel} OFF",
            "laser_channels": (1, 2),
            "stop": "STOP",
            "stopped": "STOPPED",
            "where": "WHERE",
            "where_answer": r"AT (-?[\d.]+)",
            "motor_on": "MOTOR ON",
            "motor_off": "MOTOR OFF",
            "steps_per_deg": 80.0 / 9.0,
            "speed_deg_s": 90.0,
            "acceleration_deg_s2": 180.0,
        }
    )

    def __init__(self, plant: Plant) -> None:
        super().__init__(plant)
        self.at = 0.0
        self._motion: Motion | None = None

    @property
    def _per_deg(self) -> float:
        return self.steps_per_turn / 360.0

    def on_reset(self) -> None:
        if self._motion is not None and self.now_s < self._motion.end_s:
            self.plant.replan(self._motion.braked(self.now_s, math.inf))
        self._motion, self.at = None, 0.0
        for output in self.outputs:
            self.plant.switch(output, False, self.now_s)
        self.plant.hold(False, self.now_s)

    def program(self) -> Iterator[float]:
        self.say("PLAIN READY\r\n")
        while True:
            words = (yield from self._read_line()).split()
            if not words:
                continue
            answer = yield from self._obey(words[0], words[1:])
            self.say(f"{answer}\r\n")

    def _read_line(self) -> Generator[float, None, str]:
        line = ""
        while (character := chr((yield from self.read_byte()))) != "\n":
            line += character
        return line

    def _obey(self, word: str, numbers: list[str]) -> Generator[float, None, str]:
        try:
            if word in ("GO", "TURN"):
                steps = float(numbers[0]) * self._per_deg
                wanted = steps if word == "GO" else self.at + steps
                return (yield from self._turn(round(wanted), float(numbers[1]) * self._per_deg))
            if word == "LIGHT":
                self.plant.switch(self.outputs[int(numbers[0]) - 1], numbers[1] == "ON", self.now_s)
                return "DONE"
            if word == "MOTOR":
                self.plant.hold(numbers[0] == "ON", self.now_s)
                return "DONE"
        except (ValueError, IndexError):
            return "WHAT? NUMBER"
        if word == "STOP":
            return "STOPPED"
        if word == "HELLO":
            return "I AM PLAIN 1"
        return f"AT {self.at / self._per_deg:.3f}" if word == "WHERE" else f"WHAT? {word}"

    def _turn(self, target: int, speed: float) -> Generator[float, None, str]:
        """Until it stands; STOP brakes it."""
        self.plant.hold(True, self.now_s)
        speed = min(max(speed, _SLOWEST), _FASTEST)
        motion = ramped_move(self.now_s, self.at, target - self.at, speed, _ACCELERATION)
        self._motion, answer = motion, "DONE"
        self.plant.move(motion)
        while self.now_s < motion.end_s:
            yield motion.end_s
            if b"STOP\n" in bytes(self.received) and answer == "DONE":
                motion, answer = motion.braked(self.now_s, _ACCELERATION), "STOPPED"
                self._motion = motion
                self.plant.replan(motion)
                self.received.clear()
        self.at = motion.position_at(motion.end_s)
        return answer


FIRMWARES.register("plain", Plain)
