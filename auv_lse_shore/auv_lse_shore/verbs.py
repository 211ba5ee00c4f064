"""The verbs of this package."""

from auv_lse_common.support.verb import NODES, Verb

VERBS = (
    Verb("mission", "mission", "run a simulated team mission as real ROS 2 processes",
         "auv_lse_shore.mission.command", needs=NODES),
    Verb("sim", "mission", "run the simulator of a mission without its vehicles",
         "auv_lse_shore.mission.sim", needs=NODES),
    Verb("check", "mission", "check mission files", "auv_lse_shore.check.command"),
    Verb("live", "mission", "show a running mission, or a recording, on a page in the browser",
         "auv_lse_shore.live.command"),
    Verb("import", "after", "turn logs of an existing survey (ArduPilot, NMEA, CSV) into a run folder",
         "auv_lse_shore.survey_import.command"),
    Verb("replay", "after", "play a recording, recompute its decisions, or make its report again",
         "auv_lse_shore.replay.command"),
    Verb("adjust", "after", "correct the positions of all soundings of one or more runs, and map them",
         "auv_lse_shore.adjust.command"),
    Verb("certify", "after", "recompute a map from its recordings, and certify what it promises",
         "auv_lse_shore.certify.command"),
    Verb("export", "after", "export results: GeoTIFF, ASCII grid, GeoJSON, CSV, a QGIS project",
         "auv_lse_shore.export.command"),
    Verb("fit", "after", "fit the hyperparameters of the Gaussian process to soundings or a run",
         "auv_lse_shore.fit"),
    Verb("campaign", "research", "run many missions, on this machine or a Dask cluster",
         "auv_lse_shore.campaign.command"),
    Verb("reproduce", "research", "reproduce the results of the paper in simulation",
         "auv_lse_shore.reproduce.reproduce"),
    Verb("bench", "research", "measure speed as ratios against named alternatives",
         "benchmarks.bench", in_checkout=True),
    Verb("faults", "research", "inject faults into a mission, and tabulate the effects",
         "benchmarks.faults.__main__", needs=NODES, in_checkout=True),
)  # fmt: skip
