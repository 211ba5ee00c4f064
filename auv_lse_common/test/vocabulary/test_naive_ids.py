"""Ids of naive paths in plans, and those in packets and parameters, of which fitted lanes have only five."""

from auv_lse_common.mission_file.sections.mission import MissionConfig
from auv_lse_common.vocabulary.naive_ids import FITTED, FITTED_OF_GROUP, IDS, id_in_packet, id_in_plan
from auv_lse_common.vocabulary.plan import NONE


def test_every_vehicle_has_a_strip_of_its_own():
    assert MissionConfig(vehicles=len(FITTED)).vehicles == len(set(FITTED))
    assert len(set(IDS)) == len(IDS)


def test_a_group_of_five_vehicles_shares_the_ids_in_packets():
    for vehicle, naive_path in enumerate(FITTED, start=1):
        sent = id_in_packet(naive_path)
        assert sent == FITTED_OF_GROUP[(vehicle - 1) % 5]
        assert id_in_plan(sent, vehicle) == naive_path
    assert id_in_plan(FITTED_OF_GROUP[4], 6) == FITTED[9]
    for naive_path in (*set(IDS) - set(FITTED), NONE):
        assert id_in_packet(naive_path) == id_in_plan(naive_path, 7) == naive_path
