"""What each way of calibrating does to a surface, on numeric views of a known rig, and what it costs."""

import time
from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from app.calibration.joint import solve_joint
from app.calibration.views import Evidence
from app.geometry.camera import CameraIntrinsics
from app.geometry.rig import Rig
from app.vision.board import BoardSpec
from benchmarks.calibration_baselines import axis_line_points, horus_rig, paper_rig
from benchmarks.report import Row, at_least, at_most
from benchmarks.synthetic_views import BOARD, Noise, SyntheticViews, surface_error_mm, typical_rig

_SEEDS = 20
_UM = 1000.0
_HAND_MM, _HAND_DEG = 0.5, 0.3
_A4_BOARD = BoardSpec("chessboard", 11, 8, 10.0)
_TURNS = (-40.0, -20.0, 0.0, 20.0, 40.0)
_JOINT, _FREE = "joint", "joint, camera solved with it"
_HORUS, _PAPER, _HAND = "Horus's", "paper's, placed perfectly", "paper's, placed by hand"


@dataclass(frozen=True, slots=True)
class Layout:
    """Where the board stands.

    Attributes:
        name: for the table.
        board: that stands there.
        lasers: of the rig.
        placements: distance of the board from the axis, mm, and the table's angles, degrees.
        free_views: of the board in a hand, for the camera.
    """

    name: str
    board: BoardSpec
    lasers: int
    placements: Mapping[float, tuple[float, ...]]
    free_views: int = 0


_TWO = {30.0: _TURNS, -30.0: _TURNS}
_LONG = Layout(
    "one placement, 20 views", BOARD, 1, {35.0: tuple(float(a) for a in np.linspace(-47.5, 47.5, 20))}
)
_SHORT = Layout("two placements, 10 views", _A4_BOARD, 2, _TWO, free_views=20)
_SMALL = Layout("the same, smaller board, one laser", BOARD, 1, _TWO)


@dataclass(slots=True)
class Trials:
    """Errors of each method, um, and what the joint one said of itself; a number for each seed."""

    errors: dict[str, list[float]]
    predicted: list[float]
    chi: list[float]
    seconds: list[float]

    def rms(self, method: str) -> float:
        return _rms(self.errors[method])


def run() -> list[Row]:
    rows = []
    for layout in (_LONG, _SHORT, _SMALL):
        trials = tried(layout)
        rows += _rows(layout, trials)
    return rows


def tried(layout: Layout, seeds: int = _SEEDS) -> Trials:
    """Every method on the same views, for some seeds of the noise."""
    trials = Trials({}, [], [], [])
    for seed in range(seeds):
        rng = np.random.default_rng(seed)
        rig = typical_rig(layout.lasers)
        views = SyntheticViews(rig, rng, board=layout.board)
        for number, (beside_mm, angles_deg) in enumerate(layout.placements.items()):
            views.placement(number, angles_deg, beside_mm, 0.0)
        on_table = views.evidence()
        start = time.perf_counter()
        found = solve_joint(on_table, rig.camera, refine_camera=False)
        trials.seconds.append(time.perf_counter() - start)
        trials.predicted.append(_UM * found.expected_error_mm)
        trials.chi.append(found.chi)
        methods: dict[str, Rig] = {_JOINT: found.rig}
        if layout.free_views:
            views.free_boards(layout.free_views)
            methods[_FREE] = solve_joint(views.evidence(), _guessed(rig.camera), refine_camera=True).rig
        methods |= _others(on_table, rig, rng)
        for method, solved in methods.items():
            trials.errors.setdefault(method, []).append(_UM * surface_error_mm(rig, solved))
    return trials


def _others(evidence: Evidence, rig: Rig, rng: np.random.Generator) -> dict[str, Rig]:
    perfect = axis_line_points(rig, rng, Noise(), 0.0, 0.0)
    by_hand = axis_line_points(rig, rng, Noise(), _HAND_MM, _HAND_DEG)
    return {
        _HORUS: horus_rig(evidence, rig.camera),
        _PAPER: paper_rig(evidence, rig.camera, perfect),
        _HAND: paper_rig(evidence, rig.camera, by_hand),
    }


def _guessed(camera: CameraIntrinsics) -> CameraIntrinsics:
    """A camera as another calibration may have left it, to start from."""
    matrix = camera.matrix * [[1.004], [1.003], [1.0]] + [[0.0, 0.0, 3.0], [0.0, 0.0, -2.0], [0.0, 0.0, 0.0]]
    return replace(camera, matrix=matrix, distortion=0.7 * camera.distortion)


def _rows(layout: Layout, trials: Trials) -> list[Row]:
    board = layout.board
    rows = []
    for method in trials.errors:
        note = f"median {np.median(trials.errors[method]):.1f}, worst {max(trials.errors[method]):.1f}"
        what = f"{layout.name}: surface error, {method}"
        value = trials.rms(method)
        if method in (_JOINT, _FREE):
            note += f"; {board.description}, {layout.lasers} laser(s)"
            is_aim = layout is _SHORT
            rows.append(
                at_most(what, value, "um RMS", 5.0, note) if is_aim else Row(what, value, "um RMS", note=note)
            )
        else:
            rows.append(Row(what, value, "um RMS", note=note))
    best = trials.rms(_JOINT)
    ratios = ((_HORUS, 5.0), (_HAND, 50.0))
    rows += [at_least(f"{layout.name}: {other} error / joint", trials.rms(other) / best, "x", times)
             for other, times in ratios]  # fmt: skip
    told = float(np.mean(trials.predicted)) / best
    rows.append(
        Row(
            f"{layout.name}: predicted / actual error", told, "", "0.67 .. 2.5", 0.67 <= told <= 2.5,
            "the prediction allows for shifted stripes, which these views do not have",
        )
    )  # fmt: skip
    chi = float(np.mean(trials.chi))
    rows.append(Row(f"{layout.name}: chi", chi, "", "0.9 .. 1.1", 0.9 <= chi <= 1.1))
    rows.append(Row(f"{layout.name}: one joint solve", float(np.median(trials.seconds)), "s", note="median"))
    return rows


def _rms(values: list[float]) -> float:
    return float(np.sqrt(np.mean(np.square(values))))
