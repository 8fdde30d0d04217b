"""No request is sent that could exceed the limit of costs, and what may have been charged counts."""

from __future__ import annotations

import os
import subprocess
import sys
import threading
import time
from pathlib import Path

import pytest

from dextera_build.calls.limits import locked_json
from dextera_build.calls.question import question
from dextera_build.calls.spending import Spending, open_ledger
from dextera_build.errors import RuleError

ASKED = question("forge", {"model": "big"})
DIE = """
import os, sys
from pathlib import Path
from dextera_build.calls.question import question
from dextera_build.calls.spending import Spending
with Spending(Path(sys.argv[1]), 1.0).reserved(question("forge", {}), 0.6):
    os.kill(os.getpid(), 9)
"""


@pytest.fixture
def ledger():
    descriptor, path = open_ledger()
    yield Path(path)
    os.close(descriptor)


def test_a_request_that_could_exceed_the_limit_is_refused(ledger):
    spending = Spending(ledger, 1.0)
    with spending.reserved(ASKED, 0.6) as bill:
        bill.amount = 0.5
    with spending.reserved(ASKED, 0.5):
        pass
    with pytest.raises(RuleError) as caught, spending.reserved(ASKED, 0.01):
        pytest.fail("it was sent")
    error = caught.value
    assert error.code == "DXB-B361"
    assert error.message == "a call of `forge big` could exceed the limit of 1.00 USD, so it was not sent"
    assert (error.facts["spent"], error.facts["the call costs up to"]) == ("1.00 USD", "0.0100 USD")
    assert error.hint.startswith("`--max-cost 1.01` or more")


def test_a_request_without_a_price_is_refused(ledger):
    with pytest.raises(RuleError, match="no price bounds a call of `forge big`") as caught:
        Spending(ledger, 1.0).reserved(ASKED, None).__enter__()
    assert caught.value.code == "DXB-B362"
    assert "[services.forge] usd_per_call = ..." in caught.value.hint


def test_free_requests_pass_at_the_limit(ledger):
    with Spending(ledger, 0.0).reserved(ASKED, 0.0):
        pass


def test_a_request_whose_answer_was_lost_counts(ledger):
    spending = Spending(ledger, 1.0)
    with pytest.raises(OSError, match="cut"), spending.reserved(ASKED, 0.6):
        raise OSError("cut")
    assert spending.total() == pytest.approx(0.6)


def test_a_request_of_a_killed_process_counts(ledger):
    done = subprocess.run([sys.executable, "-c", DIE, str(ledger)], check=False)
    assert done.returncode == -9
    with pytest.raises(RuleError, match="could exceed"), Spending(ledger, 1.0).reserved(ASKED, 0.5):
        pytest.fail("it was sent")


def test_a_request_waits_for_one_under_way_that_may_turn_out_cheaper(ledger):
    began = threading.Event()

    def first():
        with Spending(ledger, 1.0).reserved(ASKED, 0.8) as bill:
            began.set()
            time.sleep(0.3)
            bill.amount = 0.1

    thread = threading.Thread(target=first)
    thread.start()
    began.wait()
    with Spending(ledger, 1.0).reserved(ASKED, 0.8):
        assert not thread.is_alive() or Spending(ledger, 1.0).total() == pytest.approx(0.9)
    thread.join()


def test_threads_never_exceed_the_limit(ledger):
    sent, refused = [], []

    def spend():
        try:
            with Spending(ledger, 1.0).reserved(ASKED, 0.3):
                sent.append(0.3)
        except RuleError:
            refused.append(1)

    threads = [threading.Thread(target=spend) for _ in range(10)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert (len(sent), len(refused)) == (3, 7)


def test_an_emptied_ledger_is_readable(ledger):
    with locked_json(ledger) as state:
        assert state == {}
