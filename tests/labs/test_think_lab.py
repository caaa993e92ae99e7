"""The lab in which one watches an agent think: each number is the agent's, at each step."""

import numpy as np
import pytest
from driving import last

from uavdh_lite.beyond.cities import CityGenerator
from uavdh_lite.environment import ACTIONS
from uavdh_lite.labs import ThinkLab
from uavdh_lite.labs.insight import value_map
from uavdh_lite.labs.think import BELOW, FORBIDDEN
from uavdh_lite.policies import policies_for


@pytest.fixture
def lab():
    return ThinkLab("manhattan")


def bars(lab):
    """Where the bars end; 0 for those without length."""
    drawn = [bar for _, bar in lab.charts.changing]
    return [round(bar.get_x() + bar.get_width(), 4) * (bar.get_width() != 0) for bar in drawn]


def test_thoughts_are_the_agents_at_each_step(lab):
    """Also near the end of the flight, where the failsafe forbids what does not lead home."""
    states, agent = lab.charts.states, lab.charts.agent
    assert lab.stage.step == 0 and len(lab.stage.q_values) == len(states)
    forbidden = 0
    for step in (0, 5, last(lab) - 1, last(lab)):
        lab.stage.step = step
        state = states[min(step, len(states) - 1)]
        allowed = agent.environment.allowed_actions(state)[0]
        forbidden += (~allowed).sum()
        q = agent.q_values(state)[0].numpy()
        assert bars(lab)[:6] == pytest.approx(np.where(allowed, q, 0).tolist(), abs=1e-3)
        assert sum(bars(lab)[6:]) == pytest.approx(1, abs=1e-3)
        texts = [text.get_text() for text in lab.charts.numbers[: len(ACTIONS)]]
        assert [text != FORBIDDEN for text in texts] == allowed.tolist()
    assert forbidden


def test_q_values_are_drawn_on_the_map_and_their_gap_is_told(lab):
    states, agent = lab.charts.states, lab.charts.agent
    for step in (0, len(states) // 2, len(states) - 1):
        q = agent.q_values(states[step])[0]
        sizes = lab.stage.q_values[step]
        assert [size is not None for size in sizes] == q.isfinite().tolist()
        best, second = q.topk(2).indices.tolist()
        assert sizes[best] == 1 and max(size or 0 for size in sizes) == 1
        lab.stage.step = step
        assert f"Next: {ACTIONS[best]}" in lab.sentence.value
        assert f"Next: {ACTIONS[best]}" in lab.charts.canvas.picture.alt
        if step:
            (flown,) = next(iter(lab.flights.values())).history[step - 1].action
            assert f"Last step: {ACTIONS[flown]}. " in lab.sentence.value
        if q[second].isfinite():
            gap = float(q[best] - q[second])
            assert f"to {ACTIONS[second]} as the next best, is {gap:.2f}." in lab.sentence.value


def test_ranges_of_returns_are_drawn_for_agents_that_have_learned_them(lab):
    lab.stage.step = 4
    returns, (half, most) = lab.charts.returns, lab.charts.ranges
    finite = lab.charts.q.isfinite()
    assert returns.shape[1:] == (6, 32)
    assert returns.mean(2)[finite].numpy() == pytest.approx(lab.charts.q[finite].numpy(), abs=1e-3)
    (allowed,) = finite[4].nonzero(as_tuple=True)
    for lines, levels in ((half, (0.25, 0.75)), (most, (0.1, 0.9))):
        segments = np.array(lines.get_segments())
        np.testing.assert_allclose(segments[:, 0, 1], allowed.numpy() + BELOW, rtol=1e-6)
        expected = np.quantile(returns[4, allowed].numpy(), levels, axis=1).T
        assert segments[:, :, 0] == pytest.approx(expected, abs=1e-3)
    lab.policy.value = "manhattan_ddqn"
    assert lab.charts.returns is None and lab.charts.bars.get_title("left") == "Q-values"


def test_the_temperature_levels_the_policy_and_leaves_the_flight(lab):
    cold, flights, picture = bars(lab), lab.flights, lab.charts.canvas.picture.value
    lab.temperature.value = 10
    assert max(bars(lab)[6:]) < max(cold[6:]) and bars(lab)[:6] == cold[:6]
    assert lab.flights is flights and lab.charts.canvas.picture.value != picture


def test_policies_without_q_values_are_not_offered(lab):
    agents = policies_for(lab.environment)[:-3]
    assert [name for _, name in lab.policy.options] == agents
    lab.policy.value = "manhattan_ddqn_early"
    lab.city.value = "village"
    assert [name for _, name in lab.policy.options] == ["any_city"] == list(lab.flights)
    lab.stage.step = last(lab)
    assert "Last step: land. The flight is over" in lab.sentence.value


def test_a_city_without_an_agent_says_so(tmp_path):
    CityGenerator(20).draw(1, seed=3)[0].save(tmp_path / "mine.png")
    lab = ThinkLab(str(tmp_path / "mine.png"))
    assert lab.charts.agent is None and list(lab.flights) == ["greedy"]
    assert "greedy has no Q-values" in lab.charts.bars.texts[0].get_text()
    assert lab.stage.q_values == [] and lab.sentence.value == ""
    lab.stage.step = 1
    lab.closest.click()
    assert lab.stage.step == 0
    lab.city.value = "village"
    assert lab.charts.agent is not None


def test_the_axis_of_q_values_fits_them_and_says_where_it_begins(lab):
    thoughts = lab.charts
    for step in range(0, len(thoughts.states), 4):
        thoughts.show(step)
        low, high = thoughts.bars.get_xlim()
        best = thoughts.q[step].topk(3).values
        assert low < best[best.isfinite()].min() and best.max() < high
        assert bool(thoughts.begins.get_text()) == (not low < 0 < high)
    less = [text.get_text() for text in thoughts.less]
    q = thoughts.q[step]
    behind = [float(q.max() - each) for each in q.tolist()]
    assert [bool(text) for text in less] == [0 < each < np.inf for each in behind]


def test_saliency_has_the_citys_outline_and_both_maps_a_scale():
    lab = ThinkLab("village")
    lab.stage.step = 3
    thoughts, size = lab.charts, lab.environment.city.size
    row, col = divmod(int(thoughts.states[3].uav_cell[0]), size)
    middle = thoughts.agent.observation.width // 2
    buildings = lab.environment.city.buildings
    assert buildings[1:3, 4:6].all() and buildings.sum() == 8  # two of 2 × 2 cells
    lines = np.array(thoughts.outline.get_segments())
    assert len(lines) == 2 * 8
    corner = np.array((4 - 0.5 - col, 1 - 0.5 - row)) + middle
    assert (np.abs(lines - corner).sum(-1) < 1e-6).any()
    ends = [text.get_text().replace("−", "-") for text in thoughts.ends]
    worth = value_map(thoughts.agent, thoughts.states[3])
    assert ends[0] == "0.0" and float(ends[1]) > 0
    expected = [np.nanmin(worth), np.nanmax(worth)]
    assert [float(end) for end in ends[2:]] == pytest.approx(expected, abs=0.051)


def test_the_uav_is_marked_in_all_that_the_network_sees(lab):
    middle = lab.charts.agent.observation.width // 2
    for step in (0, 6):
        lab.stage.step = step
        places = [(mark.get_xdata()[0], mark.get_ydata()[0]) for mark in lab.charts.marks]
        assert places[:-1] == [(middle, middle)] * 6
        row, col = divmod(int(lab.charts.states[step].uav_cell[0]), 16)
        assert places[-1] == (col, row)


def test_the_closest_call_has_the_smallest_gap_while_there_is_data(lab):
    lab.closest.click()
    q = lab.charts.q.topk(2, dim=1).values
    gaps, states = (q[:, 0] - q[:, 1]).tolist(), lab.charts.states
    with_data = [step for step in range(len(gaps)) if states[step].data_left.sum() > 0]
    assert with_data != list(range(len(gaps)))
    assert lab.stage.step == min(with_data, key=lambda step: gaps[step])
