from dataclasses import replace
from itertools import product

import numpy as np
import pytest

from uavdh_lite.city import City
from uavdh_lite.environment import HOVER, LAND, Environment, Rewards, State
from uavdh_lite.evaluation import evaluate, fly
from uavdh_lite.planners import Genie, Greedy, Random, _best, _Problem, _ranked
from uavdh_lite.scenario import SCENARIOS, Scenario, place
from uavdh_lite.streams import Use, stream

SMALL = """
L . b .
. N . .
. . B .
. . . .
"""


class Quiet(np.random.Generator):
    """Draws no fading: the channel's mean."""

    def __init__(self):
        super().__init__(np.random.PCG64(0))

    def standard_normal(self, size=None, dtype=np.float64, out=None):
        return np.zeros(size, dtype)


@pytest.fixture
def small():
    return Environment(City.from_text("small", SMALL))


def value(environment, start, actions):
    """Return of a flight without fading; with −0.2 a step it is what the genie maximises."""
    sequence = iter(actions)
    flights = fly(environment, lambda state: np.array([next(sequence)]), start, Quiet())
    return flights


def test_random_takes_every_action_alike(small, generator):
    state = Scenario("s", "s", (1, 2)).sample(small.city, 12_000, generator)
    counts = np.bincount(Random(0)(state), minlength=6)
    assert counts.min() > 1800 and counts.sum() == 12_000


@pytest.mark.parametrize("name", ["manhattan", "open_field"])
def test_greedy_always_lands_in_time_and_needs_no_safety_controller(name):
    environment = Environment(City.load(name))
    records = evaluate(environment, Greedy(environment), SCENARIOS[name], 400, seed=0).records()
    assert (records["has_landed"] == 1).all()
    assert not records["safety_interventions"].any()
    assert records["collection_ratio"].mean() > 0.9


def test_greedy_takes_shortest_ways():
    environment = Environment(City.load("open_field"))
    greedy = Greedy(environment)
    home = environment.city.landing_distance.ravel()
    cells = np.arange(len(home))
    to_zone = greedy._moves(cells[:, None], environment.city.landing_cells).min(axis=1)
    assert (to_zone == home)[home >= 0].all()
    pairs = stream(Use.TEST, 0).choice(environment.city.flight_cells, (200, 2))
    for start, goal in pairs:
        cell, moves = start, 0
        while cell != goal:
            action = greedy._towards(np.array([cell]), np.array([goal]))[0]
            cell = environment.next_cell[cell, action]
            moves += 1
        assert moves == greedy._moves(start, goal)


def test_greedy_goes_to_the_nearest_device_and_home_when_all_is_collected(small):
    state = place(small.city, (3, 0), [(3, 3), (0, 1)], [5, 5], 30, 2)
    east = Greedy(small)(state)  # (3, 3) is 3 moves away, (0, 1) is 4
    assert east == 1
    empty = State(
        state.uav_cell,
        state.time_left,
        state.device_cells,
        state.data_initial,
        np.zeros_like(state.data_left),
        state.landed,
    )
    assert Greedy(small)(empty) == 0  # north, to the landing zone


@pytest.mark.parametrize(
    ("devices", "data", "time"),
    [([(3, 3), (0, 3)], [4.0, 2.0], 7), ([(2, 0)], [3.0], 6), ([(0, 1), (3, 1)], [9.0, 9.0], 6)],
)
def test_genie_finds_the_best_of_all_flights(small, devices, data, time):
    """All 5^(T−1) ways to move, each landing as soon as it likes, against the search."""
    start = place(small.city, (0, 0), devices, data, time, 2)
    best = -np.inf
    for length in range(time):
        moves = np.array(list(product(range(5), repeat=length)), int).reshape(5**length, length)
        many = start[np.zeros(len(moves), int)]
        plans = np.c_[moves, np.full(len(moves), LAND)]
        state, total = many, np.zeros(len(moves), np.float32)
        for action in plans.T:
            fading = np.zeros((len(moves), 4, 2), np.float32)
            state, outcome = small.transition(state, action, fading)
            total += Rewards(safety=0)(outcome)
        best = max(best, total[state.landed].max(initial=-np.inf))
    plan = Genie(small, beam=10_000).plan(start)
    assert plan.value == pytest.approx(best, abs=1e-4)
    flown = value(small, start, plan.actions)
    assert flown.end.landed[0]
    assert flown.cumulative_reward[0] == pytest.approx(best, abs=1e-4)
    assert flown.end.data_collected.sum() == pytest.approx(plan.collected, abs=1e-4)


def test_growing_the_beam_reaches_the_value_of_a_wide_one():
    environment = Environment(City.load("manhattan"))
    start = SCENARIOS["manhattan"].sample(environment.city, 3, stream(Use.TEST, 3))

    def total(genie):
        return sum(genie.plan(start, episode).value for episode in range(3))

    narrow, wide = (total(Genie(environment, beam=beam, grow=False)) for beam in (1, 16))
    assert 0.98 * wide < narrow <= wide + 1e-3
    assert total(Genie(environment)) > 0.998 * wide


def test_genie_flies_and_lands_with_fading(small):
    scenario = Scenario("s", "s", (1, 2), (3.0, 8.0), (8, 14))
    flights = evaluate(small, Genie(small), scenario, 40, seed=0)
    greedy = evaluate(small, Greedy(small), scenario, 40, seed=0)
    assert flights.end.landed.all() and not flights.safety_interventions.any()
    assert flights.cumulative_reward.mean() > greedy.cumulative_reward.mean()


def test_genie_without_a_way_home_in_time_hovers(small):
    start = place(small.city, (3, 3), [(2, 0)], [5.0], 3, 2)
    plan = Genie(small).plan(start)
    assert plan.actions.tolist() == [HOVER] * 3 and plan.value == -np.inf


def test_the_beam_grows_once_an_episode_and_never_beyond_the_widest(small, monkeypatch):
    """A first plan that ever wider beams improve: 2, 8, 32, and the next would be too wide."""
    beams, search = [], Genie._search

    def improving(self, problem, plans, widths, per_cell=None):
        found = search(self, problem, plans, widths, per_cell)
        if per_cell is None:
            beams.append(int(widths[0]))
        return [replace(plan, value=plan.value + 1, beam=int(widths[0])) for plan in found]

    monkeypatch.setattr(Genie, "_search", improving)
    start = place(small.city, (0, 0), [(2, 3)], [20.0], 14, 2)
    genie = Genie(small, widest=32, replan=4)
    flights = fly(small, genie, start, np.random.default_rng(0))
    assert flights.end.landed[0]
    assert beams[:3] == [2, 8, 32] and len(beams) > 3
    assert set(beams[3:]) == {32}
    fly(small, genie, start, np.random.default_rng(0))  # begun again: planned from the start
    assert beams.count(2) == 2


def test_a_genies_plans_belong_to_their_episodes(small):
    """Two starts with equal devices, amounts and time in one batch, from opposite corners."""
    pair = State.concatenate(
        [place(small.city, start, [(2, 3)], [20.0], 14, 2) for start in ((0, 0), (3, 0))]
    )
    together = fly(small, Genie(small), pair, Quiet()).records()["collection_ratio_and_landed"]
    for row in range(2):
        alone = fly(small, Genie(small), pair[[row]], Quiet())
        assert together[row] == alone.records()["collection_ratio_and_landed"][0] > 0


def test_a_genie_keeps_nothing_between_flights(small):
    genie = Genie(small)
    first, second = (place(small.city, (0, 0), [(2, 3)], [20.0], time, 2) for time in (14, 8))
    fly(small, genie, first, Quiet())
    after, alone = (fly(small, one, second, Quiet()) for one in (genie, Genie(small)))
    assert after.records()["collection_ratio"] == alone.records()["collection_ratio"]
    assert vars(genie).keys() == vars(Genie(small)).keys()


def some_states(environment, generator, count=40):
    """Flights under way on the small map: any cell, some devices already empty."""
    scenario = Scenario("s", "s", (1, 3), (3.0, 12.0), (4, 7))
    return scenario.sample_anywhere(environment.city, count, generator, 1)


def test_no_flight_is_worth_more_than_its_bound(small, generator):
    """All ways to move from many states, against the bound of the state that they start from."""
    state = some_states(small, generator)
    problem = _Problem(small, state, 0.2)
    episodes = np.arange(len(state))
    bound = problem.bound(episodes, problem.start_cell, problem.data, 0)
    episode, cell, left = episodes, problem.start_cell, problem.data
    best = np.full(len(state), -np.inf)
    for step in range(problem.time.max()):
        over = (problem.home[cell] == 0) & (step < problem.time[episode])
        np.maximum.at(best, episode[over], problem.value(episode, left, step)[over])
        parent, action = np.divmod(np.arange(len(cell) * LAND), LAND)
        alive = problem.home_after[cell[parent], action] + step + 1 < problem.time[episode[parent]]
        parent, action = parent[alive], action[alive]
        episode, cell = episode[parent], cell[parent]
        left = problem.collect(episode, cell, action, left[:, parent])
        cell = problem.target[cell, action]
    assert np.isfinite(best).all()
    assert (best <= bound + 1e-3).all()
    assert (bound - best < 0.5).mean() > 0.3  # and it says something
    assert [plan.value for plan in Genie(small, beam=10_000).plans(state)] == pytest.approx(
        best.tolist(), abs=2e-3
    )


def test_a_planned_move_collects_what_the_environment_does_without_fading(small, generator):
    state = some_states(small, generator, 400)
    problem = _Problem(small, state, 0.2)
    action = generator.integers(0, LAND, len(state))
    quiet = np.zeros((len(state), 4, 3), np.float32)
    after, _ = small.transition(state, action, quiet)
    left = problem.collect(np.arange(len(state)), problem.start_cell, action, problem.data)
    assert left.sum(axis=0) == pytest.approx(after.data_left.sum(axis=1), abs=1e-4)
    np.testing.assert_allclose(np.sort(left, axis=0).T, np.sort(after.data_left), atol=1e-4)


def test_a_plan_is_worth_what_its_flight_without_fading_brings():
    environment = Environment(City.load("manhattan"))
    start = SCENARIOS["manhattan"].sample(environment.city, 6, stream(Use.TEST, 4))
    genie = Genie(environment)
    plans = genie.plans(start)
    flown = fly(environment, Genie(environment, replan=1000), start, Quiet())
    values = [plan.value for plan in plans]
    assert values == pytest.approx(flown.cumulative_reward.tolist(), abs=1e-3)
    known = _Problem(environment, start, 0.2).expect(plans)
    assert [plan.value for plan in known] == pytest.approx(values, abs=1e-3)
    for episode in (0, 5):  # alone and in a batch
        alone = genie.plan(start, episode)
        assert alone.value == plans[episode].value
        assert alone.actions.tolist() == plans[episode].actions.tolist()


def test_without_fading_a_genie_keeps_to_its_plan(small):
    start = place(small.city, (0, 0), [(3, 3), (2, 0)], [9.0, 9.0], 14, 2)
    plan = Genie(small).plan(start)
    flown = fly(small, Genie(small, replan=1), start, Quiet(), record=True)
    assert [int(step.action[0]) for step in flown.history] == plan.actions.tolist()


def test_the_best_candidates_of_a_cell():
    """Three places; in the first, two sets of emptied devices, and one candidate twice."""
    place = np.array([0, 0, 0, 0, 0, 0, 1, 2])
    left = np.array([[3, 2, 2, 1, 0, 0, 5, 0], [3, 3, 3, 5, 9, 8, 5, 0]], np.float32)

    def best(beam, per_cell):
        wide = np.full(len(place), 1)
        return sorted(_best(place, left, beam * wide, per_cell * wide).tolist())

    assert best(9, 99) == [0, 1, 3, 4, 5, 6, 7]  # 2 is as 1
    assert best(1, 99) == [1, 5, 6, 7]
    assert best(2, 2) == [0, 1, 6, 7]
    assert best(2, 1) == [1, 6, 7]


def test_a_genie_called_with_a_state_takes_the_first_step_of_its_plan(small):
    state = place(small.city, (0, 0), [(2, 3)], [20.0], 14, 2)
    genie = Genie(small)
    assert genie(state).tolist() == [genie.plan(state, 0).actions[0]]


def test_plans_are_ranked_alike_however_many_groups_there_are():
    generator = stream(Use.TEST)
    group, amount = generator.integers(0, 5, 200), generator.random(200).astype(np.float32)
    many = group * 2**31  # too large to share a number with the amount
    np.testing.assert_array_equal(_ranked(group, amount), _ranked(many, amount))
    order = _ranked(group, amount)
    assert (np.diff(group[order]) >= 0).all()
    same = np.diff(group[order]) == 0
    assert (np.diff(amount[order])[same] >= 0).all()
