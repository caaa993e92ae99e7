import pytest

from uavdh_lite.experiments.demo import draw_flights, fly_agent, paper_agents


@pytest.fixture(scope="module")
def flown():
    return [fly_agent(name, 3, 0, "cpu") for name in paper_agents()]


def test_each_agent_flies_over_its_own_city(flown):
    assert [environment.city.name for environment, _ in flown] == ["manhattan", "open_field"]
    assert all(len(flights.start) == 3 for _, flights in flown)


@pytest.mark.parametrize(("agents", "count"), [(2, 4), (1, 3)])
def test_the_first_flights_of_each_are_drawn(flown, agents, count):
    figure, drawn = draw_flights(flown[:agents])
    assert drawn == len(figure.axes) == count
    titles = [f"{city}, scenario {k}" for city in ("manhattan", "open_field") for k in range(2)]
    if agents == 2:
        assert [ax.get_title() for ax in figure.axes] == titles
    legend = [text.get_text() for text in figure.legends[0].get_texts()]
    assert sum(text.startswith("device") for text in legend) == 5  # manhattan has up to five
