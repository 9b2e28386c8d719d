"""Markers lying on the table in an unknown layout: their layout, and the sheet's pose at each stop."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import cv2
import numpy as np

from app.calibration.poses import BoardPose, board_pose
from app.geometry.arrays import Floats, Points
from app.geometry.camera import CameraIntrinsics
from app.geometry.plane import fit_plane
from app.geometry.transform import RigidTransform
from app.vision.markers import MarkerObservation

UNIT_CORNERS = np.array([[-0.5, 0.5, 0.0], [0.5, 0.5, 0.0], [0.5, -0.5, 0.0], [-0.5, -0.5, 0.0]])
"""(4, 3) corners of a marker of side one in the order they are seen; x right, y up, z towards the eye."""

_REFERENCES, _TRIED = 8, 24


@dataclass(frozen=True, eq=False, slots=True)
class SheetStart:
    """A first idea of the sheet of markers.

    Attributes:
        ids: numbers of the markers, in the order of `layout`.
        layout: (M, 3) x mm, y mm, rotation rad of each marker on the sheet; the first is the origin.
        poses: the sheet's pose in the camera frame for each observation.
    """

    ids: tuple[int, ...]
    layout: Floats
    poses: tuple[BoardPose, ...]


def marker_points(layout: Floats, marker_mm: float) -> Points:
    """(M, 4, 3) corners on the sheet, mm."""
    cosine, sine = np.cos(layout[:, 2]), np.sin(layout[:, 2])
    turn = np.zeros((len(layout), 3, 3))
    turn[:, 0, 0] = turn[:, 1, 1] = cosine
    turn[:, 0, 1], turn[:, 1, 0], turn[:, 2, 2] = -sine, sine, 1.0
    centres = np.column_stack([layout[:, :2], np.zeros(len(layout))])
    corners: Points = marker_mm * UNIT_CORNERS @ turn.transpose(0, 2, 1) + centres[:, None, :]
    return corners


def start_sheet(
    camera: CameraIntrinsics, observations: Sequence[MarkerObservation], marker_mm: float
) -> SheetStart:
    """Layout from single pictures; the one that explains the others best is taken.

    Args:
        observations: each shows one marker or more.
        marker_mm: side of a marker.
    """
    by_wealth = sorted(range(len(observations)), key=lambda k: -len(observations[k].ids))
    richest = [k for k in by_wealth if len(observations[k].ids) == len(observations[by_wealth[0]].ids)]
    chosen = np.unique(np.linspace(0, len(richest) - 1, min(_REFERENCES, len(richest))).astype(int))
    candidates = []
    for k in chosen:
        known = _layout_from_one(camera, observations[richest[k]], marker_mm)
        known = _with_the_others(camera, observations, known, marker_mm)
        tried = _sheet_poses(camera, observations[:: max(1, len(observations) // _TRIED)], known, marker_mm)
        candidates.append((float(np.median([p.rms_px for p in tried])), known))
    _, known = min(candidates, key=lambda c: c[0])
    poses = _sheet_poses(camera, observations, known, marker_mm)
    ids = tuple(known)
    return SheetStart(ids, np.array([known[i] for i in ids]), poses)


def _layout_from_one(
    camera: CameraIntrinsics, seen: MarkerObservation, marker_mm: float
) -> dict[int, Floats]:
    """Layout from one picture: each marker's own pose gives points of the sheet's plane."""
    rays = camera.rays(seen.corners.reshape(-1, 2))
    corners = []
    for square in rays.reshape(-1, 4, 3):
        _, rvecs, tvecs, _ = cv2.solvePnPGeneric(
            marker_mm * UNIT_CORNERS,
            np.ascontiguousarray(square[:, :2]),
            np.eye(3),
            np.zeros(5),
            flags=cv2.SOLVEPNP_IPPE_SQUARE,
        )
        corners.append(_pose(rvecs[0], tvecs[0]) @ (marker_mm * UNIT_CORNERS))
    fit = fit_plane(np.concatenate(corners))
    hits = fit.plane.intersect_rays(rays).reshape(-1, 4, 3)
    z = -fit.plane.normal
    x = hits[0, 1] - hits[0, 0]
    x = x - (x @ z) * z
    x /= np.linalg.norm(x)
    axes = np.column_stack([x, np.cross(z, x)])
    flat = (hits - hits[0].mean(axis=0)) @ axes
    sides = np.linalg.norm(flat - np.roll(flat, -1, axis=1), axis=2)
    flat *= marker_mm / float(sides.mean())
    return {int(i): _place(square) for i, square in zip(seen.ids, flat, strict=True)}


def _pose(rvec: object, tvec: object) -> RigidTransform:
    return RigidTransform.from_rvec(np.asarray(rvec, np.float64), np.asarray(tvec, np.float64))


def _place(square: Floats) -> Floats:
    """x, y and rotation of a marker from its four flat corners (4, 2)."""
    along = square[1] - square[0] + square[2] - square[3]
    return np.array([*square.mean(axis=0), np.arctan2(along[1], along[0])])


def _with_the_others(
    camera: CameraIntrinsics,
    observations: Sequence[MarkerObservation],
    known: Mapping[int, Floats],
    marker_mm: float,
) -> dict[int, Floats]:
    """Markers that the first picture does not show, from pictures that show them beside known ones."""
    known = dict(known)
    wanted = {int(i) for seen in observations for i in seen.ids} - known.keys()
    for seen in observations:
        new = [k for k, i in enumerate(seen.ids) if int(i) in wanted]
        if not new or not any(int(i) in known for i in seen.ids):
            continue
        (pose,) = _sheet_poses(camera, [seen], known, marker_mm)
        sheet = pose.camera_from_board
        normal = sheet.rotation[:, 2]
        for k in new:
            rays = camera.rays(seen.corners[k])
            hits = rays * (float(normal @ sheet.translation) / (rays @ normal))[:, None]
            known[int(seen.ids[k])] = _place((sheet.inverse() @ hits)[:, :2])
            wanted.discard(int(seen.ids[k]))
    return known


def _sheet_poses(
    camera: CameraIntrinsics,
    observations: Sequence[MarkerObservation],
    known: Mapping[int, Floats],
    marker_mm: float,
) -> tuple[BoardPose, ...]:
    poses = []
    for seen in observations:
        usable = [k for k, i in enumerate(seen.ids) if int(i) in known]
        if not usable:
            poses.append(BoardPose(RigidTransform.identity(), float("inf")))
            continue
        points = marker_points(np.array([known[int(seen.ids[k])] for k in usable]), marker_mm)
        poses.append(board_pose(camera, seen.corners[usable].reshape(-1, 2), points.reshape(-1, 3)))
    return tuple(poses)
