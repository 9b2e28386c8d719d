"""What calibration files of other programs do not tell is said, and what is wrong in them is named."""

import copy
import hashlib
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from foreign_files import fabscan_file, horus_file
from hypothesis import given
from hypothesis import strategies as st
from numpy.testing import assert_allclose

from app.calibration.foreign.importing import import_calibration, notes_of, parse_calibration
from app.calibration.record import CalibrationRecord
from app.devices.frame import Mounting
from app.errors import CalibrationFileError
from app.simulation.rig import standard_rig

RIG = standard_rig(960, 1280, distortion=np.zeros(5)).rig
BENT = standard_rig(960, 1280).rig
Change = Callable[[dict[str, Any]], object]


def read(document: dict[str, Any], bench: Mounting | None = None) -> CalibrationRecord:
    return parse_calibration(json.dumps(document).encode(), "their.json", bench or Mounting(90))


def horus(rig: Any = RIG, **values: object) -> dict[str, Any]:
    """A file of Horus with other values."""
    document = horus_file(rig)
    for name, value in values.items():
        document["calibration_settings"][name] = {"value": value}
    return document


def fabscan(change: Change) -> dict[str, Any]:
    document = fabscan_file(RIG)
    change(document)
    return document


def said(record: CalibrationRecord) -> str:
    return "\n".join(notes_of(record))


def test_a_record_tells_where_it_comes_from_also_after_it_was_kept(tmp_path: Path) -> None:
    record = read(horus())
    record.save(tmp_path / "kept.json")
    kept = CalibrationRecord.load(tmp_path / "kept.json")
    assert kept.method == "horus"
    assert kept.extra["provenance"]["program"] == "Horus"
    assert kept.extra["provenance"]["file"] == "their.json"
    assert notes_of(kept) == notes_of(record)
    assert notes_of(kept)


def test_the_picture_that_it_is_for_is_told() -> None:
    assert "For pictures of 960 x 1280: rotation = 90 and mirror = false" in said(read(horus()))
    sensor = read(horus(), Mounting())
    assert sensor.camera.size == (1280, 960)
    assert "For pictures of 1280 x 960: rotation = 0" in said(sensor)


@pytest.mark.parametrize(
    ("document", "way"), [(horus(), "ccw"), (fabscan_file(RIG), "cw")], ids=["horus", "fabscan"]
)
def test_the_direction_of_the_table_is_told(document: dict[str, Any], way: str) -> None:
    record = read(document)
    assert record.extra["provenance"]["turntable_direction"] == way
    assert f'direction = "{way}"' in said(record)
    mirrored = read(document, Mounting(90, is_mirrored=True))
    assert mirrored.extra["provenance"]["turntable_direction"] != way


@pytest.mark.parametrize(
    "document",
    [
        horus(pattern_origin_distance=0.0),
        fabscan(lambda d: d["calibration"]["pattern"].update(origin_distance=0)),
    ],
    ids=["horus", "fabscan"],
)
def test_a_distance_that_nobody_measured_leaves_the_table_unknown(document: dict[str, Any]) -> None:
    record = read(document)
    assert record.axis is not None
    assert np.isnan(record.axis.offset_mm)
    assert "height of the table is not in the file" in said(record)
    assert "height of the table" not in said(read(horus()))


def test_a_plane_that_was_not_calibrated_is_left_out() -> None:
    record = read(horus(distance_right=0.0, normal_right=[0.0, 0.0, 0.0]))
    assert set(record.lasers) == {"left"}
    assert "plane of laser 'right' is not in the file" in said(record)
    record = read(
        fabscan(lambda d: d["calibration"]["laser_planes"][1].update(deviation=0, distance=0, normal=[]))
    )
    assert set(record.lasers) == {"right"}
    assert "plane of laser 'left' is not in the file" in said(record)


def test_a_laser_that_a_fabscan_does_not_have_is_not_missed() -> None:
    record = read(fabscan(lambda d: d["laser"].update(numbers=1)))
    assert set(record.lasers) == {"right"}
    assert "'left'" not in said(record)


@pytest.mark.parametrize(
    "document",
    [
        horus(rotation_matrix=np.zeros((3, 3)).tolist(), translation_vector=[0.0, 0.0, 0.0]),
        fabscan(lambda d: d["calibration"].update(platform_rotation=[], platform_translation=[])),
    ],
    ids=["horus", "fabscan"],
)
def test_a_rig_without_an_axis_is_a_calibration_of_camera_and_lasers(document: dict[str, Any]) -> None:
    record = read(document)
    assert record.axis is None
    assert set(record.lasers) == {"left", "right"}
    assert "axis of the table is not in the file" in said(record)


def test_a_normal_towards_the_camera_is_turned_round_with_its_distance() -> None:
    plane = RIG.lasers["left"]
    record = read(horus(normal_left=(-plane.normal).tolist(), distance_left=-plane.distance_mm))
    assert_allclose(record.lasers["left"].normal, plane.normal)
    assert record.lasers["left"].distance_mm == pytest.approx(plane.distance_mm)


def test_a_distortion_that_the_program_left_out_is_left_out_and_told() -> None:
    record = read(horus(BENT, use_distortion=False))
    assert not record.camera.distortion.any()
    assert "computed lasers and points without it" in said(record)
    assert "without it" not in said(read(horus()))


def test_a_distortion_that_the_program_used_is_kept_and_its_rounding_told() -> None:
    rounded = np.round(BENT.camera.distortion, 3).tolist()
    record = read(horus(BENT, distortion_vector=rounded))
    assert_allclose(record.camera.distortion, rounded)
    assert "rounds the lens distortion to 3 decimals" in said(record)
    assert "rounds" not in said(read(horus(BENT)))


def test_residuals_of_fabscan_are_kept_and_put_in_their_place() -> None:
    record = read(fabscan_file(RIG))
    assert record.laser_rms_mm == {"left": 0.061, "right": 0.061}
    assert "say little about the truth" in said(record)


def test_the_camera_that_horus_starts_with_is_recognised() -> None:
    matrix = [[1430, 0, 480], [0, 1430, 620], [0, 0, 1]]
    assert "never calibrated" in said(read(horus(camera_matrix=matrix)))


def test_planes_of_another_camera_are_recognised_by_the_check_sum() -> None:
    numbers = np.concatenate([RIG.camera.matrix.ravel(), RIG.camera.distortion])
    right = hashlib.md5(numbers.tobytes()).hexdigest()
    record = read(horus(laser_triangulation_hash="0" * 32, platform_extrinsics_hash=right))
    assert "laser planes were found with another camera matrix" in said(record)
    assert "axis was found" not in said(record)


def test_a_picture_size_that_does_not_fit_the_camera_is_doubted() -> None:
    record = read(fabscan(lambda d: d["camera"]["resolution"].update(width=1640, height=1232)))
    assert "away from its middle" in said(record)
    assert "away from its middle" not in said(read(fabscan_file(RIG)))


def test_numpy_s_double_brackets_are_understood() -> None:
    def bracket(document: dict[str, Any]) -> None:
        group = document["calibration"]
        group["platform_translation"] = [[n] for n in group["platform_translation"]]
        group["laser_planes"][0]["normal"] = [group["laser_planes"][0]["normal"]]

    assert_allclose(read(fabscan(bracket)).rig.axis.origin, RIG.axis.origin)


def set_horus(name: str, value: object) -> dict[str, Any]:
    return horus(**{name: value})


def without(name: str) -> dict[str, Any]:
    document = horus()
    del document["calibration_settings"][name]
    return document


@pytest.mark.parametrize(
    ("document", "problem"),
    [
        (without("camera_matrix"), r"calibration_settings\.camera_matrix: is missing"),
        (without("camera_rotate"), r"calibration_settings\.camera_rotate: is missing"),
        ({"calibration_settings": {}}, r"calibration_settings\.camera_width: is missing \(and"),
        ({"calibration_settings": 3}, r"calibration_settings: must be"),
        (set_horus("camera_matrix", []), r"camera_matrix\.value: is empty"),
        (
            set_horus("camera_matrix", [[1, 0], [0, 1]]),
            r"camera_matrix\.value: must have 3 x 3 numbers, not 4",
        ),
        (
            set_horus("camera_matrix", [[-1, 0, 1], [0, 1, 1], [0, 0, 1]]),
            r"camera_matrix\.value: focal lengths must be greater",
        ),
        (
            set_horus("camera_matrix", [["1", 0, 1], [0, 1, 1], [0, 0, 1]]),
            r"camera_matrix\.value\[0\]: must be a valid number, not '1'",
        ),
        (set_horus("distortion_vector", [0.1]), r"distortion_vector\.value: must have 5 numbers"),
        (set_horus("camera_width", -1), r"camera_width\.value: must be greater than 0, not -1"),
        (set_horus("camera_width", "1280"), r"camera_width\.value: must be a valid integer, not '1280'"),
        (set_horus("camera_hflip", 1), r"camera_hflip\.value: must be a valid boolean"),
        (set_horus("normal_left", [1.0, 1.0, 0.0]), r"normal_left\.value: must be a unit vector"),
        (set_horus("normal_left", [1.0, 0.0]), r"normal_left\.value: must have 3 numbers, not 2"),
        (set_horus("distance_left", "12"), r"distance_left\.value: must be a valid number"),
        (set_horus("distance_left", 1e300), r"distance_left\.value: must be less than"),
        (set_horus("translation_vector", [1, 2]), r"translation_vector\.value: must have 3 numbers"),
        (
            set_horus("rotation_matrix", [[1, 0, 0], [0, 1, 0.1], [0, 0, 1]]),
            r"rotation_matrix\.value: is no rotation",
        ),
        (
            set_horus("rotation_matrix", [[1, 0, 0], [0, 1, 0], [0, 0, -1]]),
            r"rotation_matrix\.value: is a reflection",
        ),
        (
            set_horus("pattern_origin_distance", -1.0),
            r"pattern_origin_distance\.value: must be greater than or equal to 0",
        ),
        (
            fabscan(lambda d: d["camera"].update(rotate="yes")),
            r"camera\.rotate: must be a valid boolean, not 'yes'",
        ),
        (fabscan(lambda d: d.pop("camera")), r"camera: is missing"),
        (
            fabscan(lambda d: d["calibration"].update(camera_matrix=[])),
            r"calibration\.camera_matrix: is empty: FabScanPi was never calibrated",
        ),
        (
            fabscan(lambda d: d["calibration"]["laser_planes"][1].update(normal=[0.5, 0, 0])),
            r"calibration\.laser_planes\[1\]\.normal: must be a unit vector",
        ),
        (
            fabscan(lambda d: d["calibration"].update(laser_planes=[{}] * 100)),
            r"calibration\.laser_planes: ",
        ),
        (fabscan(lambda d: d["calibration"].pop("platform_rotation")), r"platform_rotation: is missing"),
        ({"something": "else"}, "is no calibration of Turnscan, Horus or FabScanPi"),
        ({"format": "turnscan-recording"}, r"format: must be 'turnscan-calibration'"),
    ],
)
def test_what_is_wrong_is_named(document: dict[str, Any], problem: str) -> None:
    with pytest.raises(CalibrationFileError, match=f"their.json: .*{problem}|their.json: {problem}"):
        read(copy.deepcopy(document))


def test_a_calibration_of_this_program_stays_as_it_is(tmp_path: Path) -> None:
    record = CalibrationRecord(camera=BENT.camera, lasers=BENT.lasers, axis=BENT.axis, method="joint")
    record.save(tmp_path / "ours.json")
    assert import_calibration(tmp_path / "ours.json", Mounting(90)).to_bytes() == record.to_bytes()


@pytest.mark.parametrize("ending", ["yml", "yaml", "xml"])
def test_a_camera_of_opencv_is_a_calibration_of_a_camera_alone(ending: str, tmp_path: Path) -> None:
    path = tmp_path / f"camera.{ending}"
    storage = cv2.FileStorage(str(path), cv2.FILE_STORAGE_WRITE)
    storage.write("image_width", 960)
    storage.write("image_height", 1280)
    storage.write("camera_matrix", BENT.camera.matrix)
    storage.write("distortion_coefficients", BENT.camera.distortion)
    storage.release()
    record = import_calibration(path)
    assert_allclose(record.camera.matrix, BENT.camera.matrix, rtol=1e-15)
    assert not record.lasers
    assert "Only the camera" in said(record)


def test_a_file_that_is_not_there_or_too_large_is_named(tmp_path: Path) -> None:
    with pytest.raises(CalibrationFileError, match=r"none\.json: no such file"):
        import_calibration(tmp_path / "none.json")
    path = tmp_path / "large.json"
    path.write_bytes(b" " * (16 * 2**20 + 1))
    with pytest.raises(CalibrationFileError, match="is larger than 16 MB"):
        import_calibration(path)


@given(
    start=st.sampled_from(["", '{"calibration_settings": ', '{"calibration": {"laser_planes": ', "{"]),
    rest=st.text(max_size=60)
    | st.recursive(
        st.none() | st.booleans() | st.floats() | st.integers() | st.text(max_size=5),
        lambda inner: st.lists(inner, max_size=4) | st.dictionaries(st.text(max_size=8), inner, max_size=4),
    ).map(json.dumps),
)
def test_no_text_is_a_surprise(start: str, rest: str) -> None:
    with pytest.raises(CalibrationFileError):
        parse_calibration((start + rest + "}" * start.count("{")).encode("utf-8", "replace"), "x", Mounting())


@given(
    name=st.sampled_from(sorted(horus_file(RIG)["calibration_settings"])),
    value=st.recursive(
        st.none() | st.booleans() | st.floats() | st.integers() | st.text(max_size=5),
        lambda inner: st.lists(inner, max_size=5),
        max_leaves=12,
    ),
)
def test_no_value_of_a_field_is_a_surprise(name: str, value: object) -> None:
    try:
        record = read(set_horus(name, value))
    except CalibrationFileError:
        return
    assert CalibrationRecord.parse(record.to_bytes(), "again").camera.size == record.camera.size
