"""An example of each thing that goes in and out: models by their names in the API's description."""

from typing import Any, Final, TypeAlias

Json: TypeAlias = dict[str, Any]

_CAMERA: Json = {
    "connected": True, "frozen": False, "fps": 29.9, "lost": 0, "problem": "", "size": [1280, 720],
    "name": "simulated camera",
}  # fmt: skip
_LASERS: Final = [
    {"name": "left", "colour": "red", "channel": 1},
    {"name": "right", "colour": "red", "channel": 2},
]
_TABLE: Json = {
    "driver": "horus", "port": "/dev/serial/by-id/usb-1a86_USB2.0-Serial-if00-port0", "smallest_deg": 0.1125,
    "slowest_deg_s": 0.1125, "fastest_deg_s": 180.0, "can_turn_steadily": True, "can_stop": True,
    "turns_by_itself": False, "lasers_by_hand": False,
}  # fmt: skip
_BENCH: Json = {
    "name": "my scanner", "simulated": False, "turntable": "Horus 0.2", "table": _TABLE, "angle_deg": 90.0,
    "placed": True, "lasers": ["left", "right"], "laser_facts": _LASERS, "lasers_on": ["left"],
    "camera": _CAMERA, "holder": "", "problems": [],
}  # fmt: skip
_JOB: Json = {
    "id": "20261121-101500-scan-1", "kind": "scan", "title": "A mug", "state": "running",
    "created": "2026-11-21T10:15:00Z", "ended": None, "done": 120, "total": 400, "note": "",
    "seconds": 41.2, "seconds_left": 96.0, "waits_for": "", "problem": None, "result": {}, "scan": "a-mug",
    "can_resume": False, "asks": False,
}  # fmt: skip
_CLOUD: Json = {
    "name": "clouds/20261121-101720.ply", "path": "/api/v1/scans/a-mug/clouds/20261121-101720.ply",
    "points": 184_203, "size_bytes": 6_079_012, "created": "2026-11-21T10:17:20Z",
    "detector": "zero-crossing", "calibrated": "2026-11-20T18:02:11Z", "made_by": "",
}  # fmt: skip
_TAKEN_WITH: Json = {"created": "2026-11-20T18:02:11Z", "method": "joint", "expected_error_mm": 0.034}
_SCAN: Json = {
    "name": "a-mug", "title": "A mug", "note": "before it was glued", "created": "2026-11-21T10:15:00Z",
    "status": "finished", "reason": "", "pictures": 400, "points": 184_203, "size_bytes": 52_411_904,
    "clouds": [_CLOUD], "calibration": _TAKEN_WITH, "has_thumbnail": True,
}  # fmt: skip
_KEPT: Json = {
    "name": "20261120-180211", "created": "2026-11-20T18:02:11Z", "method": "joint", "width": 1280,
    "height": 720, "lasers": ["left", "right"], "has_axis": True, "has_table": True,
    "expected_error_mm": 0.034, "level": "green", "is_current": True, "problem": "", "missing": [],
}  # fmt: skip
_PROOF: Json = {
    "verdict": "good", "level": "green", "stops": 8, "points": 21_350,
    "findings": [
        {
            "name": "size", "value_mm": 0.021, "verdict": "good", "level": "green",
            "words": "Distances on the board are right.", "cause": "", "remedy": "", "good_mm": 0.05,
            "fair_mm": 0.15,
        }
    ],
}  # fmt: skip
_KEPT_WHOLE: Json = _KEPT | {
    "focal_px": [1180.4, 1180.9], "centre_px": [641.2, 358.7], "distortion": [0.03, -0.11, 0.0, 0.0, 0.02],
    "rms_px": 0.11,
    "planes": [{"name": "left", "normal": [0.86, 0.02, -0.51], "distance_mm": -152.4, "rms_mm": 0.031}],
    "axis_rms_mm": 0.012, "chi": 1.04, "proof": _PROOF, "notes": [], "has_report": True,
}  # fmt: skip
_CALIBRATING: Json = {
    "job_id": "20261120-175600-calibrate-1", "session": "20261120-175600", "kind": "automatic",
    "steps": ["board", "proof", "table", "solving", "proving", "done"], "step": "board", "done": 0.0,
    "instruction": {
        "code": "place-board", "words": "Stand the board on the table.", "target": None, "problem": "",
    },
    "waits_for_person": True, "may_continue": True, "may_take": False, "sight": "unseen", "outline": [],
    "arrow": None, "said": "", "coverage": [[0, 2], [1, 0]], "coverage_share": 0.5,
    "views": [
        {
            "number": 0, "step": "board", "pose": 0, "angle_deg": 12.0, "corners": 88,
            "outline": [[0.3, 0.2], [0.7, 0.2], [0.7, 0.8], [0.3, 0.8]], "rms_px": None, "is_struck": False,
            "reason": "",
        }
    ],
    "taken": 1, "width": 1280, "height": 720,
}  # fmt: skip
_COUNTERS: Json = {
    "type": "counters", "frames": 18_112, "lost": 0, "fps": 29.9, "points": 92_310,
    "viewers": {"overlay": 1, "events": 2, "cloud": 1}, "live_fps": {"overlay": 15.0}, "skipped": 3,
    "bytes_sent": 48_211_930,
}  # fmt: skip
_CONTROL: Json = {
    "name": "exposure", "present": True, "value": 8000.0, "lowest": 100.0, "highest": 100_000.0,
    "automatic": False, "uses": {"laser": 8000.0, "texture": "auto"},
}  # fmt: skip
_BOARD: Json = {"kind": "chessboard", "columns": 11, "rows": 8, "square_mm": 12.0}
_COMPUTING: Json = {
    "detector": "zero-crossing", "above_mm": 1.0, "min_quality": 0.2, "with_colour": True,
}  # fmt: skip
_DISTANCES: Json = {"asked": 100_000, "median_mm": 0.03, "rms_mm": 0.06, "p95_mm": 0.12}
_SPOKEN: Json = {
    "text": "Nobody was there for a while, so the lasers went off: left.",
    "hint": "Switch them on again.",
}
_EVENT: Json = {"type": "job-changed", "job": _JOB}

EXAMPLES: Final[dict[str, Any]] = {
    "AccessOut": {"password_is_set": True, "is_let_in": True, "by": "session"},
    "AnswerOut": {"lines": ["ok"]},
    "AnyEventOut": _EVENT,
    "BenchOut": _BENCH,
    "BinOut": {
        "key": "20261121-113000-a-mug", "name": "a-mug", "title": "A mug",
        "created": "2026-11-21T10:15:00Z", "deleted": "2026-11-21T11:30:00Z", "pictures": 400,
        "points": 184_203, "frees_bytes": 52_411_904,
    },
    "BoardOut": {
        "board": _BOARD, "description": "chessboard, 11 x 8 corners, 12 mm", "is_of_bench": True,
        "ruler_mm": 100.0,
    },
    "BoxModel": {"low": [-30.0, -30.0, 2.0], "high": [30.0, 30.0, 80.0]},
    "CalibrateIn": {"kind": "automatic", "board": _BOARD, "ruler_mm": 99.8},
    "CalibrationComparisonOut": {
        "camera": {"focal_px": [0.4, 0.4], "focal_percent": 0.03, "centre_px": 0.2, "edge_px": 0.3},
        "lasers": [{"name": "left", "angle_deg": 0.01, "at_axis_mm": 0.02}],
        "axis": {"shift_mm": 0.02, "tilt_deg": 0.01, "table_mm": 0.0},
        "ball": [{"name": "left", "moved_mm": 0.02, "bent_mm": 0.01}], "bent_mm": 0.01, "expected_mm": 0.05,
        "is_explained": True, "only_first": [], "only_second": ["right"],
    },
    "CalibrationDetailOut": _KEPT_WHOLE,
    "CalibrationOut": _KEPT,
    "CalibrationSessionOut": {
        "name": "20261120-175600", "kind": "automatic", "pictures": 96, "calibration": "20261120-180211",
        "created": "2026-11-20T17:56:00Z", "problem": "",
    },
    "CalibrationState": _CALIBRATING,
    "CheckupIn": {"only": ["board", "lasers"]},
    "ChoiceIn": {
        "name": "my scanner", "board": "horus", "port": "/dev/ttyUSB0", "camera": "uvc", "device": "0",
        "lasers": [{"name": "left", "channel": 1, "colour": "red"}],
    },
    "ChosenOut": {"bench": _BENCH, "problem": ""},
    "ControlOut": _CONTROL,
    "ControlsIn": {"use": "laser", "values": {"exposure": 8000.0, "white_balance": "auto"}},
    "DevicesOut": {
        "cameras": [
            {
                "device": "0", "path": "/dev/video0", "name": "HD Pro Webcam", "usb_id": "046d:082d",
                "serial_number": "", "is_built_in": False, "problem": "",
            }
        ],
        "ports": [
            {
                "name": "/dev/serial/by-id/usb-1a86_USB2.0-Serial-if00-port0", "path": "/dev/ttyUSB0",
                "description": "USB2.0-Serial", "usb_id": "1a86:7523", "serial_number": "", "problem": "",
                "in_use": True,
            }
        ],
        "presets": [
            {"name": "ciclop", "title": "BQ Ciclop", "board": "horus", "camera": "uvc", "note": ""}
        ],
        "bench": "bench.toml",
    },
    "ErasedOut": {"scans": 1, "freed_bytes": 52_411_904},
    "EstimateOut": {
        "seconds": 170.0, "capture_s": 150.0, "shots": 600, "points": 180_000, "size_bytes": 54_000_000,
        "is_measured": True,
    },
    "ExportIn": {"scan": "a-mug", "form": "xyz"},
    "ExposureIn": {"laser": "left"},
    "ExposureOut": {
        "control": _CONTROL, "clipped": 0.01, "bright_grey": 212.0, "pictures": 9, "advice": "",
    },
    "FreedOut": {"freed_bytes": 6_079_012},
    "IdentityOut": {
        "board": "horus", "firmware": "Horus 0.2", "baud": 115_200, "notes": [], "options": {},
    },
    "ImportedOut": {"calibration": _KEPT_WHOLE, "was_there": False},
    "JobOut": _JOB,
    "Line": {"line": "G90", "understood": True},
    "DoneIn": {"words": "Turn the table to 30 degrees, then confirm."},
    "DetectorOut": {"name": "zero-crossing", "threshold": 12.0},
    "LiveIn": {"threshold": 25.0, "channel": "red"},
    "LiveMessage": {
        "frame": 7, "exposed_s": 12.5, "size": [640, 480], "is_stale": False, "problem": "", "numbers": None,
        "parts": 16, "stripes": [["left", "vertical", 2]],
        "marks": {"outlines": [], "board": [], "markers": []},
    },
    "LiveOut": {
        "detector": "zero-crossing", "threshold": 25.0, "channel": "red", "laser": None, "quality": 80,
        "width": None, "line_step": 2, "shows_board": True, "shows_markers": True, "shows_region": True,
        "polygon": [], "cylinder": {"radius_mm": 100.0, "lowest_mm": -2.0, "highest_mm": 200.0},
    },
    "LoginIn": {"password": "a sentence that only we know"},
    "LoginSessionOut": {
        "id": "3f9c2b", "browser": "Firefox on Linux", "created": "2026-11-21T10:00:00Z",
        "last_seen": "2026-11-21T10:15:00Z", "expires": "2026-12-21T10:00:00Z", "is_this": True,
    },
    "LookIn": {"preset": "top"},
    "MeasureIn": {"tab": "left-window", "across": 0.52, "down": 0.4},
    "Move": {"by_deg": 45.0, "speed_deg_s": 30.0},
    "PasswordIn": {"old": "a sentence that only we know", "new": "another one that nobody guesses"},
    "PicturesOut": {
        "total": 400, "start": 0, "width": 1280, "height": 720,
        "pictures": [
            {
                "number": 0, "role": "scan", "angle_deg": 0.0, "lasers_on": ["left"], "pose": None,
                "time_s": 0.4, "exposure_us": 8000.0,
            }
        ],
    },
    "PortIn": {"port": "/dev/ttyUSB0"},
    "Problem": {
        "type": "turnscan:bench-busy", "title": "The bench is busy: a scan holds it.", "status": 409,
        "hint": "Wait until it has ended, or cancel it.",
    },
    "ReconstructIn": _COMPUTING | {"scan": "a-mug", "calibration": "current"},
    "ResumeIn": {"scan": "a-mug"},
    "RetryIn": {"accept_position": False},
    "ScanComparisonOut": {
        "first": _SCAN, "second": _SCAN | {"name": "a-mug-2", "title": "A mug, glued"},
        "settings": [{"setting": "steps", "first": 200, "second": 400}], "calibration": None,
        "calibration_note": "Both were taken with the same calibration.",
        "deviation": {"there": _DISTANCES, "back": _DISTANCES, "spacing_mm": 0.4}, "deviation_note": "",
    },
    "ScanIn": _COMPUTING | {"title": "A mug", "lasers": ["left", "right"], "mode": "step", "steps": 200},
    "ScanOut": _SCAN,
    "CodeIn": {"address": "http://192.168.1.20:8000"},
    "CodeOut": {
        "link": "http://192.168.1.20:8000/login#key=of-one-use", "rows": ["111", "101", "111"],
        "lasts_s": 600.0,
    },
    "ServerOut": {
        "version": "0.1.0", "python": "3.11.7", "system": "Linux x86_64", "folder": "/srv/turnscan",
        "addresses": ["http://192.168.1.20:8000"], "is_local": False, "is_encrypted": False,
    },
    "SessionIn": {"session": "20261120-175600", "redo": "solving"},
    "ShowIn": {"scan": "a-mug"},
    "SpaceOut": {
        "free_bytes": 21_474_836_480, "used_bytes": 524_288_000, "bin_bytes": 52_411_904,
        "upload_bytes": 17_179_869_184,
    },
    "StageOut": {"stage": "board"},
    "StateOut": {"type": "state", "bench": _BENCH, "jobs": [_JOB], "counters": _COUNTERS},
    "Switch": {"on": True},
    "StepKindOut": {
        "kind": "quality", "words": "Keeps points by what the scan itself knows of them.",
        "settings": {"type": "object", "properties": {"least": {"type": "number", "default": 0.3}}},
    },
    "CleaningIn": {"scan": "a-mug", "steps": [{"kind": "statistical-outliers"}, {"kind": "table"}]},
    "CleaningOut": {
        "scan": "a-mug", "cloud": "clouds/20261121-101720.ply", "points": 184_203, "left": 160_518,
        "share": 0.5, "shown": True,
        "effects": [
            {"kind": "statistical-outliers", "before": 92_102, "after": 91_020, "taken": 2_164, "note": ""},
            {"kind": "table", "before": 91_020, "after": 80_259, "taken": 21_522, "note": ""},
        ],
    },
    "SurfaceMeasureIn": {
        "scan": "a-mug", "steps": [{"kind": "cylinder", "bottom_mm": 10.0, "top_mm": 60.0}],
        "shape": "cylinder", "ends": [[-40.0, 0.0, 40.0], [40.0, 0.0, 40.0]], "against": {"scan": "a-mug-2"},
    },
    "SurfaceMeasuresOut": {
        "points": 120_400, "whole": 184_203, "shown": True,
        "size": {
            "low_mm": [-40.1, -40.0, 10.0], "high_mm": [40.0, 40.1, 60.0], "extent_mm": [80.1, 80.1, 50.0],
            "smallest_mm": [80.1, 80.0, 50.0], "turned_deg": 12.5, "area_mm2": None, "volume_mm3": None,
        },
        "fit": {
            "kind": "cylinder", "centre_mm": [0.02, -0.01, 35.0], "direction": [0.0, 0.0, 1.0],
            "radius_mm": 40.02, "diameter_mm": 80.04, "rms_mm": 0.031, "robust_mm": 0.033, "used": 118_900,
            "given": 120_400,
        },
        "distance": {
            "start_mm": [-40.0, 0.0, 40.0], "end_mm": [40.0, 0.0, 40.0], "distance_mm": 80.0,
            "moved_mm": [0.1, 0.1],
        },
        "deviation": {
            "points": 120_400, "signed": True, "mean_mm": 0.01, "median_mm": 0.01, "median_away_mm": 0.03,
            "rms_mm": 0.05, "p95_mm": 0.1, "largest_mm": 1.2, "scale_mm": 0.1,
            "histogram": {"edges_mm": [-0.1, 0.0, 0.1], "counts": [58_200, 62_200]},
        },
    },
    "TextureIn": {"scan": "a-mug", "pictures": 24},
    "ErasedMeshOut": {"freed_bytes": 7_310_284},
    "FinishPresetOut": {
        "preset": "print", "steps": [{"kind": "quality"}, {"kind": "statistical-outliers"}],
        "mesh": {"is_closed": True, "tolerance_mm": 0.03},
    },
    "LassoIn": {"tab": "page", "outline": [[0.1, 0.1], [0.4, 0.1], [0.4, 0.5]], "keep": "outside"},
    "LassoOut": {"step": {"kind": "lasso", "keep": "outside"}},
    "PickIn": {"tab": "page", "across": 0.5, "down": 0.4, "before": []},
    "PickOut": {"point": [12.4, -3.1, 40.2]},
    "ThrownAway": {"key": "20261121-113000-a-mug"},
    "TokenIn": {"name": "the script in the workshop"},
    "TokenMade": {"name": "the script in the workshop", "secret": "shown this once"},
    "TokenOut": {
        "id": "9a1e04", "name": "the script in the workshop", "created": "2026-11-21T10:00:00Z",
        "last_used": None,
    },
    "TriedOut": {
        "ok": True, "said": ["The laser left went on, and the camera sees its stripe."],
    },
    "ViewIn": {"colour": "height", "point_size_mm": 0.4},
    "ViewOut": {
        "live": False, "scan": "a-mug", "cloud": "clouds/20261121-101720.ply", "points": 184_203,
        "nowhere": 0, "colour": "texture", "point_size_mm": 0.4, "dark": True, "viewers": 1,
        "extent": {"low": [-42.0, -40.5, 0.4], "high": [41.5, 40.0, 92.1]}, "crop": None,
        "measured": [[-42.0, 0.0, 40.0], [41.5, 0.0, 40.0]], "distance_mm": 83.5,
    },
    "Words": {"title": "A mug, glued", "note": "after it was glued"},
    "Zero": {"angle_deg": 0.0},
    "BenchChangedOut": {"type": "bench-changed", "bench": _BENCH},
    "CalibrationChangedOut": {"type": "calibration-changed", "calibration": _CALIBRATING},
    "CountersOut": _COUNTERS,
    "JobChangedOut": _EVENT,
    "JobSaidOut": {"type": "job-said", "job_id": _JOB["id"], "line": "The cloud has 184203 points."},
    "NoticeOut": {"type": "notice"} | _SPOKEN,
    "PointsAddedOut": {"type": "points-added", "job_id": _JOB["id"], "points": 92_310},
}  # fmt: skip
"""Each is valid for its model; a test sees to that."""
