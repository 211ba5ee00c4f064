"""The cluster that missions are flown on."""

import pytest

from auv_lse_shore.campaign.cluster import CampaignError, cluster


def test_an_unreachable_scheduler_is_named(monkeypatch):
    import distributed

    def refuse(address, timeout):
        raise OSError(f"Timed out trying to connect to {address}")

    monkeypatch.setattr(distributed, "Client", refuse)
    with (
        pytest.raises(CampaignError, match=r"--scheduler tcp://127\.0\.0\.1:1: cannot be used"),
        cluster("tcp://127.0.0.1:1", None),
    ):
        pass
