"""Where a table stands, as its driver keeps it: boards forget their count, and the table stands still."""

from app.errors import PositionUnknown


class Bearings:
    """The angle of a table, from the board's count and the angle of that count's zero.

    Attributes:
        device: what messages call the table.
        at: where it stands by the board's count: steps, units or degrees.
        per_deg: counts in a degree.
        origin_deg: the angle where the board counts 0.
        way: where the move under way began and where it ends, degrees; None while the table stands.
    """

    def __init__(self, device: str, per_deg: float = 1.0) -> None:
        self.device, self.per_deg = device, per_deg
        self.at, self.origin_deg = 0.0, 0.0
        self.way: tuple[float, float] | None = None
        self._doubt: tuple[float, float] | None = None

    @property
    def angle_deg(self) -> float:
        return self.degrees(self.at)

    def degrees(self, count: float) -> float:
        """The angle of a place that the board calls by a count."""
        return self.origin_deg + count / self.per_deg

    def nearest(self, angle_deg: float) -> int:
        """The whole count that is nearest to an angle."""
        return round((angle_deg - self.origin_deg) * self.per_deg)

    def reached(self, angle_deg: float) -> float:
        """The angle nearest to one where the table can stand."""
        return self.degrees(self.nearest(angle_deg))

    def set_out(self, goal: float) -> None:
        """The table leaves for a count."""
        self.way = (self.angle_deg, self.degrees(goal))

    def arrive(self, at: float) -> None:
        """It stands at a count."""
        self.at, self.way = at, None

    def count_anew(self, at: float = 0.0, per_deg: float | None = None) -> None:
        """The board calls the place where the table stands by another count, perhaps in another measure."""
        angle_deg = self.angle_deg
        self.at, self.per_deg = at, per_deg or self.per_deg
        self.origin_deg = angle_deg - at / self.per_deg

    def lose(self) -> None:
        """The board has lost the move under way: the table stands somewhere on it. Nothing where it stood."""
        self._doubt, self.way = self.way or self._doubt, None

    def lost(self) -> PositionUnknown:
        """The error that says so; the same every time, until somebody tells where the table stands."""
        self.lose()
        return PositionUnknown(self.device, *sorted(self._doubt or (self.angle_deg, self.angle_deg)))

    @property
    def is_known(self) -> bool:
        """Whether no move was lost since somebody told where the table stands."""
        return self._doubt is None

    def require_known(self) -> None:
        """Raise PositionUnknown from when a move was lost until somebody tells where the table stands."""
        if self._doubt is not None:
            raise self.lost()

    def tell(self, angle_deg: float) -> None:
        """Somebody knows: the place where the table stands is called by this angle."""
        shift = angle_deg - self.angle_deg
        self.origin_deg += shift
        self._doubt = None
        if self.way is not None:
            self.way = (self.way[0] + shift, self.way[1] + shift)
