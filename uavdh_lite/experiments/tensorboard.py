"""A run's curves as TensorBoard event files, by the writer that comes with torch."""

from pathlib import Path

from uavdh_lite.errors import extra
from uavdh_lite.training import Trainer


def writer_type() -> type:
    """The class that writes event files; `MissingExtra` if TensorBoard is not installed."""
    with extra("tensorboard"):
        from torch.utils.tensorboard import SummaryWriter
    return SummaryWriter


class Board:
    """Writes the rows of a run's two tables as they come; `close` ends the files.

    Each number is a scalar named like its column, `training/has_landed`, at the environment steps
    of its row. A resumed run continues the same curves: whatever was written after the state that
    it resumes from is dropped.

    Raises `MissingExtra` if TensorBoard is not installed.
    """

    def __init__(self, folder: Path, trainer: Trainer):
        self._writer = writer_type()(str(folder), purge_step=trainer.steps + 1)
        self._trainer = trainer
        self._written = {name: len(rows) for name, rows in self._tables().items()}

    def _tables(self) -> dict[str, list[dict]]:
        return {
            "training": self._trainer.training_rows,
            "validation": self._trainer.validation_rows,
        }

    def write(self) -> None:
        """Write the rows that were added since the last call."""
        for name, rows in self._tables().items():
            for row in rows[self._written[name] :]:
                for column, value in row.items():
                    if column != "steps" and value is not None:
                        self._writer.add_scalar(f"{name}/{column}", value, row["steps"])
            self._written[name] = len(rows)
        self._writer.flush()

    def close(self) -> None:
        self._writer.close()
