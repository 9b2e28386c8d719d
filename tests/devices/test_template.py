"""The driver that is typed in, on a home-made board, and templates that cannot work."""

from collections.abc import Generator, Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest
from turntable_contract import TurntableContract, plant_state, wait_until

from app.devices.command_template import parse_template
from app.devices.turntable import TURNTABLES, Turntable
from app.devices.turntables.template import TemplateTable
from app.errors import DeviceRefused, DeviceUnrecognised, OptionError, PositionUnknown
from app.simulation.clock import Clock
from app.simulation.firmware.dialects.plain import Plain
from app.simulation.firmware.kernel import Firmware
from app.simulation.firmware.plant import Plant, Wiring
from app.simulation.firmware.port import EmulatedPort

_FULL = {**Plain.driver_options, "answer_s": 0.8, "boot_s": 0.8}
# The least a board can have: nothing tells who or where it is, and nothing stops it.
_BARE = {
    "move": "TURN {delta} {speed}",
    "done": "DONE",
    "laser_on": "LIGHT {channel} ON",
    "laser_off": "LIGHT {channel} OFF",
    "steps_per_deg": 80.0 / 9.0,
    "speed_deg_s": 90.0,
    "acceleration_deg_s2": 180.0,
    "boot_s": 0.5,
    "answer_s": 0.5,
}


class TestTemplate(TurntableContract):
    def make_firmware(self, plant: Plant) -> Firmware:
        return Plain(plant)

    def make_driver(self, port: str) -> Turntable:
        return TURNTABLES.make("template", port=port, **_FULL)


class TestBareTemplate(TurntableContract):
    def make_firmware(self, plant: Plant) -> Firmware:
        return Plain(plant)

    def make_driver(self, port: str) -> Turntable:
        return TURNTABLES.make("template", port=port, **_BARE)


def test_it_says_of_itself_what_the_board_answered(tmp_path: Path) -> None:
    with _connected(tmp_path, _FULL) as (table, _):
        assert table.facts.firmware == "I AM PLAIN 1"


def test_another_board_is_not_taken_for_it(tmp_path: Path) -> None:
    options = _FULL | {"hello_answer": "I AM FANCY", "answer_s": 0.3}
    with (
        pytest.raises(DeviceUnrecognised, match="as the template says"),
        _connected(tmp_path, options),
    ):
        pass


def test_what_the_board_complains_about_is_told(tmp_path: Path) -> None:
    options = _FULL | {"laser_on": "LAMP {channel}"}
    refused = pytest.raises(DeviceRefused, match=r"'WHAT\? LAMP' to 'LAMP 1'")
    with _connected(tmp_path, options) as (table, _), refused:
        table.set_laser(1, True)


def test_lines_of_the_start_are_sent_and_awaited(tmp_path: Path) -> None:
    with _connected(tmp_path, _FULL | {"init": ["LIGHT 2 OFF", "MOTOR ON"]}) as (_, emulator):
        assert plant_state(emulator).is_holding


def test_steps_may_be_asked_for_absolute_or_relative(tmp_path: Path) -> None:
    # This board counts degrees, so that a step is one.
    for word, relative in (("GO", False), ("TURN", True)):
        options = _FULL | {"move": word + " {steps} 90", "relative": relative, "steps_per_deg": 1.0}
        with _connected(tmp_path, options) as (table, emulator):
            for angle in (20.0, 35.0, 15.0):
                assert table.move_to(angle) == angle
                assert plant_state(emulator).angle_deg == pytest.approx(angle, abs=0.06)


def test_a_reset_while_it_stands_keeps_the_angle(tmp_path: Path) -> None:
    with _connected(tmp_path, _FULL) as (table, emulator):
        table.move_to(40.0)
        table.set_laser(2, True)
        emulator.reset()
        wait_until(lambda: not plant_state(emulator).outputs_on)
        reached = table.move_to(80.0)
        assert plant_state(emulator).angle_deg == pytest.approx(reached, abs=0.06)
        assert plant_state(emulator).outputs_on == {1}


def test_a_board_that_cannot_tell_where_it_stopped_says_so(tmp_path: Path) -> None:
    options = _FULL | {"where": "", "where_answer": ""}
    with _connected(tmp_path, options) as (table, emulator):
        assert not table.facts.can_stop
        table.start_turning(300.0, 30.0)
        wait_until(lambda: plant_state(emulator).angle_deg > 20.0)
        with pytest.raises(PositionUnknown) as told:
            table.stop()
        true = plant_state(emulator).angle_deg
        assert not plant_state(emulator).is_moving
        assert told.value.lowest_deg <= true <= told.value.highest_deg
        table.zero(true)
        assert table.angle_deg == true


def test_half_a_number_is_not_taken_for_the_position(tmp_path: Path) -> None:
    class Hesitant(Plain):
        def _obey(self, word: str, numbers: list[str]) -> Generator[float, None, str]:
            if word == "WHERE":
                self.say("AT 1")
                yield from self.sleep(1.0)
                return "2.000"
            return (yield from super()._obey(word, numbers))

    with _connected(tmp_path, _FULL, Hesitant) as (table, _):
        table.talk("HELLO")
        assert table._bearings.at == round(12.0 * 80.0 / 9.0)


@pytest.mark.parametrize(
    ("change", "field"),
    [
        ({"move": "GO {angel}"}, "'move' has a placeholder {angel}"),
        ({"move": "GO {angle.__class__}"}, "'move' has a placeholder"),
        ({"move": "GO {0}"}, "'move' has a placeholder"),
        ({"move": "GO {angle!r}"}, "'move' has a placeholder"),
        ({"move": "GO {}"}, "'move' has a placeholder"),
        ({"move": "GO {angle"}, "'move' has a bracket"),
        ({"move": "GO {{angle}}"}, "'move' has a bracket"),
        ({"move": "GO {speed}"}, "'move' lacks the placeholder"),
        ({"move": ""}, "'move' is missing"),
        ({"move": 5}, "'move' must be text"),
        ({"move": "GO {steps}", "steps_per_deg": 0.0}, "'steps_per_deg' must be given"),
        ({"move": "GO {angle} \N{SNOWMAN}"}, "'move' has a character"),
        ({"done": ""}, "'done' is missing"),
        ({"done": "("}, "'done' is not a regular expression"),
        ({"failed": "(?P<banner>x)"}, "'failed' is not a regular expression"),
        ({"laser_on": "LIGHT ON"}, "'laser_on' lacks the placeholder {channel}"),
        ({"laser_off": "LIGHT {number} OFF"}, "'laser_off' has a placeholder {number}"),
        ({"laser_off": ""}, "'laser_off' is missing"),
        ({"hello_answer": ""}, "'hello_answer' is missing"),
        ({"stop": "STOP {angle}"}, "'stop' has a placeholder {angle}"),
        ({"init": ["A {x}"]}, "'init' has a placeholder {x}"),
        ({"where_answer": "AT .*"}, "'where_answer' must have one pair"),
        ({"line_ending": "END"}, "'line_ending' cannot be"),
        ({"speed_deg_s": 0.0}, "'speed_deg_s' cannot be"),
        ({"answer_s": float("inf")}, "'answer_s' cannot be"),
        ({"decimals": 40}, "'decimals' must be"),
    ],
)
def test_a_template_that_cannot_work_is_refused_by_the_name_of_its_field(
    change: dict[str, object], field: str
) -> None:
    with pytest.raises(OptionError) as told:
        TemplateTable("nowhere", **(_FULL | change))  # type: ignore[arg-type]
    assert field in told.value.message
    assert told.value.message.count(".") <= 2


def test_numbers_are_written_as_boards_read_them() -> None:
    text = parse_template("move", r"G1 X{angle} F{speed}\x18", ("angle", "speed"))
    assert text.fill({"angle": -0.00001, "speed": 1e7}) == b"G1 X0 F10000000\x18"
    assert text.fill({"angle": -12.3456, "speed": 0.5}, 2) == b"G1 X-12.35 F0.5\x18"


@contextmanager
def _connected(
    folder: Path, options: dict[str, object], kind: type[Plain] = Plain
) -> Iterator[tuple[TemplateTable, EmulatedPort]]:
    with EmulatedPort(kind(Plant(Wiring(3200.0))), folder / "port", Clock(10.0)) as emulator:
        table = TemplateTable(str(emulator.link), **options)  # type: ignore[arg-type]
        table.connect()
        try:
            yield table, emulator
        finally:
            table.disconnect()
