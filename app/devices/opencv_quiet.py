"""OpenCV and FFmpeg without their talk on the terminal: what they would say becomes a sentence of ours.

They would also print addresses with the passwords in them.
"""

import contextlib
import os
from collections.abc import Iterator

import cv2


@contextlib.contextmanager
def opencv_quiet() -> Iterator[None]:
    os.environ.setdefault("OPENCV_FFMPEG_LOGLEVEL", "-8")
    level = cv2.utils.logging.setLogLevel(cv2.utils.logging.LOG_LEVEL_SILENT)
    try:
        yield
    finally:
        cv2.utils.logging.setLogLevel(level)
