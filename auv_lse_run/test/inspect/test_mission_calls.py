"""When auv_lse go sends a command, and to whom, with a simulated clock and simulated vehicles."""

from __future__ import annotations

import importlib.util
from types import SimpleNamespace
from typing import Any

import pytest

if importlib.util.find_spec("rclpy") is None or importlib.util.find_spec("auv_lse_msgs") is None:
    pytest.skip("needs rclpy and the built workspace (scripts/test sets both up)", allow_module_level=True)

from auv_lse_run.inspect import graph_node, mission_calls_node
from auv_lse_run.inspect import run as mission
from auv_lse_run.remote.mission_link import MissionLink
from auv_lse_run.remote.orders import ACTED, INTERRUPTED, SILENT, Order

pytestmark = pytest.mark.ros


#: How much the vehicles' clock is ahead of the operator's (s).
AHEAD_S = 5000.0


class _Vehicle:
    """Its service is matched after `from_s`, its node's name is known 2 s later; it ignores the first `deaf` calls."""

    def __init__(self, graph: _Graph, from_s: float, deaf: int) -> None:
        self._graph, self.from_s, self._deaf = graph, from_s, deaf
        self.is_accepting = True
        self.calls_s: list[float] = []
        self.requests: list[Any] = []

    def service_is_ready(self) -> bool:
        return self._graph.now_s >= self.from_s

    def call_async(self, request: Any) -> Any:
        self.calls_s.append(self._graph.now_s)
        self.requests.append(request)
        is_heard = len(self.calls_s) > self._deaf
        clock_s = self._graph.now_s + AHEAD_S
        answer = SimpleNamespace(accepted=self.is_accepting, message="ABORTED: ABORT by me", clock_s=clock_s)
        return SimpleNamespace(done=lambda: is_heard, result=lambda: answer)


class _Graph(graph_node.Graph):
    """A graph with vehicles: {name: (time of its appearance in s, number of calls that it ignores)}."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch, vehicles: dict[str, tuple[float, int]]) -> None:
        super().__init__(at_once=True)
        self.now_s, self.node = 0.0, self
        self.vehicles = {name: _Vehicle(self, *fate) for name, fate in vehicles.items()}
        clock = SimpleNamespace(monotonic=lambda: self.now_s)
        monkeypatch.setattr(graph_node, "time", clock)
        monkeypatch.setattr(mission_calls_node, "time", clock)
        monkeypatch.setattr(mission, "time", clock)

    def spin(self, seconds: float) -> None:
        self.now_s += seconds

    def nodes(self, hidden: bool = False) -> list[str]:
        return [f"/{name}/safety_node" for name, v in self.vehicles.items() if self.now_s >= v.from_s + 2.0]

    def services(self) -> list[str]:
        return [f"/{name}/mission/run" for name, v in self.vehicles.items() if self.now_s >= v.from_s]

    def topics(self, hidden: bool = False) -> dict[str, tuple[str, ...]]:
        return {}

    def create_client(self, kind: type, service: str) -> Any:
        return self.vehicles.get(service.split("/")[1], _Vehicle(self, 1e9, 0))

    def destroy_client(self, client: Any) -> None:
        pass

    def run(self, *words: str, verb: str = "abort") -> int:
        options = mission.parser().parse_args([verb, *words])
        assert options.at_once, "the command line does not discover first"
        return mission.run_send(options, self)


def test_a_command_goes_out_as_soon_as_each_vehicle_is_matched(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    graph = _Graph(monkeypatch, {"auv1": (0.1, 0), "auv2": (0.5, 0), "auv3": (2.9, 0)})
    assert graph.run("all") == 0
    for name, vehicle in graph.vehicles.items():
        assert vehicle.calls_s == [pytest.approx(vehicle.from_s, abs=0.06)], name
    assert capsys.readouterr().out.splitlines()[-1] == "accepted by 3: auv1, auv2, auv3"


def test_a_command_to_named_vehicles_ends_with_the_last_answer(monkeypatch: pytest.MonkeyPatch) -> None:
    graph = _Graph(monkeypatch, {"auv1": (0.1, 0), "auv2": (0.5, 0)})
    assert graph.run("auv1", "auv2") == 0
    assert graph.now_s == pytest.approx(0.6, abs=0.11)
    assert [len(v.calls_s) for v in graph.vehicles.values()] == [1, 1]


def test_a_command_without_an_answer_is_repeated_and_a_silent_vehicle_reported(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    graph = _Graph(monkeypatch, {"auv1": (0.1, 2), "auv2": (0.1, 99)})
    assert graph.run("auv1", "auv2", "auv7", "..") == 1
    assert graph.vehicles["auv1"].calls_s == pytest.approx([0.1, 1.1, 2.1], abs=0.16)
    printed = capsys.readouterr()
    assert printed.out.splitlines() == ["auv1: ABORTED: ABORT by me", "accepted by 1: auv1"]
    assert printed.err.splitlines() == [
        "..: error: not found; running: auv1, auv2",
        "auv2: error: no answer. It may still act on ABORT: see auv_lse state",
        "auv7: error: not found; running: auv1, auv2",
    ]


def test_a_vehicle_may_be_named_as_for_auv_lse_vehicle_and_in_capitals(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Whoever aborts in a hurry types what comes to mind."""
    graph = _Graph(monkeypatch, {"auv1": (0.1, 0), "auv2": (0.1, 0), "auv3": (0.1, 0)})
    assert graph.run("AUV1", "2", "/auv3", "auv1") == 0
    assert [len(v.calls_s) for v in graph.vehicles.values()] == [1, 1, 1]
    assert graph.run("ALL") == 0
    assert [len(v.calls_s) for v in graph.vehicles.values()] == [2, 2, 2]
    capsys.readouterr()
    assert graph.run("boat") == 1
    assert capsys.readouterr().err == "boat: error: not found; running: auv1, auv2, auv3\n"


def test_a_vehicle_whose_safety_node_hangs_is_named(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """A stopped process is not discovered; `abort all` must not pass over its vehicle."""
    for words in (("all",), ("auv1", "auv2")):
        graph = _Graph(monkeypatch, {"auv1": (0.1, 0)})
        nodes = graph.nodes
        monkeypatch.setattr(
            graph, "nodes", lambda hidden=False, known=nodes: [*known(), "/auv2/gp_node", "/auv3/sounder_node"]
        )
        assert graph.run(*words) == 1
        printed = capsys.readouterr()
        assert "accepted by 1: auv1" in printed.out
        waiting, failed = printed.err.splitlines()
        assert waiting == "auv2: its safety_node hangs or is not running; waiting up to 20 s for its restart"
        assert failed.startswith("auv2: error: its safety_node, which takes commands, hangs or is not running")
        assert "auv3" not in printed.err, "a user's driver"


def test_a_vehicle_that_has_answered_does_not_hang_although_the_name_of_its_safety_node_is_not_known_yet(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    graph = _Graph(monkeypatch, {"auv1": (0.1, 0)})
    nodes = graph.nodes
    monkeypatch.setattr(graph, "nodes", lambda hidden=False: [*nodes(), "/auv1/gp_node"])
    assert graph.run("auv1", verb="hold") == 0
    assert capsys.readouterr().err == ""


def test_a_vehicle_that_refuses_is_not_counted_as_accepting(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    graph = _Graph(monkeypatch, {"auv1": (0.1, 0), "auv2": (0.1, 0)})
    graph.vehicles["auv1"].is_accepting = False
    assert graph.run("auv1", "auv2", verb="go") == 1
    printed = capsys.readouterr()
    assert printed.out.splitlines()[-1] == "accepted by 1: auv2"
    assert printed.err.startswith("auv1: refused: ")


@pytest.mark.parametrize(("verb", "calls"), [("hold", 1), ("go", 0)])
def test_a_stop_waits_for_the_restart_of_a_safety_node_and_go_does_not(
    monkeypatch: pytest.MonkeyPatch, verb: str, calls: int
) -> None:
    """It takes 10 s until a safety_node that hangs is killed: who stops a vehicle must not have to try again."""
    graph = _Graph(monkeypatch, {"auv1": (0.1, 0), "auv2": (12.0, 0)})
    nodes = graph.nodes
    monkeypatch.setattr(graph, "nodes", lambda hidden=False: [*nodes(), "/auv2/gp_node"])
    assert graph.run("all", verb=verb) == 1 - calls
    assert len(graph.vehicles["auv2"].calls_s) == calls
    assert len(graph.vehicles["auv1"].calls_s) > 0


def test_without_a_vehicle_the_command_fails(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("ROS_STATIC_PEERS", "10.9.0.2")
    with pytest.raises(graph_node.GraphError, match=r"no vehicle found in .* through ROS_STATIC_PEERS=10\.9\.0\.2 "):
        _Graph(monkeypatch, {}).run("all")


def test_ctrl_c_names_the_vehicles_that_may_act_on_the_command(monkeypatch: pytest.MonkeyPatch) -> None:
    graph = _Graph(monkeypatch, {"auv1": (0.1, 0), "auv2": (0.1, 9)})
    spin = graph.spin

    def interrupted(seconds: float) -> None:
        spin(seconds)
        if graph.now_s > 2.0:
            raise KeyboardInterrupt

    monkeypatch.setattr(graph, "spin", interrupted)
    with pytest.raises(KeyboardInterrupt, match="No answer yet from auv2, which may act on it"):
        graph.run("auv1", "auv2")


@pytest.mark.parametrize("verb", ["go", "reset"])
def test_what_may_move_a_vehicle_is_sent_with_the_time_of_the_vehicle_at_which_it_was_given(
    monkeypatch: pytest.MonkeyPatch, verb: str
) -> None:
    """Its first two calls are lost, whatever they are: it is asked for its time, then sent the command."""
    graph = _Graph(monkeypatch, {"auv1": (0.5, 0), "auv2": (0.5, 2)})
    assert graph.run("auv1", "auv2", verb=verb) == 0
    for name, asked in (("auv1", 1), ("auv2", 3)):
        requests = graph.vehicles[name].requests
        assert [r.ask for r in requests] == [True] * asked + [False]
        assert AHEAD_S - 0.11 <= requests[-1].given_s <= AHEAD_S, "when the operator gave it, or just before"


def test_a_go_of_the_fleet_is_sent_with_the_time_at_which_its_operator_gave_it(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    graph = _Graph(monkeypatch, {"auv1": (0.5, 0)})
    graph.now_s = 400.0
    link = MissionLink("auv1", 1)
    link._graph = graph
    order = Order(laptop="a", number=1, verb="go", given_s=100.0, valid_s=600.0)
    assert link.give(order)[0] == ACTED
    sent = graph.vehicles["auv1"].requests[-1]
    assert (sent.ask, sent.given_s, sent.valid_s) == (False, pytest.approx(AHEAD_S + 100.0, abs=0.11), 600.0)


def test_a_stop_is_sent_at_once(monkeypatch: pytest.MonkeyPatch) -> None:
    for verb in ("hold", "surface", "abort"):
        graph = _Graph(monkeypatch, {"auv1": (0.1, 0)})
        assert graph.run("auv1", verb=verb) == 0
        assert [(r.ask, r.given_s) for r in graph.vehicles["auv1"].requests] == [(False, 0.0)]


def test_a_vehicle_that_does_not_answer_receives_no_go(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """It would act on it when it is back, without anybody watching."""
    graph = _Graph(monkeypatch, {"auv1": (0.1, 99)})
    assert graph.run("auv1", verb="go") == 1
    assert all(r.ask for r in graph.vehicles["auv1"].requests)
    assert capsys.readouterr().err == "auv1: error: no answer, so GO was not sent. Try again\n"


@pytest.mark.parametrize(
    ("verb", "asked", "outcome"), [("go", False, SILENT), ("go", True, INTERRUPTED), ("hold", True, SILENT)]
)
def test_an_order_from_the_laptop_is_repeated_only_if_it_cannot_undo_a_later_hold(
    monkeypatch: pytest.MonkeyPatch, verb: str, asked: bool, outcome: str
) -> None:
    """A vehicle that does not answer; `asked`: it has said what time it is."""
    graph = _Graph(monkeypatch, {"auv1": (0.1, 99)})
    vehicle, ignored = graph.vehicles["auv1"], SimpleNamespace(done=lambda: False)
    answer = SimpleNamespace(clock_s=AHEAD_S)
    heard = SimpleNamespace(done=lambda: True, result=lambda: answer)
    monkeypatch.setattr(vehicle, "call_async", lambda request: heard if request.ask and asked else ignored)
    link = MissionLink("auv1", 1)
    link._graph = graph
    assert link.give(Order(laptop="a", number=1, verb=verb))[0] == outcome
