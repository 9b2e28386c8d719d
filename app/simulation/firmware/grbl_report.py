"""What Grbl tells in some of its status reports only."""

from collections.abc import Sequence

# A busy board tells the offset in every thirtieth report and the overrides in every twentieth.
_BUSY_OFFSET, _BUSY_OVERRIDE, _IDLE = 29, 19, 9


class RareFields:
    """Counts reports, and says with which of them offset and overrides come."""

    def __init__(self) -> None:
        self._until_offset = self._until_override = 0

    def tell_offset(self) -> None:
        """It has changed, and comes with the next report."""
        self._until_offset = 0

    def take(self, offset: Sequence[float], accessories: str, *, is_busy: bool) -> list[str]:
        """The fields of one more report.

        Args:
            offset: of the work's coordinates on each axis.
            accessories: letters of what is on.
            is_busy: the board reports more often then.
        """
        fields = []
        if self._until_offset > 0:
            self._until_offset -= 1
        else:
            self._until_offset = _BUSY_OFFSET if is_busy else _IDLE
            self._until_override = self._until_override or 1
            fields.append("WCO:" + ",".join(f"{value:.3f}" for value in offset))
        if self._until_override > 0:
            self._until_override -= 1
        else:
            self._until_override = _BUSY_OVERRIDE if is_busy else _IDLE
            fields.append("Ov:100,100,100")
            fields += [f"A:{accessories}"] if accessories else []
        return fields
