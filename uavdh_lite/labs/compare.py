"""Two flights of one mission: where they part, who is ahead and why, and how to find a duel."""

from typing import Any

import numpy as np

from uavdh_lite.environment import LAND, State
from uavdh_lite.errors import InputError
from uavdh_lite.evaluation import Trajectory, evaluate, fly
from uavdh_lite.labs.flights import Hangar, does, numbers, says, title
from uavdh_lite.labs.state import YOU, Stage, random_mission, scenario_of
from uavdh_lite.missions import Mission
from uavdh_lite.streams import Use, stream

AHEAD, LEVEL = 2.0, 0.5  # differences of the return
LITTLE, ENOUGH, MUCH = 0.1, 0.5, 2.0  # data units: nothing to speak of, worth a word, a reason
NEAR = 2  # cells between them
LONG = 3  # more steps without data than the other's that are worth a word
TRIES = 40  # missions that are looked at together for a duel, in a city of 16 × 16 cells
BATCHES = 4  # of such missions
MISSIONS = 100


def parting(first: Trajectory, second: Trajectory, size: int) -> int | None:
    """The step in which the flights part for good; None if they come to the same end.

    That is where they were nearest when they were near each other for the last time, with about
    the same data: two ways to one device are no parting. If they end near each other, it is the
    last cell that they have in common in which they act differently.

    Arguments:
        size: of the city, in cells on a side.
    """
    steps = min(len(first.action), len(second.action))
    cells = [np.array(divmod(each.uav_cell[: steps + 1], size)) for each in (first, second)]
    far = np.abs(np.subtract(*cells)).sum(axis=0)
    apart = np.abs(first.data_left[: steps + 1] - second.data_left[: steps + 1]).max(axis=1)
    if far[-1] == 0 and apart[-1] < ENOUGH and len(first.action) == len(second.action):
        return None
    differ = np.append(first.action[:steps] != second.action[:steps], False)
    near = (far <= NEAR) & (apart < MUCH)
    last = np.flatnonzero(near)[-1]
    first_near = np.flatnonzero(np.append(True, ~near[:last]))[-1]  # of those up to the last
    meeting = [k for k in range(first_near, last + 1) if differ[k]]
    if near[-1] or not meeting:
        same = (far == 0) & (apart < max(ENOUGH, apart[-1]))
        acts = same & differ
        return int(np.flatnonzero(acts if acts.any() else same[:steps])[-1])
    return int(min(meeting, key=lambda k: (far[k], -k)))


def scene(stage: Stage, hangar: Hangar) -> dict[str, Any]:
    """What the panel says: the verdict, where they part and why, and the numbers."""
    flights = [hangar.flight(stage, policy) for policy in stage.policies]
    names = [title(policy) for policy in stage.policies]
    part = parting(*flights, stage.mission.city.size)
    results = [numbers(flight) for flight in flights]
    told, why = verdict(names, results), _why(names, flights, part)
    return {
        "parting": part,
        "look": sorted({step for step, _ in why if step is not None}),
        "verdict": told,
        "why": " ".join(text for _, text in why),
        "results": [{"name": n, **r} for n, r in zip(names, results, strict=True)],
        "story": _story(flights, part, told, [text for _, text in why]),
    }


def verdict(names: list[str], results: list[dict]) -> str:
    """Who is ahead, and by what."""
    if not all(result["ended"] for result in results):
        return "One flight is still in the air."
    difference = results[0]["return"] - results[1]["return"]
    if abs(difference) < LEVEL:
        return "Nearly level."
    ahead, behind = (0, 1) if difference > 0 else (1, 0)
    first, second = results[ahead], results[behind]
    if first["landed"] and not second["landed"]:
        crash = says(names[behind], "crashes: all that was collected is lost")
        return _upper(f"{says(names[ahead], 'wins')}, because {crash}.")
    gained = first["collected"] - second["collected"]
    sooner = second["steps"] - first["steps"]
    parts = []
    if abs(gained) >= (ENOUGH if sooner else LITTLE):
        parts.append(f"{abs(gained):.1f} units {'more' if gained > 0 else 'less'}")
    if sooner:
        steps = "1 step" if abs(sooner) == 1 else f"{abs(sooner)} steps"
        parts.append(f"home {steps} {'sooner' if sooner > 0 else 'later'}")
    told = ", ".join(parts) or "fewer refusals"
    by = f" by {abs(difference):.1f} in return" if gained < 0 else ""  # else the data says it
    return _upper(f"{says(names[ahead], 'wins')}{by}: {told}.")


def _why(names: list[str], flights: list[Trajectory], part: int | None) -> list[tuple]:
    """Sentences: what each does where they part, and what comes of it in the end.

    Each with the step to look at, or None.
    """
    if part is None:
        return [(None, "They come to the same end.")]
    towards = [_towards(flight, part) for flight in flights]
    (where, _), (there, _) = towards
    also = ["", ""] if where == there else [text for _, text in towards]
    each = zip(names, flights, also, strict=True)
    told = [says(name, does(flight, part) + more) for name, flight, more in each]
    sentences = [(part, f"At step {part + 1}, {told[0]}, while {told[1]}.")]
    behind = 0 if flights[0].reward.sum() < flights[1].reward.sum() else 1
    steps, others = (idle(flights[k], part).sum() for k in (behind, 1 - behind))
    if lost := astray(flights[behind], part):
        flies = says(names[behind], "hovers or flies to and fro for nearly nothing")
        sentences.append((lost[0], f"From step {lost[0] + 1} to {lost[1]} {flies}."))
    elif steps - others >= LONG:
        spends = says(
            names[behind], f"spends {steps} steps that bring less than {LITTLE} units each"
        )
        other = says(names[1 - behind], str(others))
        sentences.append((None, f"From then on {spends}; {other}."))
    left = flights[0].data_left[-1] - flights[1].data_left[-1]
    fewer = 0 if left.sum() > 0 else 1  # who brings less data
    more = left if fewer == 0 else -left
    device = more.argmax()
    if more[device] >= ENOUGH:
        leaves = f"leaves {more[device]:.1f} units more at device {device}"
        if (time := flights[fewer].time_left[-1]) >= LONG:
            leaves += f", with {time} units of time unused"
        theirs = flights[1 - fewer].data_left[1:, device]
        first = int((theirs < flights[fewer].data_left[-1, device] - LITTLE).argmax())
        last = int((theirs <= theirs[-1] + LITTLE).argmax())
        when = f"from step {first + 1} to {last + 1}" if last > first else f"in step {last + 1}"
        gets = f"gets them {when}"
        ends = f"In the end {says(names[fewer], leaves)}; {says(names[1 - fewer], gets)}."
        sentences.append((first, ends))
    return sentences


def idle(flight: Trajectory, step: int) -> np.ndarray:
    """(T,) bool: steps from this one on that bring hardly any data; a landing is none of them."""
    brings = -np.diff(flight.data_left.sum(axis=1))
    lands = (flight.action == LAND) & ~flight.intervened
    return (brings < LITTLE) & ~lands & (np.arange(len(lands)) >= step)


def astray(flight: Trajectory, step: int) -> tuple[int, int] | None:
    """The longest stretch of idle steps that stay where it is or lead to and fro.

    From its first step to behind its last one; None if there is none of `LONG` steps.
    """
    cells = flight.uav_cell
    turns = cells[2:] == cells[:-2]  # this step leads away, and the next one back
    to_and_fro = np.append(turns, False) | np.append(False, turns)
    lost = idle(flight, step) & (to_and_fro | (cells[1:] == cells[:-1]))
    ends = np.flatnonzero(np.diff(np.concatenate([[0], lost, [0]])))
    first, last = max(
        ends.reshape(-1, 2).tolist(), key=lambda each: each[1] - each[0], default=(0, 0)
    )
    return (first, last) if last - first >= LONG else None


def _towards(flight: Trajectory, step: int) -> tuple[int | None, str]:
    """The device that first gives much, None for home or nothing, and words for it."""
    given = flight.data_left[step] - flight.data_left[step:]
    enough = (given >= MUCH).any(axis=1)
    if enough.any():
        after = int(enough.argmax())
        device = int(given[after].argmax())
        gets = f"gets its first {MUCH:.0f} units from device {device}"
        return device, f" and {gets} by step {step + after}"
    way = flight.uav_cell[step:-1]  # without the step that lands
    straight = len(set(way.tolist())) == len(way)
    return None, " and goes home" if flight.landed and straight and len(way) > 1 else ""


def _story(flights: list[Trajectory], part: int | None, told: str, why: list[str]) -> list:
    """Three captions and the steps at which they are shown."""
    last = max(len(flight.action) for flight in flights)
    return [
        [0, "Two drones, one mission: collect the devices' data, and land in blue in time."],
        [part or 0, f"Here they part. {why[0]} {' '.join(why[1:][-1:])}"],
        [last, f"{told} Now it is your turn: drag a device, or fly yourself."],
    ]


def find_duel(stage: Stage, hangar: Hangar, wanted: int) -> Stage:
    """The next random mission in which the first policy wins (1), loses (−1), or is level (0).

    Candidates fly at once, with other fading than their own; the most promising are then flown
    as they will be shown. Raises `InputError` if there is none among them.
    """
    pair = stage.policies if YOU not in stage.policies else Stage.of(stage.mission).policies
    if pair[0] == pair[1]:
        raise InputError("both are flown by the same: choose another rival")
    city = stage.mission.city
    count = max(8, int(TRIES * (16 / city.size) ** 2) if city.size > 16 else TRIES)
    begin = stage.mission.seed + 1
    for first in range(begin, begin + BATCHES * count, count):
        missions = [random_mission(city, first + k) for k in range(count)]
        for k in _hopeful(hangar, pair, missions, wanted, first)[:6]:
            flown = Hangar.of(missions[k], hangar)
            flights = [flown.flight(stage, name) for name in pair]
            first_did, second_did = (numbers(flight) for flight in flights)
            ahead = first_did["return"] - second_did["return"]
            gained = first_did["collected"] - second_did["collected"]
            clear = wanted * ahead > AHEAD and wanted * gained > -LITTLE
            level = abs(ahead) < LEVEL and parting(*flights, city.size) is not None
            if clear if wanted else level:
                return Stage(missions[k], pair, stage.tool)
    raise InputError(f"no such duel among the next {BATCHES * count} missions: try other rivals")


def _hopeful(
    hangar: Hangar, pair: tuple[str, str], missions: list[Mission], wanted: int, seed: int
) -> np.ndarray:
    """The numbers of the missions, the most promising first, from one flight of each policy."""
    start = State.concatenate([mission.state for mission in missions])
    returns = [
        fly(hangar.environment, hangar.policy(name), start, stream(Use.LAB, seed)).returns
        for name in pair
    ]
    difference = returns[0] - returns[1]
    return np.argsort(-wanted * difference if wanted else np.abs(difference), kind="stable")


def many(stage: Stage, hangar: Hangar) -> list[dict]:
    """The means of both policies over 100 random missions, in per cent, with their intervals."""
    scenario, rows = scenario_of(stage.mission.city), []
    for name in ["greedy" if policy == YOU else policy for policy in stage.policies]:
        policy = hangar.policy(name)
        flights = evaluate(hangar.environment, policy, scenario, MISSIONS, 0, Use.LAB)
        metrics = flights.metrics().items()
        shown = {metric: [round(100 * value) for value in values] for metric, values in metrics}
        rows.append({"name": title(name), **shown})
    return rows


def _upper(text: str) -> str:
    return text[:1].upper() + text[1:]
