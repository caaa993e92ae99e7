"""All labs on one page with a tab for each; a lab is made when its tab is first opened."""

from uavdh_lite.city import City
from uavdh_lite.errors import InputError, extra
from uavdh_lite.labs.channel import ChannelLab
from uavdh_lite.labs.city import ADDRESS as CITY
from uavdh_lite.labs.city import CityLab
from uavdh_lite.labs.fly import FlyLab
from uavdh_lite.labs.menu import CityMenu
from uavdh_lite.labs.mission import ADDRESS as MISSION
from uavdh_lite.labs.mission import MissionLab
from uavdh_lite.labs.think import ThinkLab
from uavdh_lite.labs.training import TrainingLab
from uavdh_lite.labs.widgets import introduced

with extra("notebooks"):
    import anywidget
    import ipywidgets
    import traitlets

LABS = {  # for each title: how the page makes the lab, what it is about, and what it is for
    "Mission": (
        lambda page: MissionLab(painted=page.painted, linked=True),
        "Drag the devices and the start on the map, and a bar's right end for more data or time. "
        "Point at a device to see its radio shadow. Then play.",
        "Set a mission on the map, and compare up to three policies that fly it",
    ),
    "Watch it think": (
        lambda page: ThinkLab(painted=page.painted),
        "At each step of a flight: the Q-value of each action, as an arrow and as a bar, the "
        "softmax policy, what the network sees, and what matters most.",
        "See what an agent computes at each step of a flight, and what it looks at",
    ),
    "Fly it yourself": (
        lambda page: FlyLab(painted=page.painted),
        "Collect as much as you can and land in time. Then see how the agents and planners do on "
        "the same mission with the same fading.",
        "Steer the UAV with buttons or keys, and see who is better",
    ),
    "Channel": (
        lambda page: ChannelLab(painted=page.painted),
        "How much data a device can send to the UAV in one slot, and what buildings between them "
        "do to it.",
        "See how far the radio reaches, and what buildings do to it",
    ),
    "Training": (
        lambda page: TrainingLab(),
        "A small agent learns a small city in half a minute. Change a setting, start a new run, "
        "and compare it with the dotted curves of the last one, or let both race. Click a curve to "
        "see how the agent flew at that time.",
        "Watch a small agent learn, and see what a setting changes",
    ),
    "City": (
        lambda page: CityLab(linked=True),
        "Paint a city and let an agent fly in it that has never seen it. It learned among blocks, "
        "houses, lanes and courtyards; long walls are hard for it. Can you draw a city in which "
        "the greedy rule fails?",
        "Paint a city of your own, and fly in it here and in the other labs",
    ),
}


LINKS = {CITY: "City", MISSION: "Mission"}  # which lab opens what stands in an address
WATCHED = {  # what is lost if one leaves the page: in which lab, and what `Address` calls it
    "City": ("unsaved", "painted"),
    "Training": ("running", "training"),
}


class Address(anywidget.AnyWidget):
    """What stands behind the # in the page's address, as `value`; it takes no room on the page.

    While leaving the page would lose work, the page has `data-unsaved`; its template asks then.

    | trait | meaning |
    | --- | --- |
    | `painted` | a painted city, as in a link; lost, unless a link that saves it was clicked |
    | `training` | whether a training is on |
    | `tabs` | for each tab's title, what is shown while the mouse is over it |

    For a link that was clicked and opens a city or a mission, it tells `copied`, whether it is in
    the clipboard now, and `value`, what the link holds.
    """

    _esm = """
    function render({ model }) {
      const saved = new Set();
      const mark = () => {
        const painted = model.get("painted");
        const unsaved = model.get("training") || (painted && !saved.has(painted));
        document.body.toggleAttribute("data-unsaved", Boolean(unsaved));
      };
      const save = (event) => {
        const address = event.target.closest?.("a")?.getAttribute("href");
        if (address) saved.add(plain(address.split(/city=|base64,/).at(-1)));
        mark();
      };
      // As in a link, whether it comes from one or from a file.
      const plain = (code) =>
        code.split("&")[0].replaceAll("+", "-").replaceAll("/", "_").replace(/=+$/, "");
      const copy = async (event) => {
        const link = event.target.closest?.("a[href^='#city='], a[href^='#mission=']");
        if (!link) return;
        const value = link.hash.slice(1);
        let copied = true;
        try {
          await navigator.clipboard.writeText(link.href);
        } catch {
          copied = false; // the browser, or who uses it, does not allow it
        }
        model.send({ value, copied });
      };
      const explain = ({ target }) => {
        const tab = target.closest?.("[role=tab]");
        const about = tab && model.get("tabs")[tab.textContent.trim()];
        if (about) tab.title = about;
      };
      document.addEventListener("pointerover", explain);
      document.addEventListener("focusin", explain);
      document.addEventListener("click", save);
      document.addEventListener("click", copy);
      model.on("change:painted", mark);
      model.on("change:training", mark);
      const tell = () => {
        model.set("value", location.hash.slice(1));
        model.save_changes();
      };
      addEventListener("hashchange", tell);
      tell();
      return () => {
        document.removeEventListener("pointerover", explain);
        document.removeEventListener("focusin", explain);
        document.removeEventListener("click", save);
        document.removeEventListener("click", copy);
        model.off("change:painted", mark);
        model.off("change:training", mark);
        removeEventListener("hashchange", tell);
      };
    }
    export default { render };
    """
    value = traitlets.Unicode().tag(sync=True)
    painted = traitlets.Unicode().tag(sync=True)
    training = traitlets.Bool().tag(sync=True)
    tabs = traitlets.Dict().tag(sync=True)


class Labs(ipywidgets.Tab):
    """The labs of the web page; `made` holds the labs that were opened, by title.

    A link to a city, made by the city editor, opens the page with that city; one to a mission, made
    by the mission lab, with that mission. The city that is painted can be flown in other labs, as
    *my city*.
    """

    def __init__(self):
        self.made: dict[str, ipywidgets.Widget] = {}
        pages = [
            ipywidgets.VBox([ipywidgets.HTML(f"<p>{introduction}</p>")])
            for _, introduction, _ in LABS.values()
        ]
        self.address = Address(tabs={title: purpose for title, (*_, purpose) in LABS.items()})
        pages[0].children = [*pages[0].children, self.address]
        super().__init__(pages, titles=list(LABS))
        self.observe(lambda change: self._open(change.new), "selected_index")
        self.selected_index = 0
        self._open(0)
        self.address.observe(lambda change: self._visit(change.new), "value")
        self.address.on_msg(lambda _, told, buffers: self._tell_link(**told))

    def _visit(self, address: str) -> None:
        for start, title in LINKS.items():
            if address.startswith(start):
                self.selected_index = list(LABS).index(title)
                self.made[title].open_link(address.removeprefix(start))

    def _tell_link(self, value: str, copied: bool) -> None:
        for start, title in LINKS.items():
            if value.startswith(start) and title in self.made:
                self.made[title].tell_link(copied)

    def painted(self) -> City:
        """The city of the city editor; `InputError` if there is none, or if it is not finished."""
        if "City" not in self.made:
            raise InputError(
                "there is no city of yours yet. Paint one in the tab City, then choose it here "
                "again"
            )
        try:
            return self.made["City"].draft.city()
        except InputError as error:
            reason = str(error).removeprefix("my_city: ")
            raise InputError(
                f"your city is not finished, so it is not taken: {reason}. Go on with it in the "
                "tab City, then choose it here again"
            ) from None

    def _open(self, index: int) -> None:
        title = list(LABS)[index]
        if title not in self.made:
            self.made[title] = LABS[title][0](self)
            page, lab = self.children[index], self.made[title]
            page.children = [introduced(LABS[title][1], lab), *page.children[1:], lab]
            if title in WATCHED:
                work, name = WATCHED[title]
                traitlets.dlink((self.made[title], work), (self.address, name))
        menu = getattr(self.made[title], "city", None)
        if isinstance(menu, CityMenu):
            menu.look_again()
