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


def paper_table(metrics: dict[str, Interval], paper: dict[str, float]) -> str:
    """The metrics that the paper reports, next to its results; then the share of time used."""
    lines = [f"{'':<28}{'this agent':>12}{'95 % interval':>20}{'paper':>10}"]
    for name, theirs in paper.items():
        mean, low, high = metrics[name]
        between = f"{low:.1%} to {high:.1%}"
        lines.append(f"{name.replace('_', ' '):<28}{mean:>12.1%}{between:>20}{theirs:>10.1%}")
    lines.append(f"{'flying time used':<28}{metrics['time_used'].mean:>12.1%}")
    return "\n".join(lines)
