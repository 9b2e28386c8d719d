"""The board of the Ciclop: Horus firmware 0.2, as recorded from its true image."""

import math
from collections.abc import Generator, Iterator

from app.simulation.firmware.eeprom import SETTLING_S
from app.simulation.firmware.horus_motor import HorusMotor
from app.simulation.firmware.horus_settings import HorusSettings
from app.simulation.firmware.horus_words import Words, read_number, read_words
from app.simulation.firmware.kernel import FIRMWARES, Firmware
from app.simulation.firmware.plant import Plant

_LINE_LENGTH = 80
_KEEPS_DRIVER = 255
# From the end of the ramp until the firmware has noticed.
_AFTER_MOVE_S = 0.003
_ALARM_DELAY_S = 0.5
_LASER_LIMIT_S = 254.0
_LASERS = (1, 2, 3, 4)
_LIGHT = 123
_UNLOCK_HINT = "['$H'|'$X' to unlock]\r\n"


class Horus(Firmware):
    """Grbl 0.9 with degrees, four lasers, and an `ok` that comes when the move is over.

    Args:
        plant: what it drives.
        is_blank: with an EEPROM that this firmware has never written.
    """

    driver = "horus"
    version = "0.2"
    commands: dict[str, tuple[int, ...]] | None = None

    def __init__(self, plant: Plant, *, is_blank: bool = False) -> None:
        super().__init__(plant)
        self.settings = HorusSettings(is_blank=is_blank)
        self._motor = HorusMotor(plant, self.settings)
        self._lit_since_s: dict[int, float] = {}
        self._forget()
        self._is_locked = False

    @property
    def byte_s(self) -> float:
        """The divider of a 16 MHz clock that is nearest to 115200 gives 117647 bits per second."""
        return 85e-6

    def on_reset(self) -> None:
        if self._motor.motion is not None:
            self._motor.break_off(self.now_s)
        self._lasers_off()
        # The driver's enable input floats, which is on.
        self.plant.hold(True, self.now_s)
        self._motor.position, self._is_locked = 0, False
        self._forget()

    def on_byte(self, byte: int) -> bool:
        if byte == 0x18:
            self._wants_reset = True
        elif byte == ord("?"):
            self._reports += 1
        elif byte == ord("!"):
            self._wants_hold = True
        elif byte == ord("~"):
            self._wants_start = True
        else:
            return False
        return True

    def program(self) -> Iterator[float]:
        self.plant.hold(False, self.now_s)
        if self.settings.is_blank:
            yield from self._first_start()
        self._is_locked = bool(self.settings[22])
        while True:
            self._lasers_off()
            self.received.clear()
            self._forget()
            yield from self._rest_driver()
            self.say(f"\r\nHorus {self.version} ['$' for help]\r\n")
            if self._is_locked:
                self.say(_UNLOCK_HINT)
            yield from self._read_lines()

    def _forget(self) -> None:
        """Every reset: no feed rate, motor off, nothing held."""
        self._feed = 0.0
        self._motor_on = self._laser_on = self._checks_only = False
        self._is_paused = self._is_held = self._motor.is_braking = False
        self._wants_reset = self._wants_hold = self._wants_start = False
        self._reports: int = 0

    def _first_start(self) -> Generator[float, None, None]:
        failure = "error: EEPROM read fail. Using defaults\r\n"
        self.say(failure)
        yield from self.sleep(self.settings.restore())
        text = self.settings.listing() + 8 * failure
        self.say(text)
        yield from self.sleep(len(text) * self.byte_s)

    def _read_lines(self) -> Generator[float, None, None]:
        """Until something asks for a reset."""
        line, is_comment = "", False
        while not self._wants_reset:
            self._serve()
            if not self.received:
                yield self._laser_due_s()
                continue
            character = chr(self.received.popleft())
            if character in "\r\n":
                yield from self._execute(line)
                line, is_comment = "", False
            elif is_comment:
                is_comment = character != ")"
            elif character == "(":
                is_comment = True
            elif character > " " and character != "/":
                if len(line) >= _LINE_LENGTH - 1:
                    self.say("error: Line overflow\r\n")
                    line = ""
                else:
                    line += character.upper() if character.isascii() else character

    def _execute(self, line: str) -> Generator[float, None, None]:
        if not line:
            return
        if line.startswith("$"):
            problem = yield from self._execute_system(line)
        elif self._is_locked:
            problem = "Alarm lock"
        else:
            words = read_words(line, self.commands)
            problem = words if isinstance(words, str) else (yield from self._execute_words(words))
        self.say(f"error: {problem}\r\n" if problem else "ok\r\n")

    def _execute_system(self, line: str) -> Generator[float, None, str]:
        """A line that begins with `$`; the words of an error, or nothing."""
        if line == "$$":
            self.say(self.settings.listing())
        elif line == "$I":
            self.say(f"[{self.version}:]\r\n")
        elif line == "$G":
            self.say(f"[G{int(self._feed > 0)} G54 T0 F{self._feed:.0f}.]\r\n")
        elif line == "$H":
            # Homing that is switched on ends at once, and the lock stays.
            return "" if self.settings[22] else "Setting disabled"
        elif line == "$X":
            if self._is_locked:
                self.say("[Caution: Unlocked]\r\n")
            self._is_locked = False
        elif line == "$C":
            self._wants_reset, self._checks_only = self._checks_only, not self._checks_only
            self.say("[Enabled]\r\n" if self._checks_only else "[Disabled]\r\n")
        else:
            return (yield from self._store(line))
        return ""

    def _store(self, line: str) -> Generator[float, None, str]:
        number = read_number(line, 1)
        if number is None or line[number[1] : number[1] + 1] != "=":
            return "Bad number format" if number is None else "Invalid statement"
        value = read_number(line, number[1] + 1)
        if value is None:
            return "Bad number format"
        taken = self.settings.store(int(number[0]), value[0])
        if isinstance(taken, str):
            return taken
        yield from self.sleep(SETTLING_S)
        self.deaf_until_s = self.now_s + taken
        yield from self.sleep(taken)
        return ""

    def _execute_words(self, words: Words) -> Generator[float, None, str]:
        moves = "G1" in words.commands or "X" in words.values
        feed = words.values.get("F", self._feed)
        if moves and feed == 0.0:
            return "Undefined feed rate"
        self._feed = feed
        channel = int(words.values.get("T", 0))
        if "G50" in words.commands:
            self._motor.position = 0
        if "X" in words.values and not self._checks_only:
            yield from self._turn_to(self._motor.steps(words.values["X"]))
        for command in words.commands:
            if command in ("M17", "M18"):
                self._motor_on = command == "M17"
            elif command in ("M70", "M71"):
                self._laser_on = command == "M71"
            elif command == "M50":
                self.say(f"{_LIGHT if channel < 8 else 0}\r\n")
            elif command == "M0":
                self._is_paused = True
            elif command == "M2":
                self._wants_reset = True
        # Whatever the line was about, it switches the laser it names.
        if not self._wants_reset:
            self._switch(channel)
            if self._motor_on:
                self.plant.hold(True, self.now_s)
            else:
                yield from self._rest_driver()
        return ""

    def _turn_to(self, target: int) -> Generator[float, None, None]:
        """One move with everything that may interrupt it."""
        if target == self._motor.position:
            return
        if self._is_paused:
            self._is_held = True
        else:
            self.plant.hold(True, self.now_s)
        self._wants_hold = False
        while target != self._motor.position:
            if self._is_held:
                yield from self._wait(math.inf)
                if self._wants_reset:
                    return
                self.plant.hold(True, self.now_s)
            motion = self._motor.start(target, self._feed, self.now_s)
            yield from self._wait(motion.end_s)
            if self._wants_reset:
                self._motor.break_off(self.now_s)
                self._is_locked = True
                # The message is given time to leave.
                yield from self._rest_driver()
                self.say("ALARM: Abort during cycle\r\n")
                yield from self.sleep(_ALARM_DELAY_S)
                return
            self._motor.end()
            self._is_held, self._motor.is_braking = self._motor.is_braking, False
        yield from self.sleep(_AFTER_MOVE_S)
        yield from self._rest_driver(lets_go=not self._motor_on)

    def _wait(self, until_s: float) -> Generator[float, None, None]:
        """Until the motion under way has ended, a hold is over, or a reset is asked for."""
        is_hold = self._motor.motion is None
        while not self._wants_reset:
            self._serve()
            if self._motor.motion is not None and self._motor.is_braking:
                until_s = self._motor.motion.end_s
            if self.now_s >= until_s or (is_hold and not self._is_held):
                return
            yield min(until_s, self._laser_due_s())

    def _serve(self) -> None:
        """Real-time commands and timers."""
        if self._wants_hold and self._motor.motion is not None and not self._motor.is_braking:
            self._motor.brake(self.now_s)
        self._wants_hold = False
        if self._wants_start:
            self._is_held = self._is_paused = self._wants_start = False
        while self._reports:
            self._reports -= 1
            self._report()
        for channel, since_s in self._lit_since_s.items():
            if self.now_s >= since_s + _LASER_LIMIT_S:
                self.plant.switch(channel - 1, False, self.now_s)

    def _report(self) -> None:
        if self._is_locked:
            state = "Alarm"
        elif self._is_held:
            state = "Queue"
        elif self._motor.motion is not None:
            state = "Hold" if self._motor.is_braking else "Run"
        else:
            state = "Check" if self._checks_only else "Idle"
        at = self._motor.printed(self.now_s)
        self.say(f"<{state},MPos:{at},0.000,0.000,WPos:{at},0.000,0.000>\r\n")

    def _rest_driver(self, *, lets_go: bool = True) -> Generator[float, None, None]:
        """The idle delay, and then the motor without current, unless the setting keeps it."""
        if self.settings[1] == _KEEPS_DRIVER:
            self.plant.hold(True, self.now_s)
            return
        yield from self.sleep(self.settings[1] / 1000.0)
        if lets_go:
            self.plant.hold(False, self.now_s)

    def _switch(self, channel: int) -> None:
        if channel not in _LASERS:
            return
        if self._laser_on and channel not in self._lit_since_s:
            self._lit_since_s[channel] = self.now_s
            self.plant.switch(channel - 1, True, self.now_s)
        elif not self._laser_on:
            self._lit_since_s.pop(channel, None)
            self.plant.switch(channel - 1, False, self.now_s)

    def _lasers_off(self) -> None:
        for channel in _LASERS:
            self.plant.switch(channel - 1, False, self.now_s)
        self._lit_since_s.clear()

    def _laser_due_s(self) -> float:
        due = (since_s + _LASER_LIMIT_S for since_s in self._lit_since_s.values())
        return min((at for at in due if at > self.now_s), default=math.inf)


FIRMWARES.register("horus", Horus)
