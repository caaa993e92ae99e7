"""The tables of the site, each a function that returns Markdown: see `generated`.

They are made from the library itself and from the files in `data/`, so that no page can disagree
with them.
"""

import io
import json
import os
import re
import tomllib
from collections import Counter
from collections.abc import Callable, Iterable
from contextlib import redirect_stdout
from dataclasses import fields
from pathlib import Path
from typing import Any
from unittest.mock import patch

import numpy as np

from uavdh_lite import registry
from uavdh_lite.beyond.measured import (
    distances_m,
    links,
    load_place,
    modelled_snr_db,
    shipped_places,
)
from uavdh_lite.beyond.recipes import BeyondRecipe
from uavdh_lite.channel import rate
from uavdh_lite.checkpoint import load_agent, shipped_agents
from uavdh_lite.city import load_city, shipped_cities
from uavdh_lite.cli.main import main
from uavdh_lite.course.checks import EXERCISES
from uavdh_lite.course.exam import questions
from uavdh_lite.evaluation import Interval, bootstrap_interval, mean_interval, paired_interval
from uavdh_lite.experiments.comparison import breakdown
from uavdh_lite.missions import Mission
from uavdh_lite.paper import RESULTS
from uavdh_lite.player import play
from uavdh_lite.policies import find_policy
from uavdh_lite.scenario import Scenario
from uavdh_lite.storage import read_table

ROOT = Path(__file__).parents[2]
DATA = ROOT / "data"
RUNS = DATA / "runs"
TEACH = Path(__file__).parents[1] / "teach"
NOTEBOOKS = ROOT / "notebooks"
SIGNS = {"ge": "≥", "gt": ">", "le": "≤"}
BOTH = "collected_and_landed"
SHARES = ("landed", "collected", BOTH)
PLANNERS = {
    "random": "random",
    "greedy": "greedy: flies to the nearest device, and home in time",
    "genie": "genie that plans for the return",
    "genie_data": "genie that plans for the data",
}
BEST_GENIE = {BOTH: "genie_data", "return": "genie"}
CLAIMS = (  # what the paper says, what was found, a verdict, a page; those without numbers
    (
        "Section IV: one agent flies missions that differ in devices, positions, data and time",
        "each agent of the ladder is trained once and flies 3000 missions that were drawn anew",
        "holds",
        "[ladder](ladder.md)",
    ),
    (
        "Trajectories, open field: with a quarter of the data at the far device, the same agent "
        "stays nearer",
        "so does `open_field_ddqn` in the mission shown; how often was not counted",
        "holds there",
        "[figure](figures.md#the-open-field-one-thing-changed)",
    ),
    (
        "Trajectories: the agent flies into the courtyard where the data is worth it",
        "in the mission shown, with 20 units there, the agents of two seeds do, and that of the "
        "third waits before the gateway; with 5 units, no agent flies in",
        "partly",
        "[figure](figures.md#the-courtyard)",
    ),
    (
        "Trajectories, Manhattan: two to five devices with one agent",
        "a flight for each number, picked by stated conditions",
        "holds there",
        "[figure](figures.md#manhattan-with-two-to-five-devices)",
    ),
    (
        "Section III-B: combined experience replay helps with a large memory",
        "the paper cites this and shows no run without it; nor do we",
        "not shown",
        "notebook 11",
    ),
    (
        "no claim of the paper: how good is that beside a simple rule?",
        "greedy, which needs no training, has a return 4 to 5 units higher than `plain`, and one "
        "within a unit of that of the strengthened DDQN",
        "",
        "[ladder](ladder.md)",
    ),
)
PARTS_OF_RUN = (0.075, 0.25, 0.5, 0.75, 1)
LADDER = {
    "random": PLANNERS["random"],
    "greedy": PLANNERS["greedy"],
    "orienteering": "orienteering: the best order of devices",
    "plain": "the paper's algorithm with nothing added: best agents, at step {steps} on average",
    "ddqn": "strengthened DDQN, `lite`",
    "ddqn_failsafe": "DDQN with the failsafe",
    "ddqn_told": "DDQN with the failsafe and told layers",
    "any_city": "`any_city`: imitation and reward in 3000 other cities",
    "copy": "imitation of the teacher",
    "imitation": "imitation, then reward",
    "teacher": "the teacher: a genie with a narrow search",
    "teacher_again": "the teacher, on the 200 missions of the following two",
    "genie_data": PLANNERS["genie_data"],
    "genie": PLANNERS["genie"],
}
KNOWLEDGE = {
    "map": "map",
    "mean_rates": "rates without fading",
    "failsafe": "failsafe",
    "moves": "a planner's moves",
    "reward": "reward",
}


def _table(head: Iterable[str], rows: Iterable[Iterable[Any]]) -> str:
    head = list(head)
    lines = [head, ["---"] * len(head), *rows]
    return "\n".join(f"| {' | '.join(map(str, line))} |" for line in lines) + "\n"


def _percent(interval: Interval) -> str:
    mean, low, high = (f"{100 * value:.1f}".replace("100.0", "100") for value in interval)
    return _together(f"{mean} %", f"({low} to {high})")


def _number(interval: Interval, digits: int = 1) -> str:
    mean, low, high = (f"{value:.{digits}f}".replace("-", "−") for value in interval)
    return _together(mean, f"({low} to {high})")


def _numbers(values: Iterable[float], digits: int) -> str:
    return _together(*(f"{value:.{digits}f}".replace("-", "−") for value in values))


def _together(*parts: str) -> str:
    """Parts that a narrow table may put on lines of their own, but does not break."""
    return " ".join(part.replace(" ", "\u00a0") for part in parts)


def bounds(limits: dict[str, float | None]) -> str:
    """As in `> 0, ≤ 1`."""
    return ", ".join(f"{SIGNS[k]} {v:g}" for k, v in limits.items() if v is not None)


# The command line


def _help(*command: str) -> str:
    """What `--help` prints, without colours, as wide as a page."""
    width = patch.dict(os.environ, COLUMNS="97", NO_COLOR="1", TERM="dumb")
    with width, redirect_stdout(io.StringIO()) as printed:
        main([*command, "--help"])
    return printed.getvalue()


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
    paper, names = BeyondRecipe("paper"), registry.names("recipe")
    rows = []
    for field in fields(BeyondRecipe):
        if "help" in field.metadata:
            usual = getattr(paper, field.name)
            values = [getattr(registry.find("recipe", n), field.name, usual) for n in names]
            shown = [_value(v) if v == usual else f"**{_value(v)}**" for v in values]
            limits = bounds(field.metadata["bounds"])
            rows.append([f"`{field.name}`", *shown, field.metadata["help"], limits])
    return _table(["field", *(f"`{name}`" for name in names), "meaning", "bounds"], rows)


def scenarios() -> str:
    """The presets, with the ranges from which an episode is drawn."""
    options = [field for field in fields(Scenario) if "help" in field.metadata]
    rows = []
    for name in registry.names("scenario"):
        values = (getattr(registry.find("scenario", name), field.name) for field in options)
        shown = ["{:g} to {:g}".format(*v) if isinstance(v, tuple) else f"`{v}`" for v in values]
        rows.append([f"`{name}`", *shown])
    names = [field.name.replace("_", " ") for field in options]
    return _table(["scenario", *names], rows)


def cities() -> str:
    """The shipped cities."""
    rows = []
    for city in sorted(map(load_city, shipped_cities()), key=lambda city: city.size):
        cells = (city.landing, ~city.no_fly, city.open_to_devices)
        counts = (np.count_nonzero(layer) for layer in cells)
        rows.append([f"`{city.name}`", f"{city.size} × {city.size}", *counts])
    head = ["city", "cells", "landing cells", "cells to fly over", "cells for devices"]
    return _table(head, rows)


def agents() -> str:
    """The shipped agents: what they say of themselves, and the commands that made them."""
    rows = []
    for name in shipped_agents():
        training = load_agent(name).training
        score = f"{training['validation'][BOTH]:.3f}"
        steps, command = f"{training['steps']:,}", f"`{training['command']}`"
        rows.append([f"`{name}`", steps, training["seed"], score, command])
    head = ["agent", "steps", "seed", "collected and landed in validation", "command"]
    return _table(head, rows)


# Comparisons


def _made_with(name: str) -> str:
    """A line with the command and the versions of a result."""
    about = _json(name)
    versions = (f"{what} {about[what]}" for what in ("torch", "numpy"))
    return (
        f"Made with `{about['command']}`, uavdh_lite {about['version']}, "
        f"Python {about['python']}, {', '.join(versions)}, {about['machine']}.\n"
    )


def _json(name: str) -> dict:
    return json.loads((RUNS / f"{name}.json").read_text())


def _parts(table: dict[str, np.ndarray], column: str) -> dict[str, dict[str, np.ndarray]]:
    """The rows of a table by the value in one column, in the order of the file."""
    return {
        name: {key: values[table[column] == name] for key, values in table.items()}
        for name in dict.fromkeys(table[column].tolist())
    }


def flown_by(scenario: str) -> dict[str, dict[str, np.ndarray]]:
    """The columns of each policy of a comparison; agents have the names that they are shipped by.

    The first part of the comparison's name is that of its agent.
    """
    parts = _parts(read_table(RUNS / f"comparison-{scenario}.csv.gz"), "policy")
    agent = scenario.partition("-")[0]
    return {agent if policy == "agent" else policy: one for policy, one in parts.items()}


def comparison(scenario: str) -> str:
    """The shipped agents, the planners and, where it has one, the paper's agent."""
    rows = []
    for policy, columns in flown_by(scenario).items():
        cities = columns.get("city")
        shares = [mean_interval(columns[metric], cities) for metric in (*SHARES, "time_used")]
        *landed_and_collected, time = map(_percent, shares)
        name = PLANNERS.get(policy, f"**`{policy}`**")
        total = _number(mean_interval(columns["return"], cities))
        rows.append([name, *landed_and_collected, total, time])
    if scenario in RESULTS:
        paper = [f"{100 * RESULTS[scenario][metric]:g} %" for metric in SHARES]
        rows.append(["paper's agent, on its own map", *paper, "", ""])
    head = ["policy", "landed", "collected", "collected and landed", "return", "time used"]
    return f"{_table(head, rows)}\n{_made_with(f'comparison-{scenario}')}"


def lead(scenario: str) -> str:
    """The agents against greedy and genie on the same missions, in pairs."""
    flown = flown_by(scenario)
    rows = []
    for name, mine in flown.items():
        if name in PLANNERS:
            continue
        for metric, label, factor in (
            (BOTH, "collected and landed, percentage points", 100),
            ("return", "return, data units", 1),
        ):
            cities = mine.get("city")
            ahead = factor * (mine[metric] - flown["greedy"][metric])
            part = share(mine[metric], flown[BEST_GENIE[metric]][metric], cities)
            difference = _number(paired_interval(ahead, cities))
            rows.append([f"`{name}`", label, difference, _percent(part)])
    return _table(["agent", "metric", "minus greedy's", "as a share of the better genie's"], rows)


def share(values: np.ndarray, reference: np.ndarray, groups: np.ndarray | None = None) -> Interval:
    """The mean of `values` as a share of that of `reference`, over the same N episodes.

    The 95 % interval keeps the two values of an episode together, and those of a group, such as
    the missions of one city; it is that of the ratio's linear part (the delta method).
    """
    ratio = values.mean() / reference.mean()
    return paired_interval(ratio + (values - ratio * reference) / reference.mean(), groups)


def by_flying_time(scenario: str) -> str:
    """Collected and landed of agents, greedy and genie by the flying time that was drawn."""
    return _by(scenario, "flying time", lambda columns: columns["flying_time"])


def by_kind(scenario: str) -> str:
    """The same by the kind of random city."""
    return _by(scenario, "kind of city", lambda columns: kind_of(columns["city"]))


def kind_of(city: np.ndarray) -> np.ndarray:
    """The kinds of random cities, (N,), from their names."""
    return np.array([name.rsplit("_", 2)[0].replace("_", " ") for name in city.tolist()])


def _by(scenario: str, title: str, by: Callable[[dict[str, np.ndarray]], np.ndarray]) -> str:
    flown = {k: v for k, v in flown_by(scenario).items() if k not in ("random", "genie")}
    parts = [
        breakdown(columns[BOTH], by(columns), columns.get("city")) for columns in flown.values()
    ]
    rows = [
        [label, count, *(_percent(part[2]) for part in group)]
        for group in zip(*parts, strict=True)
        for label, count, _ in group[:1]
    ]
    return _table([title, "missions", *(f"`{name}`" for name in flown)], rows)


# Studies


def runs_of(study: str) -> dict[str, list[dict[str, np.ndarray]]]:
    """The validations of each variant: the columns of each seed's run."""
    variants = _parts(read_table(RUNS / f"{study}.csv.gz"), "variant")
    return {name: [*_parts(one, "seed").values()] for name, one in variants.items()}


def ends_of(study: str) -> dict[str, dict[str, np.ndarray]]:
    """The last validation of each variant: the columns, with a value for each seed."""
    return {
        variant: {key: np.array([run[key][-1] for run in runs]) for key in runs[0]}
        for variant, runs in runs_of(study).items()
    }


def study(name: str) -> str:
    """The last validation of each run, by variant: the changes are those to the first variant."""
    ends = ends_of(name)
    first, rows = next(iter(ends)), {}
    for variant, end in ends.items():
        landed = sorted(f"{value:.3f}" for value in end["landed"])
        changes = {
            metric: "" if variant == first else _change(end[metric], ends[first][metric], digits)
            for metric, digits in ((BOTH, 3), ("return", 2))
        }
        rows[variant] = [
            variant.replace("_", " "),
            f"{1000 * round(end['steps'].max() / 1000):,}",
            _numbers(end[BOTH], 3),
            changes[BOTH],
            " to ".join(dict.fromkeys((landed[0], landed[-1]))),
            _numbers(end["return"], 2),
            changes["return"],
            f"{end['time_used'].mean():.2f}",
        ]
    others = sorted(ends.keys() - {first}, key=lambda variant: ends[variant][BOTH].mean())
    head = ["variant", "steps", "collected and landed, by seed", "change of the mean", "landed"]
    head += ["return, by seed", "change of the mean", "time used"]
    return _table(head, (rows[variant] for variant in (first, *others)))


def parts() -> str:
    """What each part was worth of the recipe that `lite` was chosen from, and `lite`, by arm."""
    ends = ends_of("pilots-manhattan") | ends_of("short-manhattan")
    names = [name.removeprefix("centred_") for name in ends if name.startswith("centred_")]
    first, rows = names[0], {}
    for name in names:
        row = [name.replace("_", " ")]
        for arm in ("centred", "in_place"):
            if f"{arm}_{name}" not in ends:
                row += [""] * 3
                continue
            own, usual = ends[f"{arm}_{name}"], ends[f"{arm}_{first}"]
            change = "" if name == first else _change(own[BOTH], usual[BOTH], 3)
            row += [_numbers(own[BOTH], 3), change, _numbers(own["return"], 1)]
        rows[name] = row
    others = sorted(names[1:], key=lambda name: ends[f"centred_{name}"][BOTH].mean())
    head = ["the longer recipe"]
    for arm in ("centred", "in place"):
        head += [f"{arm}: collected and landed, by seed", "change of the mean", "return, by seed"]
    table = _table(head, (rows[name] for name in (first, *others)))
    return f"{table}\n{_run_by('pilots-manhattan')} {_run_by('short-manhattan')}"


def _change(values: np.ndarray, usual: np.ndarray, digits: int) -> str:
    return f"{values.mean() - usual.mean():+.{digits}f}".replace("-", "−")


def by_steps(name: str) -> str:
    """Validations on the way: what the greedy policies of all seeds reach after some steps."""
    rows = []
    for variant, runs in runs_of(name).items():
        every = runs[0]["steps"]
        chosen = [every[np.abs(every - part * every[-1]).argmin()] for part in PARTS_OF_RUN]
        for step in dict.fromkeys(chosen):
            ends = [{key: v[run["steps"] == step][0] for key, v in run.items()} for run in runs]
            shown = [_numbers([e[m] for e in ends], d) for m, d in ((BOTH, 3), ("return", 1))]
            landed = _numbers([e["landed"] for e in ends], 3)
            rows.append([variant.replace("_", " "), f"{int(step):,}", landed, *shown])
    head = ["variant", "steps", "landed, by seed", "collected and landed, by seed"]
    return f"{_table([*head, 'return, by seed'], rows)}\n{_run_by(name)}"


def _run_by(name: str) -> str:
    """A line with the command, the version and the machine of a study's runs."""
    about = _json(name)
    on = about.get("device", about["machine"])
    begun = f"; {about['begun']}" if "begun" in about else ""
    return f"Made with `{about['command']}`, uavdh_lite {about['version']}, {on}{begun}.\n"


def ladder(scenario: str) -> str:
    """All ways to fly over one of the paper's maps, and what each of them knows.

    The paper's own agent is below them, as a number from another map.
    """
    table = read_table(RUNS / "ladder.csv.gz")
    here = table["scenario"] == scenario
    found = {str(name): i for i, name in zip(np.flatnonzero(here), table["row"][here], strict=True)}
    rows = []
    for name, title in LADDER.items():
        if name not in found:
            continue
        one = {key: values[found[name]] for key, values in table.items()}
        interval = lambda what: Interval(one[what], one[f"{what}_low"], one[f"{what}_high"])  # noqa: B023, E731
        seeds = int(one["seeds"]) if one["steps"] else ""
        ahead = "" if name == "greedy" else _number(interval("return_ahead"), 2)
        rows.append([title.format(steps=f"{round(one['steps'], -3):,.0f}")])
        rows[-1] += [_percent(interval(metric)) for metric in ("landed", BOTH)]
        rows[-1] += [_number(interval("return")), ahead]
        rows[-1].append(", ".join(KNOWLEDGE[w] for w in KNOWLEDGE if one[f"knows_{w}"]))
        rows[-1] += [seeds, int(one["missions"])]
    paper = [f"{100 * RESULTS[scenario][metric]:g} %" for metric in ("landed", BOTH)]
    rows.append(["the paper's agent, on its own map", *paper, "", "", "map, reward", 1, 1000])
    head = ["pilot", "landed", "collected and landed", "return", "ahead of greedy"]
    head += ["knows", "seeds", "missions"]
    return f"{_table(head, rows)}\n{_made_with('ladder')}"


def claims() -> str:
    """What the paper claims, and what the recorded runs say of each claim."""
    table = read_table(RUNS / "ladder.csv.gz")

    def ours(row: str, scenario: str) -> list[str]:
        """Means over runs and missions: landed, and collected and landed."""
        at = np.flatnonzero((table["row"] == row) & (table["scenario"] == scenario))[0]
        return [f"{100 * table[metric][at]:.1f}" for metric in ("landed", BOTH)]

    rows = []
    for scenario, title in {"manhattan": "Manhattan", "open_field": "open field"}.items():
        paper = [f"{100 * RESULTS[scenario][metric]:g}" for metric in ("landed", BOTH)]
        plain, lite = ours("plain", scenario), ours("ddqn", scenario)
        rows.append(
            [
                f"Table II, {title}: one agent lands in {paper[0]} % of 1000 random missions, and "
                f"collects and lands {paper[1]} % of the data",
                f"with `plain` {plain[0]} and {plain[1]} %, with the strengthened DDQN {lite[0]} "
                f"and {lite[1]} %, over our map",
                "partly",
                "[ladder](ladder.md)",
            ]
        )
    ends = {
        recipe: {
            variant: (
                _numbers([100 * run[BOTH][-1] for run in runs], 1),
                _numbers([run["return"][-1] for run in runs], 1),
            )
            for variant, runs in runs_of(f"centring_{recipe}-manhattan").items()
        }
        for recipe in ("plain", "lite")
    }
    for recipe, verdict in {"plain": "holds", "lite": "partly"}.items():
        one = ends[recipe]
        rows.append(
            [
                "Training curves: centring the map lets the agent learn faster and better; "
                f"`{recipe}`",
                "collected and landed in the last validation, by seed: centred {} %, in place {} "
                "%; return: centred {}, in place {}".format(
                    *(one[variant][i] for i in (0, 1) for variant in ("centred", "non_centred"))
                ),
                verdict,
                "[the ablation](training.md#the-ablation-on-map-centring)",
            ]
        )
    rows += [list(row) for row in CLAIMS]
    return _table(["in the paper", "found here", "verdict", "more"], rows)


def outstanding() -> str:
    """The studies that the current version has not made, and the hours of one core that they need.

    Raises `ValueError` if there are none: then no page must say that there are.
    """
    rows = [
        [f"`{name}`", study["what"], f"{study['core_hours']:g}"]
        for name, study in tomllib.loads((RUNS / "list.toml").read_text())["studies"].items()
        if "outstanding" in study
    ]
    if not rows:
        raise ValueError("nothing is outstanding; take the table and its sentence away")
    return _table(["study", "what it is", "core-hours"], rows)


def sb3() -> str:
    """DQN and PPO of Stable-Baselines3 next to our DDQN in the village."""
    columns = {BOTH: 3, "landed": 3, "seconds": 0}
    rows = [
        [name, *(_numbers([run[c][-1] for run in runs], digits) for c, digits in columns.items())]
        for name, runs in runs_of("sb3-village").items()
    ]
    head = ["algorithm", "collected and landed, by seed", "landed, by seed", "seconds, by seed"]
    return f"{_table(head, rows)}\n{_made_with('sb3-village')}"


def practice(scenario: str) -> str:
    """The leaderboard of a practice set of the challenge."""
    board = json.loads((DATA / "challenge" / f"practice-{scenario}.json").read_text())
    rows = []
    for score in sorted(board["scores"].values(), key=lambda score: -score[BOTH][0]):
        shares = (_percent(Interval(*score[name])) for name in (BOTH, "landed"))
        rows.append([f"`{score['name']}`", *shares, _number(Interval(*score["return"]))])
    return _table(["policy", "collected and landed", "landed", "return"], rows)


def flights(checkpoint: str, seed: str, *others: str) -> str:
    """A mission flown by an agent and others, to play in the page, and the agent's command.

    The agent flies over its own city, or over that of a picture in the repository.
    """
    agent, picture = load_agent(checkpoint), next((o for o in others if o.endswith(".png")), "")
    if picture:
        agent = agent.over(load_city(ROOT / picture))
    mission = Mission.draw(agent.scenario, agent.city, int(seed))
    pilots = {checkpoint: agent}
    pilots |= {o: find_policy(o, agent.environment) for o in others if o != picture}
    flown = {k: mission.fly(agent.environment, v).trajectory(0) for k, v in pilots.items()}
    city = f" --city {picture}" if picture else ""
    command = f"fly --checkpoint {checkpoint}{city} --seed {seed} --out flight.html"
    player = play(agent.environment, flown)._repr_html_()
    return f"```{{raw}} html\n{player}\n```\n\n`python -m uavdh_lite {command}`\n"


# Teaching


def sessions(name: str) -> list[tuple[str, int, list[tuple[str, int, list[str]]]]]:
    """A plan of `teach/plan.toml`: each session's name, longest minutes, and its parts.

    A part has what is done, its minutes, and the exercises; see the file.
    """
    plan = tomllib.loads((TEACH / "plan.toml").read_text(encoding="utf-8"))[name]
    minutes = {one.number: one.minutes for one in EXERCISES.values()}
    found = []
    for session in plan["session"]:
        parts = []
        for what, *rest in session["parts"]:
            if rest and isinstance(rest[0], int):
                parts.append((what, rest[0], []))
                continue
            taken = sum(minutes[number] for number in rest)
            if what != "exercises":
                (path,) = NOTEBOOKS.glob(f"{what}_*.ipynb")
                read = re.search(r"(\d+) minutes to read", path.read_text(encoding="utf-8"))
                taken += int(read[1])
                what = f"[`{path.stem}`](../tutorials/{path.name})"
            parts.append((what, taken, rest))
        found.append((session["name"], session.get("longest", plan["longest"]), parts))
    return found


def plan(name: str) -> str:
    """A plan: the minutes of each part, and of each session in all."""
    rows = []
    for session, _, parts in sessions(name):
        rows.append([f"**{session}**", f"**{sum(part[1] for part in parts)}**", "", ""])
        rows += [["", taken, what, ", ".join(numbers)] for what, taken, numbers in parts]
    return _table(["session", "minutes", "what is done", "exercises"], rows)


def exercises() -> str:
    """Every exercise: points and minutes from its heading, the rest from `teach/goals.toml`."""
    goals = tomllib.loads((TEACH / "goals.toml").read_text(encoding="utf-8"))
    rows = [
        [one.number, one.title, one.points, one.minutes, *goals.get(name, ["", ""])]
        for name, one in EXERCISES.items()
    ]
    return _table(["number", "exercise", "points", "minutes", "needs", "trains"], rows)


def outcomes() -> str:
    """What each notebook is for, with its exercises and the questions of the exam on it."""
    goals = tomllib.loads((TEACH / "goals.toml").read_text(encoding="utf-8"))["outcomes"]
    asked = Counter(question["notebook"] for question in questions())
    rows = []
    for number, outcome in goals.items():
        (path,) = NOTEBOOKS.glob(f"{int(number):02d}_*.ipynb")
        own = [one for one in EXERCISES.values() if one.number.split(".")[0] == number]
        trained = ", ".join(f"{one.number} ({one.minutes} min)" for one in own) or "the project"
        link = f"[{path.stem}](../tutorials/{path.name})"
        rows.append([outcome, link, trained, asked[int(number)] or "—"])
    head = ["students can", "notebook", "exercises", "questions of the exam"]
    return _table(head, rows)


# Real places

PILOTS = {
    "greedy": "greedy",
    "ddqn": "`manhattan_ddqn`, a strengthened DDQN that was trained for another city",
    "nothing": "`any_city`, told silence: that no data can be collected anywhere",
    "model": "`any_city`, told the paper's model",
    **{
        f"{kind}_{count}": f"`any_city`, told {what} {count} earlier flight{'s' * (count > 1)}"
        for kind, what in (("line", "two lines fitted to"), ("link", "the links heard in"))
        for count in (1, 10, 100)
    },
    "truth": "`any_city`, told the truth",
}


def places() -> str:
    """The shipped places: their links in the paper's model and in the ray-traced gains."""
    rows = []
    for name in shipped_places():
        world = load_place(name)
        known, traced_db, model_db = links(world), world.mean_snr_db, modelled_snr_db(world)
        row = [
            name.replace("_", " ").title(),
            f"{100 * (known & world.sight[0]).sum() / known.sum():.0f} %",
        ]
        for state in (world.sight[0], ~world.sight[0]):
            inside = known & state & np.isfinite(traced_db)
            log_m = 10 * np.log10(distances_m(world)[inside])
            slope, level = np.polyfit(log_m, traced_db[inside], 1)
            spread_db = (traced_db[inside] - slope * log_m - level).std()
            row += [f"{-slope:.2f}", f"{spread_db:.1f} dB"]
        silent = 1 - inside.sum() / (known & state).sum()
        row.append(f"{100 * silent:.0f} %")
        for pairs in (known & ~world.sight[0], known):  # the last of them are all
            rates = rate(model_db[pairs]), rate(traced_db[pairs])
            row.append(f"{np.corrcoef(*rates)[0, 1]:.2f}")
        error = np.sqrt(np.square(rates[1] - rates[0]).mean()) / rates[0].mean()
        rows.append([*row, f"{error:.2f}", *(f"{values.mean():.3f}" for values in rates)])
    lines = ["place", "pairs in sight", "exponent in sight", "spread in sight"]
    lines += ["exponent behind buildings", "spread behind buildings"]
    lines += ["hidden pairs without any ray", "correlation of rates behind buildings"]
    lines += ["correlation of rates, all pairs", "RMS difference of the rates / mean rate, model"]
    lines += ["mean rate, model", "mean rate, ray-traced"]
    head, *rows = zip(lines, *rows, strict=True)
    return _table(head, rows)


def real_city(radio: str) -> str:
    """Who flew how well over the four places, in one of the two radios, next to greedy."""
    flown, rows = flown_over_places(radio), []
    for policy, label in PILOTS.items():
        table = flown[policy]
        ahead, row = table["return"] - flown["greedy"]["return"], [label]
        row += [f"{100 * table[BOTH].mean():.1f} %", _numbers([table["return"].mean()], 1)]
        if policy == "greedy":
            row += [""] * 3
        else:
            row.append(_number(bootstrap_interval(ahead)))
            for key in ("seed", "place"):
                parts = [ahead[table[key] == value].mean() for value in np.unique(table[key])]
                row.append(_numbers(parts, 1))
        rows.append(row)
    head = ["policy", "collected and landed", "return", "return, ahead of greedy"]
    head += ["that lead by seed"]
    names = ", ".join(name.replace("_", " ").title() for name in shipped_places())
    return f"{_table([*head, f'that lead in {names}'], rows)}\n{_made_with('real_city')}"


def change_of_radio() -> str:
    """What the ray-traced radio adds to the returns of the paper's, at each of the places."""
    before, after = (flown_over_places(radio) for radio in ("model", "ray-traced"))
    told, greedy = (after[name]["return"] - before[name]["return"] for name in ("model", "greedy"))
    at, rows = before["model"]["place"], []
    changes = {PILOTS["model"]: told, "greedy": greedy, "the lead of `any_city`": told - greedy}
    for label, added in changes.items():
        parts = [added, *(added[at == place] for place in shipped_places())]
        rows.append([label, *(_number(bootstrap_interval(part), 2) for part in parts)])
    names = (name.replace("_", " ").title() for name in shipped_places())
    return _table(["change of", "all four places", *names], rows)


def worth_of_telling() -> str:
    """What other beliefs add to the return of `any_city`, next to being told the paper's model."""
    policies = "nothing", "line_1", "line_10", "line_100", "link_10", "link_100", "truth"
    rows = {policy: [PILOTS[policy]] for policy in policies}
    for radio in ("model", "ray-traced"):
        flown = flown_over_places(radio)
        for policy, row in rows.items():
            added = flown[policy]["return"] - flown["model"]["return"]
            mean, low, high = (f"{v:+.2f}".replace("-", "−") for v in bootstrap_interval(added))
            row.append(_together(mean, f"({low} to {high})"))
            if radio == "ray-traced":
                for key, digits in (("seed", 2), ("place", 1)):
                    of = flown[policy][key]
                    row.append(_numbers((added[of == one].mean() for one in np.unique(of)), digits))
    names = ", ".join(name.replace("_", " ").title() for name in shipped_places())
    head = ["policy", "under the paper's model", "under the ray-traced model"]
    head += ["the ray-traced model, by seed", f"the ray-traced model, in {names}"]
    return _table(head, rows.values())


def flown_over_places(radio: str) -> dict[str, dict[str, np.ndarray]]:
    """The flights of each policy in one radio; those at the same place flew the same mission."""
    table = read_table(RUNS / "real_city.csv.gz")
    of_radio = table["radio"] == radio
    return _parts({name: values[of_radio] for name, values in table.items()}, "policy")
