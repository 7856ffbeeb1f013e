"""What is known of a suite's ranks before anything is recorded."""

import pytest

from vrbench.config.ranking import never_ranked
from vrbench.config.suite import Suite, load_suite

RANK = {"metric": "ape.translation.aligned", "point": "eye", "statistic": "rmse"}


RANKED = ["gameplay-replay", "occluded-cameras", "relocalisation", "static-jitter", "speed-sweep"]


@pytest.mark.parametrize("name", [*RANKED, "calibration", "long-loop"])
def test_of_the_shipped_suites_those_with_two_mounts_of_three_takes_can_be_ranked(name):
    assert (not never_ranked(load_suite(name))) == (name in RANKED)


@pytest.mark.parametrize(
    ("changes", "says"),
    [
        ({"rank": {**RANK, "statistic": "p95"}}, "boards rank by rmse or mean"),
        ({"rank": {**RANK, "metric": "rpe.translation@1s"}, "compare": "paired"}, "alone"),
        ({"rank": {**RANK, "statistic": "mean"}, "compare": "paired"}, "alone"),
    ],
)
def test_what_no_board_can_rank_is_told(changes, says):
    told = load_suite("gameplay-replay").canonical()
    told["conditions"] = [{"id": "usual", "baseline": True}, {"id": "slow", "speed": 0.5}]
    (why,) = never_ranked(Suite.model_validate({**told, **changes}))
    assert says in why
