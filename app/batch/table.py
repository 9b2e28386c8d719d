"""What became of every recording, as a table for programs (CSV) and for people (HTML with pictures)."""

import base64
import csv
import html
import io
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from urllib.parse import quote

import cv2

from app.batch.one import THUMBNAIL_FILE
from app.batch.places import Task
from app.batch.result import Outcome, Result
from app.files import write_whole

CSV_FILE, HTML_FILE = "results.csv", "results.html"
_PICTURE_PX, _PICTURE_QUALITY = 160, 80
_UNREACHED = "not reached"
_COLUMNS = (
    "name", "outcome", "points", "triangles", "x_mm", "y_mm", "z_mm", "volume_cm3", "expected_error_mm",
    "seconds", "said", "recording", "files",
)  # fmt: skip
# A spreadsheet takes text that begins so for a formula.
_FORMULA = ("=", "+", "-", "@", "\t", "\r")


@dataclass(frozen=True, slots=True)
class Row:
    """A recording and what became of it; None where it was not reached."""

    task: Task
    result: Result | None

    @property
    def outcome(self) -> str:
        return _UNREACHED if self.result is None else str(self.result.outcome)

    @property
    def said(self) -> list[str]:
        """Sentences, the gravest first."""
        if self.result is None:
            return []
        return [*filter(None, [self.result.failure]), *self.result.doubts, *self.result.notes]


def write_tables(out: Path, rows: Sequence[Row]) -> None:
    """`results.csv` and `results.html` in the folder.

    Raises:
        OutputError: they cannot be written.
    """
    write_whole(out / CSV_FILE, _csv(rows))
    write_whole(out / HTML_FILE, _page(rows))


def _csv(rows: Sequence[Row]) -> bytes:
    text = io.StringIO(newline="")
    table = csv.writer(text)
    table.writerow(_COLUMNS)
    for row in rows:
        result = row.result or Result(recording=str(row.task.recording))
        size = result.size_mm or (None, None, None)
        table.writerow(
            [
                _harmless(row.task.name), row.outcome, result.points, result.triangles, *map(_short, size),
                _short(result.volume_cm3), _short(result.expected_error_mm), _short(result.seconds or None),
                _harmless(" ".join(row.said)), _harmless(result.recording), " ".join(result.files),
            ]
        )  # fmt: skip
    return text.getvalue().encode("utf-8", "replace")


def _harmless(text: str) -> str:
    return f"'{text}" if text.startswith(_FORMULA) else text


def _short(number: float | None) -> str:
    return "" if number is None else f"{number:.3f}"


def _page(rows: Sequence[Row]) -> bytes:
    counts = [f"{sum(row.outcome == name for row in rows)} {name}" for name in (*Outcome, _UNREACHED)]
    body = "".join(map(_row, rows))
    return f"""<!doctype html>
<html lang=en><meta charset=utf-8><meta name=viewport content="width=device-width">
<title>Results</title>
<style>
:root {{ color-scheme: light dark }}
body {{ font: 16px/1.5 system-ui, sans-serif; margin: 2rem auto; max-width: 75rem; padding: 0 1rem }}
td, th {{ padding: .4rem .8rem .4rem 0; text-align: left; vertical-align: top }}
td {{ font-variant-numeric: tabular-nums; border-top: 1px solid #8884 }}
td:nth-child(4) {{ white-space: nowrap }}
img {{ background: white; border-radius: 6px; display: block }}
p {{ margin: 0 }} .doubtful, .failed {{ font-weight: bold; color: #c0392b }}
</style>
<h1>{len(rows)} recordings</h1>
<p>{", ".join(counts)}
<table><tr><th><th>name<th>outcome<th>size, mm<th>points<th>triangles<th>files<th>what was said</tr>
{body}</table>
</html>
""".encode("utf-8", "replace")


def _row(row: Row) -> str:
    result = row.result or Result(recording=str(row.task.recording))
    name = html.escape(row.task.name)
    size = "" if result.size_mm is None else " x ".join(f"{side:.1f}" for side in result.size_mm)
    files = "<br>".join(
        f'<a href="{html.escape(_link(row.task, file))}">{html.escape(file)}</a>' for file in result.files
    )
    said = "".join(f"<p>{html.escape(sentence)}" for sentence in row.said)
    return (
        f'<tr><td>{_picture(row)}<td title="{html.escape(result.recording)}">{name}'
        f'<td class="{row.outcome}">{row.outcome}<td>{size}<td>{_count(result.points)}'
        f"<td>{_count(result.triangles)}<td>{files}<td>{said}</tr>\n"
    )


def _link(task: Task, file: str) -> str:
    """From the table beside the folders."""
    return "./" + quote(f"{task.name}/{file}".encode("utf-8", "surrogateescape"))


def _count(number: int | None) -> str:
    return "" if number is None else f"{number:,}"


def _picture(row: Row) -> str:
    """The thumbnail, smaller, within the page; nothing where there is none."""
    if row.result is None or THUMBNAIL_FILE not in row.result.files:
        return ""
    image = cv2.imread(str(row.task.folder / THUMBNAIL_FILE))
    if image is None:
        return ""
    small = cv2.resize(image, (_PICTURE_PX, _PICTURE_PX), interpolation=cv2.INTER_AREA)
    data = cv2.imencode(".jpg", small, [cv2.IMWRITE_JPEG_QUALITY, _PICTURE_QUALITY])[1]
    encoded = base64.b64encode(data.tobytes()).decode()
    return f'<img alt="" width={_PICTURE_PX} height={_PICTURE_PX} src="data:image/jpeg;base64,{encoded}">'
