"""Results as text: tables in columns."""

from collections.abc import Iterable

from uavdh_lite.evaluation import Interval

TABLE_METRICS = ("landed", "collected", "collected_and_landed", "return", "time_used")


def table(rows: Iterable[Iterable[str]]) -> str:
    """Rows of cells as lines, the first column to the left, the others to the right."""
    columns = list(zip(*rows, strict=True))
    widths = [max(map(len, column)) + 2 for column in columns]
    padded = [[cell.rjust(width) for cell in c] for c, width in zip(columns, widths, strict=True)]
    padded[0] = [cell.ljust(widths[0]) for cell in columns[0]]
    return "\n".join(map("".join, zip(*padded, strict=True)))


def policies_table(
    results: dict[str, dict[str, Interval]], paper: dict[str, float] | None = None
) -> str:
    """A line for each policy, with the mean of each of `TABLE_METRICS` and its 95 % interval.

    Arguments:
        results: `Flights.metrics` by policy.
        paper: the paper's own means, for one more line.
    """
    rows = [["", *(name.replace("_", " ") for name in TABLE_METRICS)]]
    for policy, metrics in results.items():
        rows.append([policy, *(interval_text(name, metrics[name]) for name in TABLE_METRICS)])
    if paper is not None:
        shares = (f"{100 * paper[name]:.1f} %" for name in paper)
        rows.append(["the paper, on its own map", *shares, "", ""])
    return table(rows)


def interval_text(metric: str, interval: Interval) -> str:
    """As in `97.1 (96.4 to 97.7) %`; the return is no share.

    Of values that are all equal, such as a single one, only the mean is shown.
    """
    scale, unit = (1, "") if metric == "return" else (100, " %")
    mean, low, high = (f"{scale * value:.1f}" for value in interval)
    return f"{mean} ({low} to {high}){unit}" if interval.low < interval.high else f"{mean}{unit}"
