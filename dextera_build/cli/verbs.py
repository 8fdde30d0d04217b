"""The verbs of `dxb` by group, each with a one-line summary, and former names of verbs."""

GROUPS = {
    "build": {
        "build": "build targets; only what is stale runs",
        "plan": "show what a build would do, without doing it",
        "watch": "build, and rebuild whenever a file that the build read changes",
        "bind": "bind names to objects, by a phrase, a property or a point in the photograph",
        "check": "check recipes without building them, or rebuild a node and compare",
    },
    "look": {
        "show": "show a recipe, node, rule, graph, trace, lineage, or the configuration",
        "ls": "list recipes, rules, backends, nodes or runs",
        "why": "explain why a node is stale, or when it was built",
        "diff": "compare two runs, nodes or artifacts",
        "log": "show past runs and what their nodes printed",
        "get": "write a node's artifact to files",
        "library": "list, search and export the objects and backgrounds that were built",
        "view": "show a scene in the browser",
        "teleop": "demonstrate a task by hand, in the browser or a headset, and record the hands",
        "serve": "serve a policy to robots and evaluators, by openpi's protocol on web sockets",
        "report": "write a run's report, one offline HTML file",
    },
    "robot": {
        "run": "run a policy on a robot with ROS 2, within limits, and record it",
        "robot": "check the connection to a robot, record a demonstration on it, or simulate one",
    },
    "share": {
        "cache": "push and pull results, collect garbage, verify or serve the store",
        "bundle": "export and import results with their provenance",
    },
    "project": {
        "init": "make a new project",
        "new": "make a new recipe, rule or backend; propose elements or a mask to edit",
        "models": "list, fetch, verify and add the weights of pretrained models",
        "consent": "show, give or withdraw consent to send data of this project to services",
        "doctor": "check this machine's packages, devices and settings",
        "help": "explain a verb, an error code, a rule or an artifact type",
        "completion": "print a script that completes command lines in bash, zsh or fish",
    },
}
"""Group -> verb -> summary."""
MODULES = {verb: f"dextera_build.cli.{group}.{verb}" for group, verbs in GROUPS.items() for verb in verbs}
"""Verb -> its module."""
VERBS = {verb: text for group in GROUPS.values() for verb, text in group.items()}
MOVED = {
    "graph": "show --graph",
    "lineage": "show --lineage",
    "trace": "show --trace",
    "gc": "cache gc",
    "pull": "cache pull",
    "push": "cache push",
    "verify": "cache verify",
}
"""Former or alternative name -> the current verb."""
