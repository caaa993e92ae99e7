"""The README is short, its pictures are light, and its chart shows what was recorded."""

import re
import sys
from pathlib import Path

import numpy as np
import pytest

from uavdh_lite.storage import read_table

ROOT = Path(__file__).parents[2]
README = (ROOT / "README.md").read_text(encoding="utf-8")
sys.path.insert(0, str(ROOT / "docs" / "_extensions"))
charts = pytest.importorskip("charts")


def test_it_is_short_and_its_pictures_are_light():
    assert len(README.split()) <= 700
    pictures = re.findall(r"!\[[^\]]+\]\(([^)]+)\)|<img src=\"([^\"]+)\"", README)
    pictures = ["".join(names) for names in pictures]
    assert len(pictures) > 2
    assert all((ROOT / picture).stat().st_size < 1_000_000 for picture in pictures)


def test_its_chart_shows_the_numbers_of_the_ladder():
    table, expected = read_table(ROOT / "data/runs/ladder.csv.gz"), []
    for scenario in charts.MAPS:
        for pilot in charts.FEW:
            row = np.flatnonzero((table["scenario"] == scenario) & (table["row"] == pilot))
            if row.size and pilot != "greedy":
                expected.append(charts.number(table["return_ahead"][row[0]]))
    picture = (charts.OUT / "ladder_small.svg").read_text(encoding="utf-8")
    texts = re.findall(r"<text[^>]*>([^<]*)</text>", picture)
    assert [text.removeprefix("◀ ") for text in texts if "." in text] == expected


@pytest.mark.parametrize("name", charts.CHARTS)
def test_charts_are_of_what_is_recorded(name):
    """Otherwise: python benchmarks/figures.py NAME."""
    picture = (charts.OUT / f"{name}.svg").read_text(encoding="utf-8")
    assert charts.source_of(name) in picture
