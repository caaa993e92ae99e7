"""Results as text: means with their 95 % intervals, in columns."""

from uavdh_lite.evaluation import Interval


def interval_text(interval: Interval) -> str:
    """As in `0.9689 (0.9632 to 0.9741)`."""
    mean, low, high = interval
    return f"{mean:.4f} ({low:.4f} to {high:.4f})"


def metrics_table(metrics: dict[str, Interval]) -> str:
    """A line for each metric, from `Flights.metrics`."""
    lines = [f"{'':<28}{'mean':>9}{'95 % interval':>22}"]
    for name, (mean, low, high) in metrics.items():
        lines.append(f"{name:<28}{mean:>9.4f}{f'{low:.4f} to {high:.4f}':>22}")
    return "\n".join(lines)


def policies_table(results: dict[str, dict[str, Interval]], paper: dict[str, float]) -> str:
    """A line for each policy, from `Flights.metrics`; the last one has the paper's results.

    The 95 % interval is that of the share collected and landed.
    """
    head = ["landed", "collected", "collected and landed", "95 % interval", "return", "time used"]
    rows = [["", *head]]
    for policy, metrics in results.items():
        _, low, high = metrics["collection_ratio_and_landed"]
        shares = [f"{metrics[name].mean:.1%}" for name in paper]
        total, time = metrics["cumulative_reward"].mean, metrics["time_used"].mean
        rows.append([policy, *shares, f"{low:.1%} to {high:.1%}", f"{total:.1f}", f"{time:.1%}"])
    theirs = [f"{share:.1%}" for share in paper.values()]
    rows.append(["the paper, on its own map", *theirs, "", "", ""])
    widths = [max(map(len, column)) + 2 for column in zip(*rows, strict=True)]
    return "\n".join(
        row[0].ljust(widths[0])
        + "".join(cell.rjust(width) for cell, width in zip(row[1:], widths[1:], strict=True))
        for row in rows
    )
