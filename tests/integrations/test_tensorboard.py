"""TensorBoard's event files hold the rows of the CSV files, also after a resume."""

import pytest
from tensorboard.backend.event_processing.event_accumulator import EventAccumulator

from uavdh_lite.experiments.runs import train
from uavdh_lite.storage import read_table
from uavdh_lite.training import BIN


def scalars(folder):
    events = EventAccumulator(str(folder))
    events.Reload()
    return {tag: events.Scalars(tag) for tag in events.Tags()["scalars"]}


@pytest.mark.filterwarnings("ignore::DeprecationWarning")
def test_events_are_the_rows_of_the_tables(tmp_path, trainer):
    run = {"steps": 4 * BIN, "environments": 32, "validation_interval": BIN}
    out = tmp_path / "run"
    train(trainer(**run), out, tensorboard=True, stop_after=2 * BIN)
    train(trainer(**run), out, tensorboard=True, resume=True)
    found = scalars(out / "tensorboard")
    for name in ("training", "validation"):
        table = read_table(out / f"{name}.csv")
        for column in table.keys() - {"steps", "seconds"}:
            events = found[f"{name}/{column}"]
            assert [event.step for event in events] == table["steps"].tolist()
            assert [event.value for event in events] == pytest.approx(
                table[column].tolist(), rel=1e-4, abs=1e-5
            )


def test_without_the_option_there_are_none(tmp_path, trainer):
    train(trainer(steps=400), tmp_path / "run")
    assert not (tmp_path / "run" / "tensorboard").exists()
