"""Does what the Dockerfile does, step by step, in a scratch folder and without Docker.

    python deploy/try_dockerfile.py            # all of it: installs every dependency, some minutes
    python deploy/try_dockerfile.py --quick    # with the packages that are installed here, without the pages

Each stage becomes a folder, its Python an environment of its own; users, volumes and ports are the machine's.
Ends with 0 when the server that the image would run has answered its own health check, and ended when told.
"""

import argparse
import os
import re
import shlex
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from dataclasses import dataclass, field
from fnmatch import fnmatch
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
_TAKEN_OVER = ("FROM", "WORKDIR", "COPY", "RUN", "ENV", "HEALTHCHECK", "ENTRYPOINT", "CMD")
_OF_DOCKER = ("USER", "VOLUME", "EXPOSE", "STOPSIGNAL")
_START_S = 120.0


@dataclass
class Stage:
    """A stage that is being built.

    Attributes:
        name: as other stages copy from it.
        root: the folder that stands for its file system.
        workdir: in it.
        environment: that it sets.
    """

    name: str
    root: Path
    workdir: str = "/"
    environment: dict[str, str] = field(default_factory=dict)
    health: list[str] = field(default_factory=list)
    entrypoint: list[str] = field(default_factory=list)
    command: list[str] = field(default_factory=list)

    @property
    def python(self) -> Path:
        return self.root / "venv" / "bin"

    def there(self, path: str) -> Path:
        """Where a path of the image lies."""
        return self.root / os.path.normpath(os.path.join(self.workdir, path)).lstrip("/")  # noqa: PTH118


def instructions(text: str) -> list[tuple[str, str]]:
    """Words and arguments of a Dockerfile, continued lines joined, comments left out."""
    lines = [line for line in text.splitlines() if line.strip() and not line.lstrip().startswith("#")]
    joined = re.sub(r"\\\n\s*", " ", "\n".join(lines))
    return [(word.upper(), rest) for word, _, rest in (line.partition(" ") for line in joined.splitlines())]


def build(scratch: Path, *, is_quick: bool) -> Stage:
    """Every instruction, in order; the last stage.

    Raises:
        ValueError: one that is not known here.
        subprocess.CalledProcessError: a step failed.
    """
    stages: dict[str, Stage] = {}
    stage = None
    for word, rest in instructions((ROOT / "Dockerfile").read_text("utf-8")):
        print(f"-- {word} {rest}", flush=True)
        if word == "FROM":
            name = rest.split(" AS ")[1] if " AS " in rest else f"stage{len(stages)}"
            stage = stages[name] = Stage(name, scratch / name)
            _make_python(stage, is_quick=is_quick)
            continue
        if stage is None:
            raise ValueError(f"{word} comes before FROM")
        _step(stage, stages, word, rest, is_quick=is_quick)
    if stage is None:
        raise ValueError("the Dockerfile has no stage")
    return stage


def try_server(stage: Stage, port: int) -> None:
    """Run what the image runs, on the simulated bench, ask it how it is, and end it.

    Raises:
        RuntimeError: it did not become healthy, or did not end well.
    """
    environment = _environment(stage) | {"TURNSCAN_PORT": str(port), "TURNSCAN_BENCH": "simulated"}
    command = [*stage.entrypoint, *stage.command]
    print(f"-- {shlex.join(command)}", flush=True)
    began_s = time.monotonic()
    server = subprocess.Popen(
        [stage.python / command[0], *command[1:]], cwd=stage.there("."), env=environment
    )
    try:
        while not _is_healthy(stage, environment):
            if server.poll() is not None or time.monotonic() - began_s > _START_S:
                raise RuntimeError("the server does not become healthy")
            time.sleep(0.2)
        print(f"healthy after {time.monotonic() - began_s:.1f} s", flush=True)
    finally:
        server.send_signal(signal.SIGTERM)
        code = server.wait(60.0)
    if code:
        raise RuntimeError(f"the server ended with {code}")
    if _is_healthy(stage, environment):
        raise RuntimeError("the health check is content though nothing runs")


def _step(stage: Stage, stages: dict[str, Stage], word: str, rest: str, *, is_quick: bool) -> None:
    if word == "WORKDIR":
        stage.workdir = str(Path(stage.workdir, rest))
        stage.there(".").mkdir(parents=True, exist_ok=True)
    elif word == "COPY":
        _copy(stage, stages, rest)
    elif word == "RUN":
        _run(stage, rest, is_quick=is_quick)
    elif word == "ENV":
        for pair in shlex.split(rest):
            name, _, value = pair.partition("=")
            stage.environment[name] = str(stage.there(value)) if value.startswith("/") else value
    elif word == "HEALTHCHECK":
        stage.health = _listed(rest.partition("CMD ")[2])
    elif word == "ENTRYPOINT":
        stage.entrypoint = _listed(rest)
    elif word == "CMD":
        stage.command = _listed(rest)
    elif word not in (*_TAKEN_OVER, *_OF_DOCKER):
        raise ValueError(f"{word} is not known here: teach {Path(__file__).name} what it does")


def _copy(stage: Stage, stages: dict[str, Stage], rest: str) -> None:
    words = rest.split()
    source = ROOT
    ignored = _ignored()
    if words[0].startswith("--from="):
        source, ignored = stages[words.pop(0).removeprefix("--from=")].root, []
    target = stage.there(words[-1])
    for name in words[:-1]:
        found = source / name.lstrip("/")
        if found.is_dir():
            shutil.copytree(found, target, dirs_exist_ok=True, ignore=_leaving_out(source, ignored))
        elif any(fnmatch(name, pattern) for pattern in ignored):
            raise ValueError(f"{name} is copied, and left out by .dockerignore")
        else:
            shutil.copy2(found, target / found.name if words[-1].endswith("/") else target)


def _run(stage: Stage, command: str, *, is_quick: bool) -> None:
    if command.startswith("useradd"):
        print("   (users are the machine's)", flush=True)
        command = "mkdir -p /data"
    # Paths of the image are those of its folder.
    command = re.sub(r"(?<![\w/.])/(wheels|data|src)\b", lambda found: str(stage.root / found[1]), command)
    environment = _environment(stage)
    if is_quick:
        environment |= {"TURNSCAN_WITHOUT_PAGES": "1"}
        command = command.replace("pip wheel", "pip wheel --no-build-isolation")
        # The packages of this machine's environment are seen, and need not be fetched.
        command = re.sub(r"pip install (.*?)\"(.*)\[.*\]\"", r'pip install --no-deps \1"\2"', command)
    subprocess.run(command, shell=True, cwd=stage.there("."), env=environment, check=True)


def _make_python(stage: Stage, *, is_quick: bool) -> None:
    stage.root.mkdir(parents=True)
    subprocess.run([sys.executable, "-m", "venv", stage.root / "venv"], check=True)
    if is_quick:
        here = next(Path(folder) for folder in sys.path if folder.endswith("site-packages"))
        packages = next((stage.root / "venv" / "lib").glob("python*")) / "site-packages"
        (packages / "here.pth").write_text(f"{here}\n", "utf-8")


def _environment(stage: Stage) -> dict[str, str]:
    kept = {name: value for name, value in os.environ.items() if not name.startswith("TURNSCAN_")}
    return (
        kept | stage.environment | {"PATH": f"{stage.python}:{os.environ['PATH']}", "PYTHONNOUSERSITE": "1"}
    )


def _is_healthy(stage: Stage, environment: dict[str, str]) -> bool:
    command = [str(stage.python / stage.health[0]), *stage.health[1:]]
    return subprocess.run(command, cwd=stage.there("."), env=environment, check=False).returncode == 0


def _listed(text: str) -> list[str]:
    return [word.strip('"') for word in re.findall(r'"[^"]*"', text)]


def _ignored() -> list[str]:
    return (ROOT / ".dockerignore").read_text("utf-8").split()


def _leaving_out(source: Path, patterns: list[str]):  # type: ignore[no-untyped-def]
    def left_out(folder: str, names: list[str]) -> set[str]:
        inside = Path(folder).relative_to(source)
        return {
            name
            for name in names
            if any(
                fnmatch(str(inside / name), pattern) or fnmatch(name, pattern.removeprefix("**/"))
                for pattern in patterns
            )
        }

    return left_out


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--quick", action="store_true", help="with the packages that are installed here")
    parser.add_argument("--port", type=int, default=8765)
    options = parser.parse_args()
    with tempfile.TemporaryDirectory(prefix="turnscan-image-", ignore_cleanup_errors=True) as scratch:
        stage = build(Path(scratch), is_quick=options.quick)
        try_server(stage, options.port)
    print("The image would work: built, started, healthy, ended.")
    return 0


if __name__ == "__main__":
    sys.exit(main())
