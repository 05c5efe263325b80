"""Dockerfile and compose file, read as far as that goes without a container engine."""

from __future__ import annotations

import fnmatch
import json
import re
import shlex
import tomllib

import pytest

from tests.deploy import files

DOCKERFILE = files.DEPLOY / "Dockerfile"
COMPOSE = files.DEPLOY / "compose.yaml"
PROJECT = tomllib.loads((files.ROOT / "pyproject.toml").read_text())
KNOWN = {"FROM", "WORKDIR", "RUN", "COPY", "ENV", "USER", "ENTRYPOINT", "CMD"}


def instructions() -> list[tuple[str, str]]:
    """(instruction, its arguments) of the Dockerfile, continued lines joined."""
    text = re.sub(r"^\s*#.*\n", "", DOCKERFILE.read_text(), flags=re.MULTILINE)
    lines = [line for line in text.replace("\\\n", " ").splitlines() if line.strip()]
    return [(line.split()[0], line.split(maxsplit=1)[1]) for line in lines]


def last_stage() -> list[tuple[str, str]]:
    rows = instructions()
    first = max(number for number, (name, _) in enumerate(rows) if name == "FROM")
    return rows[first:]


def copied() -> list[str]:
    """What the image is built from, relative to the repository."""
    rows = [arguments for name, arguments in instructions() if name == "COPY"]
    words = [shlex.split(row) for row in rows if "--from=" not in row]
    return [source for row in words for source in row[:-1]]


def services() -> dict[str, str]:
    """Name -> text of every service: what is indented under `services:`."""
    text = re.sub(r"\s*#.*", "", COMPOSE.read_text())
    [block] = re.findall(r"^services:\n((?:\n|  .*\n)+)", text, flags=re.MULTILINE)
    parts = re.split(r"^  ([a-z0-9]+):\n", block, flags=re.MULTILINE)
    return dict(zip(parts[1::2], parts[2::2], strict=True))


def command(service: str) -> list[str]:
    [found] = re.findall(r"^    command: (\[.*\])$", services()[service], flags=re.MULTILINE)
    words: list[str] = json.loads(found)
    return words


# --- image --------------------------------------------------------------------------------------


def test_dockerfile_uses_instructions_that_exist() -> None:
    rows = instructions()
    assert {name for name, _ in rows} == KNOWN
    assert rows[0] == ("FROM", "python:3.11-slim AS build")
    assert last_stage()[0] == ("FROM", "python:3.11-slim")


@pytest.mark.parametrize("source", copied())
def test_dockerfile_copies_what_exists_and_is_sent_to_the_builder(source: str) -> None:
    assert (files.ROOT / source).exists()
    ignore = (files.DEPLOY / "Dockerfile.dockerignore").read_text().splitlines()
    assert "*" in ignore
    assert any(fnmatch.fnmatch(source, line[1:]) for line in ignore if line.startswith("!"))


def test_project_installs_every_package_it_has() -> None:
    """An editable install finds the others as well; an image does not."""
    listed = set(PROJECT["tool"]["setuptools"]["packages"])
    folders = {
        ".".join(path.relative_to(files.ROOT).parent.parts)
        for top in {name.split(".")[0] for name in listed}
        for path in (files.ROOT / top).rglob("__init__.py")
    }
    assert listed == folders


def test_dockerfile_copies_every_package_and_file_the_build_needs() -> None:
    packages = {name.split(".")[0] for name in PROJECT["tool"]["setuptools"]["packages"]}
    project = PROJECT["project"]
    assert packages | {"pyproject.toml", project["readme"], *project["license-files"]} | {
        "deploy/constraints.txt"
    } == set(copied())
    [install] = [row for name, row in instructions() if "pip install" in row]
    assert "--constraint deploy/constraints.txt" in install


def test_dockerfile_starts_swarm_as_an_ordinary_user() -> None:
    rows = last_stage()
    names = [name for name, _ in rows]
    assert [json.loads(row) for name, row in rows if name == "ENTRYPOINT"] == [["swarm"]]
    assert "swarm" in PROJECT["project"]["scripts"]
    assert [row for name, row in rows if name == "USER"] == ["swarm"]
    assert names.index("USER") < names.index("ENTRYPOINT")
    assert not {"RUN", "COPY"} & set(names[names.index("USER") :])  # nothing it owns but its runs


def test_constraints_pin_every_dependency() -> None:
    lines = (files.DEPLOY / "constraints.txt").read_text().splitlines()
    pinned = {re.sub(r"[-_.]+", "-", line.partition("==")[0]).lower() for line in lines}
    wanted = {re.split(r"[<>=\s]", one)[0].lower() for one in PROJECT["project"]["dependencies"]}
    assert wanted <= pinned


# --- compose ------------------------------------------------------------------------------------


def test_compose_has_one_service_per_robot_of_its_scenario() -> None:
    world = files.parse(command("world"))
    assert set(services()) == {"world", *files.robots_of(world["scenario"])}


@pytest.mark.parametrize("name", files.ROBOTS)
def test_compose_robot_joins_the_world_of_the_same_run(name: str) -> None:
    world = files.parse(command("world"))
    port = world["listen"].rpartition(":")[2]
    robot = files.parse(command(name))
    assert robot["name"] == name
    assert robot["run_id"] == world["run_name"]
    assert robot["connect"] == f"tcp/world:{port}"
    assert "<<: *robot" in services()[name]


def test_compose_asks_the_run_that_it_starts_for_its_health() -> None:
    [found] = re.findall(r"^      test: (\[.*\])$", services()["world"], flags=re.MULTILINE)
    kind, program, *arguments = json.loads(found)
    assert (kind, program) == ("CMD", "swarm")
    assert files.parse(arguments)["run_id"] == files.parse(command("world"))["run_name"]


def test_compose_builds_from_the_dockerfile_and_keeps_the_runs() -> None:
    text = COMPOSE.read_text()
    [context] = re.findall(r"context: (\S+)", text)
    [dockerfile] = re.findall(r"dockerfile: (\S+)", text)
    assert ((COMPOSE.parent / context).resolve() / dockerfile) == DOCKERFILE
    [place] = re.findall(r'volumes: \["runs:(\S+)"\]', text)
    [folder] = [row for name, row in last_stage() if name == "WORKDIR"]
    assert place == f"{folder}/runs"
