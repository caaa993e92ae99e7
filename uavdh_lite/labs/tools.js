// The six tools. Each has what its panel says, as HTML, and what it adds to the map and to the panel
// at a moment. `scene` is what Python sent, `stage` is where it is shown.

const WORDS = {
  UAV: "the drone: it flies 10 m above the ground, one cell in a step",
  shadow: "cells that a building hides from a device: the radio link is much weaker there",
  agent: "a neural network that learned to fly from its own trials",
  greedy: "a simple rule: to the nearest device with data, and home in time",
  "data units": "what the devices have for the UAV to collect",
  return: "the sum of rewards: a unit of data is 1, a step −0.2, a refused action −1, a crash −150",
  landed: "the share of missions that ended in the landing zone in time",
  fading: "luck of the radio link: the same draws for all who fly a mission",
  "Q-value": "the return that the agent expects from here on if it takes this action now",
  score: "how surely the planner that the agent copied would take this action",
  SNR: "signal-to-noise ratio: how far the signal is above the noise, in decibels",
  dB: "decibels, a logarithmic scale: 10 dB are ten times, 20 dB a hundred times",
  slot: "a quarter of a step; each goes to the device that is heard best",
  value: "the best value if the UAV were over that cell now",
  "collected and landed": "the share of the data that was brought home; 0 after a crash",
  collected: "the share of the data that was collected, landed or not",
  ghost: "the flight of your rival in the same mission, with the same fading, as far as you are",
  "path loss": "what the signal loses on its way, where nothing hides it: 22.7 dB each time the distance is ten times as long",
  layer: "a map laid over the city: five that the network sees, and the value of each cell",
  failsafe: "a rule that refuses what would leave too little time to fly home",
  "DDQN agent": "a neural network that learned by the paper's method, from its own trials",
  "imitation agent": "a neural network that learned to copy a planner, then from its own trials",
  "any-city agent": "one neural network for any city of at most 16 by 16 cells",
  "half-trained agent": "the same as the DDQN agent, early in its training",
  "paper's own agent": "a neural network trained with all constants of the paper",
  genie: "a planner that searches with full knowledge; no agent can know so much",
};
const term = (word, shown = word) =>
  `<span class="term" tabindex="0" role="note" aria-label="${word}: ${WORDS[word]}"
    data-about="${escaped(WORDS[word])}">${shown}</span>`;
// A text in which names explain themselves
const explained = (text) =>
  escaped(text).replace(/\b(greedy|genie|agent|failsafe)\b/gi, (word) => term(word.toLowerCase(), word));
const button = (name, about, more = "") =>
  `<button type="button" data-ask="${escaped(JSON.stringify(about))}" ${more}>${name}</button>`;
const options = (pairs, chosen) =>
  pairs
    .map(([value, name]) => {
      const selected = value === chosen ? "selected" : "";
      return `<option value="${escaped(value)}" ${selected}>${escaped(name)}</option>`;
    })
    .join("");
// A list with its label; a question mark explains what was chosen
function chooser(label, name, pairs, chosen) {
  const [, shown] = pairs.find(([value]) => value === chosen) ?? [];
  return `<span class="chooser">${WORDS[label] ? term(label) : label} <select data-set="${name}"
    aria-label="${label}">${options(pairs, chosen)}</select>${WORDS[shown] ? term(shown, "?") : ""}</span>`;
}
const units = (amount) => (amount >= 0.1 ? amount.toFixed(1) : amount.toPrecision(1));
const signed = (value) => (value <= -0.05 ? "−" : "") + Math.abs(value).toFixed(1);
const gapOf = (gap) => (gap < 0.005 ? "less than 0.01" : gap.toFixed(2));
const grouped = (number) => number.toLocaleString("en");
const upper = (text) => text[0].toUpperCase() + text.slice(1);
const choosePolicy = ({ state }, which, label) =>
  chooser(label, `policy-${which}`, state.known, state.policies[which]);

// Colours of a scale from 0 to 1, which colour-blind readers can follow too (viridis)
const SCALE = ["68 1 84", "59 82 139", "33 145 140", "94 201 98", "253 231 37"].map((rgb) =>
  rgb.split(" ").map(Number),
);
function colourOf(share) {
  const place = Math.min(Math.max(share, 0), 1) * (SCALE.length - 1);
  const k = Math.min(Math.floor(place), SCALE.length - 2);
  const mixed = SCALE[k].map((low, c) => Math.round(low + (place - k) * (SCALE[k + 1][c] - low)));
  return `rgb(${mixed.join(" ")})`;
}
const GRADIENT = `linear-gradient(to right, ${[0, 0.25, 0.5, 0.75, 1].map(colourOf).join(", ")})`;

// Squares in the colours of a map's values; null is left out.
const heat = (values, colour, opacity = 0.85) =>
  `<g fill-opacity="${opacity}" shape-rendering="crispEdges">${values
    .flatMap((row, y) => row.map((each, x) => [each, x, y]))
    .filter(([each]) => each !== null)
    .map(([each, x, y]) => `<path d="M${x - 0.5} ${y - 0.5}${SQUARE}" fill="${colour(each)}"/>`)
    .join("")}</g>`;
const range = (values) => {
  const known = values.flat().filter((each) => each !== null);
  return [Math.min(...known), Math.max(...known)];
};
const ramp = (low, high, about) =>
  `<div class="ramp"><span>${low}</span><i style="background: ${GRADIENT}"></i><span>${high}</span>
    <small>${about}</small></div>`;

// The outline of the cells of a map for which something holds
function outline(rows, holds) {
  const inside = (y, x) => rows[y]?.[x] !== undefined && holds(rows[y][x]);
  let d = "";
  rows.forEach((row, y) =>
    [...row].forEach((_, x) => {
      if (!inside(y, x)) return;
      const [left, top] = [x - 0.5, y - 0.5];
      if (!inside(y - 1, x)) d += `M${left} ${top}h1`;
      if (!inside(y + 1, x)) d += `M${left} ${top + 1}h1`;
      if (!inside(y, x - 1)) d += `M${left} ${top}v1`;
      if (!inside(y, x + 1)) d += `M${left + 1} ${top}v1`;
    }),
  );
  return `<path class="outline" d="${d}"/>`;
}

// Rows of a table with a column for each policy
const line = (name, results, show) =>
  `<tr><th>${name}</th>${results.map((each) => `<td>${show(each)}</td>`).join("")}</tr>`;
const average = ({ panel: { many } }) => {
  if (!many) return "";
  const mean = (metric) => ({ [metric]: [middle, low, high] }) =>
    `${middle} % <small>${low}–${high}</small>`;
  return `<tbody class="many">${line("mean of 100, 95 % interval", many, ({ name }) => explained(name))}
    ${line(term("collected and landed"), many, mean("collected_and_landed"))}
    ${line(term("landed"), many, mean("landed"))}${line("time used", many, (row) => `${row.time_used[0]} %`)}</tbody>`;
};
const manyButton = button("100 missions", { kind: "many" }, 'data-busy="flying 100 missions …"');

const ARROWS = { ArrowUp: "north", ArrowRight: "east", ArrowDown: "south", ArrowLeft: "west" };
const WAYS = { north: [-1, 0], east: [0, 1], south: [1, 0], west: [0, -1] };
const TOOLS = {
  fly: {
    title: "Fly",
    html(scene) {
      const { you, ghost, ranking, rival_name: rival } = scene.panel;
      const refusals = scene.film.flights[0].refused.filter((action) => action);
      const refused = scene.film.flights[0].refused.at(-1);
      const no = refused && !you.ended ? this.refusal(scene.film, refused) : "";
      const key = (action, sign) =>
        button(sign, { kind: "fly", action }, `class="${action}" aria-label="${action}"`);
      const pad = `<div class="pad">${key("north", "↑")}${key("west", "←")}${key("hover", "hover")}
        ${key("east", "→")}${key("south", "↓")}${key("land", "land")}</div>`;
      const rank = (each, k) => `<tr><td>${k + 1}</td><td>${escaped(each.city)}</td><td>${each.time}</td>
        <td>${signed(each.ahead)}</td>
        <td>${each.landed ? each.collected.toFixed(1) : "crashed"}</td></tr>`;
      const table = ranking.length
        ? `<table class="ranking"><caption>Your flights in this session, the best first</caption>
            <tr><th></th><th>city</th><th>time given</th><th>${term("return")} against ghost</th><th>data</th></tr>
            ${ranking.map(rank).join("")}</table>`
        : "";
      const head = you.ended ? this.card(you, ghost, rival, refusals) : this.help(you, rival);
      const known = scene.state.known.filter(([name]) => name !== "you");
      return `<div class="head">${head}</div><p class="no" role="status">${no}</p><div class="beside">${pad}${table}</div>
        <div class="row">${button("Again", { kind: "again" })}
        ${chooser("ghost", "policy-1", known, scene.panel.rival)}</div>`;
    },
    refusal({ city, flights: [{ path }] }, action) {
      const [[row, col], [down, right]] = [path.at(-1), WAYS[action] ?? [0, 0]];
      const there = KINDS[city[row + down]?.[col + right]];
      const inTheWay = there ? `a ${there.name}` : "the edge of the city";
      const why = action === "land" ? "you can only land in blue" : inTheWay;
      return `<b>Refused: ${action}</b>, ${why}. One unit of time is gone.`;
    },
    help: (you, rival) =>
      `<h2>${you.steps ? `${you.time_left} units of time left` : "Your flight"}</h2>
      <p>Collect the ${term("data units", "data")} and land in blue in time. Arrow keys move, space
      hovers, L lands; or press the buttons. The pale ${term("UAV")} is the ${term("ghost")}, flown by ${explained(rival)}.</p>`,
    card(you, ghost, rival, no) {
      const ahead = you.return - ghost.return;
      const home = (each) => `${each.collected.toFixed(1)} units in ${each.steps} step${each.steps === 1 ? "" : "s"}`;
      const end = you.landed ? `You landed with ${home(you)}.` : "The time ran out before you landed.";
      const other = ghost.landed ? home(ghost) : "a crash";
      const refused = no.length ? ` Refused: ${no.length}, each costs 1 and a step.` : "";
      const names = ahead > 0 ? "You win" : `${upper(escaped(rival))} wins`;
      return `<div class="card" role="status"><h2>${Math.abs(ahead) < 0.05 ? "Level" : names}</h2>
        <p>${end}${refused} ${explained(upper(rival))}: ${other}. ${term("return", "Return")}:
        ${signed(you.return)} against ${signed(ghost.return)}.</p></div>`;
    },
    over: () => `<path class="ghost-path"/><g class="uav ghost">${UAV}</g>`,
    keys: { ...ARROWS, " ": "hover", l: "land", L: "land" },
    // The ghost and its trail, as far as it has come at this time
    moment(stage, { film }, time) {
      const { path } = film.flights[1];
      const { place } = momentAt(film.flights[1], time);
      const trail = [...path.slice(0, Math.floor(time) + 1), place].map(([row, col]) => `${col} ${row}`);
      stage.find(".ghost")?.setAttribute("transform", at(place));
      stage.find(".ghost-path")?.setAttribute("d", `M${trail.join("L")}`);
    },
  },

  compare: {
    title: "Compare",
    html(scene) {
      const { verdict, why, parting, look, results } = scene.panel;
      const duel = (name, wanted) =>
        button(name, { kind: "duel", wanted }, 'data-busy="looking for a duel …"');
      const [first, second] = results.map(({ name }) => escaped(name));
      const brought = ({ landed, collected }) => (landed ? collected.toFixed(1) : "0, crashed");
      const flown = `${line("", results, ({ name }) => explained(name))}
        ${line(`${term("data units", "data")} brought home`, results, brought)}
        ${line("time used", results, ({ steps }) => steps)}
        ${line(term("return"), results, (each) => signed(each.return))}`;
      const show = (step) => button(step + 1, { show: step }, `aria-label="stop before step ${step + 1}"`);
      const go = look.length ? `Stop before step ${look.map(show).join("")}` : "";
      return `<h2>${explained(verdict)}</h2><p class="why">${explained(why)}</p>
        <div class="row">${go}${manyButton}</div>
        <div class="row">Find a duel: ${duel(`${first} wins`, 1)}
        ${duel(`${second} wins`, -1)}${duel("nearly level", 0)}</div>
        <div class="row">${choosePolicy(scene, 0, "left")}${choosePolicy(scene, 1, "right")}</div>
        <table>${average(scene) || flown}</table>
        <p><small>${parting === null ? "" : `Orange ring: where each is before step ${parting + 1}.`}</small></p>`;
    },
    over({ film, panel }, k) {
      if (panel.parting === null) return "";
      const { path } = film.flights[k];
      const [row, col] = path[Math.min(panel.parting, path.length - 1)];
      return `<circle class="parting" cx="${col}" cy="${row}" r=".75"/>`;
    },
  },

  think: {
    title: "Think",
    html({ panel }) {
      if (panel.agent === null) {
        return `<h2>No agent knows this city</h2><p>Choose another city, or paint one of at most 16
          by 16 cells: the ${term("agent")} for any city flies there.</p>`;
      }
      const layers = ["none", ...SEEN, "value"].map((name) => [name, name]);
      const close = gapOf(panel.gaps[panel.closest]);
      const note = panel.note && `<p><b>${explained(upper(panel.note))}.</b></p>`;
      return `${note}<p class="says-why" role="status"></p><h3>${term(panel.number, `${panel.number}s`)}: below the best (<span
        class="most"></span>)</h3><div class="q"></div>
        <div class="row">${button("Closest call", { show: panel.closest })}
        <small>step ${panel.closest + 1}: a gap of ${close}</small></div>
        <div class="row">${chooser("layer", "layer", layers, stage_layer.name)}
        <label><input type="checkbox" data-set="centred" ${stage_layer.centred ? "checked" : ""}>
        centred, as it sees it</label></div><div class="layer-scale"></div>
        <p class="meaning"></p>
        <div class="row">${chooser("who thinks", "policy-0", panel.agents, panel.chosen)}</div>`;
    },
    over: () => '<g class="layer"></g>',
    moment(stage, { panel, film, state }, time) {
      if (panel.agent === null) return;
      const step = Math.min(Math.floor(time + 1e-9), panel.q.length - 1);
      const [{ path, end }] = film.flights;
      const over = `It has ${end}. Below: what it thought before its last step.`;
      stage.fill(".says-why", time >= path.length - 1 ? over : `Next, step ${step + 1}: ${panel.says[step]}`);
      const values = panel.q[step];
      const best = Math.max(...values.filter((each) => each !== null));
      const most = Math.max(0.5, ...values.map((each) => (each === null ? 0 : best - each)));
      const bar = (value, k) => {
        const name = panel.actions[k];
        if (value === null) return `<div><span>${name}</span><i></i><b>not allowed</b></div>`;
        const width = (100 * (best - value)) / most;
        const text = value === best ? "the best" : gapOf(best - value).replace("less than", "<");
        return `<div class="${value === best ? "best" : ""}"><span>${name}</span>
          <i><u style="width: ${width}%"></u></i><b>${text}</b></div>`;
      };
      stage.fill(".q", values.map(bar).join(""));
      stage.fill(".most", signed(best));
      this.layer(stage, { panel, film, state }, step, time);
    },
    layer(stage, { panel, film }, step, time) {
      const { name, centred } = stage_layer;
      const here = film.flights[0].path[step];
      stage.centre(centred ? momentAt(film.flights[0], time).place : null);
      const group = stage.find(".layer");
      stage.find(".main").classList.toggle("layered", name !== "none");
      stage.find(".main").classList.toggle("seen", SEEN.includes(name));
      if (!group) return;
      if (name === "none") group.innerHTML = "";
      else if (SEEN.includes(name)) group.innerHTML = seenLayer(film, name, step);
      else if (panel.values) {
        const [least, high] = range(panel.values.values);
        const low = Math.max(least, high - FAR);
        const colour = (value) => colourOf((value - low) / (high - low || 1));
        group.innerHTML = heat(panel.values.values, colour);
        const lowest = `${signed(low)}${low > least ? " or less" : ""}`;
        stage.fill(".layer-scale", ramp(lowest, signed(high), `value: ${WORDS.value}`));
      }
      if (centred) group.innerHTML += outside(film.city.length, name);
      if (name !== "value") stage.fill(".layer-scale", "");
      else if (panel.values?.step !== step && here) stage.askWhenFree({ kind: "values", step });
      stage.fill(".meaning", MEANINGS[name] ?? (centred ? CENTRED : ""));
    },
  },

  channel: {
    title: "Channel",
    html(scene) {
      const { panel, state } = scene;
      const [low, high] = panel.range;
      const device = (_, k) =>
        button(`device ${k}`, { kind: "look", device: k }, `aria-pressed="${k === panel.device}"`);
      return `<p class="sentence" role="status"></p><table class="ledger"></table>
        <div class="row">${state.devices.map(device).join("")}</div>
        ${ramp(`${low} dB`.replace("-", "−"), `${high} dB`, `${upper(term("SNR"))} from device
          ${panel.device} over each cell, without ${term("fading")}. Point at a cell to see its link. White line: the
          edge of the ${term("shadow", "shadows")}, which are on its darker side.`)}`;
    },
    under: ({ panel: { snr, range: [low, high] } }) =>
      heat(snr, (value) => colourOf((value - low) / (high - low)), 0.9),
    over: ({ panel }) =>
      `${outline(panel.building, (each) => each > 0)}<path class="ray"/>`,
    point(stage, scene, cell) {
      const { panel, state, film } = scene;
      const [row, col] = cell ?? panel.dearest;
      const [y, x] = state.devices[panel.device].cell;
      const cost = panel.building[row][col];
      stage.find(".ray")?.setAttribute("d", `M${x} ${y}L${col} ${row}`);
      stage.find(".ray")?.classList.toggle("blocked", cost > 0);
      const rate = `${units(panel.rate[row][col])} units a ${term("slot")}`;
      const free = Math.log2(1 + 10 ** ((panel.snr[row][col] + cost) / 10));
      const where = `Row ${row}, column ${col}`;
      const there = KINDS[film.city[row][col]]?.name ?? "open ground";
      const costs = `Behind a building: it costs ${cost.toFixed(1)} ${term("dB")}.`;
      const [head, instead] = cost > 0 ? [costs, ` instead of ${units(free)}`] : ["In sight.", ""];
      stage.fill(".sentence", `<b>${head}</b> ${where}, ${there}: ${rate}${instead}.`);
      const line = (name, value) => `<tr><th>${name}</th><td>${value} dB</td></tr>`;
      const metres = panel.distance[row][col].toFixed(0);
      const lines = [
        ["signal at 1 m", signed(panel.transmit)],
        [`${term("path loss")} over ${metres} m`, `−${signed(panel.path_loss[row][col])}`],
        ["buildings in between", cost > 0 ? `−${signed(cost)}` : "0.0"],
        [term("SNR"), signed(panel.snr[row][col])],
        [term("fading"), `± ${panel.fading[Number(cost > 0)]}`],
      ];
      stage.fill(".ledger", lines.map((each) => line(...each)).join(""));
    },
  },

  paint: {
    title: "Paint",
    html(scene) {
      const swatch = ([sign, { name }]) => `<button type="button" class="swatch" data-sign="${sign}"
        aria-pressed="${sign === brush.sign}"><svg viewBox="-.6 -.6 1.2 1.2"><path class="paper"
        d="M-.5 -.5${SQUARE}"/>${sign === "." ? "" : cells([sign], sign)}</svg>
        ${name.split(":")[0]}</button>`;
      const all = [[".", { name: "open ground" }], ...Object.entries(KINDS)];
      return `<h2>Paint the city</h2><p>Draw with the pointer, and drag devices where you want
        them. Violet: from where a device at the pointer could not be seen, its ${term("shadow")}.</p>
        <div class="swatches">${all.map(swatch).join("")}</div>
        <div class="row">${manyButton}${button("Save as PNG", { kind: "save", what: "png" })}</div>
        <table>${average(scene)}</table>
        <div class="row">${choosePolicy(scene, 0, "first")}${choosePolicy(scene, 1, "second")}</div>`;
    },
    over: () => '<path class="shadow live"/><path class="fresh"/>',
    point(stage, scene, cell) {
      if (brush.cells) return;
      if (!cell) return stage.find(".live")?.setAttribute("d", "");
      const { shadow: known } = scene.panel;
      if (known && String(known.cell) === String(cell)) {
        stage.find(".live")?.setAttribute("d", tiles(known.rows, "#", SQUARE));
      } else stage.askWhenFree({ kind: "shadow", cell });
    },
  },

  train: {
    title: "Train",
    html(scene) {
      const { settings, runs, sentences, running, largest, finished, error } = scene.panel;
      const known = Object.entries(settings).map(([name, [title]]) => [name, title]);
      chosen.train ??= runs.length ? runs.map(({ setting }) => setting) : ["small", "no fear"];
      const own = chosen.train;
      const go = running
        ? button("Pause", { kind: "pause" })
        : `${runs.length && !finished ? button("Go on", { kind: "train", settings: [] }) : ""}
          <button type="button" class="begin">${runs.length ? "New race" : "Start"}</button>`;
      const large = scene.film.city.length > largest;
      const where = large ? "A city of this size takes minutes to learn: they race over the village." : "";
      const rival = own[1] ? `<br>Orange: ${escaped(settings[own[1]][1])}` : "";
      const shown = CURVES.map((name) => [name, name.replaceAll("_", " ")]);
      const [flight] = scene.film.flights;
      const titles = own.filter((name) => name).map((name) => settings[name][0]);
      const other = runs.length > 0 && !running && String(titles) !== String(runs.map(({ title }) => title));
      const ran = ({ title }, k) => `${COLOURS[k]}: ${title}`; // others may be chosen since
      const racer = (colour, pairs, k) => `<span class="racer"><span class="key ${colour}"></span>
        ${chooser(colour, colour, pairs, own[k] ?? "")}</span>`;
      return `<div class="row">${racer("blue", known, 0)}
        ${racer("orange", [["", "nobody"], ...known], 1)}</div>
        <p class="setting">${other ? "For a new race. " : ""}Blue: ${escaped(settings[own[0]][1])}${rival}</p><p>${where}</p>
        <div class="row">${go}${chooser("shown", "metric", shown, chosen.metric)}</div>
        ${runs.length ? `${curves(scene.panel, chosen.metric)}<p>The curves: ${runs.map(ran).join("; ")}.</p>` : ""}
        <p class="verdict" role="status">${(sentences ?? []).map(escaped).join("<br>")}</p><p role="alert">${escaped(error ?? "")}</p>
        <p>A point: 100 missions that it does not learn from.
        ${runs.length ? "Press near one to see its agent fly." : ""}</p>
        <p class="flies">This flight: ${explained(flight.name)}. ${flight.ending}</p>`;
    },
  },
};

const OWN = "labs" in document.documentElement.dataset; // the page is ours, with its address
const COLOURS = ["blue", "orange"]; // of the runs
const CURVES = ["collected_and_landed", "collected", "landed", "return"];
const brush = { sign: "B", cells: null }; // cells: those of the stroke that is being painted
const chosen = { train: null, metric: "landed" };
const stage_layer = { name: "none", centred: false };
const FAR = 15; // below the best value; the colours do not tell what is farther
const CENTRED = "The network sees all layers shifted so that the UAV is in the middle.";
const MEANINGS = {
  "landing zone": "One of five layers that the network sees: where it may land.",
  "no-fly zone": "One of five layers: where it may not fly. Outside of the city, too.",
  buildings: "One of five layers: what blocks the radio link.",
  "data left": "One of five layers: data still to be collected, in the cells of the devices.",
  "data collected": "One of five layers: data that it has collected, in the same cells.",
};

const SEEN = Object.keys(MEANINGS);

// What the network sees of the city in one of its layers
function seenLayer({ city, devices, flights }, name, step) {
  const signs = { "landing zone": "L", "no-fly zone": "NB", buildings: "bB" }[name] ?? "";
  const rows = city.map((row) => [...row]);
  const layer = heat(rows, (sign) => (signs.includes(sign) ? "#0072b2" : "#8883"), 1);
  if (signs) return layer;
  const [now, first] = [flights[0].left[step], flights[0].left[0]];
  const most = Math.max(...first.slice(0, -1));
  const full = devices.map(({ cell: [row, col] }, k) => {
    const amount = name === "data left" ? now[k] : first[k] - now[k];
    const square = `M${col - 0.5} ${row - 0.5}${SQUARE}`;
    return `<path d="${square}" fill="#0072b2" fill-opacity="${amount / most}"/>`;
  });
  return layer + full.join("");
}

// All around a city of this size lies a no-fly zone, as far as the network sees
function outside(size, name) {
  const around = `M${-size} ${-size}h${3 * size}v${3 * size}h${-3 * size}z`;
  const d = `${around}M-.5 -.5v${size}h${size}v${-size}z`;
  return `<path class="outside" d="${d}" fill="${name === "no-fly zone" ? "#0072b2" : "#d6333f"}"/>`;
}

// The curves of a race: points by steps, each a button; full blue lies on a wider, open orange
function curves({ runs, steps, point }, metric) {
  const [width, height, left, bottom] = [420, 195, 44, 26];
  const share = metric !== "return";
  const [low, high] = share ? [0, 1] : [-200, 40]; // a crash costs 150
  const x = (at) => left + ((width - left - 12) * at) / steps;
  const y = (value) => 10 + ((height - bottom - 10) * (high - Math.max(value, low))) / (high - low);
  const name = (value) => (share ? `${Math.round(100 * value)} %` : value.toFixed(0));
  const ticks = [low, (low + high) / 2, high].map(
    (tick) => `<path class="grid" d="M${left} ${y(tick)}H${width - 12}"/>
      <text x="${left - 6}" y="${y(tick)}" text-anchor="end">${name(tick)}</text>`,
  );
  const line = ({ points, title, kink }, k) => {
    const colour = COLOURS[k];
    const here = kink === null ? "" : `<path class="kink" d="M${x(points[kink].steps)} 4V${height - bottom}"/>`;
    const d = points.map((each, n) => `${n ? "L" : "M"}${x(each.steps)} ${y(each[metric])}`).join("");
    const dot = (each, n) => {
      const about = `${title}, after ${grouped(each.steps)} steps: ${name(each[metric])}`;
      const on = point?.[0] === k && point[1] === n;
      const ask = escaped(JSON.stringify({ kind: "point", run: k, point: n }));
      const [r, mark] = [3.5 + 2 * k, on ? "on" : ""];
      const place = `cx="${x(each.steps)}" cy="${y(each[metric])}" r="${r}"`;
      return `<circle class="dot ${mark}" ${place} role="button" tabindex="0" data-ask="${ask}"
        aria-label="${about}"><title>${about}</title></circle>`;
    };
    return `<g class="${colour}">${here}<path class="curve" d="${d}"/>${points.map(dot).join("")}</g>`;
  };
  return `<svg class="curves" viewBox="0 0 ${width} ${height}" role="group" aria-label="curves">
    ${ticks.join("")}<text x="${width - 12}" y="${height - 8}" text-anchor="end">${grouped(steps)} steps</text>
    <text x="${left}" y="${height - 8}">0</text>${runs.map(line).reverse().join("")}</svg>`;
}
