"""A cell by numbers, for those who do not use a mouse."""

from collections.abc import Callable

import ipywidgets


class CellPicker(ipywidgets.HBox):
    """Row, column, and a button that stands for a click on that cell.

    Arguments:
        handler: called with (row, column).
    """

    def __init__(self, handler: Callable[[tuple[int, int]], None]):
        narrow = {"layout": {"width": "110px"}, "style": {"description_width": "50px"}}
        self.row = ipywidgets.BoundedIntText(description="row", min=0, max=99, **narrow)
        self.column = ipywidgets.BoundedIntText(description="column", min=0, max=99, **narrow)
        self.button = ipywidgets.Button(
            description="click there", tooltip="as a click on this cell", layout={"width": "90px"}
        )
        self.button.on_click(lambda _: handler((self.row.value, self.column.value)))
        super().__init__([self.row, self.column, self.button])
