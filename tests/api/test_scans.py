"""The library over HTTP: what goes out, what comes in, and what is turned away without a trace."""

import io
import json
import os
import stat
import struct
import threading
import zipfile
from collections.abc import Callable, Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any
from urllib.parse import quote

import cv2
import numpy as np
import pytest
from fastapi.testclient import TestClient
from starlette.concurrency import run_in_threadpool
from starlette.requests import ClientDisconnect

from app.api.versioned import API
from app.devices.bench_file import simulated_description
from app.geometry.cloud import PointCloud
from app.library.library import Library
from app.main import create_app
from app.recording.manifest import Header
from app.recording.shot import Role
from app.recording.writer import RecordingWriter
from app.settings import Settings
from app.surface.ply import write_ply
from app.surface.ply_reader import read_ply

SCANS = f"{API}/scans"
_SIZE = (64, 48)
_JSON = {"content-type": "application/json"}


@pytest.fixture(scope="module")
def client(tmp_path_factory: pytest.TempPathFactory) -> Iterator[TestClient]:
    description = simulated_description("horus", object="sphere", width=320, height=240)
    application = create_app(Settings(tmp_path_factory.mktemp("server"), "simulated"), description)
    with TestClient(application, base_url="http://localhost") as client:
        yield client


@pytest.fixture
def library(client: TestClient) -> Iterator[Library]:
    """The server's own, empty afterwards."""
    library: Library = client.app.state.services.library  # type: ignore[attr-defined]
    limit = library.upload_bytes
    yield library
    library.upload_bytes = limit
    assert [path.name for path in (library.folder / ".work").glob("*")] == []
    for item in library.scans():
        library.delete(item.name)
    library.empty()


def make_cloud(points: int, radius: float = 30.0) -> PointCloud:
    random = np.random.default_rng(points)
    normals = random.normal(size=(points, 3)).astype(np.float32)
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    return PointCloud(
        radius * normals, normals, np.full((points, 3), 200, np.uint8), np.full(points, 0.1, np.float32),
        np.zeros(points, np.uint8), np.zeros(points, np.float32), np.ones(points, np.float32), ("left",),
    )  # fmt: skip


def make_scan(library: Library, title: str = "Mug", points: int = 0, radius: float = 30.0) -> str:
    """Six pictures, each of another grey, and a cloud if wanted."""
    folder = library.reserve(title)
    with RecordingWriter.create(folder, Header.of(_SIZE, {"left": "red"})) as writer:
        for number in range(6):
            image = np.full((_SIZE[1], _SIZE[0], 3), 40 * number, np.uint8)
            lasers = ("left",) if number % 2 == 0 else ()
            role = Role.SCAN if lasers else Role.BACKGROUND
            writer.append_encoded(cv2.imencode(".png", image)[1].tobytes(), role, lasers, 60.0 * number)
    if points:
        write_ply(folder / "cloud.ply", make_cloud(points, radius))
    library.rename(folder.name, title)
    return folder.name


def zipped(files: dict[str, bytes], kind: int = zipfile.ZIP_STORED) -> bytes:
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w", kind) as archive:
        for name, data in files.items():
            archive.writestr(name, data)
    return buffer.getvalue()


def files_of(folder: Path, *without: str) -> dict[str, bytes]:
    return {
        path.relative_to(folder).as_posix(): path.read_bytes()
        for path in folder.rglob("*")
        if path.is_file() and path.name not in without
    }


def check_problem(answer: Any, status: int, kind: str, said: str = "") -> None:
    assert answer.status_code == status, answer.text
    assert answer.headers["content-type"] == "application/problem+json"
    problem = answer.json()
    assert problem["type"].startswith(f"turnscan:{kind}"), problem
    assert said in problem["title"], problem


def test_a_scan_that_was_sent_to_another_server_is_the_same_there(
    client: TestClient, library: Library
) -> None:
    name = make_scan(library, "Grüne Tasse", 500)
    sent = client.get(f"{SCANS}/{name}/recording.zip")
    assert int(sent.headers["content-length"]) == len(sent.content)
    assert (
        "filename=\"Grune Tasse.zip\"; filename*=UTF-8''Gr%C3%BCne%20Tasse.zip"
        in sent.headers["content-disposition"]
    )
    head = client.head(f"{SCANS}/{name}/recording.zip")
    assert (head.headers["content-length"], head.content) == (sent.headers["content-length"], b"")
    before = files_of(library.folder / name, "log.txt")
    came = client.post(f"{SCANS}/upload?file=C:\\tmp\\tasse.zip", content=sent.content)
    assert came.status_code == 201
    assert (came.json()["title"], came.json()["name"]) == ("Grüne Tasse", f"{name}-2")
    after = files_of(library.folder / f"{name}-2", "log.txt", "cloud.png")
    assert after == before
    assert "Taken in from tasse.zip." in client.get(f"{SCANS}/{name}-2/log").json()[0]


def test_clouds_go_out_as_they_are_as_text_and_in_parts(
    client: TestClient, library: Library, tmp_path: Path
) -> None:
    name = make_scan(library, 'A "ball"/..', 20_000)
    cloud = client.get(f"{SCANS}/{name}").json()["clouds"][0]
    whole = client.get(cloud["path"])
    assert len(whole.content) == cloud["size_bytes"] == int(whole.headers["content-length"])
    assert 'filename="A ball.ply"' in whole.headers["content-disposition"]
    (tmp_path / "text.ply").write_bytes(client.get(f"{cloud['path']}?form=ascii").content)
    text, kept = read_ply(tmp_path / "text.ply"), read_ply(library.folder / name / "cloud.ply")
    assert (tmp_path / "text.ply").read_bytes().startswith(b"ply\nformat ascii")
    assert np.array_equal(text.points, kept.points)
    assert client.get(f"{SCANS}/{name}/cloud.ply?form=binary").content == whole.content
    part = client.get(cloud["path"], headers={"Range": "bytes=100-199"})
    assert (part.status_code, part.content) == (206, whole.content[100:200])
    rest = {"Range": "bytes=100-", "If-Range": whole.headers["etag"]}
    assert client.get(cloud["path"], headers=rest).content == whole.content[100:]
    assert client.get(cloud["path"], headers=rest | {"If-Range": '"old"'}).content == whole.content
    again = client.get(cloud["path"], headers={"If-None-Match": whole.headers["etag"]})
    assert (again.status_code, again.content) == (304, b"")
    head = client.head(cloud["path"])
    assert (head.headers["content-length"], head.content) == (str(cloud["size_bytes"]), b"")
    assert client.get(cloud["path"], headers={"Range": "bytes=9999999-"}).status_code == 416
    check_problem(client.get(f"{SCANS}/{name}/clouds/other.ply"), 404, "not-there", "other.ply")
    check_problem(client.get(f"{SCANS}/{name}/cloud.ply?form=purple"), 422, "invalid", "form")


def test_one_cloud_is_erased_and_the_recording_beside_it_is_not(client: TestClient, library: Library) -> None:
    name = make_scan(library)
    folder = library.folder / name
    write_ply(folder / "recording.ply", make_cloud(10))
    (folder / "clouds").mkdir()
    write_ply(folder / "clouds" / "recording.ply", make_cloud(20))
    (folder / "clouds" / "recording.json").write_text("{}")
    paths = {each["points"]: each["path"] for each in client.get(f"{SCANS}/{name}").json()["clouds"]}
    assert {points: read_points(client, path) for points, path in paths.items()} == {10: 10, 20: 20}
    assert client.delete(paths[20]).json()["freed_bytes"] > 2
    assert list((folder / "clouds").iterdir()) == []
    assert client.delete(paths[10]).status_code == 200
    assert (folder / "recording.json").exists()
    check_problem(client.delete(paths[10]), 404, "not-there")
    alone = client.post(f"{SCANS}/upload?title=x", content=(ply_bytes(5))).json()
    check_problem(client.delete(alone["clouds"][0]["path"]), 400, "library", "nothing but this cloud")


def read_points(client: TestClient, path: str) -> int:
    head = client.get(path).content[:400].decode("ascii", "replace")
    return int(head.partition("element vertex ")[2].split()[0])


def ply_bytes(points: int) -> bytes:
    buffer = io.BytesIO()
    write_ply(buffer, make_cloud(points))
    return buffer.getvalue()


def test_pictures_are_listed_page_by_page_and_shown_large_and_small(
    client: TestClient, library: Library
) -> None:
    name = make_scan(library)
    listed = client.get(f"{SCANS}/{name}/pictures?start=1&count=2").json()
    assert (listed["total"], listed["width"], listed["height"]) == (6, *_SIZE)
    assert [(each["number"], each["angle_deg"]) for each in listed["pictures"]] == [(1, 60.0), (2, 120.0)]
    lit = client.get(f"{SCANS}/{name}/pictures?role=scan").json()["pictures"]
    assert [(each["number"], each["lasers_on"]) for each in lit] == [(n, ["left"]) for n in (0, 2, 4)]
    whole = client.get(f"{SCANS}/{name}/pictures/4")
    assert whole.headers["content-type"] == "image/png"
    assert shape(whole.content) == (48, 64, 160)
    small = client.get(f"{SCANS}/{name}/pictures/4?width=32")
    assert small.headers["content-type"] == "image/jpeg"
    assert shape(small.content) == (24, 32, 160)
    tag = {"If-None-Match": small.headers["etag"]}
    assert client.get(f"{SCANS}/{name}/pictures/4?width=32", headers=tag).status_code == 304
    assert client.get(f"{SCANS}/{name}/pictures/4?width=40", headers=tag).status_code == 200
    thumbnail = client.get(f"{SCANS}/{name}/thumbnail.png")
    assert client.get(f"{SCANS}/{name}").json()["has_thumbnail"]
    assert shape(thumbnail.content) == (48, 64, 120)
    tag = {"If-None-Match": thumbnail.headers["etag"]}
    assert client.get(f"{SCANS}/{name}/thumbnail.png", headers=tag).status_code == 304
    check_problem(client.get(f"{SCANS}/{name}/pictures/6"), 404, "not-there", "no picture 6")
    (library.folder / name / "frames" / "000004.png").write_bytes(b"no picture")
    check_problem(client.get(f"{SCANS}/{name}/pictures/4?width=32"), 422, "frame")
    alone = client.post(f"{SCANS}/upload", content=ply_bytes(5)).json()["name"]
    check_problem(client.get(f"{SCANS}/{alone}/pictures"), 404, "not-there", "no pictures")


def shape(data: bytes) -> tuple[int, int, int]:
    """Height, width and grey in the middle of a picture."""
    image = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_GRAYSCALE)
    assert image is not None
    return image.shape[0], image.shape[1], int(image[image.shape[0] // 2, image.shape[1] // 2])


def test_the_bin_is_erased_only_as_it_was_seen(client: TestClient, library: Library) -> None:
    names = [make_scan(library, f"Number {number}") for number in range(3)]
    keys = [client.delete(f"{SCANS}/{name}").json()["key"] for name in names]
    listed = {each["key"]: each for each in client.get(f"{SCANS}/bin").json()}
    assert set(listed) == set(keys)
    assert listed[keys[0]]["title"] == "Number 0"
    space = client.get(f"{SCANS}/space").json()
    assert space["bin_bytes"] == sum(each["frees_bytes"] for each in listed.values())
    assert space["used_bytes"] == 0 < space["free_bytes"]
    check_problem(client.delete(f"{SCANS}/bin"), 422, "invalid", "frees")
    check_problem(client.delete(f"{SCANS}/bin?frees=1"), 409, "bin-changed")
    frees = listed[keys[0]]["frees_bytes"]
    erased = client.delete(f"{SCANS}/bin/{keys[0]}?frees={frees}").json()
    assert erased == {"scans": 1, "freed_bytes": frees}
    check_problem(client.delete(f"{SCANS}/bin/{keys[0]}?frees={frees}"), 404, "scan-not-found")
    assert client.post(f"{SCANS}/bin/{keys[1]}/restore").json()["name"] == names[1]
    left = client.get(f"{SCANS}/space").json()["bin_bytes"]
    assert client.delete(f"{SCANS}/bin?frees={left}").json() == {"scans": 1, "freed_bytes": left}
    assert client.get(f"{SCANS}/bin").json() == []


def test_documents_of_a_scan_are_shown_and_others_are_not(
    client: TestClient, library: Library, tmp_path: Path
) -> None:
    name = make_scan(library, points=5)
    assert client.get(f"{SCANS}/{name}/recording.json").json()["format"] == "turnscan-recording"
    assert client.get(f"{SCANS}/{name}/about.json").json()["title"] == "Mug"
    check_problem(client.get(f"{SCANS}/{name}/calibration.json"), 404, "not-there")
    check_problem(client.get(f"{SCANS}/{name}/secret.json"), 422, "invalid")
    check_problem(client.get(f"{SCANS}/{name}/made/cloud.ply"), 404, "not-there", "Nobody wrote down")
    (tmp_path / "passwords").write_text("secret")
    (library.folder / name / "scan.json").symlink_to(tmp_path / "passwords")
    (library.folder / name / "log.txt").unlink(missing_ok=True)
    (library.folder / name / "log.txt").symlink_to(tmp_path / "passwords")
    check_problem(client.get(f"{SCANS}/{name}/scan.json"), 404, "not-there")
    assert client.get(f"{SCANS}/{name}/log").json() == []
    for inside in ("scan.json", "log.txt"):
        (library.folder / name / inside).unlink()
    (library.folder / "away").symlink_to(tmp_path, target_is_directory=True)
    check_problem(client.get(f"{SCANS}/away"), 404, "scan-not-found")
    (library.folder / "away").unlink()


NAMES = [
    "..",
    ".work",
    "a/b",
    "/etc",
    "C:\\x",
    "a\x00b",
    "a\\..\\b",
    "\u202e",
    "ü" * 200,
    "x" * 5000,
    "%2e%2e",
]
WAYS = [
    "", "/log", "/cloud.ply", "/clouds/cloud.ply", "/made/x.ply", "/thumbnail.png", "/recording.zip",
    "/scan.json", "/pictures", "/pictures/0", "/compare/mug",
]  # fmt: skip


def test_names_that_lead_elsewhere_are_no_scans(client: TestClient, library: Library) -> None:
    make_scan(library, points=5)
    outside = ["mug/clouds/../recording.json", "mug/clouds/recording.json", "mug/clouds//etc/passwd"]
    for name in NAMES:
        ways = [("GET", f"{name}{way}") for way in WAYS]
        ways += [("GET", f"mug/{way}/{name}") for way in ("clouds", "made", "compare")]
        ways += [("DELETE", name), ("PATCH", name), ("POST", f"bin/{name}/restore")]
        for method, path in ways:
            status, said = asked(client, method, f"{SCANS}/{path}", body=[b"{}"], headers=_JSON)
            assert status in (404, 405), (method, path, said)
            assert b"turnscan:" in said
        erased = client.delete(f"{SCANS}/bin/{quote(name, safe='')}?frees=0")
        assert erased.status_code in (404, 405), (name, erased.text)
    for path in outside:
        assert asked(client, "GET", f"{SCANS}/{path}")[0] == 404


def test_a_download_outlives_the_deletion_and_lets_go_when_it_is_broken_off(
    client: TestClient, library: Library
) -> None:
    name = make_scan(library)
    expected = client.get(f"{SCANS}/{name}/recording.zip").content
    (library.folder / name / "frames" / "000000.png").write_bytes(os.urandom(3 << 20))
    taken: list[bytes] = []

    def deleted(data: bytes) -> None:
        if not taken:
            library.delete(name)
        taken.append(data)

    assert asked(client, "GET", f"{SCANS}/{name}/recording.zip", on_body=deleted)[0] == 200
    assert zipfile.ZipFile(io.BytesIO(b"".join(taken))).testzip() is None
    assert len(b"".join(taken)) > len(expected)
    library.restore(name)

    def broken_off(data: bytes) -> None:
        if data:
            raise OSError("the client is gone")

    for path in (f"{SCANS}/{name}/recording.zip", f"{SCANS}/{name}/pictures/0"):
        with pytest.raises((OSError, ClientDisconnect)):
            asked(client, "GET", path, on_body=broken_off)
        assert open_files(library.folder) == []


def test_what_is_too_much_is_refused_before_and_while_it_comes(client: TestClient, library: Library) -> None:
    library.upload_bytes = 3_000_000
    check_problem(client.post(f"{SCANS}/upload", content=bytes(3_000_001)), 413, "too-large", "3.0 MB")
    sent = 0

    def endless() -> Iterator[bytes]:
        nonlocal sent
        while True:
            sent += 1 << 20
            yield bytes(1 << 20)

    status, said = asked(client, "POST", f"{SCANS}/upload", body=endless())
    assert (status, sent) == (413, 3 << 20)
    assert b"too-large" in said
    library.upload_bytes = 1 << 60
    promised = {"content-length": str(1 << 50)}
    status, said = asked(client, "POST", f"{SCANS}/upload", body=iter([b""]), headers=promised)
    assert status == 507, said
    assert b"no room" in said


def test_an_upload_that_breaks_off_leaves_nothing(client: TestClient, library: Library) -> None:
    whole = ply_bytes(100_000)
    status, said = asked(client, "POST", f"{SCANS}/upload", body=iter([whole[:2_500_000]]), is_whole=False)
    assert status == 422, said
    assert b"broke off" in said
    assert library.scans() == ()
    assert [path.name for path in (library.folder / ".work").glob("*")] == []


def test_two_uploads_at_once_become_two_scans(client: TestClient, library: Library) -> None:
    data = ply_bytes(1000)
    middle = threading.Barrier(2)

    def halves() -> Iterator[bytes]:
        yield data[:500]
        middle.wait(60.0)
        yield data[500:]

    found: list[int] = []
    threads = [
        threading.Thread(
            target=lambda: found.append(asked(client, "POST", f"{SCANS}/upload", body=halves())[0])
        )
        for _ in range(2)
    ]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join(120.0)
    assert found == [201, 201]
    assert sorted(item.name for item in library.scans()) == ["scan-upload", "scan-upload-2"]


def test_what_should_not_come_in_is_turned_away_without_a_trace(client: TestClient, library: Library) -> None:
    name = make_scan(library)
    good = {f"mug/{path}": data for path, data in files_of(library.folder / name).items()}
    library.delete(name)
    link = zipfile.ZipInfo("mug/link")
    link.external_attr = (stat.S_IFLNK | 0o777) << 16
    linked = io.BytesIO(zipped(good))
    with zipfile.ZipFile(linked, "a") as archive:
        archive.writestr(link, "/etc/passwd")
    head = b"ply\nformat binary_little_endian 1.0\nelement vertex 999999999999\n"
    head += b"property float x\nproperty float y\nproperty float z\nend_header\n"
    refused: list[tuple[bytes, str]] = [
        (b"", "neither a folder nor a zip file nor a PLY"),
        (b"GIF89a", "neither a folder nor a zip file nor a PLY"),
        (b"PK\x03\x04 and no more", "no zip file, or a damaged one"),
        (zipped(good)[:-500], "damaged"),
        (zipped({"bomb.txt": bytes(5 << 20)} | good, zipfile.ZIP_DEFLATED), "50 times its size"),
        (zipped(good | {"../../out.txt": b"x"}), "leads out of its folder"),
        (zipped(good | {"/etc/out.txt": b"x"}), "absolute"),
        (zipped(good | {"mug\\out.txt": b"x"}), "absolute or of another system"),
        (zipped(good | {"/".join("a" * 14): b"x"}), "folders in folders"),
        (linked.getvalue(), "no file"),
        (zipped({"inner.zip": zipped(good)}), "holds no recording and no cloud"),
        (b"PK\x03\x04" + struct.pack("<4s4H2LH", b"PK\5\6", 0, 0, 9, 9, 1 << 29, 4, 0), "100,000 files"),
        (zipped({path: data for path, data in good.items() if "000003" not in path}), "is missing"),
        (zipped(good | {"mug/log.txt/x": b"x"}), ""),
        (head + bytes(100), "too short"),
        (b"ply\nformat ascii 1.0\nelement vertex 1\n" + b"x" * 100_000, "its header never ends"),
    ]
    for data, said in refused:
        check_problem(client.post(f"{SCANS}/upload?file=it.zip", content=data), 422, "import", said)
        assert library.scans() == ()
        assert [path.name for path in (library.folder / ".work").glob("*")] == []
    form = client.post(f"{SCANS}/upload", files={"file": b"x"})
    check_problem(form, 422, "import", "is a form")
    check_problem(client.post(f"{SCANS}/upload?title=%00", content=ply_bytes(5)), 400, "library", "title")


def test_two_scans_are_compared(client: TestClient, library: Library) -> None:
    first, second = make_scan(library, "One", 4000, 30.0), make_scan(library, "Two", 4000, 30.5)
    for name, steps in ((first, 100), (second, 200)):
        folder = library.folder / name
        plan = {"lasers": ["left"], "steps": steps}
        document = {
            "format": "turnscan-scan", "version": 1, "bench": "simulated", "status": "finished",
            "plan": plan, "table": {},
        }  # fmt: skip
        (folder / "scan.json").write_text(json.dumps(document))
    apart = client.get(f"{SCANS}/{first}/compare/{second}").json()
    assert apart["settings"] == [{"setting": "plan.steps", "first": 100, "second": 200}]
    assert apart["deviation"] is None
    assert "made elsewhere" in apart["deviation_note"]
    assert "calibration.json" in apart["calibration_note"]
    assert str(library.folder) not in apart["calibration_note"]
    record = client.app.state.services.calibration()  # type: ignore[attr-defined]
    for name in (first, second):
        record.save(library.folder / name / "calibration.json")
    near = client.get(f"{SCANS}/{first}/compare/{second}").json()
    assert near["deviation_note"] == near["calibration_note"] == ""
    assert near["calibration"]["camera"]["centre_px"] == 0.0
    for way in ("there", "back"):
        assert 0.49 <= near["deviation"][way]["median_mm"] < near["deviation"][way]["p95_mm"] < 3.0
    assert 0.1 < near["deviation"]["spacing_mm"] < 1.5
    assert near["second"]["points"] == 4000


def asked(
    client: TestClient,
    method: str,
    path: str,
    body: Iterable[bytes] = (),
    headers: Mapping[str, str] | None = None,
    *,
    is_whole: bool = True,
    on_body: Callable[[bytes], None] | None = None,
) -> tuple[int, bytes]:
    """A request piece by piece, as a server hands it on; status and body."""
    given = {"host": "localhost"} | dict(headers or {})
    scope = {
        "type": "http", "asgi": {"version": "3.0", "spec_version": "2.4"}, "http_version": "1.1",
        "method": method, "scheme": "http", "path": path, "raw_path": path.encode(), "query_string": b"",
        "headers": [(key.encode(), value.encode()) for key, value in given.items()],
        "client": ("127.0.0.1", 1), "server": ("localhost", 80), "state": {},
    }  # fmt: skip
    status, came, parts = 0, bytearray(), iter(body)

    async def receive() -> dict[str, Any]:
        part = await run_in_threadpool(next, parts, None)
        if part is not None:
            return {"type": "http.request", "body": part, "more_body": True}
        if is_whole:
            return {"type": "http.request", "body": b"", "more_body": False}
        return {"type": "http.disconnect"}

    async def send(message: dict[str, Any]) -> None:
        nonlocal status
        if message["type"] == "http.response.start":
            status = message["status"]
        elif on_body is not None:
            on_body(message.get("body", b""))
        else:
            came.extend(message.get("body", b""))

    assert client.portal is not None
    application: Any = client.app
    client.portal.call(application, scope, receive, send)
    return status, bytes(came)


def open_files(folder: Path) -> list[str]:
    """Files of this program below a folder; none where the system does not tell."""
    there = Path("/proc/self/fd")
    found = [os.path.realpath(each) for each in there.iterdir()] if there.is_dir() else []
    return [path for path in found if path.startswith(str(folder)) and not path.endswith(".lock")]
