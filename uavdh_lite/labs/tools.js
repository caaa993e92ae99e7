// The six tools. Each has what its panel says, as HTML, and what it adds to the map and to the panel at
// a moment. `scene` is what the session sent, `stage` is where it is shown.

import {
  KINDS,
  SQUARE,
  UAV,
  at,
  cells,
  escaped,
  momentAt,
  scaleOf,
  square,
  tiles,
} from "../player.js";
import { LAYERS, METRICS } from "./state.js";
import { RUNS, gapOf, grouped, signed, timeUnits, units, upper } from "./words.js";

const tenths = (value) => Number(value.toFixed(1));
const WORDS = {
  UAV: "the drone: it flies 10 m above the ground, one cell of 10 m in a step",
  shadow: "cells that a building hides from a device: the radio link is much weaker there",
  greedy: "a simple rule: fly to the nearest device with data, and home in time",
  random: "every action is equally likely",
  "data units": "what the devices have for the UAV to collect",
  return:
    "the sum of rewards: each unit of data counts 1, each step −0.2 (a landing nothing), a refused action −1, a crash −150; data counts even if a crash loses it",
  landed: "the share of missions that ended with a landing in time",
  fading:
    "shadow fading: random changes of the radio link, normal in dB, by their standard deviation; the draws are the same for all who fly a mission",
  "Q-value":
    "the return that the agent expects from here on if it takes this action now; later rewards count less, so it is usually below their plain sum",
  score: "how surely the planner that the agent copied would take this action",
  SNR: "signal-to-noise ratio: how far the signal is above the noise, in decibels",
  "SNR at 1 m":
    "the SNR at 1 m from the device; it is set by the city's size, so that at ground level −15 dB are left from the centre to a corner in sight",
  dB: "decibels, a logarithmic scale: 10 dB are a factor of ten, 20 dB a factor of a hundred",
  slot: "a quarter of a step; each goes to the device that is heard best among those with data left, and brings log2(1 + SNR) units, where −20 dB are an SNR of 0.01, and 10 dB one of 10",
  value: "the Q-value or score of the best action if the UAV were over that cell now",
  "collected and landed": "the share of the data that was brought home; 0 after a crash",
  ghost:
    "the flight of your rival in the same mission, with the same fading, as far as you have come",
  "path loss":
    "what the signal loses on its way, where nothing hides it: 22.7 dB each time the distance grows tenfold; a cell is 10 m wide, and the UAV flies 10 m above the ground",
  "hidden by buildings":
    "what the signal loses in addition without a line of sight: the more, the longer its way, however many buildings are in between",
  layer: "a map laid over the city: one of five that the network sees, or the value of each cell",
  "DDQN agent":
    "a neural network that learned from its own trials, by a strengthened form of double deep Q-learning",
  "imitation agent":
    "a neural network that first learned to copy a planner and then learned from its own trials; a failsafe brings it home in time",
  "any-city agent":
    "one neural network for any city of at most 16 by 16 cells; a failsafe brings it home in time",
};
const term = (word, shown = word) =>
  WORDS[word]
    ? `<span class="term" tabindex="0" role="note" aria-label="${word}: ${WORDS[word]}"
        data-about="${escaped(WORDS[word])}">${shown}</span>`
    : shown;
/** A text in which names explain themselves. */
const explained = (text) =>
  escaped(text).replace(/\b(greedy|DDQN agent|imitation agent|any-city agent)\b/gi, (word) =>
    term(
      Object.keys(WORDS).find((each) => each.toLowerCase() === word.toLowerCase()),
      word,
    ),
  );
export const button = (name, about, more = "") =>
  `<button type="button" data-ask="${escaped(JSON.stringify(about))}" ${more}>${name}</button>`;
export const options = (pairs, chosen) =>
  pairs
    .map(
      ([value, name]) =>
        `<option value="${escaped(String(value))}" ${value === chosen ? "selected" : ""}>${escaped(name)}</option>`,
    )
    .join("");
/** A list with its label; a question mark explains what was chosen. */
function chooser(label, name, pairs, chosen) {
  const [, shown] = pairs.find(([value]) => value === chosen) ?? [];
  return `<span class="chooser">${term(label)} <select data-set="${name}"
    aria-label="${label}">${options(pairs, chosen)}</select>${WORDS[shown] ? term(shown, "?") : ""}</span>`;
}
/** The row in which both rivals are chosen, and who cannot fly over this city. */
const choosePolicies = ({ state }, ...labels) =>
  `<div class="row">${labels.map((label, k) => chooser(label, `policy-${k}`, state.known, state.policies[k])).join("")}` +
  `<small>${escaped(state.absent)}</small></div>`;

// Colours of a scale from 0 to 1, which colour-blind readers can follow too (viridis)
const SCALE = ["68 1 84", "59 82 139", "33 145 140", "94 201 98", "253 231 37"].map((rgb) =>
  rgb.split(" ").map(Number),
);
function colourOf(share) {
  const place = Math.min(Math.max(share, 0), 1) * (SCALE.length - 1);
  const k = Math.min(Math.floor(place), SCALE.length - 2);
  return `rgb(${SCALE[k].map((low, c) => Math.round(low + (place - k) * (SCALE[k + 1][c] - low))).join(" ")})`;
}
const GRADIENT = `linear-gradient(to right, ${[0, 0.25, 0.5, 0.75, 1].map(colourOf).join(", ")})`;
const ramp = (low, high, about) =>
  `<div class="ramp"><span>${low}</span><i style="background: ${GRADIENT}"></i><span>${high}</span><small>${about}</small></div>`;

/** Squares in the colours of the values of cells, by number; null is left out. */
const heat = (values, size, colour, opacity = 0.85) =>
  `<g fill-opacity="${opacity}" shape-rendering="crispEdges">${values
    .map((each, cell) =>
      each === null
        ? ""
        : `<path d="${square([Math.floor(cell / size), cell % size])}" fill="${colour(each)}"/>`,
    )
    .join("")}</g>`;

/** The outline of the cells, by number, for which something holds. */
function outline(values, size, holds) {
  const inside = (y, x) => y >= 0 && y < size && x >= 0 && x < size && holds(values[y * size + x]);
  let d = "";
  values.forEach((_, cell) => {
    const [y, x] = [Math.floor(cell / size), cell % size];
    if (!inside(y, x)) return;
    const [left, top] = [x - 0.5, y - 0.5];
    if (!inside(y - 1, x)) d += `M${left} ${top}h1`;
    if (!inside(y + 1, x)) d += `M${left} ${top + 1}h1`;
    if (!inside(y, x - 1)) d += `M${left} ${top}v1`;
    if (!inside(y, x + 1)) d += `M${left + 1} ${top}v1`;
  });
  return `<path class="outline" d="${d}"/>`;
}

/** A row of a table with a column for each policy. */
const line = (name, results, show) =>
  `<tr><th scope="row">${name}</th>${results.map((each) => `<td>${show(each)}</td>`).join("")}</tr>`;
const heads = (first, results) =>
  `<thead><tr><th>${first}</th>${results.map(({ who }) => `<th scope="col">${explained(who.title)}</th>`).join("")}</tr></thead>`;
const average = ({ panel: { many } }) => {
  if (!many) return "";
  const mean = ([middle, low, high]) => `${middle} % <small>${low}–${high}</small>`;
  return `${heads("mean of 100 random missions, 95 % interval", many)}<tbody class="many">
    ${line(term("collected and landed"), many, ({ both }) => mean(both))}
    ${line(term("landed"), many, ({ landed }) => mean(landed))}
    ${line("time used", many, ({ time }) => `${time} %`)}</tbody>`;
};
/** What two agents can do; a flight by hand has its own mission alone. */
const forAgents = ({ state: { policies } }, name, html) =>
  policies.includes("you")
    ? `${name}: choose two agents, because your flight belongs to this mission.`
    : html;
const manyButton = (scene) =>
  forAgents(scene, "100 missions", button("100 missions", { kind: "many" }));

export const ARROWS = {
  ArrowUp: "north",
  ArrowRight: "east",
  ArrowDown: "south",
  ArrowLeft: "west",
};
export const WAYS = { north: [-1, 0], east: [0, 1], south: [1, 0], west: [0, -1] };
export const brush = { sign: "B", cells: null }; // cells: those of the stroke that is being painted

export const TOOLS = {
  fly: {
    title: "Fly",
    html({ film, panel, state, tools }, { tells }) {
      const { you, ghost, ranking, rival } = panel;
      const refusals = film.flights[0].refused.filter((action) => action).length;
      const key = (action, sign) =>
        button(sign, { kind: "fly", action }, `class="${action}" aria-label="${action}"`);
      const pad = `<div class="pad">${key("hover", "hover")}${key("north", "↑")}${key("land", "land")}
        ${key("west", "←")}${key("south", "↓")}${key("east", "→")}</div>`;
      const rank = (
        each,
        k,
      ) => `<tr><td>${k + 1}</td><td>${escaped(each.city)}</td><td>${each.time}</td>
        <td>${signed(each.ahead)} <small>${escaped(each.ghost)}</small></td><td>${each.landed ? each.collected.toFixed(1) : "crashed"}</td></tr>`;
      const table = ranking.length
        ? `<table class="ranking"><caption>Your flights, the best first</caption>
            <tr><th></th><th>city</th><th>time given</th><th>ahead of the ghost by</th><th>data</th></tr>
            ${ranking.map(rank).join("")}</table>`
        : "";
      const meet = [
        { kind: "policy", which: 1, name: rival.name },
        { kind: "policy", which: 0, name: "you" },
        { kind: "tool", tool: "compare" },
      ];
      const both = tools.includes("compare")
        ? button(`Compare with ${escaped(rival.subject)}`, meet)
        : "";
      const head = you.ended ? this.card(panel, refusals, both) : this.help(you, rival, tells);
      const known = state.known.filter(([name]) => name !== "you");
      return `<div class="beside">${pad}<div class="row">${button("Again", { kind: "again" })}
        ${chooser("ghost", "policy-1", known, rival.name)}</div></div>
        <p class="no" role="status"></p>${head}${table}`;
    },
    refusal({ city, flights: [{ path }] }, action) {
      const [[row, col], [down, right]] = [path.at(-1), WAYS[action] ?? [0, 0]];
      const there = KINDS[city[row + down]?.[col + right]];
      const inTheWay = there ? `a ${there.name}` : "the edge of the city";
      const why = action === "land" ? "you can only land on blue cells" : inTheWay;
      return `<b>Refused: ${action}</b>, ${why}. It costs a unit of time and 1 of the return.`;
    },
    help: (
      you,
      rival,
      tells,
    ) => `<div class="beside"><h2>${you.steps ? `${timeUnits(you.timeLeft)} left` : "Your flight"}</h2>
      ${tells && !you.steps ? '<button type="button" class="tell">A story first</button>' : ""}</div>
      <p>Collect the ${term("data units", "data")} and land on a blue cell in time. Press the
      buttons, or keys: arrows move, space hovers, L lands; ↶ takes a move back. The pale ${term("UAV")} is the ${term("ghost")}, flown by ${explained(rival.subject)}.</p>`,
    card({ you, ghost, rival, end: heading }, no, both) {
      const home = (each) =>
        `${each.collected.toFixed(1)} units in ${each.steps} step${each.steps === 1 ? "" : "s"}`;
      const end = you.landed
        ? `You landed with ${home(you)}.`
        : "The time ran out before you landed.";
      const other = ghost.landed ? home(ghost) : "a crash";
      const refused = no
        ? ` Refused actions: ${no}; each cost 1 of the return and a unit of time.`
        : "";
      return `<div class="card" role="status"><h2>${explained(heading)}</h2>${both}
        <p>${end}${refused} ${explained(upper(rival.title))}: ${other}. ${term("return", "Return")}:
        ${signed(you.return)} against ${signed(ghost.return)}.</p></div>`;
    },
    over: ({ film }) =>
      `<path class="ghost-path"/><g class="uav ghost"><g transform="scale(${scaleOf(film.city.length)})">${UAV}</g></g>`,
    keys: { ...ARROWS, " ": "hover", l: "land", L: "land" },
    // The ghost and its trail, as far as it has come at this time, and what is to be known before the next move
    moment(stage, { film, panel: { you } }, time, playing) {
      const { path } = film.flights[1];
      const refused = film.flights[0].refused.at(-1);
      const back =
        time < you.steps &&
        !playing &&
        `This is after step ${Math.ceil(time)} of ${you.steps}; your next move goes on from the last.`;
      stage.fill(".no", you.ended ? "" : back || (refused ? this.refusal(film, refused) : ""));
      const { place } = momentAt(film.flights[1], time);
      const trail = [...path.slice(0, Math.floor(time) + 1), place].map(
        ([row, col]) => `${col} ${row}`,
      );
      stage.find(".ghost")?.setAttribute("transform", at(place));
      stage.find(".ghost-path")?.setAttribute("d", `M${trail.join("L")}`);
    },
  },

  compare: {
    title: "Compare",
    html(scene) {
      const { verdict, why, parting, look, results, rule } = scene.panel;
      const duel = (name, wanted) => button(name, { kind: "duel", wanted });
      const [first, second] = results.map(({ who }) => escaped(who.title));
      const brought = ({ landed, ended, collected }) =>
        landed ? collected.toFixed(1) : ended ? "0, crashed" : "0, in the air";
      const flown = `${heads("this mission", results)}<tbody>
        ${line(`${term("data units", "data")} brought home`, results, brought)}
        ${line("time used", results, ({ steps }) => steps)}
        ${line(term("return"), results, (each) => signed(each.return))}</tbody>`;
      const show = (step) =>
        button(step + 1, { show: step }, `aria-label="stop before step ${step + 1}"`);
      const go = look.length ? `Stop before step ${look.map(show).join("")}` : "";
      const ring =
        parting === null
          ? ""
          : `<small>Orange ring: where each is before step ${parting + 1}.</small>`;
      return `<h2>${explained(verdict)}</h2><div class="row">${go}${ring}</div><p class="why">${explained(why.join(" "))}</p>
        <div class="choices"><div class="row">${forAgents(
          scene,
          "Find a duel",
          `Find a duel: ${duel(`${first} wins`, 1)}${duel(`${second} wins`, -1)}${duel("nearly level", 0)}`,
        )} <small>${rule}</small></div>
        ${choosePolicies(scene, "left", "right")}</div>
        <table>${flown}${average(scene)}</table><div class="row">${manyButton(scene)}</div>`;
    },
    over({ film, panel }, k) {
      // larger than any ring of hovering
      if (panel.parting === null) return "";
      const { path } = film.flights[k];
      const [row, col] = path[Math.min(panel.parting, path.length - 1)];
      return `<circle class="parting" cx="${col}" cy="${row}" r="${scaleOf(film.city.length)}"/>`;
    },
  },

  think: {
    title: "Think",
    html({ panel, state: { looks } }) {
      if (panel.agent === null) {
        return `<h2>No agent knows this city</h2><p>Choose another city, or paint one of at most 16 by 16 cells: the
          ${term("any-city agent")} flies there.</p>`;
      }
      const { step, gap, stake, smaller } = panel.closest ?? {};
      const instead =
        panel.instead &&
        `${upper(panel.instead.subject)} ${panel.instead.you ? "have" : "has"} no ${panel.number}s: here the ${panel.agent} thinks and flies.`;
      const later = smaller
        ? `; at step ${smaller.step + 1} it is ${gapOf(smaller.gap)}, but ${smaller.empty ? "nothing" : "hardly anything"} is left then`
        : "";
      const idle = stake
        ? `, the smallest while there was still a unit of data or more to collect${later}.`
        : ". Hardly anything was left to collect, so little depends on it.";
      return `<div role="status"><h2 class="says-why"></h2></div>${instead ? `<p><b>${explained(instead)}</b></p>` : ""}
        <h3>${term(panel.number, `${panel.number}s`)}: the longer the bar, the better (best: <span class="most"></span>)</h3><div class="q"></div><p class="missed"></p>
        <div class="row">${
          panel.closest
            ? `${button("Closest decision", { show: step })} <small>step ${step + 1}: a gap of ${gapOf(gap)}${idle}</small>`
            : "<small>No step leaves a choice between two actions.</small>"
        }</div>
        <div class="row">${chooser(
          "layer",
          "layer",
          LAYERS.map((name) => [name, name]),
          looks.layer,
        )}
        <label><input type="checkbox" data-set="centred" ${looks.centred ? "checked" : ""}> centred, as the network sees it</label></div>
        <div class="layer-scale"></div><p class="meaning"></p>
        <div class="row">${chooser("who thinks", "policy-0", panel.agents, panel.name)}</div>`;
    },
    over: () => '<g class="layer"></g>',
    moment(stage, scene, time) {
      const { panel, film } = scene;
      if (panel.agent === null) return;
      const step = Math.min(Math.floor(time + 1e-9), panel.values.length - 1);
      const [{ path, end }] = film.flights;
      const over = `It has ${end}. Below: what it thought before its last step.`;
      stage.fill(
        ".says-why",
        time >= path.length - 1 ? over : `Next, step ${step + 1}: ${panel.says[step]}`,
      );
      const values = panel.values[step];
      const allowed = values.filter((each) => Number.isFinite(each));
      const best = Math.max(...allowed);
      const low = Math.min(...allowed);
      const bar = (value, k) => {
        const name = panel.actions[k];
        if (!Number.isFinite(value))
          return `<div><span>${name}</span><i></i><b>not allowed</b></div>`;
        const width = best > low ? (100 * (value - low)) / (best - low) : 100;
        const text =
          value === best ? "the best" : `${gapOf(best - value).replace("less than", "<")} less`;
        return `<div class="${value === best ? "best" : ""}"><span>${name}</span><i><u style="width: ${width}%"></u></i><b>${text}</b></div>`;
      };
      stage.fill(".q", values.map(bar).join(""));
      stage.fill(".most", signed(best));
      stage.fill(".missed", panel.missed[step]);
      this.layer(stage, scene, step, time);
    },
    layer(
      stage,
      {
        panel,
        film,
        state: {
          looks: { layer: name, centred },
        },
      },
      step,
      time,
    ) {
      const size = film.city.length;
      stage.centre(centred ? momentAt(film.flights[0], time).place : null);
      const group = stage.find(".layer");
      stage.find(".main").classList.toggle("layered", name !== "none");
      stage.find(".main").classList.toggle("seen", SEEN.includes(name));
      if (!group) return;
      if (name === "none") group.innerHTML = "";
      else if (SEEN.includes(name)) group.innerHTML = seenLayer(film, name, step);
      else if (panel.map) {
        const known = panel.map.values.filter((each) => each !== null);
        const [least, high] = [Math.min(...known), Math.max(...known)];
        const low = Math.max(least, high - 15);
        group.innerHTML = heat(panel.map.values, size, (value) =>
          colourOf((value - low) / (high - low || 1)),
        );
        const lowest = `${signed(low)}${low > least ? " or less" : ""}`;
        stage.fill(".layer-scale", ramp(lowest, signed(high), `value: ${WORDS.value}`));
      }
      if (centred) group.innerHTML += outside(size, name);
      const pink =
        centred && name !== "no-fly zone"
          ? ` ${name in MEANINGS ? "" : CENTRED} Pink: outside of the city.`
          : "";
      if (name !== "value") stage.fill(".layer-scale", "");
      else if (panel.map?.step !== step) stage.askWhenFree({ kind: "values", step });
      const [all, left] = [0, step].map((at) => film.flights[0].left[at].slice(0, -1));
      const none = Math.max(...left) < 0.05 && " Nothing is left.";
      const full = name.startsWith("data ")
        ? (name === "data left" && none) || ` Full blue: ${Math.max(...all).toFixed(1)} units.`
        : "";
      stage.fill(".meaning", `${MEANINGS[name] ?? ""}${full}${pink}`);
    },
  },

  channel: {
    title: "Channel",
    still: () => true,
    cursor:
      "arrow keys move the cell that the UAV is over; Enter on a device chooses it, elsewhere it holds the cell",
    html({ panel, state }) {
      const [low, high] = panel.range;
      const device = (_, k) =>
        button(`device ${k}`, { kind: "look", device: k }, `aria-pressed="${k === panel.device}"`);
      return `<div role="status"><h2 class="sentence"></h2></div><table class="ledger"></table>
        <div class="row">${state.devices.map(device).join("")}</div>
        ${ramp(
          `${low} dB`.replace("-", "−"),
          `${high} dB`,
          `${upper(term("SNR"))} from device ${panel.device} over each cell, without
          ${term("fading")}. Point at a cell to see its link, or move there with Tab and the arrow keys; press the cell, or Enter, to hold it, and
          again, or Escape, to let it go. White line: the edge of the
          ${term("shadow", "shadows")}, which are on its darker side.`,
        )}`;
    },
    under: ({
      film,
      panel: {
        snr,
        range: [low, high],
      },
    }) => heat(snr, film.city.length, (value) => colourOf((value - low) / (high - low)), 0.9),
    over: ({
      film,
      panel,
      state: { held },
    }) => `${outline(panel.building, film.city.length, (each) => each > 1e-6)}<path class="ray"/>
      ${held ? `<path class="held" d="${square(held)}"/>` : ""}`,
    point(stage, { panel, state, film }, pointed) {
      const cell = state.held ?? pointed;
      if (cell || this.city !== String(film.city))
        [this.cell, this.city] = [cell, String(film.city)]; // the last one stays
      const [row, col] = this.cell ?? panel.dearest;
      const number = row * film.city.length + col;
      const [y, x] = state.devices[panel.device].cell;
      const cost = panel.building[number];
      const hidden = cost > 1e-6;
      stage.find(".ray")?.setAttribute("d", `M${x} ${y}L${col} ${row}`);
      stage.find(".ray")?.classList.toggle("blocked", hidden);
      const sign = film.city[row][col];
      const there = `${(KINDS[sign]?.name ?? "open ground").replace(":", ", which")}${"BN".includes(sign) ? ", where no UAV may fly" : ""}`;
      const head = hidden
        ? `Hidden from device ${panel.device} by buildings: they cost ${cost.toFixed(1)} ${term("dB")}.`
        : `In sight of device ${panel.device}.`;
      const instead = hidden ? ` instead of ${units(panel.free[number])}` : "";
      const amount = `${units(panel.rate[number])} units a ${term("slot")}${instead}`;
      const brings = panel.traced
        ? `in the model ${amount}; in flights here, by traced rays, ${units(panel.traced.rate[number])}`
        : amount;
      stage.fill(
        ".sentence",
        `${head} Row ${row}, column ${col}, ${there}: ${brings}.${
          state.held ? " Held: press the cell again, or Escape, to let it go." : ""
        }`,
      );
      const entry = (name, value) => `<tr><th scope="row">${name}</th><td>${value} dB</td></tr>`;
      const lines = [
        [term("SNR at 1 m"), signed(panel.transmit)],
        [
          `${term("path loss")} over ${panel.distance[number].toFixed(0)} m`,
          `−${signed(panel.pathLoss[number])}`,
        ],
        [term("hidden by buildings"), hidden ? `−${signed(cost)}` : "0.0"],
        [
          term("SNR"),
          signed(tenths(panel.transmit) - tenths(panel.pathLoss[number]) - tenths(cost)),
        ], // adds up as it is shown
        [term("fading"), `± ${panel.fading[Number(!hidden)].toFixed(1)}`],
      ];
      if (panel.traced) {
        const snr = panel.traced.snr[number];
        lines.push([
          `${term("SNR")} in flights, from traced rays`,
          Number.isFinite(snr) ? signed(snr) : "−∞",
        ]);
      }
      stage.fill(".ledger", lines.map((each) => entry(...each)).join(""));
    },
  },

  paint: {
    title: "Paint",
    still: () => true,
    cursor: "arrow keys move the cell; space paints it",
    html(scene) {
      const swatch = ([sign, { name }]) => `<button type="button" class="swatch" data-sign="${sign}"
        aria-pressed="${sign === brush.sign}"><svg viewBox="-.6 -.6 1.2 1.2" aria-hidden="true"><path class="paper"
        d="M-.5 -.5${SQUARE}"/>${sign === "." ? "" : cells([sign], sign)}</svg>${name.split(":")[0]}</button>`;
      const all = [[".", { name: "open ground" }], ...Object.entries(KINDS)];
      return `<div class="swatches">${all.map(swatch).join("")}</div>
        <p>Draw with the pointer, and drag devices where you want them; or press Tab to the map,
        move with the arrow keys and paint with space. Violet cells are those that a device at the pointer could
        not see: its ${term("shadow")}. Low buildings cast one, too, though a UAV may fly over them.</p>
        <div class="row">${manyButton(scene)}${button("Save as PNG", { kind: "save", what: "png" })}</div>
        <table>${average(scene)}</table>
        ${choosePolicies(scene, "first", "second")}`;
    },
    over: () => '<path class="shadow live"/><g class="fresh"></g>',
    point(stage, { panel }, cell) {
      if (brush.cells) return;
      if (!cell) return stage.find(".live")?.setAttribute("d", "");
      const { shadow: known } = panel;
      if (known && String(known.cell) === String(cell)) {
        stage.find(".live")?.setAttribute("d", tiles(known.rows, "#", SQUARE));
      } else stage.askWhenFree({ kind: "shadow", cell });
    },
  },

  watch: {
    title: "Watch",
    still: ({ state }) => !state.point,
    html({ panel, film, state: { looks, point } }) {
      const { settings, runs, says, village, elsewhere, left, mean } = panel;
      const others = (k) =>
        settings.map(([title], run) => [run, title]).filter(([run]) => run !== looks.runs[1 - k]);
      const racer = (colour, pairs, k) => `<span class="racer"><span class="key ${colour}"></span>
        ${chooser(colour, `run-${k}`, pairs, looks.runs[k] ?? "")}</span>`;
      const about = looks.runs.map((run, k) => `${upper(RUNS[k])}: ${escaped(settings[run][1])}`);
      const [flight] = film.flights;
      const said = ({ text, run, at }) =>
        at.reduce((html, k) => {
          // each point that it names flies its agent
          const steps = grouped(runs[run].points[k].steps);
          return html.replace(
            steps,
            button(
              steps,
              { kind: "race", point: [run, k] },
              'class="inline" title="see its agent fly"',
            ),
          );
        }, escaped(text));
      const verdict = `<p class="verdict" role="status">${[says.at(-1), ...says.slice(0, -1)].map(said).join("<br>")}</p>`; // how it ended first
      const odd = runs.flatMap(({ points }) => points).find(({ steps }) => steps % 1000);
      return `<h2>Watch it learn in the ${escaped(village)}</h2><div class="row">${racer("blue", others(0), 0)}${racer("orange", [["", "nobody"], ...others(1)], 1)}
        ${chooser(
          "shown",
          "metric",
          METRICS.map((each) => [each, each.replaceAll("_", " ")]),
          looks.metric,
        )}</div>
        <p class="setting">${about.join("<br>")}</p>
        <div class="${this.fresh(looks.runs) ? "draws" : ""}">${curves(runs, point, looks.metric)}</div>
        <p class="flies">${
          point
            ? `This flight: ${explained(flight.name)}, in one mission. ${flight.ending} ${mean}`
            : `Press near a point, or move with the arrow keys, to see its agent fly${elsewhere ? ` in the ${escaped(village)}; until then the map shows your mission` : ""}.`
        }
        ${left ? "↶ brings your mission back." : ""}</p>${verdict}
        <p>${point ? "" : "Each point stands for 100 missions that the agent did not learn from."}
        The training runs were recorded.
        ${odd ? `They fly several missions at once, hence ${grouped(odd.steps)} steps and not ${grouped(odd.steps - (odd.steps % 1000))}.` : ""}</p>`;
    },
    drawn: "", // the runs whose curves have drawn themselves
    fresh(runs) {
      const before = this.drawn;
      this.drawn = String(runs);
      return before !== this.drawn;
    },
    /** Keys over the curves go from point to point, and from run to run. */
    keyed(
      {
        scene: {
          panel: { runs },
          state: { point },
        },
        ask,
      },
      key,
      down = 0,
      right = { Home: -Infinity, End: Infinity }[key],
    ) {
      if (right === undefined) return null;
      const [run, k] = point ?? [0, right > 0 ? -1 : runs[0].points.length];
      const other = Math.min(Math.max(run + down, 0), runs.length - 1);
      const there = Math.min(Math.max(k + right, 0), runs[other].points.length - 1);
      return () => ask({ kind: "race", point: [other, there] });
    },
  },
};

const CENTRED = "All layers are shifted so that the UAV is in the middle.";
const MEANINGS = {
  "landing zone": "A layer that the network sees: where the UAV may land.",
  "no-fly zone": "A layer: where the UAV may not fly, which includes all that is outside the city.",
  buildings: "A layer: what blocks the radio link.",
  "data left": "A layer: data still to be collected, in the cells of the devices.",
  "data collected": "A layer: data that the UAV has collected, in the same cells.",
};
const SEEN = Object.keys(MEANINGS);

/** What the network sees of the city in one of its layers. */
function seenLayer({ city, devices, flights }, name, step) {
  const signs = { "landing zone": "L", "no-fly zone": "NB", buildings: "bB" }[name] ?? "";
  const layer = heat(
    [...city.join("")],
    city.length,
    (sign) => (signs.includes(sign) ? "#0072b2" : "#8883"),
    1,
  );
  if (signs) return layer;
  const [now, first] = [flights[0].left[step], flights[0].left[0]];
  const most = Math.max(...first.slice(0, -1));
  const full = devices.map(({ cell }, k) => {
    const amount = name === "data left" ? now[k] : first[k] - now[k];
    return `<path d="${square(cell)}" fill="#0072b2" fill-opacity="${amount / most}"/>`;
  });
  return layer + full.join("");
}

/** All around a city of this size lies a no-fly zone, as far as the network sees. */
function outside(size, name) {
  const around = `M${-size} ${-size}h${3 * size}v${3 * size}h${-3 * size}z`;
  const d = `${around}M-.5 -.5v${size}h${size}v${-size}z`;
  return `<path class="outside" d="${d}" fill="${name === "no-fly zone" ? "#0072b2" : "#d6333f"}"/>`;
}

/** The curves of a race: points by steps; full blue lies on a wider, open orange. Arrow keys choose a point. */
function curves(runs, point, metric) {
  const [width, height, left, bottom] = [420, 195, 44, 26];
  const steps = Math.max(...runs.map(({ points }) => points.at(-1).steps));
  const x = (each) => left + ((width - left - 12) * each) / steps;
  const y = (share) => 10 + (height - bottom - 10) * (1 - share);
  const name = (share) => `${Math.round(100 * share)} %`;
  const ticks = [0, 0.5, 1].map(
    (tick) =>
      `<path class="grid" d="M${left} ${y(tick)}H${width - 12}"/><text x="${left - 6}" y="${y(tick)}">${name(tick)}</text>`,
  );
  const times = [0, 0.25, 0.5].map(
    (part) =>
      `<text class="time" x="${x(part * steps)}" y="${height - 8}">${grouped(Math.round(part * steps))}</text>`,
  );
  const about = (run, k) =>
    `${RUNS[run]}, ${runs[run].title}, after ${grouped(runs[run].points[k].steps)} steps: ${name(runs[run].points[k][metric])}`;
  const drawn = ({ points, kink }, run) => {
    const here =
      kink === null
        ? ""
        : `<path class="kink" d="M${x(points[kink].steps)} 4V${height - bottom}"/>`;
    const d = points
      .map((each, k) => `${k ? "L" : "M"}${x(each.steps)} ${y(each[metric])}`)
      .join("");
    const dot = (each, k) => {
      const on = point?.[0] === run && point[1] === k ? "on" : "";
      const ask = escaped(JSON.stringify({ kind: "race", point: [run, k] }));
      return `<circle class="dot ${on}" cx="${x(each.steps)}" cy="${y(each[metric])}" r="${3.5 + 2 * run}" data-ask="${ask}"
        ><title>${about(run, k)}</title></circle>`;
    };
    return `<g class="${RUNS[run]}">${here}<path class="curve" d="${d}" pathLength="1"/>${points.map(dot).join("")}</g>`;
  };
  const told = point ? about(...point) : "no point chosen";
  return `<svg class="curves" viewBox="0 0 ${width} ${height}" role="slider" tabindex="0" aria-label="points of the curves; up and down: the other curve"
    aria-valuemin="1" aria-valuemax="${runs[0].points.length}" aria-valuenow="${point ? point[1] + 1 : 1}" aria-valuetext="${escaped(told)}">
    ${ticks.join("")}${times.join("")}<text x="${width - 12}" y="${height - 8}">${grouped(steps)} steps</text>
    ${runs.map(drawn).reverse().join("")}</svg>`;
}
