"""Behind the locked door all that is allowed works; what is forbidden, tried from containers, gets nothing through."""

from __future__ import annotations

import json
import subprocess
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, NamedTuple

import pytest
from tests.deploy.conftest import environment
from tests.deploy.stack import DEPLOY, LIMIT_S, ROOT, RUN, Stack, run, wait_until
from tests.integration.harness import Listener

from aeroskein_service.keys import Keys
from aeroskein_service.link import Link
from aeroskein_service.transport import Session, open_session

pytestmark = [pytest.mark.slow, pytest.mark.timeout(1500)]

KEYS = Keys("atc/v1")
PARTICIPANTS = ("router", "adsb", "radar1", "radar2", "fusion", "web", "consumer", "operator")
SERVICES = {"router", "adsb", "radar1", "radar2", "fusion", "web", "consumer"}
TRYING_S = 15.0
GIVE_UP_S = 10.0  # where nobody is let in

# Identity, what it does (tests/deploy/acts.py), key. Everybody's acts are tried at once, from one container each.
ALLOWED_TO_GET = [
    ("consumer", "hear", "atc/v1/feed/live/*"),
    ("consumer", "hear-again", "atc/v1/feed/live/*"),
    ("consumer", "hear", "atc/v1/fused/live/*"),
    ("consumer", "hear", "atc/v1/fused/element/*"),
    ("consumer", "hear", "atc/v1/status/*"),
    ("consumer", "hear", "atc/v1/registration/*"),
    ("consumer", "ask", "atc/v1/query/tracks"),
    ("web", "ask", "atc/v1/query/reports"),
    ("web", "hear-again", "atc/v1/feed/element/*"),
    ("operator", "ask", "atc/v1/control/sensor/radar2?action=on"),
    ("fusion", "hear-again", "atc/v1/reports/adsb/**"),
    ("fusion", "hear", "atc/v1/reports/adsb/@adv/**"),
]
FORBIDDEN_TO_GET = [
    ("stranger", "hear", "atc/v1/feed/live/*"),
    ("stranger", "hear-again", "atc/v1/feed/live/*"),
    ("stranger", "hear-again", "atc/v1/reports/adsb/**"),
    ("stranger", "ask", "atc/v1/query/tracks"),
    ("consumer", "hear", "atc/v1/reports/**"),
    ("consumer", "hear", "atc/v1/reports/adsb/**"),
    ("consumer", "hear-again", "atc/v1/reports/radar1/**"),
    ("consumer", "hear", "atc/v1/reports/adsb/@adv/**"),
    ("consumer", "hear", "**"),
    ("consumer", "ask", "atc/v1/query/reports"),
    ("consumer", "ask", "**"),
    ("consumer", "ask", "atc/v1/control/sensor/radar1?action=off"),
    ("consumer", "alive", "atc/v1/alive/fusion/**"),
    ("web", "ask", "atc/v1/control/registration/radar1?action=reset"),
    ("web", "hear", "atc/v1/reports/adsb/**"),
    ("adsb", "ask", "atc/v1/query/tracks"),
    ("adsb", "hear", "atc/v1/feed/live/*"),
    ("adsb", "hear", "atc/v1/reports/radar1/**"),
    ("adsb", "hear-again", "atc/v1/reports/radar1/**"),
    ("radar1", "hear", "atc/v1/reports/adsb/@adv/**"),
    ("adsb", "ask", "@/*/router/**"),
    ("radar1", "ask", "atc/v1/control/sensor/radar2?action=off"),
]
ALLOWED_TO_PUT = [
    ("adsb", "put", "atc/v1/reports/adsb/site2"),
    ("fusion", "put", "atc/v1/feed/live/other"),
]
FORBIDDEN_TO_PUT = [
    ("adsb", "put", "atc/v1/reports/radar1"),
    ("radar1", "put", "atc/v1/reports/adsb/site2"),
    ("consumer", "put", "atc/v1/reports/adsb"),
    ("web", "put", "atc/v1/reports/adsb"),
    ("operator", "put", "atc/v1/reports/radar2"),
    ("stranger", "put", "atc/v1/reports/adsb"),
    ("fusion", "put", "atc/v1/reports/adsb"),
    ("consumer", "put", "atc/v1/feed/live/forged"),
    ("adsb", "put", "atc/v1/fused/live/FFFFFF"),
    ("radar2", "put", "atc/v1/registration/radar2"),
    ("stranger", "put", "atc/v1/status/forged"),
    ("web", "put", "atc/v1/registration/radar1"),
    ("operator", "put", "atc/v1/feed/element/forged"),
]
FORBIDDEN_TO_POSE = [
    ("consumer", "serve", "atc/v1/query/tracks"),
    ("radar1", "serve", "atc/v1/query/tracks"),
    ("adsb", "claim", "atc/v1/alive/fusion/1of1/aaa"),
    ("stranger", "claim", "atc/v1/alive/fusion/1of1/aab"),
]
ALL = ALLOWED_TO_GET + FORBIDDEN_TO_GET + ALLOWED_TO_PUT + FORBIDDEN_TO_PUT + FORBIDDEN_TO_POSE


@pytest.fixture(scope="module")
def stack(image) -> Iterator[Stack]:
    """The locked demo."""
    made = Stack(f"{RUN}-locked", environment(image), "secure")
    try:
        made.up()
        wait_until(lambda: next(made.points(), None), "a fused point at the consumer")
        yield made
    finally:
        made.down()


@pytest.fixture(scope="module")
def certificates(stack, tmp_path_factory) -> Path:
    """Copies of the participants' files, and those of somebody whom the authority knows and the table does not."""
    folder = tmp_path_factory.mktemp("certificates")
    ours = folder / "ours"
    ours.mkdir()
    stack.compose("run", "--rm", "-v", f"{ours}/stranger:/certificates/stranger", "certificates", "/certificates",
                  "stranger")  # fmt: skip
    for name in PARTICIPANTS:
        run("docker", "cp", f"{stack.container('certificates')}:/certificates/{name}", ours)
    return readable(ours)


def readable(folder: Path) -> Path:
    """Let containers' users through to copies of files; which files they get, their mounts say."""
    for above in (folder.parent, folder.parent.parent, folder.parent.parent.parent):
        above.chmod(0o711)
    for path in (folder, *folder.rglob("*")):
        path.chmod(0o755 if path.is_dir() else 0o644)
    return folder


def container_of(stack: Stack, image: str, identity: Path | None, endpoint: str, *arguments: str) -> list[str]:
    """The command for a container on the stack's network that holds this identity's files, or none."""
    command = ["docker", "run", "--rm", "--no-healthcheck", "--read-only", "--tmpfs", "/tmp"]
    command += ["--network", f"{stack.name}_core", "--entrypoint", "/opt/aeroskein/bin/python"]
    command += ["-v", f"{ROOT / 'tests' / 'deploy' / 'acts.py'}:/acts.py:ro"]
    settings = {"CONNECT": endpoint}
    if identity is not None:
        command += ["-v", f"{identity}:/run/aeroskein:ro"]
        settings["TLS_ROOT_CA"] = "/run/aeroskein/ca.pem"
        if (identity / "cert.pem").exists():
            settings |= {"TLS_CERTIFICATE": "/run/aeroskein/cert.pem", "TLS_PRIVATE_KEY": "/run/aeroskein/key.pem"}
    for name, value in settings.items():
        command += ["-e", f"AEROSKEIN_ZENOH__{name}={value}"]
    return [*command, image, "/acts.py", *arguments]


@contextmanager
def as_identity(stack: Stack, certificates: Path, name: str) -> Iterator[Session]:
    """A session from outside with the files of a participant."""
    own = certificates / name
    link = Link(
        connect=(f"tls/{stack.address('router', 'core')}:7447",),
        tls_root_ca=str(own / "ca.pem"),
        tls_certificate=str(own / "cert.pem"),
        tls_private_key=str(own / "key.pem"),
        tls_verify_name=False,
    )
    with open_session(link) as session:
        yield session


class Outcome(NamedTuple):
    """What came of all acts."""

    got: dict[tuple[str, str, str], int | None]
    arrived: set[tuple[str, str]]  # who put what key, as the service and a consumer saw it
    replies: set[str]  # who answered a consumer's question for tracks; "" is the service
    tokens: set[str]  # of fusion services


@pytest.fixture(scope="module")
def outcome(stack, image, certificates) -> Outcome:
    """Everybody tries everything at once, while the service's and a consumer's eyes are open."""
    by_identity: dict[str, list[tuple[str, str, str]]] = {}
    for one in ALL:
        by_identity.setdefault(one[0], []).append(one)
    with (
        as_identity(stack, certificates, "fusion") as service,
        as_identity(stack, certificates, "consumer") as consumer,
    ):
        heard = [Listener(service, "atc/v1/reports/**")]
        heard += [Listener(consumer, f"atc/v1/{what}/**") for what in ("feed", "fused", "status", "registration")]
        tries = {
            identity: subprocess.Popen(
                container_of(stack, image, certificates / identity, "tls/router:7447", identity, str(TRYING_S),
                             str(LIMIT_S), json.dumps([one[1:] for one in acts])),
                stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
            )
            for identity, acts in by_identity.items()
        }  # fmt: skip
        replies: set[str] = set()
        tokens: set[str] = set()
        while any(process.poll() is None for process in tries.values()):
            for answer in consumer.ask(KEYS.query("tracks"), timeout_s=3.0):
                replies.add(json.loads(answer.payload)["forged"] if answer.encoding.endswith("json") else "")
            tokens |= set(service.alive("atc/v1/alive/fusion/**"))
            time.sleep(0.2)
        got: dict[tuple[str, str, str], int | None] = {}
        for identity, process in tries.items():
            out, err = process.communicate(timeout=60)
            assert process.returncode == 0, err
            got |= dict(zip(by_identity[identity], json.loads(out.splitlines()[-1]), strict=True))
        forged = [message for listener in heard for message in listener.messages if "forged" in message]
    return Outcome(got, {(message["forged"], message["key"]) for message in forged}, replies, tokens)


# -- allowed ---------------------------------------------------------------------------------------------------------
def test_locked_demo_fuses_all_sensors_and_is_healthy(stack):
    def mixed() -> bool:
        return {name for _, point in stack.points() for name in point["sources"]} >= {"adsb", "radar1", "radar2"}

    wait_until(mixed, "points to which all sensors contributed")
    wait_until(lambda: stack.healthy() >= SERVICES, "all to be healthy")


@pytest.mark.parametrize("act", ALLOWED_TO_GET, ids=" ".join)
def test_allowed_listening_and_asking_gets_something(outcome, act):
    assert outcome.got[act]


@pytest.mark.parametrize("act", ALLOWED_TO_PUT, ids=" ".join)
def test_allowed_put_arrives(outcome, act):
    assert (act[0], act[2]) in outcome.arrived


def test_lost_batches_are_fetched_again_through_the_locked_router(stack, certificates):
    def adsb() -> dict[str, Any]:
        with as_identity(stack, certificates, "consumer") as session:
            heard = Listener(session, KEYS.status())
            newest = heard.wait_for(lambda messages: messages[-1] if messages else None, "a status")
            part: dict[str, Any] = newest["sensors"]["adsb"]
            return part

    # Given a locked stack, when a feed is cut off for longer than its connection holds and is joined again
    before = adsb()
    stack.cut("adsb", "adsb")
    time.sleep(15.0)
    stack.join("adsb", "adsb")
    # Then nothing is missing: the rules let the hidden keys of the cache through
    after = wait_until(lambda: now if (now := adsb())["batches"] > before["batches"] + 150 else None, "batches")
    assert after["lost_batches"] == before["lost_batches"]


# -- certificates ----------------------------------------------------------------------------------------------------
def test_every_container_holds_its_own_key_and_no_other(stack):
    held = {
        service: run("docker", "exec", stack.container(service), "cat", "/run/aeroskein/key.pem")
        for service in sorted(SERVICES)
    }
    assert len(set(held.values())) == len(SERVICES)
    for service in SERVICES:
        mounts = {mount["Destination"] for mount in stack.inspect(service)["Mounts"]}
        assert not [where for where in mounts if where.startswith("/certificates")]
        found = run("docker", "exec", stack.container(service), "find", "/run", "/etc/aeroskein", "/var/lib/aeroskein",
                    "/tmp", "-name", "*.pem", check=False)  # fmt: skip
        assert {Path(line).name for line in found.splitlines()} == {"ca.pem", "cert.pem", "key.pem"}


def test_expiry_is_told_and_a_renewed_certificate_opens_the_door_again(stack):
    def certificates(*arguments: str) -> str:
        return stack.compose("run", "--rm", "certificates", *arguments, check=False)

    def number() -> str:
        return run("docker", "exec", stack.container("radar2"), "openssl", "x509", "-serial", "-noout", "-in",
                   "/run/aeroskein/cert.pem")  # fmt: skip

    # Given certificates for a year
    assert "radar2" not in certificates("--check", "/certificates", "30")
    assert "/certificates/radar2/cert.pem" in certificates("--check", "/certificates", "400")
    # When a feed gets a new one and is started again
    before = number()
    certificates("--renew", "/certificates", "radar2")
    assert number() != before
    run("docker", "restart", "-t", "5", stack.container("radar2"))
    restarted_s = time.time()
    # Then it comes through the door with it
    wait_until(lambda: any("radar2" in point["sources"] for _, point in stack.points(restarted_s)), "points of radar2")


# -- forbidden -------------------------------------------------------------------------------------------------------
@pytest.mark.parametrize("who", ["without certificate", "foreign authority", "expired certificate", "without TLS"])
def test_stranger_is_not_let_in(stack, image, certificates, who):
    folder, endpoint, identity = certificates.parent, "tls/router:7447", None
    if who == "without TLS":
        endpoint = "tcp/router:7447"
    elif who == "without certificate":
        identity = folder / "bare"
        identity.mkdir()
    elif who == "expired certificate":
        # By the right authority, in a participant's name, for no day.
        identity = folder / "expired"
        make = (
            "mkdir /tmp/site && ln -s /certificates/authority /tmp/site && "
            "DAYS=0 make_certificates.sh /tmp/site consumer && cp /tmp/site/consumer/*.pem /expired"
        )
        given = ("-v", f"{identity}:/expired", "--entrypoint", "sh")
        stack.compose("run", "--rm", *given, "certificates", "-c", make)
    else:
        # The same name by another authority.
        run(DEPLOY / "secure" / "make_certificates.sh", folder / "forged", "fusion")
        identity = folder / "forged" / "fusion"
    if identity is not None:
        (identity / "ca.pem").write_bytes((certificates / "fusion" / "ca.pem").read_bytes())
        readable(identity)
    acts = json.dumps([("hear", "atc/v1/feed/live/*"), ("ask", "atc/v1/query/tracks")])
    tried = run(*container_of(stack, image, identity, endpoint, who, "3", str(GIVE_UP_S), acts))
    assert json.loads(tried.splitlines()[-1]) == [None, None]


@pytest.mark.parametrize("act", FORBIDDEN_TO_GET, ids=" ".join)
def test_forbidden_listening_and_asking_gets_nothing(outcome, act):
    assert outcome.got[act] == 0


@pytest.mark.parametrize("act", FORBIDDEN_TO_PUT, ids=" ".join)
def test_forbidden_put_does_not_arrive(outcome, act):
    assert (act[0], act[2]) not in outcome.arrived


def test_nobody_but_the_service_answers_for_it(outcome):
    assert outcome.replies == {""}


def test_nobody_can_pose_as_a_second_fusion_service(outcome):
    assert outcome.tokens == {"atc/v1/alive/fusion/1of1/fusion"}
