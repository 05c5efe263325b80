"""Which way imports go: the source is read, and any other edge fails.

swarm (pure) <- agents, world (never each other) <- shells <- swarm.run
"""

from __future__ import annotations

import ast
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
PACKAGES = ("swarm", "agents", "world", "dashboards")

# modules that may touch clocks, files, processes or a network; all others are pure
SHELLS = {
    "swarm.bus",
    "swarm.zenoh_bus",
    "swarm.recording",
    "swarm.source",
    "swarm.playback",
    "swarm.verdict",
    "swarm.findings",
    "swarm.backlog",
    "swarm.container",
    "swarm.mending",
    "swarm.lifetime",
    "swarm.log",
    "swarm.runs",
    "agents.process",
    "world.process",
    "world.attendance",
    "world.conductor",
    "world.desk",
    "world.pace",
    "world.injector",
    "world.watchers",
    "dashboards.live",
    "dashboards.bridge",
}
# the only module, or package, that may import a library
ONLY = {
    "zenoh": ("swarm.zenoh_bus", "swarm.run.bench"),  # the bench's floor is a bare Zenoh barrier
    "mcap": ("swarm.container",),
    "rerun": ("dashboards",),
    "foxglove": ("dashboards",),
    "typer": ("swarm.run",),
    "rich": ("swarm.run",),
    "matplotlib": ("dashboards.figures", "dashboards.drawing", "dashboards.charts"),
    "jinja2": ("dashboards.page",),
    "pyarrow": ("swarm.run.export",),
    "psutil": ("swarm.runs", "swarm.run"),
    "setproctitle": ("swarm.lifetime", "swarm.run"),
}
# pure in what it decides, but it keeps machine code on disk
KEEPS_FILES = {"agents.navigator.compiled"}
# what no pure module may import: clocks, randomness, files, processes
IMPURE = {"time", "random", "os", "pathlib", "subprocess", "socket", "threading", "datetime"}


def modules() -> dict[str, ast.Module]:
    """Name -> syntax tree of every module of the project."""
    found = {}
    for package in PACKAGES:
        for path in sorted((ROOT / package).rglob("*.py")):
            parts = path.relative_to(ROOT).with_suffix("").parts
            name = ".".join(parts[:-1] if parts[-1] == "__init__" else parts)
            found[name] = ast.parse(path.read_text(), str(path))
    return found


MODULES = modules()


def imports(name: str) -> set[str]:
    """Full names of the modules that a module imports, anywhere in it."""
    found = set()
    for node in ast.walk(MODULES[name]):
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{name}: relative import"
            base = node.module or ""
            for alias in node.names:
                inner = f"{base}.{alias.name}"
                found.add(inner if inner in MODULES else base)
    return found


def inside(name: str, places: tuple[str, ...]) -> bool:
    return any(name == place or name.startswith(f"{place}.") for place in places)


def allowed(name: str, target: str) -> bool:
    """Whether module `name` may import the project's module `target`."""
    if inside(name, ("swarm.run",)):
        return True
    if inside(target, ("swarm.run",)):
        return False
    if inside(target, ("swarm",)):
        return name in SHELLS or target not in SHELLS or inside(name, ("dashboards",))
    if inside(name, ("world",)) and inside(target, ("world",)):
        return name in SHELLS or target not in SHELLS
    if inside(name, ("agents",)) and inside(target, ("agents",)):
        return name in SHELLS or target not in SHELLS
    if inside(name, ("dashboards",)) and inside(target, ("dashboards",)):
        return True
    return name == "world.watchers" and inside(target, ("dashboards",))


@pytest.mark.parametrize("name", sorted(MODULES))
def test_imports_go_one_way(name: str) -> None:
    project = [target for target in imports(name) if target.split(".")[0] in PACKAGES]
    assert [target for target in project if not allowed(name, target)] == []


@pytest.mark.parametrize("name", sorted(MODULES))
def test_libraries_stay_where_they_belong(name: str) -> None:
    for target in imports(name):
        library = target.split(".")[0]
        if library in ONLY:
            assert inside(name, ONLY[library]), f"{name} imports {target}"


def pure_modules() -> list[str]:
    return sorted(
        name
        for name in MODULES
        if inside(name, ("swarm", "agents", "world"))
        and name not in SHELLS | KEEPS_FILES
        and not inside(name, ("swarm.run",))
    )


@pytest.mark.parametrize("name", pure_modules())
def test_pure_modules_know_no_clock_file_or_process(name: str) -> None:
    assert {target.split(".")[0] for target in imports(name)} & IMPURE == set()


def test_every_shell_that_is_named_exists() -> None:
    assert set(MODULES) >= SHELLS


def test_a_wrong_edge_is_seen() -> None:
    assert not allowed("agents.robot", "world.scene")
    assert not allowed("world.scene", "agents.robot")
    assert not allowed("swarm.metrics", "world.scene")
    assert not allowed("agents.robot", "swarm.zenoh_bus")
    assert not allowed("world.simulation", "world.process")
    assert allowed("world.watchers", "dashboards.live")
