"""What lies in deploy/ fits the program: commands, variables, access rules, certificates, the systemd unit."""

from __future__ import annotations

import json
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
import typer.main
import zenoh

from aeroskein_service.cli import app
from aeroskein_service.config import Config, load_config
from aeroskein_service.config_layers import environment_layer

DEPLOY = Path(__file__).parents[2] / "deploy"
COMPOSE = DEPLOY / "compose.yaml"
VARIABLE = re.compile(r"\b(AEROSKEIN_[A-Z0-9_]+__[A-Z0-9_]+): ([^\s}]+)")
COMMAND = re.compile(r"^\s+(?:command|test): (\[.*\])$", re.MULTILINE)
EXPOSURE = 1.5  # of 10, as systemd-analyze counts


def commands_in(path: Path) -> list[list[str]]:
    """Our own commands in a compose file, with the paths of their containers replaced by those of this folder."""
    found = [json.loads(text) for text in COMMAND.findall(path.read_text())]
    ours = [
        [part for part in command if part not in ("CMD", "aeroskein")]
        for command in found
        if command[0] not in ("-c", "/certificates") and command[1] not in ("wget", "grep")
    ]
    return [[part.replace("/etc/aeroskein", str(DEPLOY)) for part in command] for command in ours]


def test_variables_in_the_compose_file_are_keys_of_the_configuration():
    variables = dict(VARIABLE.findall(COMPOSE.read_text()))
    assert variables
    layer = environment_layer(Config, variables)
    assert len(layer.leaves) == len(variables)


@pytest.mark.parametrize("command", commands_in(COMPOSE), ids=" ".join)
def test_commands_in_compose_file_are_commands_of_ours(command):
    group = typer.main.get_command(app)
    name, subcommand, rest = group.resolve_command(group.make_context("aeroskein", [], resilient_parsing=True), command)
    # Parsing alone fails on an unknown option, a missing one and a file that is not there.
    subcommand.make_context(name, list(rest))


def test_every_sensor_of_the_configuration_has_its_feed():
    text = COMPOSE.read_text()
    for sensor in load_config(DEPLOY / "fusion.toml", environ={}).sensor_ids:
        assert f'"--sensor", "{sensor}"]' in text


# -- security --------------------------------------------------------------------------------------------------------
@pytest.mark.parametrize("login", ["certificates", "passwords"])
def test_locked_routers_are_what_the_table_of_rights_makes(login):
    sensors = [f"--sensor={name}" for name in load_config(DEPLOY / "fusion.toml", environ={}).sensor_ids]
    made = subprocess.run(
        [sys.executable, DEPLOY / "secure" / "make_router.py", *sensors, f"--login={login}"],
        capture_output=True, text=True, check=True,
    ).stdout  # fmt: skip
    assert made == (DEPLOY / "secure" / f"router-{login}.json5").read_text()


@pytest.mark.parametrize("path", sorted(DEPLOY.rglob("router*.json5")), ids=lambda path: path.name)
def test_router_files_are_zenoh_configurations(path):
    config = zenoh.Config.from_file(str(path))
    assert json.loads(config.get_json("mode")) == "router"
    assert json.loads(config.get_json("scouting/multicast/enabled")) is False


@pytest.mark.parametrize("login", ["certificates", "passwords"])
def test_locked_routers_deny_what_no_rule_allows(login):
    config = zenoh.Config.from_file(str(DEPLOY / "secure" / f"router-{login}.json5"))
    control = json.loads(config.get_json("access_control"))
    assert control["enabled"]
    assert control["default_permission"] == "deny"
    rules = {rule["id"]: rule for rule in control["rules"]}
    assert len(rules) == len(control["rules"])
    assert {rule["permission"] for rule in rules.values()} == {"allow"}
    writes = {
        key
        for policy in control["policies"]
        if policy["subjects"] == ["consumer"]
        for name in policy["rules"]
        if "ingress" in rules[name]["flows"] and "put" in rules[name]["messages"]
        for key in rules[name]["key_exprs"]
    }
    assert not writes


openssl = pytest.mark.skipif(shutil.which("openssl") is None, reason="no openssl here")


def certificates(folder: Path, *arguments: str) -> subprocess.CompletedProcess[str]:
    script = DEPLOY / "secure" / "make_certificates.sh"
    return subprocess.run([script, *arguments], cwd=folder, capture_output=True, text=True)


@openssl
def test_certificates_are_of_the_authority_and_their_keys_are_for_nobody_else(tmp_path):
    assert certificates(tmp_path, "certs", "router", "adsb").returncode == 0
    for name in ("router", "adsb"):
        own = tmp_path / "certs" / name
        subprocess.run(["openssl", "verify", "-CAfile", own / "ca.pem", own / "cert.pem"], check=True)
        assert own.joinpath("key.pem").stat().st_mode & 0o007 == 0
        assert not (own / "ca.key").exists()
    shown = subprocess.run(
        ["openssl", "x509", "-noout", "-text", "-in", tmp_path / "certs" / "router" / "cert.pem"],
        capture_output=True, text=True, check=True,
    ).stdout  # fmt: skip
    assert "DNS:router" in shown


@openssl
def test_renewal_replaces_one_certificate_and_keeps_the_authority(tmp_path):
    certificates(tmp_path, "certs", "router", "adsb")
    before = {path: path.read_bytes() for path in tmp_path.rglob("*.pem")}
    assert certificates(tmp_path, "--renew", "certs", "adsb").returncode == 0
    changed = {path.relative_to(tmp_path).as_posix() for path, old in before.items() if path.read_bytes() != old}
    assert changed == {"certs/adsb/cert.pem", "certs/adsb/key.pem"}


@openssl
def test_check_names_the_certificate_that_expires(tmp_path):
    certificates(tmp_path, "certs", "router")
    assert certificates(tmp_path, "--check", "certs").returncode == 0
    late = certificates(tmp_path, "--check", "certs", "400")
    assert late.returncode == 1
    assert "certs/router/cert.pem" in late.stderr


# -- systemd ---------------------------------------------------------------------------------------------------------
@pytest.mark.skipif(shutil.which("systemd-analyze") is None, reason="no systemd-analyze here")
def test_unit_is_valid_and_hardened(tmp_path):
    unit = tmp_path / "aeroskein.service"
    # The program has to exist for systemd to accept the unit.
    unit.write_text((DEPLOY / "aeroskein.service").read_text().replace("/opt/aeroskein/bin/aeroskein", "/bin/true"))
    verified = subprocess.run(["systemd-analyze", "verify", unit], capture_output=True, text=True)
    assert (verified.returncode, verified.stderr) == (0, "")
    judged = subprocess.run(
        ["systemd-analyze", "security", "--offline=true", f"--threshold={EXPOSURE * 10:.0f}", unit],
        capture_output=True, text=True,
    )  # fmt: skip
    assert judged.returncode == 0, judged.stdout


def test_unit_runs_a_command_of_ours():
    line = next(
        line for line in (DEPLOY / "aeroskein.service").read_text().splitlines() if line.startswith("ExecStart=")
    )
    name, *rest = line.split()[1:]
    command = typer.main.get_command(app).commands[name]
    command.make_context(name, [part.replace("/etc/aeroskein", str(DEPLOY)) for part in rest])
