"""The gate before Foxglove's server: which connections pass, and that it carries bytes both ways."""

import contextlib
import socket
import threading

import pytest

from auv_lse_shore.live.viewers import origin_gate
from auv_lse_shore.live.viewers.origin_gate import MAX_REQUEST, OriginGate, hidden_address, refusal

HOSTS, ORIGINS = {"127.0.0.1:8765", "localhost:8765"}, {"https://app.foxglove.dev"}


def request(*headers):
    return "\r\n".join(["GET / HTTP/1.1", "Upgrade: websocket", *headers]).encode()


@pytest.mark.parametrize(
    ("headers", "words"),
    [
        (["Host: 127.0.0.1:8765"], ""),
        (["Host: localhost:8765", "Origin: https://app.foxglove.dev"], ""),
        (["host: LOCALHOST:8765", "ORIGIN: https://App.Foxglove.dev"], ""),
        (["Host: localhost:8765", "Origin: http://localhost:8080"], ""),
        (["Host: localhost:8765", "Origin: http://[::1]:8080"], ""),
        ([], "Host"),
        (["Host: evil.example:8765"], "Host 'evil.example:8765': expected one of 127.0.0.1:8765, localhost:8765"),
        (["Host: 127.0.0.1"], "Host"),
        (["Host: 127.0.0.1:8765", "Host: 127.0.0.1:8765"], "Host"),
        (
            ["Host: 127.0.0.1:8765", "Origin: https://evil.example"],
            "To allow it: --foxglove-origin https://evil.example",
        ),
        (["Host: 127.0.0.1:8765", "Origin: null"], "Origin 'null'"),
        (["Host: 127.0.0.1:8765", "Origin:"], "Origin ''"),
        (["Host: 127.0.0.1:8765", "Origin: http://localhost.evil.example"], "Origin"),
        (["Host: 127.0.0.1:8765", "Origin: http://app.foxglove.dev"], "Origin"),
        (["Host: 127.0.0.1:8765", "Origin: https://app.foxglove.dev", "Origin: https://evil.example"], "Origin"),
    ],
)
def test_the_headers_decide(headers, words):
    found = refusal(request(*headers), HOSTS, ORIGINS)
    assert words in found
    assert bool(words) == bool(found)


def test_other_requests_than_websockets_are_refused():
    assert refusal(b"GET / HTTP/1.1\r\nHost: 127.0.0.1:8765", HOSTS, ORIGINS) == "expected a WebSocket connection"


@contextlib.contextmanager
def gate():
    """A gate before a server that repeats what it hears, and what the gate reports."""
    said = []
    with socket.create_server((hidden_address(), 0)) as server:
        found = OriginGate("127.0.0.1", 0, ORIGINS, said.append)
        found.server = server.getsockname()

        def echo():
            with contextlib.suppress(OSError):
                while True:
                    connection, _ = server.accept()
                    while data := connection.recv(1 << 16):
                        connection.sendall(data)
                    connection.close()

        threading.Thread(target=echo, daemon=True).start()
        yield found, said
        found.close()


def received(connection, size):
    data = b""
    while len(data) < size and (more := connection.recv(1 << 16)):
        data += more
    return data


def test_bytes_pass_both_ways_and_refusals_are_answered_and_reported_once():
    with gate() as (found, said):
        good = request(f"Host: 127.0.0.1:{found.port}") + b"\r\n\r\nand " + bytes(range(256)) * 4000
        with socket.create_connection(("127.0.0.1", found.port), 10.0) as client:
            threading.Thread(target=client.sendall, args=(good,), daemon=True).start()
            assert received(client, len(good)) == good
        for _ in range(2):
            with socket.create_connection(("127.0.0.1", found.port), 10.0) as client:
                client.sendall(request(f"Host: 127.0.0.1:{found.port}", "Origin: https://evil.example") + b"\r\n\r\n")
                answer = received(client, 1 << 20)
            assert answer.startswith(b"HTTP/1.1 403 Forbidden")
            assert b"--foxglove-origin https://evil.example" in answer
        assert len(said) == 1
        with socket.create_connection(("127.0.0.1", found.port), 10.0) as client:
            with contextlib.suppress(OSError):
                client.sendall(b"x" * 4 * MAX_REQUEST)
            with contextlib.suppress(OSError):  # reset, or closed
                assert client.recv(1) == b""
        client = socket.create_connection(("127.0.0.1", found.port), 10.0)
    with contextlib.suppress(OSError), client:
        assert client.recv(1) == b"", "closed with the gate"


def test_errors_of_the_system_do_not_end_the_gate(monkeypatch):
    class Exhausted(socket.socket):
        left = 2

        def accept(self):
            if Exhausted.left:
                Exhausted.left -= 1
                raise OSError(24, "Too many open files")
            return super().accept()

    real = socket.create_server

    def create_server(address):
        with real(address) as listener:
            return Exhausted(fileno=listener.detach())

    with monkeypatch.context() as patch:
        patch.setattr(origin_gate, "_RETRY_S", 0.0)
        patch.setattr(socket, "create_server", create_server)
        said = []
        found = OriginGate("127.0.0.1", 0, ORIGINS, said.append)
    with socket.create_connection(("127.0.0.1", found.port), 20.0) as connection:
        connection.sendall(b"GET / HTTP/1.1\r\n\r\n")
        assert connection.recv(100).startswith(b"HTTP/1.1 403")
    found.close()
    assert said[0] == "cannot open connections: [Errno 24] Too many open files; retrying"
    assert found.failures == 2, "closing is no failure"
