from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest
from known_shapes import cloud_of
from scipy.spatial import cKDTree

from app.errors import SurfaceError
from app.geometry.cloud import PointCloud
from app.geometry.transform import RigidTransform
from app.simulation.objects import make_object
from app.surface.joining.join import Joined, join
from app.surface.joining.options import JoinOptions, PairedPlaces, Place
from benchmarks.bench_joining import pose_error_mm
from benchmarks.seen_points import NOISE_MM, put_down, seen

_RABBIT = make_object("rabbit").mesh
_TILTS = (np.zeros(3), np.array([0.5 * np.pi, 0.0, 0.0]), np.array([0.0, np.pi, 0.0]))
_ENOUGH_MM = 0.05
_RED, _BLUE, _GREY = (200, 0, 40), (0, 0, 240), (90, 90, 90)


@pytest.fixture(scope="module")
def poses() -> tuple[RigidTransform, ...]:
    rng = np.random.default_rng(1)
    return tuple(put_down(_RABBIT, tilt, rng) for tilt in _TILTS)


@pytest.fixture(scope="module")
def scans(poses: tuple[RigidTransform, ...]) -> tuple[PointCloud, ...]:
    """Upright, lying and turned over, each in another colour."""
    rng = np.random.default_rng(2)
    clouds = (seen(_RABBIT, pose, 10_000, rng) for pose in poses)
    colours = (_RED, _BLUE, _GREY)
    return tuple(
        replace(cloud, colours=np.full((len(cloud), 3), colour, np.uint8))
        for cloud, colour in zip(clouds, colours, strict=True)
    )


@pytest.fixture(scope="module")
def joined(scans: tuple[PointCloud, ...]) -> Joined:
    told: list[float] = []
    joined = join(scans, progress=lambda words, share: told.append(share))
    assert told == sorted(told)
    assert told[-1] == 1.0
    return joined


def _error_mm(joined: Joined, poses: Sequence[RigidTransform], number: int) -> float:
    truth = poses[0] @ poses[number].inverse()
    return pose_error_mm(joined.placements[number].pose, truth, poses[number] @ _RABBIT.vertices)


def test_a_thing_that_lay_or_stood_on_its_head_is_placed_without_a_hint(
    joined: Joined, poses: tuple[RigidTransform, ...]
) -> None:
    assert [_error_mm(joined, poses, number) <= _ENOUGH_MM for number in range(3)] == [True] * 3
    np.testing.assert_array_equal(joined.placements[0].pose.rotation, np.eye(3))
    assert not joined.doubts
    assert all(placed.is_sure for placed in joined.placements)
    assert all(0.5 < placed.overlap <= 1.0 for placed in joined.placements)
    assert all(0.0 < placed.residual_mm < 3.0 * NOISE_MM for placed in joined.placements)
    assert 0.0 < joined.residual_mm < 3.0 * NOISE_MM


def test_a_joined_cloud_is_in_the_first_scans_frame_without_the_table(
    joined: Joined, poses: tuple[RigidTransform, ...]
) -> None:
    away = np.asarray(cKDTree(poses[0] @ _RABBIT.vertices).query(joined.cloud.points)[0])
    assert away.max() < 4.0
    assert "table" in joined.notes[0]
    # Such a cloud does not stand on the table, and was not seen from one side at each angle.
    assert not joined.cloud.laser_names
    assert not joined.cloud.angle_deg.any()
    assert not joined.cloud.laser.any()
    assert np.allclose(np.linalg.norm(joined.cloud.normals, axis=1), 1.0, atol=1e-3)


def test_points_that_scans_share_are_means_of_all_of_them(
    joined: Joined, scans: tuple[PointCloud, ...]
) -> None:
    cloud = joined.cloud
    count = np.rint((NOISE_MM / cloud.sigma_mm) ** 2).astype(int)
    assert set(count) == {1, 2, 3}
    np.testing.assert_allclose(cloud.sigma_mm, NOISE_MM / np.sqrt(count), rtol=1e-4)
    assert set(map(tuple, cloud.colours[count == 1].tolist())) <= {_RED, _BLUE, _GREY}
    mixed = np.mean([_RED, _BLUE, _GREY], axis=0)
    assert np.all(np.abs(cloud.colours[count == 3] - mixed) <= 1.0)
    assert len(cloud) < 0.8 * sum(np.count_nonzero(scan.points[:, 2] > 1.0) for scan in scans)


def test_two_scans_of_one_place_are_less_noisy_than_either() -> None:
    rng = np.random.default_rng(5)
    radius, noise = 20.0, 0.05

    def half(sigma: float) -> PointCloud:
        ways = rng.normal(size=(10_000, 3))
        ways[:, 0] = np.abs(ways[:, 0])
        ways /= np.linalg.norm(ways, axis=1, keepdims=True)
        points = ways * (radius + sigma * rng.normal(size=(len(ways), 1)))
        return replace(cloud_of(points, ways, sigma), laser_names=())

    def noise_of(cloud: PointCloud) -> float:
        return float(np.std(np.linalg.norm(cloud.points, axis=1) - radius))

    places: list[Place] = [(30.0, 0.0, 0.0), (0.0, 30.0, 0.0), (0.0, 0.0, 30.0)]
    pairs = tuple(PairedPlaces(cloud=1, here=place, there=place) for place in places)
    alike = join([half(noise), half(noise)], JoinOptions(pairs=pairs))
    assert noise_of(alike.cloud) < 0.8 * noise
    # The better scan counts for more, and the worse one does no harm.
    unlike = join([half(noise), half(3.0 * noise)], JoinOptions(pairs=pairs))
    assert noise_of(unlike.cloud) < 1.05 * noise


def test_clicked_places_say_where_a_scan_lies(
    scans: tuple[PointCloud, ...], poses: tuple[RigidTransform, ...]
) -> None:
    tips = _RABBIT.vertices[[0, 4_000, 9_000, 15_000]]
    # Nobody clicks better than a millimetre.
    here = poses[1] @ tips + np.random.default_rng(0).uniform(-1.0, 1.0, tips.shape)
    there = poses[0] @ tips
    pairs = tuple(
        PairedPlaces(cloud=1, here=tuple(one), there=tuple(other))
        for one, other in zip(here, there, strict=True)
    )
    joined = join(scans[:2], JoinOptions(pairs=pairs, is_fused=False))
    assert _error_mm(joined, poses, 1) <= _ENOUGH_MM
    # Not fused, every point stays as it was.
    assert set(joined.cloud.sigma_mm.tolist()) == set(scans[0].sigma_mm.tolist())
    with pytest.raises(SurfaceError, match="Scan 2 has 2 pairs of places"):
        join(scans[:2], JoinOptions(pairs=pairs[:2]))
    with pytest.raises(SurfaceError, match="names scan number 1"):
        join(scans[:1], JoinOptions(pairs=pairs))
    on_a_line = tuple(
        PairedPlaces(cloud=1, here=(x, 0.0, 0.0), there=(0.0, x, 1.0)) for x in (0.0, 20.0, 50.0)
    )
    with pytest.raises(SurfaceError, match="lie on a line"):
        join(scans[:2], JoinOptions(pairs=on_a_line))


def test_scans_that_share_no_surface_are_told(
    scans: tuple[PointCloud, ...], poses: tuple[RigidTransform, ...]
) -> None:
    halves = []
    for scan, pose, side in zip(scans[:2], poses[:2], (1.0, -1.0), strict=True):
        in_rabbit = pose.inverse() @ scan.points.astype(np.float64)
        halves.append(scan.select(side * in_rabbit[:, 0] > 6.0))
    with pytest.raises(SurfaceError, match="Scan 2 shows no surface") as told:
        join(halves)
    assert "three places" in told.value.hint


def test_a_thing_that_looks_alike_from_several_sides_is_doubted() -> None:
    cube = make_object("cube").mesh
    rng = np.random.default_rng(3)
    clouds = [seen(cube, put_down(cube, tilt, rng), 8_000, rng) for tilt in _TILTS[:2]]
    joined = join(clouds)
    assert "more than one way" in joined.doubts[0]
    assert not joined.placements[1].is_sure


def test_strange_clouds_are_refused_or_cleaned(scans: tuple[PointCloud, ...]) -> None:
    good = scans[0]
    copies = cloud_of(np.tile([1.0, 2.0, 30.0], (1_000_000, 1)))
    with pytest.raises(SurfaceError, match="Scan 2 has points at 1 different places"):
        join([good, copies])
    with pytest.raises(SurfaceError, match=r"copies\.ply has points at 1 different places"):
        join([good, copies], names=("good.ply", "copies.ply"))
    with pytest.raises(SurfaceError, match="Scan 1 has points at 0 different places"):
        join([PointCloud.empty(), good])
    with pytest.raises(SurfaceError, match="no scan"):
        join([])
    with pytest.raises(SurfaceError, match="shows the table"):
        join([good, good.select(np.flatnonzero(good.points[:, 2] < 0.3))])
    points = good.points.copy()
    points[::3] = np.nan
    holed = join([replace(good, points=points, sigma_mm=np.full(len(good), np.nan, np.float32))])
    assert np.isfinite(holed.cloud.points).all()
    assert holed.placements[0].is_sure
    assert not holed.doubts


def test_scans_of_another_program_are_joined_without_normals_and_angles(
    scans: tuple[PointCloud, ...], poses: tuple[RigidTransform, ...]
) -> None:
    foreign = []
    for scan in scans[:2]:
        thing = scan.select(np.flatnonzero(scan.points[:, 2] > 1.0))
        # A stray point far away makes nothing larger.
        points = np.vstack([thing.points, [3e5, -2e5, 40.0]])
        foreign.append(replace(cloud_of(points, sigma_mm=np.nan), laser_names=()))
    joined = join(foreign, names=("one.ply", "other.ply"))
    assert _error_mm(joined, poses, 1) <= _ENOUGH_MM
    assert np.isnan(joined.cloud.sigma_mm).all()
    assert np.abs(joined.cloud.points).max() < 200.0
