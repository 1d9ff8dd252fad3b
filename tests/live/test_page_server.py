"""The page's server from outside, by raw HTTP and WebSockets: who may talk to it; nobody slows the worker."""

from __future__ import annotations

import http.client
import json
import os
import socket
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager, suppress
from importlib.util import find_spec
from typing import Any
from urllib.parse import urlsplit

import msgspec
import pytest

from contactwrench.errors import MissingExtraError
from contactwrench.live.page import Ask, Hub, Server, serve
from contactwrench.live.snapshot import Command, Phase
from contactwrench.live.source import DeviceError
from tests.support.live_session import T0, snapshot, trace

pytestmark = pytest.mark.skipif(
    find_spec("uvicorn") is None or find_spec("websockets") is None, reason="uvicorn or websockets is not installed"
)
TOKEN = "a-token-that-is-known-here"


@pytest.fixture(scope="module")
def page() -> Iterator[tuple[Hub, Server]]:
    hub = Hub()
    server = serve(hub)
    yield hub, server
    server.close()


@pytest.fixture(scope="module")
def guarded() -> Iterator[Server]:
    server = serve(Hub(), token=TOKEN)
    yield server
    server.close()


def _port(server: Server) -> int:
    return urlsplit(server.url).port or 0


def _asked(port: int, method: str = "GET", path: str = "/", body: bytes | None = None, **headers: str) -> Any:
    connection = http.client.HTTPConnection("127.0.0.1", port, timeout=20)
    try:
        connection.request(method, path, body, {name.replace("_", "-"): value for name, value in headers.items()})
        answer = connection.getresponse()
        answer.text = answer.read().decode()  # type: ignore[attr-defined]
        return answer
    finally:
        connection.close()


def _handshake(port: int, path: str = "/live", **headers: str) -> bytes:
    """The status line of an upgrade to a WebSocket."""
    given = {
        "Host": f"127.0.0.1:{port}",
        "Upgrade": "websocket",
        "Connection": "Upgrade",
        "Sec-WebSocket-Version": "13",
        "Sec-WebSocket-Key": "AAAAAAAAAAAAAAAAAAAAAA==",
        **headers,
    }
    with socket.create_connection(("127.0.0.1", port), timeout=20) as raw:
        lines = "".join(f"{name}: {value}\r\n" for name, value in given.items())
        raw.sendall(f"GET {path} HTTP/1.1\r\n{lines}\r\n".encode())
        return raw.recv(4096).partition(b"\r\n")[0]


@contextmanager
def _browser(server: Server) -> Iterator[Any]:
    """A WebSocket, after its first message, which says whether there is a lab."""
    from websockets.sync.client import connect

    origin = f"http://127.0.0.1:{_port(server)}"
    options: dict[str, Any] = {"origin": origin, "proxy": None, "close_timeout": 1}
    with connect(f"ws{origin[4:]}/live", **options) as browser:
        browser.recv(timeout=20)
        yield browser


def _eventually(holds: Callable[[], bool]) -> bool:
    until = time.monotonic() + 20.0
    while not holds() and time.monotonic() < until:
        time.sleep(0.01)
    return time.monotonic() < until


@pytest.mark.parametrize("path", ["/", "/index.html", "/page.js", "/show.js", "/draw.js", "/page.css", "/icon.svg"])
def test_every_file_comes_with_headers_that_bound_it(page: tuple[Hub, Server], path: str) -> None:
    answer = _asked(_port(page[1]), path=path)
    assert answer.status == 200
    assert answer.getheader("content-security-policy").startswith("default-src 'self';")
    assert answer.getheader("x-content-type-options") == "nosniff"
    assert answer.getheader("cache-control") == "no-store"
    assert answer.getheader("referrer-policy") == "no-referrer"
    assert answer.getheader("server") is None
    assert "http" not in answer.text.replace('xmlns="http://www.w3.org/2000/svg"', "")
    assert "style=" not in answer.text


@pytest.mark.parametrize("path", ["/../server.py", "/%2e%2e/app.py", "//etc/passwd", "/static/page.js", "/live"])
def test_no_other_path_is_answered(page: tuple[Hub, Server], path: str) -> None:
    assert _asked(_port(page[1]), path=path).status == 404


def test_only_its_own_names_are_answered(page: tuple[Hub, Server]) -> None:
    port = _port(page[1])
    for host in (f"127.0.0.1:{port}", f"localhost:{port}"):
        assert _asked(port, Host=host).status == 200
    for host in ("", "evil.example", f"evil.example:{port}", "127.0.0.1", f"127.0.0.1:{port + 1}",
                 f"127.0.0.1.nip.io:{port}", f"[::1]:{port}", f"10.0.0.1:{port}",
                 f"evil.example#127.0.0.1:{port}"):  # fmt: skip
        assert _asked(port, Host=host).status == 400, host


def test_a_page_elsewhere_cannot_ask_or_listen(page: tuple[Hub, Server]) -> None:
    port = _port(page[1])
    own = f"http://127.0.0.1:{port}"
    assert _handshake(port, Origin=own).startswith(b"HTTP/1.1 101")
    for origin in (
        "http://evil.example",
        "null",
        f"https://127.0.0.1:{port}",
        f"{own}0",
        f"http://localhost:{port}",
        "",
    ):
        assert _handshake(port, Origin=origin).startswith(b"HTTP/1.1 403"), origin
        assert _asked(port, "POST", Origin=origin).status == 403, origin
    assert _handshake(port).startswith(b"HTTP/1.1 403")
    assert _handshake(port, Host="evil.example", Origin="http://evil.example").startswith(b"HTTP/1.1 403")
    assert _handshake(port, path="/elsewhere", Origin=own).startswith(b"HTTP/1.1 403")
    for method in ("POST", "PUT", "DELETE", "OPTIONS", "HEAD"):
        assert _asked(port, method, Origin=own).status == 405


def test_a_token_is_needed_by_every_request(guarded: Server) -> None:
    port = _port(guarded)
    own = f"http://127.0.0.1:{port}"
    for path in ("/", "/page.js", "/?token=", f"/?token={TOKEN[:-1]}", f"/?token={TOKEN}x", "/?token=%ff"):
        assert _asked(port, path=path).status == 403, path
    assert _handshake(port, Origin=own) .startswith(b"HTTP/1.1 403")  # fmt: skip
    opened = _asked(port, path=f"/?token={TOKEN}")
    cookie = opened.getheader("set-cookie")
    assert opened.status == 200
    assert cookie.endswith("; Path=/; HttpOnly; SameSite=Strict")
    pair = cookie.partition(";")[0]
    assert _asked(port, path="/page.js", Cookie=f"other=1; {pair}").status == 200
    assert _asked(port, path="/page.js", Cookie=pair).getheader("set-cookie") is None
    assert _handshake(port, Origin=own, Cookie=pair).startswith(b"HTTP/1.1 101")
    for wrong in (pair[:-1], pair.replace(str(port), "1"), f"x{pair}", "é=1"):
        assert _asked(port, path="/page.js", Cookie=wrong).status == 403, wrong


def test_a_token_is_made_where_others_can_reach_it() -> None:
    server = serve(Hub(), "0.0.0.0", token="")
    try:
        port = _port(server)
        token = server.url.partition("token=")[2]
        assert len(token) >= 32
        assert _asked(port).status == 403
        for host in (f"10.0.0.7:{port}", f"localhost:{port}"):
            assert _asked(port, path=f"/?token={token}", Host=host).status == 200
        assert _asked(port, path=f"/?token={token}", Host=f"evil.example:{port}").status == 400
    finally:
        server.close()


WRONG = ("", "no json", "[]", '{"do":"next"}', '{"kind":"ask","do":"format"}', '{"kind":"ask","do":"next","more":1}',
         '{"kind":"ask","do":"retake","pose":-1}', '{"kind":"ask","do":"retake","pose":1.5}',
         '{"kind":"lab","do":"up"}', '{"kind":"ready","x":1}', "[" * 2000, b"\xff\xfe")  # fmt: skip


@pytest.mark.parametrize("message", WRONG, ids=range(len(WRONG)))
def test_what_is_no_command_ends_the_connection(page: tuple[Hub, Server], message: str | bytes) -> None:
    from websockets.exceptions import ConnectionClosed

    with _browser(page[1]) as browser:
        browser.send(message)
        with pytest.raises(ConnectionClosed) as closed:
            browser.recv(timeout=20)
    assert closed.value.rcvd is not None
    assert closed.value.rcvd.code == 1008
    assert page[0].commands.empty()


@pytest.mark.parametrize("size", [4097, 10_000_000])
def test_a_large_message_is_refused_before_it_is_read(page: tuple[Hub, Server], size: int) -> None:
    from websockets.exceptions import ConnectionClosed

    with pytest.raises((ConnectionClosed, OSError)), _browser(page[1]) as browser:  # noqa: PT012
        browser.send("x" * size)
        browser.recv(timeout=20)
        browser.recv(timeout=20)


@pytest.mark.parametrize(
    "begin", [b"GET / HTTP/1.1\r\nX: ", b"GET /", b"", b"POST / HTTP/1.1\r\nContent-Length: 10000000\r\n\r\n"]
)
def test_a_request_without_end_is_ended(page: tuple[Hub, Server], begin: bytes) -> None:
    with socket.create_connection(("127.0.0.1", _port(page[1])), timeout=20) as raw:
        with suppress(OSError):
            raw.sendall(begin + b"x" * 10_000_000)
        with suppress(OSError):
            assert raw.recv(64).startswith(b"HTTP/1.1 400")
    assert _asked(_port(page[1])).status == 200


def test_commands_come_in_their_order_and_are_bounded(page: tuple[Hub, Server]) -> None:
    hub, server = page
    with _browser(server) as browser:
        browser.send('{"kind":"ask","do":"retake","pose":3}')
        assert hub.commands.get(timeout=20) == Ask(Command.RETAKE, 3)
        for _ in range(hub.commands.maxsize):
            browser.send('{"kind":"ask","do":"zero"}')
        browser.send('{"kind":"ask","do":"zero"}')
        assert "busy" in json.loads(browser.recv(timeout=20))["notice"]
    while not hub.commands.empty():
        assert hub.commands.get_nowait() == Ask(Command.ZERO)


def test_a_browser_gets_the_newest_and_every_row_once() -> None:
    hub = Hub()
    server = serve(hub)
    try:
        with _browser(server) as browser:
            rows, published, before = [], 0, T0 - 1.0
            for skipped in (1, 5, 1, 40, 3):
                for _ in range(skipped):
                    published += 1
                    t = T0 + published / 30
                    hub.publish(msgspec.json.encode(snapshot(Phase.RUN, t, trace=trace(t, 1 / 30))))
                browser.send('{"kind":"ready"}')
                message = json.loads(browser.recv(timeout=20))
                assert message["snapshot"]["t"] == t > before
                before = t
                rows += [row[0] for part in (*message["earlier"], message["snapshot"]["trace"]) for row in part]
            assert len(rows) == published * 3
            assert sorted(set(rows)) == rows
    finally:
        server.close()


def test_rows_of_another_phase_are_not_mixed_in() -> None:
    hub = Hub()
    for phase in (Phase.CONNECT, Phase.VERIFY, Phase.RUN, Phase.RUN):
        hub.publish(msgspec.json.encode(snapshot(phase, seconds=0.01)))
    number, text = hub.after(1) or (0, b"")
    assert number == 4
    assert len(json.loads(text)["earlier"]) == 1
    assert hub.after(4) is None


def test_a_stopped_browser_never_slows_the_worker(page: tuple[Hub, Server]) -> None:
    """Twenty that never read, 2,000 snapshots of 20 kB: each publish is short, and nothing is kept for them."""
    hub, server = page
    data = msgspec.json.encode(snapshot(Phase.RUN, seconds=2.0))
    with ExitStack() as stack:
        for _ in range(20):
            stack.enter_context(_browser(server)).send('{"kind":"ready"}')
        took = []
        for _ in range(2000):
            began = time.perf_counter()
            hub.publish(data)
            took.append(time.perf_counter() - began)
        assert sorted(took)[1000] < 2e-3
        assert sum(took) < 10.0


def test_the_21st_page_is_refused_politely_and_1000_connections_are_bounded(page: tuple[Hub, Server]) -> None:
    from websockets.exceptions import ConnectionClosed

    _, server = page
    with ExitStack() as stack:
        browsers = [stack.enter_context(_browser(server)) for _ in range(20)]
        with pytest.raises(ConnectionClosed) as closed, _browser(server):
            pass
        assert closed.value.rcvd is not None
        assert (closed.value.rcvd.code, closed.value.rcvd.reason) == (1013, "20 pages are open already. Close one.")
        browsers[0].close()
        assert _eventually(lambda: _can_open(server))
        files = len(os.listdir("/proc/self/fd")) if os.path.isdir("/proc/self/fd") else None
        ours = []
        for _ in range(1000):
            raw = stack.enter_context(socket.create_connection(("127.0.0.1", _port(server)), timeout=20))
            ours.append(raw)
        assert ours[-1].recv(64).startswith(b"HTTP/1.1 503")
        if files is not None:
            assert _eventually(lambda: len(os.listdir("/proc/self/fd")) - files - 1000 < 70)
    assert _eventually(lambda: _asked(_port(server)).status == 200)


def _can_open(server: Server) -> bool:
    from websockets.exceptions import ConnectionClosed

    try:
        with _browser(server):
            return True
    except ConnectionClosed:
        return False


def test_the_lab_gets_what_is_pressed_and_a_release_when_the_browser_goes() -> None:
    done: list[dict[str, str]] = []
    server = serve(Hub(), lab=done.append)
    try:
        with _browser(server) as browser:
            for action in ("press_down", "release", "push_tool"):
                browser.send(json.dumps({"kind": "lab", "do": action}))
        assert _eventually(lambda: len(done) == 4)
        assert [each["do"] for each in done] == ["press_down", "release", "push_tool", "release"]
    finally:
        server.close()


def test_nothing_is_left_after_close() -> None:
    before = {thread.name for thread in threading.enumerate()}
    hub = Hub()
    server = serve(hub, lab=lambda action: None)
    port = _port(server)
    browser = ExitStack()
    browser.enter_context(_browser(server)).send('{"kind":"lab","do":"press_down"}')
    half = socket.create_connection(("127.0.0.1", port), timeout=20)
    half.sendall(b"GET / HT")
    began = time.monotonic()
    server.close()
    assert time.monotonic() - began < 4.0
    hub.publish(b'{"phase":"run","trace":[]}')
    browser.close()
    half.close()
    assert {thread.name for thread in threading.enumerate()} <= before
    socket.create_server(("127.0.0.1", port)).close()


def test_a_taken_port_is_said_in_one_line(page: tuple[Hub, Server]) -> None:
    with pytest.raises(DeviceError, match=r"^127.0.0.1:\d+: found that it cannot be listened on .*: choose another$"):
        serve(Hub(), port=_port(page[1]))


def test_a_missing_library_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(__import__("sys").modules, "uvicorn", None)
    with pytest.raises(MissingExtraError, match=r"pip install 'contactwrench\[live\]'"):
        serve(Hub())


def test_a_host_that_can_be_none_is_said_in_one_line() -> None:
    with pytest.raises(DeviceError, match=r"^a\.\.b:0: found that it cannot be listened on .*: choose another$"):
        serve(Hub(), "a..b")


def test_a_name_that_has_an_address_of_ipv6_alone_is_listened_on(monkeypatch: pytest.MonkeyPatch) -> None:
    known = socket.getaddrinfo

    def only_there(host: str, *given: Any, **named: Any) -> Any:
        return known("::1" if host == "box" else host, *given, **named)

    monkeypatch.setattr(socket, "getaddrinfo", only_there)
    server = serve(Hub(), "box")
    connection = http.client.HTTPConnection("::1", _port(server), timeout=20)
    url = urlsplit(server.url)
    connection.request("GET", f"/?{url.query}", headers={"Host": url.netloc})
    assert (url.hostname, connection.getresponse().status) == ("box", 200)
    connection.close()
    server.close()
