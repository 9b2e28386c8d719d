"""Writes a recording that nobody took, with the truth beside it."""

import json
import os
from collections import deque
from collections.abc import Callable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from itertools import chain
from pathlib import Path

import numpy as np

from app.documents import Json
from app.files import write_whole
from app.recording.manifest import Header
from app.recording.picture import encode
from app.recording.reader import Recording
from app.recording.simulated_plan import SimulationPlan
from app.recording.simulated_stops import Stop, board_of, calibration_stops, scan_stops
from app.recording.simulated_truth import TRUTH_FILE, TRUTH_MESH_FILE, frame_truth, truth_document
from app.recording.writer import RecordingWriter
from app.simulation.render import Renderer, renderer_of

Progress = Callable[[int, int], None]
"""Called with the frames done and the frames in all."""


def simulate_recording(
    out: Path | str, plan: SimulationPlan, progress: Progress | None = None, workers: int | None = None
) -> Recording:
    """Write a recording, `truth.json` and, where there is a scan, `truth.stl` into a new folder.

    `truth.json` is a calibration file and can be used in place of one; its key `truth` holds the rest.

    Args:
        out: a folder that is new or empty.
        plan: what it shows.
        progress: told after every frame.
        workers: threads; as many as there are processors where not given.

    Raises:
        OutputError: the folder holds something, or the disk is full; nothing is left behind.
        OptionError: the plan cannot be carried out, such as a board that does not fit the picture.
    """
    plan = plan.as_set_up()
    stops = list(_stops(plan))
    total = sum(len(stop.takes) for stop in stops)
    writer = RecordingWriter.create(out, _header(plan, any(stop.has_board for stop in stops)))
    try:
        frames: list[Json] = []
        for stop, pictures in _rendered(stops, plan, workers or os.cpu_count() or 1):
            for take, data in zip(stop.takes, pictures, strict=True):
                entry = writer.append_encoded(
                    data, take.role, take.lasers_on, take.angle_deg, pose=take.pose, time_s=take.time_s
                )
                frames.append(frame_truth(entry.file, plan, stop))
                if progress is not None:
                    progress(len(frames), total)
        _write_truth(writer.folder, plan, frames)
        return writer.close()
    except BaseException:
        for name in (TRUTH_FILE, TRUTH_MESH_FILE):
            (writer.folder / name).unlink(missing_ok=True)
        writer.discard()
        raise


def _stops(plan: SimulationPlan) -> Iterator[Stop]:
    calibration = calibration_stops(plan) if "calibration" in plan.parts else iter(())
    return chain(calibration, scan_stops(plan) if "scan" in plan.parts else iter(()))


def _header(plan: SimulationPlan, has_board: bool) -> Header:
    return Header.of(
        plan.scanner.rig.camera.size,
        {name: source.colour for name, source in plan.scanner.sources.items()},
        direction=plan.direction,
        seconds_per_turn=plan.seconds_per_turn or None,
        board=board_of(plan) if has_board else None,
        platter=plan.platter,
        camera_name="simulated",
    )


def _rendered(stops: list[Stop], plan: SimulationPlan, workers: int) -> Iterator[tuple[Stop, list[bytes]]]:
    """Stops with their pictures, in order; only a few are made ahead, so memory stays flat."""
    first_frame = np.cumsum([0] + [len(stop.takes) for stop in stops])
    pending: deque[tuple[Stop, Future[list[bytes]]]] = deque()
    with ThreadPoolExecutor(workers, "simulation") as pool:
        try:
            for stop, number in zip(stops, first_frame, strict=False):
                renderer = renderer_of(stop.scene)
                pending.append((stop, pool.submit(_pictures, renderer, stop, plan, int(number))))
                if len(pending) > 2 * workers:
                    done, pictures = pending.popleft()
                    yield done, pictures.result()
            while pending:
                done, pictures = pending.popleft()
                yield done, pictures.result()
        finally:
            for _, pictures in pending:
                pictures.cancel()


def _pictures(renderer: Renderer, stop: Stop, plan: SimulationPlan, first_frame: int) -> list[bytes]:
    view = renderer.look(stop.angle_rad)
    pictures = []
    for number, take in enumerate(stop.takes, start=first_frame):
        seed = int(np.random.SeedSequence([plan.seed, number]).generate_state(1, np.uint64)[0])
        pictures.append(encode(renderer.expose(view, take.lasers_on, seed), plan.image_format, plan.quality))
    return pictures


def _write_truth(folder: Path, plan: SimulationPlan, frames: list[Json]) -> None:
    document = truth_document(plan, frames)
    write_whole(folder / TRUTH_FILE, (json.dumps(document, indent=1) + "\n").encode())
    if "scan" in plan.parts:
        surface = plan.item.mesh.moved(plan.table_from_item).as_trimesh()
        write_whole(folder / TRUTH_MESH_FILE, bytes(surface.export(file_type="stl")))
