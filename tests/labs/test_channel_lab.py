"""The lab of the radio channel: one link in all its parts, and the constants."""

import re

import numpy as np
import pytest
from driving import open_tab, pick, point, stroke

from uavdh_lite.channel import Channel, rate
from uavdh_lite.environment import HOVER
from uavdh_lite.labs import ChannelLab, Labs
from uavdh_lite.labs.channel import plain
from uavdh_lite.labs.link import link
from uavdh_lite.missions import environment_of, place


def test_a_link_by_hand():
    """30 m along a street, 10 m up: d² = 1000 m²; SNR = −15 + 22.7 (log 113.14 − 1.5) dB."""
    city = environment_of("manhattan").city
    found = link(city, Channel(), (4, 7), (4, 4))
    assert found.line_of_sight and found.ground_m == pytest.approx(30)
    assert found.crossed.tolist() == [[4, 4], [4, 5], [4, 6], [4, 7]]
    snr_db = -15 + 22.7 * (np.log10(80 * np.sqrt(2)) - 1.5)
    assert found.snr_db == pytest.approx(snr_db, abs=1e-3)
    assert found.fading_db == pytest.approx(np.sqrt(2))
    found = link(city, Channel(), (4, 7), (7, 4))
    assert not found.line_of_sight and found.fading_db == pytest.approx(np.sqrt(5))
    assert all(city.buildings[row, col] for row, col in found.blocked_by)


def test_links_agree_with_the_environment():
    """Sight and rate of a cell, from a link, and from an upload while the UAV hovers."""
    environment, device = environment_of("manhattan"), (4, 7)
    city = environment.city
    for cell in np.flatnonzero(~city.no_fly)[::7]:
        found = link(city, environment.channel, device, divmod(int(cell), 16))
        assert found.line_of_sight == environment.sight[0, 4 * 16 + 7, cell]
        state = place(city, divmod(int(cell), 16), [device], [100], 9, 5)
        quiet = np.zeros_like(environment.draw_fading(state, np.random.default_rng(0)))
        _, outcome = environment.transition(state, np.array([HOVER]), quiet)
        assert outcome.uploaded[0, 0] == pytest.approx(found.rate, rel=1e-3, abs=1e-6)


def test_the_lab_follows_clicks_and_sliders():
    lab = ChannelLab("manhattan")

    def click_map(cell):
        point(lab.canvas, lab.map, cell, "down", pressed=True)

    click_map((4, 7))
    lab.click.value = "UAV"
    click_map((4, 4))
    assert (lab.device, lab.uav) == ((4, 7), (4, 4))
    assert "line of sight" in lab.numbers.value and "0.65 data units" in lab.numbers.value
    assert "device in cell (4, 7), UAV over (4, 4)" in lab.canvas.picture.alt
    for sentence in re.findall("<div>(.*?)</div>", lab.numbers.value):
        assert sentence in lab.canvas.picture.alt
    picture = lab.canvas.picture.value
    click_map((7, 4))
    assert "no line of sight" in lab.numbers.value and lab.canvas.picture.value != picture
    blocked = lab.numbers.value
    lab.constants["path_loss_exponent_nlos"].value = 5
    assert lab.numbers.value != blocked
    lab.constants["fading_nlos_db"].value = 3
    assert "± 3.0 dB" in lab.numbers.value
    assert len(lab.map.lines) == len(lab.curve.lines) == len(lab.bar.texts) == 0  # nothing piles up
    assert lab.bar.images[0].get_cmap().name == lab.rates.get_cmap().name
    assert lab.bar.images[0].get_array()[0] == 1  # the largest is at the top
    lab.city.value = "village"
    assert lab.uav == (0, 0)


def test_a_drag_takes_what_is_under_the_mouse_and_the_boxes_follow():
    lab = ChannelLab("village")

    def move(start, *cells):
        point(lab.canvas, lab.map, start, "down", pressed=True)
        for cell in cells:
            point(lab.canvas, lab.map, cell, "move", pressed=True)

    device, uav = lab.device, lab.uav
    assert (lab.click.value, lab.picker.row.value) == ("device", device[0])
    move(uav, (3, 0), (5, 0))
    assert (lab.device, lab.uav) == (device, (5, 0))
    move(device, (7, 7), (7, 9.5), (6, 7))  # beyond the map and back
    assert (lab.device, lab.uav) == ((6, 7), (5, 0))
    move((0, 3), (0, 4))  # begins at neither: what is chosen
    assert (lab.device, lab.uav) == ((0, 4), (5, 0))
    lab.click.value = "UAV"
    assert (lab.picker.row.value, lab.picker.column.value) == (5, 0)
    move((0, 5), (5, 0), (0, 4))
    assert lab.device == lab.uav == (0, 4)
    move((0, 4), (2, 0))  # both: what is chosen
    assert (lab.device, lab.uav) == ((0, 4), (2, 0))
    for cell in ((-1, 3), (3, 8)):  # outside
        lab.clicked(cell)
        assert lab.uav == (2, 0)


def test_cells_are_picked_by_numbers():
    lab = ChannelLab("village")
    pick(lab, 1, 4)
    assert "devices do not stand on buildings" in lab.numbers.value
    pick(lab, 3, 5)
    assert lab.device == (3, 5) and "In a mission" not in lab.numbers.value
    pick(lab, 50, 5)  # outside: the last row
    assert lab.device == (7, 5)


def test_the_lab_says_how_far_a_device_is_heard_and_what_the_mouse_points_at():
    lab = ChannelLab("manhattan")
    city = lab.environment.city
    for sight in (True, False):
        squared = np.float32(lab.reach(sight) ** 2 + lab.channel.altitude_m**2)
        snr_db = lab.channel.transmit_snr_db(16) - lab.channel.path_loss_db(squared, sight)
        assert rate(snr_db) == pytest.approx(0.1, rel=1e-3)
        assert f"{lab.reach(sight):.0f} m" in lab.numbers.value
    lab.constants["altitude_m"].value = 100
    assert "nowhere behind a building" in lab.numbers.value
    lab.paper.click()
    lab.click.value = "UAV"
    lab.clicked((8, 4))
    told = re.search(r"([\d.]+) data units a slot", lab.numbers.value)[1]
    point(lab.canvas, lab.map, (8, 4), "move")
    assert f"row 8, column 4: {told} data units a slot" in lab.seen.value
    lab.look_at(lab.curve, 3.0, 3.0)
    assert lab.seen.value == ""
    shown = lab.rates.get_array()
    assert (shown.mask == (city.buildings & city.no_fly)).all()  # the radio passes no-fly zones


def test_the_channel_goes_back_to_the_paper_and_axes_follow_the_rates():
    lab = ChannelLab("village")
    paper, low = lab.channel, lab.curve.get_ylim()[1]
    lab.constants["cell_edge_snr_db"].value = 10
    assert lab.channel != paper and lab.curve.get_ylim()[1] > 2 * low
    lab.paper.click()
    assert lab.channel == paper and lab.curve.get_ylim()[1] == low
    lab.logarithmic.value = True
    low, high = lab.curve.get_ylim()
    assert lab.curve.get_yscale() == "log" and 0 < low < 1e-3 < high
    said = [text.get_text().strip() for text in lab._draw_scale(lab.rates.get_clim()[1])]
    assert said[:-1] == ["0.00001", "0.0001", "0.001", "0.01", "0.1"]
    dark, bright = (lab.rates.cmap(lab.rates.norm(each)) for each in (0.0005, 0.05))
    assert np.abs(np.subtract(dark, bright)).max() > 0.3  # a cell in a shadow is not like the rest
    lab.logarithmic.value = False
    assert lab.curve.get_ylim()[0] == 0


def test_small_rates_are_written_plainly():
    said = {3.1415: "3.14", 0.652: "0.65", 0.000451: "0.0005", 1e-5: "0.00001", 1e-9: "0", 0.0: "0"}
    assert {value: plain(value) for value in said} == said


def test_links_are_traced_in_a_painted_city():
    page = Labs()
    lab = open_tab(page, "Channel")
    lab.city.value = "my city"
    assert "no city of yours yet" in lab.message.value and lab.city.value == "manhattan"
    stroke(open_tab(page, "City"), (7, 6))
    open_tab(page, "Channel")
    lab.city.value = "my city"
    assert lab.environment.city.buildings[7, 6] and lab.message.value == ""
    assert "Rates over my_city" in lab.canvas.picture.alt
