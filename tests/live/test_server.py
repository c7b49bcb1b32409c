"""The server of the live page: this machine and this page only, whatever arrives; plans as `anser.plan` makes them."""

import contextlib
import http.client
import json
import random
import socket
import time
import tomllib
from pathlib import Path

import pytest
from websockets.exceptions import ConnectionClosed, InvalidStatus
from websockets.sync.client import connect

import anser
from anser.config.shipped_files import shipped_files
from anser.live.documents import DocumentFolder
from anser.live.messages import SIZE_MAX
from anser.live.server import LiveServer

DOCUMENT = tomllib.loads(Path(shipped_files()["storm-sampling"]).read_text(encoding="utf-8"))


@pytest.fixture(scope="module")
def server(tmp_path_factory):
    made = LiveServer(DOCUMENT, tmp_path_factory.mktemp("folder"))
    yield made
    made.close()


def get(server, path, **headers):
    connection = http.client.HTTPConnection("127.0.0.1", server.port, timeout=20)
    connection.request("GET", path, headers=headers)
    answer = connection.getresponse()
    content = answer.read()
    connection.close()
    return answer.status, content, dict(answer.getheaders())


def open_socket(server, origin=None, token=None, **options):
    address = f"ws://127.0.0.1:{server.port}/{token or server.token}/socket"
    return connect(address, origin=origin or f"http://127.0.0.1:{server.port}", max_size=None, **options)


def receive(page, kind, limit_s=120.0):
    """Next message of a kind; others are skipped."""
    end = time.monotonic() + limit_s
    while time.monotonic() < end:
        message = json.loads(page.recv(timeout=limit_s))
        if message["type"] == kind:
            return message
    raise TimeoutError(kind)


def is_alive(server):
    with open_socket(server) as page:
        return receive(page, "welcome")["scenario"] == DOCUMENT


def test_listens_on_loopback_alone(server):
    assert server._socket.getsockname()[0] == "127.0.0.1"


def test_the_page_works_offline(server):
    status, content, headers = get(server, f"/{server.token}/")
    assert status == 200
    assert b"src=" not in content.split(b"<body")[0]
    assert headers["referrer-policy"] == "no-referrer"
    assert "frame-ancestors 'self'" in headers["content-security-policy"]


@pytest.mark.parametrize("path", ["/", "/wrong/", "/wrong/socket", "/%00/", "/../", "/wrong/report/x"])
def test_requests_without_the_token_are_refused(server, path):
    assert get(server, path)[0] == 403


def test_foreign_hosts_and_origins_are_refused(server):
    address = f"/{server.token}/"
    assert get(server, address, Host="example.org")[0] == 403
    assert get(server, address, Host=f"example.org:{server.port}")[0] == 403
    assert get(server, address, Origin="http://example.org")[0] == 403
    for options in ({"origin": "http://example.org"}, {"origin": "null"}, {"token": "wrong"}):
        with pytest.raises(InvalidStatus), open_socket(server, **options):
            pass
    with pytest.raises(InvalidStatus), connect(f"ws://127.0.0.1:{server.port}/{server.token}/socket"):
        pass
    assert is_alive(server)


def mutated(generator, text):
    """A message with random bytes changed, cut, doubled or nested."""
    kind = generator.randrange(5)
    k = generator.randrange(len(text))
    if kind == 0:
        return text[:k]
    if kind == 1:
        return text[:k] + chr(generator.randrange(32, 0x3000)) + text[k + 1 :]
    if kind == 2:
        return text[:k] + text[k // 2 :]
    if kind == 3:
        return text.replace(
            '"number":1', f'"number":{generator.choice(["-1", "1e400", "NaN", "[]", "null", "0.5"])}', 1
        )
    return "[" * generator.randrange(1, 3000) + text


def send_mutations(server, count, seed):
    generator = random.Random(seed)
    requests = [
        {"type": "files", "number": 1},
        {"type": "open", "number": 1, "name": "x.toml"},
        {"type": "text", "number": 1, "scenario": {"a": 1}, "base": None},
        {"type": "resume", "number": 1, "session": "x", "flight_ids": ["a"]},
        {"type": "stop", "number": 1},
    ]
    with open_socket(server) as page:
        for k in range(count):
            page.send(mutated(generator, json.dumps(generator.choice(requests), separators=(",", ":"))))
            if k % 50 == 49:  # an answer to a valid request shows that the socket lives
                page.send('{"type":"files","number":99}')
                while receive(page, "files")["number"] != 99:
                    pass


def test_a_file_with_a_date_or_a_message_without_json_is_told_and_the_socket_lives(server, monkeypatch):
    file = server.workbench.folder.path / "odd.toml"
    file.write_text("[extra]\nday = 2026-11-26\n")
    with open_socket(server) as page:
        receive(page, "welcome")
        page.send('{"type":"open","number":1,"name":"odd.toml"}')
        assert "extra.day: given 2026-11-26 (date)" in receive(page, "failed")["problems"][0]["text"]
        monkeypatch.setattr(DocumentFolder, "names", lambda folder: [float("nan")])
        page.send('{"type":"files","number":2}')
        assert receive(page, "failed")["number"] == 2
        monkeypatch.undo()
        file.unlink()
        page.send('{"type":"files","number":3}')
        assert receive(page, "files")["number"] == 3


def test_malformed_messages_are_refused_and_the_server_lives(server):
    send_mutations(server, 300, seed=1)
    with open_socket(server) as page:
        receive(page, "welcome")
        page.send("no JSON")
        assert "malformed" in receive(page, "failed")["problems"][0]["text"]
        page.send('{"type":"plan","number":1}')
        assert "scenario" in receive(page, "failed")["problems"][0]["text"]
        with contextlib.suppress(ConnectionClosed):  # the server does not wait for the end of the message
            page.send("x" * (SIZE_MAX + 1))
        with pytest.raises(ConnectionClosed):
            page.recv(timeout=20)
    with open_socket(server) as page:
        page.send(b"\x00\x01")
        receive(page, "welcome")
        with pytest.raises(ConnectionClosed):
            page.recv(timeout=5)
    with socket.create_connection(("127.0.0.1", server.port)) as raw:
        raw.sendall(b"\x16\x03\x01 not HTTP\r\n\r\n")
    assert is_alive(server)


@pytest.mark.long
def test_ten_thousand_malformed_messages(server):
    send_mutations(server, 10_000, seed=2)
    assert is_alive(server)


def plan(page, number, document):
    page.send(json.dumps({"type": "plan", "number": number, "scenario": document}))
    while True:
        message = receive(page, "plan")
        if message["number"] == number:
            return message["answer"]


def test_answers_are_those_of_anser_plan_of_the_saved_file(server):
    with open_socket(server) as page, open_socket(server) as second_page:
        for socket_ in (page, second_page):
            receive(socket_, "welcome")
        moved = json.loads(json.dumps(DOCUMENT))
        moved["goal"][0]["north_m"] = 400.0
        answer = plan(page, 1, moved)
        assert answer["status"] == "planned"
        page.send(json.dumps({"type": "save", "number": 2, "name": "moved.toml", "scenario": moved}))
        assert receive(page, "saved")["name"] == "moved.toml"
        saved = anser.plan(server.workbench.folder.path / "moved.toml")
        assert answer["last_s"] == saved.arrival_s
        assert [entry["arrival_s"] for entry in answer["aircraft"]] == list(saved.arrivals_s)
        # the other page goes on with its own document: the same goal elsewhere
        assert plan(second_page, 1, DOCUMENT)["goals"][0]["north_m"][0] == 0.0
        assert answer["goals"][0]["north_m"][0] == 400.0
        page.send(json.dumps({"type": "save", "number": 3, "name": "moved.toml", "scenario": DOCUMENT}))
        assert receive(page, "exists")["number"] == 3


@pytest.mark.long
def test_a_refusal_names_aircraft_keys_and_positions(server):
    crowded = json.loads(json.dumps(DOCUMENT))
    crowded["separation"] = {"horizontal_m": 6000.0}
    with open_socket(server) as page:
        receive(page, "welcome")
        answer = plan(page, 1, crowded)
    assert answer["status"] == "refused"
    problem = answer["problems"][0]
    assert len(problem["aircraft"]) == 2
    assert "separation.horizontal_m" in problem["keys"]
    assert problem["text"] == str(anser.plan(server.workbench.folder.scenario(crowded)).refusals[0])


def test_an_invalid_document_names_its_keys(server):
    broken = json.loads(json.dumps(DOCUMENT))
    broken["aircraft"][1]["start"]["altitude_m"] = -5000.0
    with open_socket(server) as page:
        receive(page, "welcome")
        answer = plan(page, 1, broken)
    assert answer["status"] == "invalid"
    assert answer["problems"][0]["keys"] == ["aircraft[1].start.altitude_m"]


@pytest.mark.long
def test_a_page_that_reconnects_gets_the_flight_that_it_missed(server):
    short = json.loads(json.dumps(DOCUMENT))
    with open_socket(server) as page:
        key = receive(page, "welcome")["session"]
        page.send(json.dumps({"type": "fly", "number": 1, "scenario": short}))
        receive(page, "rows")
    end = time.monotonic() + 120.0
    while not server.workbench.flights and time.monotonic() < end:
        time.sleep(0.1)
    with open_socket(server) as page:
        receive(page, "welcome")
        page.send(json.dumps({"type": "resume", "number": 2, "session": key, "flight_ids": []}))
        flight = receive(page, "flight")
        assert flight["success"]
        status, content, _ = get(server, f"/{server.token}/{flight['report']}")
        assert status == 200
        assert b"storm-sampling" in content
        # a second tab with the same session gets one of its own
        with open_socket(server) as second_page:
            own_key = receive(second_page, "welcome")["session"]
            second_page.send(json.dumps({"type": "resume", "number": 1, "session": key, "flight_ids": []}))
            assert plan(second_page, 2, DOCUMENT)["status"] == "planned"
            assert own_key in server.workbench.sessions
        assert plan(page, 3, DOCUMENT)["status"] == "planned"
