"""The tables of the site, each a function that returns Markdown: see `generated`.

They are made from the library itself and from the files in `data/`, so that no page can disagree
with them.
"""

import json
import os
import re
import subprocess
import sys
from collections.abc import Callable, Iterable
from dataclasses import fields
from pathlib import Path
from typing import Any

import numpy as np

from uavdh_lite.checkpoint import load_agent, shipped_agents
from uavdh_lite.city import City, shipped_cities
from uavdh_lite.evaluation import Interval, bootstrap_interval, mean_interval
from uavdh_lite.experiments.ablation import final_scores
from uavdh_lite.experiments.comparison import breakdown, share
from uavdh_lite.paper import RESULTS
from uavdh_lite.recipe import PAPER, RECIPES, Recipe
from uavdh_lite.scenario import SCENARIOS, Scenario
from uavdh_lite.storage import read_table

DATA = Path(__file__).parents[2] / "data"
SIGNS = {"ge": "≥", "gt": ">", "le": "≤"}
CRAL, RETURN = "collection_ratio_and_landed", "cumulative_reward"
POLICIES = {
    "agent": "**quantile agent**, beyond the paper",
    "ddqn": "**DDQN agent**, the paper's method",
    "random": "random",
    "greedy": "greedy: to the nearest device, home in time",
    "genie": "genie, plans for the return",
    "genie_data": "genie, plans for the data",
}
NAMED = {  # in comparisons of other agents than a city's first ones
    ("manhattan_turned", "agent"): "**`manhattan_turned`**, in eight views",
    ("manhattan_turned", "manhattan"): "`manhattan`",
    ("any_city", "agent"): "**any_city**, which saw none of these cities",
    **{
        (f"any_city-{city}", "agent"): "**any_city**, which never saw this city"
        for city in ("manhattan", "open_field", "village")
    },
    **{
        (f"any_city-{city}", city): f"`{city}`, which knows only this city"
        for city in ("manhattan", "open_field")
    },
}
NAMES = {
    "without_huber_loss": "Huber loss",
    "without_leaky_relus": "leaky ReLUs",
    "without_replay": "replay memory: 50,000 transitions, half of them random at first",
}
SHARES = ("has_landed", "collection_ratio", CRAL)
BEST_GENIE = {CRAL: "genie_data", RETURN: "genie"}


def _table(head: Iterable[str], rows: Iterable[Iterable[Any]]) -> str:
    head = list(head)
    lines = [head, ["---"] * len(head), *rows]
    return "\n".join(f"| {' | '.join(map(str, line))} |" for line in lines) + "\n"


def _percent(interval: Interval) -> str:
    mean, low, high = (f"{100 * value:.1f}".replace("100.0", "100") for value in interval)
    return _together(f"{mean} %", f"({low} to {high})")


def _number(interval: Interval) -> str:
    mean, low, high = (f"{value:.1f}".replace("-", "−") for value in interval)
    return _together(mean, f"({low} to {high})")


def _together(*parts: str) -> str:
    """Parts that a narrow table may put on lines of their own, but does not break."""
    return " ".join(part.replace(" ", "\u00a0") for part in parts)


def _minutes(seconds: float) -> str:
    return f"{seconds / 60:.1f}"


def bounds(limits: dict[str, float | None]) -> str:
    """As in `> 0, ≤ 1`."""
    return ", ".join(f"{SIGNS[k]} {v:g}" for k, v in limits.items() if v is not None)


# The command line


def _help(*command: str) -> str:
    """What `--help` prints, without colours, as wide as a page."""
    environment = {**os.environ, "COLUMNS": "97", "NO_COLOR": "1", "TERM": "dumb"}
    call = [sys.executable, "-m", "uavdh_lite", *command, "--help"]
    done = subprocess.run(call, capture_output=True, text=True, check=True, env=environment)
    return done.stdout


def commands_in(help_text: str) -> list[str]:
    """The commands that a help text lists."""
    _, found, listed = help_text.partition("─ Commands ─")
    return re.findall(r"^│ ([a-z]\w*) ", listed.partition("╰")[0], re.M) if found else []


def command_line(*parents: str) -> str:
    """A section for each command, and for the commands below it."""
    text = ""
    for name in commands_in(_help(*parents)):
        command = (*parents, name)
        shown = _help(*command)
        text += f"{'#' * (len(command) + 1)} {' '.join(command)}\n\n"
        text += f"```text\n{shown.rstrip()}\n```\n\n"
        if commands_in(shown):
            text += command_line(*command)
    return text


# Recipes, scenarios, cities, agents


def _value(value: Any) -> str:
    if isinstance(value, tuple):
        return ", ".join(map(str, value))
    if isinstance(value, bool) or value is None:
        return {True: "yes", False: "no", None: "none"}[value]
    return f"{value:,}" if isinstance(value, int) else str(value).replace("-", "−")


def recipes() -> str:
    """Every field of a recipe, and its value in each of them: bold where it is not the paper's."""
    rows = []
    for field in fields(Recipe):
        if "help" in field.metadata:
            paper = getattr(PAPER, field.name)
            values = [getattr(recipe, field.name) for recipe in RECIPES.values()]
            shown = [_value(v) if v == paper else f"**{_value(v)}**" for v in values]
            limits = bounds(field.metadata["bounds"])
            rows.append([f"`{field.name}`", *shown, field.metadata["help"], limits])
    return _table(["field", *(f"`{name}`" for name in RECIPES), "meaning", "bounds"], rows)


def scenarios() -> str:
    """The presets, with the ranges from which an episode is drawn."""
    options = [field for field in fields(Scenario) if "help" in field.metadata]
    rows = []
    for scenario in SCENARIOS.values():
        values = (getattr(scenario, field.name) for field in options)
        shown = ["{:g} to {:g}".format(*v) if isinstance(v, tuple) else f"`{v}`" for v in values]
        rows.append([f"`{scenario.name}`", *shown])
    names = [field.name.replace("_", " ") for field in options]
    return _table(["scenario", *names], rows)


def cities() -> str:
    """The shipped cities."""
    rows = []
    for city in sorted(map(City.load, shipped_cities()), key=lambda city: city.size):
        cells = (city.landing_cells, city.flight_cells, city.device_cells)
        rows.append([f"`{city.name}`", f"{city.size} × {city.size}", *map(len, cells)])
    head = ["city", "cells", "landing cells", "cells to fly over", "cells for devices"]
    return _table(head, rows)


def agents() -> str:
    """The shipped agents, from the headers of their files."""
    rows = []
    for name in shipped_agents():
        training = load_agent(name).training
        rows.append(
            [
                f"`{name}`",
                f"{training['steps']:,}",
                training["seed"],
                f"{training['validation'][CRAL]:.3f}",
                training.get("streams", 1),
                f"`{training['command'].partition(' --out')[0]}`",
            ]
        )
    head = ["agent", "steps", "seed", "CRAL in validation", "streams", "command"]
    return _table(head, rows)


# Results


def _comparison(scenario: str) -> tuple[dict[str, dict[str, np.ndarray]], dict]:
    table = read_table(DATA / "runs" / f"comparison-{scenario}.csv.gz")
    about = json.loads((DATA / "runs" / f"comparison-{scenario}.json").read_text())
    flown = {
        policy: {name: column[table["policy"] == policy] for name, column in table.items()}
        for policy in dict.fromkeys(table["policy"].tolist())
    }
    return flown, about


def _made_with(about: dict) -> str:
    """The command and versions of a result."""
    return (
        f"`{about['command'].replace('data/runs/', '')}`, seed {about.get('seed', 0)}, "
        f"streams version {about.get('streams', 1)}, Python {about['python']}, "
        f"torch {about['torch']}, numpy {about['numpy']}, {about['machine']}"
    )


def evaluations(*agents: str) -> str:
    """Shipped agents on other draws of 1000 missions, a row for each agent and seed."""
    rows = []
    for agent in agents:
        paths = (DATA / "runs" / "evaluations").glob(f"{agent}-[0-9]*.json")
        for path in sorted(paths, key=lambda path: int(path.stem.rpartition("-")[2])):
            metrics = {k: Interval(**v) for k, v in json.loads(path.read_text()).items()}
            shown = [_percent(metrics[name]) for name in ("has_landed", CRAL, "time_used")]
            seed = path.stem.rpartition("-")[2]
            rows.append([f"`{agent}`", seed, *shown, _number(metrics[RETURN])])
    head = ["agent", "seed", "landed", "collected and landed", "flying time used", "return"]
    made = "`python -m uavdh_lite evaluate --checkpoint AGENT --seed SEED --json FILE`"
    return f"{_table(head, rows)}\nMade with {made}, streams version 2.\n"


def comparison(scenario: str) -> str:
    """The shipped agents, the planners and, where it has one, the paper's agent."""
    flown, about = _comparison(scenario)
    rows = []
    for policy, columns in flown.items():
        shares = [mean_interval(columns[metric]) for metric in SHARES]
        total = _number(mean_interval(columns[RETURN]))
        time = _percent(mean_interval(columns["time_used"]))
        name = NAMED.get((scenario, policy)) or POLICIES[policy.removeprefix(f"{scenario}_")]
        rows.append([name, *map(_percent, shares), total, time])
    if scenario in RESULTS:
        paper = [f"{100 * value:g} %" for value in RESULTS[scenario].values()]
        rows.append(["paper's agent, on its own map", *paper, "", ""])
    head = ["", "landed", "collected", "collected and landed", "return", "time used"]
    return f"{_table(head, rows)}\nMade with {_made_with(about)}.\n"


def _agents(scenario: str, flown: dict) -> dict[str, str]:
    """The shipped agents of a comparison: what tables call them, and their names there."""
    if scenario.startswith("any_city"):
        return {"`any_city`": "agent"}
    if scenario == "manhattan_turned":
        return {"`manhattan_turned`": "agent", "`manhattan`": "manhattan"}
    names = {"quantile agent": "agent", "DDQN agent": f"{scenario}_ddqn"}
    return {label: name for label, name in names.items() if name in flown}


def lead(scenario: str) -> str:
    """The agents against greedy and genie on the same missions, in pairs."""
    flown, _ = _comparison(scenario)
    rows = []
    for label, policy in _agents(scenario, flown).items():
        for metric, name, factor in (
            (CRAL, "collected and landed, points", 100),
            (RETURN, "return, data units", 1),
        ):
            mine = flown[policy][metric]
            cities = flown[policy].get("city")
            difference = bootstrap_interval(
                factor * (mine - flown["greedy"][metric]), groups=cities
            )
            part = share(mine, flown[BEST_GENIE[metric]][metric], cities)
            rows.append([label, name, _number(difference), _percent(part)])
    return _table(["", "", "minus greedy", "as a share of the best genie"], rows)


def by_flying_time(scenario: str) -> str:
    """Collected and landed of agents, greedy and genie by the flying time that was drawn."""
    return _by(scenario, "flying time", lambda columns: columns["flying_time"])


def by_devices(scenario: str) -> str:
    """The same by the number of devices."""
    return _by(scenario, "devices", lambda columns: columns["devices"])


def by_kind(scenario: str) -> str:
    """The same by the kind of random city."""
    return _by(scenario, "kind of city", lambda columns: kind_of(columns["city"]))


def kind_of(city: np.ndarray) -> np.ndarray:
    """The kinds of random cities, (N,), from their names."""
    return np.array([name.rsplit("_", 2)[0] for name in city.tolist()])


def _by(scenario: str, title: str, by: Callable[[dict[str, np.ndarray]], np.ndarray]) -> str:
    flown, _ = _comparison(scenario)
    shown = _agents(scenario, flown) | {"greedy": "greedy", "genie, for the data": "genie_data"}
    parts = [breakdown(flown[p][CRAL], by(flown[p])) for p in shown.values()]
    rows = [
        [label, count, *(_percent(part[2]) for part in group)]
        for group in zip(*parts, strict=True)
        for label, count, _ in group[:1]
    ]
    return _table([title, "missions", *shown], rows)


def _runs(study: str) -> dict[str, dict]:
    return json.loads((DATA / "runs" / study / "about.json").read_text())["runs"]


def _streams(runs: dict[str, dict]) -> str:
    return ", ".join(map(str, sorted({run.get("streams", 1) for run in runs.values()})))


def centring() -> str:
    """Each run of the centring study: steps to thresholds, and the end, in validation."""
    table = read_table(DATA / "runs" / "centring-manhattan" / "validation.csv.gz")
    runs = _runs("centring-manhattan")
    rows = []
    for variant in dict.fromkeys(table["variant"].tolist()):
        for seed in np.unique(table["seed"][table["variant"] == variant]):
            run = (table["variant"] == variant) & (table["seed"] == seed)
            steps, values = table["steps"][run], table[CRAL][run]
            first = [steps[values >= t][0] if (values >= t).any() else None for t in (0.8, 0.9)]
            reached = ["" if step is None else f"{int(step):,}" for step in first]
            seconds = runs[f"{variant}-{int(seed)}"]["seconds"]
            name = variant.replace("_", "-")
            rows.append([name, int(seed), *reached, f"{values[-1]:.3f}", _minutes(seconds)])
    head = ["map", "seed", "steps to 0.8", "steps to 0.9", "CRAL at the end", "minutes"]
    return f"{_table(head, rows)}\nStreams version {_streams(runs)}.\n"


def deviations() -> str:
    """What undoing each deviation of `lite` does to short runs on `manhattan`."""
    folder = DATA / "runs" / "deviations-manhattan"
    scores = final_scores(folder / "validation.csv.gz")
    table = read_table(folder / "validation.csv.gz")
    last = table["steps"] == table["steps"].max()
    lite = np.mean(scores.pop("all"))
    rows = []
    for variant, values in sorted(scores.items(), key=lambda item: np.mean(item[1])):
        landed = table["has_landed"][last & (table["variant"] == variant)]
        change = f"{np.mean(values) - lite:+.3f}".replace("-", "−")
        name = NAMES.get(variant, variant.removeprefix("without_").replace("_", " "))
        seeds = (f"{value:.3f}" for value in values)
        rows.append([name, *seeds, change, f"{landed.min():.3f} to {landed.max():.3f}"])
    landed = table["has_landed"][last & (table["variant"] == "all")]
    seeds = [f"{value:.3f}" for value in final_scores(folder / "validation.csv.gz")["all"]]
    rows.insert(0, ["nothing: `lite`", *seeds, "", f"{landed.min():.3f} to {landed.max():.3f}"])
    head = ["the paper's value for", "seed 0", "seed 1", "seed 2", "change of CRAL", "landed"]
    return f"{_table(head, rows)}\nStreams version {_streams(_runs('deviations-manhattan'))}.\n"


def parts() -> str:
    """What each idea of `quantile` is worth in short runs on `manhattan`: the recipe without it."""
    table = read_table(DATA / "runs" / "parts-manhattan" / "validation.csv.gz")
    last = table["steps"] == table["steps"].max()
    names = {"all": "all: `quantile`", "none": "none: `lite`"}
    rows, best = [], None
    for variant in dict.fromkeys(table["variant"].tolist()):
        end = {name: values[last & (table["variant"] == variant)] for name, values in table.items()}
        score = end[CRAL].mean()
        best = score if best is None else best
        change = "" if variant == "all" else f"{score - best:+.3f}".replace("-", "−")
        others = [f"{end[name].mean():.2f}" for name in ("cumulative_reward", "time_used")]
        rows.append(
            [
                names.get(variant, variant.replace("_", " ")),
                *(f"{value:.3f}" for value in end[CRAL]),
                change,
                f"{end['has_landed'].min():.3f}",
                *(number.replace("-", "−") for number in others),
            ]
        )
    head = ["parts", "CRAL, seed 0", "seed 1", "seed 2", "change", "landed, least"]
    text = _table([*head, "return, mean", "time used, mean"], rows)
    return f"{text}\nStreams version {_streams(_runs('parts-manhattan'))}.\n"


VALUES_STEPS = (30_000, 100_000)
MEANS = {CRAL: 3, "cumulative_reward": 2}  # with so many digits


def values() -> str:
    """Other values of `quantile`, one at a time, in short runs of two lengths on `manhattan`."""
    names = {"as_it_is": "none"}
    rows: dict[str, list[str]] = {}
    for steps in VALUES_STEPS:
        table = read_table(DATA / "runs" / f"values-manhattan-{steps}" / "validation.csv.gz")
        usual = {name: table[name][table["variant"] == "as_it_is"].mean() for name in MEANS}
        for variant in dict.fromkeys(table["variant"].tolist()):
            end = {name: table[name][table["variant"] == variant] for name in MEANS}
            row = rows.setdefault(variant, [names.get(variant, variant.replace("_", " "))])
            row.append(_together(*(f"{value:.3f}" for value in end[CRAL])))
            for name, digits in MEANS.items():
                change = f"{end[name].mean() - usual[name]:+.{digits}f}".replace("-", "−")
                row.append("" if variant == "as_it_is" else change)
    head = ["another value"]
    for steps in VALUES_STEPS:
        head += [f"{steps:,} steps: CRAL of three seeds", "change", "change of the return"]
    text = _table(head, rows.values())
    return f"{text}\nStreams version {_streams(_runs(f'values-manhattan-{VALUES_STEPS[0]}'))}.\n"


def five_minutes() -> str:
    """The recipe and others in runs of five minutes on one core, as fast as each is."""
    table = read_table(DATA / "runs" / "in_minutes-manhattan" / "validation.csv.gz")
    rows = []
    for variant, name in {
        "210000_steps": "`quantile`: an update with 128 transitions for every 32 steps",
        "64_environments": "128 transitions for every 64 steps",
        "minibatch_64": "64 transitions for every 16 steps",
    }.items():
        ends = table["variant"] == variant
        steps = table["steps"][ends].max()
        ends &= table["steps"] == steps
        rows.append(
            [
                name,
                f"{1000 * round(steps / 1000):,}",
                _together(*(f"{value:.3f}" for value in table[CRAL][ends])),
                _together(*(f"{value:.2f}" for value in table[RETURN][ends])),
            ]
        )
    head = ["", "steps", "CRAL, three seeds", "return, three seeds"]
    return f"{_table(head, rows)}\nStreams version {_streams(_runs('in_minutes-manhattan'))}.\n"


def _unseen(**wanted: object) -> list[str]:
    """The CRAL of each seed among the runs of `unseen_cities` for which all of this holds."""
    table = read_table(DATA / "runs" / "unseen_cities.csv.gz")
    rows = np.all([table[name] == value for name, value in wanted.items()], axis=0)
    return [f"{value:.3f}" for value in table[CRAL][rows]]


SEEDS = ["seed 0", "seed 1", "seed 2"]


def frames() -> str:
    """Agents that see 2000 cities in different frames, over cities that none of them has seen."""
    rows = []
    for observation in ("centred", "non_centred", "global_local"):
        for views in (1, 8):
            runs = {"observation": observation, "learned_in": "random:2000:0", "views": views}
            rows.append([f"`{observation}`", views, *_unseen(**runs, flown_over="random:300:9")])
    return _table(["the network sees", "views", *SEEDS], rows)


def cities_to_learn_in() -> str:
    """Agents that learned in more and more cities, over those and over others."""
    rows = []
    for count in (1, 10, 100, 2000):
        runs = {"observation": "global_local", "learned_in": f"random:{count}:0"}
        seen = _unseen(**runs, views=1, flown_over=f"random:{count}:0")
        for views in (1, 8):
            unseen = _unseen(**runs, views=views, flown_over="random:300:9")
            rows.append([count, views, *unseen, *(seen if views == 1 else [""] * 3)])
    head = [*SEEDS, *(f"seen, {seed}" for seed in SEEDS)]
    return _table(["cities", "views", *head], rows)


def recorded_runs() -> str:
    """Every training whose curves are in `data/runs`."""
    rows = []
    for path in sorted((DATA / "runs").glob("*/about.json")):
        about = json.loads(path.read_text())
        for name, run in about.get("runs", {path.parent.name: about}).items():
            if path.parent.name.startswith(("deviations-", "parts-", "values-")):
                continue  # in tables of their own
            rows.append(
                [
                    f"`{path.parent.name}`",
                    name.replace("_", "-"),
                    run["seed"],
                    f"{run['steps']:,}",
                    run["threads"],
                    _minutes(run["seconds"]),
                    f"{run['validation'][CRAL]:.3f}",
                    run.get("streams", 1),
                ]
            )
    head = ["folder in `data/runs`", "run", "seed", "steps", "threads", "minutes"]
    return _table([*head, "CRAL in the last validation", "streams"], rows)


def sb3() -> str:
    """DQN and PPO of Stable-Baselines3 next to our DDQN in the village."""
    table = read_table(DATA / "runs" / "sb3-village.csv.gz")
    about = json.loads((DATA / "runs" / "sb3-village.json").read_text())
    last = table["steps"] == table["steps"].max()
    rows = []
    for algorithm in dict.fromkeys(table["algorithm"].tolist()):
        of = last & (table["algorithm"] == algorithm)
        values = ", ".join(f"{value:.3f}" for value in table[CRAL][of])
        landed = ", ".join(f"{value:.3f}" for value in table["has_landed"][of])
        seconds = ", ".join(f"{value:.0f}" for value in table["seconds"][of])
        rows.append([algorithm, values, landed, seconds])
    head = ["algorithm", "CRAL, by seed", "landed, by seed", "seconds, by seed"]
    made = f"`{about['command']}`, streams version {about.get('streams', 1)}"
    return f"{_table(head, rows)}\nMade with {made}, {about['machine']}.\n"


def practice(scenario: str) -> str:
    """The leaderboard of a practice set of the challenge."""
    board = json.loads((DATA / "challenge" / f"practice-{scenario}.json").read_text())
    scores = sorted(board["scores"].values(), key=lambda score: -score["cral"][0])
    rows = []
    for score in scores:
        intervals = (Interval(*score[name]) for name in ("cral", "has_landed"))
        total = _number(Interval(*score[RETURN]))
        rows.append([f"`{score['name']}`", *map(_percent, intervals), total])
    return _table(["", "collected and landed", "landed", "return"], rows)
