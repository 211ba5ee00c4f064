import numpy as np

from auv_lse_common.plan import Plan


def test_a_plan_holds_what_a_packet_can():
    plan = Plan(
        step=7,
        heading_rad=0.1,
        north_m=123.456789,
        east_m=-9.87654321,
        actions=(np.int64(3), 5),
        naive_path=0xF0,
    )
    assert plan.north_m == float(np.float32(123.456789))
    assert plan.actions == (3, 5)
    assert type(plan.actions[0]) is int
    again = Plan(
        step=7,
        heading_rad=plan.heading_rad,
        north_m=plan.north_m,
        east_m=plan.east_m,
        actions=(3, 5),
        naive_path=0xF0,
    )
    assert again == plan
