"""Documents of the verbs of robots."""

from __future__ import annotations

from dextera_build.cli.documents.document import Document


def _times(name: str, what: str, kind: str) -> dict[str, tuple[str, str]]:
    return {
        f"{name}_ms_p50": (kind, f"{what}: median [ms]; null: it was never measured"),
        f"{name}_ms_p99": (kind, f"{what}: 99th percentile [ms]"),
    }


_ENDED = {
    "reason": ("text", "why it ended"),
    "success": ("boolean or null", "whether the task was done, as measured; null: unknown"),
    "steps": ("integer", "control steps"),
}
_RECORDING = {"recording": ("text", "path of the recording")}
_AHEAD = "number or null?"

DOCUMENTS = (
    Document(
        "run",
        "dxb run RECIPE --policy RECIPE:NODE",
        {
            **_ENDED,
            "missed_periods": ("integer", "control periods whose command was late by more than half a period"),
            "interventions": ("integer", "control periods in which the guard changed targets"),
            **_times("delay", "time from a measurement to its command", "number or null"),
            **_times("jitter", "deviation of the time between two commands from the period", "number or null"),
            "periods_without_a_step": ("integer?", "with `--asynchronous`: control periods in which no step was left"),
            **_times("answer", "with `--asynchronous`: time of an answer", _AHEAD),
            **_times("age", "with `--asynchronous`: time from the measurement behind a command to the command", _AHEAD),
            **_RECORDING,
        },
    ),
    Document(
        "robot.doctor",
        "dxb robot doctor RECIPE",
        {
            "checks[].check": ("text", "what was checked"),
            "checks[].ok": ("boolean", "whether it is fine"),
            "checks[].found": ("text", "what was found, in words"),
            "checks[].mend": ("text or null", "what mends it; null: nothing to mend"),
            "failed": ("integer", "number of checks that failed"),
        },
    ),
    Document(
        "robot.track",
        "dxb robot track RECIPE --cell RECIPE:NODE",
        {
            "frames": ("integer", "frames in which objects were tracked"),
            **_times("frame", "time of a frame in the tracker", "number or null"),
            "tracked.*": ("number", "object -> fraction of frames in which it was measured"),
        },
    ),
    Document("robot.record", "dxb robot record RECIPE", {**_ENDED, **_RECORDING}),
    Document(
        "robot.simulate",
        "dxb robot simulate RECIPE",
        {
            "task": ("text", "name of the task"),
            "world": ("text", "kind of the world"),
            "commands": ("integer", "commands that arrived"),
            "commands_expired": ("integer", "those that arrived too late"),
            "commands_after_stop": ("integer", "those that came after the sender had stopped"),
            "unusable": ("list of text", "the first five reasons why a command was refused"),
            "status": ("list of text", "the last five states that the sender reported"),
            "last_command_after_fault_s.*": ("number", "kind of a fault -> time from it to the last command [s]"),
            "joints.*": ("number", "joint -> its position at the end [rad or m]"),
            "success": ("boolean or null", "whether the task is done; null: unknown"),
            "restarts_late": ("integer", "how often this machine was too slow for real time"),
        },
    ),
)
