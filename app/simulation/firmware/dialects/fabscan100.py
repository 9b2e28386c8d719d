"""The first FabScan's firmware: one byte, one deed, and hardly ever an answer.

Source: francisengelmann/FabScan100, arduino/FabScanArduinoFirmware/FabScanArduinoFirmware.ino, read for its
figures.
"""

import math
from collections.abc import Iterator

from app.simulation.firmware.kernel import FIRMWARES, Firmware
from app.simulation.firmware.motion import Motion, ramped_move
from app.simulation.firmware.plant import Plant

_LASER_OFF, _LASER_ON, _STEP, _CLOCKWISE, _COUNTER_CLOCKWISE = 200, 201, 202, 203, 204
_MOTOR_ON, _MOTOR_OFF, _LIGHT, _TURN_LASER, _PING, _PONG, _SELECT = 205, 206, 207, 209, 210, 211, 212
_TABLE = 10
_STEP_S = 0.006


class FabScan100(Firmware):
    """The version for the FabScan shield. Its laser is on from the end of the boot loader."""

    baud = 9600
    buffer_size = 64
    outputs = (0,)
    channels = (1,)

    def __init__(self, plant: Plant) -> None:
        super().__init__(plant)
        self._motion: Motion | None = None
        self._is_powered = False
        self._way = 1
        self._stepper = _TABLE

    def program(self) -> Iterator[float]:
        self._is_powered, self._way, self._stepper = False, 1, _TABLE
        self.plant.switch(0, True, self.now_s)
        self.say(bytes([_PONG]))
        while True:
            action = yield from self.read_byte()
            if action in (_LASER_OFF, _LASER_ON):
                self.plant.switch(0, action == _LASER_ON, self.now_s)
            elif action == _STEP:
                count = yield from self.read_byte()
                yield from self._turn(count)
            elif action in (_CLOCKWISE, _COUNTER_CLOCKWISE):
                self._way = 1 if action == _COUNTER_CLOCKWISE else -1
            elif action in (_MOTOR_ON, _MOTOR_OFF):
                self._power(action == _MOTOR_ON)
            elif action == _LIGHT:
                yield from self.read_byte()
            elif action == _TURN_LASER:
                yield from self._read_for_ever()
            elif action == _PING:
                yield from self.sleep(0.001)
                self.say(bytes([_PONG]))
            elif action == _SELECT:
                self._stepper = yield from self.read_byte()
                self.say(bytes([self._stepper]))

    def on_reset(self) -> None:
        if self._motion is not None and self.now_s < self._motion.end_s:
            self.plant.replan(self._motion.braked(self.now_s, math.inf))
        self._motion = None
        self.plant.switch(0, False, self.now_s)
        self.plant.hold(False, self.now_s)

    def _turn(self, count: int) -> Iterator[float]:
        if self._stepper == _TABLE and count:
            self._motion = ramped_move(self.now_s, 0.0, self._way * count, 1.0 / _STEP_S, math.inf)
            self.plant.move(self._motion, is_coupled=self._is_powered)
        yield from self.sleep(count * _STEP_S)

    def _power(self, is_on: bool) -> None:
        if self._stepper == _TABLE:
            self._is_powered = is_on
            self.plant.hold(is_on, self.now_s)

    def _read_for_ever(self) -> Iterator[float]:
        """The state after 209, which has no way out."""
        while True:
            yield from self.read_byte()


FIRMWARES.register("fabscan100", FabScan100)
