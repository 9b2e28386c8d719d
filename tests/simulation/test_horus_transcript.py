"""The Horus emulator against what the true firmware said, row by row, in virtual time."""

import pprint

from transcripts import Player, Setting, read_transcript

from app.simulation.firmware.dialects.horus import Horus
from app.simulation.firmware.plant import Plant, Wiring

# Moves that the table leaves out, and how long each had been under way. By the row's request and note.
_MOVING = {
    ("?", "while moving (answered at once)"): Setting(((b"G1F30X60\n", 0.390),), quiet_s=0.57),
    ("!", ""): Setting(((b"G1F30X0\n", 0.378),)),
    ("\\x18", "reset while moving"): Setting(((b"M71T1\nG1F30X60\n", 0.447),)),
}


def test_every_recorded_row_is_reproduced() -> None:
    player = Player(Horus(Plant(Wiring(3200.0)), is_blank=True))
    rows = read_transcript("horus-fw 0.2")
    wrong = {}
    for row in rows:
        difference = player.play(row, _MOVING.get((row.text, row.note))).differences(row)
        if difference:
            wrong[f"line {row.line}: {row.text}"] = difference
    assert not wrong, pprint.pformat(wrong, width=180)
    assert len(rows) > 70
