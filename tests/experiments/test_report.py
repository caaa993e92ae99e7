from uavdh_lite.evaluation import Interval
from uavdh_lite.experiments.report import TABLE_METRICS, policies_table


def test_a_line_for_each_policy_and_the_papers_in_columns():
    metrics = dict.fromkeys(TABLE_METRICS, Interval(0.9, 0.81234, 1.0))
    metrics["time_used"] = Interval(0.5, 0.5, 0.5)  # all equal, such as a single one
    metrics["return"] = Interval(35.04, -1, 36)
    paper = {"landed": 0.995, "collected": 0.948, "collected_and_landed": 0.946}
    lines = policies_table({"agent": metrics, "a rule": metrics}, paper).splitlines()
    assert len(lines) == 4 and len({len(line) for line in lines}) == 1
    assert [line.split("  ")[0] for line in lines[1:3]] == ["agent", "a rule"]  # to the left
    cells = [" ".join(line.split()) for line in lines]
    assert cells[0] == "landed collected collected and landed return time used"
    share = "90.0 (81.2 to 100.0) %"
    assert cells[1] == f"agent {share} {share} {share} 35.0 (-1.0 to 36.0) 50.0 %"
    assert cells[3] == "the paper, on its own map 99.5 % 94.8 % 94.6 %"
