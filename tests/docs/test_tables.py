"""The tables of the results."""

import re
import sys
from pathlib import Path

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).parents[2] / "docs" / "_extensions"))
tables = pytest.importorskip("tables")


@pytest.mark.parametrize("table", ["comparison", "lead", "by_kind"])
def test_intervals_over_several_cities_are_those_of_whole_cities(monkeypatch, table):
    """The agent brings 1 in every second of eight cities and 0 in the others, whatever flies."""
    of_cities = np.arange(8).repeat(125)
    columns = {
        "city": np.array([f"town_{number}_a" for number in of_cities]),
    }
    values = {"agent": of_cities % 2.0, "greedy": 0.0 * of_cities, "genie_data": of_cities**0.0}
    values["genie"] = values["genie_data"]
    metrics = (*tables.SHARES, "time_used", "return")
    flown = {name: columns | dict.fromkeys(metrics, one) for name, one in values.items()}
    monkeypatch.setattr(tables, "flown_by", lambda scenario: flown)
    monkeypatch.setattr(tables, "_made_with", lambda name: "")
    shown = getattr(tables, table)("any").replace("\xa0", " ")
    intervals = re.findall(r"50\.0 (?:% )?\(([^)]+)\)", shown)
    assert intervals and set(intervals) == {"5.3 to 94.7"}  # by Student's t


def test_a_page_with_nothing_outstanding_must_not_say_so(monkeypatch, tmp_path):
    study = '[studies.old]\nwhat = "w"\ncore_hours = 2'
    (tmp_path / "list.toml").write_text(f'{study}\noutstanding = "late"')
    monkeypatch.setattr(tables, "RUNS", tmp_path)
    assert "`old`" in tables.outstanding()
    (tmp_path / "list.toml").write_text(study)
    with pytest.raises(ValueError, match="nothing is outstanding"):
        tables.outstanding()


def test_a_share_pairs_the_episodes(generator):
    reference = generator.uniform(1, 100, 200)
    for groups in (None, np.arange(200) // 9):  # unpaired, it would be some 0.9 ± 0.1
        exact = tables.share(0.9 * reference, reference, groups)
        assert exact == pytest.approx((0.9, 0.9, 0.9))
    values = 0.9 * reference + generator.normal(0, 5, 200)
    noisy = tables.share(values, reference)
    assert noisy.low < noisy.mean < noisy.high
    assert noisy.mean == pytest.approx(values.sum() / reference.sum())
