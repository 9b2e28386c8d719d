"""What the API's description says beyond what routes and models say themselves."""

from collections.abc import Iterator
from typing import Any, Final

from app.api.examples import EXAMPLES

_SCHEMAS = "#/components/schemas/"
_PROBLEM = "application/problem+json"

TAGS: Final = [
    {"name": name, "description": words}
    for name, words in (
        ("access", "The password, who is logged in, and tokens for programs."),
        ("bench", "Camera, table and lasers: how they stand, and moving them by hand."),
        ("calibrate", "A calibration that is being made: begun, answered, taken up again; boards to print."),
        ("calibrations", "The calibrations that are kept: looked at, compared, chosen, taken in and out."),
        ("devices", "What is plugged in, and which of it makes the bench."),
        ("events", "News as they happen."),
        ("jobs", "Whatever takes long: ordered, followed, paused, cancelled, taken up again."),
        ("live", "What the camera sees now, and what is made of it."),
        ("scans", "The library: recordings and clouds, the bin, uploads and downloads."),
        ("surface", "Clouds after the scan: cleaned in steps, and measured."),
        ("server", "The server itself: its version, its addresses, a code that lets a phone in."),
        ("view", "What the 3D view shows, and how."),
    )
]

# Models whose names several modules share.
_NAMES: Final = {
    "app__access__access__Kind": "WayIn",
    "app__api__bench_out__LaserOut": "LaserOut",
    "app__api__calibration_models__CalibrationOut": "CalibrationOut",
    "app__api__calibration_models__ComparisonOut": "CalibrationComparisonOut",
    "app__api__calibration_models__LaserOut": "LaserPlaneOut",
    "app__api__routes__access__SessionOut": "LoginSessionOut",
    "app__api__routes__calibrate__SessionOut": "CalibrationSessionOut",
    "app__api__routes__scan_compare__ComparisonOut": "ScanComparisonOut",
    "app__api__scan_models__CalibrationOut": "TakenWithOut",
    "app__jobs__calibrate_state__Kind": "CalibrationKind",
    "app__live__settings__Kind": "LiveKind",
}
_COUNTED: Final = {"type": "integer", "minimum": 0}
_PIXEL: Final = {"type": "array", "items": {"type": "number"}, "minItems": 2, "maxItems": 2}
_LIVE_NUMBERS: Final = {
    "type": "object",
    "required": ["points", "saturated", "focus", "histogram", "exposure_us", "corners", "markers"],
    "properties": {
        "points": _COUNTED | {"description": "Of the stripes."},
        "saturated": _COUNTED | {"description": "Of these the clipped ones."},
        "focus": {"type": "number", "description": "The larger the sharper, for one scene and exposure."},
        "histogram": {"type": "array", "items": {"type": "number"}, "minItems": 64, "maxItems": 64},
        "exposure_us": {"anyOf": [{"type": "number"}, {"type": "null"}]},
        "corners": _COUNTED | {"description": "Of the calibration board, as far as it was found."},
        "markers": _COUNTED | {"description": "On the table, as far as they were found."},
    },
}
_LIVE_MARKS: Final = {
    "type": "object",
    "description": "Kind 3: what may be drawn over the picture, in pixels of the camera.",
    "required": ["outlines", "board", "markers"],
    "properties": {
        "outlines": {"type": "array", "items": {"type": "array", "items": _PIXEL}},
        "board": {
            "type": "array",
            "description": "Number and place of each corner.",
            "items": {"type": "array", "items": {"type": "number"}, "minItems": 3, "maxItems": 3},
        },
        "markers": {
            "type": "array",
            "description": "Number and four corners of each marker.",
            "items": {
                "type": "array",
                "prefixItems": [_COUNTED, {"type": "array", "items": _PIXEL}],
                "minItems": 2,
                "maxItems": 2,
            },
        },
    },
}
_LIVE_MESSAGE: Final = {
    "type": "object",
    "description": (
        "The JSON in a message of live pictures. A message is, little-endian: one byte of kind (0 raw, 1 "
        "mask, 2 overlay, 3 stripe, 4 mask as packed bits), one of version (1), two of nothing, four with "
        "the length of this JSON, a multiple of 8, filled up with spaces; then the JSON; then a JPEG file "
        "(0, 1, 2), positions (3: for each point of each stripe three 16-bit numbers: line, position in "
        "parts of a pixel, flags: 1 saturated, 2 a new piece begins) or zlib of bits, row by row (4)."
    ),
    "required": ["frame", "exposed_s", "size", "is_stale", "problem", "numbers"],
    "properties": {
        "frame": _COUNTED | {"description": "Of the camera; pictures with the same number belong together."},
        "exposed_s": {"type": "number", "description": "When its exposure began, by the server's own clock."},
        "size": {"type": "array", "items": {"type": "integer"}, "minItems": 2, "maxItems": 2},
        "is_stale": {"type": "boolean"},
        "problem": {"type": "string", "description": "Why no newer picture comes."},
        "numbers": {"anyOf": [_LIVE_NUMBERS, {"type": "null"}]},
        "parts": {"type": "integer", "description": "Kind 3: so many make a pixel."},
        "stripes": {
            "type": "array",
            "description": "Kind 3: laser, direction and number of points of each.",
            "items": {
                "type": "array",
                "prefixItems": [{"type": "string"}, {"enum": ["vertical", "horizontal"]}, _COUNTED],
            },
        },
        "marks": _LIVE_MARKS,
    },
}
_SOCKETS: Final = {
    "/api/v1/events": {
        "summary": "Every event as one JSON message, the first of type `state`",
        "sends": {"$ref": f"{_SCHEMAS}AnyEventOut"},
        "takes": "the text `stop`, which presses the emergency stop",
    },
    "/api/v1/live/{kind}": {
        "summary": "The newest picture each time the client asks; `kind` as for `/live/{kind}.mjpeg`",
        "sends": {"$ref": f"{_SCHEMAS}LiveMessage"},
        "takes": "any message, which asks for the next picture",
    },
}
_WAYS_IN: Final = {
    "token": {"type": "http", "scheme": "bearer", "description": "Made with POST /access/tokens."},
    "session": {"type": "apiKey", "in": "cookie", "name": "turnscan"},
}


def described(document: dict[str, Any]) -> dict[str, Any]:
    """The description of the routes with examples, problems as they are sent, events and sockets."""
    document = _renamed(document)
    schemas = document["components"]["schemas"]
    schemas["LiveMessage"] = dict(_LIVE_MESSAGE)
    for name, example in EXAMPLES.items():
        schemas[name].setdefault("examples", [example])
    for operation in _operations(document):
        operation["summary"] = operation["operationId"].replace("_", " ").capitalize()
        for status, response in operation["responses"].items():
            if status in ("4XX", "5XX"):
                response["content"] = {_PROBLEM: {"schema": {"$ref": f"{_SCHEMAS}Problem"}}}
    document["components"]["securitySchemes"] = _WAYS_IN
    document["security"] = [{}, {"token": []}, {"session": []}]
    document["x-websockets"] = _SOCKETS
    return document


def _operations(document: dict[str, Any]) -> Iterator[dict[str, Any]]:
    for operations in document["paths"].values():
        yield from operations.values()


def _renamed(part: Any) -> Any:
    """With the models' own names wherever they are named."""
    if isinstance(part, dict):
        return {_NAMES.get(key, key): _renamed(value) for key, value in part.items()}
    if isinstance(part, list):
        return [_renamed(each) for each in part]
    if isinstance(part, str) and part.startswith(_SCHEMAS):
        name = part.removeprefix(_SCHEMAS)
        return _SCHEMAS + _NAMES.get(name, name)
    return part
