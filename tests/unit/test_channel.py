import numpy as np
import pytest

from uavdh_lite.channel import Channel, link, rate, rate_map
from uavdh_lite.city import City
from uavdh_lite.environment import ACTIONS, Environment
from uavdh_lite.errors import InputError
from uavdh_lite.scenario import place


def test_link_budget_by_hand():
    """A 16×16 city: the edge is at √2 · 160 m / 2 = 113.137 m, 20.5360 dB re 1 m.

    P/σ² = −15 + 2.27 · 20.5360 = 31.6168 dB. A device 30 m away and 10 m below is at √1000 m,
    15 dB re 1 m: LoS 31.6168 − 2.27 · 15 = −2.4332 dB, NLoS 31.6168 − 3.64 · 15 = −22.9832 dB.
    """
    channel = Channel()
    assert channel.transmit_snr_db(16) == pytest.approx(31.6168, abs=1e-4)
    los, nlos = channel.mean_snr_db(np.float32([1000, 1000]), np.array([True, False]), 16)
    assert los == pytest.approx(-2.4332, abs=1e-3)
    assert nlos == pytest.approx(-22.9832, abs=1e-3)
    assert rate(los) == pytest.approx(0.6517, abs=2e-4)  # log2(1 + 0.57106)
    assert rate(nlos) == pytest.approx(0.00724, abs=1e-5)  # log2(1 + 0.00503)


def test_snr_at_the_cell_edge_is_the_given_one():
    edge_m = np.sqrt(2) * 16 * 10 / 2
    snr = Channel(cell_edge_snr_db=-7.0).mean_snr_db(np.float32([edge_m**2]), [True], 16)
    assert snr == pytest.approx(-7.0, abs=1e-4)


def test_rate_limits():
    assert rate(-np.inf) == 0
    assert rate(0.0) == 1
    assert rate(10 * np.log10(3)) == pytest.approx(2)


def test_environment_uses_the_channel_for_distances_along_the_way():
    """Hovering over the device: d = 10 m. Moving two cells' width away: d² = 100 + (10 i/4)²."""
    city = City.from_text("open", "L....\n.....\n.....\n.....\n.....")
    environment = Environment(city)
    device, here, east = np.array([[12]]), np.array([12]), np.array([13])
    quiet = np.zeros((1, 4, 1), np.float32)
    edge_db = -15 + 22.7 * np.log10(np.sqrt(2) * 50 / 2)
    hover = environment.snr_db(device, here, here, quiet)
    assert hover.shape == (1, 4, 1)
    assert hover == pytest.approx(edge_db - 22.7, abs=1e-4)
    move = environment.snr_db(device, here, east, quiet)[0, :, 0]
    expected = [edge_db - 11.35 * np.log10(100 + (2.5 * i) ** 2) for i in (1, 2, 3, 4)]
    assert move == pytest.approx(expected, abs=1e-4)


def test_fading_has_the_given_variance(generator):
    channel = Channel()
    draws = generator.standard_normal(200_000).astype(np.float32)
    assert channel.fading_db(draws, True).var() == pytest.approx(2, rel=0.02)
    assert channel.fading_db(draws, False).var() == pytest.approx(5, rel=0.02)


@pytest.mark.parametrize(
    ("field", "value"),
    [("altitude_m", 0), ("cell_size_m", -1), ("fading_variance_los_db2", -2), ("slots", 0)],
)
def test_impossible_constants_name_the_field(field, value):
    with pytest.raises(InputError, match=field):
        Channel(**{field: value})


@pytest.fixture(scope="module")
def environment():
    return Environment(City.load("manhattan"))


def test_a_link_in_sight_by_hand(environment):
    """30 m along a street, 10 m up: d² = 1000 m²; SNR = −15 + 22.7 (log 113.14 − 1.5) dB."""
    found = link(environment.city, Channel(), (4, 7), (4, 4))
    assert found.line_of_sight
    assert found.crossed.tolist() == [[4, 4], [4, 5], [4, 6], [4, 7]]
    assert found.ground_m == pytest.approx(30)
    assert found.distance_m == pytest.approx(np.sqrt(1000))
    snr_db = -15 + 22.7 * (np.log10(80 * np.sqrt(2)) - 1.5)
    assert found.snr_db == pytest.approx(snr_db, abs=1e-3)
    assert found.rate == pytest.approx(np.log2(1 + 10 ** (snr_db / 10)), abs=1e-4)
    assert found.fading_db == pytest.approx(np.sqrt(2))


def test_a_building_in_between_is_named(environment):
    found = link(environment.city, Channel(), (4, 7), (7, 4))
    assert not found.line_of_sight
    assert all(environment.city.buildings[row, col] for row, col in found.blocked_by)
    assert found.fading_db == pytest.approx(np.sqrt(5))


def test_links_agree_with_the_environment_everywhere(environment):
    """Sight and rate of every cell, from a link, a map, and an upload while hovering."""
    device, city = (4, 7), environment.city
    rates = rate_map(city, environment.channel, environment.line_of_sight, device)
    sight = environment.line_of_sight[4 * 16 + 7].reshape(16, 16)
    for cell in city.flight_cells[::7]:
        row, col = divmod(int(cell), 16)
        found = link(city, environment.channel, device, (row, col))
        assert found.line_of_sight == sight[row, col]
        assert found.rate == pytest.approx(rates[row, col], rel=1e-3, abs=1e-6)
        state = place(city, (row, col), [device], [100], 9, 5)
        quiet = np.zeros_like(environment.draw_fading(state, np.random.default_rng(0)))
        hover = np.array([ACTIONS.index("hover")])
        _, outcome = environment.transition(state, hover, quiet)
        assert outcome.uploaded[0, 0] == pytest.approx(found.rate, rel=1e-3, abs=1e-6)
