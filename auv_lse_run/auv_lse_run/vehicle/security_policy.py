"""The SROS 2 policy of one vehicle, generated from the table of topics: what its nodes may publish, read and serve."""

import argparse
from collections.abc import Sequence
from xml.etree import ElementTree

from auv_lse_common.mission_file.parameters import ParameterError
from auv_lse_common.topics.table import MISSION_TOPICS, VEHICLE_TOPICS
from auv_lse_run.vehicle.run_vehicle import vehicle_number

#: Topics and parameter services of every ROS 2 node.
_TOPICS_OF_ALL = ("/rosout", "/parameter_events", "/clock")
_SERVICES_OF_ALL = (
    "describe_parameters",
    "get_parameter_types",
    "get_parameters",
    "list_parameters",
    "set_parameters",
    "set_parameters_atomically",
    "get_type_description",
)
_NODES = ("gp_node", "planner_node", "safety_node", "modem_node", "micromodem_node", "vehicle_link_node")
_SERVICES = ("mission/run",)

ERRORS = (ParameterError,)


def policy(vehicle: int) -> str:
    """The policy of vehicle `vehicle` as text: one enclave, /auvN, for all of its nodes and its recorder."""
    root = ElementTree.Element("policy", {"version": "0.2.0"})
    enclaves = ElementTree.SubElement(root, "enclaves")
    enclave = ElementTree.SubElement(enclaves, "enclave", {"path": f"/auv{vehicle}"})
    profiles = ElementTree.SubElement(enclave, "profiles")
    shared = [name for name, topic in MISSION_TOPICS.items() if not topic.lockstep]
    own = [name for name, topic in VEHICLE_TOPICS.items() if not topic.lockstep]
    topics = sorted({*_TOPICS_OF_ALL, *shared, *(f"/auv{vehicle}/{name}" for name in own)})
    for node in _NODES:
        of_node = (f"/auv{vehicle}/{node}/{name}" for name in _SERVICES_OF_ALL)
        _profile(
            profiles, f"/auv{vehicle}", node, topics, sorted([*of_node, *(f"/auv{vehicle}/{s}" for s in _SERVICES)])
        )
    _profile(profiles, "/", "recorder_node", topics, [f"/recorder_node/{name}" for name in _SERVICES_OF_ALL])
    ElementTree.indent(root)
    return '<?xml version="1.0" encoding="UTF-8"?>\n' + ElementTree.tostring(root, encoding="unicode") + "\n"


def _profile(
    profiles: ElementTree.Element, namespace: str, node: str, topics: Sequence[str], services: Sequence[str]
) -> None:
    profile = ElementTree.SubElement(profiles, "profile", {"ns": namespace, "node": node})
    allowed = ElementTree.SubElement(profile, "topics", {"publish": "ALLOW", "subscribe": "ALLOW"})
    for name in topics:
        ElementTree.SubElement(allowed, "topic").text = name
    served = ElementTree.SubElement(profile, "services", {"reply": "ALLOW", "request": "ALLOW"})
    for name in services:
        ElementTree.SubElement(served, "service").text = name


def parser() -> argparse.ArgumentParser:
    """The command line of auv_lse security-policy."""
    p = argparse.ArgumentParser(
        prog="auv_lse security-policy",
        description="Prints the SROS 2 policy of one vehicle, generated from the table of topics: what its nodes may "
        "publish, read and serve.",
        epilog="Exit codes: 0; 2 not a vehicle's name, or wrong command line.",
    )
    p.add_argument("vehicle", metavar="VEHICLE", help="the vehicle, such as auv2")
    return p


def run(options: argparse.Namespace) -> None:
    """Prints a vehicle's policy."""
    print(policy(vehicle_number(options.vehicle)), end="")
