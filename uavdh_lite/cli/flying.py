"""`demo`, `fly`, `evaluate`, `compare` and `export`: what trained agents do."""

from dataclasses import asdict, replace
from pathlib import Path
from typing import Annotated, Literal

from cyclopts.types import NonNegativeInt, PositiveInt
from matplotlib.figure import Figure

from uavdh_lite import evaluation, missions, plotting, registry
from uavdh_lite.agent import Agent
from uavdh_lite.beyond.genie import Genie
from uavdh_lite.beyond.symmetry import in_eight_views
from uavdh_lite.bridges.onnx import export_onnx
from uavdh_lite.channel import Channel
from uavdh_lite.checkpoint import load_agent
from uavdh_lite.city import City, fingerprint_of, load_cities
from uavdh_lite.cli.options import (
    PICTURES,
    Checkpoint,
    Cities,
    CommandLine,
    Count,
    named,
    options_of,
    output,
    with_values,
)
from uavdh_lite.config import differences
from uavdh_lite.environment import Environment
from uavdh_lite.errors import InputError
from uavdh_lite.experiments import comparison
from uavdh_lite.experiments.report import TABLE_METRICS, policies_table
from uavdh_lite.paper import RESULTS
from uavdh_lite.player import play
from uavdh_lite.policies import agents_for, find_policy
from uavdh_lite.provenance import provenance
from uavdh_lite.scenario import Scenario, find_scenario
from uavdh_lite.storage import write_json

FLOWN = {  # in `demo`: the policy's name, from that of the city
    "beyond it: copies a planner": "{}",
    "a strengthened DDQN": "{}_ddqn",
    "greedy rule": "greedy",
}


ChannelOptions = options_of(Channel(), "Channel")


def open_agent(checkpoint: str | None, city: str | City | None) -> tuple[str, Agent]:
    """The name and the agent of a file or a shipped one, over its own city, another, or several.

    Without a checkpoint it is the shipped agent that knows the city best; without a city, that of
    manhattan. Raises `InputError` if there is none.
    """
    if city is None:
        name = checkpoint or "manhattan"
        return name, load_agent(name)
    environment = Environment(load_cities(city) if isinstance(city, str) else city)
    best = checkpoint or next(iter(agents_for(environment)), None)
    if best is None:
        raise InputError(
            f"no shipped agent was trained for cities of {environment.size} × {environment.size} "
            "cells: train one (train --city), or name one of larger cities as --checkpoint"
        )
    return best, load_agent(best).over(environment.cities)


def _where(agent: Agent) -> str:
    """What an agent flies over, in words."""
    return agent.city.name if len(agent.cities) == 1 else f"{len(agent.cities)} cities"


def _flown(agent: Agent) -> tuple[Scenario, str]:
    """An agent's scenario, with the channel that it flies over; and in words: its name, and what
    the scenario of this name has otherwise, or where there is none, that of the paper."""
    name, channel = agent.scenario.name, agent.environment.channel
    usual = find_scenario(name) if name in registry.names("scenario") else Scenario(name)
    flown = replace(agent.scenario, channel=channel)
    found = differences(flown, replace(usual, city=flown.city))
    return flown, f"{name}, but {found}" if found else name


def demo(
    *,
    episodes: Count = 3000,
    out: Annotated[Path | None, named(*PICTURES)] = None,
    seed: NonNegativeInt = 50_000,
) -> None:
    """Fly the shipped agents next to a simple rule and the paper's results, and draw four flights.

    Arguments:
        episodes: number of random missions.
        out: the figure, by default demo.png.
        seed: seed of the missions and the fading, by default that of the ladder in the results.
    """
    figure = Figure(figsize=(11, 13), layout="constrained")
    axes = figure.subplots(2, 2)
    for (name, paper), row in zip(RESULTS.items(), axes, strict=True):
        agent = load_agent(name)
        environment = Environment(agent.city)
        flown = {}
        for label, pattern in FLOWN.items():
            policy = find_policy(pattern.format(name), environment)
            drawn = agent.scenario, episodes, seed
            flown[label] = evaluation.evaluate(environment, policy, *drawn)
        metrics = {label: flights.metrics() for label, flights in flown.items()}
        print(f"{name}: {episodes} random missions, seed {seed}")
        print(f"{policies_table(metrics, paper)}\n")
        best = next(iter(flown.values()))
        for episode, ax in enumerate(row[:episodes]):
            plotting.draw_trajectory(ax, environment, best.trajectory(episode))
            ax.set_title(f"{name}, scenario {episode}")
    plotting.add_legend(figure, devices=5)
    with output(out, "demo", ".png") as out:
        plotting.save_figure(figure, out)
    print(f"The first flights over each map are drawn in {out}.")
    print("The agents are those of one training each; the results have the means of all.")
    print("The paper's maps were never published as files. Ours are redrawn from its text, so the")
    print("agents solve the same task, but in other streets.")


def fly(
    *,
    checkpoint: Checkpoint = None,
    city: Cities = None,
    mission: Path | None = None,
    save_mission: Annotated[Path | None, named(".json")] = None,
    seed: NonNegativeInt | None = None,
    out: Annotated[Path | None, named(*PICTURES, ".gif", ".html")] = None,
) -> None:
    """Fly one mission and draw it: a random one, or that of a file.

    The agent flies over the radio channel that it was trained with.

    Arguments:
        mission: a mission's file, from --save-mission or from the labs.
        save_mission: write the mission to this file, to change or to share it.
        seed: seed of the random mission and its fading, by default 0.
        out: the figure, by default flight.png; a name that ends in .gif makes an animation, in
            .html a page that plays it.
    """
    if mission is not None and (city is not None or seed is not None):
        raise InputError("a mission has its own city and seed: leave out --city and --seed")
    given = None if mission is None else missions.load_mission(mission)
    name, agent = open_agent(checkpoint, city if given is None else given.city)
    if len(agent.cities) > 1:
        raise InputError(f"{name} over {_where(agent)}: name a single one with --city")
    flown = given or missions.Mission.draw(agent.scenario, agent.city, seed or 0)
    if save_mission is not None:
        missions.save_mission(save_mission, flown)
    environment = Environment(flown.city, agent.environment.channel)
    trajectory = flown.fly(environment, agent).trajectory(0)
    with output(out, "flight", ".png") as out:
        if out.suffix.lower() == ".gif":
            plotting.save_animation(environment, trajectory, out)
        elif out.suffix.lower() == ".html":
            play(environment, trajectory).save(out)
        else:
            plotting.save_figure(plotting.trajectory_figure(environment, trajectory), out)
    landed = "landed" if trajectory.landed else "crashed"
    heard = differences(environment.channel, Channel())
    over = f"{name} over {_where(agent)}" + f", with {heard}" * bool(heard)
    print(f"{over}: {landed}. {plotting.caption(trajectory)}. {out}")


def evaluate(
    *,
    checkpoint: Checkpoint = None,
    city: Cities = None,
    episodes: Count = 1000,
    seed: NonNegativeInt = 0,
    views: Literal[1, 8] = 1,
    json: Annotated[Path | None, named(".json")] = None,
    channel_values: ChannelOptions = None,  # type: ignore[valid-type]
) -> None:
    """Fly an agent on many random missions.

    An agent flies over the radio channel that it was trained with. If you give options under
    Channel, it flies over one with the constants of the paper but for these.

    Arguments:
        episodes: number of random missions.
        seed: seed of the missions and the fading.
        views: with 8 the agent flies by the mean of what it sees in a map turned and mirrored, if
            it has learned from all these views.
        json: file to write the mean, low and high of each metric to.
    """
    name, agent = open_agent(checkpoint, city)
    agent = in_eight_views(agent) if views == 8 else agent
    if channel_values is not None:
        agent = agent.over(agent.environment.city, with_values(Channel(), channel_values))
    flights = evaluation.evaluate(agent.environment, agent, agent.scenario, episodes, seed)
    metrics = flights.metrics()
    drawn = f"{episodes} random missions over {_where(agent)}, seed {seed}"
    print(f"{_flown(agent)[1]}: {drawn}")
    print(policies_table({name: metrics}))
    if json is not None:
        write_json(json, {name: interval._asdict() for name, interval in metrics.items()})


def compare(
    *,
    checkpoint: Checkpoint = None,
    others: tuple[str, ...] = (),
    city: Cities = None,
    episodes: Count = 1000,
    seed: NonNegativeInt = 0,
    jobs: PositiveInt = 1,
    out: Annotated[Path | None, named(".csv", ".csv.gz")] = None,
    command_line: CommandLine,
) -> None:
    """Compare an agent with the planners on the same missions.

    The agent, the random planner, the greedy planner and two genies fly the same missions with
    the same fading. The metrics of every episode are written as a table.

    Arguments:
        others: names of shipped agents of the same city to compare with, too.
        episodes: number of random missions.
        seed: seed of the missions, the fading and the random planner.
        jobs: number of processes at a time, one for each policy.
        out: the table, by default comparison-SCENARIO.csv.gz, with a JSON file next to it.
    """
    opened, agent = open_agent(checkpoint, city)
    environment = Environment(agent.cities, agent.environment.channel)
    scenario, called = _flown(agent)
    if out is not None:
        comparison.about_path(out)  # before anything flies
    if "agent" in others:
        raise InputError("--others agent: the table has a row of this name, of --checkpoint")
    planners = {
        each: find_policy(each, environment, seed) for each in (*others, "random", "greedy")
    }
    genies = {"genie": Genie(environment), "genie_data": Genie(environment, time_cost=0.01)}
    policies = {"agent": agent, **planners, **genies}
    jobs = min(jobs, len(policies))
    results = comparison.compare(environment, scenario, policies, episodes, seed, jobs)
    about = {"command": command_line, "seed": seed, **provenance(), "agent": agent.training}
    about |= {"scenario": asdict(scenario), "cities": fingerprint_of(agent.cities)}
    drawn = f"{episodes} random missions over {_where(agent)}, seed {seed}"
    print(f"{called}: {drawn}; agent is {opened}")
    metrics = {
        policy: {
            m: evaluation.mean_interval(columns[m], columns.get("city")) for m in TABLE_METRICS
        }
        for policy, columns in results.items()
    }
    print(policies_table(metrics), flush=True)
    with output(out, f"comparison-{scenario.name}", ".csv.gz", ".json") as out:
        comparison.save_comparison(out, results, about)
    print(out)


def export(
    *,
    checkpoint: Checkpoint,
    city: Cities = None,
    out: Annotated[Path | None, named(".onnx")] = None,
) -> None:
    """Write an agent's network as an ONNX file.

    The file is written only if ONNX Runtime has with it the Q-values of the agent.

    Arguments:
        out: the file, by default agent.onnx.
    """
    name, agent = open_agent(checkpoint, city)
    with output(out, "agent", ".onnx") as out:
        error = export_onnx(agent, out)
    print(f"{out}: {name} over {_where(agent)}; Q-values differ by at most {error:.1g}")
