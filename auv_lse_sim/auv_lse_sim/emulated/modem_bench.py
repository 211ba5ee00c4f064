"""`python -m auv_lse_sim.emulated.modem_bench`: emulated modems in real time, for trying drivers without hardware.

Every modem receives every packet of the others after one second. No mission runs: connect `micromodem_node`, WHOI's
`acomms`, or a terminal to the printed ports. Stop with Ctrl-C.
"""

import argparse
import contextlib
import select
import signal
import sys
from collections.abc import Callable, Sequence
from datetime import UTC, datetime
from pathlib import Path

from auv_lse_sim.emulated.host_ports import HostPort, PtyPort, TcpServerPort
from auv_lse_sim.emulated.modem_rack import ModemRack, perfect_water

_TICK_S = 0.05


def run(
    ports: dict[int, HostPort], delay_s: float, clock_s: Callable[[], float], running: Callable[[], bool]
) -> ModemRack:
    """Serves the modems while `running` returns true; closes the ports.

    Args:
        ports: Ports by modem number.
        delay_s: Travel time of every packet (s).
        clock_s: Returns the time (s since 1970, UTC).
        running: Whether to continue.

    Returns:
        The rack, closed, for its counts.
    """
    transmit, water = perfect_water(lambda: rack, delay_s)
    rack = ModemRack(ports, transmit, clock_s())
    with contextlib.suppress(KeyboardInterrupt), contextlib.closing(rack):
        while running():
            select.select([rack], [], [], _TICK_S)
            now_s = clock_s()
            rack.serve(now_s)
            rack.poll(now_s)
            water(now_s)
    return rack


def main(arguments: Sequence[str] | None = None) -> int:
    """Serves the modems until Ctrl-C. Returns 0, or 2 if a port cannot be opened."""
    parser = argparse.ArgumentParser(
        prog="python -m auv_lse_sim.emulated.modem_bench", description=(__doc__ or "").split("\n\n")[1]
    )
    parser.add_argument("--modems", type=int, default=2, metavar="K", help="number of modems (default: 2)")
    parser.add_argument("--folder", type=Path, metavar="DIR", help="create links DIR/modem1, ... to the ptys")
    parser.add_argument("--tcp", type=int, metavar="PORT", help="TCP on PORT, PORT+1, ... of 127.0.0.1 instead of ptys")
    parser.add_argument("--delay", type=float, default=1.0, metavar="S", help="travel time of packets (default: 1 s)")
    options = parser.parse_args(arguments)
    ports: dict[int, HostPort] = {}
    try:
        for number in range(1, options.modems + 1):
            if options.tcp is not None:
                ports[number] = TcpServerPort(options.tcp + number - 1)
            else:
                ports[number] = PtyPort(options.folder / f"modem{number}" if options.folder is not None else None)
    except OSError as error:
        print(f"error: port of modem {len(ports) + 1} cannot be opened: {error}", file=sys.stderr)
        return 2
    for number, port in ports.items():
        print(f"modem {number}: {port.port}", flush=True)
    rack = run(ports, options.delay, lambda: datetime.now(UTC).timestamp(), lambda: True)
    print(f"packets sent {sum(rack.transmitted.values())}, received {sum(rack.delivered.values())}")
    return 0


if __name__ == "__main__":
    signal.signal(signal.SIGINT, signal.default_int_handler)  # background scripts inherit an ignored SIGINT
    sys.exit(main())
