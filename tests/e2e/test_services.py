"""`[services.NAME]` and `--max-cost` through the real `dxb`, with several worker processes."""

from __future__ import annotations

import signal
import threading
import time
from collections.abc import Iterator
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer

import pytest

from tests.e2e.space import Answer, Space
from tests.e2e.test_watch import Watching

RULE = '''
"""toy.ask: asks a service."""
import os
import urllib.request
from dextera_build.artifacts.base import File
from dextera_build.rule import Context, Options, rule

class AskOptions(Options):
    """Options."""
    number: int = 0
    """What to ask."""

@rule(version=1)
def ask(ctx: Context, *, options: AskOptions) -> File:
    """Return what the service says."""
    def send(timeout_s: float) -> bytes:
        with urllib.request.urlopen(f"{os.environ['ASK_URL']}/{options.number}", timeout=timeout_s) as answer:
            return answer.read()
    return File(data=ctx.call("oracle", {"number": options.number}, send, wait_s=0.05))
'''
RECIPE = """
nodes:
{nodes}
targets: {{default: [{names}]}}
"""
SETTINGS = "[services.oracle]\nconcurrent = 2\nusd_per_call = 0.02\n[resources]\ncpu = 4\n"


class Oracle:
    """Counts how many requests it serves at a time."""

    def __init__(self) -> None:
        self.url = ""
        self.asked = 0
        self.now = 0
        self.most = 0
        self.waits_for = 1
        """The first requests are answered once so many are there."""
        self.enough = threading.Event()


@pytest.fixture
def oracle(monkeypatch: pytest.MonkeyPatch) -> Iterator[Oracle]:
    made, lock = Oracle(), threading.Lock()

    class Handler(BaseHTTPRequestHandler):
        def do_GET(self) -> None:
            with lock:
                made.asked += 1
                made.now += 1
                made.most = max(made.most, made.now)
                if made.now >= made.waits_for:
                    made.enough.set()
            made.enough.wait(60)
            time.sleep(0.2)
            with lock:
                made.now -= 1
            self.send_response(200)
            self.end_headers()
            self.wfile.write(f"answer {self.path}".encode())

        def log_message(self, *words: object) -> None:
            pass

    server = ThreadingHTTPServer(("127.0.0.1", 0), Handler)
    made.url = f"http://127.0.0.1:{server.server_address[1]}"
    monkeypatch.setenv("ASK_URL", made.url)
    threading.Thread(target=server.serve_forever, args=(0.02,), daemon=True).start()
    yield made
    server.shutdown()
    server.server_close()


@pytest.fixture
def asking(space: Space, oracle: Oracle) -> Space:
    space.write("rules/toy/ask.py", RULE.lstrip())
    nodes = "\n".join(f"  q{number}: {{rule: toy.ask, number: {number}}}" for number in range(6))
    space.write("recipes/say/ask.yaml", RECIPE.format(nodes=nodes, names=", ".join(f"q{n}" for n in range(6))))
    space.write("dxb.toml", SETTINGS)
    return space


def failed(answer: Answer) -> list[str]:
    ends = [event for event in answer.events if event["event"] == "node_finished" and event["status"] == "failed"]
    return [event["error"]["code"] for event in ends]


@pytest.mark.medium
def test_worker_processes_share_the_slots_of_a_service(asking: Space, oracle: Oracle) -> None:
    oracle.waits_for = 2  # workers may take longer to start than an answer
    answer = asking.dxb("build", "say/ask", "-j", "4", "--console", "plain")
    assert answer.code == 0, answer.err
    assert (oracle.asked, oracle.most) == (6, 2)
    assert "  cost: 0.1200 USD for 6 requests to oracle\n" in answer.err
    again = asking.dxb("build", "say/ask", "--force", "q0", "--console", "plain")
    assert "cost:" not in again.err


@pytest.mark.slow
def test_a_limit_of_costs_holds_over_worker_processes(asking: Space, oracle: Oracle) -> None:
    answer = asking.build("say/ask", "-j", "4", "-k", "--max-cost", "0.07")
    assert answer.code == 1
    assert oracle.asked == 3
    assert failed(answer) == ["DXB-B361"] * 3
    paid = [event for event in answer.events if event["event"] == "node_paid"]
    assert [(event["service"], event["usd"]) for event in paid] == [("oracle", 0.02)] * 3
    rest = asking.dxb("build", "say/ask", "-k", env={"DXB_MAX_COST": "0.06"})
    assert rest.code == 0, rest.err
    assert oracle.asked == 6


@pytest.mark.medium
def test_the_report_and_the_log_tell_what_calls_cost(asking: Space, oracle: Oracle) -> None:
    assert asking.dxb("build", "say/ask").code == 0
    assert asking.dxb("report", "--out", "report.html").code == 0
    assert "0.1200 USD for 6 requests to oracle" in (asking.root / "report.html").read_text()
    assert "cost: 0.1200 USD for 6 requests to oracle" in asking.dxb("log").err


@pytest.mark.medium
def test_a_service_without_a_price_is_not_asked_under_a_limit(asking: Space, oracle: Oracle) -> None:
    asking.edit("dxb.toml", "usd_per_call = 0.02\n", "")
    answer = asking.build("say/ask:q0", "--max-cost", "1")
    assert failed(answer) == ["DXB-B362"]
    assert oracle.asked == 0
    assert asking.build("say/ask:q0", "--max-cost", "none").code == 0


@pytest.mark.parametrize(
    ("words", "code"), [(["--max-cost", "much"], "DXB-U103"), (["--max-cost", "1", "--executor", "ray"], "DXB-U180")]
)
def test_limits_that_cannot_be_kept_are_refused(asking: Space, oracle: Oracle, words: list[str], code: str) -> None:
    answer = asking.dxb("build", "say/ask", *words)
    assert answer.code == 2
    assert f"error[{code}]" in answer.err
    assert oracle.asked == 0


def test_wrong_settings_of_a_service_name_the_file(asking: Space) -> None:
    asking.write("dxb.toml", "[services.oracle]\nprice = 3\n")
    answer = asking.dxb("build", "say/ask")
    assert answer.code == 2
    assert "error[DXB-R404]: `services.oracle` has no field `price`" in answer.err
    assert "dxb.toml" in answer.err
    asking.write("dxb.toml", SETTINGS)
    assert "services" in asking.dxb("show", "--config").out


@pytest.mark.slow
def test_a_limit_of_costs_holds_over_the_rounds_of_a_watch(asking: Space, oracle: Oracle) -> None:
    asking.write("recipes/say/one.yaml", "nodes:\n  q: {rule: toy.ask, number: 10}\ntargets: {default: [q]}\n")
    watching = Watching(asking, "say/one", "--max-cost", "0.05")
    watching.until("1 ran")
    asking.edit("recipes/say/one.yaml", "10", "11")
    watching.until("1 ran")
    asking.edit("recipes/say/one.yaml", "11", "12")
    watching.until("1 failed")
    watching.process.send_signal(signal.SIGINT)
    watching.process.wait(30)
    assert oracle.asked == 2
