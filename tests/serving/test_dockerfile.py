"""What the Dockerfile does can be tried, and the service's unit says what the server understands."""

import configparser
import importlib.util
import sys
from pathlib import Path

from app.settings import read_settings

_ROOT = Path(__file__).resolve().parents[2]


def test_every_step_of_the_dockerfile_is_tried_without_docker() -> None:
    spec = importlib.util.spec_from_file_location("try_dockerfile", _ROOT / "deploy" / "try_dockerfile.py")
    assert spec is not None
    assert spec.loader is not None
    tried = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = tried
    spec.loader.exec_module(tried)
    steps = tried.instructions((_ROOT / "Dockerfile").read_text())
    words = {word for word, _ in steps}
    assert words <= {*tried._TAKEN_OVER, *tried._OF_DOCKER}
    assert {"USER", "HEALTHCHECK", "VOLUME", "EXPOSE"} <= words
    ignored = (_ROOT / ".dockerignore").read_text().split()
    copied = [rest.split()[:-1] for word, rest in steps if word == "COPY" and "--from" not in rest]
    for name in (name for names in copied for name in names):
        assert (_ROOT / name).exists()
        assert name not in ignored
    settings = dict(pair.split("=") for word, rest in steps if word == "ENV" for pair in rest.split())
    assert read_settings({}, settings).folder == Path("/data")


def test_the_unit_sets_what_there_is_to_set() -> None:
    unit = configparser.ConfigParser(strict=False, delimiters=("=",), interpolation=None)
    unit.optionxform = str  # type: ignore[assignment,method-assign]
    unit.read_string((_ROOT / "deploy" / "turnscan.service").read_text())
    service = unit["Service"]
    lines = (_ROOT / "deploy" / "turnscan.service").read_text().splitlines()
    pairs = [pair for line in lines if line.startswith("Environment=") for pair in line[12:].split()]
    settings = read_settings({}, dict(pair.split("=", 1) for pair in pairs))
    assert settings.folder == Path("/var/lib", service["StateDirectory"])
    assert service["Type"] == "notify"
    assert float(service["WatchdogSec"]) >= 10.0
