import pytest

from auv_lse_common.mission_file.sections.link import LinkConfig
from auv_lse_comms.transport import AddressError, UdpPort
from auv_lse_mavlink import check_command
from auv_lse_mavlink.port import AutopilotPort


def test_an_endpoint_that_cannot_be_opened_is_reported_once_and_retried():
    taken = UdpPort("udpin", "127.0.0.1", 0)
    endpoint = f"udpin://127.0.0.1:{taken.local_port}"
    pilot = AutopilotPort(LinkConfig(kind="mavlink", endpoint=endpoint), 2, None)
    told = [event.text for n in range(100) for event in pilot.step(float(n), float(n))]
    assert len(told) == 1
    assert told[0].startswith(f"link.endpoint: {endpoint}: ")
    assert "Address already in use" in told[0]
    taken.close()
    for n in range(100, 200):
        assert pilot.step(float(n), float(n)) == []
    assert pilot.transport is not None
    assert pilot.close(200.0, 200.0) == []


def test_a_check_names_an_endpoint_that_is_no_address_as_it_was_typed():
    with pytest.raises(AddressError, match=r"^'foo' is not an address"):
        check_command.run(check_command.parser().parse_args(["foo"]))
