from uavdh_lite.evaluation import Interval
from uavdh_lite.experiments.report import interval_text, metrics_table, policies_table

METRICS = {
    "has_landed": Interval(0.99, 0.98123, 1.0),
    "time_used": Interval(0.7, 0.6, 0.8),
}


def test_an_interval_has_four_digits():
    assert interval_text(METRICS["has_landed"]) == "0.9900 (0.9812 to 1.0000)"


def test_a_line_for_each_metric_in_columns():
    title, *lines = metrics_table(METRICS).splitlines()
    assert title.split() == ["mean", "95", "%", "interval"]
    assert [line.split() for line in lines] == [
        ["has_landed", "0.9900", "0.9812", "to", "1.0000"],
        ["time_used", "0.7000", "0.6000", "to", "0.8000"],
    ]
    assert len({len(line) for line in (title, *lines)}) == 1


def test_a_line_for_each_policy_and_the_papers():
    shares = ("has_landed", "collection_ratio", "collection_ratio_and_landed")
    paper = dict(zip(shares, (0.995, 0.948, 0.946), strict=True))
    metrics = {name: Interval(0.99, 0.98123, 1.0) for name in shares}
    metrics |= {"cumulative_reward": Interval(35.04, 34, 36), "time_used": METRICS["time_used"]}
    text = policies_table({"agent": metrics, "a rule": metrics}, paper)
    title, agent, rule, papers = text.splitlines()
    assert title.split() == [
        "landed",
        "collected",
        "collected",
        "and",
        "landed",
        "95",
        "%",
        "interval",
        "return",
        "time",
        "used",
    ]
    assert agent.removeprefix("agent").split() == rule.removeprefix("a rule").split()
    assert agent.split()[1:] == ["99.0%"] * 3 + ["98.1%", "to", "100.0%", "35.0", "70.0%"]
    assert papers.split()[-3:] == ["99.5%", "94.8%", "94.6%"]
    assert len({len(line) for line in (title, agent, rule, papers)}) == 1
