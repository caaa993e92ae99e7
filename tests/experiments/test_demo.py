import numpy as np
import pytest

from uavdh_lite.experiments.demo import AGENTS, GREEDY, draw_flights, fly_all, paper_agents


@pytest.fixture(scope="module")
def all_flown():
    return [fly_all(name, 3, 0, "cpu") for name in paper_agents()]


@pytest.fixture
def flown(all_flown):
    return [(environment, next(iter(flights.values()))) for environment, flights in all_flown]


def test_all_fly_the_same_missions_over_each_city(all_flown):
    assert [environment.city.name for environment, _ in all_flown] == ["manhattan", "open_field"]
    assert list(all_flown[0][1]) == [*AGENTS, GREEDY]  # manhattan has all of them
    for _, flights in all_flown:
        for of_policy in flights.values():
            assert len(of_policy.start) == 3
            for name in ("uav_cell", "device_cells", "time_left", "data_left"):
                mine, rules = getattr(of_policy.start, name), getattr(flights[GREEDY].start, name)
                np.testing.assert_array_equal(mine, rules)


@pytest.mark.parametrize(("agents", "count"), [(2, 4), (1, 3)])
def test_the_first_flights_of_each_are_drawn(flown, agents, count):
    figure, drawn = draw_flights(flown[:agents])
    assert drawn == len(figure.axes) == count
    titles = [f"{city}, scenario {k}" for city in ("manhattan", "open_field") for k in range(2)]
    if agents == 2:
        assert [ax.get_title() for ax in figure.axes] == titles
    legend = [text.get_text() for text in figure.legends[0].get_texts()]
    assert sum(text.startswith("device") for text in legend) == 5  # manhattan has up to five
