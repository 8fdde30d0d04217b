"""Documents of the verbs that look at what was built, except `dxb show`."""

from __future__ import annotations

from dextera_build.cli.documents.document import EPOCH, NODE, STALE, Document, rows

_DIGEST = "digest of an output"
_MOTION = {
    "frames": ("text", "`T_parent_child`"),
    "distance_m": ("number", "distance between the origins [m]"),
    "angle_deg": ("number", "angle between the orientations [deg]"),
    "distance_interval_m": ("list of number or null", "95 % interval [m]; null: no covariances are known"),
    "angle_interval_deg": ("list of number or null", "95 % interval [deg]; null: no covariances are known"),
}
_DIFFERENCE = {
    "kind": ("text", "`output`, `metric`, `option`, `code`, `input`, `status`, ..."),
    "name": ("text", "what differs: a field, an option, a metric, ..."),
    "change": ("text", "the change, in words"),
    "largest": ("number or null", "largest absolute difference of two numbers; null: they are no numbers"),
    "changed": ("integer or null", "how many numbers differ"),
    "total": ("integer or null", "how many numbers there are"),
    "motion": ("object or null", "motion of a pose; null: it is none"),
    **{f"motion.{name}": told for name, told in _MOTION.items()},
}
_ASSET = {
    "digest": ("text", "SHA-256 of the artifact: its identity"),
    "kind": ("text", "`object` or `background`"),
    "name": ("text", "label of the object, or the recipe's last word for a background"),
    "category": ("text", "`mug`, `laptop`, ...; `room` for a background"),
    "source": ("text", "`rgb` or `rgbd`: whether measured depth helped"),
    "scale": ("text or null", "where metres come from: `depth`, `marker`, `robot`, `size`, `unknown`"),
    "size_m": ("list of number or null", "extent along x, y, z [m]"),
    "mass_kg": ("number or null", "best estimate [kg]"),
    "mass_low_kg": ("number or null", "lower end of its 90 % interval [kg]"),
    "mass_high_kg": ("number or null", "upper end [kg]"),
    "material": ("text or null", "row of the material table"),
    "friction": ("number or null", "sliding friction"),
    "cut": ("boolean", "whether the picture's border cuts it"),
    "joints[].name": ("text", "name of a joint"),
    "joints[].type": ("text", "`revolute` or `prismatic`"),
    "joints[].lower": ("number", "lower limit [rad or m]"),
    "joints[].upper": ("number", "upper limit [rad or m]"),
    "joints[].position": ("number", "position in the photograph [rad or m]"),
    "collision_pieces": ("integer", "number of collision pieces"),
    "triangles": ("integer", "number of triangles"),
    "urdf": ("text or null", "SHA-256 of its URDF folder; null: none was built"),
    "nodes": ("list of text", "addresses of the nodes that returned it"),
}

DOCUMENTS = (
    rows(
        "ls.recipes",
        "dxb ls",
        {"recipe": ("text", "address of a recipe"), "summary": ("text", "its first line")},
    ),
    rows("ls.rules", "dxb ls rules", {"rule": ("text", "address of a rule"), "summary": ("text", "what it does")}),
    rows(
        "ls.backends",
        "dxb ls backends",
        {
            "rule": ("text", "address of the rule"),
            "backend": ("text", "name of the backend"),
            "profiles": ("list of text", "profiles that take it"),
            "lacks": ("list of text", "what it lacks on this machine; empty: it can run"),
            "gpu_gb": ("number or null", "memory of a GPU that it needs [GiB]; null: none"),
            "licence": ("text", "licence of what it runs"),
            "summary": ("text", "what it does"),
        },
    ),
    rows(
        "ls.profiles",
        "dxb ls profiles",
        {
            "profile": ("text", "name of a profile"),
            "rule": ("text", "address of a rule"),
            "backends": ("list of text", "its backends in the profile, the preferred one first"),
            "from": ("text", "the profile that states them"),
        },
    ),
    rows(
        "ls.runs",
        "dxb ls runs",
        {
            "run": ("text", "id of the run"),
            "time": ("number", f"when it began [{EPOCH}]"),
            "recipe": ("text", "the recipe that was built"),
            "ended": ("text", "`done`, `failed`, `interrupted` or `cut off`"),
            "seconds": ("number or null", "its duration [s]; null: it was cut off"),
        },
    ),
    rows(
        "ls.divergent",
        "dxb ls divergent",
        {
            "node": ("text", "a node that returned another output when it ran again"),
            "key": ("text", "its key"),
            "first": ("text", "digest of the output that is kept"),
            "again": ("list of text", "digests of the other outputs"),
            "time": ("number", f"when it was noticed [{EPOCH}]"),
        },
    ),
    rows(
        "ls.calls",
        "dxb ls calls",
        {
            "call": ("text", "digest of a recorded call"),
            "service": ("text", "the service that was asked"),
            "model": ("text or null", "its model"),
            "time": ("number or null", f"when it was asked [{EPOCH}]"),
            "seconds": ("number", "how long the answer took [s]"),
            "tokens": ("number or null", "tokens that the service counted"),
            "cost": ("number or null", "its cost, as the service states it [USD]"),
            "answer_bytes": ("integer or null", "size of the answer [byte]"),
        },
    ),
    rows("ls.nodes", "dxb ls RECIPE[:GLOB]", NODE),
    Document(
        "why",
        "dxb why RECIPE:NODE",
        {
            "node": ("text", "the node"),
            "answer": ("text", "the answer in one sentence"),
            "causes[].kind": ("text", "`option`, `code`, `input`, `file`, `package`, `waits for`, ..."),
            "causes[].name": ("text", "what changed"),
            "causes[].change": ("text", "the old and the new value, in words"),
            "causes[].place": ("text", "file, line and column, or the node; empty if there is none"),
            "causes[].depth": ("integer", "0, or one more than that of the cause that it explains, which stands above"),
        },
    ),
    rows("why.recipe", "dxb why RECIPE", STALE),
    Document(
        "diff",
        "dxb diff A [B]",
        {
            "old": ("text", "name of the first operand"),
            "new": ("text", "name of the second one"),
            "summary": ("text or null", "what differs, in one sentence"),
            "differences[].node": ("text", "address of a node that differs; empty if two results are compared"),
            **{f"differences[].rows[].{name}": told for name, told in _DIFFERENCE.items()},
        },
    ),
    rows("log", "dxb log [RUN]", {"*": ("any", "fields of the [event](#events)")}),
    Document(
        "log.node",
        "dxb log RUN NODE",
        {
            "run": ("text", "id of the run"),
            "node": ("text", "address of the node"),
            "status": ("text", "how it ended: `cached`, `ran`, `fetched`, `failed`, `waits` or `cancelled`"),
            "text": ("text or null", "everything that it printed; null: nothing, or the store has lost it"),
        },
    ),
    Document("get", "dxb get RECIPE:NODE", {"files": ("list of text", "paths of the files, the main one first")}),
    rows("library", "dxb library", _ASSET),
    Document(
        "library.folder",
        "dxb library -o DIR",
        {"files": ("list of text", "paths of `index.json` and `index.html`")},
    ),
    Document(
        "report",
        "dxb report [RUN]",
        {
            "report": ("text", "path of the page"),
            "view": ("text or null", "path of the page in 3D if it is too large for the report; else null"),
        },
    ),
    Document("view", "dxb view RECIPE", {"url": ("text", "address of the viewer")}, when="when it listens"),
    Document(
        "view.file",
        "dxb view RECIPE --save FILE",
        {"file": ("text", "path of the file"), "bytes": ("integer", "its size [byte]")},
    ),
    Document("teleop", "dxb teleop RECIPE", {"url": ("text", "address of the page")}, when="when it listens"),
    Document(
        "teleop.ended",
        "dxb teleop RECIPE",
        {
            "recording": ("text", "path of the recording"),
            "takes": ("integer", "number of takes in it"),
            "discarded": ("boolean", "whether the end discarded a take that was running"),
            **{
                f"{name}_ms": ("list of number or null", f"{told}: median and 99th percentile [ms]")
                for name, told in {
                    "own_share": "delay from a message to its effect in this program",
                    "processor": "processor time in it",
                    "whole_way": "delay from the page and back to it",
                    "round_trip": "round trip of the network",
                    "camera": "delay from a picture of a camera to its hands",
                }.items()
            },
            "messages_dropped": ("integer", "messages that a newer one replaced"),
            "frames_refused": ("integer", "messages that were malformed"),
            "replay": ("text or null", "the command that replays the recording; null: it has no take"),
        },
        when="at its end",
    ),
    Document(
        "serve",
        "dxb serve RECIPE:NODE",
        {
            "url": ("text", "address of the server"),
            "wire": ("text", "version of the promise that the server sends to its clients"),
            "policy": ("text", "digest of the checkpoint"),
            "algorithm": ("text", "how it was trained"),
            "task": ("text", "name of the task"),
            "instruction": ("text", "the task in words"),
            "embodiment": ("text", "digest of names and limits of the robot's joints"),
            "rate_hz": ("number", "control rate [Hz]"),
            "inputs[].name": ("text", "key of a channel in a request"),
            "inputs[].shape": ("list of integer", "its shape"),
            "inputs[].dtype": ("text", "`float32` or `uint8`"),
            "inputs[].names": ("list of text", "names of its rows or components"),
            "inputs[].unit": ("text", "unit of its numbers; empty if it has none"),
            "joints": ("list of text", "components of an action"),
            "limits": ("list", "lower and upper limit of each joint [rad or m]"),
            "horizon": ("integer", "steps in an answer"),
            "every": ("integer", "steps to carry out before the next request"),
            "history": ("integer", "steps that the policy sees at once"),
            "forget": ("number", "decay of the weights by which overlapping answers are averaged"),
            "reset": ("text", "key of a request that begins an episode"),
        },
        when="when it listens",
    ),
)
