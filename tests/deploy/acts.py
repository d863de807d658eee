"""What somebody tries inside a container against a locked router; runs there and prints one JSON line.

    acts.py NAME SECONDS GIVE_UP ACTS    ACTS is JSON: [[what, key], ...], all tried at the same time, a session each

The connection is the container's own (AEROSKEIN_ZENOH__...). ``put`` puts payloads that carry NAME, plain and with a
cache; ``hear`` and ``hear-again`` count what arrives, plain and with the cache's history; ``ask`` counts answers;
``alive`` counts liveliness tokens, ``claim`` holds one; ``serve`` answers queries. A client learns nothing of a denial:
only what arrives counts.
"""

from __future__ import annotations

import json
import sys
import threading
import time
from concurrent.futures import ThreadPoolExecutor

from aeroskein_service.config import load_config
from aeroskein_service.transport import OpenCancelledError, SensorPublisher, Session, open_session

OPENING = threading.Lock()  # one handshake at a time: the router has more to do
PAUSE_S = 0.1


def act(session: Session, name: str, what: str, key: str, seconds: float) -> int:
    """Do it; how much came of it."""
    got: list[str] = []
    ends_s = time.monotonic() + seconds
    forged = json.dumps({"forged": name, "key": key}).encode()
    if what == "ask":
        answers = 0
        while not answers and time.monotonic() < ends_s:
            answers = sum(answer.ok for answer in session.ask(key, timeout_s=seconds))
            time.sleep(PAUSE_S)
        return answers
    if what == "alive":
        return len(session.alive(key, timeout_s=seconds))
    if what == "put":
        cached = SensorPublisher(session, key, "application/json")
    elif what == "hear":
        session.subscribe(key, lambda at, _payload, _encoding: got.append(at))
    elif what == "hear-again":
        session.subscribe_recovering(key, lambda at, _payload, _encoding: got.append(at), history=100)
    elif what == "claim":
        session.declare_alive(key)
    elif what == "serve":
        session.answer(key, lambda question: question.reply(forged, "application/json"))
    while time.monotonic() < ends_s:
        if what == "put":
            session.put(key, forged, "application/json")
            cached.put(forged)
        time.sleep(PAUSE_S)
    return len(got)


def attempt(name: str, what: str, key: str, seconds: float, give_up_s: float) -> int | None:
    """The act in a session of its own; None where the router lets nobody in for so long."""
    stop = threading.Event()
    with OPENING:
        giving_up = threading.Timer(give_up_s, stop.set)
        giving_up.start()
        try:
            session = open_session(load_config(sensors_required=False).zenoh.link, stop=stop)
        except OpenCancelledError:
            return None
        finally:
            giving_up.cancel()
    with session:
        return act(session, name, what, key, seconds)


def main() -> None:
    """Try everything and say what came of each."""
    name, seconds, give_up_s, acts = sys.argv[1], float(sys.argv[2]), float(sys.argv[3]), json.loads(sys.argv[4])
    with ThreadPoolExecutor(len(acts)) as at_once:
        outcomes = at_once.map(lambda one: attempt(name, one[0], one[1], seconds, give_up_s), acts)
        print(json.dumps(list(outcomes)))


if __name__ == "__main__":
    main()
