"""Many recordings: a bad one, a dead worker and an impatient person stop nothing that could go on."""

import csv
import os
import signal
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import psutil
import pytest
from command_line import copied, frame_of, replaced, rewritten, turnscan
from distributed import Client, LocalCluster

from app.batch.one import make_thing
from app.batch.order import BatchOrder
from app.batch.places import Task
from app.batch.result import Result, read_result
from app.batch.run import BatchPlan, run_batch
from app.batch.table import Row, write_tables
from app.recording.simulated import simulate_recording
from app.recording.simulated_plan import SimulationPlan, Views
from app.simulation.rig import standard_rig
from app.surface.finish import Finish, Preset, preset_mesh

_PATIENCE_S = 120.0
_REPEATED = 100


@pytest.fixture(scope="module")
def scan(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A ball in eight stops, 320 x 240, with pictures to calibrate from and the true calibration."""
    folder = tmp_path_factory.mktemp("batch") / "scan"
    views = Views(intrinsics=5, laser_plane=2, angles_deg=(-24.0, 0.0, 24.0))
    plan = SimulationPlan(scanner=standard_rig(320, 240), views=views, steps=8, texture_every=0)
    simulate_recording(folder, plan)
    return folder


def order_for(scan: Path) -> BatchOrder:
    """As the command makes it of `_OPTIONS`."""
    mesh = preset_mesh(Preset.MEASURE).model_copy(update={"cell_mm": 2.5})
    return BatchOrder(finish=Finish(preset=Preset.MEASURE, mesh=mesh), calibration=str(scan / "truth.json"))


_OPTIONS = ("--preset", "measure", "--detail", 2.5)


@dataclass
class Watched:
    """What was told; may do something when a recording of that name is worked on."""

    at: str = ""
    do: Callable[[], None] = lambda: None
    kept: int = -1
    ended_names: list[str] = field(default_factory=list)

    def found(self, kept: int, waiting: int) -> None:
        self.kept = kept

    def going(self, name: str, words: str, share: float) -> None:
        if name == self.at and words == "reconstructing":
            self.at = ""
            self.do()

    def ended(self, name: str, result: Result) -> None:
        self.ended_names.append(name)


def outcomes(rows: list[Row]) -> list[str]:
    return [row.outcome for row in rows]


def interrupt() -> None:
    raise KeyboardInterrupt


def kill_the_worker() -> None:
    for child in psutil.Process().children():
        with suppress(psutil.Error):
            if any("spawn_main" in word for word in child.cmdline()):
                child.kill()


def lengthened(recording: Path) -> None:
    """Make a copy so long that nobody is done with it.

    Its worker waits when it has told more than the line to it holds, which is nowhere as much, until somebody
    hears it: whatever is done when the first word of its stops is heard is done in their midst.
    """

    def repeat(document: dict[str, Any]) -> None:
        for frame in [each for each in document["frames"] if each["role"] == "scan"]:
            for number in range(_REPEATED):
                again = f"{frame['file']}-{number}.png"
                (recording / again).hardlink_to(recording / frame["file"])
                document["frames"].append(frame | {"file": again})

    rewritten(recording, repeat)


def test_a_batch_goes_on_past_a_bad_recording_and_a_dead_worker(scan: Path, tmp_path: Path) -> None:
    first, second, bad = tmp_path / "a" / "ball", tmp_path / "b" / "ball", tmp_path / "bad"
    copied(scan, first)
    copied(scan, second)
    lengthened(second)
    bad.mkdir()
    plan = BatchPlan(order_for(scan), tmp_path / "things")
    recordings = [first, bad, second, first / "recording.json"]
    with pytest.raises(KeyboardInterrupt):
        run_batch(recordings, plan, Watched("ball-2", interrupt))
    with (plan.out / "results.csv").open() as file:
        table = list(csv.DictReader(file))
    assert [(row["name"], row["outcome"]) for row in table] == [
        ("ball", "done"), ("bad", "failed"), ("ball-2", "not reached"),
    ], table  # fmt: skip
    assert "has no recording.json. Name a folder" in table[1]["said"]
    assert float(table[0]["x_mm"]) > 50.0
    assert not list(plan.out.rglob("*.part"))
    assert {path.name for path in (plan.out / "bad").iterdir()} == {"result.json"}
    made = read_result(plan.out / "ball")
    assert made is not None
    assert made.files == ("cloud.ply", "thumbnail.png", "thing.ply")
    assert all((plan.out / "ball" / name).stat().st_size for name in made.files)

    watched = Watched("ball-2", kill_the_worker)
    # The folder of the results may lie among the recordings.
    rows = run_batch([second, bad, plan.out, first], plan, watched)
    assert watched.kept == 1
    assert watched.ended_names == ["ball-2", "bad"]
    assert outcomes(rows) == ["failed", "failed", "done"]
    assert rows[0].result is not None
    assert "was ended by signal 9" in rows[0].result.problem
    left = read_result(plan.out / "ball-2")
    assert left is not None
    assert "broken off" in left.problem

    frame = frame_of(first, "scan")
    replaced(frame, b"no picture any more")
    kept = {path.name for path in (plan.out / "ball").iterdir()}
    first.rename(tmp_path / "elsewhere")
    assert outcomes(run_batch([first], plan, Watched())) == ["failed"]
    assert {path.name for path in (plan.out / "ball").iterdir()} == kept
    (tmp_path / "elsewhere").rename(first)
    replaced(second / "recording.json", (scan / "recording.json").read_bytes())
    ended = turnscan("batch", first, second, *_OPTIONS, "-c", scan / "truth.json", "--out", plan.out)
    assert ended.code == 2, ended.said
    assert {path.name for path in (plan.out / "ball").iterdir()} == {"result.json"}
    for words in ("Failed: ball:", "Made ball-2:", "2 recordings: 1 done, 1 failed.", "results.html"):
        assert words in ended.said
    assert 'src="data:image/jpeg;base64,' in (plan.out / "results.html").read_text()
    again = turnscan("batch", second, *_OPTIONS, "-c", scan / "truth.json", "--out", plan.out)
    assert "1 recording is done already" in again.said
    assert again.code == 0


@pytest.fixture(scope="module")
def cluster() -> Iterator[LocalCluster]:
    with LocalCluster(n_workers=2, threads_per_worker=1, dashboard_address=None) as cluster:
        yield cluster


# Dask warns where the disk is slow, as that of a busy machine may be.
@pytest.mark.filterwarnings("ignore:Creating scratch directories")
def test_a_cluster_ends_the_batch_when_one_of_two_workers_is_killed(
    scan: Path, tmp_path: Path, cluster: LocalCluster
) -> None:
    recordings = [copied(scan, tmp_path / name) for name in ("one", "two")]
    bad = tmp_path / "bad"
    plan = BatchPlan(order_for(scan), tmp_path / "things", scheduler=cluster.scheduler_address)
    killed: list[int] = []

    with Client(cluster.scheduler_address, set_as_default=False) as client:
        # Asked before there is work: busy workers answer late.
        pids = client.run(os.getpid)

        def kill_a_busy_worker() -> None:
            give_up = time.monotonic() + _PATIENCE_S
            while not killed and time.monotonic() < give_up:
                for address, work in client.processing().items():
                    if work and not killed:
                        os.kill(pids[address], signal.SIGKILL)
                        killed.append(pids[address])

        killer = threading.Thread(target=kill_a_busy_worker)
        killer.start()
        rows = run_batch([*recordings, bad], plan, Watched())
        killer.join(_PATIENCE_S)
    assert killed
    assert outcomes(rows) == ["done", "done", "failed"]


def test_a_recording_is_calibrated_from_its_own_pictures(scan: Path, tmp_path: Path) -> None:
    order = order_for(scan).model_copy(update={"calibration": ""})
    told: list[str] = []

    def made(recording: Path) -> Result:
        text = make_thing(
            str(recording),
            str(tmp_path / "thing"),
            order.model_dump_json(),
            lambda words, _: told.append(words),
        )
        return Result.model_validate_json(text)

    result = made(scan)
    assert not result.problem, result.problem
    assert result.files == ("calibration.json", "cloud.ply", "thumbnail.png", "thing.ply")
    assert any(words.startswith("calibrating") for words in told)
    scan_alone = copied(scan, tmp_path / "alone")
    rewritten(scan_alone, lambda document: document.update(frames=document["frames"][-16:]))
    assert "holds no pictures to calibrate from. Name a file with --calibration." in made(scan_alone).failure


def test_names_do_no_harm_in_the_tables(tmp_path: Path) -> None:
    evil = "=1+1<script>alert(1)"
    result = Result(recording=f"/archive/{evil}", problem=f"{evil} is bad", hint="Mend it.")
    write_tables(tmp_path, [Row(Task(Path("/archive") / evil, tmp_path / evil), result)])
    page = (tmp_path / "results.html").read_text()
    assert "<script" not in page
    assert "&lt;script&gt;" in page
    with (tmp_path / "results.csv").open() as file:
        row = next(iter(csv.DictReader(file)))
    assert row["name"].startswith("'=")
    assert row["outcome"] == "failed"


def test_wrong_wishes_are_refused_before_any_work(scan: Path, tmp_path: Path) -> None:
    for arguments, sentence in (
        (("--scheduler", "tcp://localhost:1", "--workers", 2), "contradict"),
        (("--detail", -1), "--detail cannot be -1"),
        (("--detector", "magic"), "magic"),
        (("-c", tmp_path / "no.json"), "no.json"),
    ):
        assert sentence in turnscan("batch", scan, "--out", tmp_path / "things", *arguments).sentence
    assert not (tmp_path / "things").exists()
