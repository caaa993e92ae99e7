from uavdh_lite.evaluation import Interval
from uavdh_lite.experiments.report import interval_text, metrics_table, paper_table

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


def test_what_the_paper_gives_and_the_time_used():
    title, landed, time = paper_table(METRICS, {"has_landed": 0.995}).splitlines()
    assert title.split()[-1] == "paper"
    assert landed.split() == ["has", "landed", "99.0%", "98.1%", "to", "100.0%", "99.5%"]
    assert time.split() == ["flying", "time", "used", "70.0%"]
