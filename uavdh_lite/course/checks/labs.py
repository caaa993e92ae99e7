"""Exercises of notebook 10, the labs."""

import numpy as np

from uavdh_lite.channel import rate_map
from uavdh_lite.course.checks.environment import Town
from uavdh_lite.course.checks.exercise import exercise, expect, solution
from uavdh_lite.course.checks.table import edit
from uavdh_lite.course.checks.trial import expect_none
from uavdh_lite.course.checks.values import pair, show
from uavdh_lite.environment import Environment
from uavdh_lite.evaluation import evaluate
from uavdh_lite.missions import Mission, environment_of
from uavdh_lite.plotting import VERMILION
from uavdh_lite.policies import find_policy
from uavdh_lite.scenario import find_scenario

SEEDS, POINTS = range(100, 10_000), 40  # the tutorial shows seeds below 100
MISSIONS = 500  # in the hint's figure


SCORE = "collected_and_landed"


def results(seed: int) -> tuple[float, ...]:
    """The scores of greedy and agent in the mission of this seed, with the same fading."""
    environment = environment_of("manhattan")
    mission = Mission.draw(find_scenario("manhattan"), environment.city, seed)
    flights = (
        mission.fly(environment, find_policy(name, environment))
        for name in ("greedy", "manhattan_ddqn")
    )
    return tuple(100 * float(flight.records()[SCORE][0]) for flight in flights)


def _draw_leads(ax):
    environment, scenario = environment_of("manhattan"), find_scenario("manhattan")
    greedy, agent = (
        evaluate(environment, find_policy(name, environment), scenario, MISSIONS, 0).records()
        for name in ("greedy", "manhattan_ddqn")
    )
    lead = 100 * (greedy[SCORE] - agent[SCORE])
    ax.plot(np.sort(lead)[::-1], ".")
    ax.axhline(POINTS, color=VERMILION, linestyle="--", label=f"{POINTS} points")
    ax.set(xlabel=f"{MISSIONS} missions, sorted", ylabel="greedy's lead over the agent, points")
    ax.set_title(f"{(lead >= POINTS).sum()} of {MISSIONS} random missions reach {POINTS} points")


MISSION = {  # what is said of a mission, and when
    "In mission {seed} the agent is ahead: greedy brings home {greedy:.1f} %, the agent "
    "{agent:.1f} %. The lead is greedy minus agent.": lambda flown: flown.lead < 0,
    f"In mission {{seed}} greedy brings home {{greedy:.1f}} %, the agent {{agent:.1f}} %: a lead "
    f"of {{lead:.4g}} points, {POINTS} are asked for. (A share of {POINTS / 100} is {POINTS} "
    "points; and the fading must come from the mission's own seed, as mission.fly does it.)": (
        lambda flown: flown.lead < POINTS
    ),
}


@exercise(
    "10.1 · Find a failure (2 points, 10 minutes)",
    "Such missions are rare. Let the computer fly one seed after the other.",
    "for seed in range(100, 10_000): draw the mission, fly it with "
    "find_policy(name, environment) for both names, "
    "take 100 * collected[0] * landed[0] at the end, and stop at the first lead "
    f"of {POINTS}.",
    figure=_draw_leads,
    takes=(
        lambda answer: isinstance(answer, int | np.integer) and not isinstance(answer, bool),
        "Hand over one seed, a whole number (int), not {given}.",
    ),
    seconds=300,
)
def failure_seed(answer) -> None:
    """The seed of a mission in which greedy is at least 40 points ahead of the agent."""
    expect(
        answer in SEEDS,
        f"The seed {show(answer)} is out of range: it must be from {SEEDS[0]} to {SEEDS[-1]:,}.",
    )
    greedy, agent = results(int(answer))
    expect_none(MISSION, seed=answer, greedy=greedy, agent=agent, lead=greedy - agent)
    print(f"In mission {answer} greedy brings home {greedy:.1f} %, the agent {agent:.1f} %.")


# No two of the mistakes below lead to the same cell of the first, and no two cells are equally bad
POCKET = "bB.N.L.", "BN.BbNN", "LLBb..N", "NBBNNN.", ".NNNL..", ".NLL.B.", "NNBB..."
OTHER = "Bb.L..", "LNNB.N", "..LbN.", "N.L.bN", "..NbNL", ".Nb..b"


def _draw_worst(ax, solved):
    environment = environment_of("manhattan")
    city, (row, col) = environment.city, solved(environment)
    rates = rate_map(city, environment.channel, environment.sight[0], (row, col))
    image = ax.imshow(np.where(city.landing_distance >= 0, rates, np.nan), cmap="viridis")
    ax.plot(col, row, "s", color=VERMILION, label="device")
    ax.figure.colorbar(image, ax=ax, label="mean rate, data units a slot")
    ax.set(xlabel="UAV's column", ylabel="UAV's row", title="manhattan (white: the UAV cannot go)")


CELL, WORST = "sight[0], cell", "min(best, key=best.get)"


@solution(
    "10.2 · The worst place for a device (3 points, 12 minutes)",
    "Two steps: for one device cell, which rate does the UAV get at the best place that it can "
    "fly to? Then compare the device cells.",
    "For each number in city.device_cells: device = divmod(number, city.size), then the "
    "maximum of rate_map(city, environment.channel, environment.sight[0], device) over "
    "the cells with city.landing_distance >= 0. Keep the device with the lowest maximum.",
    figure=_draw_worst,
    seconds=60,
    rules={
        "For each cell in city.device_cells take the best rate, the max over all UAV cells that "
        "count: those with city.landing_distance >= 0, however far. The answer is the device's "
        "cell with the lowest of these rates, not the first or the smallest cell, as (row, "
        "column).": [
            *(("BbbB", "bN..", "...b", "..L."), ("BNbb", "LNLb", "..bB", ".B.N")),
        ],
        "Of the best rates the lowest decides, and for them only UAV cells with "
        "city.landing_distance >= 0 count: the UAV can neither enter a no-fly cell nor get to one "
        "that is walled in (both −1).": [("bL.N", "NB..", ".NbB", "B.B.")],
        "Over the landing zone (city.landing_distance 0) the UAV collects, too: it counts.": [
            ("b.NB", "NNLN", "Lbb.", "Lb..")
        ],
        "Use the environment that your function is given, not the notebook's own, for all of that, "
        "for M too.": [POCKET, OTHER],
    },
    made=lambda *rows: (Environment(Town.of("a city", *rows)),),
    mistakes={
        "That is right for manhattan only: use the environment that your function is given, not "
        "the notebook's own, for M too.": (
            *(lambda environment: (11, 2), edit("city.size)", "16)")),
            edit(WORST, f"divmod({WORST}[0] * city.size + {WORST}[1], 16)"),
        ),
        "That cell has the lowest *mean* of the rates over all UAV cells. The UAV chooses where "
        "it hovers: take the best rate for each device cell first.": edit(".max", ".mean"),
        "The device that you hand to rate_map is (column, row). It must be (row, column), as "
        "divmod(number, M) gives it.": (
            *(edit(CELL, f"{CELL}[::-1]"), edit(CELL, f"{CELL}[::-1]", WORST, f"{WORST}[::-1]")),
        ),
        "That is an index into city.device_cells, not a cell: take the number that stands there.": (
            edit(WORST, f"divmod(list(best).index({WORST}), city.size)")
        ),
    },
    read=pair,
    call=lambda environment: f"worst_device_cell(Environment({environment.city!r}))",
)
def worst_device_cell(environment):
    """`worst_device_cell(environment)`: (row, column) with the lowest best mean rate."""
    city, best = environment.city, {}
    for number in city.device_cells:
        cell = divmod(int(number), city.size)
        rates = rate_map(city, environment.channel, environment.sight[0], cell)
        best[cell] = float(rates[city.landing_distance >= 0].max())
    return min(best, key=best.get)
