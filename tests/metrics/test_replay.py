import pytest

from vrbench.metrics import replay
from vrbench.streams import Columns


def test_replay_forgives_the_delay_and_not_the_path(values, make_take, moved):
    take = make_take()
    tcp = take.columns.poses["robot/tcp"]
    columns = Columns(
        {"robot/target": tcp, "robot/tcp": moved(tcp, 0.085, (0.5, 0, 0))},
        metadata={"fraction": "0.9"},
    )
    found = values(replay.FAMILY, make_take(columns=columns))
    assert found["replay.fidelity", "tcp", "all", "rmse"].value == pytest.approx(0.5, abs=0.02)
    assert found["replay.fraction", "", "all", "value"].value == pytest.approx(90, abs=0.2)
    missing = values(replay.FAMILY, take)
    assert "robot/target" in missing["replay.fidelity", "", "all", "rmse"].reason
