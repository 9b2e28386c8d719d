"""The camera from views of a flat board: Zhang 2000, as the paper uses it, and what the numbers are worth."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal, TypeAlias

import cv2
import numpy as np

from app.calibration.coverage import Coverage, doubts, focal_error, tilt_spread_deg
from app.errors import CalibrationError
from app.geometry.arrays import Floats, Pixels
from app.geometry.camera import CameraIntrinsics
from app.geometry.transform import RigidTransform
from app.vision.board import BoardObservation
from app.vision.corners import misfit

DistortionModel: TypeAlias = Literal["paper", "full"]

PARAMETERS = ("fx", "fy", "cx", "cy", "k1", "k2", "p1", "p2", "k3")
_LEAST_CORNERS, _LEAST_VIEWS = 6, 3
_GROSS_SHARE = 0.1
"""A view whose corners lie off any smooth pattern by this share of their spacing was not detected rightly."""
_BAD_FACTOR, _BAD_PX = 3.0, 0.1
"""A view is bad when its RMS is this many times the usual one and above this floor."""
_SUBSETS, _ROUNDS = 15, 6
_SIGNIFICANT = 4.0
"""k3 is kept when it is this many of its standard deviations away from zero."""


@dataclass(frozen=True, eq=False, slots=True)
class FittedView:
    """One view that the camera was solved from.

    Attributes:
        index: its place in the sequence that was given.
        camera_from_board: where the board stood.
        distance_mm: from the camera to the middle of the corners.
        corners: (N, 2) px.
        residuals: (N, 2) measured minus predicted, px.
    """

    index: int
    camera_from_board: RigidTransform
    distance_mm: float
    corners: Pixels
    residuals: Pixels

    @property
    def rms_px(self) -> float:
        return _rms(self.residuals)


@dataclass(frozen=True, slots=True)
class DroppedView:
    """One view that was not used.

    Attributes:
        index: its place in the sequence that was given.
        reason: why, as the end of a sentence.
    """

    index: int
    reason: str


@dataclass(frozen=True, eq=False, slots=True)
class IntrinsicsResult:
    """A solved camera, and what it is worth.

    Attributes:
        camera: the camera.
        model: `full` where k3 was asked for and determined, otherwise `paper`.
        rms_px: of the residual vectors' lengths, as OpenCV counts it.
        standard_deviations: (9,) of PARAMETERS; 0 for one that was held.
        views: the views that were used.
        dropped: the others.
        coverage: where the corners of the used views lie.
        tilt_spread_deg: largest angle between two boards.
        focal_error: relative standard deviation of the focal length.
        warnings: plain sentences; empty when the camera can be trusted.
    """

    camera: CameraIntrinsics
    model: DistortionModel
    rms_px: float
    standard_deviations: Floats
    views: tuple[FittedView, ...]
    dropped: tuple[DroppedView, ...]
    coverage: Coverage
    tilt_spread_deg: float
    focal_error: float
    warnings: tuple[str, ...]

    @property
    def rms_per_view_px(self) -> Floats:
        """(V,) RMS of every used view, in their order."""
        return np.array([view.rms_px for view in self.views])


@dataclass(frozen=True, eq=False, slots=True)
class _Fit:
    camera: CameraIntrinsics
    deviations: Floats
    rms_px: float


def solve_intrinsics(
    observations: Sequence[BoardObservation],
    size: tuple[int, int],
    *,
    model: DistortionModel = "paper",
    sought: str = "calibration board",
) -> IntrinsicsResult:
    """The camera that explains the views best; views that do not belong are found and dropped.

    Args:
        observations: one for each picture, empty where no board was found.
        size: width and height of the pictures.
        model: `paper` holds k3 at zero; `full` estimates it too, and keeps it only where it is determined.
        sought: what was looked for, for the message when it was never seen.

    Raises:
        CalibrationError: there are fewer than three usable views, or they lead to no camera at all.
    """
    usable, dropped = _usable_views(observations)
    if not any(observation.is_found for observation in observations):
        raise CalibrationError(
            f"No {sought} was found in any of the {len(observations)} pictures.",
            "Check the kind and the counts of the board, and that all of it is in the picture.",
        )
    if len(usable) < _LEAST_VIEWS:
        raise CalibrationError(
            f"Only {len(usable)} of {len(observations)} pictures show the {sought} well enough; "
            f"a camera needs {_LEAST_VIEWS} views at least and {20} are good."
        )
    kept = _agreeing_views(observations, usable, size)
    fit = _fit(observations, kept, size, with_k3=False)
    used_model: DistortionModel = "paper"
    if model == "full":
        with_k3 = _fit(observations, kept, size, with_k3=True)
        if _is_k3_determined(fit, with_k3, sum(len(observations[i].ids) for i in kept)):
            fit, used_model = with_k3, "full"
    views = tuple(_fitted_view(fit.camera, observations[i], i) for i in kept)
    usual = float(np.median([view.rms_px for view in views]))
    for index in sorted(set(usable) - set(kept)):
        rms = _fitted_view(fit.camera, observations[index], index).rms_px
        dropped.append(
            DroppedView(
                index,
                f"its corners are {rms:.2f} px off where {usual:.2f} px is usual: bent, blurred or wrong",
            )
        )
    return _result(fit, used_model, views, tuple(sorted(dropped, key=lambda view: view.index)), size)


def _result(
    fit: _Fit,
    model: DistortionModel,
    views: tuple[FittedView, ...],
    dropped: tuple[DroppedView, ...],
    size: tuple[int, int],
) -> IntrinsicsResult:
    poses = [view.camera_from_board for view in views]
    coverage = Coverage.of([view.corners for view in views], size)
    uncertainty = focal_error(fit.camera, fit.deviations, fit.rms_px)
    said = doubts(fit.camera, poses, [view.distance_mm for view in views], coverage, uncertainty)
    return IntrinsicsResult(
        fit.camera, model, fit.rms_px, fit.deviations, views, dropped,
        coverage, tilt_spread_deg(poses), uncertainty, said,
    )  # fmt: skip


def _usable_views(observations: Sequence[BoardObservation]) -> tuple[list[int], list[DroppedView]]:
    usable, dropped = [], []
    for index, seen in enumerate(observations):
        reason = _flaw(seen)
        if reason:
            dropped.append(DroppedView(index, reason))
        else:
            usable.append(index)
    return usable, dropped


def _flaw(seen: BoardObservation) -> str:
    """Why a view cannot be used whatever the camera is; empty where it can."""
    if not seen.is_found:
        return "no board was found in it"
    if len(seen.ids) < _LEAST_CORNERS:
        return f"it shows only {len(seen.ids)} corners"
    if not np.all(np.isfinite(seen.corners)):
        return "it has corners that are no numbers"
    board = seen.board_points[:, :2]
    if np.linalg.matrix_rank(board - board.mean(axis=0), tol=1e-6) < 2:
        return "its corners lie on one line"
    gaps = np.linalg.norm(np.diff(seen.corners, axis=0), axis=1)
    if float(np.median(misfit(seen.corners, board))) > max(_GROSS_SHARE * float(np.median(gaps)), 1.0):
        return "its corners form no flat board"
    return ""


def _agreeing_views(
    observations: Sequence[BoardObservation], usable: list[int], size: tuple[int, int]
) -> list[int]:
    """The largest set of views that one camera explains.

    Starts from all views; where that leaves some standing out, from the random half of the views whose camera
    explains the median view best (least median of squares), so that a wrong view does not judge itself.
    """
    kept = usable
    fit = _fit(observations, kept, size, with_k3=False)
    errors = _view_errors(fit.camera, observations, usable)
    if np.all(errors <= _limit(errors)) or len(usable) <= _LEAST_VIEWS + 1:
        return kept
    rng = np.random.default_rng(0)
    count = max(_LEAST_VIEWS, (len(usable) + 1) // 2)
    for _ in range(_SUBSETS):
        subset = sorted(int(i) for i in rng.choice(usable, count, replace=False))
        try:
            trial = _fit(observations, subset, size, with_k3=False)
        except CalibrationError:
            continue
        trial_errors = _view_errors(trial.camera, observations, usable)
        if np.median(trial_errors) < np.median(errors):
            errors = trial_errors
    for _ in range(_ROUNDS):
        agreeing = [i for i, error in zip(usable, errors, strict=True) if error <= _limit(errors)]
        if len(agreeing) < _LEAST_VIEWS or agreeing == kept:
            break
        kept = agreeing
        errors = _view_errors(_fit(observations, kept, size, with_k3=False).camera, observations, usable)
    return kept


def _limit(errors: Floats) -> float:
    return max(_BAD_FACTOR * float(np.median(errors)), _BAD_PX)


def _view_errors(
    camera: CameraIntrinsics, observations: Sequence[BoardObservation], which: list[int]
) -> Floats:
    """(V,) RMS of each view with the best pose the camera allows it, px."""
    return np.array([_fitted_view(camera, observations[i], i).rms_px for i in which])


def _fitted_view(camera: CameraIntrinsics, seen: BoardObservation, index: int) -> FittedView:
    is_solved, rvec, translation = cv2.solvePnP(
        seen.board_points, seen.corners, camera.matrix, camera.distortion, flags=cv2.SOLVEPNP_IPPE
    )
    if not is_solved:
        nowhere = np.full_like(seen.corners, np.inf)
        return FittedView(index, RigidTransform.identity(), np.inf, seen.corners, nowhere)
    rvec, translation = cv2.solvePnPRefineLM(
        seen.board_points, seen.corners, camera.matrix, camera.distortion, rvec, translation
    )
    pose = RigidTransform.from_rvec(np.asarray(rvec), np.asarray(translation))
    points = pose @ seen.board_points
    residuals = np.nan_to_num(seen.corners - camera.project(points), nan=np.inf)
    return FittedView(index, pose, float(np.linalg.norm(points.mean(axis=0))), seen.corners, residuals)


def _fit(
    observations: Sequence[BoardObservation], which: list[int], size: tuple[int, int], *, with_k3: bool
) -> _Fit:
    flags = 0 if with_k3 else cv2.CALIB_FIX_K3
    boards = [observations[i].board_points.astype(np.float32) for i in which]
    corners = [observations[i].corners.astype(np.float32).reshape(-1, 1, 2) for i in which]
    try:
        rms, matrix, distortion, _, _, deviations, _, _ = cv2.calibrateCameraExtended(
            boards, corners, size, np.eye(3), np.zeros(5), flags=flags
        )
    except cv2.error as error:
        raise CalibrationError(
            "The views of the board lead to no camera: they contradict each other."
        ) from error
    camera = CameraIntrinsics(
        np.asarray(matrix, np.float64), np.asarray(distortion, np.float64).ravel()[:5], size
    )
    spread = np.asarray(deviations, np.float64).ravel()[: len(PARAMETERS)]
    values = np.concatenate([camera.matrix.ravel(), camera.distortion, spread, [rms]])
    if not np.all(np.isfinite(values)) or min(camera.matrix[0, 0], camera.matrix[1, 1]) <= 0.0:
        raise CalibrationError("The views of the board lead to no camera: the solution is not finite.")
    return _Fit(camera, spread, float(rms))


def _is_k3_determined(without: _Fit, with_k3: _Fit, corners: int) -> bool:
    """Whether k3 differs from zero and the residuals fall by more than chance (F test of one parameter)."""
    k3, deviation = abs(with_k3.camera.distortion[4]), with_k3.deviations[8]
    gain = (without.rms_px**2 - with_k3.rms_px**2) / max(with_k3.rms_px**2, 1e-18) * 2.0 * corners
    return bool(k3 > _SIGNIFICANT * deviation and gain > _SIGNIFICANT**2)


def _rms(residuals: Pixels) -> float:
    return float(np.sqrt(np.mean(np.sum(residuals**2, axis=1))))
