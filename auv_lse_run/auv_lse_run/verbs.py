"""The verbs of this package."""

from auv_lse_common.support.verb import NODES, Verb

VERBS = (
    Verb("vehicle", "vehicle", "run the nodes of one vehicle, and restart them when they die",
         "auv_lse_run.vehicle.run_vehicle", needs=NODES),
    Verb("go", "vehicle", "start the mission, or continue after a hold",
         "auv_lse_run.inspect.run", ("go",), NODES),
    Verb("hold", "vehicle", "hold the position until go",
         "auv_lse_run.inspect.run", ("hold",), NODES),
    Verb("surface", "vehicle", "hold at the surface until go",
         "auv_lse_run.inspect.run", ("surface",), NODES),
    Verb("abort", "vehicle", "end the mission; safety.abort sets what the vehicle does then",
         "auv_lse_run.inspect.run", ("abort",), NODES),
    Verb("reset", "vehicle", "clear tripped limits and an abort; the mission then holds until go",
         "auv_lse_run.inspect.run", ("reset",), NODES),
    Verb("state", "vehicle", "show the state of each vehicle's mission",
         "auv_lse_run.inspect.run", ("state",), NODES),
    Verb("security-policy", "vehicle", "print the SROS 2 policy of one vehicle",
         "auv_lse_run.vehicle.security_policy"),
    Verb("nodes", "inspect", "list and describe running nodes, as ros2 node does",
         "auv_lse_run.inspect.nodes", needs=NODES),
    Verb("topics", "inspect", "list, show and measure topics, as ros2 topic does",
         "auv_lse_run.inspect.topics", needs=NODES),
    Verb("params", "inspect", "list, show and set parameters of running nodes, as ros2 param does",
         "auv_lse_run.inspect.params", needs=NODES),
    Verb("files", "install", "list the files that are shipped: missions, layouts, systemd unit",
         "auv_lse_run.command.files"),
    Verb("completion", "install", "print a script that completes auv_lse in bash or zsh",
         "auv_lse_run.command.completion"),
    Verb("wheels", "install", "build the packages as libraries for pip",
         "auv_lse_run.command.wheels", in_checkout=True),
)  # fmt: skip
