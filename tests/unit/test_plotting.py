import io
from dataclasses import replace

import numpy as np
import pytest
from matplotlib.collections import PatchCollection
from matplotlib.colors import to_rgba
from matplotlib.figure import Figure
from matplotlib.quiver import Quiver
from PIL import Image

from uavdh_lite.city import City
from uavdh_lite.environment import EAST, HOVER, LAND, SOUTH, WEST, Environment
from uavdh_lite.evaluation import fly
from uavdh_lite.plotting import (
    DEVICE_COLOURS,
    RED,
    TALL,
    THICK,
    THIN,
    add_legend,
    caption,
    draw_city,
    draw_curves,
    draw_flight,
    draw_layers,
    draw_trajectory,
    pixels,
    png,
    save_animation,
    save_figure,
    shadow_sum,
)
from uavdh_lite.scenario import place
from uavdh_lite.storage import read_table
from uavdh_lite.streams import Use, stream


@pytest.fixture
def figure():
    return Figure(layout="constrained")


def flight(corridor, actions, data=1.5):
    environment = Environment(corridor)
    start = place(corridor, (2, 0), [(2, 2)], [data], 9, max_devices=2)
    actions = iter(actions)
    flights = fly(
        environment,
        lambda state: np.array([next(actions)]),
        start,
        stream(Use.TEST, 0),
        record=True,
    )
    return environment, flights.trajectory(0)


def test_city_draws_each_kind_of_cell_once(figure):
    city = City.from_text("drawn", "L.N\n.bB\n..B")
    ax = draw_city(figure.subplots(), city)
    collections = [c for c in ax.collections if isinstance(c, PatchCollection)]
    assert [len(c.get_paths()) for c in collections] == [1, 1, 2, 1]  # landing, low, tall, no-fly
    bottom, top = ax.get_ylim()
    assert bottom > top  # row 0, the north, is up


def test_shadow_sum_counts_the_devices_out_of_sight():
    city = City.from_text("wall", "L.B..\n..B..\n..B..\n.....\n.....")
    environment = Environment(city)
    total = shadow_sum(environment, np.array([5, 9]))  # west and east of the wall
    assert total[0, 1] == 1 and total[0, 3] == 1  # each hidden from the other side's device
    assert total[4, 2] == 0  # sees both
    assert total[1, 2] == 2  # the wall itself


def test_trajectory_has_an_arrow_for_each_move_in_the_served_devices_colour(figure, corridor):
    environment, trajectory = flight(corridor, [EAST, EAST, HOVER, WEST, WEST, LAND])
    ax = draw_trajectory(figure.subplots(), environment, trajectory)
    arrows = [c for c in ax.collections if isinstance(c, Quiver)]
    east = [(x, u) for each in arrows for x, u in zip(each.X, each.U, strict=True) if u > 0]
    assert sorted(east) == [(0, 1), (1, 1)] and not any(each.V.any() for each in arrows)
    assert sorted(x for each in arrows for x, u in zip(each.X, each.U, strict=True) if u < 0) == [
        1,
        2,
    ]
    uploaded = trajectory.data_left[:-1, 0] - trajectory.data_left[1:, 0]
    served = [t for t in (0, 1, 3, 4) if uploaded[t] > 0]
    colours = [tuple(colour) for each in arrows for colour in each.get_facecolor().tolist()]
    assert colours.count(to_rgba(DEVICE_COLOURS[0])) == len(served) > 0
    assert colours.count(to_rgba("black")) == 4 - len(served) > 0
    markers = [line.get_marker() for line in ax.lines]
    assert markers == ["o", "X", "^", "D"]  # hover, device, start, landing
    assert caption(trajectory) == "Time 6/9; data 1.5/1.5"
    assert ax.get_xlabel() == f"column\n{caption(trajectory)}"


def test_the_more_a_step_uploads_the_thicker_is_its_arrow(figure, corridor):
    environment, trajectory = flight(corridor, [EAST, EAST, WEST, WEST, LAND], data=50.0)
    uploaded = np.array([0.0, 0.001, 1.0, 4.0, 0.0])  # by hand
    left = 50 - np.cumsum([0.0, *uploaded])
    trajectory = replace(trajectory, data_left=np.stack([left, 0 * left], axis=1))
    draw_flight(figure.subplots(), environment.city, trajectory)
    arrows = [c for c in figure.axes[0].collections if isinstance(c, Quiver)]
    widths = {each.width: len(each.U) for each in arrows}
    assert widths == pytest.approx({THIN: 1, THIN + (THICK - THIN) / 4: 2, THICK: 1})


def test_a_label_is_written_where_the_route_is_not(figure):
    city = City.from_text("open", "\n".join(["L...."] + ["....."] * 4))
    environment = Environment(city)
    start = place(city, (0, 0), [(2, 2), (0, 4)], [9.0, 9.0], 9, max_devices=2)
    around = iter([EAST, EAST, EAST, SOUTH, SOUTH, HOVER, HOVER, HOVER, HOVER])
    flights = fly(
        environment, lambda _: np.array([next(around)]), start, stream(Use.TEST), record=True
    )
    ax = draw_trajectory(figure.subplots(), environment, flights.trajectory(0))
    inside, corner = (text.xyann for text in ax.texts)
    assert inside[0] < 0  # the route passes to the north and to the east
    assert corner[0] < 0 and corner[1] < 0  # the north-eastern corner of the map has no other room


def test_shadows_are_never_as_dark_as_buildings(figure):
    city = City.from_text("drawn", "L.N\n.bB\n..B")
    ax = draw_city(figure.subplots(), city, shadow_sum=np.arange(9).reshape(3, 3) * 10)
    colours = np.asarray(ax.images[0].get_array())
    assert (colours[0, 0] == 1).all() and colours.min() > 0.6 > max(to_rgba(TALL["facecolor"])[:3])
    one, two = (draw_city(figure.subplots(), city, np.full((3, 3), n)).images[0] for n in (1, 2))
    assert (np.asarray(one.get_array()) > np.asarray(two.get_array())).all()


def test_a_crash_is_marked(figure, corridor):
    environment, trajectory = flight(corridor, [HOVER] * 9)
    ax = draw_trajectory(figure.subplots(), environment, trajectory)
    assert "*" in [line.get_marker() for line in ax.lines]


def test_curves_show_the_mean_and_the_range_over_runs(figure, tmp_path):
    (tmp_path / "a.csv").write_text("steps,reward\n5000,1\n10000,\n15000,3\n")
    run = read_table(tmp_path / "a.csv")
    assert run["steps"].tolist() == [5000, 10_000, 15_000] and np.isnan(run["reward"][1])
    runs = [{"steps": run["steps"], "reward": np.array([0.0, 1, 2]) + k} for k in (0, 1, 5)]
    ax = draw_curves(figure.subplots(), runs, "reward", label="centred")
    assert ax.lines[0].get_ydata().tolist() == [2, 3, 4]
    assert ax.lines[0].get_label() == "centred"
    low, high = ax.collections[0].get_paths()[0].get_extents().get_points()[:, 1]
    assert (low, high) == pytest.approx((0.01, 6.96))


def test_figures_are_saved_with_their_legend(figure, corridor, tmp_path):
    environment, trajectory = flight(corridor, [EAST, WEST, LAND])
    trajectory = replace(trajectory)
    draw_trajectory(figure.subplots(), environment, trajectory)
    add_legend(figure, 1)
    save_figure(figure, tmp_path / "f.png")
    save_figure(figure, tmp_path / "f.pdf")
    (legend,) = figure.legends
    box = legend.get_window_extent()
    assert box.x0 >= 0 and box.x1 <= figure.bbox.x1  # nothing is cut off
    assert (tmp_path / "f.png").read_bytes().startswith(b"\x89PNG")
    assert (tmp_path / "f.pdf").read_bytes().startswith(b"%PDF")


def test_a_png_is_of_a_figure_or_of_pixels():
    figure = Figure(figsize=(2, 3), facecolor=RED)
    assert pixels(figure).shape == (300, 200, 3)
    for picture in (figure, pixels(figure)):
        read = Image.open(io.BytesIO(png(picture)))
        assert (read.format, read.size) == ("PNG", (200, 300))
        assert read.convert("RGB").getpixel((100, 150)) == (0xC1, 0x27, 0x2D)
    assert Image.open(io.BytesIO(png(figure, dpi=50))).size == (100, 150)


def test_an_animation_has_a_frame_a_step_and_empties_the_bars(corridor, tmp_path):
    environment, trajectory = flight(corridor, [EAST, EAST, HOVER, WEST, WEST, LAND])
    save_animation(environment.city, trajectory, tmp_path / "flight.gif")
    coloured = []
    with Image.open(tmp_path / "flight.gif") as film:
        assert film.n_frames == len(trajectory.action) + 1
        assert film.info["loop"] == 0
        for frame in range(film.n_frames):
            film.seek(frame)
            picture = np.asarray(film.convert("RGB"))[:, 560:]  # right of the map: the bars
            black = (picture < 40).all(axis=-1)
            coloured.append(int(black[240:].sum()))  # the lower bar: the flying time
    assert coloured[0] > 1.5 * coloured[-1] > 0 and film.info["duration"] == 3000


def test_a_network_is_drawn_layer_by_layer_from_left_to_right(figure):
    layers = [("maps", (5, 31, 31), "red"), ("flat", (8464,), "green"), ("values", (6,), "blue")]
    ax = draw_layers(figure.subplots(), layers)
    squares = {
        colour: [p for p in ax.patches if p.get_facecolor() == to_rgba(colour)]
        for _, _, colour in layers
    }
    assert [len(found) for found in squares.values()] == [5, 1, 1]  # a square for each map
    assert {p.get_width() for p in squares["red"]} == {31}
    heights = [squares[colour][0].get_height() for colour in ("green", "blue")]
    assert heights == pytest.approx([4 * np.log2(8464), 4 * np.log2(6)])
    left = [min(p.get_x() for p in found) for found in squares.values()]
    assert left == sorted(left) and left[1] > 31
    assert [text.get_text() for text in ax.texts] == ["5×31×31\nmaps", "8464\nflat", "6\nvalues"]
    assert ax.get_xlim()[0] < 0 and max(p.get_x() for p in ax.patches) < ax.get_xlim()[1]
