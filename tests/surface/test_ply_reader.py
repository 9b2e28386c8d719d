from pathlib import Path

import numpy as np
import pytest
from clouds import some_cloud
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose, assert_array_equal

from app.errors import PointCloudFileError
from app.surface.ply import ply_stream, write_ply
from app.surface.ply_reader import PlyFile, read_ply

XYZ = "property float x\nproperty float y\nproperty float z\n"


def written(folder: Path, head: str, body: bytes, order: str = "ascii") -> Path:
    path = folder / "given.ply"
    path.write_bytes(f"ply\nformat {order} 1.0\n{head}end_header\n".encode() + body)
    return path


@pytest.mark.parametrize(("order", "mark"), [("binary_little_endian", "<"), ("binary_big_endian", ">")])
def test_any_order_and_type_of_properties_is_understood(tmp_path: Path, order: str, mark: str) -> None:
    # fmt: off
    layout = np.dtype([("z", f"{mark}f8"), ("blue", "u1"), ("x", f"{mark}i2"), ("label", f"{mark}u4"),
                       ("y", f"{mark}f4"), ("nx", f"{mark}f8"), ("ny", f"{mark}f8"), ("nz", f"{mark}f8")])
    # fmt: on
    rows = np.array([(1.5, 7, -3, 9, 2.25, 0, 0, 1), (4.5, 8, 300, 9, -1.0, 0, 1, 0)], layout)
    head = (
        "element vertex 2\nproperty double z\nproperty uchar blue\nproperty int16 x\nproperty uint label\n"
        "property float32 y\nproperty double nx\nproperty double ny\nproperty double nz\n"
        "element face 1\nproperty list uchar int vertex_indices\n"
    )
    cloud = read_ply(written(tmp_path, head, rows.tobytes() + b"\x03" + bytes(12), order))
    assert_array_equal(cloud.points, [[-3.0, 2.25, 1.5], [300.0, -1.0, 4.5]])
    assert_array_equal(cloud.normals, [[0, 0, 1], [0, 1, 0]])
    assert_array_equal(cloud.colours, [[200, 200, 7], [200, 200, 8]])


def test_what_is_missing_has_a_default(tmp_path: Path) -> None:
    cloud = read_ply(written(tmp_path, f"element vertex 2\n{XYZ}", b"1 2 3\n4 5 6\n"))
    assert_array_equal(cloud.points, [[1, 2, 3], [4, 5, 6]])
    assert_array_equal(cloud.normals, 0.0)
    assert np.isnan(cloud.sigma_mm).all()
    assert_array_equal(cloud.quality, 1.0)
    assert cloud.laser_names == ()


def test_an_element_before_the_vertices_is_passed_over(tmp_path: Path) -> None:
    head = f"element camera 2\nproperty float f\nelement vertex 1\n{XYZ}"
    assert_array_equal(read_ply(written(tmp_path, head, b"5\n6\n1 2 3\n")).points, [[1, 2, 3]])
    body = np.array([5.0, 6.0, 1.0, 2.0, 3.0], "<f4").tobytes()
    assert_array_equal(read_ply(written(tmp_path, head, body, "binary_little_endian")).points, [[1, 2, 3]])


def test_colours_as_floats_run_from_zero_to_one(tmp_path: Path) -> None:
    head = f"element vertex 1\n{XYZ}property float red\nproperty ushort green\nproperty int blue\n"
    cloud = read_ply(written(tmp_path, head, b"0 0 0 1.0 32896 77\n"))
    assert_array_equal(cloud.colours, [[255, 128, 77]])


def test_lines_with_carriage_returns_and_comments_are_read(tmp_path: Path) -> None:
    path = tmp_path / "crlf.ply"
    text = (
        f"ply\nformat ascii 1.0\ncomment laser beams\nobj_info x\nelement vertex 1\n{XYZ}end_header\n1 2 3\n"
    )
    path.write_bytes(text.replace("\n", "\r\n").encode())
    assert_array_equal(read_ply(path).points, [[1, 2, 3]])


V = "element vertex "
BAD = {
    "promises": f"{V}999999999999\n{XYZ}",
    "does not say how many": f"{V}-3\n{XYZ}",
    "how many": f"{V}1e3\n{XYZ}",
    "how many 'vertex'": f"element vertex {'9' * 30}\n{XYZ}",
    "unknown type": f"{V}1\nproperty quadruple x\n{XYZ}",
    "without x, y and z": f"{V}1\nproperty float x\nproperty float y\n",
    "no vertices": "element face 1\nproperty float a\n",
    "lists in its vertices": f"{V}1\n{XYZ}property list uchar int neighbours\n",
    "before its vertices": f"element face 1\nproperty list uchar int i\n{V}1\n{XYZ}",
    "before any element": f"property float x\n{V}1\n{XYZ}",
    "malformed property": f"{V}1\nproperty float\n{XYZ}",
    "twice": f"{V}1\n{XYZ}property float x\n",
    "unknown line": f"{V}1\n{XYZ}surprise 1\n",
    "unknown format": f"format ebcdic 1.0\n{V}1\n{XYZ}",
}


@pytest.mark.parametrize("problem", BAD)
def test_a_bad_header_is_named(tmp_path: Path, problem: str) -> None:
    with pytest.raises(PointCloudFileError, match=problem):
        read_ply(written(tmp_path, BAD[problem], b"1 2 3 4 5\n"))


@pytest.mark.parametrize(
    ("body", "problem"),
    [
        (b"1 2 3\n4 5\n", "too short"),
        (b"1.000 2.000 3.000\n4 5\n", "ends before"),
        (b"1 2 3\n4 five 6\n", "no number"),
        (b"1 2 3\n4 5 nan\n", "vertex 1 has a position that is not finite"),
        (b"1 2 3\n4 5 1e39\n", "not finite"),
    ],
)
def test_a_bad_body_is_named(tmp_path: Path, body: bytes, problem: str) -> None:
    with pytest.raises(PointCloudFileError, match=problem):
        read_ply(written(tmp_path, f"{V}2\n{XYZ}", body))


def test_normals_of_any_length_become_unit_vectors(tmp_path: Path) -> None:
    body = b"1 2 3 0 0 5\n4 5 6 0 0 0\n7 8 9 nan 0 1\n1 1 1 3e38 3e38 0\n"
    cloud = read_ply(
        written(tmp_path, f"{V}4\n{XYZ}" + "".join(f"property float n{k}\n" for k in "xyz"), body)
    )
    half = 0.5**0.5
    assert_allclose(cloud.normals, [[0, 0, 1], [0, 0, 0], [0, 0, 0], [half, half, 0]], atol=1e-6)


def test_a_colour_that_does_not_fit_is_named(tmp_path: Path) -> None:
    with pytest.raises(PointCloudFileError, match="'red'"):
        read_ply(written(tmp_path, f"{V}1\n{XYZ}property uchar red\n", b"1 2 3 256\n"))


@pytest.mark.parametrize("content", [b"", b"plyx\n", b"solid stl\n", b"ply\n", b"ply\nformat ascii 1.0\n"])
def test_other_files_are_refused(tmp_path: Path, content: bytes) -> None:
    path = tmp_path / "other.ply"
    path.write_bytes(content)
    with pytest.raises(PointCloudFileError):
        read_ply(path)


def test_a_missing_file_is_named(tmp_path: Path) -> None:
    with pytest.raises(PointCloudFileError, match=r"none\.ply"):
        read_ply(tmp_path / "none.ply")


@settings(max_examples=60, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(st.integers(0, 2000), st.booleans())
def test_a_file_that_is_cut_short_is_refused(tmp_path: Path, length: int, is_text: bool) -> None:
    whole = tmp_path / "whole.ply"
    write_ply(whole, some_cloud(20), ascii_text=is_text)
    data = whole.read_bytes()
    cut = tmp_path / "cut.ply"
    # The last character of a text is the end of its last line, which may be missing.
    cut.write_bytes(data[: min(length, len(data) - 12)])
    with pytest.raises(PointCloudFileError):
        read_ply(cut)


header_lines = st.sampled_from(
    ["format ascii 1.0", "format binary_little_endian 1.0", "element vertex 2", "element vertex 4000000000",
     "element face 1", "property float x", "property float y", "property float z", "property uchar red",
     "property list uchar int i", "property int y", "comment x", "end_header", "element", "property",
     "format", "property list float double x", "\x00\xff", "element vertex nan", "obj_info"]
)  # fmt: skip


@settings(max_examples=300, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(st.lists(header_lines, max_size=14), st.binary(max_size=60))
def test_no_header_does_harm(tmp_path: Path, lines: list[str], body: bytes) -> None:
    path = tmp_path / "odd.ply"
    path.write_bytes("\n".join(["ply", *lines, "end_header", ""]).encode("latin-1") + body)
    try:
        cloud = read_ply(path)
    except PointCloudFileError:
        return
    assert np.isfinite(cloud.points).all()


@settings(max_examples=200, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(st.lists(st.tuples(st.integers(0, 900), st.integers(0, 255)), min_size=1, max_size=6), st.booleans())
def test_no_damaged_byte_does_harm(tmp_path: Path, damage: list[tuple[int, int]], is_text: bool) -> None:
    path = tmp_path / "damaged.ply"
    write_ply(path, some_cloud(12), ascii_text=is_text)
    data = bytearray(path.read_bytes())
    for place, value in damage:
        data[place % len(data)] = value
    path.write_bytes(data)
    try:
        cloud = read_ply(path)
    except PointCloudFileError:
        return
    assert np.isfinite(cloud.points).all()
    assert_allclose(len(cloud.colours), len(cloud.points))


def test_a_text_file_without_end_of_line_or_with_empty_elements_is_refused_at_once(tmp_path: Path) -> None:
    path = tmp_path / "endless.ply"
    head = b"ply\nformat ascii 1.0\nelement nothing 999999999999999\nelement vertex 1\n"
    path.write_bytes(head + b"property float x\nproperty float y\nproperty float z\nend_header\n")
    with pytest.raises(PointCloudFileError, match="too short"):
        read_ply(path)
    path.write_bytes(path.read_bytes() + b"1" * 200_000)
    with pytest.raises(PointCloudFileError, match="a line that is too long"):
        read_ply(path)


@pytest.mark.parametrize("ascii_text", [True, False])
def test_pieces_put_together_are_the_whole_and_can_be_sent_on(tmp_path: Path, ascii_text: bool) -> None:
    path = tmp_path / "cloud.ply"
    write_ply(path, some_cloud(1000), ascii_text=ascii_text)
    whole, file = read_ply(path), PlyFile.open(path)
    assert (file.points, file.is_text, file.laser_names) == (1000, ascii_text, whole.laser_names)
    pieces = list(file.pieces(300))
    assert [len(piece) for piece in pieces] == [300, 300, 300, 100]
    assert_array_equal(np.concatenate([piece.points for piece in pieces]), whole.points)
    sent = b"".join(ply_stream(file.pieces(300), 1000, file.laser_names, ascii_text=ascii_text))
    assert sent == path.read_bytes()
