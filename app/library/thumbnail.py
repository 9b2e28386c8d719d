"""A small square picture of a cloud, for lists."""

from pathlib import Path

import cv2
import numpy as np

from app.surface.preview import VIEWS, PreviewPainter, write_picture

SIDE_PX = 320


def paint_thumbnail(path: Path, painter: PreviewPainter) -> None:
    """The cloud from the front, as PNG.

    Raises:
        OutputError: it cannot be written.
    """
    front = painter.panel(VIEWS[0])
    small = cv2.resize(front, (SIDE_PX, SIDE_PX), interpolation=cv2.INTER_AREA)
    write_picture(path, small.astype(np.uint8))
