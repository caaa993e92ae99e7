"""An environment whose SNRs come from a table, and what an agent is told of it."""

from dataclasses import replace

import numpy as np
import pytest

from uavdh_lite.beyond.cities import FREE, LANDING, NO_FLY
from uavdh_lite.beyond.failsafe import SafeEnvironment
from uavdh_lite.beyond.genie import Genie
from uavdh_lite.beyond.measured import (
    FLOOR_DB,
    Heard,
    MeasuredEnvironment,
    believing,
    expected,
    heard,
    levelled,
    links,
    load_gains,
    load_place,
    modelled_snr_db,
    save_gains,
    shipped_places,
)
from uavdh_lite.channel import Channel, rate
from uavdh_lite.checkpoint import load_agent
from uavdh_lite.city import City
from uavdh_lite.environment import EAST, HOVER
from uavdh_lite.errors import InputError
from uavdh_lite.evaluation import evaluate
from uavdh_lite.planners import Greedy
from uavdh_lite.scenario import Scenario
from uavdh_lite.storage import data_folder
from uavdh_lite.streams import Use, stream

VILLAGE = City.load("village")
ANY = Scenario("any", devices=(1, 3), data=(1.0, 25.0), flying_time=(20, 40))


@pytest.fixture(scope="module")
def model():
    return SafeEnvironment(VILLAGE)


def table(environment, **entries):
    """A table in which nothing is heard but these links: `d3_u5=7.0`."""
    snr_db = np.full((environment.size**2,) * 2, -np.inf)
    for link, value in entries.items():
        device, uav = (int(part[1:]) for part in link.split("_"))
        snr_db[device, uav] = value
    return MeasuredEnvironment(environment.city, mean_snr_db=snr_db)


def test_the_models_own_table_gives_the_models_world_where_the_uav_hovers(model):
    """Half-way between two cells the table is coarser."""
    world = MeasuredEnvironment(model.city, mean_snr_db=modelled_snr_db(model))
    state = ANY.sample_anywhere(model, 200, stream(Use.TEST), 0)
    draws = model.draw_fading(state, stream(Use.TEST, 1))
    ours = world.snr_db(state, state.uav_cell, draws)
    theirs = model.snr_db(state, state.uav_cell, 0 * draws)
    assert ours.dtype == np.float32 and ours == pytest.approx(theirs, abs=1e-3)
    assert world.rate_map(7) == pytest.approx(model.rate_map(7), rel=1e-4, abs=1e-6)


def test_the_table_is_read_at_the_nearest_cell_and_in_the_middle_at_the_one_being_entered(model):
    start = ANY.sample(model, 1, stream(Use.TEST))
    here = int(start.uav_cell[0])
    after = int(model.next_cell[0, here, EAST])
    assert after != here
    device = int(start.device_cells[0, 0])
    world = table(model, **{f"d{device}_u{here}": 3.0, f"d{device}_u{after}": 5.0})
    quiet = world.draw_fading(start, stream(Use.TEST))
    found = world.snr_db(start, np.array([after]), quiet)[0, :, 0]
    assert found.tolist() == [3.0, 5.0, 5.0, 5.0]


def test_nobody_hears_what_no_ray_joins_and_the_genie_knows_where_a_device_is_heard(model):
    world, start = table(model), ANY.sample(model, 1, stream(Use.TEST))
    flights = evaluate(world, Greedy(world), ANY, 20, seed=0)
    assert flights.end.landed.all() and not flights.end.collected.any()
    assert all((step.outcome.served == -1).all() for step in flights.history)
    there = int(np.flatnonzero(model.landing_distance[0] == 2)[0])
    world = table(model, **{f"d{int(start.device_cells[0, 0])}_u{there}": 30.0})
    assert Genie(world).act(start)[0] != HOVER
    assert evaluate(world, Genie(world), ANY, 10, seed=0).end.landed.all()


def test_one_offset_gives_links_in_sight_the_models_mean(model):
    generator = stream(Use.TEST)
    gain_db = modelled_snr_db(model) - 70 + generator.normal(0, 3, (model.size**2,) * 2)
    gain_db[:, ::5] = -np.inf
    snr_db = levelled(model, gain_db)
    heard_at = np.isfinite(gain_db)
    assert (
        np.ptp(snr_db[heard_at] - gain_db[heard_at]) < 1e-4 and (snr_db[~heard_at] == -np.inf).all()
    )
    known = links(model) & model.sight[0] & heard_at
    assert snr_db[known].mean() == pytest.approx(modelled_snr_db(model)[known].mean(), abs=1e-4)


def test_what_is_heard_is_the_worlds_snr_of_devices_with_data_left(model):
    world = MeasuredEnvironment(model.city, mean_snr_db=modelled_snr_db(model))
    flights = evaluate(world, Greedy(world), ANY, 15, seed=3)
    found = heard(world, flights, stream(Use.TEST))
    truth = np.maximum(world.mean_snr_db[found.device, found.uav], FLOOR_DB)
    assert found.snr_db == pytest.approx(truth, abs=1e-4)
    expected_count = sum(
        ((step.state.data_left > 0) & ~step.state.ended[:, None]).sum() for step in flights.history
    )
    assert len(found.device) == expected_count
    assert set(found.device) <= set(flights.start.device_cells[flights.start.data_initial > 0])


def measured_everywhere(world, environment):
    device, uav = np.nonzero(links(environment))
    return Heard(device, uav, world[device, uav])


def test_a_fit_finds_the_exponents_of_another_channel(model):
    """And with no spread, its map is that of the channel."""
    other = replace(model, channel=Channel(path_loss_exponent_los=1.9, path_loss_exponent_nlos=4.2))
    belief = expected(model, measured_everywhere(modelled_snr_db(other), model))
    known = links(model)
    truth = modelled_snr_db(other)
    assert belief.mean_snr_db[known] == pytest.approx(truth[known], abs=0.01)


def test_one_snr_moves_its_link_half_way_and_those_nearby_less(model):
    """With a weight n = exp(−d² / 2r²), by n / (n + 1); the spread is divided by √(n + 1).

    The belief has the rate that is expected then, here as an integral over the fading.
    """
    device, uav = 0, 9
    line = modelled_snr_db(model)
    found = Heard(np.array([device]), np.array([uav]), line[[device], [uav]] + 8)
    belief = expected(model, found, nearby_cells=1.0).mean_snr_db
    z = np.linspace(-8, 8, 4001)
    density = np.exp(-(z**2) / 2) / np.exp(-(z**2) / 2).sum()
    for cell, squared_cells in ((uav, 0), (uav + 1, 1), (uav + model.size, 1), (uav + 9, 2)):
        heard_here = np.exp(-squared_cells / 2)
        mean_db = line[device, cell] + 8 * heard_here / (heard_here + 1)
        spread_db = model.channel.fading_db(1, model.sight[0, device, cell])
        rates = rate(mean_db + spread_db / np.sqrt(heard_here + 1) * z)
        assert rate(belief[device, cell]) == pytest.approx(rates @ density, rel=1e-4)


def test_world_and_belief_are_two_things(model):
    """The agent is told the belief and flies in the world, whatever it is told."""
    agent = load_agent("any_city").over(model.city)
    start = agent.scenario.sample(model, 50, stream(Use.TEST))
    same = MeasuredEnvironment(model.city, mean_snr_db=modelled_snr_db(model))
    assert np.allclose(agent.q_values(start), believing(agent, same).q_values(start), atol=1e-3)
    deaf = believing(agent, table(model))
    assert not deaf.observation.expected_data(start).any()
    assert (deaf.q_values(start) - agent.q_values(start)).abs().nan_to_num().max() > 0.1
    told_less, told = (evaluate(same, one, agent.scenario, 100, seed=0) for one in (deaf, agent))
    assert told.returns.mean() > told_less.returns.mean() + 1
    assert told_less.end.collected.mean() > 0.1  # the world still has its radio


@pytest.mark.parametrize("name", ["florence", "munich", "paris", "san_francisco"])
def test_a_shipped_place_has_links_where_its_city_has_them(name):
    """In sight nearly always something is heard; behind buildings less, and often nothing."""
    world = load_place(name)
    assert name in shipped_places() and world.cities[0].name == name and world.size == 16
    known, sight = links(world), world.sight[0]
    heard_at = np.isfinite(world.mean_snr_db)
    assert heard_at[known & sight].mean() > 0.99 and not heard_at[~world.open_to_devices[0]].any()
    assert 0.1 < 1 - heard_at[known & ~sight].mean() < 0.6
    rates = [rate(snr_db[known]) for snr_db in (world.mean_snr_db, modelled_snr_db(world))]
    assert np.corrcoef(*rates)[0, 1] > 0.9


def test_a_place_needs_its_own_table(model, tmp_path):
    with pytest.raises(InputError, match=r"no place named 'Munich': .* florence, munich"):
        load_place("Munich")
    path, table = tmp_path / "town.png", tmp_path / "town.npz"
    model.city.save(path)
    for name in ("T.NPZ", "measured", "sub.v1"):
        save_gains(tmp_path / name, -np.ones((1, 1)), {})
        assert load_gains(tmp_path / name)[0] == -1
    complete, deaf = np.full((64, 64), -80.0), np.where(model.sight[0], -np.inf, -80.0)
    for gain_db, about, named in (
        (np.zeros((4, 4)), {}, "not the gains of town.png"),
        (deaf, {}, "not the gains of town.png .*no finite gain between two cells in sight"),
        (complete, {"cell_size_m": 20.0}, "its cell_size_m are 20.0, but 10.0 for town.png"),
    ):
        save_gains(table, gain_db, about)
        with pytest.raises(InputError, match=f"town.npz: {named}"):
            load_place(path)
    save_gains(table, -complete, {})
    with pytest.raises(InputError, match=r"town\.npz: .* a path loss is a negative gain"):
        load_gains(table)
    save_gains(table, complete, {"cell_size_m": 10.0, "scene": "Ω"})
    assert np.ptp(load_place(path).mean_snr_db) == 0 and load_gains(table)[1]["scene"] == "Ω"
    table.write_bytes(table.read_bytes()[:-30])
    with pytest.raises(InputError, match=r"town\.npz: not a table of gains"):
        load_place(path)


def test_a_place_is_flown_over_another_channel_but_not_at_another_altitude():
    weak = load_place("munich", Channel(cell_edge_snr_db=-25.0))
    assert weak.channel.cell_edge_snr_db == -25
    usual, known = load_place("munich").mean_snr_db, np.isfinite(weak.mean_snr_db)
    np.testing.assert_allclose(usual[known] - weak.mean_snr_db[known], 10, rtol=1e-4)
    for other in ({"altitude_m": 20.0}, {"cell_size_m": 5.0}):
        with pytest.raises(InputError, match=r"munich\.npz: its (altitude|cell_size)_m are 10"):
            load_place("munich", Channel(**other))


def test_a_table_of_another_city_is_refused_and_zones_may_be_painted(tmp_path):
    """By the buildings, whatever the files are called."""
    places, path = data_folder() / "places", tmp_path / "town.png"
    munich = City.load(places / "munich.png")
    kinds = munich.kinds.copy()
    kinds[tuple(np.argwhere(kinds == FREE)[:20].T)] = NO_FLY
    painted = City.from_kinds("painted", kinds)
    gain_db, about = load_gains(places / "munich.npz")
    save_gains(tmp_path / "town.npz", gain_db, about)
    for city in (munich, painted):
        city.save(path)
        assert np.isfinite(load_place(path).mean_snr_db).any()
    kinds = munich.kinds.copy()
    kinds[tuple(np.argwhere(kinds == LANDING)[0])] = FREE
    City.from_kinds("painted", kinds).save(path)
    with pytest.raises(InputError, match=r"town\.npz: .*no gain of a device at row "):
        load_place(path)
    City.load(places / "paris.png").save(path)
    with pytest.raises(InputError, match=r"town\.npz: its buildings are .* town"):
        load_place(path)
