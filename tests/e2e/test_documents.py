"""Every verb with `--json` prints one document, as described; tests of servers and robots compare theirs."""

from __future__ import annotations

import pytest

from dextera_build.cli.documents import DOCUMENTS
from tests import documents
from tests.e2e.space import Space

READING = """
ls | ls rules | ls backends | ls profiles | ls runs | ls divergent | ls calls | ls say/words
plan say/words | plan say/words --check | why say/words | why say/words:all | check say/words | check say/words:all
show say/words | show say/words:all | show toy.shout | show factorize.mesh | show --config
show --graph say/words | show --graph say/words --dot | show --graph say/words -o graph.json
show --lineage say/words | show --trace | show --trace -o trace.json
diff 0001:start 0001:words | log | log 0001 start | get say/words:all -o got | library | report -o page.html
cache size | cache gc | cache verify | cache push say/words --to ./elsewhere | cache pull say/words --from ./elsewhere
bundle create say/words -o words.tar | bundle inspect words.tar | bundle inspect words.tar --recipe say/words
bundle import words.tar | bundle keygen anna
models ls | models verify | consent ls | doctor
"""
ELSEWHERE = {
    *("bind", "bind.removed", "cache.serve", "check.calibration", "library.folder", "run", "serve", "show.call"),
    *("models.accept", "models.add", "models.get", "models.rm", "robot.doctor", "robot.record", "robot.simulate"),
    "robot.track",
    *("show.part", "teleop", "teleop.ended", "view", "view.file"),
}
"""Documents that the tests of their verbs compare, on a service, a server, a robot, weights or shapes."""


@pytest.mark.slow
def test_verbs_print_the_documents_that_are_described(space: Space) -> None:
    assert space.build("say/words").code == 0
    seen = set()
    for words in (line.strip() for line in READING.replace("\n", "|").split("|") if line.strip()):
        answer = space.dxb(*words.split(), "--json")
        assert answer.code in ((0, 4) if words == "doctor" else (0,)), answer.err
        seen.add(documents.read(answer.out)["schema"])
    assert seen == {each.schema for name, each in DOCUMENTS.items() if name not in ELSEWHERE}


@pytest.mark.medium
def test_what_goes_wrong_is_described_too(space: Space) -> None:
    space.write("recipes/say/wrong.yaml", "nodes:\n  a: {rule: toy.shuot, text: x}\n")
    one = space.dxb("check", "say/wrong", "--json")
    (row,) = one.rows
    assert (one.code, row["found"], row["error"]["where"][1]) == (2, None, 2)
    assert "error[DXB-R" in one.err
    assert space.dxb("check", "say/words", "say/wrong", "--json").rows[1] == row
    assert space.dxb("plan", "say/nothing", "--json").out == ""
    unbuilt = space.dxb("plan", "say/words", "--check", "--json")
    assert (unbuilt.code, unbuilt.rows) == (3, [{"node": "start", "why": "never built"}])
    first = space.dxb("ls", "say/words", "--json").rows[0]
    assert (first["backend"], first["last_seconds"]) == (None, None)
