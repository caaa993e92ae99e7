"""The hands of a person at the labs: clicks, drags, keys and files, without a browser."""

import base64
import datetime
import html
import io
import re

import numpy as np
from PIL import Image


def pixels(widget):
    """What a picture shows, (height, width, 3)."""
    return np.asarray(Image.open(io.BytesIO(widget.value)).convert("RGB")).astype(int)


def tell(widget, **told):
    """A message from the widget's part in the browser."""
    widget._handle_custom_msg(told, [])


def drag(lab, start, end):
    """The mouse pressed in a cell of a map and released in another."""
    tell(lab.stage, kind="drop", **{"from": list(start), "to": list(end)})


def click(lab, cell):
    drag(lab, cell, cell)


def key(lab, name):
    """A key that steers."""
    tell(lab.stage, kind="key", key=name)


def point(canvas, ax, cell, kind="click", pressed=False):
    """The mouse over the middle of a cell that is drawn in an Axes."""
    x, y = ax.transData.transform((cell[1], cell[0]))
    tell(canvas.picture, kind=kind, x=x, y=canvas.figure.bbox.height - y, pressed=pressed)


def stroke(lab, cell, kind="down", pressed=True):
    """The mouse over a cell of the city that is painted."""
    point(lab.canvas, lab.ax, cell, kind, pressed)


def pick(lab, row, column):
    """A click by numbers instead of the mouse."""
    lab.picker.row.value, lab.picker.column.value = row, column
    lab.picker.button.click()


def upload(lab, data, name="<i>.x"):
    """A file that was chosen in the browser's dialog; its name is somebody else's."""
    lab.upload.value = [
        {
            "name": name,
            "type": "",
            "size": len(data),
            "content": memoryview(data),
            "last_modified": datetime.datetime(2026, 1, 1, tzinfo=datetime.UTC),
        }
    ]


def open_tab(page, title):
    """Show a lab of the page, and give it."""
    page.selected_index = page.titles.index(title)
    return page.made[title]


def link_of(lab):
    """What stands behind the # of the link that the lab offers."""
    return html.unescape(re.search('href="#([^"]*)"', lab.take_home.value)[1])


def file_of(lab):
    """The file that the lab offers."""
    return base64.b64decode(lab.take_home.value.split("base64,")[1].split('"')[0])


def set_by(mission):
    """What a mission consists of, but for its city."""
    return mission.start, mission.devices, mission.data, mission.flying_time, mission.seed


def last(lab):
    """The last step of the flights that are shown."""
    return max(int(flights.steps[0]) for flights in lab.flights.values())
