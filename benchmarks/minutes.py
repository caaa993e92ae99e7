"""How much each recipe collects after how many minutes on one core: data/figures/minutes.png.

    python benchmarks/minutes.py

Each point is the end of a recorded run over `manhattan` that was made for this length. The speed
of both recipes is measured here, in turns, for a minute each; the minutes of a run are its steps
by that speed, without validations.
"""

from pathlib import Path

import numpy as np
import torch
from matplotlib.figure import Figure
from training import in_turns, ready

from uavdh_lite.city import load_city
from uavdh_lite.environment import Environment
from uavdh_lite.evaluation import evaluate
from uavdh_lite.experiments.runs import keep_freed_memory
from uavdh_lite.planners import Greedy
from uavdh_lite.plotting import BLUE, VERMILION
from uavdh_lite.scenario import find_scenario
from uavdh_lite.storage import read_table, write_atomically
from uavdh_lite.streams import Use

DATA = Path(__file__).parents[1] / "data"
METRIC = "collected_and_landed"
RECORDED = {  # by recipe: studies, and the variant that is the recipe as it is
    "quantile": [
        ("values-manhattan-30000", "8_quantiles"),
        ("values-manhattan-100000", "8_quantiles"),
        ("lengths-manhattan", "210000_steps"),
        ("lengths-manhattan", "850000_steps"),
    ],
    "lite": [
        ("parts-manhattan", "none"),
        ("deviations-manhattan", "all"),
        ("recipes-manhattan", "lite"),
    ],
}


def ends(study: str, variant: str) -> tuple[float, np.ndarray]:
    """The steps of a variant's runs, and the metric in the last validation of each."""
    table = read_table(DATA / "runs" / f"{study}.csv.gz")
    own = table["variant"] == variant
    steps = table["steps"][own].max()
    return steps, table[METRIC][own & (table["steps"] == steps)]


def greedy_score() -> float:
    """Greedy in the missions of the validations."""
    environment, scenario = Environment(load_city("manhattan")), find_scenario("manhattan")
    flights = evaluate(environment, Greedy(environment), scenario, 1000, 0, Use.VALIDATION)
    return float(flights.records()[METRIC].mean())


if __name__ == "__main__":
    torch.set_num_threads(1)
    keep_freed_memory()  # as `train` does
    trainers = {name: ready("manhattan", name) for name in RECORDED}
    updates = in_turns({name: one.step for name, one in trainers.items()}, seconds=60)
    figure = Figure(figsize=(7, 3.6), layout="constrained")
    ax = figure.subplots()
    for name, style in {"quantile": {"color": BLUE}, "lite": {"color": VERMILION}}.items():
        a_minute = 60 * updates[name] * trainers[name].recipe.environments
        steps, scores = zip(*(ends(*one) for one in RECORDED[name]), strict=True)
        minutes = np.array(steps) / a_minute
        ax.plot(minutes, np.mean(scores, axis=1), **style, label=f"recipe {name}")
        ax.plot(minutes, scores, "o", **style, markersize=5, alpha=0.7)
        for one in zip(steps, minutes.round(1), np.round(scores, 3), strict=True):
            print(name, "steps {:,.0f}, minutes {}, seeds {}".format(*one))
    greedy = greedy_score()
    print(f"greedy {greedy:.3f}")
    ax.axhline(greedy, color="grey", ls="--", lw=1, label="greedy rule")
    ax.set(xscale="log", xlabel="minutes on one core", ylabel="collected and landed")
    ax.xaxis.set_major_formatter("{x:g}")
    ax.set_ylim(0.15, 1)
    ax.legend(loc="lower right")
    out = DATA / "figures" / "minutes.png"
    write_atomically(out, lambda path: figure.savefig(path, format="png", dpi=150))
