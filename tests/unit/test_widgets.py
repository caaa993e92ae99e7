import ipywidgets
import pytest
from matplotlib.figure import Figure

from uavdh_lite.labs.widgets import explore


def draw(width, height):
    if width > height:
        raise ValueError(f"too wide: {width} <{height}>")
    return Figure(figsize=(width, height))


@pytest.fixture
def controls():
    return {
        "width": ipywidgets.IntSlider(value=2, min=1, max=9),
        "height": ipywidgets.IntSlider(value=3, min=1, max=9),
    }


def size(picture):
    """Width and height of a PNG, from its header."""
    return int.from_bytes(picture.value[16:20]), int.from_bytes(picture.value[20:24])


def test_the_picture_follows_the_controls(controls):
    *shown, message, picture = explore(draw, **controls).children
    assert shown == list(controls.values())
    assert size(picture) == (200, 300) and message.value == ""
    controls["width"].value = 3
    assert size(picture) == (300, 300)


def test_an_error_is_shown_and_the_last_picture_stays(controls):
    *_, message, picture = explore(draw, **controls).children
    controls["width"].value = 5
    assert "ValueError: too wide: 5 &lt;3&gt;" in message.value
    assert size(picture) == (200, 300)
    controls["height"].value = 5
    assert message.value == "" and size(picture) == (500, 500)
