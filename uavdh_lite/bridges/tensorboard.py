"""A run's curves as TensorBoard event files, by the writer that comes with torch."""

from pathlib import Path

from uavdh_lite.errors import extra
from uavdh_lite.training import Trainer


class Board:
    """Writes the rows of a run's two tables as they come: `training/landed` is a column's curve.

    A resumed run writes all of them again, in place of what is there.

    Raises `MissingExtra` if TensorBoard is not installed.
    """

    def __init__(self, folder: Path, trainer: Trainer):
        with extra("tensorboard"):
            from torch.utils.tensorboard import SummaryWriter
        self._trainer, self._written = trainer, 0
        self._writer = SummaryWriter(str(folder), purge_step=0)

    def write(self) -> None:
        """Write the rows that were added since the last call."""
        trainer = self._trainer
        tables = {"training": trainer.training_rows, "validation": trainer.validation_rows}
        for table, rows in tables.items():
            for row in rows:
                for column, value in row.items():
                    if row["steps"] > self._written and column != "steps" and value is not None:
                        self._writer.add_scalar(f"{table}/{column}", value, row["steps"])
        self._written = trainer.steps
        self._writer.flush()

    def close(self) -> None:
        self.write()
        self._writer.close()
