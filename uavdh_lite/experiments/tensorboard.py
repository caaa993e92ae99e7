"""A run's curves as TensorBoard event files, by the writer that comes with torch."""

from pathlib import Path

from uavdh_lite.errors import extra
from uavdh_lite.training import Trainer


class Board:
    """Writes the rows of a run's two tables as they come; `close` ends the files.

    Each number is a scalar named like its column, `training/has_landed`, at the environment steps
    of its row. A run that is resumed goes on with the same curves: what it had written beyond the
    state it goes on from is struck out.

    Raises `MissingExtra` if TensorBoard is not installed.
    """

    def __init__(self, folder: Path, trainer: Trainer):
        with extra("tensorboard"):
            from torch.utils.tensorboard import SummaryWriter
        self._writer = SummaryWriter(str(folder), purge_step=trainer.steps + 1)
        self._trainer = trainer
        self._written = {name: len(rows) for name, rows in self._tables().items()}

    def _tables(self) -> dict[str, list[dict]]:
        return {
            "training": self._trainer.training_rows,
            "validation": self._trainer.validation_rows,
        }

    def write(self) -> None:
        """Write the rows that are new since the last call."""
        for name, rows in self._tables().items():
            for row in rows[self._written[name] :]:
                for column, value in row.items():
                    if column != "steps" and value is not None:
                        self._writer.add_scalar(f"{name}/{column}", value, row["steps"])
            self._written[name] = len(rows)
        self._writer.flush()

    def close(self) -> None:
        self._writer.close()
