"""The live view's server: it serves this machine's own page and nobody else."""

from __future__ import annotations

import asyncio
import contextlib
import json
import os
import re
import signal
import socket
import subprocess
import sys
import threading
import time
from pathlib import Path

import pytest
from tornado.httpclient import AsyncHTTPClient, HTTPClientError, HTTPRequest
from tornado.websocket import websocket_connect
from verb_main import verb_main

from auv_lse_common.vocabulary.mission_run import Command
from auv_lse_record.run_writer import write_run
from auv_lse_shore.live.sources import running
from auv_lse_shore.live.sources.command_queue import CommandError, CommandQueue
from auv_lse_shore.live.sources.timeline import Timeline
from auv_lse_shore.live.viewers.page import live_page
from auv_lse_shore.live.viewers.server import LiveServer, PortTakenError, port_or_any

main = verb_main("live")


def served(talk, commands=None):
    """Serves a timeline of 1001 events on some free port and runs `talk(server, timeline)`."""

    async def run():
        timeline = Timeline()
        timeline.begin({"kind": "mission"})
        timeline.add([{"kind": "n", "t": i} for i in range(1000)])
        server = LiveServer(timeline, 0, commands)
        try:
            return await talk(server, timeline)
        finally:
            await server.close()

    return asyncio.run(asyncio.wait_for(run(), 30))


async def status(url, **options):
    try:
        return (await AsyncHTTPClient().fetch(HTTPRequest(url, **options))).code
    except HTTPClientError as error:
        return error.code


def test_only_the_page_of_this_machine_is_answered():
    async def talk(server, _):
        url, port = server.url, server.port
        assert await status(url) == 200
        assert await status(url, headers={"Host": f"localhost:{port}", "Origin": f"http://localhost:{port}"}) == 200
        for host in ("evil.example", f"evil.example:{port}", "127.0.0.1", f"127.0.0.1:{port + 1}"):
            assert await status(url, headers={"Host": host}) == 403, host
        for origin in (
            "http://evil.example",
            "null",
            f"https://127.0.0.1:{port}",
            f"http://127.0.0.1:{port}.evil.example",
        ):
            assert await status(url, headers={"Origin": origin}) == 403, origin
            request = HTTPRequest(f"ws://127.0.0.1:{port}/events", headers={"Origin": origin})
            with pytest.raises(HTTPClientError, match="403"):
                await websocket_connect(request)
        for path in ("etc/passwd", "../server.py", "%2e%2e/server.py", "page/main.js", "events/../", "//etc/passwd"):
            assert await status(url + path) == 404, path
        assert await status(url, method="POST", body="x") == 405

    served(talk)


def order(server, timeline, **changed):
    """A valid request for a command, with changes to its body or headers."""
    name = timeline.since("", 0, 0)[0]
    headers = {"X-Live-Token": server.token, "Origin": f"http://127.0.0.1:{server.port}", **changed.pop("headers", {})}
    body = changed.pop("body", None) or json.dumps({"mission": name, "command": "hold", "vehicles": [1], **changed})
    url = f"http://127.0.0.1:{server.port}/command"
    return HTTPRequest(url, method="POST", headers=headers, body=body)


async def answer(request):
    found = await AsyncHTTPClient().fetch(request, raise_error=False)
    return found.code, found.body.decode()


def test_a_command_needs_the_token_and_this_page():
    async def talk(server, timeline):
        assert server.url == f"http://127.0.0.1:{server.port}/#control={server.token}"
        assert len(server.token) >= 20
        for headers in (
            {"X-Live-Token": ""},
            {"X-Live-Token": server.token[:-1]},
            {"X-Live-Token": "wörng"},
            {"Origin": "http://evil.example"},
            {"Origin": "null"},
            {"Host": f"evil.example:{server.port}"},
        ):
            assert (await answer(order(server, timeline, headers=headers)))[0] == 403, headers
        assert commands.take() == []
        page = (await AsyncHTTPClient().fetch(f"http://127.0.0.1:{server.port}/")).body.decode()
        assert server.token not in page
        url = f"http://127.0.0.1:{server.port}/command"
        assert await status(url, headers={"X-Live-Token": server.token}) == 405, "GET"

    commands = CommandQueue()
    commands.open(3)
    served(talk, commands)


def test_without_control_and_on_a_recording_no_command_is_taken():
    async def without(server, timeline):
        assert (server.token, "#" in server.url) == ("", False)
        code, text = await answer(order(server, timeline))
        assert code == 403
        assert "Start it with auv_lse live --control" in text

    async def replayed(server, timeline):
        code, text = await answer(order(server, timeline))
        assert code == 409
        assert "no mission is running" in text

    served(without)
    served(replayed, CommandQueue())


@pytest.mark.parametrize(
    ("changed", "code", "words"),
    [
        ({"body": "[]"}, 400, 'send {"mission": text'),
        ({"body": "{"}, 400, 'send {"mission": text'),
        ({"body": "[" * 3000}, 400, 'send {"mission": text'),
        ({"vehicles": 1}, 400, 'send {"mission": text'),
        ({"command": "go"}, 409, "'go' is not a command; use one of hold, surface, abort"),
        ({"command": ["hold"]}, 409, "is not a command; use one of hold, surface, abort"),
        ({"vehicles": []}, 409, "vehicles must be numbers from 1 to 3, not []"),
        ({"vehicles": [1, 4]}, 409, "vehicles must be numbers from 1 to 3, not [1, 4]"),
        ({"vehicles": [True]}, 409, "vehicles must be numbers from 1 to 3, not [True]"),
        ({"mission": "an earlier one"}, 409, "another mission has begun; nothing was sent"),
    ],
)
def test_an_impossible_command_is_refused_with_its_reason(changed, code, words):
    async def talk(server, timeline):
        found, text = await answer(order(server, timeline, **changed))
        assert (found, words in text) == (code, True), text
        assert commands.take() == []

    commands = CommandQueue()
    commands.open(3)
    served(talk, commands)


def test_a_command_is_answered_with_the_outcome_of_each_vehicle():
    async def talk(server, timeline):
        request = asyncio.create_task(answer(order(server, timeline, command="abort", vehicles=[2, 1, 2])))
        while not (orders := commands.take()):
            await asyncio.sleep(0.01)
        assert [(o.command, o.vehicles) for o in orders] == [(Command.ABORT, (1, 2))]
        orders[0].outcomes.set_result({1: ("accepted", "ABORTED"), 2: ("refused", "ended")})
        code, text = await request
        assert code == 200
        assert json.loads(text) == {
            "1": {"outcome": "accepted", "text": "ABORTED"},
            "2": {"outcome": "refused", "text": "ended"},
        }

    commands = CommandQueue()
    commands.open(3)
    served(talk, commands)


def test_a_command_that_waits_at_the_missions_end_is_reported_as_not_heard():
    commands = CommandQueue()
    commands.open(2)
    outcomes = commands.order("surface", [2])
    commands.close()
    assert outcomes.result(0) == {2: ("not heard", "the mission has ended")}
    with pytest.raises(CommandError, match="no mission is running"):
        commands.order("surface", [2])


def test_it_listens_on_this_machine_alone():
    async def talk(server, _):
        assert server.url.startswith("http://127.0.0.1:")
        others = {a[4][0] for a in socket.getaddrinfo(socket.gethostname(), None, socket.AF_INET)} - {"127.0.0.1"}
        for address in others:
            with socket.socket() as probe:
                probe.settimeout(1.0)
                assert probe.connect_ex((address, server.port)) != 0, address

    served(talk)


def test_the_page_fetches_nothing_and_runs_its_own_script_only():
    async def talk(server, _):
        answer = await AsyncHTTPClient().fetch(server.url)
        policy = answer.headers["Content-Security-Policy"]
        assert policy.startswith("default-src 'none'")
        assert re.search(r"script-src 'sha256-[\w+/]+=';", policy)
        assert answer.headers["Cache-Control"] == "no-store"

    served(talk)
    assert not re.findall(r"(?:src|href)\s*=\s*\"(?!data:)", live_page())
    assert not re.findall(r"^(?:import|export) ", live_page(), re.MULTILINE)


def test_text_of_a_mission_cannot_leave_its_element():
    page = live_page([{"kind": "mission", "name": "</script><script>alert(1)</script>"}])
    assert "alert(1)" in page
    assert "</script><script>alert" not in page


def test_several_pages_get_every_event_and_a_reconnected_page_continues():
    async def collect(socket_, name, have):
        await socket_.write_message(json.dumps({"name": name, "have": have}))
        found, begins = [], []
        while True:
            told = json.loads(await socket_.read_message())
            begins.append(told["from"])
            found += told["events"]
            if have + len(found) >= 1001:
                return told["name"], found, begins

    async def talk(server, timeline):
        url = f"ws://127.0.0.1:{server.port}/events"
        first, second = await websocket_connect(url), await websocket_connect(url)
        (name, found, _), (other, again, _) = await asyncio.gather(collect(first, "", 0), collect(second, "", 0))
        assert name == other
        assert found == again
        assert [e["t"] for e in found[1:]] == list(range(1000))
        first.close()
        _, rest, begins = await collect(await websocket_connect(url), name, 990)
        assert (begins[0], len(rest)) == (990, 11)
        timeline.begin({"kind": "mission", "name": "another"})
        told = json.loads(await second.read_message())
        assert (told["from"], [e["name"] for e in told["events"]], told["name"] != name) == (0, ["another"], True)
        for message in ("[]", '{"name": "a", "have": 1e999}', "[" * 3000):
            bad = await websocket_connect(url)
            await bad.write_message(message)
            assert await bad.read_message() is None
            assert bad.close_code == 1003, message

    served(talk)


def test_a_page_is_told_that_more_events_wait():
    """The page then draws seldom, and reads."""

    async def talk(server, timeline):
        timeline.add([{"kind": "n", "t": i} for i in range(4000)])
        page = await websocket_connect(f"ws://127.0.0.1:{server.port}/events")
        await page.write_message(json.dumps({"name": "", "have": 0}))
        found = 0
        while found < 5001:
            told = json.loads(await page.read_message())
            assert told["from"] == found
            found += len(told["events"])
            assert told["more"] == (found < 5001)

    served(talk)


def test_a_port_that_is_taken_is_named_with_its_option():
    with socket.socket() as other:
        other.bind(("127.0.0.1", 0))
        other.listen()
        port = other.getsockname()[1]
        assert port_or_any(port) == 0, "a mission's live view takes another one"
        with pytest.raises(PortTakenError, match=rf"--port {port}: .*Address already in use.*another port: --port N"):
            LiveServer(Timeline(), port)


def test_the_command_reports_errors(tmp_path, capsys):
    assert main([str(tmp_path / "nowhere")]) == 2
    assert "nowhere does not exist. Name a run folder" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("arguments", "expected"),
    [
        (["--port", "99999"], "--port must be 0 to 65535, not 99999"),
        (["--control"], "--control needs a running mission, but"),
        (["--domain", "3"], "--domain is for running missions, but"),
        (["--mission", "nosuch"], "--mission nosuch: there is no such file"),
        (["--mission", "."], ".: cannot be read: Is a directory"),
        (["--write", "page.html", "--port", "8000"], "--port serves a page, but --write only writes one"),
        (["--write", "page.html", "--port", "0"], "--port serves a page, but --write only writes one"),
        (["--write", "page.html", "--open"], "--open serves a page, but --write only writes one"),
        (["--write", "nowhere/page.html"], "nowhere/page.html: cannot be written: No such file or directory"),
    ],
)
def test_impossible_options_are_named(tmp_path, capsys, synthetic_run, arguments, expected):
    write_run(synthetic_run(steps=1), tmp_path / "run")
    assert main([str(tmp_path / "run"), "--no-open", *arguments]) == 2
    assert expected in capsys.readouterr().err


def test_a_mission_file_may_come_through_a_pipe(tmp_path, synthetic_run):
    """As --mission <(...) of a shell."""
    write_run(synthetic_run(steps=1), tmp_path / "run")
    mission, pipe = (tmp_path / "run" / "mission.yaml").read_text(), tmp_path / "pipe"
    os.mkfifo(pipe)
    writer = threading.Thread(target=pipe.write_text, args=(mission,), daemon=True)
    writer.start()
    page = tmp_path / "page.html"
    assert main([str(tmp_path / "run"), "--mission", str(pipe), "--write", str(page)]) == 0
    assert page.is_file()


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
def test_the_command_serves_until_a_signal_ends_it(tmp_path, synthetic_run, number):
    folder = tmp_path / "a run"
    write_run(synthetic_run(), folder)
    command = [sys.executable, "-m", "auv_lse_run", "live", str(folder), "--port", "0", "--no-open"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as process:
        watchdog = threading.Timer(60.0, process.kill)
        watchdog.start()
        try:
            line = process.stdout.readline()
            assert "http://127.0.0.1:" in line, process.stderr.read()
            time.sleep(0.2)
            process.send_signal(number)
            _, errors = process.communicate(timeout=30)
        finally:
            watchdog.cancel()
            with contextlib.suppress(ProcessLookupError):
                process.kill()
    assert (process.returncode, errors) == (128 + number, "")


def test_a_recording_can_be_written_into_the_page(tmp_path, synthetic_run):
    folder, page = tmp_path / "run", Path(tmp_path / "page.html")
    write_run(synthetic_run(), folder)
    assert main([str(folder), "--write", str(page), "--no-open"]) == 0
    events = json.loads(page.read_text().split('type="application/json">', 1)[1].split("</script>", 1)[0])
    assert (events[0]["kind"], events[0]["name"]) == ("mission", "run")


def test_control_refuses_to_choose_between_missions(monkeypatch, capsys):
    monkeypatch.setattr("auv_lse_shore.live.command.busy_domains", lambda: [41, 42])
    assert main(["--control", "--no-open"]) == 2
    assert "Several missions are running (domains 41, 42); choose one with --domain" in capsys.readouterr().err


def test_the_buttons_stay_with_the_first_mission_found(monkeypatch, tmp_path):
    found = running.RunningMission(80, tmp_path / "80")
    monkeypatch.setattr(running, "newest_mission", lambda: found)
    monkeypatch.setattr(running, "busy_domains", lambda: [80, 81])
    monkeypatch.setattr(running, "run_on", lambda domain: tmp_path / str(domain))
    commanding = running.MissionFollower(Timeline(), None, None, CommandQueue())
    watching = running.MissionFollower(Timeline(), None, None)
    assert commanding._find() == watching._find() == found
    found = running.RunningMission(81, tmp_path / "81")
    assert (commanding._find().domain, watching._find().domain) == (80, 81)
