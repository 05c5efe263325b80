"""What deploy/ holds, brought to life: certificates, routers, a folder whose processes all end."""

from __future__ import annotations

import json
import subprocess
from collections.abc import Iterator
from pathlib import Path

import pytest
import zenoh

from tests.deploy import files
from tests.run import processes


@pytest.fixture
def folder(tmp_path: Path) -> Iterator[Path]:
    """Working directory of a test's processes; none of them is left when the test is over."""
    yield tmp_path
    processes.end_all(tmp_path)


@pytest.fixture(scope="session")
def certificates(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Folder that certificates.sh has made for the robots of two-obstacles."""
    made = tmp_path_factory.mktemp("certificates") / "tls"
    subprocess.run([files.CERTIFICATES, made, *files.ROBOTS], check=True, capture_output=True)
    return made


@pytest.fixture
def plain_router(endpoint: str) -> Iterator[str]:
    """Endpoint of a router opened from router/plain.json5, on a port of its own."""
    config = zenoh.Config.from_file(str(files.PLAIN))
    config.insert_json5("listen/endpoints", json.dumps([endpoint]))
    with zenoh.open(config):
        yield endpoint


@pytest.fixture
def secure_router(endpoint: str, certificates: Path) -> Iterator[str]:
    """Endpoint of a router opened from router/secure.json5, with certificates made here."""
    endpoint = endpoint.replace("tcp/", "tls/")
    config = zenoh.Config.from_file(str(files.SECURE))
    config.insert_json5("listen/endpoints", json.dumps([endpoint]))
    for key in ("root_ca_certificate", "listen_certificate", "listen_private_key"):
        path = f"transport/link/tls/{key}"
        name = Path(json.loads(config.get_json(path))).name
        config.insert_json5(path, json.dumps(str(certificates / name)))
    with zenoh.open(config):
        yield endpoint
