"""Many cities at once: every episode goes on as it would over its city alone."""

from contextlib import closing
from dataclasses import fields, replace

import numpy as np
import pytest
import torch
from matplotlib.figure import Figure

from uavdh_lite.agent import value_map
from uavdh_lite.channel import Channel
from uavdh_lite.checkpoint import load_agent, save_agent
from uavdh_lite.city import Cities, City
from uavdh_lite.city_generator import CityGenerator
from uavdh_lite.environment import Environment, Rewards, State
from uavdh_lite.errors import CityError, InputError
from uavdh_lite.evaluation import alone, evaluate, fly
from uavdh_lite.observation import Observation
from uavdh_lite.planners import Genie, Greedy
from uavdh_lite.plotting import draw_cities
from uavdh_lite.replay import Replay
from uavdh_lite.scenario import Scenario
from uavdh_lite.streams import Use, stream
from uavdh_lite.training import OverlappedTrainer, Trainer

SCENARIO = Scenario("any", devices=(1, 4), data=(2.0, 15.0), flying_time=(10, 40))
SMALL = City.from_text("small", "L . \n . b")
LARGE = City.from_text("large", ". N L \n . . . \n B . .")
BOTH = Cities((SMALL, LARGE))


def drawn(*sizes, each=4):
    """A few random cities of each size, in turns."""
    sets = [CityGenerator((size, size)).draw(each, seed=1).cities for size in sizes]
    return Cities(tuple(city for turn in zip(*sets, strict=True) for city in turn))


def equal(first, second):
    return all(
        np.array_equal(getattr(first, field.name), getattr(second, field.name))
        for field in fields(first)
    )


def over_each(environment, state):
    """For each city: which episodes are in it, its environment, and their states there."""
    where = environment.cities.city[state.uav_cell]
    for index in np.unique(where):
        rows = np.flatnonzero(where == index)
        yield rows, *environment.alone(state[rows])


def test_cells_are_numbered_on_from_city_to_city():
    assert len(BOTH) == 2 and BOTH[1] is LARGE and BOTH.size == 3
    assert BOTH.sizes.tolist() == [2, 3] and BOTH.first_cell.tolist() == [0, 4]
    assert BOTH.city.tolist() == [0] * 4 + [1] * 9
    assert BOTH.row.tolist() == [0, 0, 1, 1, 0, 0, 0, 1, 1, 1, 2, 2, 2]
    assert BOTH.col.tolist() == [0, 1, 0, 1, 0, 1, 2, 0, 1, 2, 0, 1, 2]
    assert np.flatnonzero(BOTH.landing).tolist() == [0, 6]
    assert np.flatnonzero(BOTH.buildings).tolist() == [3, 10]
    assert np.flatnonzero(BOTH.no_fly).tolist() == [5, 10]
    assert BOTH.landing_distance.tolist() == [0, 1, 1, 2, 4, -1, 0, 3, 2, 1, -1, 3, 2]
    cells, starts, counts = BOTH.device_cells
    assert cells.tolist() == [1, 2, 4, 5, 7, 8, 9, 11, 12]
    assert (starts.tolist(), counts.tolist()) == ([0, 2], [2, 7])


def test_moves_stay_in_the_city():
    next_cell, forbidden = Environment(BOTH).next_cell, Environment(BOTH).forbidden
    assert next_cell[3].tolist() == [1, 3, 3, 2, 3, 3], "no way on to the next city's cells"
    assert next_cell[4].tolist() == [4, 4, 7, 4, 4, 4], "nor back; east of it is no-fly"
    assert forbidden[4].tolist() == [True, True, False, True, False, True]
    assert next_cell[7].tolist() == [4, 8, 7, 7, 7, 7]


def test_cells_take_four_bytes_where_two_are_too_few():
    assert BOTH.cell_type == np.int16
    many = Cities((LARGE,) * 4000)
    assert many.cell_type == np.int32
    state = SCENARIO.sample(many, 50, stream(Use.TEST))
    after, _ = Environment(many).step(state, np.full(50, 2), stream(Use.TEST))
    assert state.uav_cell.dtype == after.uav_cell.dtype == state.device_cells.dtype == np.int32
    assert state.uav_cell.max() > 2**15, "the last cities are drawn, too"
    replay = Replay(100, 50, 4, many.cell_type)
    replay.add(state, np.zeros(50), np.zeros(50), after.ended, after)
    batch = replay.sample(50, stream(Use.TEST), 0.9)
    assert np.array_equal(batch.state.uav_cell, state.uav_cell)
    assert np.array_equal(batch.next_state.device_cells, after.device_cells)


@pytest.mark.parametrize("failsafe", [False, True])
@pytest.mark.parametrize(
    "sizes, method", [((12,), "exact"), ((8, 13), "exact"), ((9,), "bresenham")]
)
def test_every_step_is_that_over_the_city_alone(failsafe, sizes, method):
    cities = drawn(*sizes)
    environment = Environment(cities, Channel(slots=3), method, failsafe)
    generator = stream(Use.TEST, 2)
    state = SCENARIO.sample(cities, 120, generator)
    cases = [(rows, single) for rows, single, _ in over_each(environment, state)]
    assert len(cases) == len(cities)
    sent_home = 0
    for _ in range(40):
        action = generator.choice(6, 120, p=[0.22, 0.22, 0.22, 0.22, 0.1, 0.02])
        fading = environment.draw_fading(state, generator)
        after, outcome = environment.transition(state, action, fading)
        allowed, reward = environment.allowed_actions(state), Rewards()(outcome)
        for rows, single in cases:
            there, found = (environment.alone(one[rows])[1] for one in (state, after))
            expected, expected_outcome = single.transition(there, action[rows], fading[rows])
            assert equal(found, expected)
            assert all(
                np.array_equal(getattr(outcome, f.name)[rows], getattr(expected_outcome, f.name))
                for f in fields(outcome)
            )
            assert np.array_equal(reward[rows], Rewards()(expected_outcome))
            assert np.array_equal(allowed[rows], single.allowed_actions(there))
        sent_home += outcome.sent_home.sum()
        state = after
    assert state.ended.all() and (sent_home > 0) == failsafe
    assert (state.landed.all()) == failsafe


def test_greedy_flies_as_over_the_city_alone():
    cities = drawn(8, 11)
    environment = Environment(cities)
    state = SCENARIO.sample_anywhere(cities, 300, stream(Use.TEST), spare_time=3)
    action = Greedy(environment)(state)
    for rows, single, there in over_each(environment, state):
        assert np.array_equal(action[rows], Greedy(single)(there))
    flights = fly(environment, Greedy(environment), state, stream(Use.TEST))
    assert flights.end.landed.all()


def test_a_set_of_one_city_is_that_city():
    city = drawn(10, each=1)[0]
    for sample in ("sample", "sample_anywhere"):
        spare = {} if sample == "sample" else {"spare_time": 2}
        given, alone_in_set = (
            getattr(SCENARIO, sample)(over, 40, stream(Use.TEST), **spare)
            for over in (city, Cities((city,)))
        )
        assert equal(given, alone_in_set)
    assert Cities((city,)).fingerprint == city.fingerprint
    assert Cities((city,)).name == city.name and BOTH.name == "2 cities"
    others = (SMALL, LARGE, Cities((SMALL, SMALL)), Cities((LARGE, SMALL)))
    assert BOTH.fingerprint not in [other.fingerprint for other in others]


def test_every_episode_is_in_one_city_and_all_cities_are_equally_likely():
    cities = drawn(8, 12, each=2)
    state = SCENARIO.sample(cities, 4000, stream(Use.TEST))
    where = cities.city[state.uav_cell]
    assert (cities.city[state.device_cells] == where[:, None]).all()
    assert cities.landing[state.uav_cell].all()
    assert not (cities.buildings | cities.landing)[state.device_cells].any()
    assert all(len(set(cells)) == len(cells) for cells in state.device_cells.tolist())
    assert np.abs(np.bincount(where) / 4000 - 1 / 4).max() < 0.03
    for index in range(4):  # every cell for devices comes up, in the smaller cities, too
        own = cities.device_cells.cells[cities.city[cities.device_cells.cells] == index]
        found = np.unique(state.device_cells[where == index])
        assert np.array_equal(found, own)
    anywhere = SCENARIO.sample_anywhere(cities, 4000, stream(Use.TEST), spare_time=2)
    assert (cities.landing_distance[anywhere.uav_cell] >= 0).all()
    assert (cities.city[anywhere.device_cells] == cities.city[anywhere.uav_cell, None]).all()


def test_too_many_devices_for_the_smallest_city_is_an_error_that_names_it():
    with pytest.raises(InputError, match="up to 4 devices, but small has 2 cells"):
        SCENARIO.sample(BOTH, 5, stream(Use.TEST))


@pytest.mark.parametrize("kind", ["centred", "non_centred", "global_local"])
def test_maps_are_those_of_the_city_alone(kind):
    cities = drawn(9)
    options = {"data_scale": 15.0, "time_scale": 40.0, "local_size": 5}
    state = SCENARIO.sample_anywhere(cities, 60, stream(Use.TEST), spare_time=3)
    maps, time = Observation(cities, kind, **options)(state)
    for rows, single, there in over_each(Environment(cities), state):
        expected, expected_time = Observation(single.city, kind, **options)(there)
        assert all(torch.equal(a[rows], b) for a, b in zip(maps, expected, strict=True))
        assert torch.equal(time[rows], expected_time)


@pytest.mark.parametrize("kind", ["centred", "non_centred"])
def test_a_smaller_city_lies_in_no_fly_cells(kind):
    cities = drawn(8, 13, each=1)
    state = SCENARIO.sample_anywhere(cities, 60, stream(Use.TEST), spare_time=3)
    rows = np.flatnonzero(cities.city[state.uav_cell] == 0)
    (maps,), _ = Observation(cities, kind)(state)
    environment, there = Environment(cities).alone(state[rows])
    (own,), _ = Observation(environment.city, kind)(there)
    assert maps.shape[-1] == 25 and own.shape[-1] == 15
    assert torch.equal(maps[rows][:, :, 5:20, 5:20], own)
    outside = maps[rows].clone()
    outside[:, 1, 5:20, 5:20] = 1
    outside[:, [0, *range(2, maps.shape[1])], 5:20, 5:20] = 0
    assert (outside[:, 1] == 1).all() and outside.sum() == outside[:, 1].sum()


def test_a_flight_is_drawn_over_its_own_city():
    cities = drawn(8, 10, each=2)
    environment = Environment(cities)
    flights = evaluate(environment, Greedy(environment), SCENARIO, 6, seed=0, record=True)
    for episode in range(6):
        trajectory = flights.trajectory(episode)
        single, flown = alone(environment, trajectory)
        assert single.city is cities[cities.city[trajectory.uav_cell[0]]]
        assert flown.start.uav_cell[0] == flown.uav_cell[0]
        assert np.array_equal(cities.within[trajectory.uav_cell], flown.uav_cell)
        assert alone(single, flown) == (single, flown)


def test_a_folder_of_cities_is_read_in_the_order_of_their_names(tmp_path):
    with pytest.raises(CityError, match="no PNG files in it"):
        Cities.load(tmp_path)
    SMALL.save(tmp_path / "b.png")
    LARGE.save(tmp_path / "a.png")
    cities = Cities.load(tmp_path)
    assert [city.name for city in cities.cities] == ["a", "b"]
    assert cities.fingerprint == Cities((LARGE, SMALL)).fingerprint


def test_what_is_of_a_single_city_says_so():
    environment = Environment(BOTH)
    with pytest.raises(InputError, match=r"single city.*over\(index\)"):
        environment.line_of_sight  # noqa: B018
    one = Scenario("one", devices=(1, 1)).sample(BOTH, 20, stream(Use.TEST))
    with pytest.raises(InputError, match="in 2 cities"):
        environment.alone(one)
    with pytest.raises(CityError, match="at least one"):
        Cities(())
    assert isinstance(environment.over(1).city, City)
    assert isinstance(one, State)


@pytest.mark.long
def test_the_genie_plans_each_episode_over_its_own_city():
    environment = Environment(drawn(8, 10))
    start = SCENARIO.sample(environment.cities, 40, stream(Use.TEST))
    flights = fly(environment, Genie(environment), start, stream(Use.TEST), record=True)
    plans = Genie(environment).plans(start)
    assert flights.end.landed.all() and len(set(environment.cities.city[start.uav_cell])) == 8
    for rows, one, own_start in over_each(environment, start):
        own = Genie(one).plans(own_start)
        for row, plan in zip(rows, own, strict=True):
            assert np.array_equal(plans[row].actions, plan.actions)
            assert plans[row].value == plan.value
    greedy = fly(environment, Greedy(environment), start, stream(Use.TEST))
    assert flights.end.collection_ratio.mean() > greedy.end.collection_ratio.mean()


def test_memory_is_a_bit_for_each_pair_of_cells_and_one_wide_map_for_each_city():
    cities = drawn(8, 9, each=3)
    environment = Environment(cities)
    environment.step(
        SCENARIO.sample(cities, 9, stream(Use.TEST)), np.zeros(9, int), stream(Use.TEST)
    )
    bits, *_ = environment._sight_bits
    assert bits.nbytes == 3 * 64 * 8 + 3 * 81 * 11  # rows of whole bytes
    (wide,) = Observation(cities).buffers()
    assert wide.numel() * wide.element_size() == 6 * 3 * 25 * 25


@pytest.fixture
def begin(quick):
    """A function that begins a quick run over eight random cities."""
    recipe = replace(quick, steps=1200, failsafe=True, quantiles=4, huber_delta=1.0)
    scenario = Scenario("any", devices=(1, 2), data=(2.0, 15.0), flying_time=(10, 30))
    return lambda trainer=Trainer: trainer(scenario, recipe, 0, drawn(8, 9))


def weights(trainer):
    return torch.cat([p.detach().flatten() for p in trainer.learner.online.parameters()])


@pytest.mark.long
def test_a_training_over_many_cities_resumes_to_the_same_weights(begin, tmp_path):
    whole, stopped, resumed, overlapped = begin(), begin(), begin(), begin(OverlappedTrainer)
    with closing(overlapped):
        while not whole.finished:
            whole.step()
            overlapped.step()
    while stopped.steps < 500:
        stopped.step()
    stopped.save(tmp_path / "run")
    resumed.restore(tmp_path / "run")
    while not resumed.finished:
        resumed.step()
    assert torch.equal(weights(whole), weights(resumed))
    assert torch.equal(weights(whole), weights(overlapped))
    batch = whole.replay.sample(500, stream(Use.TEST), 0.9, 1)
    assert len(np.unique(whole.environment.cities.city[batch.state.uav_cell])) == 8


def test_an_agent_of_many_cities_comes_back_and_flies_others(begin, tmp_path):
    agent = begin().agent
    save_agent(tmp_path / "agent.safetensors", agent)
    loaded = load_agent(tmp_path / "agent.safetensors")
    assert loaded.city.fingerprint == agent.city.fingerprint
    assert [city.name for city in loaded.city.cities] == [city.name for city in agent.city.cities]
    state = agent.scenario.sample(agent.city, 50, stream(Use.TEST))
    assert loaded.symmetric and not agent.symmetric
    assert torch.equal(replace(loaded, symmetric=False).q_values(state), agent.q_values(state))
    own = loaded.city[0]
    over, rows = (
        loaded.over(own),
        np.flatnonzero(loaded.environment.cities.city[state.uav_cell] == 0),
    )
    assert own.size == 8 and loaded.city.size == 9  # so its own city lies in no-fly cells
    expected = loaded.q_values(state)[rows]
    alone = over.q_values(loaded.environment.alone(state[rows])[1])
    torch.testing.assert_close(alone, expected)
    new = CityGenerator((8, 8)).draw(1, seed=9)[0]
    assert loaded.knows(new) and loaded.knows(own) and over.knows(new)
    assert evaluate(
        loaded.over(new).environment, loaded.over(new), agent.scenario, 5, 0
    ).end.landed.all()
    large = CityGenerator((10, 10)).draw(1, seed=9)[0]
    assert not loaded.knows(large)
    with pytest.raises(InputError, match="cities of up to 9 cells"):
        loaded.over(large)


def test_an_agent_of_one_city_knows_no_other(corridor, quick):
    agent = Trainer(Scenario("corridor", devices=(1, 1)), quick, 0, corridor).agent
    assert agent.knows(corridor) and not agent.knows(SMALL) and agent.over(SMALL).city is SMALL


def test_what_needs_one_city_says_so(begin):
    agent = begin().agent
    with pytest.raises(CityError, match=r"8 cities: name one of them, or another \(--city\)"):
        value_map(agent, agent.scenario.sample(agent.city, 1, stream(Use.TEST)))


def test_an_environment_of_one_city_is_alone_already():
    environment = Environment(LARGE)
    state = SCENARIO.sample(LARGE, 3, stream(Use.TEST))
    assert environment.alone(state) == (environment, state)


def test_a_page_of_cities_leaves_the_rest_of_its_places_empty():
    figure = Figure()
    draw_cities(figure, Cities((SMALL, LARGE, SMALL)), columns=2)
    assert [ax.axison for ax in figure.axes] == [True, True, True, False]


def test_an_agent_is_fine_tuned_over_one_city_from_its_own_weights(begin, quick):
    agent, city = begin().agent, CityGenerator((8, 8)).draw(1, seed=9)[0]
    run = Trainer(agent.scenario, agent.recipe, 1, city, begin_with=agent)
    start = agent.scenario.sample(city, 30, stream(Use.TEST))
    expected = agent.over(city).q_values(start)
    assert torch.equal(run.agent.q_values(start), expected)
    assert run.agent.observation.size == 9 and not run.agent.knows(agent.city)
    assert agent.training["symmetric"] and not run.agent.training["symmetric"]
    tuned = Trainer(
        agent.scenario, agent.recipe, 1, city, begin_with=replace(agent, symmetric=True)
    )
    assert tuned.agent.training["symmetric"]
    before = weights(run).clone()
    while run.updates < 3:
        run.step()
    assert not torch.equal(weights(run), before)
    assert torch.equal(agent.over(city).q_values(start), expected)  # it keeps its own weights
    other = replace(agent.recipe, hidden=(7,), quantiles=5)
    with pytest.raises(InputError, match=r"hidden is .* there, \(7,\) here; quantiles is 4 there"):
        Trainer(agent.scenario, other, 1, city, begin_with=agent)
