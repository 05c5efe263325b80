"""certificates.sh makes what `--tls DIR` expects, and nobody else gets in with anything less."""

from __future__ import annotations

import json
import shutil
import stat
import subprocess
from pathlib import Path

import pytest
import trustme
import zenoh
from cryptography import x509
from cryptography.x509.oid import ExtendedKeyUsageOID as Usage
from cryptography.x509.oid import NameOID

from swarm import errors, zenoh_bus
from tests.deploy import files
from tests.run import processes

PROCESSES = ("world", "supervisor", "router", *files.ROBOTS)


def make(*arguments: str | Path) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [files.CERTIFICATES, *arguments], capture_output=True, text=True, check=False
    )


def read(path: Path) -> x509.Certificate:
    return x509.load_pem_x509_certificate(path.read_bytes())


def hosts(certificate: x509.Certificate) -> set[str]:
    names = certificate.extensions.get_extension_for_class(x509.SubjectAlternativeName).value
    addresses = {str(address) for address in names.get_values_for_type(x509.IPAddress)}
    return addresses | set(names.get_values_for_type(x509.DNSName))


@pytest.mark.parametrize("name", PROCESSES)
def test_certificates_name_the_process_and_its_use(certificates: Path, name: str) -> None:
    certificate = read(certificates / f"{name}.pem")
    certificate.verify_directly_issued_by(read(certificates / "ca.pem"))
    common = certificate.subject.get_attributes_for_oid(NameOID.COMMON_NAME)
    assert [one.value for one in common] == [name]
    assert hosts(certificate) == {"127.0.0.1", "::1", "localhost"}
    uses = set(certificate.extensions.get_extension_for_class(x509.ExtendedKeyUsage).value)
    both = {Usage.SERVER_AUTH, Usage.CLIENT_AUTH}
    assert uses == (both if name in ("world", "router") else {Usage.CLIENT_AUTH})


def test_certificates_keep_keys_to_their_owner(certificates: Path) -> None:
    modes = {path.name: stat.S_IMODE(path.stat().st_mode) for path in certificates.glob("*.key")}
    assert modes == {f"{name}.key": 0o600 for name in ("ca", *PROCESSES)}


def test_certificates_add_a_robot_with_its_hosts_and_keep_the_others(
    certificates: Path, tmp_path: Path
) -> None:
    copy = shutil.copytree(certificates, tmp_path / "copy")
    kept = {path.name: path.read_bytes() for path in copy.iterdir()}
    done = make(copy, "--hosts", "arm-1.lab,192.168.1.10,fe80::7", "robot9")
    assert done.returncode == 0, done.stderr
    assert {name: (copy / name).read_bytes() for name in kept} == kept
    assert {path.name for path in copy.iterdir()} - set(kept) == {"robot9.pem", "robot9.key"}
    added = read(copy / "robot9.pem")
    added.verify_directly_issued_by(read(copy / "ca.pem"))
    assert hosts(added) - {"127.0.0.1", "::1", "localhost"} == {
        "arm-1.lab",
        "192.168.1.10",
        "fe80::7",
    }


@pytest.mark.parametrize(
    ("arguments", "text"),
    [
        (["Robot1"], "expected a robot's name such as robot3, got 'Robot1'"),
        (["../robot1"], "got '../robot1'"),
        (["--hosts", "a b;c", "robot1"], "expected --hosts as names or addresses"),
        (["--days", "0", "robot1"], "expected --days as a number above 0, got '0'"),
        (["--force", "robot1"], "got --force"),
        (["--hosts"], "expected DIR"),
    ],
)
def test_certificates_refuse_what_they_cannot_name(
    tmp_path: Path, arguments: list[str], text: str
) -> None:
    done = make(tmp_path / "tls", *arguments)
    assert done.returncode == 2
    assert text in done.stderr
    assert not (tmp_path / "tls").exists()


def test_swarm_runs_the_same_over_tls_as_in_memory(folder: Path, certificates: Path) -> None:
    run = ("run", "two-obstacles", "--duration", "2", "--json", "--quiet", *files.UNRECORDED)
    found = []
    for way in (("--tls", str(certificates)), ("--bus", "memory")):
        done = processes.swarm(folder, *run, *way, "--out", way[0].strip("-"))
        assert done.returncode == 1, done.stderr  # 2 s do not suffice to arrive
        found.append(json.loads(done.stdout))
    over_tls, in_memory = found
    assert over_tls["outcome"] == "timeout"
    assert over_tls["commands_total"] == 6 * (over_tls["ticks"] + 1)  # tick 0 has some, too
    for figure in ("ticks", "collisions", "per_robot", "formation", "min_clearance_robot_m"):
        assert over_tls[figure] == in_memory[figure], figure


def test_world_refuses_who_shows_no_certificate_of_its_authority(
    endpoint: str, certificates: Path, tmp_path: Path
) -> None:
    other = trustme.CA()
    strange = other.issue_cert("127.0.0.1", common_name="robot1")
    shutil.copy(certificates / "ca.pem", tmp_path)  # it trusts the world; the world not it
    strange.private_key_pem.write_to_path(str(tmp_path / "robot1.key"))
    strange.cert_chain_pems[0].write_to_path(str(tmp_path / "robot1.pem"))
    endpoint = endpoint.replace("tcp/", "tls/")
    world = zenoh_bus.open_router("tls", endpoint, tls=certificates)
    try:
        with pytest.raises(errors.BusError, match="reach the router"):
            zenoh_bus.open_client(
                "tls", endpoint, name="robot1", tls=tmp_path, connect_timeout_s=0.3
            )
        nobody = zenoh.Config()
        for key, value in {
            "mode": "client",
            "connect/endpoints": [endpoint],
            "transport/link/tls/root_ca_certificate": str(certificates / "ca.pem"),
        }.items():
            nobody.insert_json5(key, json.dumps(value))
        with pytest.raises(zenoh.ZError):
            zenoh.open(nobody)
        zenoh_bus.open_client("tls", endpoint, name="robot1", tls=certificates).close()
    finally:
        world.close()


def test_robots_refuse_a_robot_that_poses_as_the_world(
    endpoint: str, certificates: Path, tmp_path: Path
) -> None:
    stolen = shutil.copytree(certificates, tmp_path / "stolen")
    for end in ("pem", "key"):
        shutil.copy(certificates / f"robot1.{end}", stolen / f"world.{end}")
    endpoint = endpoint.replace("tcp/", "tls/")
    impostor = zenoh_bus.open_router("tls", endpoint, tls=stolen)
    try:
        with pytest.raises(errors.BusError, match="reach the router"):
            zenoh_bus.open_client(
                "tls", endpoint, name="robot2", tls=certificates, connect_timeout_s=0.3
            )
    finally:
        impostor.close()


@pytest.mark.parametrize(
    ("endpoint", "encrypted", "text"),
    [
        ("tcp/127.0.0.1:7447", True, "'tcp/127.0.0.1:7447' with it"),
        ("tls/127.0.0.1:7447", False, "'tls/127.0.0.1:7447' without it"),
        ("127.0.0.1", False, "expected an endpoint such as tcp/127.0.0.1:7447, got '127.0.0.1'"),
    ],
)
def test_bus_refuses_an_endpoint_that_would_not_be_what_was_asked_for(
    certificates: Path, endpoint: str, encrypted: bool, text: str
) -> None:
    tls = certificates if encrypted else None
    with pytest.raises(errors.UsageError) as caught:
        zenoh_bus.open_router("tls", endpoint, tls=tls)
    assert text in str(caught.value)
    with pytest.raises(errors.UsageError) as caught:
        zenoh_bus.open_client("tls", endpoint, name="robot1", tls=tls)
    assert text in str(caught.value)


def test_bus_names_the_certificate_that_is_missing(certificates: Path, endpoint: str) -> None:
    endpoint = endpoint.replace("tcp/", "tls/")
    with pytest.raises(errors.UsageError, match=r"got .*/robot77\.pem"):
        zenoh_bus.open_client("tls", endpoint, name="robot77", tls=certificates)
