// Flying by hand, against a ghost in the same mission.

import { KINDS, UAV, at, escaped, momentAt, scaleOf } from "../player.js";
import { COLOURS } from "./compare.js";
import { NETWORKS, button, chooser } from "./html.js";
import { timeUnits } from "./words.js";

export const ARROWS = {
  ArrowUp: "north",
  ArrowRight: "east",
  ArrowDown: "south",
  ArrowLeft: "west",
};
export const WAYS = { north: [-1, 0], east: [0, 1], south: [1, 0], west: [0, -1] };

export const FLY = {
  title: "Fly",
  words: ["greedy", "random", ...NETWORKS],
  html({ panel, state, tools }, { tells }) {
    const { you, ghost, rival, headline } = panel;
    const key = (action, sign) =>
      button(sign, { kind: "fly", action }, `class="${action}" aria-label="${action}"`);
    const pad = `<div class="pad">${key("hover", "hover")}${key("north", "↑")}${key("land", "land")}
      ${key("west", "←")}${key("south", "↓")}${key("east", "→")}</div>`;
    const meet = [
      { kind: "policy", which: 1, name: rival.name },
      { kind: "policy", which: 0, name: "you" },
      { kind: "tool", tool: "compare" },
    ];
    const both = you.ended && tools.includes("compare") ? button("See both flights", meet) : "";
    const head = you.ended
      ? headline
      : you.steps
        ? `${timeUnits(you.timeLeft)} left`
        : `Beat ${rival.subject}: ${ghost.landed ? ghost.collected.toFixed(1) : 0} units home`;
    const tell =
      tells && !you.steps ? '<button type="button" class="tell">Show me around</button>' : "";
    const help = you.steps
      ? ""
      : "<p>Fly near the devices, and land on blue before time runs out. Keys: arrows, space to hover, L to land.</p>";
    const known = state.known.filter(([name]) => name !== "you");
    const bar = (k, name) =>
      `<div class="hand" style="--colour: ${COLOURS[k]}"><span>${escaped(name)}</span><i class="in-${k}"></i><output class="has-${k}"></output></div>`;
    return `<h2 aria-live="polite">${escaped(head)}</h2><div class="beside">${pad}<div class="hands">${bar(0, "you")}${bar(1, rival.title)}
      <p class="no" role="status"></p></div></div>${help}
      <div class="row">${both}${button("Again", { kind: "again" })}${chooser("rival", "policy-1", known, rival.name)}${tell}</div>`;
  },
  refusal({ city, flights: [{ path }] }, action) {
    const [[row, col], [down, right]] = [path.at(-1), WAYS[action] ?? [0, 0]];
    const there = KINDS[city[row + down]?.[col + right]];
    const what = there ? `a ${there.name.split(":")[0]}` : "the edge";
    return `<b>Refused</b>: ${action === "land" ? "you can land only on blue" : what}.`;
  },
  over: ({ film }) =>
    `<path class="ghost-path"/><g class="uav ghost"><g transform="scale(${scaleOf(film.city.length)})">${UAV}</g></g>`,
  keys: { ...ARROWS, " ": "hover", l: "land", L: "land" },
  // The ghost and its trail, as far as it has come at this time, and the data of both
  moment(stage, { film, panel: { you } }, time) {
    const { path } = film.flights[1];
    const refused = film.flights[0].refused.at(-1);
    const back = time < you.steps && `Step ${Math.ceil(time)} of ${you.steps}.`;
    stage.fill(".no", you.ended ? "" : back || (refused ? this.refusal(film, refused) : ""));
    const { place } = momentAt(film.flights[1], time);
    const cells = [...path.slice(0, Math.floor(time) + 1), place];
    const trail = cells.map(([row, col]) => `${col} ${row}`);
    stage.find(".ghost")?.setAttribute("transform", at(place));
    stage.find(".ghost-path")?.setAttribute("d", `M${trail.join("L")}`);
    film.flights.forEach((flight, k) => {
      const all = flight.left[0].slice(0, -1).reduce((total, each) => total + each, 0);
      const left = momentAt(flight, time)
        .amounts.slice(0, -1)
        .reduce((total, each) => total + each, 0);
      stage.find(`.in-${k}`)?.style.setProperty("--share", `${(100 * (all - left)) / all}%`);
      const has = stage.find(`.has-${k}`);
      if (has) has.textContent = (all - left).toFixed(1);
    });
  },
};
