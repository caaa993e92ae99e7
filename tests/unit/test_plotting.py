from dataclasses import replace

import numpy as np
import pytest
from matplotlib.collections import PatchCollection
from matplotlib.colors import to_rgba
from matplotlib.figure import Figure
from matplotlib.patches import FancyArrow
from PIL import Image, ImageSequence
from strategies import renumbered

from uavdh_lite import plotting
from uavdh_lite.city import City
from uavdh_lite.environment import EAST, HOVER, LAND, WEST, Environment
from uavdh_lite.evaluation import FunctionPolicy, fly
from uavdh_lite.missions import Mission
from uavdh_lite.streams import Use, stream

DRAWN = City.from_text("drawn", "L.N\n.bB\n..B")


@pytest.fixture
def ax():
    return Figure(layout="constrained").subplots()


def flight(cities, actions, uav=(2, 0), device=(2, 2), data=1.5, city=0):
    """A flight with one device; a second place is empty."""
    environment = Environment(cities)
    own = environment.cities[city]
    start = Mission(own, uav, [device], [data], 9, max_devices=2).state
    start = renumbered(start, own.size, environment.size)
    start = replace(start, city=np.array([city], np.int16))
    actions = iter(actions)
    policy = FunctionPolicy(lambda state: np.array([next(actions)]))
    flights = fly(environment, policy, start, stream(Use.TEST, 0))
    return environment, flights.trajectory(0)


def arrows(ax):
    return [patch for patch in ax.patches if isinstance(patch, FancyArrow)]


def markers(ax):
    return [line.get_marker() for line in ax.lines]


def test_a_city_has_each_kind_of_cell_in_its_style(ax):
    plotting.draw_city(ax, DRAWN)
    drawn = [each for each in ax.collections if isinstance(each, PatchCollection)]
    assert [len(each.get_paths()) for each in drawn] == [1, 1, 1, 2]  # as in `CELL_STYLES`
    for collection, style in zip(drawn, plotting.CELL_STYLES.values(), strict=True):
        assert collection.get_hatch() == style.get("hatch")
    bottom, top = ax.get_ylim()
    assert bottom > top  # row 0, the north, is up


def test_small_maps_have_the_names_of_their_cities_whatever_these_are():
    figure = Figure()
    plotting.draw_cities(figure, [replace(DRAWN, name=r"$\frac$"), DRAWN, DRAWN], columns=2)
    plotting.pixels(figure)
    drawn = [(ax.get_title(), ax.axison) for ax in figure.axes]
    assert drawn == [(r"$\frac$", True), ("drawn", True), ("drawn", True), ("", False)]


def test_the_shadow_counts_devices_out_of_sight_and_is_never_as_dark_as_buildings(ax):
    city = City.from_text("wall", "L.B..\n..B..\n..B..\n.....\n.....")
    total = plotting.shadow_sum(Environment(city), np.array([5, 9]))  # west and east of the wall
    assert total[0, 1] == 1 and total[0, 3] == 1  # each hidden from the other side's device
    assert total[4, 2] == 0 and total[1, 2] == 2  # one sees both, the wall none
    plotting.draw_city(ax, DRAWN, shadow_sum=np.arange(9).reshape(3, 3))
    colours = np.asarray(ax.images[0].get_array())
    assert (colours[0, 0] == 1).all() and (colours[0, 1] > colours[0, 2]).all()
    assert (
        colours.min() > 0.6 > max(to_rgba(plotting.CELL_STYLES["tall building"]["facecolor"])[:3])
    )


def test_rates_are_coloured_wherever_the_uav_may_fly_and_white_below_the_limits(ax):
    environment = Environment(City.load("manhattan"))
    for limits in (None, (1e-2, 10)):
        plotting.draw_rates(ax, environment, (4, 7), limits)
        picture, rates = ax.images[-1], environment.rate_map(4 * 16 + 7)
        white = (picture.to_rgba(picture.get_array())[..., :3] == 1).all(axis=-1)
        assert (white == (rates < limits[0] if limits else False))[~environment.city.no_fly].all()


def test_a_flight_has_an_arrow_for_each_move_in_the_served_devices_colour(ax, corridor):
    environment, trajectory = flight(corridor, [EAST, EAST, HOVER, WEST, WEST, LAND])
    plotting.draw_trajectory(ax, environment, trajectory)
    drawn = arrows(ax)
    spans = [[each.get_xy()[:, 0].min(), each.get_xy()[:, 0].max()] for each in drawn]
    assert np.allclose(spans, [[0, 1], [1, 2], [1, 2], [0, 1]])
    beside = [each.get_xy()[:, 1].mean() > 2 for each in drawn]  # south of the path's row
    assert beside == [True, True, False, False]  # right of the direction of flight
    uploads = (trajectory.data_left[:-1] - trajectory.data_left[1:])[[0, 1, 3, 4]]
    expected = [plotting.device_colour(0) if each.any() else "black" for each in uploads]
    assert [each.get_facecolor() for each in drawn] == [to_rgba(colour) for colour in expected]
    assert len(set(expected)) == 2
    assert markers(ax) == ["o", "X", "^", "D"]  # hover, device, start, landing
    assert [text.get_text() for text in ax.texts] == ["2"]  # 1.5 units
    assert ax.get_xlabel().endswith(plotting.caption(trajectory))
    assert plotting.caption(trajectory) == "Time 6/9; data 1.5/1.5"


def test_the_more_a_step_uploads_the_thicker_is_its_arrow(ax, corridor):
    actions = [EAST, EAST, EAST, WEST, WEST, WEST, LAND]
    environment, trajectory = flight(corridor, actions, data=50.0)
    much = plotting.MUCH
    left = 50 - np.cumsum([0, 0, 0.01 * much, much / 2, much, 3 * much, 0, 0])
    plotting.draw_flight(ax, environment.city, replace(trajectory, data_left=left[:, None]), 5)
    reach = [np.ptp(each.get_xy()[:, 1]) for each in arrows(ax)]  # of the heads
    none, little, half, much, more, _ = reach
    assert none < little < half < much == pytest.approx(more) and none > plotting.THIN


def test_a_flight_over_a_smaller_city_of_several_is_drawn_where_it_is(ax, corridor):
    small = City.from_text("small", "L.b\nL..\nL..")
    environment, trajectory = flight((corridor, small), [EAST, WEST, LAND], (1, 0), (1, 2), city=1)
    plotting.draw_trajectory(ax, environment, trajectory)
    assert ax.get_xlim() == (-0.5, 2.5) and ax.get_ylim() == (2.5, -0.5)
    device = ax.lines[markers(ax).index("X")]
    assert (device.get_xdata()[0], device.get_ydata()[0]) == (2, 1)
    (text,) = ax.texts
    assert text.xyann[0] < 0  # the eastern border leaves no room on the other side


# Linear sRGB to XYZ over the white point D65, and to what people without the long-wave or the
# medium-wave cones see (Machado et al., 2009)
TO_XYZ = np.array([[0.4339, 0.3762, 0.1899], [0.2127, 0.7152, 0.0722], [0.0178, 0.1095, 0.8729]])
VISIONS = {
    "usual": np.eye(3),
    "protan": [[0.1523, 1.0526, -0.2049], [0.1145, 0.7863, 0.0992], [-0.0039, -0.0481, 1.0520]],
    "deutan": [[0.3673, 0.8606, -0.2280], [0.2801, 0.6725, 0.0474], [-0.0118, 0.0429, 0.9689]],
}


def cie_lab(colours, vision):
    """CIELAB of sRGB colours, (n, 3)."""
    rgb = np.array([to_rgba(colour)[:3] for colour in colours])
    linear = np.where(rgb <= 0.04045, rgb / 12.92, ((rgb + 0.055) / 1.055) ** 2.4)
    xyz = (linear @ np.transpose(VISIONS[vision])).clip(0, 1) @ TO_XYZ.T
    x, y, z = np.where(xyz > 0.008856, np.cbrt(xyz), 7.787 * xyz + 16 / 116).T
    return np.stack([116 * y - 16, 500 * (x - y), 200 * (y - z)], axis=1)


@pytest.mark.parametrize("vision", VISIONS)
@pytest.mark.parametrize(("paper", "text"), [("white", "black"), ("#111111", "#EEEEEE")])
def test_ten_devices_are_told_apart_on_light_and_on_dark_paper(paper, text, vision):
    """From each other, from the paper and from a step without uploads: CIE ΔE of 15 or more."""
    colours = [*map(plotting.device_colour, range(10)), paper, text]
    lab = cie_lab(colours, vision)
    difference = np.linalg.norm(lab[:, None] - lab, axis=-1)[np.triu_indices(12, 1)]
    assert len(difference) == 66 and difference.min() >= 15


def test_the_end_says_whether_it_landed(ax, corridor):
    environment, crashed = flight(corridor, [HOVER] * 9)
    plotting.draw_flight(ax, environment.city, crashed, 5)
    assert markers(ax)[-1] == "*"
    plotting.draw_flight(ax, environment.city, replace(crashed, time_left=crashed.time_left + 1), 5)
    assert markers(ax)[-1] is plotting.UAV  # still in the air


def test_curves_show_the_mean_and_the_range_over_runs(ax):
    steps = np.array([5, 10, 15])
    runs = [{"steps": steps, "reward": np.array([0.0, 1, 2]) + k} for k in (0, 1, 5)]
    plotting.draw_curves(ax, runs, "reward")
    assert ax.lines[0].get_ydata().tolist() == [2, 3, 4]
    low, high = ax.collections[0].get_paths()[0].get_extents().get_points()[:, 1]
    assert (low, high) == pytest.approx((0.01, 6.96))


def test_runs_with_rows_at_different_steps_are_lines_at_their_own():
    """The variant beside them has its mean, as ever."""
    steps = [5, 10, 15, 6, 12, 4, 8, 4, 8]
    values = np.arange(9.0)
    table = {
        "variant": np.array(["told"] * 5 + ["lite"] * 4),
        "seed": np.array([0, 0, 0, 1, 1, 0, 0, 1, 1]),
        "steps": np.array(steps),
        "return": values,
        "collected_and_landed": values / 10,
    }
    figure = Figure()
    plotting.draw_study(figure, table)
    drawn = [[line.get_xdata().tolist() for line in ax.lines] for ax in figure.axes]
    assert drawn == [[[5, 10, 15], [6, 12], [4, 8]]] * 2
    first, other, mean = figure.axes[0].lines
    assert np.array_equal(np.r_[first.get_ydata(), other.get_ydata()], values[:5])
    assert mean.get_ydata().tolist() == [6, 7]
    assert first.get_color() == other.get_color() != mean.get_color()
    assert [text.get_text() for text in figure.axes[0].get_legend().texts] == ["told", "lite"]


def test_the_legend_has_the_devices_of_the_map(corridor):
    """Of three, the one in the middle has no data."""
    environment = Environment(corridor)
    mission = Mission(corridor, (2, 0), [(2, 1), (2, 2), (2, 3)], [10, 0, 12], 9)
    flown = mission.fly(environment, FunctionPolicy(lambda state: np.array([HOVER])))
    figure = plotting.trajectory_figure(environment, flown.trajectory(0))
    marks = [line.get_color() for line in figure.axes[0].lines if line.get_marker() == "X"]
    devices = {
        text.get_text(): handle.get_color()
        for text, handle in zip(
            figure.legends[0].texts, figure.legends[0].legend_handles, strict=True
        )
        if text.get_text().startswith("device")
    }
    assert list(devices) == ["device 0", "device 2"] and list(devices.values()) == marks


def test_figures_are_saved_with_their_legend(corridor, tmp_path):
    figure = Figure(layout="constrained")
    plotting.draw_trajectory(figure.subplots(), *flight(corridor, [EAST, WEST, LAND]))
    plotting.add_legend(figure, 1)
    plotting.save_figure(figure, tmp_path / "f")
    assert (tmp_path / "f.png").exists()
    plotting.save_figure(figure, tmp_path / "f.pdf")
    assert (tmp_path / "f.pdf").read_bytes().startswith(b"%PDF")
    (legend,) = figure.legends
    box = legend.get_window_extent()
    assert box.x0 >= 0 and box.x1 <= figure.bbox.x1  # nothing is cut off


def test_an_animation_shows_each_step_and_waits_at_the_end(corridor, tmp_path):
    """Over a smaller city of several, it is that over the city alone."""
    moves = [EAST, WEST, LAND]
    for name, cities, city in (
        ("flight", corridor, 0),
        ("among", (City.load("village"), corridor), 1),
    ):
        environment, trajectory = flight(cities, moves, city=city)
        plotting.save_animation(environment, trajectory, tmp_path / f"{name}.gif")
    assert (tmp_path / "flight.gif").read_bytes() == (tmp_path / "among.gif").read_bytes()
    with Image.open(tmp_path / "flight.gif") as film:
        durations = [frame.info["duration"] for frame in ImageSequence.Iterator(film)]
    assert len(durations) == 4 and durations[-1] > 5 * durations[0] > 0


def test_maps_stand_three_in_a_row_with_names_and_numbers():
    maps = {"one": np.array([[0.0, -2.04], [1.5, 0.0]]), "two": np.zeros((2, 2))}
    first, second, empty = plotting.draw_maps(maps, numbers=True).axes
    assert [ax.get_title() for ax in (first, second, empty)] == ["one", "two", ""]
    assert [text.get_text() for text in first.texts] == ["0", "-2", "1.5", "0"]
    low, zero, high = (first.images[0].cmap(first.images[0].norm(v)) for v in (-2.04, 0, 2.04))
    assert low[0] > low[2] and high[2] > high[0]  # red, blue
    assert min(zero[:3]) > 0.95 and not empty.images
    assert len(plotting.draw_maps(dict.fromkeys("abcd", np.zeros((1, 1)))).axes) == 6
