"""One link by hand, and beside what the environment computes (in single precision)."""

import numpy as np
import pytest

from uavdh_lite.channel import Channel, link, rate_map
from uavdh_lite.city import City
from uavdh_lite.environment import ACTIONS, Environment
from uavdh_lite.scenario import place


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
