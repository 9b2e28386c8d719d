"""Which part of a thing is measured."""

from app.errors import OptionError
from app.surface.step import Step
from app.surface.steps.box import Box
from app.surface.steps.cylinder import Cylinder

_FORMS = "Write box:X1,Y1,Z1,X2,Y2,Z2 or cylinder:RADIUS,BOTTOM,TOP or cylinder:RADIUS,BOTTOM,TOP,X,Y, in mm."


def parse_region(text: str) -> Step:
    """A part in one word: `box:X1,Y1,Z1,X2,Y2,Z2` or `cylinder:RADIUS,BOTTOM,TOP[,X,Y]`, mm.

    Raises:
        OptionError: it is not of that form.
    """
    kind, _, rest = text.partition(":")
    try:
        numbers = [float(part) for part in rest.split(",")]
    except ValueError:
        raise OptionError(f"{text!r} does not describe a part.", _FORMS) from None
    match kind, numbers:
        case "box", [x1, y1, z1, x2, y2, z2]:
            low = (min(x1, x2), min(y1, y2), min(z1, z2))
            return Box(low=low, high=(max(x1, x2), max(y1, y2), max(z1, z2)))
        case "cylinder", [radius, bottom, top] if radius > 0.0:
            return Cylinder(radius_mm=radius, bottom_mm=bottom, top_mm=top)
        case "cylinder", [radius, bottom, top, x, y] if radius > 0.0:
            return Cylinder(radius_mm=radius, bottom_mm=bottom, top_mm=top, centre_mm=(x, y))
    raise OptionError(f"{text!r} does not describe a part.", _FORMS)
