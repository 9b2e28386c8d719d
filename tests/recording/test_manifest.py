"""`recording.json`: kept whole when right, one sentence with the entry's place when wrong."""

import copy
import json
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from app.documents import parse_document
from app.errors import RecordingError
from app.recording.manifest import Manifest
from app.vision.board import BoardSpec

EXAMPLE: dict[str, Any] = {
    "format": "turnscan-recording",
    "version": 1,
    "camera": {"width": 1280, "height": 720, "name": "optional text"},
    "lasers": [{"name": "left", "colour": "red"}, {"name": "right", "colour": "red"}],
    "turntable": {"direction": "ccw"},
    "board": {"kind": "chessboard", "columns": 9, "rows": 6, "square_mm": 10.0},
    "frames": [
        {"file": "frames/000000.png", "role": "intrinsics"},
        {"file": "frames/000020.png", "role": "laser_plane", "pose": 0, "lasers_on": []},
        {"file": "frames/000021.png", "role": "laser_plane", "pose": 0, "lasers_on": ["left"]},
        {"file": "frames/000050.png", "role": "axis", "angle_deg": 0.0, "lasers_on": []},
        {
            "file": "frames/000080.png",
            "role": "scan",
            "angle_deg": 0.0,
            "time_s": 0.0,
            "lasers_on": ["left"],
        },
        {"file": "frames/000081.png", "role": "texture", "angle_deg": 0.0, "lasers_on": []},
    ],
}
CHARUCO = {
    "kind": "charuco", "columns": 5, "rows": 7, "square_mm": 40, "marker_mm": 20,
    "dictionary": "DICT_6X6_250",
}  # fmt: skip
NAN = float("nan")
JSON: st.SearchStrategy[Any] = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=8),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=8), inner, max_size=3),
    max_leaves=8,
)
FINITE_JSON: st.SearchStrategy[Any] = st.recursive(
    st.none()
    | st.booleans()
    | st.integers(-(10**20), 10**20)
    | st.floats(allow_nan=False, allow_infinity=False)
    | st.text(st.characters(codec="utf-8"), max_size=8),
    lambda inner: (
        st.lists(inner, max_size=3)
        | st.dictionaries(st.text(st.characters(codec="utf-8"), max_size=8), inner, max_size=3)
    ),
    max_leaves=8,
)


def parsed(document: object) -> Manifest:
    return parse_document(json.dumps(document).encode(), Manifest, "my-rec/recording.json", RecordingError)


def changed(path: list[str | int], value: object) -> dict[str, Any]:
    document: Any = copy.deepcopy(EXAMPLE)
    place = document
    for key in path[:-1]:
        place = place[key]
    place[path[-1]] = value
    return dict(document)


def test_the_formats_own_example_is_kept_as_it_is() -> None:
    manifest = parsed(EXAMPLE)
    assert manifest.board_spec() == BoardSpec("chessboard", 9, 6, 10.0)
    assert manifest.frames[4].lasers_on == ("left",)
    assert json.loads(manifest.text()) == EXAMPLE


@pytest.mark.parametrize(
    ("path", "value", "message"),
    [
        (["frames", 1, "role"], "scann", r"frames\[1\]\.role: must be 'intrinsics', .*not 'scann'"),
        (["frames", 1, "role"], None, r"frames\[1\]\.role: "),
        (["frames", 0, "file"], "../secret.png", r"frames\[0\]\.file: '\.\./secret\.png' leaves the folder"),
        (["frames", 0, "file"], "/etc/passwd", r"frames\[0\]\.file: .* leaves the folder"),
        (["frames", 0, "file"], "a/../../b.png", r"frames\[0\]\.file: .* leaves the folder"),
        (["frames", 0, "file"], "..\\b.png", r"frames\[0\]\.file: .* leaves the folder"),
        (["frames", 0, "file"], "C:\\b.png", r"frames\[0\]\.file: .* leaves the folder"),
        (["frames", 0, "file"], "a\0.png", r"frames\[0\]\.file: is not a file name"),
        (["frames", 0, "file"], "", r"frames\[0\]\.file: is not a file name"),
        (["frames", 0, "file"], 7, r"frames\[0\]\.file: must be a valid string, not 7"),
        (
            ["frames", 2, "lasers_on"],
            ["middle"],
            r"frames\[2\]\.lasers_on: there is no laser called 'middle'",
        ),
        (["frames", 2, "lasers_on"], ["left", "left"], r"frames\[2\]\.lasers_on: names a laser twice"),
        (["frames", 2, "lasers_on"], "left", r"frames\[2\]\.lasers_on: "),
        (["frames", 4, "angle_deg"], NAN, r"frames\[4\]\.angle_deg: must be a finite number"),
        (["frames", 4, "angle_deg"], 1e300, r"frames\[4\]\.angle_deg: must be less than"),
        (["frames", 4, "angle_deg"], "90", r"frames\[4\]\.angle_deg: must be a valid number, not '90'"),
        (["frames", 4, "angle_deg"], True, r"frames\[4\]\.angle_deg: "),
        (["frames", 4, "angle_deg"], None, r"frames\[4\]\.angle_deg: is missing"),
        (["frames", 4, "exposure_us"], -1, r"frames\[4\]\.exposure_us: must be greater than 0, not -1"),
        (["frames", 4, "pose"], 0.5, r"frames\[4\]\.pose: "),
        (["frames", 4], [], r"frames\[4\]: "),
        (["frames"], {}, "frames: must be .*, not an object"),
        (["frames", 1, "file"], "frames/000000.png", None),
        (["frames", 2, "file"], "frames/000020.png", r"frames\[2\]\.file: .* is listed twice"),
        (["camera", "width"], -1280, r"camera\.width: must be greater than 0, not -1280"),
        (["camera", "width"], 10**30, r"camera\.width: must be less than or equal to 65535"),
        (["camera", "width"], 12.5, r"camera\.width: "),
        (["camera"], None, "camera: "),
        (["lasers", 0, "colour"], "pink", r"lasers\[0\]\.colour: must be 'red', 'green', 'blue' or 'any'"),
        (["lasers", 1, "name"], "left", "lasers: has two lasers called 'left'"),
        (["lasers", 1, "name"], "", r"lasers\[1\]\.name: "),
        (["turntable", "direction"], "left", r"turntable\.direction: must be 'ccw' or 'cw', not 'left'"),
        (["turntable"], {}, r"turntable\.direction: is missing"),
        (["turntable"], None, r"frames\[3\]\.angle_deg: means nothing without turntable\.direction"),
        (["turntable", "seconds_per_turn"], 0, r"turntable\.seconds_per_turn: must be greater than 0"),
        (["board", "square_mm"], float("inf"), r"board\.square_mm: must be a finite number"),
        (["board", "square_mm"], -10, r"board\.square_mm: must be greater than 0, not -10"),
        (["board", "kind"], "checkers", r"board\.kind: must be 'chessboard', .*, not 'checkers'"),
        (["board"], {"columns": 3}, r"board\.kind: is missing"),
        (["board"], {"kind": "circles", "columns": 4, "rows": 3}, r"board\.spacing_mm: is missing"),
        (["board"], CHARUCO | {"marker_mm": 50}, "board: marker_mm must be smaller than square_mm"),
        (["board"], CHARUCO | {"dictionary": "DICT_9"}, r"board\.dictionary: there is no ArUco dictionary"),
        (["board"], CHARUCO, None),
        (["platter"], {"kind": "aruco"}, r"platter\.dictionary: is missing \(and 2 more problems\)"),
        (["version"], 2, "version: must be 1, not 2"),
        (["weather"], [{"rain": NAN}], r"weather\[0\]\.rain: must be a finite number"),
        (["weather"], "\ud800", "weather: is not valid text"),
    ],
)
def test_every_mistake_is_named_by_its_place(
    path: list[str | int], value: object, message: str | None
) -> None:
    document = changed(path, value)
    if message is None:
        parsed(document)
        return
    with pytest.raises(RecordingError, match=f"^my-rec/recording\\.json: {message}"):
        parsed(document)


@pytest.mark.parametrize(
    ("data", "message"),
    [
        (b"", "is not JSON"),
        (b"{", "is not JSON .*line 1"),
        (b"[1]", "must hold a JSON object"),
        (b"\xff\xfe{}", "is not UTF-8 text"),
        (b'{"a": 1, "a": 2}', "has the key 'a' twice"),
        (b"[" * 100_000, "is nested too deeply"),
        (b'{"a":' + b"[" * 90 + b"]" * 90 + b"}", "is nested too deeply"),
        (b'{"a": ' + b"9" * 5000 + b"}", "digits"),
        (b'{"a": 1e999}', "a: must be a finite number"),
        (b'{"a": Infinity}', "a: must be a finite number"),
        (b'{"\\ud800": 1}', "has a key that is not valid text"),
    ],
)
def test_what_is_no_manifest_at_all_is_one_sentence(data: bytes, message: str) -> None:
    with pytest.raises(RecordingError, match=f"^rec: .*{message}"):
        parse_document(data, Manifest, "rec", RecordingError)


def test_a_scan_of_constant_speed_needs_times_instead_of_angles() -> None:
    document = changed(["turntable", "seconds_per_turn"], 20.0)
    document["frames"][4]["angle_deg"] = None
    parsed(document)
    del document["frames"][4]["time_s"]
    with pytest.raises(RecordingError, match=r"frames\[4\]: needs angle_deg or time_s"):
        parsed(document)


def test_a_byte_order_mark_is_no_mistake() -> None:
    data = b"\xef\xbb\xbf" + json.dumps(EXAMPLE).encode()
    assert parse_document(data, Manifest, "rec", RecordingError).camera_size == (1280, 720)


def test_a_board_that_is_asked_for_and_missing_is_an_error() -> None:
    document = changed(["board"], None)
    with pytest.raises(RecordingError, match=r"recording\.json: board: is missing"):
        parsed(document).board_spec()
    with pytest.raises(RecordingError, match=r"recording\.json: platter: is missing"):
        parsed(document).platter_spec()


@given(
    extra=st.dictionaries(st.text(st.characters(codec="utf-8")), FINITE_JSON, max_size=4),
    place=st.sampled_from([[], ["camera"], ["lasers", 0], ["turntable"], ["board"], ["frames", 3]]),
)
def test_unknown_keys_are_kept_wherever_they_are(extra: dict[str, Any], place: list[str | int]) -> None:
    document: Any = copy.deepcopy(EXAMPLE)
    here = document
    for key in place:
        here = here[key]
    known = {"seconds_per_turn", "platter", "name", "exposure_us", "pose", "time_s"} | set(here)
    here.update({key: value for key, value in extra.items() if key not in known})
    assert json.loads(parsed(document).text()) == document


@given(st.binary(max_size=200) | st.text(max_size=200).map(lambda text: text.encode("utf-8", "replace")))
def test_bytes_of_any_kind_are_an_error_and_no_surprise(data: bytes) -> None:
    with pytest.raises(RecordingError):
        parse_document(data, Manifest, "rec", RecordingError)


@given(spoil=st.data())
def test_a_spoiled_manifest_is_an_error_or_still_a_manifest(spoil: st.DataObject) -> None:
    document: Any = copy.deepcopy(EXAMPLE)
    place = document
    while True:
        key = spoil.draw(st.sampled_from(list(place) if isinstance(place, dict) else range(len(place))))
        inner = place[key]
        if not isinstance(inner, dict | list) or not inner or spoil.draw(st.booleans()):
            break
        place = inner
    place[key] = spoil.draw(JSON)
    try:
        manifest = parsed(document)
    except RecordingError:
        return
    assert parsed(json.loads(manifest.text())) == manifest
