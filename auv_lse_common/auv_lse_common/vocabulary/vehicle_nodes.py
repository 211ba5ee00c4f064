"""The nodes of one vehicle."""


def vehicle_nodes(modem: bool, link: bool) -> list[tuple[str, str]]:
    """Package and executable of each node of one vehicle.

    Args:
        modem: Whether micromodem_node runs between modem_node and a modem.
        link: Whether vehicle_link_node runs between the stack and an autopilot.
    """
    nodes = [
        ("auv_lse_planner", "safety_node"),  # first: nothing moves without it, and it must answer soonest
        ("auv_lse_gp", "gp_node"),
        ("auv_lse_planner", "planner_node"),
        ("auv_lse_comms", "modem_node"),
    ]
    if modem:
        nodes.append(("auv_lse_comms", "micromodem_node"))
    if link:
        nodes.append(("auv_lse_mavlink", "vehicle_link_node"))
    return nodes
