"""The units start commands that exist, with the variables the example defines."""

from __future__ import annotations

import configparser
import re
import shlex
import shutil
import subprocess
import sysconfig
from pathlib import Path

import pytest

from tests.deploy import files

UNITS = ("swarm-world@.service", "swarm-robot@.service")
INSTALLED = "/opt/msam-swarm/bin/swarm"
ANALYZE_S = 30.0


def read(unit: str) -> configparser.ConfigParser:
    """Sections of a unit; fails on a key that is there twice."""
    parser = configparser.ConfigParser(interpolation=None, delimiters=("=",))
    parser.optionxform = str  # type: ignore[assignment,method-assign]
    parser.read_string((files.SYSTEMD / unit).read_text())
    return parser


def variables() -> dict[str, str]:
    """What the example environment file defines."""
    lines = (files.SYSTEMD / "swarm.env.example").read_text().splitlines()
    pairs = (line.partition("=") for line in lines if line and not line.startswith("#"))
    return {name: value for name, _, value in pairs}


def expand(line: str, instance: str) -> list[str]:
    """Words of an ExecStart as systemd makes them: ${NAME} is one word, $NAME is split."""
    words: list[str] = []
    for word in shlex.split(line.replace("%i", instance)):
        if re.fullmatch(r"\$[A-Z_]+", word):
            words += variables()[word[1:]].split()
        else:
            words.append(re.sub(r"\$\{([A-Z_]+)\}", lambda found: variables()[found[1]], word))
    return words


@pytest.mark.parametrize(
    ("unit", "instance", "wanted"),
    [
        (
            "swarm-world@.service",
            "two-obstacles",
            {"scenario": "two-obstacles", "run_name": "lab", "listen": "tls/0.0.0.0:7447"},
        ),
        (
            "swarm-robot@.service",
            "robot3",
            {"name": "robot3", "run_id": "lab", "connect": "tls/world.lab:7447"},
        ),
    ],
)
def test_unit_starts_a_verb_with_flags_that_exist(
    unit: str, instance: str, wanted: dict[str, str]
) -> None:
    program, *arguments = expand(read(unit)["Service"]["ExecStart"], instance)
    assert program == INSTALLED
    parameters = files.parse(arguments)
    assert {name: parameters[name] for name in wanted} == wanted
    assert parameters["tls"] == Path("/etc/msam-swarm/tls")


@pytest.mark.parametrize("unit", UNITS)
def test_unit_restarts_what_crashed_without_privileges(unit: str) -> None:
    sections = read(unit)
    service = sections["Service"]
    assert sections.sections() == ["Unit", "Service", "Install"]
    assert service["Restart"] == "on-failure"
    assert "2" in service["RestartPreventExitStatus"].split()  # a wrong flag stays wrong
    assert service["EnvironmentFile"] == "/etc/msam-swarm/swarm.env"
    assert service["User"] not in ("", "root")
    assert service["NoNewPrivileges"] == "yes"
    assert service["CapabilityBoundingSet"] == ""
    assert service["ProtectSystem"] == "strict"


def test_units_confine_world_and_robot_alike() -> None:
    world, robot = (dict(read(unit)["Service"]) for unit in UNITS)
    own = {"ExecStart", "Environment", "RestartPreventExitStatus", "TimeoutStopSec"}
    own |= {"RuntimeDirectory", "RuntimeDirectoryPreserve"}
    assert {k: v for k, v in world.items() if k not in own} == {
        k: v for k, v in robot.items() if k not in own
    }


@pytest.mark.parametrize("unit", UNITS)
def test_unit_passes_systemd_analyze(unit: str, tmp_path: Path) -> None:
    analyze = shutil.which("systemd-analyze")
    if analyze is None:
        pytest.skip("systemd-analyze is not installed")
    program = Path(sysconfig.get_path("scripts")) / "swarm"
    path = tmp_path / unit
    path.write_text((files.SYSTEMD / unit).read_text().replace(INSTALLED, str(program)))
    done = subprocess.run(
        [analyze, "verify", "--man=no", str(path)],
        capture_output=True,
        text=True,
        timeout=ANALYZE_S,
        check=False,
    )
    # an unknown key is only a warning to it; lines about other units of this host are not ours
    said = [line for line in done.stderr.splitlines() if unit in line or "swarm-" in line]
    assert (done.returncode, said) == (0, [])
