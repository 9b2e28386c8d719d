"""What one is in a file."""

from enum import StrEnum


class Unit(StrEnum):
    """In which the numbers of a file are."""

    MM = "mm"
    CM = "cm"
    M = "m"
    INCH = "inch"

    @property
    def per_mm(self) -> float:
        """By how much millimetres are multiplied."""
        return {Unit.MM: 1.0, Unit.CM: 0.1, Unit.M: 0.001, Unit.INCH: 1.0 / 25.4}[self]

    @property
    def word(self) -> str:
        """As 3MF spells it."""
        return {Unit.MM: "millimeter", Unit.CM: "centimeter", Unit.M: "meter", Unit.INCH: "inch"}[self]
