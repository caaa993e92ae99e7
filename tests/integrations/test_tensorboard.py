"""TensorBoard's event files hold the rows of a run's tables, also when it stops and resumes."""

import pytest
from tensorboard.backend.event_processing.event_accumulator import EventAccumulator

from uavdh_lite.experiments.runs import train
from uavdh_lite.storage import read_table
from uavdh_lite.training import BIN


@pytest.mark.filterwarnings("ignore::DeprecationWarning")
def test_events_are_the_rows_of_the_tables(tmp_path, trainer):
    run = {"steps": 3 * BIN, "environments": 32, "validation_interval": 2 * BIN}
    train(trainer(**run), tmp_path, stop_after=BIN)
    train(trainer(**run), tmp_path, tensorboard=True, resume=True, stop_after=BIN + 1)
    found = EventAccumulator(str(tmp_path / "tensorboard"))
    assert [event.step for event in found.Reload().Scalars("training/loss")] == [BIN + 24]
    train(trainer(**run), tmp_path, tensorboard=True, resume=True)
    found.Reload()
    for name in ("training", "validation"):
        table = read_table(tmp_path / f"{name}.csv")
        for column in table.keys() - {"steps", "seconds"}:
            events = found.Scalars(f"{name}/{column}")
            assert [event.step for event in events] == table["steps"].tolist()
            values = [event.value for event in events]
            assert values == pytest.approx(table[column].tolist(), rel=1e-4, abs=1e-5)
