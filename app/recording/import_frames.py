"""Make a recording from pictures that somebody took: `turnscan import`."""

from collections import Counter
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

from app.documents import compose
from app.errors import ImportFailed, RecordingError
from app.recording.import_plan import ImportPlan, Layout, lay_out
from app.recording.manifest import Header
from app.recording.period import TurnLength
from app.recording.picture_folder import PictureFolder
from app.recording.reader import Recording
from app.recording.survey import PictureSource, Progress, Skipped, Survey
from app.recording.video import Video
from app.recording.writer import RecordingWriter, refuse_taken

_MERGE_HINT = "Import these pictures into a recording of their own."


@dataclass(frozen=True, eq=False, slots=True)
class ImportReport:
    """What became of the pictures.

    Attributes:
        source: name of the folder or video.
        recording: the recording, closed.
        written: how many pictures went into it now.
        skipped: those that could not be used.
        repeated: frames of a padded video that only repeat the one before them.
        stride: frames of a padded video for each picture of the camera; 1 elsewhere.
        idle: pictures of a table that did not turn steadily yet, or any more.
        turn: length of a turn in pictures, where it had to be found; None otherwise.
        step_deg: angle from picture to picture; NaN where there are no angles.
    """

    source: str
    recording: Recording
    written: int
    skipped: tuple[Skipped, ...]
    repeated: int
    stride: float
    idle: int
    turn: TurnLength | None
    step_deg: float

    def sentences(self) -> tuple[str, ...]:
        """The report for a person, skipped pictures not named."""
        said = [f"{self.written} pictures of {self.source} went into {self.recording.folder}."]
        if self.repeated:
            said.append(f"{self.repeated} frames only repeat the one before them and were left out.")
        if self.turn is not None:
            raw = f", {self.turn.frames * self.stride:.0f} frames of the video," if self.repeated else ""
            said.append(
                f"One turn is {self.turn.frames:.2f} +- {self.turn.sigma_frames:.2f} pictures{raw} as the "
                f"pictures themselves tell; they show {self.turn.turns:.2f} turns."
            )
        if self.idle:
            said.append(f"{self.idle} pictures show the table before or after it turned steadily.")
        if self.skipped:
            said.append(f"{len(self.skipped)} pictures could not be used.")
        return tuple(said)


def import_pictures(
    source: Path | str,
    out: Path | str,
    plan: ImportPlan,
    *,
    is_added: bool = False,
    progress: Progress = lambda done, total: None,
) -> ImportReport:
    """Make a recording of a folder of pictures or a video file, or add them to one that is there.

    Nothing is left behind when it fails or is interrupted.

    Args:
        source: folder or video.
        out: folder of the recording.
        plan: what the pictures mean.
        is_added: to the recording at `out`, where there is one.
        progress: called while looking through the pictures and again while writing them.

    Raises:
        ImportFailed: the source cannot be read, or the length of a turn is neither given nor found.
        OptionError: the plan contradicts itself.
        RecordingError: the pictures do not fit the recording they are added to.
        OutputError: the recording cannot be written.
    """
    plan.check()
    pictures = open_source(Path(source), plan)
    there = _existing(Path(out)) if is_added else None
    if there is None:
        refuse_taken(Path(out))
    survey = pictures.survey(progress)
    layout = lay_out(survey, plan, pictures.name, 0 if there is None else _next_pose(there))
    if not layout.placed:
        raise ImportFailed(f"{source}: no picture is left to import.")
    header = _header(survey, plan, there)
    writer = RecordingWriter.create(out, header) if there is None else RecordingWriter.resume(out, header)
    try:
        _write(writer, pictures, layout, progress)
        recording = writer.close()
    except BaseException:
        writer.discard()
        raise
    return ImportReport(
        pictures.name, recording, len(layout.placed), survey.skipped, survey.repeated, survey.stride,
        layout.idle, layout.turn, _step_deg(layout),
    )  # fmt: skip


def open_source(path: Path, plan: ImportPlan) -> PictureSource:
    """The folder or video at a path.

    Raises:
        ImportFailed: there is neither.
    """
    if path.is_dir():
        return PictureFolder(path, plan.order)
    if path.is_file():
        return Video(path, plan.image_format, plan.quality)
    raise ImportFailed(f"{path}: there is no such folder or video file.")


def _write(writer: RecordingWriter, pictures: PictureSource, layout: Layout, progress: Progress) -> None:
    total, written = len(layout.placed), 0
    # Times of two sources are of two clocks, and a recording has one.
    has_clock = all(entry.time_s is None for entry in writer.entries)
    files = pictures.read([placed.index for placed in layout.placed])
    for placed, data in zip(layout.placed, files, strict=False):
        time_s = placed.time_s if has_clock else None
        writer.append_encoded(
            data, placed.role, placed.lasers_on, placed.angle_deg, pose=placed.pose, time_s=time_s
        )
        written += 1
        progress(written, total)
    if written < total:
        raise ImportFailed(f"{pictures.name} gave {written} pictures where it had {total} before.")


def _existing(out: Path) -> Recording | None:
    return Recording.open(out) if out.is_dir() and any(out.iterdir()) else None


def _next_pose(recording: Recording) -> int:
    return max((entry.pose for entry in recording.entries if entry.pose is not None), default=-1) + 1


def _header(survey: Survey, plan: ImportPlan, there: Recording | None) -> Header:
    """The header for the pictures, joined with that of the recording they are added to."""
    new = Header.of(
        survey.size, plan.lasers, direction=plan.direction or "ccw", board=plan.board, platter=plan.platter
    )
    if there is None:
        return new
    where = str(there.folder)
    if survey.size != there.camera_size:
        raise RecordingError(
            where,
            f"has pictures of {there.camera_size[0]} x {there.camera_size[1]} pixels, "
            f"the new ones are {survey.size[0]} x {survey.size[1]}",
            _MERGE_HINT,
        )
    document = there.manifest.as_json()
    del document["frames"]
    lasers = there.lasers
    for name, colour in plan.lasers.items():
        if lasers.get(name, colour) != colour:
            raise RecordingError(where, f"has {name!r} as a {lasers[name]} laser, not {colour}", _MERGE_HINT)
    document["lasers"] = document.get("lasers", []) + [
        laser.as_json() for laser in new.lasers if laser.name not in lasers
    ]
    for key, mine, theirs in (
        ("board", plan.board, there.board),
        ("platter", plan.platter, there.platter),
    ):
        if mine is not None and theirs is not None and mine != theirs:
            raise RecordingError(where, f"has another {key}", _MERGE_HINT)
        if mine is not None:
            document[key] = new.as_json()[key]
    if plan.direction not in (None, there.direction) and any(e.angle_deg is not None for e in there.entries):
        raise RecordingError(
            where, f"has a table that turns {there.direction}, not {plan.direction}", _MERGE_HINT
        )
    document["turntable"] = document.get("turntable", {}) | {"direction": plan.direction or there.direction}
    return compose(Header, document, where, RecordingError)


def _step_deg(layout: Layout) -> float:
    """The commonest step between neighbouring angles that differ."""
    angles = sorted({placed.angle_deg for placed in layout.placed if placed.angle_deg is not None})
    steps = Counter(round(after - before, 9) for before, after in pairwise(angles))
    return steps.most_common(1)[0][0] if steps else float("nan")
